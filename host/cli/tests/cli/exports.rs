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
        (
            "bsdf",
            "bsdf",
            "--resolution 12 --step 30 --zeros --table compact",
        ),
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
        let form = &told["table"]["form"];
        if let Some(asked) = options.iter().find(|word| ["dense", "compact"].contains(word)) {
            assert_eq!(form, asked);
        }
        assert_eq!(form.is_string(), to == "bsdf", "{told}");
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
    let bird = bird_of(&at("bird.brdf"));
    assert_eq!(bird["metadata"]["method"], "simulation");
    assert!(
        bird["data"]["uBRDF"].is_object(),
        "a measurement states how uncertain it is"
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

/// The document of a BiRD file that keeps all rules of the schema that are known here.
fn bird_of(path: &str) -> Value {
    let document: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    let keys = |of: &Value| {
        let mut keys: Vec<String> = of.as_object().unwrap().keys().cloned().collect();
        keys.sort();
        keys
    };
    assert_eq!(keys(&document), ["data", "metadata"]);
    let metadata = &document["metadata"];
    let required =
        "description environment id instrumentation method provenance sample schema software timestamp type";
    assert_eq!(keys(metadata), required.split(' ').collect::<Vec<_>>());
    for (name, value) in metadata.as_object().unwrap() {
        let is_said = match value {
            Value::String(text) => !text.is_empty(),
            Value::Object(all) => {
                (name == "environment" || !all.is_empty()) && all.values().all(|of| !of.is_null())
            }
            Value::Array(all) => !all.is_empty(),
            _ => false,
        };
        assert!(is_said, "{name}: {value}");
    }
    assert_eq!(metadata["type"], "BRDF");
    assert!(["measurement", "simulation"].contains(&metadata["method"].as_str().unwrap()));
    let time = metadata["timestamp"].as_str().unwrap();
    assert!(time.len() >= 20 && time.as_bytes()[10] == b'T', "{time}");
    let data = &document["data"];
    let count = data["BRDF"]["values"].as_array().unwrap().len();
    assert!(count > 100, "{count}");
    for (name, list) in data.as_object().unwrap() {
        let (units, range): (&[&str], _) = match name.as_str() {
            "theta_i" | "theta_r" => (&["deg"], 0.0..90.0),
            "phi_i" | "phi_r" => (&["deg"], 0.0..360.0),
            "BRDF" | "uBRDF" => (&["1/sr", "sr^-1"], 0.0..f64::INFINITY),
            "adhoc_variables" => continue,
            other => panic!("{other} is no key of the schema"),
        };
        assert!(
            units.contains(&list["unit"].as_str().unwrap()),
            "{name}: {}",
            list["unit"]
        );
        let values = list["values"].as_array().unwrap();
        assert_eq!(values.len(), count, "{name}");
        assert!(
            values
                .iter()
                .all(|value| range.contains(&value.as_f64().unwrap())),
            "{name}"
        );
    }
    for name in ["theta_i", "phi_i", "theta_r", "phi_r"] {
        assert!(data[name].is_object(), "{name}");
    }
    for (name, list) in data["adhoc_variables"].as_object().unwrap() {
        assert!(!list["description"].as_str().unwrap().is_empty(), "{name}");
        assert_eq!(list["values"].as_array().unwrap().len(), count, "{name}");
    }
    document
}

#[test]
fn a_model_states_no_uncertainty_in_the_format_of_bird() {
    let folder = tempfile::tempdir().unwrap();
    let model = text(&folder.path().join("model.json")).to_owned();
    let words = [
        "export",
        "ward:brass",
        "--to",
        "bird",
        "--step",
        "45",
        "--out",
        &model,
    ];
    run(&words, "").done();
    assert!(bird_of(&model)["data"]["uBRDF"].is_null());
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
            vec!["--to", "csv", "--out", &csv, "--table", "dense"],
            ["--table", "--to bsdf", "csv"],
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
