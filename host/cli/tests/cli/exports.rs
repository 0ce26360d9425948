//! Results become files of other programs, and those serve wherever a BRDF is asked for.

use std::fs;

use serde_json::Value;

use crate::answers::number;
use crate::command::{refuses, run, text};
use crate::commands::Scene;

#[test]
fn a_measurement_goes_out_in_every_format_and_comes_back() {
    let scene = Scene::new();
    let at = |name: &str| text(&scene.folder().join(name)).to_owned();
    let (measured, whole) = (at("measured"), at("whole.zarr"));
    run(&["fill", &measured, "--out", &whole], "").done();
    for (to, ending, options) in [
        ("bsdf", "bsdf", "--resolution 24 --step 15 --zeros"),
        ("ssdd", "ssdd", "--step 30"),
        ("klems", "xml", "--zeros"),
        ("zemax", "bsdf", "--step 30 --zeros"),
        ("bird", "brdf", "--step 30"),
        ("npy", "npy", "--step 30"),
    ] {
        let out = at(&format!("{to}.{ending}"));
        let options: Vec<&str> = options.split_whitespace().collect();
        let told = run(
            &[
                &["export", &whole, "--to", to, "--out", &out, "--json"],
                &options[..],
            ]
            .concat(),
            "",
        )
        .object();
        assert!(
            number(&told, "pairs") > 100.0 && told["round_trip"]["median"].is_number(),
            "{told}"
        );
        assert_eq!(number(&told, "bytes"), fs::metadata(&out).unwrap().len() as f64);
        let info = run(&["info", &out, "--json"], "").object();
        assert!(
            info["format"].as_str().unwrap().ends_with(&format!("({to})")),
            "{info}"
        );
        let answered = run(&["value", &out], "35 40 50 200\n");
        let line = answered.done();
        assert_eq!(line.split_whitespace().count(), 3, "{to}: {line}");
        let evaluated = run(&["evaluate", &whole, "--reference", &out, "--json"], "").object();
        assert!(evaluated["against_reference"].is_object(), "{to}: {evaluated}");
    }
    let bird: Value = serde_json::from_str(&fs::read_to_string(at("bird.brdf")).unwrap()).unwrap();
    assert_eq!(bird["metadata"]["method"], "simulation");
    let count = |name: &str| bird["data"][name]["values"].as_array().map(Vec::len);
    assert!(
        count("BRDF") > Some(100) && count("uBRDF") == count("BRDF") && count("theta_i") == count("BRDF")
    );
    let table = at("slice.csv");
    run(
        &[
            "export", &whole, "--to", "csv", "--slice", "30,45", "--out", &table,
        ],
        "",
    )
    .done();
    let rows = fs::read_to_string(&table).unwrap();
    let is_slice =
        |row: &str| row.starts_with("30,45,") || row.starts_with('#') || row.starts_with("theta_i_deg,");
    assert!(rows.lines().count() > 20 && rows.lines().all(is_slice), "{rows}");
}

#[test]
fn what_cannot_be_exported_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_owned();
    let [bsdf, npy, csv, exr] = ["a.bsdf", "a.npy", "a.csv", "a.exr"].map(at);
    for (words, named) in [
        (
            vec!["--to", "bsdf", "--out", &npy],
            ["a.npy", "ends in .bsdf", "found .npy"],
        ),
        (vec!["--to", "merle", "--out", &npy], ["merl", "klems", "merle"]),
        (
            vec!["--to", "bsdf", "--out", &bsdf, "--slice", "30,0"],
            ["--slice", "csv", "bsdf"],
        ),
        (
            vec!["--to", "csv", "--out", &csv, "--slice", "95,0"],
            ["--slice", "below 90", "95,0"],
        ),
        (
            vec!["--to", "csv", "--out", &csv, "--resolution", "8"],
            ["--resolution", "bsdf", "csv"],
        ),
        (
            vec!["--to", "exr", "--out", &exr],
            ["--slice", "one light", "--slice 30,0"],
        ),
        (
            vec!["--to", "exr", "--out", &exr, "--slice", "30,0", "--step", "5"],
            ["--step", "--resolution", "degrees"],
        ),
        (
            vec![
                "--to",
                "exr",
                "--out",
                &exr,
                "--slice",
                "30,0",
                "--resolution",
                "5000",
            ],
            ["resolution", "2 to 1024", "found 5000"],
        ),
        (
            vec!["--to", "bsdf", "--out", &bsdf, "--resolution", "1"],
            ["resolution", "2 to 1024", "found 1"],
        ),
        (
            vec!["--to", "npy", "--out", &npy, "--step", "0"],
            ["--step", "0.5 to 45", "0"],
        ),
        (
            vec!["--to", "bird", "--out", &at("a.json"), "--step", "1"],
            ["resolution", "1000000 pairs", "wider step"],
        ),
    ] {
        refuses(&[&["export", "ward:brass"], &words[..]].concat(), "", 2, &named);
    }
    refuses(
        &["export", &at("none.ssdd"), "--to", "npy", "--out", &npy],
        "",
        2,
        &["none.ssdd", "readable"],
    );
    run(
        &["export", "lambert", "--to", "npy", "--step", "45", "--out", &npy],
        "",
    )
    .done();
    refuses(
        &["export", &npy, "--to", "npy", "--out", &npy],
        "",
        2,
        &["a.npy", "expected another file"],
    );
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}
