//! Triggers that are missed and frames that are lost or come twice: recorded, mended, and nothing else.

use std::path::Path;

use crate::answers::number;
use crate::command::{quick, run};
use crate::tree::{assert_same, assert_same_values};

const FAULTS: [&str; 6] = [
    "--missed-triggers",
    "0.05",
    "--dropped-frames",
    "0.05",
    "--doubled-frames",
    "0.05",
];

fn measure(out: &Path, faults: &[&str]) -> serde_json::Value {
    let mut arguments = quick(out);
    arguments.extend(
        faults
            .iter()
            .chain(&["--json"])
            .map(|&argument| argument.to_owned()),
    );
    run(&arguments, "").object()
}

#[test]
fn a_measurement_with_faults_is_the_one_without() {
    let scratch = tempfile::tempdir().unwrap();
    let (clean_out, faulty_out) = (scratch.path().join("clean"), scratch.path().join("faulty"));
    let (clean, faulty) = (measure(&clean_out, &[]), measure(&faulty_out, &FAULTS));

    for fault in ["missed_triggers", "dropped_frames", "duplicates", "repeated"] {
        let path = format!("capture.{fault}");
        assert_eq!(number(&clean, &path), 0.0, "{fault}");
        assert!(number(&faulty, &path) > 0.0, "{fault} in {}", faulty["capture"]);
    }
    let tally = |fault: &str| number(&faulty, &format!("capture.{fault}"));
    assert_eq!(tally("paired"), number(&faulty, "exposures"));
    let lost = tally("missed_triggers") + tally("dropped_frames") + tally("lost_records") + tally("disputed");
    assert_eq!(lost, tally("repeated"), "what is lost is taken again, each time");

    // Without noise the frames are the same, whenever they were taken.
    assert_eq!(clean["evaluation"], faulty["evaluation"]);
    assert_eq!(clean["assembled"], faulty["assembled"]);
    assert_same_values(&faulty_out.join("brdf.zarr"), &clean_out.join("brdf.zarr"));
    assert_same(
        &faulty_out.join("raw.zarr/frames"),
        &clean_out.join("raw.zarr/frames"),
    );
}

#[test]
fn the_pilot_capture_too_lives_with_faults() {
    let scratch = tempfile::tempdir().unwrap();
    let exposure = |name: &str, faults: &[&str]| {
        let out = scratch.path().join(name);
        let mut arguments = quick(&out);
        let at = arguments
            .iter()
            .position(|argument| argument == "--exposure-ms")
            .unwrap();
        arguments.drain(at..at + 2);
        arguments.extend(
            faults
                .iter()
                .chain(&["--json"])
                .map(|&argument| argument.to_owned()),
        );
        number(&run(&arguments, "").object(), "exposure_s")
    };
    assert_eq!(exposure("clean", &[]), exposure("faulty", &FAULTS));
}
