//! What has no value, as any other reader sees it.
//!
//! # Design
//! The files are decoded here from their bytes and `zarr.json`, as Zarr v3 says and without a line of the program's own
//! store: an absent chunk is the fill value. What a reader then finds in `f` and `sigma` by themselves has to be right.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::command::{quick, run, text};

/// The numbers of an array as any reader of Zarr v3 gets them, row-major.
fn decoded(group: &Path, name: &str) -> Vec<f64> {
    let metadata: Value =
        serde_json::from_slice(&fs::read(group.join(name).join("zarr.json")).unwrap()).unwrap();
    let lengths = |pointer: &str| -> Vec<usize> {
        let lengths = metadata.pointer(pointer).unwrap().as_array().unwrap().iter();
        lengths.map(|length| length.as_u64().unwrap() as usize).collect()
    };
    let shape = lengths("/shape");
    let chunk = lengths("/chunk_grid/configuration/chunk_shape")[0];
    let row: usize = shape[1..].iter().product();
    let fill = match &metadata["fill_value"] {
        Value::String(word) if word == "NaN" => f64::NAN,
        number => number.as_f64().unwrap(),
    };
    let (size, number): (usize, fn(&[u8]) -> f64) = match metadata["data_type"].as_str().unwrap() {
        "uint8" => (1, |bytes| f64::from(bytes[0])),
        "float16" => (2, |bytes| half(u16::from_le_bytes(bytes.try_into().unwrap()))),
        "float32" => (4, |bytes| {
            f64::from(f32::from_le_bytes(bytes.try_into().unwrap()))
        }),
        "float64" => (8, |bytes| f64::from_le_bytes(bytes.try_into().unwrap())),
        other => panic!("{other}"),
    };
    let mut values = Vec::new();
    for index in 0..shape[0].div_ceil(chunk) {
        let key: Vec<String> = shape.iter().skip(1).map(|_| "0".to_owned()).collect();
        let file = format!("c.{}", [vec![index.to_string()], key].concat().join("."));
        match fs::read(group.join(name).join(file)) {
            // The checksum comes last.
            Ok(bytes) => {
                let bytes = plain(&metadata, &bytes[..bytes.len() - 4], chunk * row * size);
                assert_eq!(bytes.len(), chunk * row * size);
                values.extend(bytes.chunks_exact(size).map(number));
            }
            Err(_) => values.extend(std::iter::repeat_n(fill, chunk * row)),
        }
    }
    values.truncate(shape[0] * row);
    values
}

/// The bytes of a chunk without its checksum, of an array with this `metadata`; so many if all is well.
fn plain(metadata: &Value, bytes: &[u8], length: usize) -> Vec<u8> {
    let codecs = metadata["codecs"].as_array().unwrap().iter();
    let names: Vec<&str> = codecs.map(|codec| codec["name"].as_str().unwrap()).collect();
    match names[..] {
        ["bytes", "crc32c"] => bytes.to_vec(),
        ["bytes", "zstd", "crc32c"] => zstd::bulk::decompress(bytes, length).unwrap(),
        _ => panic!("{names:?}"),
    }
}

/// IEEE 754 binary16.
fn half(bits: u16) -> f64 {
    let sign = if bits >> 15 == 0 { 1.0 } else { -1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023) / 1024.0);
    match exponent {
        0 => sign * fraction * 2_f64.powi(-14),
        31 if fraction > 0.0 => f64::NAN,
        31 => sign * f64::INFINITY,
        _ => sign * (1.0 + fraction) * 2_f64.powi(exponent - 15),
    }
}

/// Mean of what is a number, as xarray's `mean` gives it, and how many there are.
fn mean(values: impl Iterator<Item = f64>) -> (f64, usize) {
    let numbers: Vec<f64> = values.filter(|value| !value.is_nan()).collect();
    (numbers.iter().sum::<f64>() / numbers.len() as f64, numbers.len())
}

/// Checks that what any reader finds in `f` and `sigma` by themselves is what was measured; returns the samples by the
/// code of their provenance.
fn has_nan_for_no_data(brdf: &Path) -> BTreeMap<u8, usize> {
    let (f, sigma, provenance) = (
        decoded(brdf, "f"),
        decoded(brdf, "sigma"),
        decoded(brdf, "provenance"),
    );
    let channels = f.len() / provenance.len();
    let mut counts = BTreeMap::new();
    for (sample, &code) in provenance.iter().enumerate() {
        *counts.entry(code as u8).or_default() += 1;
        for at in sample * channels..(sample + 1) * channels {
            let (f, sigma) = (f[at], sigma[at]);
            if code == 0.0 {
                assert!(f.is_nan() && sigma.is_nan(), "sample {sample}: {f} ± {sigma}");
            } else {
                assert!(
                    f.is_finite() && sigma > 0.0 && sigma.is_finite(),
                    "sample {sample}: {f} ± {sigma}"
                );
            }
        }
    }
    for values in [&f, &sigma] {
        let with_value = values
            .iter()
            .enumerate()
            .filter(|(at, _)| provenance[at / channels] != 0.0);
        assert_eq!(
            mean(values.iter().copied()),
            mean(with_value.map(|(_, value)| *value))
        );
    }
    // A cell that no pixel sees has no solid angle either.
    for (sr, reason) in decoded(brdf, "outgoing_pixel")
        .iter()
        .zip(decoded(brdf, "outgoing_reason"))
    {
        assert!(
            if reason == 0.0 { *sr > 0.0 } else { sr.is_nan() },
            "{sr} sr, reason {reason}"
        );
    }
    counts
}

#[test]
fn any_reader_finds_nan_where_there_is_no_value() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    // Saturated pixels, a hole, chunks that are absent; two exposures, of which one may saturate; another rig; noise.
    let cases: [(&str, &[&str]); 4] = [
        ("rcg-1-16bit", &["--exposure-ms", "60", "--noise", "on"]),
        ("rcg-1-16bit", &["--brackets", "4,60"]),
        ("rcg-2", &["--sample", "lambert:0"]),
        ("dmd", &["--noise", "on", "--sample", "ggx:metal"]),
    ];
    for (case, (rig, more)) in cases.into_iter().enumerate() {
        let out = at(&format!("m{case}"));
        let measure = [
            "measure",
            "--rig",
            rig,
            "--step",
            "15",
            "--image-size",
            "16",
            "--out",
            text(&out),
        ];
        run(&[&measure, more].concat(), "").done();
        let counts = has_nan_for_no_data(&out.join("brdf.zarr"));
        assert!(counts[&0] > 0 && counts.len() > 1, "{rig} {more:?}: {counts:?}");
    }
    // What was filled: everything above the horizon.
    let filled = at("filled.zarr");
    run(&["fill", text(&at("m0")), "--out", text(&filled)], "").done();
    let counts = has_nan_for_no_data(&filled);
    assert!(counts[&0] > 0 && counts[&5] > 0, "{counts:?}");
}

/// CRC-32C (Castagnoli), as it stands behind each chunk.
fn crc32c(bytes: &[u8]) -> [u8; 4] {
    let mut sum = u32::MAX;
    for byte in bytes {
        sum ^= u32::from(*byte);
        for _ in 0..8 {
            sum = (sum >> 1) ^ (0x82f6_3b78 & (sum & 1).wrapping_neg());
        }
    }
    (!sum).to_le_bytes()
}

/// Makes of a file what version 1 of the format would have: zeros where there is no value, and chunks that are not compressed.
fn as_version_1(brdf: &Path) {
    for (array, size) in [("f", 4), ("sigma", 2), ("provenance", 1), ("outgoing_pixel", 8)] {
        let header = brdf.join(array).join("zarr.json");
        let mut metadata: Value = serde_json::from_slice(&fs::read(&header).unwrap()).unwrap();
        for entry in fs::read_dir(brdf.join(array)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|extension| extension == "json") {
                continue;
            }
            let bytes = fs::read(&path).unwrap();
            let mut bytes = plain(&metadata, &bytes[..bytes.len() - 4], 1 << 24);
            for number in bytes.chunks_exact_mut(size) {
                let is_nan = match *number {
                    [_] => false,
                    [a, b] => half(u16::from_le_bytes([a, b])).is_nan(),
                    [a, b, c, d] => f32::from_le_bytes([a, b, c, d]).is_nan(),
                    _ => f64::from_le_bytes((&*number).try_into().unwrap()).is_nan(),
                };
                if is_nan {
                    number.fill(0);
                }
            }
            let sum = crc32c(&bytes);
            fs::write(&path, [&bytes[..], &sum].concat()).unwrap();
        }
        metadata["codecs"] = json!([
            { "name": "bytes", "configuration": { "endian": "little" } },
            { "name": "crc32c" }
        ]);
        if size == 1 {
            metadata["codecs"][0]
                .as_object_mut()
                .unwrap()
                .remove("configuration");
        }
        fs::write(&header, metadata.to_string()).unwrap();
    }
    let group = brdf.join("zarr.json");
    let mut metadata: Value = serde_json::from_slice(&fs::read(&group).unwrap()).unwrap();
    metadata["attributes"]["rcg_format_version"] = json!(1);
    // Files of then have no sum of what stands here.
    metadata["attributes"]
        .as_object_mut()
        .unwrap()
        .shift_remove("rcg_checksum");
    fs::write(&group, metadata.to_string()).unwrap();
}

#[test]
fn a_file_of_version_1_says_the_same() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    run(&quick(&out), "").done();
    let brdf = out.join("brdf.zarr");
    let lines: String = (0..400)
        .map(|k| {
            format!(
                "{} {} {} {}\n",
                (k * 7) % 90,
                k * 31 % 360,
                (k * 13) % 90,
                k * 17 % 360
            )
        })
        .collect::<Vec<_>>()
        .concat();
    let answers = || {
        let values = run(&["value", text(&brdf)], &lines).done().to_owned();
        let picture = scratch.path().join("sphere.png");
        run(
            &["render", text(&brdf), "--size", "64", "--out", text(&picture)],
            "",
        )
        .done();
        let evaluated = run(
            &["evaluate", text(&brdf), "--reference", "ward:brass", "--json"],
            "",
        );
        (values, fs::read(picture).unwrap(), evaluated.object())
    };
    let now = answers();
    assert!(now.0.contains("- hole") && now.0.contains("e-"));
    as_version_1(&brdf);
    assert!(decoded(&brdf, "f").contains(&0.0));
    assert!(answers() == now);
}
