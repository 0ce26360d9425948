//! `worlds`: the whole chain in a drawn world, and what is refused.

use std::fs;

use crate::answers::number;
use crate::command::{refuses, run, text};

#[test]
fn draws_that_cannot_be_are_refused() {
    for (arguments, parts) in [
        (
            ["--count", "0"],
            &["--count", "whole number from 1", "found `0`"][..],
        ),
        (
            ["--rigs", "gold"],
            &["--rigs", "rcg-1-16bit", "dmd", "found `gold`"],
        ),
        (
            ["--kind", "good"],
            &["--kind", "any, careful or bad", "found `good`"],
        ),
        (["--step", "7"], &["step", "divides 90", "found 7"]),
        (["--requests", "0"], &["--requests", "found `0`"]),
        (["--jobs", "0"], &["--jobs", "found `0`"]),
        (["--image-size", "7"], &["--image-size", "8 to 4096", "found `7`"]),
    ] {
        let mut all = vec!["worlds"];
        if arguments[0] != "--count" {
            all.extend(["--count", "1"]);
        }
        all.extend(arguments);
        refuses(&all, "", 2, parts);
    }
    refuses(&["worlds"], "", 2, &["--count"]);
}

#[test]
fn a_careful_world_is_right_kept_and_not_run_again() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("worlds");
    let line = "worlds --count 1 --kind careful --rigs rcg-1-16bit --step 30 --image-size 24 --geometry-image-size 64 \
                --photometry-image-size 32 --seed";
    let line = |seed: &'static str| {
        let mut line: Vec<&str> = line.split_whitespace().collect();
        line.extend([seed, "--out", text(&out)]);
        line
    };
    let answer = run(&[&line("1")[..], &["--json"]].concat(), "").object();
    assert_eq!(answer["worlds"][0]["outcome"]["ended"], "right", "{answer:#}");
    assert!(number(&answer, "summary.presets.0.measured.samples") > 1000.0);
    let world = out.join("rig-0000/world-0/world.json");
    let before = fs::read(&world).unwrap();
    let again = run(&line("1"), "");
    assert!(again.done().contains("flaws drawn"));
    assert_eq!(fs::read(&world).unwrap(), before);
    // What is held must be what is drawn.
    refuses(
        &line("2"),
        "",
        2,
        &["world.json", "expected the world that is drawn", "another seed"],
    );

    // A world that ended silent is a failure, and says so once.
    let mut held: serde_json::Value = serde_json::from_slice(&before).unwrap();
    held["outcome"] = serde_json::json!({ "ended": "silent", "wrong": ["m0: wrong"] });
    fs::write(&world, held.to_string()).unwrap();
    run(&line("1"), "").complains(1, &["expected every world right or refused", "found 1 of 1"]);
    let silent = run(&[&line("1")[..], &["--json"]].concat(), "");
    assert_eq!(silent.code, Some(1));
    let object: serde_json::Value = serde_json::from_str(&silent.stdout).unwrap();
    assert_eq!(
        (&object["exit"], &object["summary"]["presets"][0]["silent"]),
        (&1.into(), &1.into())
    );
}

#[test]
#[ignore = "long: ./test.sh full runs it"]
fn in_ten_worlds_of_any_kind_nothing_is_silently_wrong() {
    let mut right = 0;
    for first in 0..10 {
        let first = first.to_string();
        let line = [
            "worlds", "--count", "1", "--seed", "31", "--first", &first, "--json",
        ];
        let answer = run(&line, "").object();
        let ended = answer["worlds"][0]["outcome"]["ended"]
            .as_str()
            .unwrap()
            .to_owned();
        assert!(ended == "right" || ended == "refused", "{answer:#}");
        right += u32::from(ended == "right");
    }
    assert!(right >= 6, "{right} of 10 answered");
}
