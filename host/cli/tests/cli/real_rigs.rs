//! Rigs whose camera and projector are real, where none of them is there.

use std::fs;
use std::path::{Path, PathBuf};

use crate::command::{refuses, run, text};

/// The example of a rig file, without the part of the trigger box that looks for one.
fn lab(folder: &Path) -> PathBuf {
    let example = include_str!("../../../rigs/lab.toml");
    let path = folder.join("lab.toml");
    let patterns = text(&folder.join("patterns")).to_owned();
    let rig = example
        .replace("port = \"auto\"", "port = \"/dev/no-such-box\"")
        .replace("folder = \"patterns\"", &format!("folder = \"{patterns}\""));
    assert!(rig.contains("no-such-box") && rig.contains(&patterns));
    fs::write(&path, rig).unwrap();
    path
}

const TINY: [&str; 6] = ["--step", "45", "--image-size", "16", "--exposure-ms", "9"];

#[test]
fn what_belongs_to_the_virtual_rig_is_refused_beside_a_real_one() {
    let scratch = tempfile::tempdir().unwrap();
    let rig = lab(scratch.path());
    let out = scratch.path().join("m");
    for (more, parts) in [
        (&["--sample", "velvet"][..], &["--sample:", "--sample-name"][..]),
        (&["--seed", "3"], &["--seed:"]),
        (&["--noise", "off"], &["--noise:"]),
        (&["--truth", "t.toml"], &["--truth:"]),
        (&["--dropped-frames", "0.1"], &["--dropped-frames:"]),
        (&["--port", "sim"], &["--port sim", "the port of a trigger box"]),
        (
            &["--wires", "localhost:1"],
            &["--wires localhost:1", "expected none beside"],
        ),
    ] {
        for command in ["measure", "plan"] {
            let arguments = [
                &[command, "--rig", text(&rig), "--out", text(&out)],
                &TINY[..],
                more,
            ]
            .concat();
            refuses(&arguments, "", 2, &[&["rig lab", "expected"], parts].concat());
        }
    }
    for command in ["geometry", "photometry"] {
        let arguments = ["calibrate", command, "--rig", text(&rig), "--out", text(&out)];
        refuses(&arguments, "", 2, &["rig lab", "expected --by-hand"]);
    }
    assert!(!out.join("plan.toml").exists());
}

#[test]
fn a_measurement_by_a_real_rig_is_planned_without_it_and_names_what_is_missing() {
    let scratch = tempfile::tempdir().unwrap();
    let rig = lab(scratch.path());
    let out = scratch.path().join("m");
    let plan = [
        "plan",
        "--rig",
        text(&rig),
        "--sample-name",
        "plate 3",
        "--out",
        text(&out),
    ];
    let missing = ["port /dev/no-such-box", "expected"];
    // What does not answer is named before anything is made.
    let measure = ["measure", "--rig", text(&rig), "--out", text(&out)];
    refuses(&[&measure[..], &TINY].concat(), "", 2, &missing);
    assert!(!out.exists());
    run(&[&plan[..], &TINY].concat(), "").done();
    let plan = fs::read_to_string(out.join("plan.toml")).unwrap();
    assert!(plan.contains("plate 3") && !plan.contains("[virtual]"), "{plan}");
    refuses(&["capture", text(&out)], "", 2, &missing);
    refuses(
        &["capture", text(&out), "--port", "/dev/another"],
        "",
        2,
        &["port /dev/another"],
    );
    refuses(
        &["capture", text(&out), "--dropped-frames", "0.1"],
        "",
        2,
        &["--dropped-frames", "real instrument"],
    );

    let checked = run(&["rig", "check", "--rig", text(&rig)], "");
    assert_eq!(checked.code, Some(1), "{checked:?}");
    for part in [
        "trigger box          missing: port /dev/no-such-box",
        "camera               missing:",
        "patterns at a time",
    ] {
        assert!(checked.stdout.contains(part), "{part}: {}", checked.stdout);
    }
    assert!(
        checked.stderr.contains("found that 2 are not as they should be"),
        "{}",
        checked.stderr
    );
    // In place of the folder micromirrors, that nobody has connected.
    let mirrors = fs::read_to_string(&rig).unwrap();
    let (before, after) = mirrors.split_once("\n[projector.files]").unwrap();
    let after = after.split_once("[projector.lens]").unwrap().1;
    let mirrors =
        format!("{before}\n[projector.dlpc900]\ndevice = \"tcp:127.0.0.1:1\"\n[projector.lens]{after}");
    fs::write(&rig, mirrors.replace("\"files\"   ", "\"dlpc900\" ")).unwrap();
    let checked = run(&["rig", "check", "--rig", text(&rig)], "");
    assert!(
        checked
            .stdout
            .contains("missing: projector tcp:127.0.0.1:1: expected a unit's reports"),
        "{checked:?}"
    );
    let info = ["projector", "info", "--rig", text(&rig)];
    refuses(&info, "", 1, &["projector tcp:127.0.0.1:1", "expected", "found"]);
    let all = run(&["rig", "check", "--rig", "dmd"], "");
    assert_eq!(all.done().matches("virtual").count(), 3);
}
