//! `value`: the BRDF itself, of models and of measurements.

use std::f64::consts::PI;
use std::fs;
use std::path::Path;

use crate::command::{quick_measurement, refuses, run, text};
use crate::tensor_file;

type Angles = [f64; 4];

fn lines(pairs: &[Angles]) -> String {
    let line = |[ti, pi, to, po]: &Angles| format!("{ti} {pi} {to} {po}\n");
    pairs.iter().map(line).collect()
}

/// The answers of `value source`, words of each line.
fn values(source: &str, pairs: &[Angles]) -> Vec<Vec<String>> {
    let outcome = run(&["value", source], &lines(pairs));
    let words = |line: &str| line.split(' ').map(str::to_owned).collect();
    let answers: Vec<Vec<String>> = outcome.done().lines().map(words).collect();
    assert_eq!(answers.len(), pairs.len());
    answers
}

fn numbers(answer: &[String]) -> [f64; 3] {
    let numbers: Vec<f64> = answer.iter().map(|word| word.parse().expect(word)).collect();
    numbers.try_into().expect("r g b")
}

/// Ward's formula with half vector h = ωi + ωo; rd, rs, ax, ay.
fn ward([rd, rs, ax, ay]: [f64; 4], [ti, pi, to, po]: Angles) -> f64 {
    let vector = |theta: f64, phi: f64| {
        let (theta, phi) = (theta.to_radians(), phi.to_radians());
        [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
    };
    let (i, o) = (vector(ti, pi), vector(to, po));
    let h = [i[0] + o[0], i[1] + o[1], i[2] + o[2]];
    let slope = ((h[0] / ax).powi(2) + (h[1] / ay).powi(2)) / (h[2] * h[2]);
    rd / PI + rs * (-slope).exp() / (4.0 * PI * ax * ay * (i[2] * o[2]).sqrt())
}

const BRASS: [f64; 4] = [0.10, 0.33, 0.05, 0.16];

#[test]
fn a_model_is_its_formula() {
    let mut pairs = Vec::new();
    for theta_i in [0.0, 20.0, 45.0, 80.0] {
        for theta_o in [0.0, 22.0, 44.0, 79.0] {
            for phi in [0.0, 90.0, 175.0, 180.0, 300.0] {
                pairs.push([theta_i, 30.0, theta_o, 30.0 + phi]);
            }
        }
    }
    for (answer, &pair) in values("ward:brass", &pairs).iter().zip(&pairs) {
        let expected = ward(BRASS, pair);
        for f in numbers(answer) {
            assert!((f / expected - 1.0).abs() < 1e-5, "{pair:?}: {f} {expected}");
        }
    }
    let same = values("ward:rd=0.1,rs=0.33,ax=0.05,ay=0.16", &pairs);
    assert_eq!(same, values("ward:brass", &pairs));
    for answer in values("lambert:0.5", &pairs) {
        assert!((numbers(&answer)[0] - 0.5 / PI).abs() < 1e-6);
    }
}

#[test]
fn below_the_horizon_there_is_a_reason_and_no_number() {
    let pairs = [
        [95.0, 0.0, 30.0, 0.0],
        [30.0, 0.0, 95.0, 0.0],
        [120.0, 0.0, 120.0, 0.0],
    ];
    for source in ["ward:brass", "lambert", "ggx:satin"] {
        for answer in values(source, &pairs) {
            assert_eq!(answer.join(" "), "- below horizon", "{source}");
        }
    }
}

/// Whether f is defined at a polar angle: below 90°, as near to it as double precision tells.
fn is_defined(theta_deg: f64) -> bool {
    theta_deg < 90.0 - 1e-10
}

/// Plots a circle of outgoing directions at `theta_deg` to `table`, which is refused at the horizon and below.
fn plots_where_f_is_defined(source: &str, theta_deg: f64, table: &Path) {
    let theta = theta_deg.to_string();
    let plot = [
        "plot",
        source,
        "--theta-r",
        &theta,
        "--azimuths",
        "4",
        "--out",
        text(table),
    ];
    let outcome = run(&plot, "");
    if is_defined(theta_deg) {
        outcome.done();
    } else {
        outcome.complains(2, &["--theta-r", "below 90 degrees"]);
    }
}

#[test]
fn every_source_ends_at_the_horizon_and_nowhere_before() {
    let scratch = tempfile::tempdir().unwrap();
    let file = scratch.path().join("even.bsdf");
    fs::write(&file, tensor_file::bytes(&tensor_file::material(0.3))).unwrap();
    let out = scratch.path().join("out");
    quick_measurement(&out);
    let filled = scratch.path().join("filled.zarr");
    run(&["fill", text(&out), "--out", text(&filled)], "").done();
    let brdf = out.join("brdf.zarr");
    let sources = [
        "lambert",
        "ward",
        "ggx",
        "velvet",
        "satin",
        text(&file),
        text(&brdf),
        text(&filled),
    ];

    let near = [
        90.0,
        90.0 - 1e-6,
        90.0 + 1e-6,
        90.0 - 1e-9,
        90.0 - 1e-13,
        90.0 + 1e-9,
        89.9,
        90.1,
        120.0,
        180.0,
    ];
    let mut pairs = Vec::new();
    for a in near {
        for phi in [60.0, 150.0, 359.0] {
            pairs.extend([[a, phi, 50.0, 200.0], [50.0, 200.0, a, phi]]);
            pairs.extend(near.map(|b| [a, phi, b, 200.0]));
        }
    }
    for source in sources {
        let mut answered = 0;
        for (answer, &pair) in values(source, &pairs).iter().zip(&pairs) {
            let answer = answer.join(" ");
            if !(is_defined(pair[0]) && is_defined(pair[2])) {
                assert_eq!(answer, "- below horizon", "{source} {pair:?}");
            } else if let Some(reason) = answer.strip_prefix("- ") {
                // Only an instrument may have no value here, and it says why.
                let is_measured = source.contains(".zarr");
                assert!(
                    is_measured && reason != "below horizon",
                    "{source} {pair:?}: {reason}"
                );
            } else {
                let mut words = answer.split(' ').map(|word| word.parse::<f64>().expect(&answer));
                let is_number = words.all(|f| f.is_finite() && f > 0.0);
                assert!(
                    is_number || source.contains(".zarr"),
                    "{source} {pair:?}: {answer}"
                );
                answered += 1;
            }
        }
        assert!(answered > 0, "{source} has no value near the horizon");
        // A circle of directions cannot lie at the horizon either.
        let table = scratch.path().join("scan.csv");
        for theta in near {
            plots_where_f_is_defined(source, theta, &table);
        }
    }
}

#[test]
fn a_measurement_is_close_to_its_sample_and_says_where_it_has_nothing() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    // A lobe that is wide compared with 5° between directions and 64 pixels.
    let (sample, parameters) = ("ward:rd=0.3,rs=0.1,ax=0.3,ay=0.5", [0.3, 0.1, 0.3, 0.5]);
    let measure = [
        "measure",
        "--out",
        text(&out),
        "--step",
        "5",
        "--image-size",
        "64",
    ];
    let rest = ["--noise", "off", "--exposure-ms", "10", "--sample", sample];
    run(&[&measure[..], &rest].concat(), "").done();
    let brdf = out.join("brdf.zarr");

    let mut pairs = Vec::new();
    for theta_i in [32.5, 47.5, 60.0, 75.0] {
        for theta_o in [34.0, 45.0, 71.0] {
            for (phi_i, phi_o) in [
                (0.0, 180.0),
                (40.0, 100.0),
                (95.0, 95.0),
                (200.0, 15.0),
                (330.0, 160.0),
            ] {
                pairs.push([theta_i, phi_i, theta_o, phi_o]);
            }
        }
    }
    for (answer, &pair) in values(text(&brdf), &pairs).iter().zip(&pairs) {
        let expected = ward(parameters, pair);
        for f in numbers(answer) {
            assert!((f / expected - 1.0).abs() < 0.03, "{pair:?}: {f} {expected}");
        }
    }

    let nothing = [
        ([10.0, 0.0, 45.0, 0.0], "- hole"),
        ([45.0, 0.0, 5.0, 0.0], "- hole"),
        ([0.0, 0.0, 0.0, 0.0], "- hole"),
        ([95.0, 0.0, 45.0, 0.0], "- below horizon"),
        ([45.0, 0.0, 95.0, 0.0], "- below horizon"),
        ([10.0, 0.0, 95.0, 0.0], "- below horizon"),
        ([95.0, 0.0, 10.0, 0.0], "- below horizon"),
    ];
    let asked: Vec<Angles> = nothing.iter().map(|(pair, _)| *pair).collect();
    for (answer, (pair, reason)) in values(text(&brdf), &asked).iter().zip(nothing) {
        assert_eq!(answer.join(" "), reason, "{pair:?}");
    }
}

#[test]
fn json_says_the_same() {
    let pairs = [[30.0, 0.0, 40.0, 170.0], [30.0, 0.0, 95.0, 0.0]];
    let object = run(&["value", "ward:brass", "--json"], &lines(&pairs)).object();
    assert_eq!(object["brdf"], "ward:brass");
    let answers = object["values"].as_array().unwrap();
    let expected = numbers(&values("ward:brass", &pairs)[0]);
    for (found, expected) in answers[0]["f_per_sr"].as_array().unwrap().iter().zip(expected) {
        assert!((found.as_f64().unwrap() / expected - 1.0).abs() < 1e-6);
    }
    assert_eq!(answers[1]["reason"], "below horizon");
}

#[test]
fn a_value_is_the_same_with_its_uncertainty_and_in_other_quantities() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("m");
    crate::command::quick_measurement(&out);
    let brdf = out.join("brdf.zarr");
    let asked = "40 10 50 120\n40 10 50 300\n95 0 10 0\n";
    let lines = |options: &[&str]| -> Vec<String> {
        let arguments = [&["value", text(&brdf)], options].concat();
        run(&arguments, asked).done().lines().map(str::to_owned).collect()
    };
    let numbers =
        |line: &String| -> Vec<f64> { line.split(' ').filter_map(|word| word.parse().ok()).collect() };
    let (plain, stated, factor) = (
        lines(&[]),
        lines(&["--uncertainty"]),
        lines(&["--quantity", "radiance-factor", "--uncertainty"]),
    );
    assert_eq!((plain.len(), stated.len(), factor.len()), (3, 3, 3));
    for ((plain, stated), factor) in plain.iter().zip(&stated).zip(&factor) {
        if plain.starts_with('-') {
            assert_eq!((stated, factor), (plain, plain));
            continue;
        }
        assert!(
            stated.starts_with(plain.as_str()) && stated.ends_with("ed"),
            "{stated}"
        );
        let (stated, factor) = (numbers(stated), numbers(factor));
        assert!(stated[3..6].iter().all(|sigma| *sigma > 0.0) && (0.0..=1.0).contains(&stated[6]));
        for (one, other) in stated[..6].iter().zip(&factor[..6]) {
            assert!(
                (other / one / std::f64::consts::PI - 1.0).abs() < 1e-3,
                "{one} {other}"
            );
        }
    }
    refuses(
        &["value", "satin", "--uncertainty"],
        asked,
        2,
        &["--uncertainty: expected a brdf.zarr", "found satin"],
    );
}
