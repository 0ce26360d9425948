//! Rig files with mistakes.

use std::fs;

use crate::command::{quick, rcg, refuses, run, text};

const RCG_1: &str = include_str!("../../../src/instrument/rig/presets/rcg-1-16bit.toml");

/// The preset with `from` replaced by `to`, refused by every command that takes a rig; nothing is made.
fn refused(from: &str, to: &str, parts: &[&str]) {
    let scratch = tempfile::tempdir().unwrap();
    let rig = scratch.path().join("my-rig.toml");
    assert!(RCG_1.contains(from), "the preset has `{from}`");
    fs::write(&rig, RCG_1.replacen(from, to, 1)).unwrap();
    let out = scratch.path().join("out");
    let parts: Vec<&str> = [text(&rig), "expected", "found"]
        .into_iter()
        .chain(parts.iter().copied())
        .collect();

    let mut measure = quick(&out);
    measure.extend(["--rig".to_owned(), text(&rig).to_owned()]);
    refuses(&measure, "", 2, &parts);
    refuses(&["map", "--rig", text(&rig)], "45 0\n", 2, &parts);
    refuses(&["plan", "--rig", text(&rig)], "", 2, &parts);
    refuses(
        &["patterns", "--rig", text(&rig), "--out", text(&out)],
        "",
        2,
        &parts,
    );
    refuses(&["controller", "info", "--rig", text(&rig)], "", 2, &parts);
    assert!(!out.exists());
}

#[test]
fn the_preset_as_a_file_is_good() {
    let scratch = tempfile::tempdir().unwrap();
    let rig = scratch.path().join("my-rig.toml");
    fs::write(&rig, RCG_1).unwrap();
    let by_file = run(&["map", "--rig", text(&rig)], "45 0\n");
    assert_eq!(by_file.done(), run(&["map"], "45 0\n").done());
}

#[test]
fn an_ellipsoid_that_is_not_prolate_is_refused() {
    for b_m in ["0.150", "0.1"] {
        let found: f64 = b_m.parse().unwrap();
        refused(
            "b_m = 0.250",
            &format!("b_m = {b_m}"),
            &[
                "mirror.b_m",
                "more than mirror.a_m = 0.15",
                &format!("found {found}"),
            ],
        );
    }
}

#[test]
fn a_pose_that_sees_nothing_is_refused() {
    let lens = "rotation_deg = [0.0, 0.0, 0.0]   # optional: degrees";
    refused(
        lens,
        "rotation_deg = [180.0, 0.0, 0.0] # turned away",
        &["camera.lens", "sees the hemisphere", "no measurable pixel"],
    );
}

#[test]
fn a_key_that_is_unknown_missing_or_of_another_type_is_refused() {
    refused(
        "hole_deg = 27.0",
        "hole_dge = 27.0",
        &["mirror.hole_dge", "hole_deg"],
    );
    refused("hole_deg = 27.0", "", &["mirror.hole_deg", "found nothing"]);
    refused(
        "hole_deg = 27.0",
        "hole_deg = \"wide\"",
        &["mirror.hole_deg", "a number", "wide"],
    );
    refused("[wire]", "[wires]", &["wires", "wire"]);
}

#[test]
fn a_number_out_of_range_is_refused() {
    refused("a_m = 0.150", "a_m = 150", &["mirror.a_m", "metres", "found 150"]);
    refused("a_m = 0.150", "a_m = nan", &["mirror.a_m", "found NaN"]);
    refused(
        "exposure_s = 0.0333",
        "exposure_s = -0.0333",
        &["camera.exposure_s", "found -0.0333"],
    );
    refused(
        "width_px = 2048",
        "width_px = 0",
        &["camera.lens.width_px", "found 0"],
    );
}

#[test]
fn what_is_not_toml_is_refused_with_its_line() {
    refused("[mirror]", "[mirror", &["line 8"]);
}

#[test]
fn a_rig_that_does_not_exist_is_refused() {
    let parts = [
        "no-such-rig",
        "expected",
        "rcg-1, rcg-1-16bit, rcg-2, rcg-3, dmd",
        "found",
    ];
    refuses(&["map", "--rig", "no-such-rig"], "45 0\n", 2, &parts);
}

#[test]
fn the_usual_rig_is_rcg_3_or_what_the_environment_names() {
    let plan = |variable: Option<&str>| {
        let mut command = rcg(&["plan", "--step", "30", "--exposure-ms", "5"]);
        match variable {
            Some(rig) => command.env("RCG_RIG", rig),
            None => command.env_remove("RCG_RIG"),
        };
        let output = command.output().unwrap();
        let said = [output.stdout, output.stderr].concat();
        (output.status.code(), String::from_utf8(said).unwrap())
    };
    for (variable, named) in [(None, "on rcg-3"), (Some("dmd"), "on dmd")] {
        let (code, said) = plan(variable);
        assert!(code == Some(0) && said.contains(named), "{said}");
    }
    let (code, said) = plan(Some("no-such-rig"));
    assert!(
        code == Some(2) && said.starts_with("rcg: no-such-rig: expected"),
        "{said}"
    );
}
