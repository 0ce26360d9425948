//! `budget`: what makes a value uncertain, after the GUM.

use std::fs;

use serde_json::Value;

use crate::command::{quick_measurement, refuses, run, text};

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("{key} of {value}"))
}

/// The budget of the sample nearest to a pair of directions, its first channel.
fn budget(dir: &str, pair: [&str; 2], more: &[&str]) -> Value {
    let command = [
        "budget",
        dir,
        "--incident",
        pair[0],
        "--outgoing",
        pair[1],
        "--json",
    ];
    let told = run(&[&command[..], more].concat(), "").done().to_owned();
    serde_json::from_str::<Value>(&told).unwrap()["budgets"][0].clone()
}

/// Refuses a budget whose parts are not what its whole is, or whose whole is not what the result at `brdf` states there.
fn check(budget: &Value, brdf: &str) {
    let mut variance = 0.0;
    for row in budget["rows"].as_array().unwrap() {
        let contribution = number(row, "contribution");
        let product = number(row, "standard_uncertainty") * number(row, "sensitivity");
        assert!((product / contribution - 1.0).abs() < 1e-9, "{row}");
        variance += contribution * contribution;
    }
    let combined = number(budget, "combined");
    assert!((variance.sqrt() / combined - 1.0).abs() < 1e-9, "{budget}");
    assert!((number(budget, "expanded") / combined - 2.0).abs() < 1e-9);
    let of = budget["of"].as_str().unwrap();
    let angles: Vec<&str> = of
        .split(|c: char| !(c.is_ascii_digit() || c == '.'))
        .filter(|word| word.parse::<f64>().is_ok())
        .collect();
    let stated = run(
        &["value", brdf, "--uncertainty", "--json"],
        &format!("{}\n", angles.join(" ")),
    )
    .done()
    .to_owned();
    let stated = &serde_json::from_str::<Value>(&stated).unwrap()["values"][0];
    let first = |key: &str| stated[key][0].as_f64().unwrap();
    // The angles are told to a hundredth of a degree, σ is kept to eleven bits, and interpolation adds its own.
    assert!(
        (first("f_per_sr") / number(budget, "value") - 1.0).abs() < 0.02,
        "{stated} {budget}"
    );
    let stated = (first("standard_uncertainty").powi(2) - first("by_interpolation").powi(2)).sqrt();
    assert!((stated / combined - 1.0).abs() < 0.03, "{stated} {budget}");
}

#[test]
fn of_a_pair_of_directions_it_makes_up_the_uncertainty_that_the_result_states() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    quick_measurement(&path("single"));
    let codes = [
        "measure",
        "--step",
        "15",
        "--image-size",
        "16",
        "--exposure-ms",
        "0.5",
        "--light",
        "multiplexed",
        "--out",
    ];
    run(&[&codes[..], &[text(&path("codes"))]].concat(), "").done();
    for name in ["single", "codes"] {
        let (dir, brdf, table) = (path(name), path(name).join("brdf.zarr"), path("table.csv"));
        let before = fs::metadata(&brdf).unwrap().modified().unwrap();
        for pair in [["52.5,0", "60,120"], ["45,180", "60,60"], ["67.5,90", "55,150"]] {
            let found = budget(text(&dir), pair, &["--csv", text(&table)]);
            check(&found, text(&brdf));
            let rows = found["rows"].as_array().unwrap().len();
            let lines = fs::read_to_string(&table).unwrap();
            assert!(rows > 0 && lines.lines().count() > rows, "{lines}");
        }
        assert_eq!(fs::metadata(&brdf).unwrap().modified().unwrap(), before);
    }
}

#[test]
fn of_regions_it_is_relative_and_what_has_none_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("m");
    quick_measurement(&dir);
    let (dir, brdf) = (text(&dir), dir.join("brdf.zarr"));
    let all = run(&["budget", dir], "").done().to_owned();
    assert!(all.matches("standard uncertainty").count() > 3, "{all}");
    let one = run(&["budget", text(&brdf), "--region", "45,40"], "")
        .done()
        .to_owned();
    assert_eq!(one.matches("view to 30 to 60°").count(), 1, "{one}");
    let model = "ward:brass";
    for (arguments, parts) in [
        (vec![dir, "--incident", "15,0"], vec!["--outgoing"]),
        (
            vec![dir, "--incident", "15,0", "--outgoing", "95,0"],
            vec!["--outgoing", "95"],
        ),
        (
            vec![dir, "--incident", "45,0", "--outgoing", "5,0"],
            vec![dir, "found none", "hole"],
        ),
        (
            vec![text(&brdf), "--incident", "15,0", "--outgoing", "30,0"],
            vec!["expected a measurement"],
        ),
        (vec![dir, "--region", "20,85"], vec!["brdf.zarr", "85°"]),
        (vec![model], vec![model]),
    ] {
        refuses(&[&["budget"], &arguments[..]].concat(), "", 2, &parts);
    }
}
