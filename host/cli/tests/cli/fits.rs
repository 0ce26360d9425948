//! `fit`: parameters with covariance, and what cannot be fitted.

use std::fs;

use serde_json::json;

use crate::command::{is_full, quick_measurement, refuses, run, text};

#[test]
fn a_fit_answers_with_parameters_covariance_and_residuals() {
    let scratch = tempfile::tempdir().unwrap();
    let picture = scratch.path().join("residuals.png");
    let arguments = [
        "fit",
        "ggx:satin",
        "--model",
        "ggx",
        "--residuals",
        text(&picture),
        "--json",
    ];
    let answer = run(&arguments, "").object();
    assert_eq!(answer["model"], "ggx");
    let parameters = answer["parameters"].as_array().unwrap();
    let names: Vec<&str> = parameters
        .iter()
        .map(|parameter| parameter["name"].as_str().unwrap())
        .collect();
    assert_eq!(
        names,
        [
            "ax",
            "ay",
            "azimuth_deg",
            "rd_r",
            "f0_r",
            "rd_g",
            "f0_g",
            "rd_b",
            "f0_b"
        ]
    );
    let covariance = answer["covariance"].as_array().unwrap();
    assert_eq!(covariance.len(), names.len());
    for (at, row) in covariance.iter().enumerate() {
        let variance = row[at].as_f64().unwrap();
        let stated = parameters[at]["standard_uncertainty"].as_f64().unwrap();
        assert!((variance.sqrt() / stated - 1.0).abs() < 1e-9, "{}", names[at]);
    }
    assert!(!answer["residuals"].as_array().unwrap().is_empty());
    assert_eq!(
        (&answer["acceptable"], &answer["warnings"]),
        (&json!(true), &json!([]))
    );
    assert!(image::open(&picture).unwrap().width() > 500);
}

#[test]
fn what_has_no_lobe_or_too_little_is_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let picture = scratch.path().join("residuals.png");
    let fit = |arguments: &[&str], parts: &[&str]| {
        let drawn = ["--residuals", text(&picture)];
        refuses(&[&["fit"][..], arguments, &drawn].concat(), "", 2, parts);
        assert!(!picture.exists(), "{arguments:?}");
    };
    fit(
        &["lambert:0.5", "--model", "ward"],
        &["fit", "expected a lobe", "found none"],
    );
    fit(
        &["ward:brass", "--model", "phong"],
        &["--model", "ward", "`phong`"],
    );
    fit(
        &["no/such.zarr", "--model", "ward"],
        &["no/such.zarr", "expected"],
    );

    let measured = scratch.path().join("m");
    quick_measurement(&measured);
    let arrays = ["f", "sigma", "provenance"].map(|array| measured.join("brdf.zarr").join(array));
    for entry in arrays.iter().flat_map(|array| fs::read_dir(array).unwrap()) {
        let path = entry.unwrap().path();
        if path.file_name().unwrap().to_str().unwrap().starts_with("c.") {
            fs::remove_file(path).unwrap();
        }
    }
    fit(
        &[text(&measured.join("brdf.zarr")), "--model", "ward"],
        &["fit", "at least 200", "found 0"],
    );
}

#[test]
fn a_model_that_does_not_describe_the_sample_says_so_and_states_no_uncertainty() {
    let cases = [("ggx:satin", "ward"), ("velvet", "ggx"), ("satin", "ward")];
    for (sample, model) in &cases[..if is_full() { 3 } else { 1 }] {
        let outcome = run(&["fit", sample, "--model", model, "--json"], "");
        if outcome.code == Some(2) {
            assert!(outcome.stderr.contains("expected a lobe"), "{}", outcome.stderr);
            continue;
        }
        let answer = outcome.object();
        assert_eq!(answer["acceptable"], json!(false), "{sample} {model}: {answer:#}");
        assert_eq!(answer["covariance"], json!(null));
        for parameter in answer["parameters"].as_array().unwrap() {
            assert_eq!(parameter["standard_uncertainty"], json!(null), "{parameter}");
            let least = if parameter["name"] == "azimuth_deg" {
                -45.0
            } else {
                0.0
            };
            assert!(parameter["value"].as_f64().unwrap() >= least, "{parameter}");
        }
        let warning = answer["warnings"][0].as_str().unwrap();
        assert!(warning.contains("does not describe the samples"), "{warning}");
        let words = run(&["fit", sample, "--model", model], "");
        assert!(words.done().contains("not acceptable"));
    }
}
