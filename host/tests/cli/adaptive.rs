//! Adaptive measurement: goals, resuming, and replaying its plan.

use std::fs;

use crate::command::{refuses, run, text};
use crate::tree::files;

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
    let f = |out: &std::path::Path| files(&out.join("brdf.zarr/f"));
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

#[test]
fn what_was_begun_is_resumed_to_the_same_bits_and_only_as_what_it_is() {
    let scratch = tempfile::tempdir().unwrap();
    let (whole, cut) = (scratch.path().join("whole"), scratch.path().join("cut"));
    let goal = ["--budget", "80"];
    let arguments = |out| [&["measure", "--out", out][..], &goal, &QUICK].concat();
    run(&arguments(text(&whole)), "").done();
    run(&arguments(text(&cut)), "").done();
    // As if it had been killed after its second batch: neither plan nor what follows from it.
    for name in ["plan.toml", "rig.toml", "manifest.json", "report.html"] {
        fs::remove_file(cut.join(name)).unwrap();
    }
    fs::rename(cut.join("raw.zarr"), cut.join("adaptive.zarr")).unwrap();
    fs::remove_dir_all(cut.join("brdf.zarr")).unwrap();
    for segment in 3..6 {
        let chunk = format!("c.{segment}.0.0.0");
        fs::remove_file(cut.join("adaptive.zarr/frames").join(chunk)).unwrap();
    }
    let list = fs::read_to_string(cut.join("directions.txt")).unwrap();
    let kept: Vec<&str> = list.lines().take(1 + 48).collect();
    fs::write(cut.join("directions.txt"), kept.join("\n")).unwrap();

    let resumed = [&arguments(text(&cut))[..], &["--resume"]].concat();
    let other_goal = ["measure", "--out", text(&cut), "--resume", "--budget", "96"];
    let parts = ["adaptive.toml", "expected", "found another goal"];
    refuses(&[&other_goal[..], &QUICK].concat(), "", 2, &parts);
    refuses(
        &[&resumed[..], &["--seed", "9"]].concat(),
        "",
        2,
        &["found another request"],
    );
    refuses(
        &[&resumed[..], &["--rig", "rcg-2"]].concat(),
        "",
        2,
        &["found another rig"],
    );
    run(&resumed, "").done();
    for part in ["raw.zarr/frames", "brdf.zarr"] {
        assert!(
            files(&cut.join(part)) == files(&whole.join(part)),
            "{part} differs"
        );
    }
    assert_eq!(fs::read_to_string(cut.join("directions.txt")).unwrap(), list);
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
