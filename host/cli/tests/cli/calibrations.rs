//! Calibration and filling: from the command to what measurements make of it, and what is refused.

use std::fs;
use std::path::Path;

use rcg::store::provenance::Provenance;
use serde_json::Value;

use crate::answers::number;
use crate::command::{is_full, refuses, run, text};
use crate::judge::scores;
use crate::tensor_file::{bytes, material};

/// A rig that strays from its file, and where its calibration goes.
struct Lab {
    folder: tempfile::TempDir,
}

impl Lab {
    fn new() -> Self {
        let lab = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        // Coarse images of a bent mirror determine nothing: this one is good.
        let line = ["truth", "--seed", "2", "--figure-mrad", "0.05", "--out"];
        run(&[&line[..], &[&lab.at("truth.toml")]].concat(), "").done();
        lab
    }

    fn at(&self, name: &str) -> String {
        text(&self.folder.path().join(name)).to_owned()
    }

    /// `rcg calibrate` of the rig as it really is.
    fn calibrate(&self, what: &str, image_size: &str, rest: &[&str]) -> Vec<String> {
        let (out, truth) = (self.at("calibration"), self.at("truth.toml"));
        let all = [
            "calibrate",
            what,
            "--out",
            &out,
            "--truth",
            &truth,
            "--image-size",
            image_size,
        ];
        all.iter().chain(rest).map(|part| (*part).to_owned()).collect()
    }

    fn measure(&self, name: &str, step_deg: &str, rest: &[&str]) -> Vec<String> {
        let (out, truth) = (self.at(name), self.at("truth.toml"));
        let all = [
            "measure",
            "--out",
            &out,
            "--truth",
            &truth,
            "--sample",
            "lambert:0.5",
            "--step",
            step_deg,
        ];
        let all = all.iter().chain(&["--image-size", "32"]).chain(rest);
        all.map(|part| (*part).to_owned()).collect()
    }
}

/// A lamp that has aged since the calibration does no harm; another one is told.
fn lamp_is_compared(lab: &Lab, with: &[&str], median: &dyn Fn(&str, &[&str]) -> f64) {
    let path = lab.at("truth.toml");
    let truth = fs::read_to_string(&path).unwrap();
    let changed = |change: &str| truth.replace("change = 0.0", &format!("change = {change}"));
    fs::write(&path, changed("-0.06")).unwrap();
    assert!(median("aged", with) < 0.015);
    fs::write(&path, changed("0.3")).unwrap();
    let parts = [
        "calibration.json",
        "lamp: expected light within 10 %",
        "was the lamp changed",
    ];
    let exchanged = lab.measure("exchanged", "30", &[with, &["--resume"]].concat());
    refuses(&exchanged, "", 2, &parts);
    fs::write(&path, &truth).unwrap();
}

/// Whoever learns that the standard is another one than was thought says so: the same frames are fitted with it. How they were captured
/// stays.
fn the_standard_is_what_is_said_of_it(lab: &Lab) {
    let again = |rest: &[&str]| lab.calibrate("photometry", "32", &[rest, &["--json"]].concat());
    let none = ["--second-standard", "none"];
    let alone = run(&again(&none), "").object();
    assert_eq!(alone["interreflection"], Value::Null);
    let other = run(&again(&[&none[..], &["--standard", "lambert:0.9"]].concat()), "").object();
    assert_eq!(other["standards"][0]["named"], "lambert:0.9");
    let sensitivity = |found: &Value| found["sensitivity"][0].as_f64().unwrap();
    let ratio = sensitivity(&other) / sensitivity(&alone);
    assert!((ratio / (0.98 / 0.9) - 1.0).abs() < 1e-6, "{ratio}");
    for (rest, captured) in [
        (["--tilts", "54:45:60"], "--tilts as captured, 51:84:40"),
        (["--exposure-ms", "1"], "--exposure-ms as captured"),
        (["--second-standard", "lambert:0.9"], "differ by"),
        // Beside the other one it is too bright for that.
        (
            ["--standard", "lambert:0.9"],
            "are both standards what they are said to be",
        ),
    ] {
        refuses(
            &lab.calibrate("photometry", "32", &rest),
            "",
            2,
            &["expected", captured],
        );
    }
}

/// A mask holds from then on, what was captured with the geometry before it is told, and without it all is as it was.
fn what_is_painted_is_not_measured(lab: &Lab) {
    let calibration = lab.at("calibration");
    let folder = Path::new(&calibration);
    let rig = || fs::read_to_string(folder.join("rig.toml")).unwrap();
    let before = rig();
    let standard = image::open(folder.join("geometry-standard.png")).unwrap();
    let mask = lab.at("painted.png");
    let is_white = |x: u32, y: u32| (20..30).contains(&x) && (25..32).contains(&y);
    image::GrayImage::from_fn(standard.width(), standard.height(), |x, y| {
        image::Luma([if is_white(x, y) { 255 } else { 0 }])
    })
    .save(&mask)
    .unwrap();
    let again = |rest: &[&str]| {
        let told = run(&lab.calibrate("geometry", "64", rest), "").done().to_owned();
        (rig(), told)
    };
    let (masked, told) = again(&["--mask", &mask]);
    assert!(
        masked.contains("mask 1") && !before.contains("mask 1"),
        "{masked}"
    );
    assert!(told.contains("its photometric captures were lit"), "{told}");
    let (kept, told) = again(&[]);
    assert_eq!(kept, masked);
    assert!(!told.contains("photometric"), "{told}");
    fs::remove_file(folder.join("mask.png")).unwrap();
    assert_eq!(again(&[]).0, before);
    let truth = lab.at("truth.toml");
    let none = lab.calibrate("geometry", "64", &["--mask", &truth]);
    refuses(&none, "", 2, &["truth.toml", "expected a picture (PNG)"]);
    assert_eq!(rig(), before);
}

#[test]
#[ignore = "long: ./test.sh full runs it; worlds do the like"]
fn a_calibrated_rig_measures_what_is_there_tilted_too() {
    let lab = Lab::new();
    let geometry = run(
        &[&lab.calibrate("geometry", "64", &[])[..], &["--json".to_owned()]].concat(),
        "",
    )
    .object();
    assert!(number(&geometry, "camera_deg") < 0.05 && number(&geometry, "projector_deg") < 0.05);
    let standards = lab.calibrate("photometry", "32", &["--tilts", "51:84:40", "--json"]);
    let photometry = run(&standards, "").object();
    assert!(number(&photometry, "field_uncertainty") < 0.005);
    let calibration = lab.at("calibration");
    for file in [
        "rig.toml",
        "geometry.json",
        "geometry-residuals.png",
        "geometry-standard.png",
        "photometry.json",
    ] {
        assert!(Path::new(&calibration).join(file).is_file(), "{file}");
    }
    the_standard_is_what_is_said_of_it(&lab);
    // What was captured is fitted again without a new capture, and found again.
    assert_eq!(run(&standards, "").object(), photometry);
    // What says what was captured belongs to the frames.
    for (what, size) in [("geometry", "64"), ("photometry", "32")] {
        let views = Path::new(&calibration).join(format!("{what}-views.json"));
        let content = fs::read_to_string(&views).unwrap();
        fs::write(&views, content.clone() + "\n").unwrap();
        let parts = [text(&views), "the frames beside it", "found another"];
        refuses(&lab.calibrate(what, size, &[]), "", 2, &parts);
        fs::write(&views, content).unwrap();
    }

    what_is_painted_is_not_measured(&lab);

    let median = |name: &str, rest: &[&str]| {
        let object = run(&lab.measure(name, "15", &[rest, &["--json"]].concat()), "").object();
        number(&object, "evaluation.against_reference.relative_error.median")
    };
    let with = ["--calibration", calibration.as_str()];
    assert!(median("without", &[]) > 0.05);
    assert!(median("with", &with) < 0.015);
    lamp_is_compared(&lab, &with, &median);
    let tilted = ["--tilt", "51:84:40"];
    assert!(median("tilted", &[&with[..], &tilted[..]].concat()) < 0.015);

    // Another rig, another calibration on resumption, another tilt.
    let other = lab.measure("other", "15", &[&with[..], &["--rig", "rcg-2"]].concat());
    refuses(
        &other,
        "",
        2,
        &[
            "geometry.json",
            "expected a calibration of rig rcg-2",
            "calibrate this rig",
        ],
    );
    assert!(!Path::new(&lab.at("other")).exists());
    let again = lab.measure("with", "15", &["--tilt", "10:0", "--resume"]);
    refuses(&again, "", 2, &["tilt: expected", "10"]);

    // All that was captured together, and by itself again with --repeat.
    let (first, second) = (lab.at("with"), lab.at("tilted"));
    let filled = run(
        &["fill", &first, &second, "--out", &lab.at("both.zarr"), "--json"],
        "",
    )
    .object();
    assert!((number(&filled, "alignments.0.scale") - 1.0).abs() < 0.02);
    let both = run(
        &[
            "evaluate",
            &lab.at("both.zarr"),
            "--reference",
            "lambert:0.5",
            "--json",
        ],
        "",
    )
    .object();
    assert!(number(&both, "coverage") > 0.999);
}

/// The example of a certificate in `lab`, changed.
fn certificate(lab: &Lab, name: &str, changes: &[(&str, &str)]) -> String {
    let example = fs::read_to_string(crate::commands::standard()).unwrap();
    let text = changes.iter().fold(example, |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replacen(from, to, 1)
    });
    let path = lab.at(name);
    fs::write(&path, text).unwrap();
    path
}

#[test]
fn a_certificate_is_taken_while_it_holds_and_named_by_all_that_follows() {
    let lab = Lab::new();
    let day = ["--date", "2026-05-01"];
    let white = certificate(&lab, "white.toml", &[("2036-02-17", "2026-06-30")]);
    let grey = certificate(
        &lab,
        "grey.toml",
        &[("EXAMPLE-2026-17", "GREY-1"), ("value = 0.985", "value = 0.2")],
    );
    let both = ["--standard", white.as_str(), "--second-standard", grey.as_str()];
    let line = |rest: &[&str]| lab.calibrate("photometry", "32", &[&both[..], rest].concat());
    let late = [
        "white.toml",
        "expires: expected",
        "2026-07-01",
        "found 2026-06-30",
    ];
    refuses(&line(&["--date", "2026-07-01"]), "", 2, &late);
    let early = ["white.toml", "calibrated: expected", "found 2026-02-17"];
    refuses(&line(&["--date", "2026-02-16"]), "", 2, &early);
    let percent = [&day[..], &["--standard-uncertainty-percent", "0.3"]].concat();
    let states = ["every standard has a certificate that states it", "found 0.3 %"];
    refuses(&line(&percent), "", 2, &states);
    refuses(
        &line(&["--date", "1.5.2026"]),
        "",
        2,
        &["--date: expected a day", "1.5.2026"],
    );
    assert!(
        !Path::new(&lab.at("calibration"))
            .join("photometry.raw.zarr")
            .exists()
    );

    let found = run(&line(&[&day[..], &["--json"]].concat()), "").object();
    assert_eq!(found["standards"][0]["certificate"]["expires"], "2026-06-30");
    assert_eq!(found["standards"][1]["certificate"]["number"], "GREY-1");
    assert!((number(&found, "standards.0.standard_uncertainty") - 0.0152).abs() < 1e-4);
    assert!((number(&found, "standards.1.standard_uncertainty") - 0.0195).abs() < 1e-4);
    // The same frames, fitted on a later day, by a certificate that holds no more.
    let again = ["--date", "2026-07-01", "--standard-expired", "--json"];
    let expired = run(&line(&again), "").object();
    assert_eq!(expired["standards"][0]["certificate"]["expired"], true);
    assert_eq!(expired["sensitivity"], found["sensitivity"]);

    let calibration = lab.at("calibration");
    let measure = lab.measure("named", "15", &["--calibration", &calibration, "--json"]);
    let object = run(&measure, "").object();
    let warnings = object["evaluation"]["warnings"].to_string();
    assert!(warnings.contains("had expired on 2026-06-30"), "{warnings}");
    let median = number(&object, "evaluation.against_reference.relative_error.median");
    assert!(
        median < number(&object, "evaluation.median_relative_sigma"),
        "{median}"
    );
    let measured = Path::new(&lab.at("named")).to_owned();
    let report = fs::read_to_string(measured.join("report.html")).unwrap();
    assert!(report.contains("EXPIRED on 2026-06-30") && report.contains("GREY-1"));
    let attributes = fs::read_to_string(measured.join("brdf.zarr/zarr.json")).unwrap();
    let attributes: Value = serde_json::from_str(&attributes).unwrap();
    let standards = &attributes["attributes"]["standards"];
    assert_eq!(*standards, expired["standards"]);
    assert_eq!(
        standards[0]["certificate"]["sha256"].as_str().map(str::len),
        Some(64)
    );
    let shown = run(&["evaluate", text(&measured.join("brdf.zarr"))], "");
    assert!(
        shown
            .done()
            .contains("certificate GREY-1 of Example Calibration Laboratory")
    );
}

#[test]
fn views_that_say_too_little_are_refused_by_name() {
    let lab = Lab::new();
    // One normal leaves a rotation free, and two that are almost the same too.
    let cases = [("10:30,10.1:30", "64"), ("15:30", "96")];
    for (tilts, image_size) in &cases[..if is_full() { 2 } else { 1 }] {
        let views = lab.calibrate("geometry", image_size, &["--tilts", tilts]);
        refuses(
            &views,
            "",
            2,
            &[
                "calibration views: expected views that determine",
                "other tilts, in other azimuths",
            ],
        );
        std::fs::remove_dir_all(lab.at("calibration")).ok();
    }
    let tilt = lab.calibrate("geometry", "64", &["--tilts", "10"]);
    assert_eq!(run(&tilt, "").code, Some(2));
}

#[test]
fn standards_that_say_nothing_are_refused_by_name() {
    let lab = Lab::new();
    let saturated = lab.calibrate("photometry", "32", &["--exposure-ms", "300"]);
    refuses(
        &saturated,
        "",
        2,
        &[
            "calibration views: expected frames of the standard",
            "saturated",
            "--exposure-ms",
        ],
    );

    let negative = lab.at("negative.bsdf");
    // Measured files with values below 0 are read as 0.
    fs::write(&negative, bytes(&material(-0.3))).unwrap();
    let lab = Lab::new();
    let standard = lab.calibrate("photometry", "32", &["--standard", &negative]);
    refuses(
        &standard,
        "",
        2,
        &[
            "negative.bsdf",
            "standard, f at incident",
            "a number above 0",
            "found 0",
        ],
    );
    assert!(!Path::new(&lab.at("calibration/photometry.json")).exists());
}

#[test]
fn captures_that_do_not_go_together_are_refused_by_name() {
    let lab = Lab::new();
    let [one, out] = ["one", "out.zarr"].map(|name| lab.at(name));
    run(&lab.measure("one", "15", &[]), "").done();
    refuses(
        &["fill", &one, &one, "--out", &out],
        "",
        2,
        &["one", "expected another capture", "found the same one"],
    );
    refuses(&["fill", &one, &lab.at("none"), "--out", &out], "", 2, &["none"]);
    refuses(
        &["fill", &one, "--out", &format!("{one}/brdf.zarr")],
        "",
        2,
        &["output: expected another file"],
    );
    let tilted = lab.measure("tilted", "15", &["--tilt", "95:0"]);
    assert_eq!(run(&tilted, "").code, Some(2));
    assert!(!Path::new(&out).exists());
}

#[test]
#[ignore = "long: ./test.sh full runs it"]
fn every_preset_can_be_calibrated_and_measures_what_is_there() {
    for preset in ["rcg-1-16bit", "rcg-2", "dmd"] {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| text(&folder.path().join(name)).to_owned();
        let (truth, out, measured) = (at("truth.toml"), at("calibration"), at("measured"));
        let with = |line: &[&str]| {
            let all = [line, &["--rig", preset, "--json"]].concat();
            run(&all, "").object()
        };
        with(&["truth", "--seed", "3", "--figure-mrad", "0.05", "--out", &truth]);
        let rest = ["--out", &out, "--truth", &truth, "--image-size"];
        with(&[&["calibrate", "geometry"], &rest[..], &["64"]].concat());
        with(&[&["calibrate", "photometry"], &rest[..], &["32"]].concat());
        let request = ["--sample", "lambert:0.5", "--step", "30", "--image-size", "24"];
        let measure = [
            "measure",
            "--out",
            &measured,
            "--truth",
            &truth,
            "--calibration",
            &out,
        ];
        let object = with(&[&measure[..], &request[..]].concat());
        let of = |field: &str| number(&object, &format!("evaluation.{field}"));
        let (error, stated) = (
            of("against_reference.relative_error.median"),
            of("median_relative_sigma"),
        );
        assert!(
            error < 2.0 * stated && stated < 0.03,
            "{preset}: {error} {stated}"
        );
        let brdf = folder.path().join("measured/brdf.zarr");
        let sample = rcg::brdf::sample::parse("lambert:0.5").unwrap();
        let found = scores(&brdf, sample.as_ref(), &[Provenance::Measured]);
        assert!(
            found.count > 3000 && found.within_2 > 0.93 && found.worst < 6.0,
            "{preset}: {found}"
        );
    }
}
