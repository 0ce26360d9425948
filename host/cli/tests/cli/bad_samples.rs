//! Measured files that are not what their name says.

use std::fs;

use crate::command::{quick, refuses, run, text};
use crate::tensor_file::{bytes, material, named, spectral};

/// The `content` as a `.bsdf`, refused by every command that takes a sample.
fn refused(content: &[u8], parts: &[&str]) {
    let scratch = tempfile::tempdir().unwrap();
    let path = scratch.path().join("sample.bsdf");
    fs::write(&path, content).unwrap();
    let parts: Vec<&str> = [text(&path), "expected", "found"]
        .into_iter()
        .chain(parts.iter().copied())
        .collect();
    refuses(&["value", text(&path)], "30 0 30 180\n", 2, &parts);
    let picture = scratch.path().join("sphere.png");
    refuses(&["render", text(&path), "--out", text(&picture)], "", 2, &parts);
    let out = scratch.path().join("out");
    let mut measure = quick(&out);
    measure.extend(["--sample".to_owned(), text(&path).to_owned()]);
    refuses(&measure, "", 2, &parts);
    assert!(!picture.exists() && !out.exists());
}

#[test]
fn a_sound_file_has_values() {
    let scratch = tempfile::tempdir().unwrap();
    let path = scratch.path().join("sample.bsdf");
    fs::write(&path, bytes(&material(0.1))).unwrap();
    let outcome = run(&["value", text(&path)], "30 0 60 120\n");
    let values: Vec<f64> = outcome
        .done()
        .split_whitespace()
        .map(|word| word.parse().unwrap())
        .collect();
    // The file holds f·cosθo.
    assert_eq!(values.len(), 3);
    assert!(values.iter().all(|f| (f - 0.1 / 0.5).abs() < 1e-5), "{values:?}");
}

#[test]
fn spectra_become_colours_wherever_a_sample_is_read() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&scratch.path().join(name)).to_owned();
    let path = at("sample.bsdf");
    // As much of all light, and more of what is long.
    for (slope, file) in [(0.0, at("grey.bsdf")), (0.5, path.clone())] {
        fs::write(file, bytes(&spectral(0.1, slope))).unwrap();
    }
    let values = |file: &str| -> Vec<f64> {
        let answered = run(&["value", file], "30 0 60 120\n");
        let words = answered.done().split_whitespace();
        words.map(|word| word.parse().unwrap()).collect()
    };
    let grey = values(&at("grey.bsdf"));
    assert!(grey.iter().all(|f| (f - 0.1 / 0.5).abs() < 1e-5), "{grey:?}");
    let reddish = values(&path);
    assert!(reddish[0] > reddish[1] && reddish[1] > reddish[2], "{reddish:?}");
    let info = run(&["info", &path, "--json"], "").object();
    let told = info["facts"].to_string();
    assert!(
        told.contains("7 wavelengths from 400 to 700 nm")
            && told.contains("CIE 1931")
            && told.contains("D65"),
        "{told}"
    );
    let picture = at("sphere.exr");
    run(&["render", &path, "--size", "16", "--out", &picture], "").done();
    let again = at("again.bsdf");
    let told = run(&["export", &path, "--to", "bsdf", "--out", &again, "--json"], "").object();
    assert!(told["warnings"].to_string().contains("D65"), "{told}");
    assert_eq!(values(&again), reddish);
    // Without blue nobody knows a colour.
    let mut fields = spectral(0.1, 0.0);
    let wavelengths = (0..7_u8).map(|n| 500.0 + 25.0 * f32::from(n));
    named(&mut fields, "wavelengths").data = wavelengths.flat_map(f32::to_le_bytes).collect();
    refused(&bytes(&fields), &["wavelengths", "420 to 680 nm", "500 to 650"]);
}

#[test]
fn a_truncated_file_is_refused_wherever_it_ends() {
    let whole = bytes(&material(0.1));
    for length in [0, 5, 12, 17, 30, 100, whole.len() / 2, whole.len() - 1] {
        refused(&whole[..length], &[]);
    }
}

#[test]
fn a_field_that_lies_outside_the_file_is_refused() {
    for offset in [1 << 20, u64::MAX - 3, u64::MAX] {
        let mut fields = material(0.1);
        named(&mut fields, "rgb").offset = Some(offset);
        refused(&bytes(&fields), &["rgb"]);
    }
}

#[test]
fn a_size_that_is_only_claimed_is_refused() {
    // 10^12 entries, and sizes whose product does not fit 64 bits.
    for side in [408_248, 1 << 31, u64::MAX] {
        let mut fields = material(0.1);
        named(&mut fields, "rgb").shape = vec![1, 2, 3, side, side];
        refused(&bytes(&fields), &["rgb"]);
    }
    let mut many_fields = bytes(&material(0.1));
    many_fields[14..18].copy_from_slice(&u32::MAX.to_le_bytes());
    refused(&many_fields, &[]);
}

#[test]
fn values_that_make_no_material_are_refused() {
    let changed = |name, value: f32| {
        let mut fields = material(0.1);
        named(&mut fields, name).data[..4].copy_from_slice(&value.to_le_bytes());
        bytes(&fields)
    };
    refused(&changed("rgb", f32::NAN), &["rgb", "finite"]);
    refused(&changed("ndf", -1.0), &["ndf"]);
    refused(&changed("theta_i", 9.0), &["theta_i"]);
    let mut dark = material(0.1);
    named(&mut dark, "vndf").data.fill(0);
    refused(&bytes(&dark), &["vndf", "density", "zero everywhere"]);
    let without = material(0.1).into_iter().filter(|field| field.name != "sigma");
    refused(&bytes(&without.collect::<Vec<_>>()), &["sigma"]);
}

#[test]
fn a_zemax_file_of_the_same_extension_is_told_apart_and_no_lobe_is_guessed() {
    let zemax = "Source  Measured\nSymmetry  ASymmetrical4D\nSpectralContent  Monochrome\n\
                 ScatterType  BRDF\nSampleRotation  1\n0\nAngleOfIncidence  1\n0\nScatterAzimuth 1\n0\n\
                 ScatterRadial 1\n0\nMonochrome\nDataBegin\nTIS 0.1\n0.1\nDataEnd\n";
    refused(zemax.as_bytes(), &["ScatterAzimuth", "all around", "others"]);
    let (half, _) = zemax.split_once("AngleOfIncidence").unwrap();
    refused(half.as_bytes(), &["AngleOfIncidence", "a line AngleOfIncidence"]);
}

#[test]
fn a_file_that_is_missing_or_a_folder_is_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let missing = scratch.path().join("missing.bsdf");
    refuses(
        &["value", text(&missing)],
        "",
        2,
        &[text(&missing), "expected", "found"],
    );
    fs::create_dir(&missing).unwrap();
    refuses(
        &["value", text(&missing)],
        "",
        2,
        &[text(&missing), "expected", "found"],
    );
}

#[test]
fn certificates_of_one_plate_make_one() {
    let scratch = tempfile::tempdir().unwrap();
    let example = fs::read_to_string(crate::commands::standard()).unwrap();
    let file = |name: &str, from: &str, to: &str| {
        let path = scratch.path().join(name);
        let content = example.replace("EXAMPLE-2026-17", name).replace(from, to);
        fs::write(&path, content).unwrap();
        text(&path).to_owned()
    };
    let first = file("first.toml", "0.985", "0.985");
    let second = file("second.toml", "0.985", "0.983");
    let out = text(&scratch.path().join("mean.toml")).to_owned();
    let mean = [
        "standard",
        &first,
        &second,
        "--out",
        &out,
        "--independent",
        "--json",
    ];
    let mean = run(&mean, "").object();
    let number = |pointer: &str| mean.pointer(pointer).unwrap().as_f64().unwrap();
    assert!((number("/certificate/value/0") - 0.984).abs() < 1e-9, "{mean}");
    assert!((number("/certificate/standard_uncertainty/0") - 0.0025 / 2_f64.sqrt()).abs() < 1e-9);
    assert!((number("/birge_ratio") - 0.566).abs() < 1e-3);
    run(&["standard", &out], "").done();

    let other = file("other.toml", "EX-0001", "EX-0002");
    let darker = file("darker.toml", "0.985", "0.945");
    for (rest, parts) in [
        (vec![&first, &other], ["other.toml", "serial"]),
        (vec![&first, &darker], ["toml", "standard uncertainties off"]),
        (vec![&first, &first], ["first.toml", "the same file"]),
        (vec![&first], ["--out", "several certificates"]),
    ] {
        let arguments: Vec<&str> = ["standard", "--out", &out]
            .into_iter()
            .chain(rest.into_iter().map(String::as_str))
            .collect();
        refuses(&arguments, "", 2, &parts);
    }
    refuses(
        &["standard", &first, &second, "--out", &second],
        "",
        2,
        &["second.toml", "another file"],
    );
    assert!(fs::read_to_string(&second).unwrap().contains("0.983"));
    refuses(
        &["standard", &first, &second],
        "",
        2,
        &["--out", "a file for the mean"],
    );
}
