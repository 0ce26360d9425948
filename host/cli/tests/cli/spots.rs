//! How wide the spots of light are, and what makes the uncertainty.

use std::fs;

use crate::command::{quick, refuses, run, text};

/// The opening in degrees that the plan in `dir` has.
fn spot_deg(dir: &std::path::Path) -> f64 {
    let plan = fs::read_to_string(dir.join("plan.toml")).unwrap();
    let found = plan.lines().find_map(|line| line.strip_prefix("spot_deg = "));
    found.unwrap().parse().unwrap()
}

#[test]
fn a_pilot_capture_chooses_the_spot_and_a_resumed_measurement_keeps_it() {
    let scratch = tempfile::tempdir().unwrap();
    let out = |sample: &str| scratch.path().join(sample);
    // Black pixels that shine: without them a wide spot is no better than a longer exposure.
    let truth = out("truth.toml");
    run(
        &[
            "truth",
            "--contrast",
            "500",
            "--without",
            "pose",
            "--out",
            text(&truth),
        ],
        "",
    )
    .done();
    let measure = |sample: &str, rest: &[&str]| -> Vec<String> {
        let dir = out(sample);
        let spec = match sample {
            "sharp" => "ward:rd=0.1,rs=0.3,ax=0.05,ay=0.08",
            _ => "lambert:0.5",
        };
        let all = [
            "measure",
            "--sample",
            spec,
            "--step",
            "15",
            "--image-size",
            "48",
            "--truth",
            text(&truth),
            "--out",
            text(&dir),
        ];
        all.iter().chain(rest).map(|one| (*one).to_owned()).collect()
    };
    for sample in ["flat", "sharp"] {
        run(&measure(sample, &["--spot", "auto"]), "").done();
    }
    let [flat, sharp] = ["flat", "sharp"].map(|sample| spot_deg(&out(sample)));
    assert!(flat > 4.0 && flat <= 15.0 && sharp < 0.5 * flat, "{flat} {sharp}");
    let before = fs::read(out("flat").join("plan.toml")).unwrap();
    run(&measure("flat", &["--spot", "auto", "--resume"]), "").done();
    assert_eq!(fs::read(out("flat").join("plan.toml")).unwrap(), before);
    let other = measure("flat", &["--spot", "2", "--resume"]);
    let other: Vec<&str> = other.iter().map(String::as_str).collect();
    refuses(&other, "", 2, &["spot", "that of a pilot capture", "2°"]);
    for (bad, parts) in [("wide", &["degrees", "or auto"][..]), ("99", &["degrees"])] {
        refuses(&["plan", "--spot", bad], "", 2, parts);
    }
    let none = out("adaptive");
    let adaptive = ["measure", "--adaptive", "--spot", "auto", "--out", text(&none)];
    refuses(&adaptive, "", 2, &["--adaptive", "--spot", "auto"]);
    assert!(!none.exists());
}

#[test]
fn the_budget_of_uncertainty_is_told_where_it_is_asked_for_and_in_the_report() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let measured = run(&quick(&out), "");
    assert!(
        measured.done().contains("uncertainty          variance by"),
        "{measured:?}"
    );
    let brdf = out.join("brdf.zarr");
    let evaluate = ["evaluate", text(&brdf)];
    let shown = run(&[&evaluate[..], &["--budget"]].concat(), "");
    let rows = shown
        .done()
        .lines()
        .skip_while(|line| !line.starts_with("budget of uncertainty"));
    let rows: Vec<&str> = rows.collect();
    assert!(
        rows.len() > 2 && rows[1].contains("stray light") && rows[2].contains('%'),
        "{rows:?}"
    );
    assert!(!run(&evaluate, "").done().contains("budget of uncertainty"));
    let object = run(&[&evaluate[..], &["--json"]].concat(), "").object();
    for region in object["budget"].as_array().unwrap() {
        let shares = region["shares"].as_array().unwrap().iter();
        let sum: f64 = shares.map(|share| share.as_f64().unwrap()).sum();
        assert!((sum - 1.0).abs() < 1e-5, "{region}");
    }
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("Budget of uncertainty"));
}
