//! Bands of light: what channels are, and images whose bands are lit one after the other.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::answers::number;
use crate::command::{refuses, run, text};

const RCG_1: &str = include_str!("../../../src/instrument/rig/presets/rcg-1-16bit.toml");
const NAMES: &str =
    "name = [\"red\", \"green\", \"blue\"]\ncentre_nm = [620, 530, 460]\nwidth_nm = [60, 70, 25]\n";
/// Of three colours that differ.
const SAMPLE: &str = "lambert:0.6,0.3,0.06";

/// The preset with so many channels of the camera and `bands`.
fn rig(folder: &Path, name: &str, channels: u8, bands: &str) -> PathBuf {
    let text = RCG_1.replacen("channels = 3 ", &format!("channels = {channels} "), 1);
    assert!(RCG_1.contains("channels = 3 "));
    let path = folder.join(name);
    fs::write(&path, format!("{text}\n[bands]\n{bands}")).unwrap();
    path
}

fn by_projector(folder: &Path) -> PathBuf {
    rig(
        folder,
        "projector.toml",
        1,
        &format!("made_by = \"projector\"\n{NAMES}"),
    )
}

/// The same by a camera with colours.
fn by_camera(folder: &Path) -> PathBuf {
    rig(folder, "camera.toml", 3, NAMES)
}

fn measure<'a>(rig: &'a Path, out: &'a Path, more: &[&'a str]) -> Vec<&'a str> {
    let what = [
        "measure",
        "--rig",
        text(rig),
        "--out",
        text(out),
        "--sample",
        SAMPLE,
    ];
    let size = ["--step", "45", "--image-size", "16", "--json"];
    [&what[..], &size, more].concat()
}

/// What is asked of a result, and what it answers: r g b of each line, or a reason.
fn values(result: &Path) -> Vec<Vec<f64>> {
    let mut asked = String::new();
    for (theta_i, theta_o) in [(22.5, 40.0), (67.5, 60.0), (67.5, 35.0)] {
        for phi_deg in [0.0, 45.0, 90.0] {
            writeln!(asked, "{theta_i} {phi_deg} {theta_o} 200").expect("strings take everything");
        }
    }
    let answered = run(&["value", text(result)], &asked);
    let line = |line: &str| line.split(' ').filter_map(|word| word.parse().ok()).collect();
    answered.done().lines().map(line).collect()
}

/// Whatever is asked for, and whatever goes wrong on the way, bands that are lit one after the other give what a camera with colours
/// does in one frame.
#[test]
fn bands_in_turn_are_those_of_a_camera_with_colours() {
    let scratch = tempfile::tempdir().unwrap();
    let (one, other) = (by_camera(scratch.path()), by_projector(scratch.path()));
    let faults = ["--missed-triggers", "0.1", "--dropped-frames", "0.05"];
    for (number_of, options) in [
        &["--exposure-ms", "9"][..],
        &["--brackets", "2,8,30"],
        &["--exposure-ms", "3", "--light", "complement"],
    ]
    .into_iter()
    .enumerate()
    {
        let at = |name: &str| scratch.path().join(format!("{name}-{number_of}"));
        let still = [options, &["--noise", "off"]].concat();
        let together = run(&measure(&one, &at("camera"), &still), "").object();
        let in_turn = run(
            &measure(&other, &at("projector"), &[&still[..], &faults].concat()),
            "",
        )
        .object();
        assert_eq!(number(&in_turn, "exposures"), number(&together, "exposures"));
        let ratio = number(&in_turn, "instrument_s") / number(&together, "instrument_s");
        // Liquid crystals have more time to settle, too.
        assert!(ratio > 3.0, "{ratio}");
        assert_eq!(
            number(&in_turn, "capture.paired"),
            3.0 * number(&together, "exposures")
        );
        assert!(number(&in_turn, "capture.repeated") > 0.0, "{in_turn}");
        let [together, in_turn] = [at("camera"), at("projector")].map(|result| values(&result));
        let mut compared = 0;
        for (a, b) in together.iter().flatten().zip(in_turn.iter().flatten()) {
            assert!((a / b - 1.0).abs() < 2e-3, "{options:?}: {a} {b}");
            compared += 1;
        }
        assert!(compared >= 9 && compared % 3 == 0, "{options:?}: {compared}");
        assert_eq!(together.concat().len(), in_turn.concat().len());
    }
}

/// What is interrupted goes on as it began, bit for bit, and as nothing else.
#[test]
fn bands_stay_what_they_are() {
    let scratch = tempfile::tempdir().unwrap();
    let (rig, out) = (by_projector(scratch.path()), scratch.path().join("m"));
    let short = ["--exposure-ms", "9", "--seed", "4"];
    run(&measure(&rig, &out, &short), "").done();
    let frames = out.join("raw.zarr");
    assert!(
        fs::read_to_string(frames.join("zarr.json"))
            .unwrap()
            .contains("620")
    );
    let before = values(&out);
    // Assembled again from the frames, and gone on with.
    run(&["assemble", text(&out)], "").done();
    assert_eq!(values(&out), before);
    run(&measure(&rig, &out, &[&short[..], &["--resume"]].concat()), "").done();
    assert_eq!(values(&out), before);
    let text_of = fs::read_to_string(&rig).unwrap();
    for (from, to) in [("620", "640"), ("\"green\"", "\"leaf\"")] {
        fs::write(&rig, text_of.replace(from, to)).unwrap();
        let mut again = measure(&rig, &out, &[&short[..], &["--resume"]].concat());
        again.retain(|word| *word != "--json");
        refuses(&again, "", 2, &["expected", "found"]);
    }
}

/// Names and wavelengths go with the values wherever they go.
#[test]
fn what_channels_are_goes_along() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let rig = by_camera(scratch.path());
    run(&measure(&rig, &at("m"), &["--exposure-ms", "9"]), "").done();
    let words =
        "red 620 nm (60 nm wide), green 530 nm (70 nm wide), blue 460 nm (25 nm wide), made by the camera";
    assert!(fs::read_to_string(at("m/report.html")).unwrap().contains(words));
    let filled = at("filled.zarr");
    run(&["fill", text(&at("m")), "--out", text(&filled)], "").done();
    let info = run(&["info", text(&filled)], "");
    assert!(info.done().contains(words), "{}", info.stdout);
    let out = at("m.brdf");
    let export = |to: &str, out: &Path, from: &Path| -> Vec<String> {
        let words = [
            "export",
            text(from),
            "--to",
            to,
            "--out",
            text(out),
            "--step",
            "45",
            "--zeros",
        ];
        words.map(str::to_owned).to_vec()
    };
    run(&export("bird", &out, &filled), "").done();
    let bird: Value = serde_json::from_str(&fs::read_to_string(&out).unwrap()).unwrap();
    for name in ["wavelength_i", "wavelength_r"] {
        let list = &bird["data"][name];
        assert_eq!((&list["unit"], &list["values"][1]), (&"nm".into(), &530.0.into()));
        let count = bird["data"]["BRDF"]["values"].as_array().unwrap().len();
        assert_eq!(list["values"].as_array().unwrap().len(), count);
    }
    // It is read as what it was.
    let [own, exported] = [&filled, &out].map(|result| values(result));
    assert_eq!(own.len(), exported.len());

    // Of other light nothing is made one.
    let infrared = NAMES.replace("460", "850");
    let rig = self::rig(scratch.path(), "infrared.toml", 3, &infrared);
    run(
        &measure(&rig, &at("infrared"), &["--exposure-ms", "9", "--seed", "2"]),
        "",
    )
    .done();
    let [m, infrared] = ["m", "infrared"].map(|name| text(&at(name).join("brdf.zarr")).to_owned());
    let parts = ["bands: expected", "460 nm", "found", "850 nm"];
    refuses(&["compare", &m, &infrared], "", 2, &parts);
    let combined = text(&at("combined.zarr")).to_owned();
    refuses(&["combine", &m, &infrared, "--out", &combined], "", 2, &parts);
    let lumped = at("infrared.bsdf");
    refuses(
        &export("zemax", &lumped, Path::new(&infrared)),
        "",
        2,
        &["bands: expected bands of 380 to 780 nm", "850 nm"],
    );
    assert!(!lumped.exists() && !at("combined.zarr").exists());
}

#[test]
fn what_bands_in_turn_cannot_do_is_said() {
    let scratch = tempfile::tempdir().unwrap();
    let (rig, out) = (by_projector(scratch.path()), scratch.path().join("patterns"));
    let sheets = [
        "patterns",
        "--rig",
        text(&rig),
        "--out",
        text(&out),
        "--sheets",
        "grb",
    ];
    refuses(
        &sheets,
        "",
        2,
        &["--sheets: expected patterns in white", "found rig"],
    );
    assert!(!out.exists());
    run(
        &[
            "patterns",
            "--rig",
            text(&rig),
            "--out",
            text(&out),
            "--step",
            "45",
        ],
        "",
    )
    .done();
    let pictures: Vec<PathBuf> = fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    let lit = |number: usize| {
        let mut of = pictures
            .iter()
            .filter(|path| text(path).ends_with(&format!("-{number}.png")));
        let picture = image::open(of.next().expect("one for each band"))
            .unwrap()
            .to_rgb8();
        let sums = [0, 1, 2].map(|channel| picture.pixels().map(|pixel| u64::from(pixel.0[channel])).sum());
        sums.map(|sum: u64| sum > 0)
    };
    assert_eq!(
        [1, 2, 3].map(lit),
        [[true, false, false], [false, true, false], [false, false, true]]
    );
}

/// From standards to a judged result: what flickers between bands is found, and in the uncertainty.
#[test]
fn a_rig_with_bands_in_turn_is_calibrated_and_right_within_its_uncertainty() {
    let scratch = tempfile::tempdir().unwrap();
    let rig = by_projector(scratch.path());
    let [truth, calibration, out] = ["truth.toml", "calibration", "m"].map(|name| scratch.path().join(name));
    fs::create_dir(&calibration).unwrap();
    let drawn =
        "truth --flaws typical --flicker-percent 0.5 --position-mm 0 --angle-deg 0 --without figure --seed 3";
    let mut draw: Vec<&str> = drawn.split(' ').collect();
    draw.extend(["--rig", text(&rig), "--out", text(&truth)]);
    run(&draw, "").done();
    let calibrated = run(
        &[
            "calibrate",
            "photometry",
            "--rig",
            text(&rig),
            "--truth",
            text(&truth),
            "--out",
            text(&calibration),
            "--image-size",
            "32",
            "--second-standard",
            "none",
            "--json",
        ],
        "",
    )
    .object();
    // As drawn: of all bands together the lamp would seem to flicker by 0.3 %, and pixels not to differ.
    for (found, true_value, within) in [("lamp.flicker", 5e-3, 0.25), ("camera.prnu", 5e-3, 0.4)] {
        let ratio = number(&calibrated, found) / true_value;
        assert!((ratio - 1.0).abs() < within, "{found}: {ratio} of what is true");
    }
    let more = [
        "--truth",
        text(&truth),
        "--calibration",
        text(&calibration),
        "--seed",
        "5",
    ];
    let mut measured = measure(&rig, &out, &more);
    let size = measured.iter().position(|word| *word == "16").unwrap();
    measured[size] = "32";
    run(&measured, "").done();
    let brdf = out.join("brdf.zarr");
    let judged = run(&["evaluate", text(&brdf), "--reference", SAMPLE, "--json"], "").object();
    assert!(number(&judged, "against_reference.within_k2") > 0.9, "{judged}");
    let compared = run(&["compare", SAMPLE, text(&brdf)], "");
    assert!(
        compared.done().contains("bias, red 620 nm (60 nm wide)"),
        "{}",
        compared.stdout
    );
}
