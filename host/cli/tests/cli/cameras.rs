//! Frames that need no camera: how many reach the disk.

use std::fs;

use rcg::store::RawStore;

use crate::command::{refuses, run, text};

/// A trial of a moment.
const SYNTHETIC: [&str; 4] = ["camera", "bench", "--source", "synthetic"];
const MOMENT: [&str; 2] = ["--seconds", "0.1"];

#[test]
fn every_frame_at_a_pace_is_on_the_disk_in_its_place() {
    let scratch = tempfile::tempdir().unwrap();
    for (size, rate, seconds) in [
        ("8", Some("400"), "0.3"),
        ("96", Some("300"), "0.3"),
        ("700", Some("40"), "0.3"),
        ("256", None, "0.05"),
    ] {
        let to = scratch.path().join(size);
        let mut line = SYNTHETIC.to_vec();
        line.extend([
            "--image-size",
            size,
            "--seconds",
            seconds,
            "--to",
            text(&to),
            "--json",
        ]);
        line.extend(rate.iter().flat_map(|rate| ["--frames-per-s", *rate]));
        let found = run(&line, "").object();
        let frames = found["frames"].as_u64().unwrap();
        assert_eq!(found["lost"], 0, "{found}");
        if let Some(rate) = rate {
            let made = rate.parse::<f64>().unwrap() * seconds.parse::<f64>().unwrap();
            assert!((1.0..made + 2.0).contains(&(frames as f64)), "{found}");
        }
        assert!(found["ring_high_water"].as_u64() <= found["ring_frames"].as_u64());
        let raw = RawStore::open(&to.join("raw.zarr")).unwrap();
        assert_eq!(raw.layout().exposures as u64, frames);
        assert_eq!(raw.whole_segments().unwrap(), raw.segments());
        let mut next = 0_u64;
        for index in 0..raw.segments() {
            let segment = raw.read_segment(index).unwrap();
            for (frame, record) in segment
                .frames
                .chunks(raw.layout().width.pow(2))
                .zip(&segment.records)
            {
                let stamp: Vec<u8> = frame[..8].iter().map(|&dn| dn as u8).collect();
                assert_eq!((stamp, record.frame_id), (next.to_le_bytes().to_vec(), next));
                next += 1;
            }
        }
        assert_eq!(next, frames);
        let left = fs::read_dir(&to).unwrap().count();
        assert_eq!(left, 1, "only raw.zarr is left");
    }
}

#[test]
fn a_trial_says_what_it_did_and_refuses_what_it_cannot_do() {
    let scratch = tempfile::tempdir().unwrap();
    let told = run(&[&SYNTHETIC[..], &MOMENT].concat(), "");
    for part in ["synthetic", "96×96 px, Mono8", "a second", "lost", "ring"] {
        assert!(told.done().contains(part), "{told:?}");
    }
    let refused =
        |more: &[&str], parts: &[&str]| refuses(&[&SYNTHETIC, &MOMENT[..], more].concat(), "", 2, parts);
    refused(
        &["--device", "Lucid"],
        &["--device", "--source synthetic", "found Lucid"],
    );
    fs::create_dir(scratch.path().join("raw.zarr")).unwrap();
    refused(&["--to", text(scratch.path())], &["raw.zarr", "already exists"]);
    let camera = ["camera", "bench", "--image-size", "96"];
    let missing = if cfg!(feature = "genicam") {
        "--image-size"
    } else {
        "genicam"
    };
    refuses(&camera, "", 2, &["expected", missing]);
    let file = scratch.path().join("file");
    fs::write(&file, "").unwrap();
    refuses(
        &[&SYNTHETIC[..], &["--to", text(&file)]].concat(),
        "",
        2,
        &[text(&file)],
    );
}
