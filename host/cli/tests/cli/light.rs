//! `--light`: the whole chain with codes on a rig with usual flaws, what is chosen, and what is refused.

use std::fs;
use std::path::Path;
use std::process::Command;

use rcg::brdf::sample::parse;
use rcg::store::provenance::Provenance;

use crate::command::{refuses, run, text};
use crate::judge::scores;

fn measure<'a>(out: &'a Path, light: &'a str) -> Vec<&'a str> {
    let what = ["measure", "--rig", "rcg-3", "--sample", "lambert:0.5"];
    let rest = [
        "--step",
        "15",
        "--image-size",
        "32",
        "--light",
        light,
        "--out",
        text(out),
    ];
    [&what[..], &rest].concat()
}

#[test]
fn codes_on_a_rig_with_usual_flaws_are_right_within_what_they_state() {
    let scratch = tempfile::tempdir().unwrap();
    let (truth, calibration) = (
        scratch.path().join("truth.toml"),
        scratch.path().join("calibration"),
    );
    let (truth, calibration) = (text(&truth), text(&calibration));
    let of_rig = ["--rig", "rcg-3", "--seed", "3"];
    // Geometry takes long to calibrate.
    let flaws = ["--flaws", "typical", "--position-mm", "0", "--angle-deg", "0"];
    run(&[&["truth", "--out", truth][..], &of_rig, &flaws].concat(), "").done();
    let photometry = ["calibrate", "photometry", "--truth", truth, "--out", calibration];
    run(&[&photometry[..], &of_rig, &["--image-size", "32"]].concat(), "").done();
    let sample = parse("lambert:0.5").unwrap();
    for light in ["multiplexed", "complement:15", "multiplexed:7"] {
        let out = scratch.path().join(light.replace(':', "-"));
        let known = ["--truth", truth, "--calibration", calibration];
        run(&[&measure(&out, light)[..], &known].concat(), "").done();
        let kinds = [Provenance::Measured, Provenance::Merged];
        let found = scores(&out.join("brdf.zarr"), sample.as_ref(), &kinds);
        assert!(found.count > 10_000 && found.within_2 > 0.95, "{light}: {found}");
        assert!(found.median_error < 0.01, "{light}: {found}");
    }
}

#[test]
fn a_pilot_says_what_it_chose_and_why() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("auto");
    // Not quiet, as `run` is.
    let said = Command::new(env!("CARGO_BIN_EXE_rcg"))
        .args(measure(&out, "auto"))
        .env("RCG_CALIBRATION", "none")
        .env_remove("RCG_LOG")
        .output()
        .unwrap();
    let said = String::from_utf8(said.stderr).unwrap();
    assert!(
        said.lines()
            .any(|line| line.contains("pilot: ") && line.contains("in the same time")),
        "{said}"
    );
    // Going on with it, nothing is chosen anew.
    let before = fs::read_to_string(out.join("plan.toml")).unwrap();
    run(&[&measure(&out, "auto")[..], &["--resume"]].concat(), "").done();
    assert_eq!(fs::read_to_string(out.join("plan.toml")).unwrap(), before);
    refuses(
        &[&measure(&out, "multiplexed:31")[..], &["--resume"]].concat(),
        "",
        2,
        &["light: expected auto", "found multiplexed:31"],
    );
}

#[test]
fn single_light_leaves_plans_as_they_were() {
    let scratch = tempfile::tempdir().unwrap();
    let plan = |out: &str, light: &[&str]| {
        let out = scratch.path().join(out);
        let all = ["plan", "--step", "15", "--image-size", "32", "--out", text(&out)];
        run(&[&all[..], light].concat(), "").done();
        fs::read_to_string(out.join("plan.toml")).unwrap()
    };
    let usual = plan("usual", &[]);
    assert_eq!(plan("single", &["--light", "single"]), usual);
    assert!(!usual.contains("light") && !usual.contains("code"), "{usual}");
    assert!(plan("coded", &["--light", "complement:7"]).contains("order = 7"));
}

#[test]
fn what_no_code_can_do_is_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("m");
    for (light, more, parts) in [
        ("coded", &[][..], &["--light", "`single`", "found `coded`"][..]),
        ("multiplexed:1", &[], &["from 2 to 4095", "multiplexed:1"]),
        (
            "multiplexed:500",
            &[],
            &["order", "expected at most the", "found 500"],
        ),
        (
            "multiplexed:63",
            &["--spot", "20"],
            &["cells of one block", "disjoint"],
        ),
        (
            "auto",
            &["--adaptive", "--budget", "20"],
            &["light: expected single", "found auto"],
        ),
    ] {
        refuses(&[&measure(&out, light)[..], more].concat(), "", 2, parts);
        assert!(!out.exists(), "{light}");
    }
    let multiplex = ["multiplex", "--light", "multiplexed"];
    refuses(
        &multiplex,
        "",
        2,
        &["--light: expected single", "found multiplexed"],
    );
}
