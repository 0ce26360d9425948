//! Laws of the figures: none over nothing, and what a direct computation says over something.

mod direct;
mod stated;

use std::path::Path;

use half::f16;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::{Map, Value, json};

use super::*;
use crate::assemble::coordinates;
use crate::brdf::sample::{Outgoing, parse};
use crate::brdf::{BrdfError, KnownBrdf};
use crate::hemisphere::disk::Disk;
use crate::hemisphere::incident::Grid;
use crate::instrument::optics::Unmeasurable;
use crate::store::{BrdfLayout, BrdfRows, BrdfWriter};

const STEP_DEG: f64 = 22.5;
const SIZE: usize = 12;
const CHUNK: usize = 16;

/// One sample: f, σ and where it comes from; `None` is missing.
pub(crate) type One = Option<(Vec<f32>, f32, Provenance)>;

/// Writes what `of` says of each (incident direction, cell) and opens it. Chunks without a value are left out.
pub(crate) fn file(path: &Path, channels: usize, of: &mut dyn FnMut(usize, usize) -> One) -> Brdf {
    let grid = Grid::ThetaPhi { step_deg: STEP_DEG }.build().unwrap();
    let disk = Disk::new(SIZE);
    let layout = BrdfLayout {
        incident: grid.len(),
        grid: SIZE,
        channels,
        chunk: CHUNK,
    };
    let outgoing: Vec<Option<Unmeasurable>> = (0..disk.len())
        .map(|cell| {
            disk.direction(cell)
                .is_none()
                .then_some(Unmeasurable::BelowHorizon)
        })
        .collect();
    let pixel_sr: Vec<f64> = outgoing
        .iter()
        .map(|reason| if reason.is_none() { 1e-3 } else { f64::NAN })
        .collect();
    let attributes = [
        ("step_deg", json!(STEP_DEG)),
        ("incident_kind", json!("theta-phi")),
        ("spot_deg", json!(1.0)),
    ];
    let attributes: Map<String, Value> = attributes
        .map(|(name, value)| (name.to_owned(), value))
        .into_iter()
        .collect();
    let small = coordinates(&grid, &vec![None; grid.len()], disk, &outgoing, &pixel_sr);
    let writer = BrdfWriter::create(path, layout, &small, attributes, true).unwrap();
    for (chunk, first) in (0..grid.len()).step_by(CHUNK).enumerate() {
        let mut rows = BrdfRows::default();
        for index in first..(first + CHUNK).min(grid.len()) {
            for (cell, reason) in outgoing.iter().enumerate() {
                let one = if reason.is_none() { of(index, cell) } else { None };
                let (f, sigma, origin) =
                    one.unwrap_or((vec![f32::NAN; channels], f32::NAN, Provenance::Missing));
                rows.f.extend(&f);
                rows.sigma.extend(vec![f16::from_f32(sigma); channels]);
                rows.provenance.push(origin.code());
            }
        }
        if rows.provenance.iter().any(|code| *code != 0) {
            writer.write_chunk(chunk, &rows).unwrap();
        }
    }
    writer.finish().unwrap();
    Brdf::open(path).unwrap()
}

fn figures(brdf: &Brdf, reference: &dyn Sample) -> (Value, String) {
    let found = evaluate(brdf, Some(("it", reference)), &|_| {}).unwrap();
    let lines = crate::measure::report::evaluation_lines(&found);
    let text = lines
        .iter()
        .map(|(what, figure)| format!("{what} {figure}\n"))
        .collect::<Vec<_>>()
        .concat();
    (serde_json::to_value(&found).unwrap(), text)
}

/// Figures of the measurement itself, and of the comparison.
const OWN: [&str; 2] = ["/median_relative_sigma", "/reciprocity_residual_median"];
const COMPARED: [&str; 5] = [
    "/against_reference/relative_error/median",
    "/against_reference/relative_error/p90",
    "/against_reference/relative_error/p99",
    "/against_reference/psnr_db",
    "/against_reference/reciprocity_residual_median",
];

fn none(found: &Value, fields: &[&str]) {
    for field in fields {
        assert_eq!(found.pointer(field), Some(&Value::Null), "{field}: {found:#}");
    }
    assert!(!found["warnings"].as_array().unwrap().is_empty(), "{found:#}");
}

#[test]
fn figures_over_nothing_are_none() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let white = parse("lambert:0.5").unwrap();
    for channels in [1, 3] {
        // Nothing measured at all.
        let empty = file(&at("empty"), channels, &mut |_, _| None);
        let (found, text) = figures(&empty, white.as_ref());
        none(&found, &OWN);
        none(&found, &COMPARED);
        assert_eq!(found["coverage"], json!(0.0));
        assert_eq!(found["against_reference"]["scored_share"], json!(0.0));
        for albedo in found["albedo"].as_array().unwrap() {
            assert_eq!(
                (&albedo["albedo"], &albedo["measured_part"]),
                (&Value::Null, &Value::Null)
            );
        }
        for figure in [
            "noise median standard uncertainty none",
            "residual none",
            "albedo none",
            "PSNR none",
        ] {
            assert!(text.contains(figure), "{figure} in {text}");
        }
    }
}

#[test]
fn figures_over_no_evidence_are_none() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let white = parse("lambert:0.5").unwrap();
    // A single sample, and one that was filled in by whatever way: none of them is evidence.
    let middle = Disk::new(SIZE)
        .neighbours(crate::hemisphere::direction::from_degrees(30.0, 40.0))
        .unwrap()[0]
        .0;
    let one = file(&at("one"), 1, &mut |index, cell| {
        (index == 20 && cell == middle).then(|| (vec![0.15], 0.01, Provenance::Measured))
    });
    let (found, _) = figures(&one, white.as_ref());
    none(&found, &OWN);
    none(&found, &["/against_reference/relative_error/median"]);
    assert!(found["coverage"].as_f64().unwrap() > 0.0 && found["measured_samples"] == json!(1));
    for origin in Provenance::ALL
        .into_iter()
        .filter(|origin| !origin.is_seen())
        .skip(1)
    {
        let filled = file(&at("filled"), 3, &mut |_, _| Some((vec![0.15; 3], 0.01, origin)));
        let (found, _) = figures(&filled, white.as_ref());
        none(&found, &OWN);
        none(&found, &COMPARED);
        assert!(
            found["coverage"].as_f64().unwrap() > 0.999,
            "it is there all the same"
        );
        let of = found["provenance"].as_array().unwrap();
        let of = of.iter().find(|of| of["provenance"] == origin.name()).unwrap();
        assert!(
            of["relative_error"]["median"].as_f64().is_some(),
            "judged by itself: {of}"
        );
    }
}

#[test]
fn figures_against_references_without_light_are_none() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    // References that are black, or have no value where something was measured.
    let whole = file(&at("whole"), 3, &mut |_, _| {
        Some((vec![0.15; 3], 0.01, Provenance::Measured))
    });
    let black = parse("lambert:0").unwrap();
    let holes = KnownBrdf::read(&file(&at("holes"), 3, &mut |_, _| None)).unwrap();
    for (reference, compared) in [(black.as_ref(), true), (&holes as &dyn Sample, false)] {
        let (found, text) = figures(&whole, reference);
        none(&found, &COMPARED);
        none(
            &found,
            &["/against_reference/blur/median", "/against_reference/blur/p99"],
        );
        assert!(found["median_relative_sigma"].as_f64().is_some());
        assert_eq!(
            found["against_reference"]["samples"].as_u64().unwrap() > 0,
            compared
        );
        assert!(
            text.contains("error median none, 90 % below: none, too few"),
            "{text}"
        );
    }
    // No difference is exact, not a number of decibels.
    let (found, text) = figures(&whole, &Same);
    assert_eq!(found["against_reference"]["psnr_db"], Value::Null);
    assert_eq!(found["against_reference"]["is_exact"], json!(true));
    assert!(text.contains("PSNR exact"), "{text}");
}

/// What the files without gaps hold, to the last bit.
#[derive(Debug)]
struct Same;

impl Sample for Same {
    fn incident(&self, _wi: DVec3) -> Box<dyn Outgoing + '_> {
        Box::new(Self)
    }

    fn is_isotropic(&self) -> bool {
        true
    }
}

impl Outgoing for Same {
    fn f(&self, _wo: DVec3) -> [f64; 3] {
        [f64::from(0.15_f32); 3]
    }
}

#[test]
fn an_albedo_is_that_of_a_whole_hemisphere() {
    let scratch = tempfile::tempdir().unwrap();
    let f = 0.5 / std::f64::consts::PI;
    for (kept, is_whole) in [(1.0, true), (0.999, true), (0.9, false)] {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
        let brdf = file(&scratch.path().join("m"), 1, &mut |_, _| {
            (rng.random_range(0.0..1.0) < kept).then(|| (vec![f as f32], 0.01, Provenance::Measured))
        });
        let found = evaluate(&brdf, None, &|_| {}).unwrap();
        for albedo in &found.albedo {
            assert_eq!(albedo.albedo.is_some(), is_whole, "{albedo:?}");
            assert_eq!(albedo.standard_uncertainty.is_some(), is_whole);
            assert!(
                (albedo.seen - kept).abs() < 0.02 && albedo.filled.abs() < 1e-12,
                "{albedo:?}"
            );
            // 12 cells a side are a coarse hemisphere.
            assert!(
                (albedo.measured_part.unwrap() / albedo.seen - 0.5).abs() < 0.02,
                "{albedo:?}"
            );
        }
        assert_eq!(found.warnings.is_empty(), is_whole, "{:?}", found.warnings);
    }
}

#[test]
fn no_capture_is_evidence_twice() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let capture = |name: &str, seed: u64| {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        file(&at(name), 1, &mut |_, _| {
            Some((vec![rng.random_range(0.15..0.17)], 0.006, Provenance::Measured))
        })
    };
    let (a, copy, b) = (capture("a", 1), capture("copy", 1), capture("b", 2));
    let link = at("link");
    std::os::unix::fs::symlink(at("a"), &link).unwrap();
    for same in [&a, &copy, &Brdf::open(&link).unwrap()] {
        let error = repeatability(&a, same).unwrap_err();
        assert!(
            matches!(
                error,
                BrdfError::Content {
                    field: "captures",
                    ..
                }
            ),
            "{error}"
        );
        assert!(KnownBrdf::beside(same, &a).is_err());
    }
    // 0.16 ± 0.0058 (uniform over 0.02), twice.
    let found = repeatability(&a, &b).unwrap();
    let deviation = found.relative_standard_deviation.unwrap();
    assert!((0.02..0.06).contains(&deviation), "{found:?}");
    assert!(found.relative_bias.unwrap().abs() < 0.01, "{found:?}");
    // One that is brighter scatters no more for that.
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
    let brighter = file(&at("brighter"), 1, &mut |_, _| {
        Some((
            vec![1.1 * rng.random_range(0.15..0.17)],
            0.006,
            Provenance::Measured,
        ))
    });
    let apart = repeatability(&a, &brighter).unwrap();
    assert!(
        (apart.relative_bias.unwrap() / (0.1 / 1.05) - 1.0).abs() < 0.1,
        "{apart:?}"
    );
    let ratio = apart.relative_standard_deviation.unwrap() / deviation;
    assert!((0.8..1.2).contains(&ratio), "{apart:?}");
    let normalised = found.normalised_difference.unwrap();
    assert!((0.9..1.02).contains(&normalised), "{found:?}");
    assert!((found.share.unwrap() - 1.0).abs() < 1e-12 && found.warnings.is_empty());
    // What is filled in is no second measurement.
    let filled = file(&at("filled"), 1, &mut |_, _| {
        Some((vec![0.16], 0.01, Provenance::Reciprocal))
    });
    let found = repeatability(&a, &filled).unwrap();
    let json = serde_json::to_value(&found).unwrap();
    assert_eq!(
        (found.samples, &json["relative_standard_deviation"]),
        (0, &Value::Null)
    );
    assert_eq!(
        (&json["normalised_difference"], found.warnings.len()),
        (&Value::Null, 1)
    );
}
