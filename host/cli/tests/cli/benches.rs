//! `bench`: error against time, from one command.

use std::fs;

use crate::command::{refuses, run, text};

#[test]
fn what_cannot_be_tried_is_refused_before_anything_is_drawn() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    for (arguments, parts) in [
        (
            ["--plan", "--step 7x"],
            &["--plan --step 7x", "options of `rcg measure`"][..],
        ),
        (["--plan", "--fast"], &["--plan --fast", "--fast"]),
        (
            ["--plan", "--step 30 --seed=3"],
            &["--seed=3, which this command says itself"],
        ),
        (["--sample", "gold"], &["gold"]),
        (
            ["--exposure", "0"],
            &["--exposure", "positive number", "found `0`"],
        ),
        (["--draws", "0"], &["--draws", "found `0`"]),
    ] {
        refuses(
            &[&["bench", "--out", text(&out)][..], &arguments].concat(),
            "",
            2,
            parts,
        );
    }
    assert!(!out.exists());
}

#[test]
#[ignore = "long: ./test.sh full runs it"]
fn error_stands_against_time_for_every_sample_and_plan() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let line = "bench --geometry-image-size 64 --photometry-image-size 32 --json --out";
    let mut line: Vec<&str> = line.split_whitespace().chain([text(&out)]).collect();
    let plan = "--step 30 --image-size 24";
    line.extend(["--sample", "lambert:0.5", "--plan", plan]);
    let dim = format!("{plan} --exposure-ms 0.01");
    line.extend(["--plan", &dim, "--plan", "--step 30 --tilt 20:0"]);
    let answer = run(&line, "").object();
    let points = answer["points"].as_array().unwrap();
    assert_eq!(points.len(), 3, "{answer:#}");
    let error = |at: usize| points[at]["error_median"].as_f64().unwrap();
    // Less light errs more, in less time.
    assert!(error(0) < error(1), "{answer:#}");
    assert!(points[0]["instrument_s"].as_f64() > points[1]["instrument_s"].as_f64());
    assert!(points[0]["best"] == true && points[0]["psnr_y_db"].as_f64() > Some(20.0));
    // The standard was not seen at that tilt.
    assert_eq!(points[2]["refused"], 1);
    assert!(answer["rows"][2]["refused"].as_str().unwrap().contains("--tilts"));
    let table = fs::read_to_string(out.join("pareto.csv")).unwrap();
    assert_eq!(table.lines().count(), 4, "{table}");
    for name in ["pareto.json", "pareto.svg", "pareto.png"] {
        assert!(out.join(name).is_file(), "{name}");
    }
}
