//! The stated standard uncertainty holds the truth as often as it says, on rigs that differ from what calibration found.

use std::path::Path;

use rcg::base::progress::Silent;
use rcg::brdf::Brdf;
use rcg::calibrate::{geometry, photometry};
use rcg::capture::directory::Measurement;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::calibration::Calibration;
use rcg::instrument::rig::{Panel, Rig};
use rcg::judge::evaluate::evaluate;
use rcg::judge::fit::{Fit, Model};
use rcg::judge::worlds::judge;
use rcg::measure::{assemble_measurement, capture, prepare};
use rcg::plan::brackets::Brackets;
use rcg::plan::{Request, Virtual};
use rcg::virtual_rig::setup::Setup;
use rcg::virtual_rig::{PixelTolerances, Tolerances, Truth};
use rcg_tests::is_full;
use rcg_tests::measurements::{Scored, coarse, scored};

const TOLERANCES: Tolerances = Tolerances {
    position_m: 5e-4,
    angle_deg: 0.3,
    field: 0.3,
    standard: 0.0,
    ..Tolerances::DRAWN
};
/// A tilt at which a part of the sample is seen beyond the rim of what the untilted one shows.
const TILT: &str = "51:84:40";
/// Relative standard uncertainty of the standard.
const STANDARD: f64 = 0.0025;

fn save(truth: &Truth, path: &Path) -> String {
    std::fs::write(path, truth.to_toml()).unwrap();
    path.display().to_string()
}

/// Calibrates the rig that `truth` describes, of which `nominal` is known, in `dir`; the standard is seen at `tilts` too.
fn calibrated(nominal: &Rig, truth: &str, tilts: &[&str], dir: &Path) -> Calibration {
    let request = geometry::Request {
        rig: nominal.clone(),
        tilts: vec![[0.0, 0.0], [15.0, 0.0], [15.0, 120.0], [15.0, 240.0]],
        image_size: 64,
        tilt_uncertainty_deg: 0.05,
    };
    let world = |seed| {
        let setup = Setup::from(Virtual {
            truth: Some(truth.to_owned()),
            seed,
            ..Virtual::default()
        });
        setup.world().unwrap()
    };
    geometry::capture(&request, dir, &world(1), &Silent).unwrap();
    geometry::calibrate(dir, &geometry::Said::default()).unwrap();
    let request = photometry::Request {
        standard: "lambert:0.98".to_owned(),
        second_standard: Some("lambert:0.2".to_owned()),
        tilts: tilts.iter().map(|tilt| tilt.parse().unwrap()).collect(),
        exposure_s: None,
        image_size: 48,
    };
    photometry::capture(&request, dir, &world(2), &Silent).unwrap();
    photometry::calibrate(
        dir,
        &photometry::Said::default(),
        &photometry::Trust::assumed(STANDARD),
    )
    .unwrap();
    Calibration::open(dir, nominal).unwrap()
}

fn holding(sample: &str, truth: &str, seed: u64) -> Virtual {
    Virtual {
        sample: sample.to_owned(),
        truth: Some(truth.to_owned()),
        seed,
        ..Virtual::default()
    }
}

fn measured(
    dir: &Path,
    calibration: Option<&Calibration>,
    rig: &Rig,
    request: Request,
    virtual_rig: Virtual,
) -> Measurement {
    let setup = Setup {
        calibration: calibration.cloned(),
        ..Setup::from(virtual_rig)
    };
    let rig = calibration.map_or(rig, |calibration| &calibration.rig);
    let (job, measurement) = prepare(dir, rig, request, &setup, &Silent).unwrap();
    capture(&measurement, &job, &Silent).unwrap();
    assemble_measurement(&measurement, &Silent).unwrap();
    measurement
}

#[test]
#[ignore = "long: ./test.sh full runs it"]
fn calibration_brings_a_misaligned_and_uneven_rig_back() {
    let nominal = Rig::load("rcg-1-16bit").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let truth = Truth::drawn(&nominal, TOLERANCES, 5).unwrap();
    let truth = save(&truth, &folder.path().join("truth.toml"));
    let calibration = calibrated(&nominal, &truth, &[TILT], &folder.path().join("calibration"));
    let error = |name: &str, calibration: Option<&Calibration>, tilt: Option<&str>| {
        let spec = "ggx:f0=0.4,ax=0.4,ay=0.5,rd=0.2";
        let request = Request {
            grid: Grid::ThetaPhi { step_deg: 10.0 },
            image_size: 48,
            brackets: Brackets::Number(3),
            tilt: tilt.map(|tilt| tilt.parse().unwrap()),
            ..Request::default()
        };
        let dir = folder.path().join(name);
        let measurement = measured(&dir, calibration, &nominal, request, holding(spec, &truth, 3));
        let brdf = Brdf::open(&measurement.path("brdf.zarr")).unwrap();
        let sample = rcg::brdf::sample::parse(spec).unwrap();
        let found = evaluate(&brdf, Some((spec, sample.as_ref())), &|_| {}).unwrap();
        let error = found.against_reference.unwrap().relative_error;
        (error.median.value().unwrap(), error.p99.value().unwrap())
    };
    let (with, without) = (
        error("with", Some(&calibration), None),
        error("without", None, None),
    );
    // The same calibration, seen in parts of the images where only the tilted standard was.
    let tilted = error("tilted", Some(&calibration), Some(TILT));
    println!("error (median, 99 %) {without:?} without calibration, {with:?} with it, {tilted:?} tilted");
    assert!(without.0 > 0.05, "{without:?}");
    for with in [with, tilted] {
        assert!(with.0 < 0.01 && with.1 < 0.05, "{with:?}");
    }

    // A calibration of another rig is told by its hash.
    let other = Rig::load("rcg-2").unwrap();
    let refused = Calibration::open(&folder.path().join("calibration"), &other)
        .unwrap_err()
        .to_string();
    assert!(
        refused.contains("expected a calibration of rig rcg-2, found one of another rig"),
        "{refused}"
    );
}

// `rcg worlds` draws more of them in every run; fits and tilts come on top here.
#[test]
#[ignore = "long: ./test.sh full runs it"]
fn in_drawn_worlds_values_and_fits_hold_the_truth_tilted_or_not() {
    for draw in 0..3 {
        let uniform = |purpose: u64| uniform(2000 + 10 * draw + purpose);
        let folder = tempfile::tempdir().unwrap();
        let nominal = coarse(["rcg-1-16bit", "dmd", "rcg-2"][draw as usize]);
        let tolerances = Tolerances {
            position_m: 1e-3,
            angle_deg: 0.6,
            field: 0.6 * uniform(0),
            standard: 0.0,
            ..Tolerances::DRAWN
        };
        let truth = Truth::drawn(&nominal, tolerances, draw).unwrap();
        let truth = save(&truth, &folder.path().join("truth.toml"));
        let calibration = calibrated(&nominal, &truth, &[TILT], &folder.path().join("calibration"));
        let between = |low: f64, high: f64, purpose: u64| low + (high - low) * uniform(purpose);
        let is_ward = draw % 2 == 1;
        // The lobes are narrow enough to show where the sample's axes are, and it lies turned.
        let known = [
            ("ax", between(0.12, 0.25, 1)),
            ("ay", between(0.25, 0.5, 2)),
            ("rd", between(0.1, 0.4, 3)),
            (if is_ward { "rs" } else { "f0" }, between(0.1, 0.4, 4)),
        ];
        let numbers = known.map(|(name, value)| format!("{name}={value}")).join(",");
        let azimuth_deg = between(-40.0, 40.0, 6);
        let spec = format!("{}:{numbers}@{azimuth_deg}", if is_ward { "ward" } else { "ggx" });
        let request = Request {
            grid: Grid::ThetaPhi { step_deg: 15.0 },
            image_size: 24 + (24.0 * uniform(5)) as u32,
            tilt: (draw != 2).then(|| TILT.parse().unwrap()),
            ..Request::default()
        };
        let virtual_rig = Virtual {
            noise: draw % 2 == 0,
            ..holding(&spec, &truth, draw)
        };
        let dir = folder.path().join("m");
        let measurement = measured(&dir, Some(&calibration), &nominal, request, virtual_rig);
        let brdf = Brdf::open(&measurement.path("brdf.zarr")).unwrap();
        let (found, share, worst) = judged(&brdf, &spec);
        let model = if is_ward { Model::Ward } else { Model::Ggx };
        let fit = Fit::of_brdf(model, &brdf).unwrap();
        let scores = fit.parameters.iter().map(|parameter| {
            let truth = known
                .iter()
                .find(|known| parameter.name.starts_with(known.0))
                .map_or(azimuth_deg, |known| known.1);
            (parameter.value - truth) / parameter.standard_uncertainty.unwrap()
        });
        let scores: Vec<f64> = scores.collect();
        println!(
            "{} {spec}: {share:.3} of {} within k = 2, worst {worst:.1}; fit {scores:.1?}",
            nominal.name,
            found.len()
        );
        assert!(fit.acceptable, "{:?}", fit.warnings);
        assert_eq!(scores.len(), if brdf.channels() == 1 { 5 } else { 9 });
        assert!(
            found.len() > 10_000 && share > 0.93 && worst < 7.0,
            "{share} {worst}"
        );
        assert!(scores.iter().all(|score| score.abs() < 3.5), "{scores:?}");
    }
}

#[test]
fn blur_is_a_part_of_the_uncertainty_for_lobes_and_pixels_of_any_width() {
    let folder = tempfile::tempdir().unwrap();
    let mut all = Vec::new();
    for draw in 0..24_u64 {
        let uniform = |purpose: u64| uniform(1000 + 10 * draw + purpose);
        let alpha = |purpose: u64| 0.05 * 14_f64.powf(uniform(purpose));
        let preset = ["rcg-1-16bit", "rcg-2", "dmd"][draw as usize % 3];
        let image_size = 20 + (44.0 * uniform(0)) as u32;
        let model = ["ward:rs=0.3,rd=0.2", "ggx:f0=0.5,rd=0.2"][draw as usize % 2];
        let spec = format!("{model},ax={:.3},ay={:.3}", alpha(1), alpha(2));
        let directions_deg = (0..6)
            .map(|i| [12.0 * f64::from(i) + 15.0 + 8.0 * uniform(3), 73.0 * f64::from(i)])
            .collect();
        let request = Request {
            grid: Grid::List { directions_deg },
            image_size,
            brackets: Brackets::Number(3),
            ..Request::default()
        };
        let virtual_rig = Virtual {
            truth: None,
            ..holding(&spec, "", draw)
        };
        let dir = folder.path().join(draw.to_string());
        let measurement = measured(&dir, None, &coarse(preset), request, virtual_rig);
        let brdf = Brdf::open(&measurement.path("brdf.zarr")).unwrap();
        let (found, share, worst) = judged(&brdf, &spec);
        println!(
            "{preset} {image_size} px {spec}: {share:.3} of {} within k = 2, worst {worst:.1}",
            found.len()
        );
        assert!(
            found.len() > 300 && share > 0.9,
            "{preset} {image_size} px {spec}: {share}"
        );
        all.extend(found);
    }
    let beyond =
        |limit: f64| all.iter().filter(|score| score.abs() > limit).count() as f64 / all.len() as f64;
    println!(
        "{:.4} of {} within k = 2, {:.1e} beyond 6 σ",
        within(&all),
        all.len(),
        beyond(6.0)
    );
    assert!((0.94..0.99).contains(&within(&all)), "{}", within(&all));
    assert!(beyond(6.0) < 1e-4, "{}", beyond(6.0));
}

/// The scores of all values of `brdf` against the sample `spec`, the share of them within k = 2, and the farthest.
fn judged(brdf: &Brdf, spec: &str) -> (Vec<f64>, f64, f64) {
    let sample = rcg::brdf::sample::parse(spec).unwrap();
    let scores: Vec<f64> = scored(brdf, sample.as_ref())
        .iter()
        .map(|one| one.score)
        .collect();
    let worst = scores.iter().fold(0.0_f64, |worst, score| worst.max(score.abs()));
    let share = within(&scores);
    (scores, share, worst)
}

/// Share of `scores` within k = 2.
fn within(scores: &[f64]) -> f64 {
    scores.iter().filter(|score| score.abs() <= 2.0).count() as f64 / scores.len() as f64
}

/// The `calibration`, off in the light by what the standard's reflectance and the `lamp` (relative) leave uncertain, in what
/// returns onto the sample, each times its draw, and in what part of the sample is seen and lit, times `seen`.
fn off(
    calibration: &Calibration,
    lamp: f64,
    [standard, lamp_draw, back]: [f64; 3],
    seen: [f64; 6],
) -> Calibration {
    let mut off = calibration.clone();
    let photometry = off.photometry.as_mut().unwrap();
    for k in &mut photometry.sensitivity {
        *k *= 1.0 + STANDARD * standard;
    }
    let monitor = photometry.lamp.monitor.as_mut().unwrap();
    for light in monitor.light.iter_mut().flatten() {
        *light *= 1.0 + lamp * lamp_draw;
    }
    let interreflection = photometry.interreflection.as_mut().unwrap();
    interreflection.share += interreflection.standard_uncertainty * back;
    // The sample of this rig lies flat: what is known of its place along one axis says nothing of the others.
    let part = photometry.seen_part.as_mut().unwrap();
    let by: [f64; 6] = std::array::from_fn(|at| part.covariance[at][at].sqrt() * seen[at]);
    for (offset_m, by) in part.offset_m.iter_mut().zip(by) {
        *offset_m += by;
    }
    for (pupil_m, by) in part.pupils_m.iter_mut().zip(&by[3..]) {
        *pupil_m *= by.exp();
    }
    part.falloff = (part.falloff + by[5]).clamp(0.0, 1.0);
    off
}

#[test]
fn over_many_seeded_runs_the_interval_of_k_2_holds_the_truth() {
    let mut nominal = coarse("rcg-1-16bit");
    // Stated is what a dielectric makes of it, and this is a metal.
    nominal.light.polarisation = 0.0;
    // Of seven lit patterns few have a black one behind them: what is left of the one before is as uncertain as it usually is.
    nominal.projector.panel = Panel::Mirrors;
    let folder = tempfile::tempdir().unwrap();
    let tolerances = Tolerances {
        // What directions are off by is drawn below.
        figure_rad: Some(0.0),
        mirror_deg: Some(0.0),
        polarisation: Some(0.0),
        // What differs in every run, as large as is stated.
        seating_m: Some(7e-5),
        pixels: PixelTolerances {
            wander_e: Some(0.5),
            ..PixelTolerances::DRAWN
        },
        ..TOLERANCES
    };
    let truth = Truth::drawn(&nominal, tolerances, 8).unwrap();
    let first = save(&truth, &folder.path().join("truth.toml"));
    let calibration = calibrated(&nominal, &first, &[], &folder.path().join("calibration"));
    let geometry = calibration.geometry.clone().unwrap();

    let spec = "ggx:f0=0.4,ax=0.5,ay=0.6,rd=0.3";
    let sample = rcg::brdf::sample::parse(spec).unwrap();
    // Incident directions all over the hemisphere.
    let directions_deg = (0..7)
        .map(|i| [32.0 + 7.0 * f64::from(i), 51.0 * f64::from(i) + 10.0])
        .collect();
    let grid = Grid::List { directions_deg };
    let mut exposure_s = None;
    let photometry = calibration.photometry.as_ref().unwrap();
    let lamp = photometry.lamp.monitor.as_ref().unwrap().standard_uncertainty;
    let (mut count, mut within, mut squares) = (0_u32, 0_u32, 0.0);
    let runs = if is_full() { 200 } else { 24 };
    for run in 0..runs {
        // What the calibration did not know, by as much as is stated: the standard's reflectance, how bright the lamp was, what
        // returns onto the sample, what part of it is seen, and the directions.
        let draw = |purpose: u64| normal(run * 20 + purpose);
        let seen = std::array::from_fn(|at| draw(10 + at as u64));
        let calibration = off(&calibration, lamp, [draw(0), draw(5), draw(6)], seen);
        let mut truth = truth.clone();
        for axis in 0..2 {
            // A turn of a device by ψ at F2 turns the direction at the sample by some four times as much.
            truth.rig.camera.lens.rotation_deg[axis] +=
                0.25 * geometry.camera_deg / 2_f64.sqrt() * draw(1 + axis as u64);
            truth.rig.projector.lens.rotation_deg[axis] +=
                0.25 * geometry.projector_deg / 2_f64.sqrt() * draw(3 + axis as u64);
        }
        let path = save(&truth, &folder.path().join("run.toml"));
        let request = Request {
            grid: grid.clone(),
            image_size: 48,
            exposure_s,
            ..Request::default()
        };
        let dir = folder.path().join("run");
        let measurement = measured(
            &dir,
            Some(&calibration),
            &nominal,
            request,
            holding(spec, &path, run),
        );
        exposure_s = Some(measurement.plan.exposure_s);
        let brdf = Brdf::open(&measurement.path("brdf.zarr")).unwrap();
        for Scored { cell, score, .. } in scored(&brdf, sample.as_ref()) {
            if brdf.disk().direction(cell).is_none_or(|wo| wo.z <= 0.174) {
                continue;
            }
            count += 1;
            within += u32::from(score.abs() <= 2.0);
            squares += score * score;
        }
        std::fs::remove_dir_all(&dir).unwrap();
    }
    let share = f64::from(within) / f64::from(count);
    let spread = (squares / f64::from(count)).sqrt();
    println!("{share:.4} of {count} samples within k = 2, scores spread by {spread:.3}");
    assert!(u64::from(count) > 2500 * runs, "{count}");
    assert!(
        (0.93..=0.97).contains(&share),
        "{share:.4}, scores spread by {spread:.3}"
    );
}

#[test]
fn terms_that_no_fit_has_are_in_the_uncertainty() {
    let nominal = coarse("rcg-3");
    let folder = tempfile::tempdir().unwrap();
    let mut truth = Truth::drawn(&nominal, TOLERANCES, 12).unwrap();
    // Narrower than any polynomial of the fit: what a wiped mirror and a lamp with a filament do.
    truth.flaws.throughput.bumps.push([0.35, -0.2, 0.25, 0.02]);
    truth.flaws.intensity.bumps.push([-0.3, 0.25, 0.25, -0.02]);
    truth.flaws.black.bumps.push([0.2, 0.3, 0.15, 0.3]);
    let saved = save(&truth, &folder.path().join("truth.toml"));
    let calibration = calibrated(&nominal, &saved, &[], &folder.path().join("calibration"));
    for (seed, spec) in [(1, "lambert:0.5"), (2, "ggx:f0=0.4,ax=0.4,ay=0.5,rd=0.2")] {
        let request = Request {
            grid: Grid::ThetaPhi { step_deg: 15.0 },
            image_size: 48,
            brackets: Brackets::Number(2),
            ..Request::default()
        };
        let dir = folder.path().join(format!("run-{seed}"));
        let virtual_rig = holding(spec, &saved, seed);
        let measurement = measured(&dir, Some(&calibration), &nominal, request, virtual_rig);
        let brdf = Brdf::open(&measurement.path("brdf.zarr")).unwrap();
        let sample = rcg::brdf::sample::parse(spec).unwrap();
        let judgement = judge(&brdf, sample.as_ref()).unwrap();
        println!("{spec}: {judgement:?}");
        assert_eq!(judgement.wrong, Vec::<String>::new(), "{spec}");
        assert!(judgement.measured.coverage().unwrap() > 0.9, "{judgement:?}");
        assert!(judgement.scored_share.unwrap() > 0.3, "{judgement:?}");
    }
}

/// A number from 0 to 1 of its own for each `seed`: SplitMix64.
fn uniform(seed: u64) -> f64 {
    let mut z = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A normal deviate of its own for each `seed`: by Box and Muller.
fn normal(seed: u64) -> f64 {
    let (a, b) = (uniform(2 * seed).max(1e-15), uniform(2 * seed + 1));
    (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}
