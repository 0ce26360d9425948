//! A virtual rig that strays from its file is calibrated before a measurement if nothing is said of a calibration, and that is kept.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use rcg::calibrate::kept::key;
use rcg::instrument::rig::Rig;
use rcg::plan::Virtual;
use serde_json::Value;

use crate::command::{rcg, text};

/// A rig that strays, in `folder`.
fn truth(folder: &Path) -> PathBuf {
    let truth = folder.join("truth.toml");
    if !truth.exists() {
        let drawn = rcg(&["truth", "--seed", "3", "--out", text(&truth)])
            .output()
            .unwrap();
        assert!(drawn.status.success(), "{}", sentence(&drawn));
    }
    truth
}

/// `rcg measure` of a small picture on the rig that strays or another one, with a cache in `folder` and nothing said of a calibration.
fn measure(folder: &Path, out: &str, more: &[&str]) -> Command {
    let (truth, out) = (truth(folder), folder.join(out));
    let line = [
        "measure",
        "--out",
        text(&out),
        "--step",
        "30",
        "--image-size",
        "16",
        "--json",
    ];
    let strays = ["--truth", text(&truth)];
    let strays: &[&str] = if more.contains(&"--truth") { &[] } else { &strays };
    let mut command = rcg(&[&line[..], strays, more].concat());
    command
        .env_remove("RCG_CALIBRATION")
        .env("HOME", folder)
        .env("XDG_CACHE_HOME", folder.join("cache"));
    command
}

/// The calibrations that are kept in `folder`.
fn kept(folder: &Path) -> Vec<PathBuf> {
    let shelf = folder.join("cache/rcg/calibrations");
    let found = fs::read_dir(shelf).map(|entries| entries.map(|entry| entry.unwrap().path()).collect());
    found.unwrap_or_default()
}

fn sentence(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

#[test]
#[ignore = "long: ./test.sh full runs it"]
fn the_virtual_rig_is_calibrated_once_as_by_the_commands_and_measured_with_that() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    let printed = |output: Output| -> Value {
        assert!(output.status.success(), "{}", sentence(&output));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let first = printed(measure(folder, "first", &[]).output().unwrap());
    let found = kept(folder);
    let [dir] = &found[..] else {
        panic!("one is kept: {}", found.len());
    };
    assert_eq!(first["calibration"], text(dir));
    // What the commands find, to the bit.
    let by_hand = folder.join("by-hand");
    for what in ["geometry", "photometry"] {
        let truth = truth(folder);
        let ended = rcg(&[
            "calibrate",
            what,
            "--truth",
            text(&truth),
            "--out",
            text(&by_hand),
        ])
        .output()
        .unwrap();
        assert!(ended.status.success(), "{}", sentence(&ended));
    }
    for name in ["rig.toml", "geometry.json", "photometry.json"] {
        let [kept, found] = [dir, &by_hand].map(|dir| fs::read(dir.join(name)).unwrap());
        assert_eq!(kept, found, "{name}");
    }
    // The next one takes it, whatever its sample and seed: a mark in it says so.
    let path = dir.join("photometry.json");
    let marked = fs::read_to_string(&path)
        .unwrap()
        .replace("\"gamma\": ", "\"gamma\": 1");
    fs::write(&path, marked).unwrap();
    printed(
        measure(folder, "next", &["--sample", "lambert:0.5", "--seed", "3"])
            .output()
            .unwrap(),
    );
    assert_eq!(kept(folder).len(), 1);
    let applied = |out: &str| fs::read(folder.join(out).join("calibration.json")).unwrap();
    assert_ne!(applied("first"), applied("next"));
    // Going on needs none, and `none` is none.
    printed(measure(folder, "first", &["--resume"]).output().unwrap());
    let without = printed(
        measure(folder, "without", &["--calibration", "none"])
            .output()
            .unwrap(),
    );
    assert_eq!(without["calibration"], Value::Null);
    assert!(!folder.join("without/calibration.json").exists());
}

#[test]
fn what_cannot_be_measured_is_refused_before_anything_is_calibrated() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    let refused = |change: fn(&mut Command), more: &[&str], parts: &[&str]| {
        let mut command = measure(folder, "out", more);
        change(&mut command);
        let ended = command.output().unwrap();
        let said = sentence(&ended);
        assert!(!ended.status.success(), "{said}");
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
        assert!(kept(folder).is_empty() && !folder.join("out").exists());
    };
    let same = |_: &mut Command| ();
    refused(same, &["--sample", "gold"], &["'gold'"]);
    refused(same, &["--truth", "nowhere.toml"], &["nowhere.toml"]);
    refused(same, &["--tilt", "89:0"], &["tilt"]);
    let nowhere = |command: &mut Command| {
        command.env("XDG_CACHE_HOME", "/dev/null");
    };
    refused(nowhere, &[], &["/dev/null/rcg/calibrations"]);
}

#[test]
fn a_kept_calibration_is_taken_by_its_key_and_only_where_none_is_named() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path();
    let rig = Rig::load("rcg-1-16bit").unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_rcg"));
    let strays = Virtual {
        truth: Some(text(&truth(folder)).to_owned()),
        ..Virtual::default()
    };
    let key = key(&rig, &strays, None, program).unwrap();
    // One that cannot be read tells that it was looked for.
    let dir = folder.join("cache/rcg/calibrations").join(key);
    fs::create_dir_all(&dir).unwrap();
    let ended = measure(folder, "out", &["--seed", "5"]).output().unwrap();
    assert!(sentence(&ended).contains(text(&dir)), "{}", sentence(&ended));
    assert!(!ended.status.success() && !folder.join("out").exists());
    let by_name = measure(folder, "by-name", &["--calibration", "none"])
        .output()
        .unwrap();
    assert!(by_name.status.success(), "{}", sentence(&by_name));
    let by_environment = measure(folder, "by-environment", &[])
        .env("RCG_CALIBRATION", "none")
        .output()
        .unwrap();
    assert!(by_environment.status.success(), "{}", sentence(&by_environment));
    // A rig that is as its file says has nothing that calibration could find.
    let ideal = rcg(&[
        "measure",
        "--step",
        "45",
        "--image-size",
        "16",
        "--out",
        text(&folder.join("ideal")),
    ])
    .env_remove("RCG_CALIBRATION")
    .env("HOME", folder)
    .env("XDG_CACHE_HOME", folder.join("cache"))
    .output()
    .unwrap();
    assert!(ideal.status.success(), "{}", sentence(&ideal));
    assert!(!folder.join("ideal/calibration.json").exists());
    // What was begun goes on as it was begun.
    let goes_on = measure(folder, "by-name", &["--resume"]).output().unwrap();
    assert!(goes_on.status.success(), "{}", sentence(&goes_on));
}
