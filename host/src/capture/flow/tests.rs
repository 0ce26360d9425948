use std::sync::atomic::{AtomicUsize, Ordering};

use super::*;
use crate::store::RawStore;

/// A source that hands over so many frames at once, and numbers one more where it loses one.
struct Script {
    numbers: std::vec::IntoIter<u64>,
    format: &'static str,
    bytes: usize,
}

impl Source for Script {
    fn about(&self) -> About {
        About {
            id: "script".to_owned(),
            region_px: (5, 3),
            pixel_format: self.format.to_owned(),
        }
    }

    fn next(&mut self, bytes: &mut Vec<u8>, timeout: Duration) -> Result<Option<Arrived>, CameraError> {
        let Some(number) = self.numbers.next() else {
            thread::sleep(timeout);
            return Ok(None);
        };
        bytes.extend((0..self.bytes).map(|at| (at as u64 * 3 + number) as u8 & 0x0f));
        Ok(Some(Arrived {
            number,
            timestamp_s: number as f64 * 0.5,
        }))
    }

    fn lost(&self) -> u64 {
        2
    }
}

fn script(format: &'static str, bytes: usize) -> Script {
    Script {
        numbers: [0, 1, 2, 5, 6].to_vec().into_iter(),
        format,
        bytes,
    }
}

/// Long enough for a thread to come to its turn beside many others.
const MOMENT: Duration = Duration::from_millis(400);

#[test]
fn every_frame_that_came_is_in_the_file_and_gaps_are_where_frames_are_missing() {
    for (format, bytes, bits) in [
        ("Mono8", 15, 8),
        ("Mono12", 30, 12),
        ("Mono12p", 23, 12),
        ("Mono16", 30, 16),
        ("RGB8", 45, 8),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let told = AtomicUsize::new(0);
        let tell = |frames| told.store(frames as usize, Ordering::Relaxed);
        let found = flow(&mut script(format, bytes), MOMENT, Some(folder.path()), &tell).unwrap();
        assert_eq!(
            (found.frames, found.lost, told.into_inner()),
            (5, 2, 5),
            "{format}"
        );
        assert!(found.synced_s.unwrap() >= found.elapsed_s && found.ring_high_water >= 1);

        let raw = RawStore::open(&folder.path().join("raw.zarr")).unwrap();
        assert_eq!((raw.layout().exposures, raw.layout().bits), (5, bits), "{format}");
        assert_eq!(raw.whole_segments().unwrap(), raw.segments());
        let segment = raw.read_segment(0).unwrap();
        let numbers: Vec<u64> = segment.records.iter().map(|record| record.frame_id).collect();
        assert_eq!(numbers, [0, 1, 2, 5, 6]);
        assert!((segment.records[3].camera_timestamp_s - 2.5).abs() < 1e-12);
        assert_eq!(
            (segment.tally.dropped_frames, segment.records[4].attempts),
            (2, 1)
        );
        let values = PixelFormat::of(format).unwrap();
        let expected = numbers.iter().flat_map(|&number| {
            let bytes: Vec<u8> = (0..bytes)
                .map(|at| (at as u64 * 3 + number) as u8 & 0x0f)
                .collect();
            values.values_of(&bytes, 15).unwrap()
        });
        assert_eq!(segment.frames, expected.collect::<Vec<_>>(), "{format}");
    }
}

#[test]
fn what_is_no_frame_is_refused_by_name() {
    let run = |source: &mut Script| flow(source, MOMENT, None, &|_| {}).unwrap_err().to_string();
    let folder = tempfile::tempdir().unwrap();
    let keep = |source: &mut Script| {
        let error = flow(source, Duration::from_mins(1), Some(folder.path()), &|_| {});
        error.unwrap_err().to_string()
    };
    assert!(run(&mut script("YUV422", 15)).contains("found YUV422"));
    let mut none = script("Mono8", 15);
    none.numbers = Vec::new().into_iter();
    assert!(run(&mut none).contains("expected frames, found none"));
    // The reader ends with the writer, long before its time.
    assert!(keep(&mut script("Mono8", 14)).contains("expected frames of 15 bytes, found one of 14"));
    assert!(keep(&mut script("Mono8", 15)).contains("already exists"));
}

#[test]
fn synthetic_frames_come_at_their_pace_and_are_lost_where_nobody_takes_them() {
    let mut source = Synthetic::new(8, Some(50_000.0));
    let mut bytes = Vec::new();
    let first = source.next(&mut bytes, Duration::ZERO).unwrap().unwrap();
    assert_eq!((first.number, source.lost()), (0, 0));
    // Nobody asks while 256 and more are made.
    thread::sleep(Duration::from_millis(20));
    bytes.clear();
    let next = source.next(&mut bytes, Duration::ZERO).unwrap().unwrap();
    assert!(next.number > 700 && source.lost() == next.number - 1, "{next:?}");
    assert_eq!(bytes, source.frame(next.number));
    assert_ne!(source.frame(3)[8..], source.frame(4)[8..]);

    let mut slow = Synthetic::new(8, Some(0.01));
    assert!(slow.next(&mut Vec::new(), Duration::ZERO).unwrap().is_some());
    assert!(
        slow.next(&mut Vec::new(), Duration::from_millis(1))
            .unwrap()
            .is_none()
    );
}

#[test]
fn frames_as_fast_as_they_are_taken_are_all_there_across_segments() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = Synthetic::new(256, None);
    let found = flow(
        &mut source,
        Duration::from_millis(150),
        Some(folder.path()),
        &|_| {},
    )
    .unwrap();
    let raw = RawStore::open(&folder.path().join("raw.zarr")).unwrap();
    assert_eq!((found.lost, raw.layout().exposures as u64), (0, found.frames));
    let mut number = 0;
    for index in 0..raw.segments() {
        for frame in raw.read_segment(index).unwrap().frames.chunks(256 * 256) {
            let stamp: Vec<u8> = frame[..8].iter().map(|&dn| dn as u8).collect();
            assert_eq!(stamp, u64::to_le_bytes(number));
            number += 1;
        }
    }
    assert_eq!(number, found.frames);
}
