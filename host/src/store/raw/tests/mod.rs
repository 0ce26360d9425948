use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use serde_json::json;

use super::*;
use crate::store::OrphanFrame;

mod hostile;
mod pieces;

const LAYOUT: RawLayout = RawLayout {
    exposures: 10,
    segment: 4,
    height: 3,
    width: 5,
    channels: 2,
    bits: 12,
    clock_hz: 125_000_000,
};

/// A segment whose every value differs from its neighbours'.
fn segment(layout: &RawLayout, range: Range<usize>, seed: u64) -> Segment {
    let per_frame = layout.height * layout.width * layout.channels;
    let frames = (range.start * per_frame..range.end * per_frame)
        .map(|i| ((i as u64 * 7 + seed) % (u64::from(layout.largest_sample()) + 1)) as u16)
        .collect();
    let records = range
        .map(|i| {
            let n = i as u64 + seed;
            ExposureRecord {
                incident: n.cast_signed() - 1,
                kind: (n % 3) as u8,
                exposure_s: 0.001 * n as f64,
                trigger_tick: n << 40,
                strobe_on_tick: (n << 40) + 1,
                strobe_off_tick: (n << 40) + 2,
                frame_id: u64::MAX - n - 1,
                camera_timestamp_s: 1000.0 + n as f64 / 7.0,
                attempts: n as u8 + 1,
                flags: n as u16 * 257,
                lit_solid_angle_sr: 0.1 / (n as f64 + 1.0),
                lit_irradiance: -1.5 * n as f64,
            }
        })
        .collect();
    Segment {
        frames,
        records,
        tally: tally(seed),
    }
}

/// A tally with as many orphans as `seed` says, up to two.
fn tally(seed: u64) -> Tally {
    let orphan_frames: Vec<OrphanFrame> = (0..seed % 3)
        .map(|n| OrphanFrame {
            frame_id: seed + n,
            timestamp_s: 0.5 * n as f64,
        })
        .collect();
    Tally {
        paired: 4 + seed,
        missed_triggers: seed * 3,
        repeated: 1 << 40,
        orphans: orphan_frames.len() as u64,
        orphan_frames,
        ..Tally::default()
    }
}

fn new_store(folder: &tempfile::TempDir, layout: RawLayout) -> (PathBuf, RawStore) {
    let path = folder.path().join("raw.zarr");
    let store = RawStore::create(&path, layout, Map::new()).unwrap();
    (path, store)
}

fn write_all(store: &RawStore, from: usize) {
    for index in from..store.segments() {
        store
            .write_segment(index, &segment(store.layout(), store.segment_range(index), 0))
            .unwrap();
    }
}

fn whole_store(folder: &tempfile::TempDir) -> (PathBuf, RawStore) {
    let (path, store) = new_store(folder, LAYOUT);
    write_all(&store, 0);
    (path, store)
}

/// Every file below `root` with its content.
fn tree(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![root.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.insert(
                    path.strip_prefix(root).unwrap().to_path_buf(),
                    fs::read(&path).unwrap(),
                );
            }
        }
    }
    files
}

#[test]
fn what_is_written_is_read_for_every_depth_and_a_partial_last_segment() {
    for bits in [1, 8, 9, 12, 16] {
        for exposures in [1, 3, 4, 10, 12] {
            let folder = tempfile::tempdir().unwrap();
            let layout = RawLayout {
                exposures,
                bits,
                ..LAYOUT
            };
            let mut attributes = Map::new();
            attributes.insert("sample".into(), json!({"name": "brass", "seed": 7}));
            let path = folder.path().join("raw.zarr");
            let written = RawStore::create(&path, layout, attributes).unwrap();
            write_all(&written, 0);

            let read = RawStore::open(&path).unwrap();
            assert_eq!(read.layout(), &layout);
            assert_eq!(read.attributes(), written.attributes());
            assert_eq!(read.attributes()["sample"]["name"], "brass");
            assert_eq!(read.segments(), exposures.div_ceil(4));
            assert_eq!(read.whole_segments().unwrap(), read.segments());
            for index in 0..read.segments() {
                let range = read.segment_range(index);
                assert_eq!(
                    read.read_segment(index).unwrap(),
                    segment(&layout, range, 0),
                    "{bits} {index}"
                );
            }
            assert!(read.segment_range(read.segments()).is_empty());
            assert!(matches!(
                read.read_segment(read.segments()),
                Err(StoreError::Argument { .. })
            ));
            assert!(matches!(
                read.read_segment(usize::MAX),
                Err(StoreError::Argument { .. })
            ));
        }
    }
}

#[test]
fn a_killed_capture_goes_on_and_ends_in_the_same_bytes() {
    let undisturbed = tempfile::tempdir().unwrap();
    let (expected, _) = whole_store(&undisturbed);

    let folder = tempfile::tempdir().unwrap();
    let (path, store) = new_store(&folder, LAYOUT);
    store.write_segment(0, &segment(&LAYOUT, 0..4, 0)).unwrap();
    // Killed in segment 1: some records are there, another is half written, the frames too.
    store
        .records
        .write(1, &segment(&LAYOUT, 4..8, 99).records)
        .unwrap();
    fs::remove_file(path.join("lit_irradiance/c.1")).unwrap();
    fs::write(path.join("lit_irradiance/c.1.tmp-12345-7"), b"hal").unwrap();
    fs::write(path.join("frames/c.1.0.0.0.tmp-12345-8"), b"half a frame").unwrap();
    drop(store);

    let resumed = RawStore::open(&path).unwrap();
    assert_eq!(resumed.whole_segments().unwrap(), 1);
    write_all(&resumed, 1);
    assert_eq!(resumed.whole_segments().unwrap(), 3);
    assert_eq!(tree(&path), tree(&expected));
}

#[test]
fn a_flipped_byte_anywhere_ends_the_whole_prefix_and_is_named() {
    for (file, array) in [
        ("frames/c.1.0.0.0", "frames"),
        ("trigger_tick/c.1", "trigger_tick"),
        ("kind/c.1", "kind"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let (path, _) = whole_store(&folder);
        let whole = fs::read(path.join(file)).unwrap();
        for position in [0, whole.len() / 2, whole.len() - 1] {
            let mut damaged = whole.clone();
            damaged[position] ^= 0x10;
            fs::write(path.join(file), damaged).unwrap();
            let store = RawStore::open(&path).unwrap();
            assert_eq!(store.whole_segments().unwrap(), 1, "{file} {position}");
            let error = store.read_segment(1).unwrap_err();
            assert!(
                matches!(&error, StoreError::Checksum { chunk: 1, array: a, .. } if a == array),
                "{error}"
            );
            let told = error.to_string();
            assert!(
                told.contains(file) && told.contains("chunk 1") && told.contains(array),
                "{told}"
            );
        }
        // Written again, the store is whole again: what lies behind was never damaged.
        let store = RawStore::open(&path).unwrap();
        store.write_segment(1, &segment(&LAYOUT, 4..8, 0)).unwrap();
        assert_eq!(store.whole_segments().unwrap(), 3);
    }
}

#[test]
fn torn_emptied_and_missing_chunks_end_the_whole_prefix() {
    for file in ["frames/c.1.0.0.0", "frame_id/c.1", "flags/c.1"] {
        let folder = tempfile::tempdir().unwrap();
        let (path, _) = whole_store(&folder);
        let whole = fs::read(path.join(file)).unwrap();
        let longer = [&whole[..], &[0]].concat();
        // Four zero bytes are a right CRC-32C of nothing.
        for torn in [&whole[..whole.len() - 1], &whole[..3], &[], &[0; 4], &longer[..]] {
            fs::write(path.join(file), torn).unwrap();
            let store = RawStore::open(&path).unwrap();
            assert_eq!(store.whole_segments().unwrap(), 1);
            let error = store.read_segment(1).unwrap_err();
            assert!(matches!(error, StoreError::Chunk { chunk: 1, .. }), "{error}");
            assert!(
                error.to_string().contains(&format!("found {} bytes", torn.len())),
                "{error}"
            );
        }
        fs::remove_file(path.join(file)).unwrap();
        let store = RawStore::open(&path).unwrap();
        assert_eq!(store.whole_segments().unwrap(), 1);
        assert!(matches!(
            store.read_segment(1),
            Err(StoreError::Chunk { chunk: 1, .. })
        ));
        assert!(store.read_segment(2).is_ok());
    }
}

#[test]
fn only_the_next_segment_or_the_last_one_again_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (path, store) = new_store(&folder, LAYOUT);
    let refused = |store: &RawStore, index: usize| {
        let range = store.segment_range(index);
        matches!(
            store.write_segment(index, &segment(&LAYOUT, range, 1)),
            Err(StoreError::Argument { what, .. }) if what.contains("index")
        )
    };
    assert!(refused(&store, 1));
    store.write_segment(0, &segment(&LAYOUT, 0..4, 0)).unwrap();
    store.write_segment(0, &segment(&LAYOUT, 0..4, 5)).unwrap();
    assert_eq!(store.read_segment(0).unwrap(), segment(&LAYOUT, 0..4, 5));
    store.write_segment(1, &segment(&LAYOUT, 4..8, 0)).unwrap();
    assert!(refused(&store, 0));

    let reopened = RawStore::open(&path).unwrap();
    assert!(refused(&reopened, 0));
    reopened.write_segment(2, &segment(&LAYOUT, 8..10, 0)).unwrap();
    assert!(refused(&reopened, 0));
    assert_eq!(reopened.whole_segments().unwrap(), 3);
}

#[test]
fn data_that_do_not_fit_are_refused_and_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (path, store) = new_store(&folder, LAYOUT);
    let before = tree(&path);
    let good = segment(&LAYOUT, 0..4, 0);
    let mut short_frames = good.clone();
    short_frames.frames.pop();
    let mut short_records = good.clone();
    short_records.records.pop();
    let mut too_bright = good.clone();
    too_bright.frames[17] = 4096;
    for (index, bad) in [
        (0, &short_frames),
        (0, &short_records),
        (0, &too_bright),
        (2, &good),
        (3, &good),
    ] {
        let error = store.write_segment(index, bad).unwrap_err();
        assert!(matches!(error, StoreError::Argument { .. }), "{error}");
    }
    assert_eq!(tree(&path), before);
    store.write_segment(0, &good).unwrap();
}

#[test]
#[cfg(target_os = "linux")]
fn a_disk_that_fills_up_is_told_and_never_mixes_old_and_new() {
    let folder = tempfile::tempdir().unwrap();
    let (path, store) = new_store(&folder, LAYOUT);
    store.write_segment(0, &segment(&LAYOUT, 0..4, 0)).unwrap();
    // Every temporary of this file leads to the device that is always full.
    let fill = |file: &str| -> Vec<PathBuf> {
        let link = |n| path.join(format!("{file}.tmp-{}-{n}", std::process::id()));
        let links: Vec<PathBuf> = (0..100).map(link).collect();
        for link in &links {
            std::os::unix::fs::symlink("/dev/full", link).unwrap();
        }
        links
    };
    let free = |links: Vec<PathBuf>| links.iter().for_each(|link| drop(fs::remove_file(link)));

    let links = fill("frames/c.1.0.0.0");
    let error = store.write_segment(1, &segment(&LAYOUT, 4..8, 0)).unwrap_err();
    assert!(
        matches!(&error, StoreError::DiskFull { path, .. } if path.ends_with("frames/c.1.0.0.0")),
        "{error}"
    );
    assert_eq!(store.whole_segments().unwrap(), 1);
    free(links);
    store.write_segment(1, &segment(&LAYOUT, 4..8, 0)).unwrap();

    // Segment 1 is written again and fails midway: it must not count with new records and old frames.
    let links = fill("flags/c.1");
    let error = store.write_segment(1, &segment(&LAYOUT, 4..8, 3)).unwrap_err();
    assert!(matches!(error, StoreError::DiskFull { .. }), "{error}");
    assert_eq!(RawStore::open(&path).unwrap().whole_segments().unwrap(), 1);
    free(links);
    store.write_segment(1, &segment(&LAYOUT, 4..8, 3)).unwrap();
    assert_eq!(store.read_segment(1).unwrap(), segment(&LAYOUT, 4..8, 3));
    assert_eq!(store.whole_segments().unwrap(), 2);
}

#[test]
fn tallies_are_stored_with_their_segments_and_summed_over_them() {
    let folder = tempfile::tempdir().unwrap();
    let (path, store) = new_store(&folder, LAYOUT);
    let mut expected = Tally::default();
    for index in 0..store.segments() {
        let segment = segment(&LAYOUT, store.segment_range(index), index as u64 + 1);
        expected.add(&segment.tally);
        store.write_segment(index, &segment).unwrap();
        let found = RawStore::open(&path).unwrap();
        assert_eq!(found.tally().unwrap(), expected);
        assert_eq!(found.read_segment(index).unwrap(), segment);
    }
    assert_eq!(expected.orphan_frames.len(), 3);
    // Of more orphans than there are places the count tells.
    let folder = tempfile::tempdir().unwrap();
    let (_, store) = new_store(&folder, LAYOUT);
    let mut wild = segment(&LAYOUT, 0..4, 0);
    wild.tally.orphans = 5;
    wild.tally.orphan_frames = vec![
        OrphanFrame {
            frame_id: 7,
            timestamp_s: 0.25
        };
        5
    ];
    store.write_segment(0, &wild).unwrap();
    let found = store.read_segment(0).unwrap().tally;
    assert_eq!((found.orphans, found.orphan_frames.len()), (5, 4));
}

#[test]
fn a_chunk_that_belongs_elsewhere_is_found_though_it_is_undamaged() {
    let about = |what: &str| Map::from_iter([(SUBJECT.to_owned(), json!({ "plan.toml": what }))]);
    let folder = tempfile::tempdir().unwrap();
    let written = |name: &str, what: &str| {
        let path = folder.path().join(name);
        let store = RawStore::create(&path, LAYOUT, about(what)).unwrap();
        write_all(&store, 0);
        path
    };
    let (path, other) = (written("raw.zarr", "this"), written("other.zarr", "that"));
    for (from, to) in [
        // Of another segment, with other values.
        (path.join("frames/c.0.0.0.0"), "frames/c.1.0.0.0"),
        (path.join("trigger_tick/c.0"), "trigger_tick/c.1"),
        // Of another measurement, its seal too: the same values, of something else.
        (other.join("seal/c.1"), "seal/c.1"),
    ] {
        let target = path.join(to);
        let own = fs::read(&target).unwrap();
        fs::copy(from, &target).unwrap();
        let store = RawStore::open(&path).unwrap();
        assert_eq!(store.whole_segments().unwrap(), 1, "{to}");
        let told = store.read_segment(1).unwrap_err().to_string();
        assert!(told.contains("belongs to another"), "{told}");
        fs::write(&target, own).unwrap();
    }
    assert_eq!(RawStore::open(&path).unwrap().whole_segments().unwrap(), 3);
}

#[test]
fn no_data_equals_no_legal_value_and_units_are_told() {
    for bits in [7, 8, 12, 16] {
        let folder = tempfile::tempdir().unwrap();
        let (path, _) = new_store(&folder, RawLayout { bits, ..LAYOUT });
        let metadata = |name: &str| -> Value {
            serde_json::from_slice(&fs::read(path.join(name).join("zarr.json")).unwrap()).unwrap()
        };
        let arrays = fs::read_dir(&path)
            .unwrap()
            .flatten()
            .filter(|entry| entry.path().is_dir());
        for name in arrays.map(|entry| entry.file_name().into_string().unwrap()) {
            let array = metadata(&name);
            let (fill, attributes) = (&array["fill_value"], &array["attributes"]);
            match array["data_type"].as_str().unwrap() {
                "float64" => assert_eq!(fill, "NaN", "{name}"),
                // All numbers of such a camera are legal; `attempts` says what is there.
                _ if name == "frames" && [8, 16].contains(&bits) => {
                    assert!(attributes["_FillValue"].is_null());
                }
                _ => assert_eq!(fill, &attributes["_FillValue"], "{name}"),
            }
            if name == "frames" && bits == 12 {
                assert_eq!(fill, 65_535);
            }
            if name.ends_with("_tick") {
                assert_eq!(attributes["ticks_per_second"], 125_000_000, "{name}");
            }
            let words = |text: &Value| text.as_str().map_or(0, |text| text.split(' ').count());
            for codes in ["flag_values", "flag_masks"] {
                if let Some(codes) = attributes[codes].as_array() {
                    assert_eq!(words(&attributes["flag_meanings"]), codes.len(), "{name}");
                }
            }
        }
        assert!(metadata("kind")["attributes"]["flag_values"].is_array());
        assert!(metadata("flags")["attributes"]["flag_masks"].is_array());
        assert_eq!(metadata("incident")["attributes"]["flag_meanings"], "black");
        let group = metadata("");
        assert_eq!(group["attributes"]["ticks_per_second"], 125_000_000);
        assert_eq!(group["attributes"]["rcg_format_version"], 2);
    }
}
