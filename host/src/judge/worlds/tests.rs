//! A file that holds the truth is right, one that does not is silent, for just the rule that it breaks; draws follow from
//! their seed.

use std::path::Path;

use half::f16;
use serde_json::{Map, Value, json};

use super::*;
use crate::assemble::coordinates;
use crate::brdf::Brdf;
use crate::brdf::sample::parse;
use crate::hemisphere::direction::from_degrees;
use crate::hemisphere::disk::Disk;
use crate::hemisphere::incident::Grid;
use crate::instrument::optics::Unmeasurable;
use crate::instrument::rig::PRESETS;
use crate::store::provenance::Provenance;
use crate::store::{BrdfLayout, BrdfRows, BrdfWriter};

const STEP_DEG: f64 = 22.5;
const SIZE: usize = 12;
const SAMPLE: &str = "ggx:plastic";
/// Relative standard uncertainty of every sample, and of all together.
const SIGMA: f64 = 0.01;
const COMMON: f64 = 0.004;

/// f, σ and provenance in place of the truth at (incident direction, cell).
type Edit<'a> = &'a dyn Fn(usize, usize, f64) -> (f64, f64, Provenance);

/// A file of [`SAMPLE`] with `edit` of the truth, and how it is judged.
fn judged(path: &Path, edit: Edit<'_>) -> Judgement {
    let grid = Grid::ThetaPhi { step_deg: STEP_DEG }.build().unwrap();
    let disk = Disk::new(SIZE);
    let layout = BrdfLayout {
        incident: grid.len(),
        grid: SIZE,
        channels: 1,
        chunk: 16,
    };
    let outgoing: Vec<Option<Unmeasurable>> = (0..disk.len())
        .map(|cell| {
            let direction = disk.direction(cell);
            direction.is_none().then_some(Unmeasurable::BelowHorizon)
        })
        .collect();
    let seen = |reason: &Option<Unmeasurable>| if reason.is_none() { 1e-3 } else { f64::NAN };
    let pixel_sr: Vec<f64> = outgoing.iter().map(seen).collect();
    let attributes: Map<String, Value> = [
        ("step_deg", json!(STEP_DEG)),
        ("incident_kind", json!("theta-phi")),
        ("spot_deg", json!(1.0)),
        ("common_uncertainty", json!(COMMON)),
    ]
    .map(|(name, value)| (name.to_owned(), value))
    .into_iter()
    .collect();
    let small = coordinates(&grid, &vec![None; grid.len()], disk, &outgoing, &pixel_sr);
    let writer = BrdfWriter::create(path, layout, &small, attributes, true).unwrap();
    let sample = parse(SAMPLE).unwrap();
    for (chunk, first) in (0..grid.len()).step_by(layout.chunk).enumerate() {
        let last = (first + layout.chunk).min(grid.len());
        let mut rows = BrdfRows::missing((last - first) * disk.len(), 1);
        for index in first..last {
            for cell in 0..disk.len() {
                let Some(wo) = disk.direction(cell) else { continue };
                let truth = sample.f(grid.direction(index), wo)[0];
                let (f, sigma, origin) = edit(index, cell, truth);
                let at = (index - first) * disk.len() + cell;
                rows.f[at] = f as f32;
                rows.sigma[at] = f16::from_f64(sigma);
                rows.provenance[at] = origin.code();
            }
        }
        writer.write_chunk(chunk, &rows).unwrap();
    }
    writer.finish().unwrap();
    judge(&Brdf::open(path).unwrap(), sample.as_ref()).unwrap()
}

/// A pair of directions that is judged.
fn somewhere() -> (usize, usize) {
    let grid = Grid::ThetaPhi { step_deg: STEP_DEG }.build().unwrap();
    let disk = Disk::new(SIZE);
    let wo = from_degrees(40.0, 100.0);
    let near = |cell: &usize| disk.direction(*cell).map_or(-1.0, |other| other.dot(wo));
    let cell = (0..disk.len())
        .max_by(|a, b| near(a).total_cmp(&near(b)))
        .unwrap();
    (grid.len() / 2, cell)
}

#[test]
fn what_holds_the_truth_is_right_and_is_silent_only_with_what_a_rule_forbids() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.zarr");
    let (row, cell) = somewhere();
    let with_z = |z: f64, cells: usize, origin: Provenance| {
        judged(&path, &|index, at, truth| {
            let is_changed = index == row && (cell..cell + cells).contains(&at);
            let f = if is_changed {
                truth * (1.0 + SIGMA * z)
            } else {
                truth
            };
            let origin = if is_changed { origin } else { Provenance::Measured };
            (f, SIGMA * truth, origin)
        })
    };
    let right = with_z(0.0, 0, Provenance::Measured);
    assert_eq!(right.wrong, Vec::<String>::new());
    assert_eq!(right.measured.coverage(), Some(1.0));
    assert!(right.measured.samples > 1000, "{right:?}");
    assert!(right.median_error.unwrap() < 1e-6, "{right:?}");
    assert!(
        (right.median_sigma.unwrap() / SIGMA - 1.0).abs() < 0.01,
        "{right:?}"
    );
    assert!(right.scored_share.unwrap() > 0.99, "{right:?}");

    let one = with_z(11.0, 1, Provenance::Merged);
    assert_eq!(one.wrong.len(), 1, "{one:?}");
    assert!(one.wrong[0].contains("beyond 10 σ, found 1 of"), "{one:?}");
    let worst = one.worst[0];
    assert!((worst.z - 11.0).abs() < 0.1, "{worst:?}");
    assert!(one.worst[1].z.abs() < 0.1, "{one:?}");
    let grid = Grid::ThetaPhi { step_deg: STEP_DEG }.build().unwrap();
    let (theta, phi) = grid.angles_deg(row);
    assert!((worst.directions_deg[0] - theta).abs() + (worst.directions_deg[1] - phi).abs() < 1e-9);
    assert!((worst.f / worst.truth - 1.11).abs() < 1e-5, "{worst:?}");

    // One beyond 6 σ may be, two of some thousand may not; what was filled in is counted apart.
    assert_eq!(with_z(-7.0, 1, Provenance::Measured).wrong, Vec::<String>::new());
    let two = with_z(-7.0, 2, Provenance::Measured);
    assert_eq!(two.measured.beyond_6, 2);
    assert!(two.wrong[0].contains("beyond 6 σ, found 2 of"), "{two:?}");
    let filled = with_z(20.0, 2, Provenance::Modelled);
    assert_eq!(filled.wrong, Vec::<String>::new());
    let modelled = filled.filled_in["modelled"];
    assert_eq!((modelled.samples, modelled.beyond_10), (2, 2));
}

#[test]
fn a_common_factor_may_be_as_wrong_as_it_is_stated_to_be() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.zarr");
    let by = |factor: f64, spread: f64| {
        judged(&path, &|index, _, truth| {
            // Each incident direction off by itself.
            let sign = if index % 2 == 0 { 1.0 } else { -1.0 };
            (
                truth * (factor + spread * sign),
                SIGMA * truth,
                Provenance::Measured,
            )
        })
    };
    for sign in [-1.0, 1.0] {
        let right = by(1.0 + sign * 3.0 * COMMON, 0.0);
        assert_eq!(right.wrong, Vec::<String>::new(), "{right:?}");
        let wrong = by(1.0 + sign * 4.0 * COMMON, 0.0);
        assert_eq!(wrong.wrong.len(), 1, "{wrong:?}");
        assert!(wrong.wrong[0].contains("common factor"), "{wrong:?}");
        let scale = wrong.scale.unwrap();
        assert!(
            (scale.value - 1.0 - sign * 4.0 * COMMON).abs() < 1e-5,
            "{scale:?}"
        );
    }
    // Rows that are off together make the factor less certain than as many samples that are off by chance.
    let (even, uneven) = (by(1.0, 0.0).scale.unwrap(), by(1.0, 0.01).scale.unwrap());
    assert!(
        uneven.standard_uncertainty > 3.0 * even.standard_uncertainty,
        "{even:?} {uneven:?}"
    );
    // A lobe that is flattened as its σ states is no factor of all.
    let flattened = judged(&path, &|_, _, truth| {
        let f = if truth > 0.2 { 0.9 * truth } else { truth };
        (f, 0.1 * truth, Provenance::Measured)
    });
    assert!(flattened.measured.coverage() == Some(1.0) && flattened.wrong.is_empty());
    assert!(flattened.median_error.unwrap() < 1e-6 && flattened.worst[0].z < -0.9);
    assert!(
        (flattened.scale.unwrap().value - 1.0).abs() < 1e-5,
        "{flattened:?}"
    );
    // Whose σ is found from a value that noise makes too small is not believed more than others.
    let noisy = judged(&path, &|index, cell, truth| {
        let f = truth * if (index + cell) % 2 == 0 { 0.7 } else { 1.3 };
        (f, 0.3 * f, Provenance::Measured)
    });
    assert_eq!(noisy.wrong, Vec::<String>::new(), "{noisy:?}");
    assert!((noisy.scale.unwrap().value - 1.0).abs() < 0.02, "{noisy:?}");
}

#[test]
fn what_samples_have_for_themselves_has_to_be_stated_beside_the_common_factor() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.zarr");
    // All off by the common factor, which hides in σ, and by as much as it each by itself, which does not.
    let by = |own: f64, sigma: f64| {
        judged(&path, &|index, cell, truth| {
            let sign = if (index + cell) % 2 == 0 { 1.0 } else { -1.0 };
            let f = truth * (1.0 + 1.9 * COMMON + own * sign);
            (f, sigma * truth, Provenance::Measured)
        })
    };
    let right = by(0.5 * SIGMA, SIGMA.hypot(COMMON));
    assert_eq!(right.wrong, Vec::<String>::new(), "{right:?}");
    assert_eq!(right.own_coverage, Some(1.0));
    let wrong = by(3.0 * 0.3 * COMMON, COMMON.hypot(0.3 * COMMON));
    assert!(wrong.own_coverage.unwrap() < 0.1, "{wrong:?}");
    assert!(
        wrong
            .wrong
            .iter()
            .any(|sentence| sentence.contains("of their own")),
        "{wrong:?}"
    );
}

#[test]
fn a_world_follows_from_its_seed_and_number_however_many_are_drawn() {
    let draw = |seed, index, kind| DrawnRig::draw(seed, index, &PRESETS, kind);
    let rigs: Vec<DrawnRig> = (0..200).map(|index| draw(5, index, Kind::Any)).collect();
    assert_eq!(rigs[17], draw(5, 17, Kind::Any));
    assert_ne!(rigs[17].seed, draw(6, 17, Kind::Any).seed);
    assert_eq!(rigs[3].request(2), draw(5, 3, Kind::Any).request(2));
    assert_ne!(rigs[3].request(2).seed, rigs[3].request(1).seed);
    let value = |rig: &DrawnRig, option: &str| -> f64 {
        let of = rig.flaws.iter().find(|(name, _)| name == option).unwrap();
        of.1.parse().unwrap()
    };
    // The whole range, in the same draw of a group.
    for (option, low, high) in [
        ("--position-mm", 0.1, 3.0),
        ("--angle-deg", 0.05, 2.0),
        ("--field-percent", 5.0, 30.0),
        ("--contrast", 400.0, 3000.0),
    ] {
        let values = rigs.iter().map(|rig| value(rig, option));
        let (least, most) = values.fold((f64::INFINITY, 0.0_f64), |(least, most), value| {
            (least.min(value), most.max(value))
        });
        assert!((low..1.1 * low).contains(&least), "{option}: {least}");
        assert!((0.9 * high..=high).contains(&most), "{option}: {most}");
    }
    // Who mounts well turns well too.
    for rig in &rigs {
        let badness = |option, good: f64, bad: f64| (value(rig, option) / good).ln() / (bad / good).ln();
        let both = badness("--position-mm", 0.1, 3.0) - badness("--angle-deg", 0.05, 2.0);
        assert!(both.abs() < 0.01, "{rig:?}");
    }
    for index in 0..100 {
        let careful = draw(5, index, Kind::Careful);
        assert!(value(&careful, "--position-mm") <= 1.0 && value(&careful, "--angle-deg") <= 0.5);
        assert!(value(&careful, "--contrast") >= 1000.0);
        let bad = draw(5, index, Kind::Bad);
        assert_eq!(bad.flaws[0].1, "3");
        assert_eq!(bad.flaws[3].1, "400");
        // What kind it is changes no other draw.
        assert_eq!((careful.seed, &careful.preset), (bad.seed, &bad.preset));
    }
}

#[test]
fn every_drawn_sample_and_tilt_can_be_read_and_a_tilt_is_one_of_the_calibration() {
    let mut tilted = 0;
    for index in 0..100 {
        let rig = DrawnRig::draw(1, index, &PRESETS, Kind::Any);
        for request in (0..3).map(|request| rig.request(request)) {
            parse(&request.sample).unwrap();
            for tilt in request.captures.iter().flatten() {
                tilted += 1;
                assert!(rig.tilts.contains(tilt));
                tilt.parse::<crate::instrument::rig::Tilt>().unwrap();
            }
        }
    }
    assert!(tilted > 30, "{tilted}");
}

#[test]
fn a_summary_counts_every_world_once_and_joins_like_causes() {
    let rig = DrawnRig::draw(1, 0, &["dmd"], Kind::Any);
    let world = |outcome: Outcome| World {
        version: "1".to_owned(),
        sizes: Sizes {
            image_px: 48,
            geometry_px: 96,
            photometry_px: 64,
            step_deg: 15.0,
        },
        rig: rig.clone(),
        request: rig.request(0),
        outcome,
        files: Vec::new(),
        elapsed_s: 1.0,
    };
    let refused = |found: &str| Outcome::Refused {
        command: "measure".to_owned(),
        sentence: format!("light: expected 3.5 mW, found {found}"),
    };
    let wrong = vec!["x".to_owned()];
    let worlds = [
        Outcome::Right,
        refused("1.25"),
        refused("17"),
        Outcome::Silent { wrong },
    ]
    .map(world);
    let summary = Summary::of(&worlds);
    let all = summary.presets.last().unwrap();
    assert_eq!((all.worlds, all.right, all.refused, all.silent), (4, 1, 2, 1));
    assert_eq!(summary.presets[0].preset, "dmd");
    assert_eq!(summary.faults(), 1);
    assert_eq!(summary.causes.len(), 1, "{summary:?}");
    assert_eq!(summary.causes[0].sentence, "light: expected # mW, found #");
    // It reads back as it was written.
    let text = serde_json::to_string(&worlds[1]).unwrap();
    assert_eq!(serde_json::from_str::<World>(&text).unwrap(), worlds[1]);
}
