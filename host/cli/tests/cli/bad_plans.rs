//! `plan.toml` after somebody has edited it.

use std::fs;
use std::path::{Path, PathBuf};

use crate::command::{refuses, run, text};

/// A planned measurement in `scratch`.
fn planned(scratch: &Path) -> PathBuf {
    let out = scratch.join("out");
    let arguments = ["plan", "--out", text(&out), "--step", "30", "--image-size", "16"];
    run(&[&arguments[..], &["--exposure-ms", "4"]].concat(), "").done();
    out
}

/// The text with the value of the line `key = …` replaced.
fn with(plan: &str, key: &str, value: &str) -> String {
    let start = format!("{key} = ");
    let lines: Vec<String> = plan
        .lines()
        .map(|line| {
            if line.starts_with(&start) {
                format!("{start}{value}")
            } else {
                line.to_owned()
            }
        })
        .collect();
    let edited = lines.join("\n");
    assert_ne!(edited, plan.trim_end(), "plan.toml has `{key}`");
    edited
}

/// Refused by all stages that read the plan; nothing is captured.
fn refused(edit: impl Fn(&str) -> String, file: &str, parts: &[&str]) {
    let scratch = tempfile::tempdir().unwrap();
    let out = planned(scratch.path());
    let path = out.join("plan.toml");
    fs::write(&path, edit(&fs::read_to_string(&path).unwrap())).unwrap();
    let named = out.join(file);
    let parts: Vec<&str> = [text(&named), "expected", "found"]
        .into_iter()
        .chain(parts.iter().copied())
        .collect();
    refuses(&["capture", text(&out)], "", 2, &parts);
    refuses(&["assemble", text(&out)], "", 2, &parts);
    refuses(&["measure", "--resume", "--out", text(&out)], "", 2, &parts);
    for absent in ["raw.zarr", "brdf.zarr", "report.html"] {
        assert!(!out.join(absent).exists(), "{absent}");
    }
}

#[test]
fn a_plan_that_nobody_touched_is_captured_and_assembled() {
    let scratch = tempfile::tempdir().unwrap();
    let out = planned(scratch.path());
    run(&["capture", text(&out)], "").done();
    run(&["assemble", text(&out)], "").done();
    assert!(out.join("brdf.zarr").is_dir());
}

#[test]
fn numbers_that_make_no_plan_are_refused() {
    for (key, value, found) in [
        ("exposure_s", "-0.004", "found -0.004"),
        ("exposure_s", "0.0", "found 0"),
        ("exposure_s", "nan", "found NaN"),
        ("exposure_s", "1e300", "found 1"),
        ("exposure_s", "0.008", "exposure_s = 0.008"),
        ("spot_deg", "-1.0", "found -1"),
        ("segment", "0", "found 0"),
        ("segment", "1000000000000", "found 1000000000000"),
        ("segment", "-3", "-3"),
        ("period_s", "0.0", "found 0"),
        ("period_s", "1e300", "found 1"),
        ("period_s", "0.001", "found 0.001"),
        ("cam_at_s", "-1.0", "found -1"),
        ("cam_at_s", "inf", "found inf"),
        ("cam_width_s", "1e18", "found 1"),
        ("proj_width_s", "nan", "found NaN"),
        ("step_deg", "7.0", "found 7"),
        ("step_deg", "1e-300", "found 0.00"),
        ("format", "1", "found 1"),
    ] {
        // The step and what goes with it are not read from one file alone.
        let file = if key == "step_deg" { "" } else { "plan.toml" };
        let check = |plan: &str| with(plan, key, value);
        if key == "step_deg" {
            let scratch = tempfile::tempdir().unwrap();
            let out = planned(scratch.path());
            let path = out.join("plan.toml");
            fs::write(&path, check(&fs::read_to_string(&path).unwrap())).unwrap();
            refuses(&["capture", text(&out)], "", 2, &["step", "expected", found]);
        } else {
            refused(check, file, &[key, found]);
        }
    }
}

#[test]
fn numbers_that_contradict_the_rig_are_refused() {
    refused(
        |plan| with(plan, "directions", "5"),
        "rig.toml",
        &["5 measurable directions"],
    );
    refused(
        |plan| with(plan, "directions", "9223372036854775807"),
        "rig.toml",
        &["measurable directions"],
    );
    refused(
        |plan| with(plan, "image_size", "8"),
        "rig.toml",
        &["8 pixels a side", "16"],
    );
    refused(
        |plan| with(plan, "image_size", "4294967295"),
        "rig.toml",
        &["pixels a side"],
    );
}

#[test]
fn keys_that_are_unknown_missing_or_of_another_type_are_refused() {
    refused(
        |plan| format!("speed = 3\n{plan}"),
        "plan.toml",
        &["speed", "segment"],
    );
    refused(
        |plan| plan.replace("segment = ", "segmnet = "),
        "plan.toml",
        &["segmnet", "segment"],
    );
    refused(
        |plan| plan.replace("period_s", "period_ms"),
        "plan.toml",
        &["timing.period_ms", "period_s"],
    );
    refused(
        |plan| with(plan, "noise", "\"loud\""),
        "plan.toml",
        &["virtual.noise", "true or false", "loud"],
    );
    refused(
        |plan| format!("{plan}\n[virtual.faults]\ndropped_frames = 1.5\n"),
        "plan.toml",
        &["virtual.faults", "from 0 to 1", "1.5"],
    );
    refused(
        |plan| with(plan, "format", "3"),
        "plan.toml",
        &["expected 5", "found 3"],
    );
    refused(
        |plan| plan.replace("[request]", "[request"),
        "plan.toml",
        &["line"],
    );
    refused(|_| String::new(), "plan.toml", &["format", "found nothing"]);
}

#[test]
fn a_plan_that_is_another_good_one_is_refused() {
    for (key, value) in [
        ("sample", "\"gone.bsdf\""),
        ("sample", "\"lambert:0.5\""),
        ("seed", "9"),
        ("spot_deg", "2.5"),
    ] {
        refused(
            |plan| with(plan, key, value),
            "plan.toml",
            &["as when the measurement was begun"],
        );
    }
}

#[test]
fn a_directory_without_a_plan_is_no_measurement() {
    let scratch = tempfile::tempdir().unwrap();
    let parts = [
        text(scratch.path()),
        "expected a measurement",
        "plan.toml",
        "found none",
    ];
    refuses(&["capture", text(scratch.path())], "", 2, &parts);
    refuses(&["assemble", text(scratch.path())], "", 2, &parts);
}

#[test]
fn a_plan_without_frames_is_not_assembled() {
    let scratch = tempfile::tempdir().unwrap();
    let out = planned(scratch.path());
    let raw = out.join("raw.zarr");
    refuses(
        &["assemble", text(&out)],
        "",
        2,
        &[text(&raw), "expected", "found nothing"],
    );
    assert!(!out.join("brdf.zarr").exists());
}
