//! Exposure brackets: from the command to the merged result, and what is refused.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::answers::number;
use crate::command::{refuses, run, text};
use crate::tree::assert_same_values;

fn arguments<'a>(out: &'a Path, brackets: &'a str) -> Vec<&'a str> {
    let out = text(out);
    let what = ["measure", "--out", out, "--step", "15", "--image-size", "16"];
    what.into_iter().chain(["--brackets", brackets]).collect()
}

fn times_s(object: &Value) -> Vec<f64> {
    let times = object["exposures_s"].as_array().expect("a list");
    times
        .iter()
        .map(|time| time.as_f64().expect("a number"))
        .collect()
}

#[test]
fn brackets_widen_the_dynamic_range_by_their_ratio() {
    let scratch = tempfile::tempdir().unwrap();
    let (one, three) = (scratch.path().join("one"), scratch.path().join("three"));
    let measure = |out: &Path, brackets: &[&str]| {
        let with_one = [
            "measure",
            "--out",
            text(out),
            "--step",
            "15",
            "--image-size",
            "16",
            "--json",
        ];
        run(&[&with_one[..], brackets].concat(), "").object()
    };
    let single = measure(&one, &["--exposure-ms", "4"]);
    let several = measure(&three, &["--brackets", "4,32,256"]);
    assert_eq!(times_s(&single), [0.004]);
    assert_eq!(times_s(&several), [0.004, 0.032, 0.256]);
    assert_eq!(number(&several, "exposures"), 3.0 * number(&single, "exposures"));
    assert!(number(&several, "instrument_s") > number(&single, "instrument_s"));
    let gain = number(&several, "assembled.dynamic_range") / number(&single, "assembled.dynamic_range");
    // A little is lost to the shot noise of the dark current.
    assert!((59.0..=64.0).contains(&gain), "{gain}");
    let noise = "evaluation.median_relative_sigma";
    assert!(number(&several, noise) < number(&single, noise) / 2.0);
    // Assembling again says the same, and the plan measures the same again.
    let again = run(&["assemble", text(&three), "--json"], "").object();
    assert_eq!(again, several["assembled"]);
    let replayed = scratch.path().join("replayed");
    let plan = three.join("plan.toml");
    let replay = [
        "measure",
        "--out",
        text(&replayed),
        "--image-size",
        "16",
        "--replay",
        text(&plan),
    ];
    run(&replay, "").done();
    assert_same_values(&replayed.join("brdf.zarr"), &three.join("brdf.zarr"));
}

#[test]
fn the_plan_tells_what_a_pilot_capture_proposes() {
    let plan = |brackets: &[&str]| {
        // A lobe so narrow that one exposure does not hold its middle and its tails.
        let sample = "ward:rd=0.0005,rs=0.3,ax=0.03,ay=0.03";
        let what = [
            "plan",
            "--step",
            "15",
            "--image-size",
            "32",
            "--sample",
            sample,
            "--json",
        ];
        run(&[&what[..], brackets].concat(), "").object()
    };
    let (one, auto) = (plan(&[]), plan(&["--brackets", "auto"]));
    let times = times_s(&auto);
    assert!(times.len() > 2, "{times:?}");
    assert_eq!(
        number(&auto, "exposures"),
        times.len() as f64 * number(&one, "exposures")
    );
    assert!(number(&auto, "dynamic_range") > 50.0 * number(&one, "dynamic_range"));
    let two = times_s(&plan(&["--brackets", "2"]));
    assert_eq!((two[0], two[1]), (times[0], times[times.len() - 1]));
}

#[test]
fn wrong_brackets_are_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    for brackets in [
        "0",
        "9",
        "-2",
        "many",
        "4,",
        "4,4",
        "4,0",
        "4,nan",
        "4,-8",
        "4,1e9",
        "1,2,3,4,5,6,7,8,9",
    ] {
        let found = format!("found `{brackets}`");
        let parts = ["--brackets", "expected `auto`, a number from 1 to 8", &found];
        refuses(&arguments(&out, brackets), "", 2, &parts);
    }
    let too_far = [
        "brackets: expected neighbouring exposure times at most",
        "found 0.01 and 1000 ms, 100000 times",
        "put a time between them",
    ];
    refuses(&arguments(&out, "1000,0.01"), "", 2, &too_far);
    let none = ["--brackets", "expected a value", "found an empty one"];
    refuses(&arguments(&out, ""), "", 2, &none);
    let both = [&arguments(&out, "3")[..], &["--exposure-ms", "4"]].concat();
    refuses(&both, "", 2, &["--brackets", "--exposure-ms"]);
    assert!(!out.exists(), "nothing is begun");
}

#[test]
fn other_brackets_are_not_resumed() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    run(&arguments(&out, "4,40"), "").done();
    let parts = [text(&out), "brackets: expected 4,40", "found 4,50"];
    refuses(
        &[&arguments(&out, "4,50")[..], &["--resume"]].concat(),
        "",
        2,
        &parts,
    );
    run(&[&arguments(&out, "4,40")[..], &["--resume"]].concat(), "").done();
    run(&["measure", "--out", text(&out), "--resume"], "").done();
}

#[test]
fn plans_with_brackets_that_cannot_be_are_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let plan = [
        "plan",
        "--out",
        text(&out),
        "--step",
        "30",
        "--image-size",
        "16",
        "--brackets",
        "4,40",
    ];
    run(&plan, "").done();
    let path = out.join("plan.toml");
    let good = fs::read_to_string(&path).unwrap();
    for (from, to, parts) in [
        (
            "segment = 400",
            "segment = 399",
            ["segment", "a multiple of the 2 exposures", "found 399"],
        ),
        (
            "cam_width_s = 0.04\n",
            "cam_width_s = 0.004\n",
            ["longer.cam_width_s", "more than", "found 0.004"],
        ),
        (
            "cam_width_s = 0.04\n",
            "cam_width_s = 90.0\n",
            ["longer.cam_width_s", "at most 60", "found 90"],
        ),
        (
            "proj_width_s = 0.0\n",
            "proj_width_s = 5e-6\n",
            ["longer.proj_width_s", "the pattern stays", "found 0.000005"],
        ),
        (
            "brackets = \"4,40\"",
            "brackets = \"4,4\"",
            ["request.brackets", "expected `auto`", "4,4"],
        ),
    ] {
        let edited = good.replacen(from, to, 1);
        assert_ne!(edited, good, "plan.toml has `{from}`");
        fs::write(&path, edited).unwrap();
        let named: Vec<&str> = [text(&path)].into_iter().chain(parts).collect();
        refuses(&["capture", text(&out)], "", 2, &named);
    }
    fs::write(&path, good).unwrap();
    run(&["capture", text(&out)], "").done();
}
