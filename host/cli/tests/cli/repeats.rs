//! Repeated measurements: their mean is read like any result, what does not belong is refused, and a history is charted.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::answers::number;
use crate::command::{rcg, refuses, run, text};
use crate::tree::{assert_same, files};

/// A measurement with noise that began so many days after another.
fn measure(out: &Path, sample: &str, seed: u32, day: u64) {
    let (seed, out) = (seed.to_string(), text(out));
    let tiny = ["--step", "15", "--image-size", "24", "--seed", &seed];
    let mut command: Command = rcg(&[&["measure", "--sample", sample, "--out", out][..], &tiny].concat());
    command.env("SOURCE_DATE_EPOCH", (1_700_000_000 + day * 86_400).to_string());
    let done = command.output().unwrap();
    assert!(done.status.success(), "{done:?}");
}

#[test]
fn the_mean_of_repeats_is_nearer_to_the_truth_and_says_how_near() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_owned();
    let [one, two, three, out, again] = ["one", "two", "three", "mean.zarr", "again.zarr"].map(at);
    for (seed, dir) in (1..).zip([&one, &two, &three]) {
        measure(Path::new(dir), "ward:brass", seed, u64::from(seed) * 7);
    }
    let told = run(&["combine", &one, &two, &three, "--out", &out, "--json"], "").object();
    assert_eq!(told["repeats"]["members"].as_array().unwrap().len(), 3);
    assert_eq!(told["repeats"]["members"][1]["began"], "2023-11-28T22:13:20Z");
    assert_eq!(told["repeats"]["drift"].as_array().unwrap().len(), 3);
    assert!(told["repeats"]["outliers"].as_array().unwrap().is_empty());

    let judged = |brdf: &str| {
        let found = run(&["evaluate", brdf, "--reference", "ward:brass", "--json"], "").object();
        [
            "median_relative_sigma",
            "against_reference.relative_error.median",
            "against_reference.within_k2",
        ]
        .map(|name| number(&found, name))
    };
    let (single, mean) = (judged(&format!("{one}/brdf.zarr")), judged(&out));
    assert!(
        mean[0] < single[0] && mean[1] < single[1] && mean[2] > 0.95,
        "{single:?} {mean:?}"
    );

    // Neither time nor names are in it, and all commands read it.
    fs::rename(&one, at("uno")).unwrap();
    run(&["combine", &at("uno"), &two, &three, "--out", &again], "").done();
    assert_same(Path::new(&out), Path::new(&again));
    for arguments in [
        &["value", &out, "--uncertainty"][..],
        &["reflectance", &out],
        &["compare", "ward:brass", &out],
        &["fit", &out, "--model", "ward"],
        &["fill", &out, "--without", "model", "--out", &at("filled.zarr")],
        &["plot", &out, "--out", &at("plot.csv")],
        &["render", &out, "--size", "8", "--out", &at("a.png")],
    ] {
        run(arguments, "45 0 45 180\n").done();
    }
    // What is in it is no evidence beside it.
    refuses(
        &["combine", &out, &two, "--out", &again],
        "",
        2,
        &["captures", "expected another capture"],
    );
}

#[test]
fn what_is_no_repeat_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_owned();
    let [one, two, off, turned, out] = ["one", "two", "off", "turned.zarr", "out.zarr"].map(at);
    measure(Path::new(&one), "lambert:0.5", 1, 0);
    measure(Path::new(&two), "lambert:0.5", 2, 1);
    measure(Path::new(&off), "lambert:0.6", 3, 2);
    run(&["turn", &two, "--azimuth", "20", "--out", &turned], "").done();
    let before = files(folder.path());
    for (arguments, parts) in [
        (&[&one, &one][..], &["captures", "expected another capture"][..]),
        (
            &[&one, &turned],
            &[
                "azimuth_deg",
                "expected φ = 0 is +x of the sample holder",
                "found φ = 0 lies at 20",
            ],
        ),
        (
            &[&one, &two, &off],
            &[
                "off",
                "expected f as in the other 2",
                "found it +20",
                "--without",
                "--keep-outliers",
            ],
        ),
        (&[&one, &at("none")], &["none", "found nothing"]),
    ] {
        let words: Vec<&str> = ["combine"]
            .into_iter()
            .chain(arguments.iter().map(|word| word.as_str()))
            .collect();
        refuses(&[&words[..], &["--out", &out]].concat(), "", 2, parts);
    }
    let three = ["combine", &one, &two, &off, "--out", &out];
    refuses(
        &[&three[..], &["--without", "nobody"]].concat(),
        "",
        2,
        &["--without nobody", "found none"],
    );
    let both = ["--without", "off", "--without", "two"];
    refuses(
        &[&three[..], &both].concat(),
        "",
        2,
        &["expected at least 2 measurements", "found 1"],
    );
    refuses(
        &["combine", &one, &two, "--out", &format!("{one}/brdf.zarr")],
        "",
        2,
        &["found one of them"],
    );
    assert!(files(folder.path()) == before);

    run(&[&three[..], &["--without", "off"]].concat(), "").done();
    let kept = run(&[&three[..], &["--keep-outliers", "--json"]].concat(), "").object();
    assert_eq!(kept["repeats"]["outliers"][0]["number"], 2);
    // A third of what the one is off by, and stated.
    let judged = run(&["evaluate", &out, "--reference", "lambert:0.5", "--json"], "").object();
    assert!((number(&judged, "against_reference.relative_error.median") - 0.2 / 3.0).abs() < 0.01);
    assert!(number(&judged, "against_reference.within_k2") > 0.99, "{judged}");
}

#[test]
fn a_history_names_what_is_out_of_control() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_owned();
    let all: Vec<String> = (0..6_u32).map(|number| at(&format!("m{number}"))).collect();
    for (number, dir) in (0..).zip(&all) {
        let sample = if number == 3 {
            "lambert:0.53"
        } else {
            "lambert:0.5"
        };
        measure(Path::new(dir), sample, number, 7 * u64::from(number));
    }
    let [csv, png] = ["h.csv", "h.png"].map(at);
    // In any order.
    let named: Vec<&str> = all.iter().rev().map(String::as_str).collect();
    let words = [&["history", "--csv", &csv, "--out", &png, "--json"], &named[..]].concat();
    let told = run(&words, "").object();
    assert_eq!(told["out_of_control"], true);
    assert_eq!(number(&told, "history.points.4.days"), 28.0);
    let signals = told["history"]["signals"].as_array().unwrap();
    assert!(
        !signals.is_empty() && signals.iter().all(|signal| signal["number"] == 3),
        "{signals:?}"
    );
    assert_eq!(fs::read_to_string(&csv).unwrap().lines().count(), 1 + 6 * 3);
    assert!(fs::read(&png).unwrap().starts_with(b"\x89PNG"));
    let first = run(
        &[&["history", "--over", "first", "--json"], &named[..]].concat(),
        "",
    )
    .object();
    assert!((number(&first, "history.points.3.values.0") - 1.06).abs() < 0.005);

    let failed = run(&[&["history", "--fail-on-action"], &named[..]].concat(), "");
    failed.complains(1, &["out of control at", "m3"]);
    assert!(failed.stdout.contains("beyond an action line"));
    fs::remove_file(at("m1/session.json")).unwrap();
    refuses(
        &[&["history"], &named[..]].concat(),
        "",
        2,
        &["m1", "session.json", "expected", "found none"],
    );
}
