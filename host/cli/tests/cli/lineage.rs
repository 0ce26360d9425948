//! Where a result comes from: who measured, when and with what, and what the same frames come to with another calibration.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::answers::number;
use crate::command::{quick, rcg, refuses, run, text};
use crate::tree::{assert_same, assert_same_values, copy, files};

/// A place for files, and names in it.
struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn at(&self, name: &str) -> String {
        text(&self.path(name)).to_owned()
    }
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// The lineage of a `brdf.zarr`.
fn lineage(brdf: &Path) -> Value {
    json(&brdf.join("zarr.json"))["attributes"]["lineage"].clone()
}

#[test]
fn the_same_frames_with_another_standard_are_as_much_brighter() {
    let place = Place::new();
    let [cal, m, same, again, other, darker] =
        ["cal", "m", "same.zarr", "again.zarr", "other", "darker.zarr"].map(|name| place.at(name));
    // A second standard would tell that the first is not what it is said to be.
    let calibrate = [
        "calibrate",
        "photometry",
        "--image-size",
        "32",
        "--second-standard",
        "none",
        "--out",
    ];
    run(&[&calibrate[..], &[&cal]].concat(), "").done();
    let measure = [
        "measure",
        "--sample",
        "lambert:0.5",
        "--step",
        "30",
        "--image-size",
        "24",
    ];
    run(
        &[&measure[..], &["--calibration", &cal, "--out", &m]].concat(),
        "",
    )
    .done();
    let brdf = place.path("m/brdf.zarr");
    let before = files(&place.path("m"));

    // Elsewhere it is the same file, and with the same calibration the same values.
    let told = run(&["assemble", &m, "--out", &same, "--json"], "").object();
    assert_same(&place.path("same.zarr"), &brdf);
    assert_eq!(told["calibration_sha256"], told["own_calibration_sha256"]);
    run(&["assemble", &m, "--calibration", &cal, "--out", &again], "").done();
    assert_same_values(&place.path("again.zarr"), &brdf);
    let (own, found) = (lineage(&brdf), lineage(&place.path("again.zarr")));
    assert_eq!(own["assembled_again"], Value::Null);
    assert_eq!(found["assembled_again"], true);
    assert_eq!(own["sha256"], found["sha256"]);
    assert_eq!(found["calibration_before"], found["sha256"]["calibration.json"]);

    another_standard_scales(&place, [&m, &cal, &other, &again, &darker]);
    assert!(files(&place.path("m")) == before);
    frames_keep_their_geometry(&place, &m, &cal);
    outputs_are_apart(&place, &m, &cal);
    assert!(files(&place.path("m")) == before);
}

/// The captures of the calibration, with the standard said to be darker.
fn another_standard_scales(place: &Place, [m, cal, other, again, darker]: [&str; 5]) {
    let own = lineage(&place.path("m/brdf.zarr"));
    copy(Path::new(cal), Path::new(other));
    let stated = json(&place.path("cal/photometry.json"))["standards"][0]["named"]
        .as_str()
        .unwrap()
        .to_owned();
    let albedo: f64 = stated.trim_start_matches("lambert:").parse().unwrap();
    run(
        &[
            "calibrate",
            "photometry",
            "--standard",
            "lambert:0.9",
            "--out",
            other,
        ],
        "",
    )
    .done();
    let all = ["assemble", m, "--calibration", other, "--out", darker, "--json"];
    let told = run(&all, "").object();
    let ratio = 0.9 / albedo;
    let scale = number(&told, "differences.scale");
    assert!((scale / ratio - 1.0).abs() < 0.01, "{scale} {ratio}");
    let median = number(&told, "differences.median_relative");
    assert!((median - (1.0 - ratio)).abs() < 0.02, "{median} {ratio}");
    assert!(number(&told, "differences.largest.sigmas") > 0.0);
    assert_ne!(
        lineage(&place.path("darker.zarr"))["sha256"]["calibration.json"],
        own["sha256"]["calibration.json"]
    );
    let error = |brdf: &str| {
        let judged = run(&["evaluate", brdf, "--reference", "lambert:0.5", "--json"], "").object();
        number(&judged, "against_reference.relative_error.median")
    };
    assert!(error(again) < 0.02 && (error(darker) - (1.0 - ratio)).abs() < 0.02);

    // They are one capture all the same.
    for one in [again, darker] {
        let fill = ["fill", m, one, "--any-scale", "--out", &place.at("filled.zarr")];
        refuses(
            &fill,
            "",
            2,
            &["captures: expected another capture", "found the same one"],
        );
    }
}

/// Another geometry is refused, and so is what is no calibration, or none at the tilt of the sample.
fn frames_keep_their_geometry(place: &Place, m: &str, cal: &str) {
    let out = place.at("refused.zarr");
    let (moved, none) = (place.at("moved"), place.at("none"));
    let again = |dir: &str| ["assemble", m, "--calibration", dir, "--out", &out].map(str::to_owned);
    let rig = fs::read_to_string(place.path("cal/rig.toml")).unwrap();
    // A wire that is a little wider.
    let turned = rig.replacen("half_width_deg = 0.6", "half_width_deg = 0.61", 1);
    assert_ne!(turned, rig);
    fs::write(place.path("moved.toml"), &turned).unwrap();
    let calibrate = ["calibrate", "photometry", "--image-size", "16", "--rig"];
    run(
        &[&calibrate[..], &[&place.at("moved.toml"), "--out", &moved]].concat(),
        "",
    )
    .done();
    refuses(
        &again(&moved),
        "",
        2,
        &[
            "moved/rig.toml: geometry: expected",
            "found another",
            "pointed elsewhere",
        ],
    );
    refuses(
        &again(&none),
        "",
        2,
        &[&none, "expected geometry.json or photometry.json"],
    );
    let tilted = place.at("tilted");
    let measure = [
        "measure",
        "--step",
        "30",
        "--image-size",
        "16",
        "--exposure-ms",
        "4",
        "--tilt",
        "12:30",
    ];
    run(&[&measure[..], &["--out", &tilted]].concat(), "").done();
    let tilted = ["assemble", &tilted, "--calibration", cal, "--out", &out];
    refuses(
        &tilted,
        "",
        2,
        &["expected a standard that was captured at the tilt of the sample"],
    );
    assert!(!Path::new(&out).exists());
}

/// What is there is not written over.
fn outputs_are_apart(place: &Place, m: &str, cal: &str) {
    let other = place.at("other-m");
    run(&quick(Path::new(&other)), "").done();
    for (out, part) in [
        (format!("{m}/brdf.zarr"), "a measurement's own one"),
        (format!("{m}/../m/brdf.zarr"), "a measurement's own one"),
        (format!("{other}/brdf.zarr"), "a measurement's own one"),
        (m.to_owned(), "the measurement itself"),
        (format!("{m}/brdf.zarr/f"), "a place in the brdf.zarr"),
        (format!("{m}/raw.zarr/x.zarr"), "a place in the raw.zarr"),
        (cal.to_owned(), "expected"),
    ] {
        refuses(&["assemble", m, "--out", &out], "", 2, &[&out, part]);
    }
    refuses(&["assemble", m, "--calibration", cal], "", 2, &["--out"]);
    // Not captured yet.
    let planned = place.at("planned");
    run(
        &[
            "plan",
            "--step",
            "30",
            "--image-size",
            "8",
            "--exposure-ms",
            "4",
            "--out",
            &planned,
        ],
        "",
    )
    .done();
    let outcome = run(&["assemble", &planned, "--out", &place.at("x.zarr")], "");
    outcome.complains(outcome.code.unwrap(), &["raw.zarr"]);
    assert!(outcome.code != Some(0) && !place.path("x.zarr").exists());
}

const SAID: &str = "operator = \"Ada <L>\"\nlaboratory = \"Cellar\"\ntemperature_c = 21.5\nhumidity_percent = 40\n\
                    notes = [\"door open\"]\nattachments = [\"sample 1.png\", \"set-up.txt\"]\n[instruments]\ncamera = \"C-17\"\n";

/// The measurement `m` with all that can be said of a session.
fn recorded(place: &Place) -> Vec<String> {
    fs::write(place.path("session.toml"), SAID).unwrap();
    fs::write(place.path("sample 1.png"), "a picture").unwrap();
    fs::write(place.path("set-up.txt"), "a text").unwrap();
    let mut all = quick(&place.path("m"));
    all.extend(["--session", &place.at("session.toml"), "--note", "second try"].map(str::to_owned));
    all
}

#[test]
fn who_what_and_when_stand_in_the_measurement_its_report_and_its_result() {
    let place = Place::new();
    let all = recorded(&place);
    run(&all, "").done();
    let m = place.path("m");
    let record = json(&m.join("session.json"));
    let session = &record["sessions"][0];
    assert_eq!(session["began"], "2023-11-14T22:13:20Z");
    assert_eq!(session["said"]["operator"], "Ada <L>");
    assert_eq!(
        session["said"]["notes"],
        serde_json::json!(["door open", "second try"])
    );
    assert_eq!(session["attached"][0]["name"], "sample 1.png");
    assert_eq!(record["trigger_boxes"][0]["port"], "sim");
    assert_eq!(
        fs::read(m.join("attachments/sample 1.png")).unwrap(),
        b"a picture"
    );
    let page = fs::read_to_string(m.join("report.html")).unwrap();
    let own = lineage(&m.join("brdf.zarr"));
    for part in [
        "Who, what, when",
        "Ada &lt;L&gt;",
        "Cellar",
        "21.5 °C",
        "40 %",
        "serial number C-17",
        "2023-11-14T22:13:20Z",
        "<img src=\"data:image/png;base64,YSBwaWN0dXJl\"",
        "<a href=\"attachments/sample%201.png\"",
        "attachments/set-up.txt",
        own["sha256"]["raw.zarr"].as_str().unwrap(),
        own["sha256"]["plan.toml"].as_str().unwrap(),
        session["attached"][1]["sha256"].as_str().unwrap(),
    ] {
        assert!(page.contains(part), "`{part}` is missing");
    }
    assert_eq!(own["operators"], serde_json::json!(["Ada <L>"]));
    assert_eq!(own["notes"], serde_json::json!(["door open", "second try"]));
    assert!(!own.to_string().contains("2023"), "a date in {own}");

    // The same command goes on without a change, but for the log.
    let before = files(&m);
    let log = fs::read_to_string(m.join("log.txt")).unwrap();
    for part in ["rcg measure", "capture: ", "assemble: over after", "done"] {
        assert!(log.contains(part), "`{part}` is missing in {log}");
    }
    run(&[&all[..], &["--resume".to_owned()]].concat(), "").done();
    assert!(files(&m) == before);
    let longer = fs::read_to_string(m.join("log.txt")).unwrap();
    assert!(longer.starts_with(&log) && longer.matches("rcg measure").count() == 2);

    // Somebody else goes on at another time: both are named, and the first as before.
    let resume = ["measure", "--resume", "--operator", "Bo", "--out", text(&m)];
    let output = rcg(&resume)
        .env("SOURCE_DATE_EPOCH", "1700086400")
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    let later = json(&m.join("session.json"));
    assert_eq!(later["sessions"][0], *session);
    assert_eq!(later["sessions"][1]["said"]["operator"], "Bo");
    assert_eq!(later["sessions"][1]["began"], "2023-11-15T22:13:20Z");
    assert_eq!(
        lineage(&m.join("brdf.zarr"))["operators"],
        serde_json::json!(["Ada <L>", "Bo"])
    );
    let page = fs::read_to_string(m.join("report.html")).unwrap();
    assert!(page.contains("Ada &lt;L&gt;") && page.contains("2023-11-15T22:13:20Z"));
    let same = [
        "manifest.json",
        "raw.zarr",
        "brdf.zarr/f",
        "brdf.zarr/sigma",
        "attachments",
        "figures",
    ];
    let kept = |all: std::collections::BTreeMap<PathBuf, Vec<u8>>| -> Vec<_> {
        all.into_iter()
            .filter(|(name, _)| same.iter().any(|part| name.starts_with(part)))
            .collect()
    };
    assert!(kept(files(&m)) == kept(before));
}

#[test]
fn a_record_that_is_not_as_it_was_is_refused_by_every_stage() {
    let place = Place::new();
    run(&recorded(&place), "").done();
    let m = place.path("m");
    let record = m.join("session.json");
    let whole = fs::read_to_string(&record).unwrap();
    let other = place.path("n");
    let mut bare = quick(&other);
    bare.extend(["--operator", "Eve"].map(str::to_owned));
    run(&bare, "").done();
    let exchanged = fs::read_to_string(other.join("session.json")).unwrap();
    for (content, part) in [
        (
            Some(whole.replace("Cellar", "Attic")),
            "something else has changed",
        ),
        (Some(whole[..100].to_owned()), "found no JSON object"),
        (Some(exchanged), "found that of another"),
        (None, "found none"),
    ] {
        for command in [&["measure", "--resume", "--out"][..], &["capture"], &["assemble"]] {
            match &content {
                Some(content) => fs::write(&record, content).unwrap(),
                None => fs::remove_file(&record).unwrap_or_default(),
            }
            refuses(&[command, &[text(&m)]].concat(), "", 2, &["session.json", part]);
        }
    }
    fs::write(&record, whole).unwrap();
    run(&["assemble", text(&m)], "").done();
    // An attachment that is another is told.
    fs::write(m.join("attachments/set-up.txt"), "another").unwrap();
    run(&["measure", "--resume", "--out", text(&m)], "").done();
    let page = fs::read_to_string(m.join("report.html")).unwrap();
    assert_eq!(page.matches("not there as it went along").count(), 1);
}

#[test]
fn what_cannot_be_said_is_refused_before_anything_is_made() {
    let place = Place::new();
    let file = place.path("session.toml");
    let m = place.path("m");
    for (said, parts) in [
        ("operater = \"A\"", &["session.toml", "operater"][..]),
        (
            "temperature_c = 1000",
            &["temperature_c: expected a number from -50 to 100, found 1000"],
        ),
        ("operator = 7", &["operator", "expected"]),
        ("[instruments]\nlamp = \"L\"", &["instruments.lamp"]),
        (
            "attachments = [\"none.png\"]",
            &["none.png", "attachments: expected a file of at most 32 MiB"],
        ),
        ("attachments = [\".\"]", &["attachments: expected"]),
        ("operator = ", &["session.toml", "line 1"]),
    ] {
        fs::write(&file, said).unwrap();
        for command in ["measure", "plan"] {
            let mut all = quick(&m);
            command.clone_into(&mut all[0]);
            all.extend(["--session", text(&file)].map(str::to_owned));
            refuses(&all, "", 2, parts);
            assert!(!m.exists());
        }
    }
    refuses(
        &["plan", "--note", "x"],
        "",
        2,
        &["--note: expected --out beside it"],
    );
    let output = rcg(&quick(&m)).env("SOURCE_DATE_EPOCH", "soon").output().unwrap();
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(
        told.contains("SOURCE_DATE_EPOCH: expected seconds since 1970, found `soon`"),
        "{told}"
    );
    assert!(!m.exists());
}

#[test]
fn plan_capture_and_calibration_are_recorded_and_what_is_made_of_files_says_of_which() {
    let place = Place::new();
    let [cal, m, filled, turned] = ["cal", "m", "filled.zarr", "turned.zarr"].map(|name| place.at(name));
    let calibrate = [
        "calibrate",
        "photometry",
        "--image-size",
        "16",
        "--operator",
        "Cy",
        "--out",
    ];
    let output = rcg(&[&calibrate[..], &[&cal]].concat())
        .env("SOURCE_DATE_EPOCH", "1699913600")
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    let plan = [
        "plan",
        "--step",
        "30",
        "--image-size",
        "16",
        "--exposure-ms",
        "4",
        "--operator",
        "Ada",
        "--calibration",
    ];
    run(&[&plan[..], &[&cal, "--out", &m]].concat(), "").done();
    run(&["capture", &m, "--operator", "Bo", "--note", "night shift"], "").done();
    run(&["measure", "--resume", "--out", &m], "").done();
    let record = json(&place.path("m/session.json"));
    let commands: Vec<&str> = record["sessions"]
        .as_array()
        .unwrap()
        .iter()
        .map(|one| one["command"].as_str().unwrap())
        .collect();
    assert_eq!(commands, ["plan", "capture", "measure"]);
    let used = &record["calibration"];
    assert_eq!(used["made"][0]["said"]["operator"], "Cy");
    assert!(used["sha256"]["photometry.json"].is_string() && used["standards"][0].is_string());
    let page = fs::read_to_string(place.path("m/report.html")).unwrap();
    for part in [
        "calibrate photometry 2023-11-13T22:13:20Z, 1.0 days before, by Cy",
        "night shift",
        "without certificate",
    ] {
        assert!(page.contains(part), "`{part}` is missing");
    }

    let own = lineage(&place.path("m/brdf.zarr"));
    assert_eq!(own["operators"], serde_json::json!(["Ada", "Bo"]));
    run(&["fill", &m, "--out", &filled], "").done();
    run(&["turn", &filled, "--azimuth", "20", "--out", &turned], "").done();
    let (of_filled, of_turned) = (
        lineage(&place.path("filled.zarr")),
        lineage(&place.path("turned.zarr")),
    );
    assert_eq!(of_filled["command"], "fill");
    assert_eq!(of_filled["inputs"][0]["lineage"], own);
    assert_eq!(of_turned["inputs"][0]["lineage"], of_filled);
    let sum = of_turned["inputs"][0]["sha256"].as_str().unwrap();
    assert_eq!(sum.len(), 64);
    // What is made of a capture is no evidence beside it.
    refuses(
        &["fill", &turned, &turned, "--out", &place.at("x.zarr")],
        "",
        2,
        &["expected another capture"],
    );
}
