//! `turn`: φ = 0 elsewhere on the sample, and nothing else.

use std::path::Path;

use serde_json::Value;

use crate::command::{refuses, run, text};

/// A sample that lies turned by 30°, and as it lies by itself.
const HELD: &str = "ward:rd=0.1,rs=0.33,ax=0.2,ay=0.4@30";
const TURNED_BACK: &str = "ward:rd=0.1,rs=0.33,ax=0.2,ay=0.4";

/// `sample`, measured into `out` without noise.
fn measured(out: &Path, sample: &str, more: &[&str]) {
    let out = text(out);
    let arguments = ["measure", "--out", out, "--sample", sample];
    let quick = ["--noise", "off", "--exposure-ms", "4"];
    run(&[&arguments[..], &quick, more].concat(), "").done();
}

/// Pairs of directions in the frame of the holder, with azimuths counted from `zero_deg`.
fn pairs(zero_deg: f64) -> String {
    let incident = [(7.5, 0.0), (37.5, 45.0), (40.0, 200.0), (52.0, 311.0)];
    let outgoing = [(35.0, 10.0), (45.0, 133.0), (60.0, 222.0), (50.0, 359.0)];
    let line = |(theta_i, phi_i): (f64, f64), (theta_o, phi_o): (f64, f64)| {
        format!("{theta_i} {} {theta_o} {}\n", phi_i - zero_deg, phi_o - zero_deg)
    };
    let lines = incident.iter().flat_map(|wi| outgoing.map(|wo| line(*wi, wo)));
    lines.collect()
}

fn values(brdf: &Path, zero_deg: f64) -> Vec<f64> {
    let outcome = run(&["value", text(brdf)], &pairs(zero_deg));
    let words = outcome.done().split_whitespace().filter(|word| *word != "-");
    words.filter_map(|word| word.parse().ok()).collect()
}

fn assert_same(a: &[f64], b: &[f64]) {
    assert!(a.len() == b.len() && a.len() > 20, "{} {}", a.len(), b.len());
    for (a, b) in a.iter().zip(b) {
        assert!((a - b).abs() <= 2e-5 * a.abs(), "{a} {b}");
    }
}

#[test]
fn what_was_measured_stays_where_it_was_on_the_sample() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    // Rings, and a list whose azimuths stand in the file.
    std::fs::write(
        at("list.txt"),
        "10 0\n10 120\n10 240\n45 10\n45 70\n45 130\n45 190\n45 250\n45 310\n70 0\n70 90\n70 180\n70 270\n",
    )
    .unwrap();
    let list = at("list.txt");
    for (name, grid) in [
        (
            "rings",
            vec!["--grid", "theta-phi", "--step", "15", "--image-size", "16"],
        ),
        (
            "even",
            vec![
                "--grid",
                "equal-solid-angle",
                "--step",
                "15",
                "--image-size",
                "16",
            ],
        ),
        ("list", vec!["--grid", text(&list), "--image-size", "16"]),
    ] {
        let (out, turned, back) = (
            at(name),
            at(&format!("{name}-30.zarr")),
            at(&format!("{name}-0.zarr")),
        );
        measured(&out, HELD, &grid);

        let answer = run(
            &[
                "turn",
                text(&out),
                "--azimuth",
                "30",
                "--out",
                text(&turned),
                "--json",
            ],
            "",
        )
        .object();
        assert_eq!(answer["azimuth"]["deg"], 30.0);
        let brdf = out.join("brdf.zarr");
        assert_same(&values(&brdf, 0.0), &values(&turned, 30.0));

        run(
            &["turn", text(&turned), "--azimuth", "-30", "--out", text(&back)],
            "",
        )
        .done();
        assert_same(&values(&brdf, 0.0), &values(&back, 0.0));

        // It is the sample that was not turned now.
        let error = |brdf: &Path, sample: &str| -> Value {
            let arguments = ["evaluate", text(brdf), "--reference", sample, "--json"];
            run(&arguments, "").object()["against_reference"]["relative_error"]["p99"].clone()
        };
        let as_held = error(&brdf, HELD);
        let as_turned = error(&turned, TURNED_BACK);
        assert_eq!(as_held, as_turned, "{name}");
        assert_ne!(as_turned, error(&turned, HELD), "{name}");

        let evaluation = run(&["evaluate", text(&turned)], "");
        assert!(
            evaluation
                .done()
                .contains("φ = 0 lies at 30.000° of the sample holder"),
            "{evaluation:?}"
        );
    }
}

#[test]
fn the_axis_of_a_lobe_becomes_zero() {
    let scratch = tempfile::tempdir().unwrap();
    let (out, turned) = (scratch.path().join("m"), scratch.path().join("turned.zarr"));
    measured(&out, HELD, &["--step", "15", "--image-size", "32"]);
    let answer = run(
        &[
            "turn",
            text(&out),
            "--azimuth",
            "auto",
            "--out",
            text(&turned),
            "--json",
        ],
        "",
    )
    .object();
    let (deg, uncertainty_deg) = (
        answer["azimuth"]["deg"].as_f64().unwrap(),
        answer["azimuth"]["standard_uncertainty_deg"].as_f64().unwrap(),
    );
    assert!(
        (deg - 30.0).abs() < 2.0 * uncertainty_deg && uncertainty_deg < 1.0,
        "{answer}"
    );
    let fit = run(&["fit", text(&turned), "--model", "ward", "--json"], "").object();
    let axis = &fit["parameters"][2];
    assert_eq!(axis["name"], "azimuth_deg");
    assert!(axis["value"].as_f64().unwrap().abs() < 0.01, "{axis}");
    assert_eq!(fit["azimuth_zero"]["model"], "Ward");

    // How well the lobe's axis is known says nothing of an azimuth of the holder, of which nobody knows here.
    let again = scratch.path().join("again.zarr");
    let turn = [
        "turn",
        text(&turned),
        "--azimuth",
        "5",
        "--out",
        text(&again),
        "--json",
    ];
    let azimuth = run(&turn, "").object()["azimuth"].clone();
    assert_eq!(azimuth["standard_uncertainty_deg"], Value::Null, "{azimuth}");
    assert_eq!(azimuth["model"], Value::Null, "{azimuth}");
}

#[test]
fn what_cannot_be_turned_is_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (out, turned) = (at("m"), at("turned.zarr"));
    measured(&out, "lambert:0.5", &["--step", "15", "--image-size", "16"]);
    let turn = |azimuth: &str, to: &Path, parts: &[&str]| {
        let arguments = ["turn", text(&out), "--azimuth", azimuth, "--out", text(to)];
        refuses(&arguments, "", 2, parts);
    };
    turn("auto", &turned, &["expected a lobe"]);
    turn("north", &turned, &["--azimuth", "expected degrees", "auto"]);
    turn("400", &turned, &["--azimuth", "from -360 to 360"]);
    turn("nan", &turned, &["--azimuth", "from -360 to 360"]);
    turn("10", &out.join("brdf.zarr"), &["expected another file"]);
    assert!(!turned.exists());

    // Cells of one are no cells of the other.
    run(
        &["turn", text(&out), "--azimuth", "10", "--out", text(&turned)],
        "",
    )
    .done();
    let whole = at("whole.zarr");
    let fill = ["fill", text(&out), text(&turned), "--out", text(&whole)];
    refuses(&fill, "", 2, &["azimuth_deg", "expected 0", "found 10"]);
    let brdf = out.join("brdf.zarr");
    let repeat = ["evaluate", text(&brdf), "--repeat", text(&turned)];
    refuses(&repeat, "", 2, &["expected"]);
}
