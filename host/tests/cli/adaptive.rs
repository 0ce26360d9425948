//! Adaptive measurement: goals, resuming, and replaying its plan.

use std::fs;
use std::path::Path;
use std::process::Stdio;

use crate::command::{rcg, refuses, run, text};
use crate::tree::{assert_same, count, files};

const QUICK: [&str; 5] = ["--image-size", "24", "--exposure-ms", "4", "--adaptive"];

#[test]
fn a_budget_is_kept_and_the_plan_can_be_measured_again() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let arguments = [
        &["measure", "--out", text(&out), "--budget", "72", "--json"][..],
        &["--noise", "off"],
        &QUICK[..],
    ]
    .concat();
    let summary = run(&arguments, "").object();
    assert_eq!(summary["adaptive"]["captures"], 72);
    assert_eq!(summary["adaptive"]["stop"], "budget");
    assert_eq!(summary["assembled"]["directions"], 72);
    assert_eq!(summary["exposures"], 72 + 16);
    assert!(!out.join("adaptive.zarr").exists());

    // The same directions, exposure time and sample: without noise the same bits.
    let again = scratch.path().join("again");
    let plan = out.join("plan.toml");
    run(&["measure", "--out", text(&again), "--replay", text(&plan)], "").done();
    let f = |out: &Path| files(&out.join("brdf.zarr/f"));
    assert!(f(&again) == f(&out), "replayed to other values");

    // Its list is a grid like any other, in the same order.
    let list = out.join("directions.txt");
    let third = scratch.path().join("third");
    let grid = ["measure", "--out", text(&third), "--grid", text(&list)];
    run(&[&grid[..], &QUICK[..4], &["--noise", "off"]].concat(), "").done();
    assert!(f(&third) == f(&out), "another order or other directions");

    refuses(
        &[
            "measure",
            "--out",
            text(&scratch.path().join("x")),
            "--replay",
            text(&plan),
            "--rig",
            "dmd",
        ],
        "",
        2,
        &[
            text(&plan),
            "expected a plan of rig dmd",
            "found one of rig rcg-1",
        ],
    );
}

#[test]
fn a_target_stops_before_the_budget_and_one_out_of_reach_says_so() {
    let scratch = tempfile::tempdir().unwrap();
    let easy = scratch.path().join("easy");
    let easy = [
        "measure",
        "--out",
        text(&easy),
        "--target",
        "20dB",
        "--json",
        "--sample",
        "lambert:0.5",
    ];
    let summary = run(&[&easy[..], &QUICK].concat(), "").object();
    assert_eq!(summary["adaptive"]["stop"], "target");
    assert_eq!(
        summary["adaptive"]["captures"], 48,
        "what is flat needs no more than the beginning"
    );

    let hard = scratch.path().join("hard");
    let hard = [
        "measure",
        "--out",
        text(&hard),
        "--target",
        "150 dB",
        "--sample",
        "lambert:0.5",
    ];
    let outcome = run(&[&hard[..], &QUICK].concat(), "");
    let said = outcome.done();
    assert!(said.contains("the target of 150 dB is not reached"), "{said}");
    assert!(said.contains("noise alone allows"), "{said}");
}

/// Begins the adaptive measurement of `arguments` in `out` and kills it once so many `segments` are stored.
fn begin_and_kill(arguments: &[&str], out: &Path, segments: usize) {
    for _ in 0..20 {
        let mut child = rcg(arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let stored = || count(&out.join("adaptive.zarr/frames"), "c.");
        while stored() < segments && child.try_wait().unwrap().is_none() {
            std::thread::yield_now();
        }
        child.kill().ok();
        child.wait().unwrap();
        if out.join("adaptive.toml").exists() && !out.join("plan.toml").exists() {
            return;
        }
        // It was too fast.
        fs::remove_dir_all(out).unwrap();
    }
    panic!("{arguments:?} was never met while it captures");
}

#[test]
fn what_was_begun_is_resumed_to_the_same_bits_and_only_as_what_it_is() {
    let scratch = tempfile::tempdir().unwrap();
    let (whole, cut) = (scratch.path().join("whole"), scratch.path().join("cut"));
    let goal = ["--budget", "80"];
    let faults = ["--missed-triggers", "0.05", "--doubled-frames", "0.05"];
    let arguments = |out| [&["measure", "--out", out][..], &goal, &QUICK, &faults].concat();
    run(&arguments(text(&whole)), "").done();
    let resumed = [&arguments(text(&cut))[..], &["--resume"]].concat();
    begin_and_kill(&arguments(text(&cut)), &cut, 3);
    let other_goal = ["measure", "--out", text(&cut), "--resume", "--budget", "96"];
    let parts = ["adaptive.toml", "expected", "found another goal"];
    refuses(&[&other_goal[..], &QUICK].concat(), "", 2, &parts);
    for (more, parts) in [
        (["--seed", "9"], ["adaptive.toml", "found another request"]),
        (["--rig", "rcg-2"], ["adaptive.toml", "found another rig"]),
    ] {
        refuses(&[&resumed[..], &more].concat(), "", 2, &parts);
    }
    // Its files are told by content.
    for (name, from, to) in [
        ("adaptive.toml", "exposure_s = 0.004", "exposure_s = 0.005"),
        ("directions.txt", "1", "2"),
    ] {
        let path = cut.join(name);
        let text = fs::read_to_string(&path).unwrap();
        let edited = text.replacen(from, to, 1);
        assert_ne!(edited, text, "{name}");
        for changed in [edited.as_str(), &text[..text.len() / 2]] {
            fs::write(&path, changed).unwrap();
            refuses(&resumed, "", 2, &[name]);
        }
        fs::write(&path, text).unwrap();
    }
    run(&resumed, "").done();
    assert!(!cut.join("adaptive.zarr").exists());
    assert_same(&cut, &whole);
    // Finished, it is still what it is.
    run(&resumed, "").done();
    refuses(
        &[&other_goal[..], &QUICK].concat(),
        "",
        2,
        &["adaptive: expected 80 captures", "found 96 captures"],
    );
}

#[test]
fn goals_that_make_no_sense_are_refused_and_nothing_is_made() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let adaptive = ["measure", "--out", text(&out), "--adaptive"];
    for (goal, parts) in [
        (&["--budget", "0"][..], &["budget", "found 0"][..]),
        (&["--budget", "15"], &["expected 16 to 4096", "found 15"]),
        (&["--budget", "-3"], &["-3"]),
        (&["--target", "good"], &["target", "such as 40dB", "found `good`"]),
        (&["--target", "-4dB"], &["target", "found `-4dB`"]),
        (&[], &["a target in dB, a budget", "found none"]),
        (&["--budget", "50", "--step", "5"], &["--step"]),
    ] {
        refuses(&[&adaptive[..], goal].concat(), "", 2, parts);
        assert!(!out.exists());
    }
    refuses(
        &["measure", "--out", text(&out), "--target", "40dB"],
        "",
        2,
        &["--adaptive"],
    );
    let gone = scratch.path().join("plan.toml");
    refuses(
        &["measure", "--out", text(&out), "--replay", text(&gone)],
        "",
        2,
        &[text(&gone), "expected a plan", "found"],
    );
}
