//! Calibrations whose targets somebody puts in: asked for one after the other, told from others, and gone on with on another day.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::command::{Outcome, rcg, refuses, run, text, wait};
use crate::tree::files;

/// A rig that strays from its file, and places for its calibrations.
struct Lab {
    folder: tempfile::TempDir,
}

impl Lab {
    fn new() -> Self {
        let lab = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        let line = ["truth", "--seed", "2", "--figure-mrad", "0.05", "--out"];
        run(&[&line[..], &[text(&lab.at("truth.toml"))]].concat(), "").done();
        lab
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The calibration `name` of the geometry.
    fn geometry(&self, name: &str, rest: &[&str]) -> Vec<String> {
        let (out, truth) = (self.at(name), self.at("truth.toml"));
        let all = ["calibrate", "geometry", "--image-size", "64", "--out"];
        let all = [&all[..], &[text(&out), "--truth", text(&truth)], rest].concat();
        all.into_iter().map(str::to_owned).collect()
    }
}

/// The frames in a folder, and what says which they are.
fn captured(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = files(dir);
    found.retain(|name, _| {
        let name = text(name);
        name.contains(".raw.zarr") || name.ends_with("-views.json")
    });
    assert!(found.len() > 10, "{}", dir.display());
    found
}

fn says(outcome: &Outcome, parts: &[&str]) {
    for part in parts {
        assert!(outcome.stderr.contains(part), "{part}: {outcome:?}");
    }
}

#[test]
fn by_hand_with_mistakes_and_on_several_days_is_as_without_hands_to_the_bit() {
    let lab = Lab::new();
    run(&lab.geometry("alone", &[]), "").done();
    let by_hand = lab.geometry("hands", &["--by-hand"]);
    let first = "put mirror 15 120\nyes\nkeep\n\n\nput mirror 15 240\nput nowhere\nput mirror 1\nagain\n\nput mirror 15 250\nstop\n";
    let first = run(&by_hand, first);
    assert!(
        first
            .done()
            .contains("3 of 5 views are missing: 3 (flat mirror at 15° / 120°)"),
        "{first:?}"
    );
    assert!(first.done().contains("goes on with them"), "{first:?}");
    says(
        &first,
        &[
            "view 1 of 5: flat mirror at 0° / 0°",
            "expected a mirror at 0° / 0°, found one at about 1",
            "found `yes`",
            "there is no view that was refused and could be kept",
            "put nowhere: sample",
            "expected `put mirror TILT AZIMUTH` in degrees",
            "expected a mirror at 15° / 120°, found one at about 1",
        ],
    );
    // Views that are missing are no calibration.
    refuses(
        &lab.geometry("hands", &[]),
        "",
        2,
        &["expected all 5 views", "view 3, 4, 5 missing", "--by-hand"],
    );
    let second = run(&by_hand, "\n\nput mirror 0 0\nput nothing\n\n");
    says(
        &second,
        &["found light in a part of the image only", "found next to nothing"],
    );
    second.done();
    assert!(captured(&lab.at("hands")) == captured(&lab.at("alone")));
    // One view again, and nothing else.
    let again = run(&lab.geometry("hands", &["--redo", "3"]), "\n");
    assert_eq!(again.stderr.matches("put it in").count(), 1, "{again:?}");
    again.done();
    assert!(captured(&lab.at("hands")) == captured(&lab.at("alone")));
    // Whoever insists is judged in the end, and named.
    let insists = run(
        &lab.geometry("hands", &["--redo", "4"]),
        "put mirror 15 200\nkeep\n",
    );
    assert_eq!(insists.code, Some(2), "{insists:?}");
    says(
        &insists,
        &[
            "found one at about 1",
            "flat mirror at the tilts that are stated",
            "15:240",
        ],
    );
    let notes = fs::read_to_string(lab.at("hands").join("geometry-by-hand.json")).unwrap();
    assert!(
        notes.contains("\"4\": \"expected a mirror at 15° / 240°"),
        "{notes}"
    );
    run(&lab.geometry("hands", &["--redo", "4"]), "\n").done();
    let notes = fs::read_to_string(lab.at("hands").join("geometry-by-hand.json")).unwrap();
    assert!(notes.contains("\"kept\": {}"), "{notes}");
    assert!(captured(&lab.at("hands")) == captured(&lab.at("alone")));
    // What somebody did not put in by hand is not mixed with what somebody did.
    refuses(
        &lab.geometry("alone", &["--by-hand"]),
        "",
        2,
        &["geometry-views.json", "begun with --by-hand"],
    );
}

#[test]
fn views_by_hand_go_on_only_as_what_they_are() {
    let lab = Lab::new();
    let begun = run(&lab.geometry("hands", &["--by-hand", "--json"]), "\n").object();
    assert_eq!(begun["missing"], serde_json::json!([2, 3, 4, 5]));
    assert_eq!(begun["targets"][0], "flat mirror at 15° / 0°");
    let before = files(&lab.at("hands"));
    for (rest, parts) in [
        (
            &["--seed", "2"][..],
            &["geometry-by-hand.json", "seed 1", "seed 2"][..],
        ),
        (&["--rig", "rcg-2"], &["--rig as captured, rcg-1-16bit", "rcg-2"]),
        (
            &["--tilts", "0:0,15:0"],
            &["--tilts as captured", "found 0:0,15:0"],
        ),
        (
            &["--redo", "6"],
            &["--redo with numbers of views from 1 to 5", "found 6"],
        ),
        (&["--redo", "0"], &["--redo", "found 0"]),
    ] {
        refuses(
            &lab.geometry("hands", &[&["--by-hand"], rest].concat()),
            "",
            2,
            parts,
        );
    }
    let other = lab.at("other.toml");
    run(&["truth", "--seed", "3", "--out", text(&other)], "").done();
    let mut line = lab.geometry("hands", &["--by-hand"]);
    let at = line.iter().position(|word| word == "--truth").unwrap();
    line[at + 1] = text(&other).to_owned();
    refuses(
        &line,
        "",
        2,
        &["geometry-by-hand.json: conditions: expected virtual rig, a truth of SHA-256"],
    );
    assert!(files(&lab.at("hands")) == before);
}

#[test]
fn standards_by_hand_are_told_from_each_other_and_give_the_same_photometry() {
    let lab = Lab::new();
    let of = |name: &str, rest: &[&str]| -> Vec<String> {
        let (out, truth) = (lab.at(name), lab.at("truth.toml"));
        let all = ["calibrate", "photometry", "--image-size", "16", "--out"];
        let all = [
            &all[..],
            &[text(&out), "--truth", text(&truth), "--date", "2026-01-01"],
            rest,
        ]
        .concat();
        all.into_iter().map(str::to_owned).collect()
    };
    let alone = run(&of("alone", &[]), "");
    let early = run(
        &of("hands", &["--by-hand", "--json"]),
        "\nput lambert:0.98\nstop\n",
    )
    .object();
    assert_eq!(early["missing"], serde_json::json!([1, 2, 3, 4]));
    let prepares = "put lambert:0.2\nput nothing\nput mirror 0 0\n\n\nput mirror 15 0\n\n";
    let first = run(
        &of("hands", &["--by-hand"]),
        &format!("{prepares}\nput lambert:0.2\n\nstop\n"),
    );
    assert!(
        first
            .done()
            .contains("2 of 4 views are missing: 3 (standard lambert:0.98)"),
        "{first:?}"
    );
    says(
        &first,
        &[
            "before the views: standard lambert:0.98",
            "something diffuse that reflects about 0.",
            "next to nothing",
            "expected the standard lambert:0.98, found a mirror at about ",
            "expected the flat mirror at 0° / 0°, found a mirror at about 1",
            "expected the light trap, found something diffuse",
        ],
    );
    refuses(
        &of("hands", &[]),
        "",
        2,
        &["the views of all targets", "--by-hand"],
    );
    for (rest, parts) in [
        (
            ["--standard", "lambert:0.9"],
            ["--standard as captured, lambert:0.98", "lambert:0.9"],
        ),
        (["--seed", "4"], ["photometry-by-hand.json", "seed 4"]),
        (["--image-size", "48"], ["--image-size as captured, 16", "48"]),
    ] {
        let mut line = of("hands", &["--by-hand"]);
        if rest[0] == "--image-size" {
            line.retain(|word| word != "--image-size" && word != "16");
        }
        line.extend(rest.map(str::to_owned));
        refuses(&line, "", 2, &parts);
    }
    let second = run(
        &of("hands", &["--by-hand"]),
        "put lambert:0.2\n\nput lambert:0.98\n\n",
    );
    assert_eq!(second.stderr.matches("'keep'").count(), 2, "{second:?}");
    assert_eq!(second.done(), alone.done());
    assert!(captured(&lab.at("hands")) == captured(&lab.at("alone")));
    let again = run(&of("hands", &["--redo", "1,4"]), "\n\n");
    assert_eq!(again.done(), alone.done());
    assert!(captured(&lab.at("hands")) == captured(&lab.at("alone")));
}

#[cfg(unix)]
#[test]
fn whoever_is_killed_loses_the_view_that_was_captured_at_most() {
    use std::io::Write as _;
    use std::process::Stdio;
    let lab = Lab::new();
    let line = lab.geometry("hands", &["--by-hand"]);
    let mut child = rcg(&line)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    child.stdin.as_mut().unwrap().write_all(b"\n\n").unwrap();
    let seal = lab.at("hands").join("geometry.raw.zarr/seal/c.0");
    while !seal.is_file() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    child.kill().unwrap();
    wait(&mut child);
    let how_far = run(&lab.geometry("hands", &["--by-hand", "--json"]), "").object();
    let missing = how_far["missing"].as_array().unwrap().len();
    assert!((3..=4).contains(&missing), "{how_far}");
    run(&line, "\n\n\n\n\n").done();
    run(&lab.geometry("alone", &[]), "").done();
    assert!(captured(&lab.at("hands")) == captured(&lab.at("alone")));
}
