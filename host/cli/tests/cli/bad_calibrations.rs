//! Directories and files that are no calibration: every command that takes one says what it expected.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::command::{refuses, run, text};

/// Commands that take a calibration, with what else they need; `OUT` is a place for results.
const TAKERS: [&[&str]; 3] = [
    &["measure", "--out", "OUT", "--step", "30", "--image-size", "16"],
    &["plan", "--step", "30", "--image-size", "16"],
    &["plan", "--out", "OUT", "--step", "30", "--image-size", "16"],
];

/// Every command that takes a calibration refuses the directory `dir` with all of `parts`, and leaves nothing behind.
fn all_refuse(dir: &Path, parts: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for taker in TAKERS {
        let line: Vec<&str> = taker
            .iter()
            .map(|part| if *part == "OUT" { text(&out) } else { part })
            .chain(["--calibration", text(dir)])
            .collect();
        refuses(&line, "", 2, parts);
        assert!(!out.exists(), "{line:?}");
    }
}

/// A photometric calibration of the default rig in `dir`.
fn calibrate(dir: &Path, rest: &[&str]) -> Vec<String> {
    let all = [
        "calibrate",
        "photometry",
        "--out",
        text(dir),
        "--image-size",
        "16",
    ];
    all.iter().chain(rest).map(|part| (*part).to_owned()).collect()
}

#[test]
fn a_directory_without_a_calibration_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("calibration");
    let writes = [
        "geometry.json or photometry.json",
        "rcg calibrate geometry --out",
        "rcg calibrate photometry --out",
    ];
    all_refuse(&dir, &writes);
    fs::create_dir(&dir).unwrap();
    all_refuse(&dir, &[&writes[..], &["found neither"]].concat());
    // What calibrations leave that have failed.
    run(&calibrate(&dir, &["--noise", "off"]), "");
    assert!(dir.join("rig.toml").is_file() && dir.join("photometry.raw.zarr").exists());
    all_refuse(&dir, &[&writes[..], &["has not succeeded"]].concat());
    for file in ["geometry.json", "photometry.json"] {
        for content in [
            "",
            "{",
            "{\"version\": 2, \"rig_sha256\": \"12",
            "[]",
            "null",
            "{}",
            "\u{0}",
        ] {
            fs::write(dir.join(file), content).unwrap();
            let command = format!("rcg calibrate {} --out DIR", file.trim_end_matches(".json"));
            all_refuse(&dir, &[file, "expected a whole file as", &command]);
        }
        fs::remove_file(dir.join(file)).unwrap();
    }
}

/// Replaces every number in turn, one for each field, and calls `each` with the whole and the field's own name.
fn spoiled(whole: &Value, bad: &Value, each: &mut dyn FnMut(&Value, &str)) {
    let mut places = Vec::new();
    find(whole, String::new(), &mut places);
    for place in places {
        let mut copy = whole.clone();
        *copy.pointer_mut(&place).unwrap() = bad.clone();
        let name = place
            .rsplit('/')
            .find(|part| part.parse::<usize>().is_err())
            .unwrap();
        each(&copy, name);
    }
}

/// Places of the numbers in `value`, of lists the last.
fn find(value: &Value, place: String, places: &mut Vec<String>) {
    match value {
        Value::Number(_) => places.push(place),
        Value::Object(fields) => fields
            .iter()
            .for_each(|(name, value)| find(value, format!("{place}/{name}"), places)),
        Value::Array(items) => {
            if let Some(last) = items.last() {
                find(last, format!("{place}/{}", items.len() - 1), places);
            }
        }
        _ => {}
    }
}

#[test]
fn a_calibration_of_something_else_than_numbers_is_refused_by_its_field() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("calibration");
    run(&calibrate(&dir, &[]), "").done();
    let path = dir.join("photometry.json");
    let whole: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    let plan = [
        "plan",
        "--step",
        "30",
        "--image-size",
        "16",
        "--calibration",
        text(&dir),
    ];
    run(&plan, "").done();
    let mut fields = 0;
    spoiled(&whole, &Value::Null, &mut |spoiled, field| {
        fs::write(&path, spoiled.to_string()).unwrap();
        refuses(&plan, "", 2, &["photometry.json", field, "found null"]);
        fields += 1;
    });
    assert!(fields >= 18, "{fields}");
    for (field, bad) in [
        ("gain_e_per_dn", json!(0.0)),
        ("gain_e_per_dn", json!(-1.0)),
        ("read_noise_e", json!(-1.0)),
        ("nonlinearity", json!(0.7)),
        ("standard_uncertainty", json!(-0.1)),
        ("field_uncertainty", json!(-0.1)),
        ("lamp_uncertainty", json!(-0.1)),
        ("field_residual", json!(-0.1)),
        ("sensitivity", json!(0.0)),
        ("share", json!(3.0)),
        ("prnu", json!(-0.1)),
        ("row_noise_e", json!(-0.1)),
        ("dsnu_e", json!(-1.0)),
        ("hot", json!(1.5)),
        ("version", json!(5)),
        ("version", json!(10)),
        ("version", json!(11)),
        ("version", json!(13)),
        ("apart", json!(0.0)),
        ("own", json!(-1.0)),
        ("each", json!(-0.1)),
        ("known_to_deg", json!(91.0)),
    ] {
        let mut tried = 0;
        spoiled(&whole, &bad, &mut |spoiled, name| {
            if name == field {
                fs::write(&path, spoiled.to_string()).unwrap();
                refuses(&plan, "", 2, &["photometry.json", field]);
                tried += 1;
            }
        });
        assert!(tried > 0, "{field}");
    }
    let mut older = whole.clone();
    older.as_object_mut().unwrap().remove("version");
    older.as_object_mut().unwrap().remove("sights");
    fs::write(&path, older.to_string()).unwrap();
    refuses(
        &plan,
        "",
        2,
        &[
            "photometry.json: version: expected 12",
            "rcg calibrate photometry --out DIR",
            "found 0",
        ],
    );
    fs::write(&path, whole.to_string()).unwrap();
    run(&plan, "").done();
    // A sample at a tilt at which no standard stood.
    let tilted = [&plan[..], &["--tilt", "20:30"]].concat();
    refuses(&tilted, "", 2, &["at the tilt of the sample, 20:30:0", "--tilts"]);
}

#[test]
fn standards_and_views_that_cannot_tell_are_refused_before_they_cost_a_capture() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("calibration");
    let alike = ["two standards whose reflectances differ", "--second-standard"];
    let again = ["differ from each other", "again", "--tilts"];
    let no_time = ["--exposure-ms", "expected a number of milliseconds"];
    let too_short = ["a longest exposure time from 0.016 to 60000 ms", "--exposure-ms"];
    let cases: [(&[&str], &[&str]); 12] = [
        (
            &["--standard", "lambert:0.98", "--second-standard", "lambert:0.98"],
            &alike,
        ),
        (
            &[
                "--standard",
                "lambert:0.5",
                "--second-standard",
                "lambert:0.5000001",
            ],
            &alike,
        ),
        (
            &["--standard", "lambert:0.98", "--second-standard", "lambert:0.9"],
            &alike,
        ),
        (&["--second-standard", "lambert:0"], &["a number above 0"]),
        (&["--standard", "lambert:0"], &["a number above 0"]),
        (&["--tilts", "20:30,20:30"], &again),
        (&["--tilts", "20:30,20:-330:360"], &again),
        (&["--tilts", "0:0"], &again),
        (&["--exposure-ms", "0"], &no_time),
        (&["--exposure-ms", "nan"], &no_time),
        (&["--exposure-ms", "0.001"], &too_short),
        (&["--exposure-ms", "1e9"], &no_time),
    ];
    for (rest, parts) in cases {
        refuses(&calibrate(&dir, rest), "", 2, parts);
        assert!(!dir.join("photometry-views.json").exists(), "{rest:?}");
    }
    let mirrors = [
        "calibrate",
        "geometry",
        "--out",
        text(&dir),
        "--image-size",
        "64",
        "--tilts",
        "10:30,10:-330",
    ];
    refuses(&mirrors, "", 2, &again);
}
