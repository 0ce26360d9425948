//! What every command answers with `--json`: one object with the documented fields.

use std::fs;

use serde_json::Value;

use crate::command::{quick, quick_measurement, run, text};

/// The number at the dotted `path`.
pub(crate) fn number(object: &Value, path: &str) -> f64 {
    let pointer = format!("/{}", path.replace('.', "/"));
    let found = object.pointer(&pointer).and_then(Value::as_f64);
    found.unwrap_or_else(|| panic!("no number at {path} in {object}"))
}

fn plan(rig: &str, step: &str) -> Value {
    run(&["plan", "--rig", rig, "--step", step, "--json"], "").object()
}

#[test]
fn the_papers_rig_takes_92_6_ms_per_exposure() {
    let plan = plan("rcg-1-16bit", "1");
    let exposures = number(&plan, "exposures");
    assert!(
        (number(&plan, "instrument_s") / exposures - 0.0926).abs() < 5e-5,
        "{plan}"
    );
    assert_eq!(plan["bound_by"], "camera");
    assert_eq!(plan["rig"], "rcg-1-16bit");
    // The hole hides the innermost 27 of 90 rings, the wire a few directions more.
    let directions = number(&plan, "directions");
    assert!(
        directions < 63.0 * 360.0 && directions > 0.98 * 63.0 * 360.0,
        "{plan}"
    );
    assert!(exposures > directions && number(&plan, "exposure_s") > 0.0);
}

#[test]
fn the_dmd_rig_is_bound_by_its_projector() {
    let plan = plan("dmd", "1");
    let expected_s = number(&plan, "exposures") * 105e-6;
    assert!(
        (number(&plan, "instrument_s") / expected_s - 1.0).abs() < 1e-9,
        "{plan}"
    );
    assert_eq!(plan["bound_by"], "projector");
}

#[test]
fn a_rig_without_a_hole_measures_more() {
    assert!(number(&plan("rcg-2", "3"), "directions") > number(&plan("rcg-1-16bit", "3"), "directions"));
}

#[test]
fn plan_writes_what_capture_and_assemble_take_up_and_measure_does_in_one_go() {
    let scratch = tempfile::tempdir().unwrap();
    let (staged, at_once) = (scratch.path().join("staged"), scratch.path().join("at-once"));
    let mut arguments = quick(&staged);
    "plan".clone_into(&mut arguments[0]);
    arguments.push("--json".to_owned());
    let plan = run(&arguments, "").object();
    assert_eq!(plan["out"], text(&staged));
    let tally = run(&["capture", text(&staged), "--json"], "").object();
    assert_eq!(tally["paired"], plan["exposures"]);
    let assembled = run(&["assemble", text(&staged), "--json"], "").object();
    assert_eq!(assembled["directions"], plan["directions"]);
    assert!(number(&assembled, "measured") > 0.0 && number(&assembled, "saturated") >= 0.0);

    // It takes what was said on disk, but for what describes it and its check sums; values are compressed, to nobody knows how little.
    let size = |array: &str| -> f64 {
        let files = std::fs::read_dir(staged.join(array)).unwrap();
        files
            .map(|file| file.unwrap().metadata().unwrap().len() as f64)
            .sum()
    };
    for (stated, arrays, least) in [
        ("raw_bytes", &["raw.zarr/frames"][..], 1.0),
        (
            "brdf_bytes",
            &["brdf.zarr/f", "brdf.zarr/sigma", "brdf.zarr/provenance"],
            0.01,
        ),
    ] {
        let stated = number(&plan, &format!("disk_space.{stated}"));
        let found: f64 = arrays.iter().map(|array| size(array)).sum();
        assert!(
            least * stated <= found && found < stated + 4000.0 * arrays.len() as f64,
            "{stated} {found}"
        );
    }

    quick_measurement(&at_once);
    for array in ["raw.zarr", "brdf.zarr"] {
        crate::tree::assert_same(&staged.join(array), &at_once.join(array));
    }
}

#[test]
fn measure_sums_up_what_it_did() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let mut arguments = quick(&out);
    arguments.push("--json".to_owned());
    let summary = run(&arguments, "").object();
    assert_eq!(summary["out"], text(&out));
    assert_eq!(summary["rig"], "rcg-1-16bit");
    assert_eq!(summary["sample"], "ward:brass");
    assert_eq!(number(&summary, "step_deg"), 15.0);
    assert_eq!(number(&summary, "image_size"), 16.0);
    assert_eq!(number(&summary, "incident_directions"), 6.0 * 24.0);
    assert_eq!(number(&summary, "exposure_s"), 0.004);
    let exposures = number(&summary, "exposures");
    assert_eq!(number(&summary, "capture.paired"), exposures);
    for fault in [
        "missed_triggers",
        "dropped_frames",
        "lost_records",
        "duplicates",
        "orphans",
        "repeated",
    ] {
        assert_eq!(number(&summary, &format!("capture.{fault}")), 0.0, "{fault}");
    }
    assert!(number(&summary, "instrument_s") > 0.06 * exposures);
    assert!(number(&summary, "assembled.measured") > 0.0);
    let coverage = number(&summary, "evaluation.coverage");
    assert!(coverage > 0.3 && coverage < 1.0, "{coverage}");
    for quantile in ["median", "p90", "p99"] {
        let error = number(
            &summary,
            &format!("evaluation.against_reference.relative_error.{quantile}"),
        );
        assert!(error > 0.0 && error.is_finite());
        number(&summary, &format!("evaluation.against_reference.blur.{quantile}"));
    }
    assert!(number(&summary, "evaluation.against_reference.psnr_db") > 10.0);
    assert_eq!(
        summary["evaluation"]["against_reference"]["reference"],
        "ward:brass"
    );
    number(&summary, "evaluation.median_relative_sigma");
    // Two of the six rings of incident directions are in the hole.
    assert_eq!(summary["evaluation"]["albedo"].as_array().unwrap().len(), 4);
    for stage in ["capture", "assemble", "evaluate", "report"] {
        assert!(number(&summary, &format!("elapsed_s.{stage}")) >= 0.0);
    }

    for file in [
        "rig.toml",
        "plan.toml",
        "manifest.json",
        "report.html",
        "figures/sphere.png",
    ] {
        assert!(out.join(file).is_file(), "{file}");
    }
    let manifest: Value = serde_json::from_slice(&fs::read(out.join("manifest.json")).unwrap()).unwrap();
    assert_eq!(manifest["state"], "reported");
    assert_eq!(number(&manifest, "seed"), 1.0);
    for file in ["rig.toml", "plan.toml"] {
        assert_eq!(manifest["sha256"][file].as_str().unwrap().len(), 64);
    }
}

#[test]
fn evaluate_says_the_same_as_measure_and_compares_only_if_asked() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let mut arguments = quick(&out);
    arguments.push("--json".to_owned());
    let summary = run(&arguments, "").object();
    let brdf = out.join("brdf.zarr");
    let alone = run(&["evaluate", text(&brdf), "--json"], "").object();
    assert_eq!(alone["against_reference"], Value::Null);
    assert_eq!(
        alone["measured_samples"],
        summary["evaluation"]["measured_samples"]
    );
    let compared = run(
        &["evaluate", text(&brdf), "--reference", "ward:brass", "--json"],
        "",
    )
    .object();
    let error = "against_reference.relative_error.median";
    assert_eq!(number(&compared, error), number(&summary["evaluation"], error));
    // Compared with something else it is worse.
    let other = run(
        &["evaluate", text(&brdf), "--reference", "lambert:0.9", "--json"],
        "",
    )
    .object();
    assert!(number(&other, error) > number(&compared, error));
}

#[test]
fn measure_without_json_prints_a_table() {
    let scratch = tempfile::tempdir().unwrap();
    let outcome = run(&quick(&scratch.path().join("out")), "");
    let table = outcome.done();
    for row in ["sample", "rig", "exposures", "triggers", "error", "report"] {
        assert!(
            table.lines().any(|line| line.starts_with(row)),
            "{row} in {table}"
        );
    }
    assert_eq!(outcome.stderr, "", "it is quiet");
}
