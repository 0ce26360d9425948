//! Frames that do not lie together, or come one by one.

use super::*;

#[test]
fn frames_that_lie_apart_or_come_one_by_one_make_the_same_file() {
    for bits in [1, 8, 12, 16] {
        let layout = RawLayout { bits, ..LAYOUT };
        let folders = [(); 3].map(|()| tempfile::tempdir().unwrap());
        let [(together, _), (apart, apart_store), (one_by_one, stream)] =
            [0, 1, 2].map(|at| new_store(&folders[at], layout));
        let store = RawStore::open(&together).unwrap();
        write_all(&store, 0);
        for index in 0..store.segments() {
            let range = store.segment_range(index);
            let Segment {
                frames,
                records,
                tally,
            } = segment(&layout, range.clone(), 0);
            let frame = layout.height * layout.width * layout.channels;
            let each: Vec<Vec<u16>> = frames.chunks(frame).map(<[u16]>::to_vec).collect();
            apart_store.write_frames(index, &each, &records, &tally).unwrap();
            let mut writer = stream.begin_segment(index).unwrap();
            for (done, one) in each.iter().enumerate() {
                assert_eq!(writer.missing(), range.len() - done);
                let bytes: Vec<u8> = match bits {
                    ..=8 => one.iter().map(|&sample| sample as u8).collect(),
                    _ => one.iter().flat_map(|sample| sample.to_le_bytes()).collect(),
                };
                writer.push(&[&bytes]).unwrap();
            }
            writer.finish(&records, &tally).unwrap();
        }
        let expected = tree(&together);
        assert!(tree(&apart) == expected, "{bits}");
        assert!(tree(&one_by_one) == expected, "{bits}");
    }
}

#[test]
fn a_segment_in_pieces_is_refused_where_it_does_not_fit_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (path, store) = new_store(&folder, LAYOUT);
    let before = tree(&path);
    let frame: &[u8] = &[0; 60];
    assert!(
        store
            .begin_segment(1)
            .unwrap_err()
            .to_string()
            .contains("0, the next one")
    );
    let mut writer = store.begin_segment(0).unwrap();
    // 13 bits.
    let error = writer.push(&[&[0xff, 0x1f]]).unwrap_err().to_string();
    assert!(error.contains("at most 4095 (12 bits)"), "{error}");
    writer.push(&[frame, frame]).unwrap();
    let records = segment(&LAYOUT, 0..4, 0).records;
    let error = writer
        .finish(&records, &Tally::default())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("frames of segment 0: expected 4, found 2 less"),
        "{error}"
    );
    let mut writer = store.begin_segment(0).unwrap();
    writer.push(&[frame; 4]).unwrap();
    assert!(writer.push(&[frame]).is_err());
    let error = writer
        .finish(&records[..3], &Tally::default())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("records of segment 0: expected 4, found 3"),
        "{error}"
    );
    assert!(tree(&path) == before);
}

#[test]
fn a_file_ends_where_its_frames_do() {
    for exposures in [1, 3, 4, 5, 8] {
        let folder = tempfile::tempdir().unwrap();
        let (path, store) = new_store(&folder, LAYOUT);
        let all = segment(&LAYOUT, 0..exposures, 3);
        let frames: Vec<&[u16]> = all.frames.chunks(30).collect();
        for (index, range) in (0..exposures)
            .step_by(4)
            .map(|at| at..exposures.min(at + 4))
            .enumerate()
        {
            let mut writer = store.begin_segment(index).unwrap();
            for frame in &frames[range.clone()] {
                let bytes: Vec<u8> = frame.iter().flat_map(|sample| sample.to_le_bytes()).collect();
                writer.push(&[&bytes]).unwrap();
            }
            let records = all.records[range].to_vec();
            writer.finish_short(records, &Tally::default()).unwrap();
        }
        assert!(store.end_after(LAYOUT.exposures + 1).is_err());
        let ended = RawStore::open(&path).unwrap().end_after(exposures).unwrap();
        ended.sync().unwrap();
        assert_eq!(ended.layout().exposures, exposures);
        assert_eq!(ended.whole_segments().unwrap(), exposures.div_ceil(4));
        let read: Vec<Segment> = (0..ended.segments())
            .map(|index| ended.read_segment(index).unwrap())
            .collect();
        assert_eq!(
            read.iter().flat_map(|one| one.frames.clone()).collect::<Vec<_>>(),
            all.frames
        );
        assert_eq!(
            read.iter()
                .flat_map(|one| one.records.clone())
                .collect::<Vec<_>>(),
            all.records
        );
    }
}
