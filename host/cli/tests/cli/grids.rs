//! Incident directions of every kind, from the command to the BRDF.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::command::{refuses, run, text};

/// A measurement without noise on `grid`; what it came to.
fn measured(out: &Path, grid: &[&str]) -> Value {
    let arguments = [
        "measure",
        "--out",
        text(out),
        "--image-size",
        "24",
        "--noise",
        "off",
        "--json",
    ];
    let rest = ["--sample", "ggx:satin"];
    run(&[&arguments[..], &rest, grid].concat(), "").object()
}

fn psnr_db(summary: &Value) -> f64 {
    summary["evaluation"]["against_reference"]["psnr_db"]
        .as_f64()
        .expect("a number")
}

/// The directions of the patterns of a grid, as a list.
fn list_of(scratch: &Path, grid: &[&str]) -> String {
    let patterns = scratch.join("patterns");
    run(&[&["patterns", "--out", text(&patterns)][..], grid].concat(), "").done();
    let table = fs::read_to_string(patterns.join("patterns.csv")).unwrap();
    let lines: Vec<String> = table
        .lines()
        .skip(1)
        .map(|line| line.split(',').skip(1).take(2).collect::<Vec<_>>().join(" "))
        .collect();
    lines.join("\n")
}

#[test]
fn every_kind_of_grid_is_measured_evaluated_and_looked_up_with_like_errors() {
    let scratch = tempfile::tempdir().unwrap();
    let list = scratch.path().join("list.txt");
    let directions = list_of(scratch.path(), &["--grid", "equal-solid-angle", "--step", "10"]);
    fs::write(&list, format!("# θ φ in degrees\n{directions}")).unwrap();
    let grids: [(&str, &[&str]); 3] = [
        ("theta-phi", &["--step", "10"]),
        (
            "equal-solid-angle",
            &["--step", "10", "--grid", "equal-solid-angle"],
        ),
        ("list", &["--grid", text(&list)]),
    ];
    let mut found = Vec::new();
    for (kind, grid) in grids {
        let out = scratch.path().join(kind);
        let summary = measured(&out, grid);
        let lines = "45 20 45 200\n60 100 45 310\n";
        let values = run(&["value", text(&out.join("brdf.zarr"))], lines);
        let red: Vec<f64> = values
            .done()
            .lines()
            .map(|line| line.split(' ').next().unwrap().parse().unwrap())
            .collect();
        assert_eq!(red.len(), 2, "{kind}");
        assert!(out.join("report.html").is_file());
        let albedo = summary["evaluation"]["albedo"].as_array().unwrap();
        assert!(!albedo.is_empty(), "{kind}");
        found.push((
            psnr_db(&summary),
            red,
            summary["incident_directions"].as_u64().unwrap(),
        ));
    }
    let [theta_phi, equal, list] = [0, 1, 2].map(|place| &found[place]);
    assert_eq!(theta_phi.2, 324);
    assert!((206..225).contains(&equal.2), "{}", equal.2);
    assert_eq!(list.2 as usize, directions.lines().count());
    for other in [equal, list] {
        assert!(
            (other.0 - theta_phi.0).abs() < 1.0,
            "PSNR {} and {} dB",
            other.0,
            theta_phi.0
        );
        for (a, b) in other.1.iter().zip(&theta_phi.1) {
            assert!((a / b - 1.0).abs() < 0.2, "{a} {b}");
        }
    }
}

#[test]
fn a_list_of_grazing_directions_alone_gets_its_exposure_from_them() {
    let scratch = tempfile::tempdir().unwrap();
    let list = scratch.path().join("list.txt");
    fs::write(&list, "81 0\n82 120\n83 240\n").unwrap();
    for brackets in ["1", "auto"] {
        let plan = ["plan", "--json", "--grid", text(&list), "--image-size", "16"];
        let found = run(&[&plan[..], &["--brackets", brackets]].concat(), "").object();
        assert_eq!(found["directions"], 3, "{brackets}: {found}");
    }
}

#[test]
fn a_list_is_kept_in_the_plan_and_resumed_without_its_file() {
    let scratch = tempfile::tempdir().unwrap();
    let list = scratch.path().join("list.txt");
    fs::write(&list, "40 0\n50 90\n60 180\n40.5 270.25\n").unwrap();
    let out = scratch.path().join("out");
    let plan = [
        "plan",
        "--out",
        text(&out),
        "--image-size",
        "16",
        "--exposure-ms",
        "4",
    ];
    run(&[&plan[..], &["--grid", text(&list)]].concat(), "").done();
    let resume = ["measure", "--out", text(&out), "--resume", "--image-size", "16"];
    // Another list of as many directions is another grid.
    let other = scratch.path().join("other.txt");
    fs::write(&other, "40 0\n50 90\n60 180\n41 270.25\n").unwrap();
    refuses(
        &[&resume[..], &["--grid", text(&other)]].concat(),
        "",
        2,
        &["grid", "expected list of 4", "found another list of 4"],
    );
    refuses(
        &[&resume[..], &["--step", "30"]].concat(),
        "",
        2,
        &["--step", "found 30"],
    );
    fs::remove_file(&list).unwrap();
    let summary = run(&[&resume[..], &["--json"]].concat(), "").object();
    assert_eq!(summary["incident_directions"], 4);
    assert_eq!(summary["step_deg"], Value::Null);
}

#[test]
fn files_that_are_no_lists_are_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let file = scratch.path().join("list.txt");
    for (content, parts) in [
        (
            "40 0\n50 90\n60\n",
            &["line 3", "expected two numbers", "`60`"][..],
        ),
        ("40 0\n50 90\n", &["at least 3", "found 2"]),
        ("40 0\n50 90\n60 180\n50 450\n", &["different", "places 2 and 4"]),
        ("40 0\n50 90\n90 180\n", &["below 90°", "(90, 180) at place 3"]),
        ("40 0\n50 0\n60 180\n", &["span an area", "great circle"]),
        ("1 0\n2 90\n3 180\n", &["projector can light", "hole"]),
    ] {
        fs::write(&file, content).unwrap();
        let arguments = ["measure", "--out", text(&out), "--grid", text(&file)];
        refuses(&arguments, "", 2, parts);
        assert!(!out.exists());
    }
    let gone = scratch.path().join("gone.txt");
    refuses(
        &["plan", "--grid", text(&gone)],
        "",
        2,
        &[text(&gone), "expected", "found"],
    );
    fs::write(&file, "40 0\n50 90\n60 180\n").unwrap();
    refuses(
        &["plan", "--grid", text(&file), "--step", "3"],
        "",
        2,
        &["--step", "with a list", "found 3"],
    );
}
