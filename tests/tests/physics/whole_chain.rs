//! Known BRDF → schedule → edges → frames → the same BRDF, through the real session, client, stores and files.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use rcg::base::progress::Silent;
use rcg::brdf::Brdf;
use rcg::brdf::interpolation::Interpolation;
use rcg::capture::directory::Measurement;
use rcg::capture::{Instrument, Tally};
use rcg::hemisphere::direction::from_degrees;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::rig::Rig;
use rcg::judge::evaluate::{Evaluation, evaluate};
use rcg::judge::fit::{Fit, Model};
use rcg::measure::{Job, assemble_measurement, complete, conclude};
use rcg::plan::{Faults, Plan, Request, Virtual};
use rcg::store::provenance::Provenance;
use rcg::virtual_rig::{Behaviour, Held, Noise, Truth};
use rcg_tests::is_full;

/// Moves the camera's pulse by this many seconds.
struct Moved(f64);

fn request() -> Request {
    Request {
        grid: Grid::ThetaPhi { step_deg: 15.0 },
        image_size: 48,
        ..Request::default()
    }
}

fn holding(sample: &str, noise: bool) -> Virtual {
    Virtual {
        sample: sample.to_owned(),
        noise,
        seed: 5,
        ..Virtual::default()
    }
}

fn begin(
    dir: &Path,
    preset: &str,
    (request, virtual_rig): (Request, Virtual),
    exposure_s: f64,
    moved: &Moved,
) -> Measurement {
    let rig = Rig::load(preset)
        .unwrap()
        .with_image_size(request.image_size)
        .unwrap();
    let mut plan = Plan::new(request, &rig, exposure_s).unwrap().on(virtual_rig);
    plan.timing.cam_at_s += moved.0;
    Measurement::create(dir, rig, plan).unwrap()
}

fn capture(measurement: &Measurement) -> Tally {
    let job = Job::of(measurement, None).unwrap();
    rcg::measure::capture(measurement, &job, &Silent).unwrap()
}

/// A whole measurement: captured without faults, and assembled.
fn measured(
    dir: &Path,
    preset: &str,
    asked: (Request, Virtual),
    exposure_s: f64,
    moved: &Moved,
) -> Measurement {
    let measurement = begin(dir, preset, asked, exposure_s, moved);
    capture(&measurement);
    assemble_measurement(&measurement, &Silent).unwrap();
    measurement
}

fn judge(measurement: &Measurement) -> Evaluation {
    let brdf = Brdf::open(&measurement.path("brdf.zarr")).unwrap();
    let spec = &measurement.plan.virtual_rig.as_ref().unwrap().sample;
    let sample = rcg::brdf::sample::parse(spec).unwrap();
    evaluate(&brdf, Some((spec, sample.as_ref())), &|_| {}).unwrap()
}

/// Median relative error of the whole chain.
fn chain(preset: &str, sample: &str, exposure_s: f64, moved: &Moved) -> f64 {
    let dir = tempfile::tempdir().unwrap();
    let measurement = measured(
        &dir.path().join("m"),
        preset,
        (request(), holding(sample, false)),
        exposure_s,
        moved,
    );
    judge(&measurement)
        .against_reference
        .unwrap()
        .relative_error
        .median
        .value()
        .unwrap()
}

#[test]
fn what_was_put_in_comes_out_on_every_preset() {
    for (preset, exposure_s) in [("rcg-1-16bit", 0.0333), ("rcg-2", 0.0333), ("dmd", 80e-6)] {
        let error = chain(preset, "lambert:0.5", exposure_s, &Moved(0.0));
        assert!(error < 0.005, "{preset}: median error {error}");
    }
    let error = chain("rcg-1-16bit", "ward:brass", 0.004, &Moved(0.0));
    assert!(error < 0.005, "brass: median error {error}");
}

#[test]
fn between_captures_the_look_up_follows_the_highlight() {
    let dir = tempfile::tempdir().unwrap();
    let request = Request {
        image_size: 96,
        ..request()
    };
    let asked = (request, holding("ward:brass", false));
    let measurement = measured(&dir.path().join("m"), "rcg-2", asked, 0.004, &Moved(0.0));
    let brdf = Brdf::open(&measurement.path("brdf.zarr")).unwrap();
    let sample = rcg::brdf::sample::parse("ward:brass").unwrap();
    // In the highlight, where interpolations differ: half vectors within 12° of the normal.
    let pairs: Vec<_> = (0..4000)
        .map(|i| {
            let i = f64::from(i);
            let wi = from_degrees(40.0 + (i * 0.618).fract() * 20.0, i * 137.5);
            let half = from_degrees((i * 0.414).fract() * 12.0, i * 71.3);
            (wi, 2.0 * wi.dot(half) * half - wi)
        })
        .collect();
    let rms = |interpolation| {
        let values = brdf.interpolated(&pairs, interpolation).unwrap();
        let squares: Vec<f64> = values
            .iter()
            .zip(&pairs)
            .filter_map(|(value, (wi, wo))| {
                let f = f64::from(value.as_ref().ok()?[1]);
                Some((f - sample.f(*wi, *wo)[1]).powi(2))
            })
            .collect();
        assert!(squares.len() > 2000, "only {} have values", squares.len());
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    let [direct, half_vector, blended] = [
        Interpolation::Direct,
        Interpolation::HalfVector,
        Interpolation::Blended,
    ]
    .map(rms);
    println!("RMS error in 1/sr: direct {direct:.4}, half vector {half_vector:.4}, blended {blended:.4}");
    assert!(blended < 0.25 * direct, "direct {direct}, blended {blended}");
    // The half vector alone is right here and wrong elsewhere.
    assert!(
        blended < 1.5 * half_vector,
        "half vector {half_vector}, blended {blended}"
    );
}

#[test]
fn a_model_is_recovered_from_its_noisy_measurement_within_the_stated_uncertainty() {
    let (wide, brass) = ([0.15, 0.3, 0.2, 0.3], [0.05, 0.16, 0.1, 0.33]);
    let cases = [
        ("rcg-2", wide, 15.0, 32),
        ("rcg-1-16bit", wide, 15.0, 32),
        ("rcg-1-16bit", brass, 5.0, 96),
        ("rcg-2", brass, 5.0, 96),
    ];
    for &(preset, known, step_deg, image_size) in &cases[..if is_full() { 4 } else { 2 }] {
        let dir = tempfile::tempdir().unwrap();
        let request = Request {
            grid: Grid::ThetaPhi { step_deg },
            image_size,
            ..request()
        };
        let [ax, ay, rd, rs] = known;
        let azimuth_deg = 27.0;
        let spec = format!("ward:ax={ax},ay={ay},rd={rd},rs={rs}@{azimuth_deg}");
        let asked = (request, holding(&spec, true));
        let measurement = measured(&dir.path().join("m"), preset, asked, 0.004, &Moved(0.0));
        let brdf = Brdf::open(&measurement.path("brdf.zarr")).unwrap();
        let fit = Fit::of_brdf(Model::Ward, &brdf).unwrap();
        for parameter in &fit.parameters {
            let (truth, most) = match &parameter.name[..2] {
                "ax" => (ax, 0.02 * ax),
                "ay" => (ay, 0.02 * ay),
                "az" => (azimuth_deg, 0.1),
                "rd" => (rd, 0.02 * rd),
                _ => (rs, 0.02 * rs),
            };
            let error = parameter.value - truth;
            println!("{preset}: {parameter:?}");
            assert!(error.abs() < most, "{preset}: {parameter:?}");
            assert!(
                error.abs() < 2.0 * parameter.standard_uncertainty.unwrap(),
                "{preset}: {parameter:?}"
            );
        }
    }
}

#[test]
fn a_camera_pulse_that_straddles_two_patterns_spoils_the_brdf() {
    // A broad lobe without a diffuse part, so that every sample changes from one pattern to the next. The pattern
    // settles for 33.3 ms: a trigger 5 ms earlier sees half of its 10 ms under the pattern before.
    let lobe = "ggx:f0=0.5,ax=0.3,ay=0.3,rd=0.0";
    let in_time = chain("rcg-1-16bit", lobe, 0.01, &Moved(0.0));
    let straddling = chain("rcg-1-16bit", lobe, 0.01, &Moved(-0.005));
    assert!(in_time < 0.005, "in time: {in_time}");
    assert!(straddling > 0.05, "straddling: {straddling} was not noticed");
}

#[test]
fn missed_triggers_dropped_and_doubled_frames_change_nothing_but_the_tally() {
    let dir = tempfile::tempdir().unwrap();
    let take = |name: &str, faults: Faults| {
        let virtual_rig = Virtual {
            faults,
            ..holding("ggx:satin", false)
        };
        let asked = (request(), virtual_rig);
        let measurement = begin(&dir.path().join(name), "rcg-1-16bit", asked, 0.01, &Moved(0.0));
        let tally = capture(&measurement);
        assemble_measurement(&measurement, &Silent).unwrap();
        let brdf = Brdf::open(&measurement.path("brdf.zarr")).unwrap();
        let chunks: Vec<_> = (0..brdf.chunks())
            .map(|chunk| {
                // By their bits: what is missing is NaN, which equals nothing.
                brdf.chunk(chunk).unwrap().map(|rows| {
                    let f: Vec<u32> = rows.f.iter().map(|f| f.to_bits()).collect();
                    let sigma: Vec<u16> = rows.sigma.iter().map(|sigma| sigma.to_bits()).collect();
                    (f, sigma, rows.provenance)
                })
            })
            .collect();
        (tally, chunks)
    };
    let (calm, clean) = take("calm", Faults::default());
    let faults = Faults {
        missed_triggers: 0.1,
        dropped_frames: 0.1,
        doubled_frames: 0.1,
    };
    let (rough, repaired) = take("rough", faults);
    assert_eq!(
        (
            calm.missed_triggers,
            calm.dropped_frames,
            calm.repeated,
            calm.orphans
        ),
        (0, 0, 0, 0)
    );
    assert!(
        rough.missed_triggers > 0 && rough.dropped_frames > 0 && rough.duplicates > 0,
        "{rough:?}"
    );
    assert!(
        rough.repeated >= rough.missed_triggers.min(rough.dropped_frames),
        "{rough:?}"
    );
    assert_eq!(rough.paired, calm.paired);
    assert!(clean == repaired, "the assembled BRDF differs");
}

#[test]
fn a_capture_taken_up_again_at_any_segment_has_the_same_bits() {
    let dir = tempfile::tempdir().unwrap();
    // Two segments and more of black patterns alone, which look the same.
    let begun = |name: &str| {
        let rig = Rig::load("rcg-1-16bit").unwrap().with_image_size(16).unwrap();
        let request = Request {
            image_size: 16,
            grid: Grid::ThetaPhi { step_deg: 30.0 },
            ..request()
        };
        let virtual_rig = Virtual {
            faults: Faults {
                missed_triggers: 0.1,
                dropped_frames: 0.1,
                doubled_frames: 0.1,
            },
            ..holding("lambert:0.5", true)
        };
        let mut plan = Plan::new(request, &rig, 0.0333).unwrap().on(virtual_rig);
        plan.segment = 5;
        Measurement::create(&dir.path().join(name), rig, plan).unwrap()
    };
    let whole = begun("whole");
    let tally = capture(&whole);
    assert!(tally.missed_triggers > 0 && tally.duplicates > 0);
    let of = |measurement: &Measurement| {
        let raw = measurement.raw().unwrap();
        (0..raw.segments())
            .map(|segment| raw.read_segment(segment).unwrap())
            .collect::<Vec<_>>()
    };
    let expected = of(&whole);
    let frames = |segment: usize| &expected[segment].frames;
    assert!(
        frames(0) != frames(1) && frames(1) != frames(2),
        "noise of black frames repeats itself"
    );
    for from in 0..expected.len() {
        for segment in from..expected.len() {
            std::fs::remove_file(whole.path(&format!("raw.zarr/seal/c.{segment}"))).unwrap();
        }
        assert_eq!(capture(&whole), tally);
        assert!(of(&whole) == expected, "taken up again at segment {from}");
    }
}

#[test]
fn the_stated_uncertainty_is_that_of_the_noise() {
    let dir = tempfile::tempdir().unwrap();
    let measurement = measured(
        &dir.path().join("m"),
        "rcg-1-16bit",
        (request(), holding("lambert:0.5", true)),
        0.0333,
        &Moved(0.0),
    );
    let brdf = Brdf::open(&measurement.path("brdf.zarr")).unwrap();
    let truth = 0.5 / std::f64::consts::PI;
    let (mut count, mut squares, mut within) = (0_u32, 0.0, 0_u32);
    for chunk in 0..brdf.chunks() {
        let Some(rows) = brdf.chunk(chunk).unwrap() else {
            continue;
        };
        for (sample, &provenance) in rows.provenance.iter().enumerate() {
            if provenance == Provenance::Measured.code() {
                let (f, sigma) = (f64::from(rows.f[sample * 3]), rows.sigma[sample * 3].to_f64());
                let score = (f - truth) / sigma;
                count += 1;
                squares += score * score;
                within += u32::from(score.abs() <= 2.0);
            }
        }
    }
    let (spread, share) = (
        (squares / f64::from(count)).sqrt(),
        f64::from(within) / f64::from(count),
    );
    assert!(count > 50_000);
    assert!((spread - 1.0).abs() < 0.05, "scores spread by {spread}");
    assert!((0.93..=0.97).contains(&share), "{share} within k = 2");
}

#[test]
fn a_known_brdf_is_judged_without_error_and_a_wrong_one_is_not() {
    let dir = tempfile::tempdir().unwrap();
    let measurement = begin(
        &dir.path().join("m"),
        "rcg-2",
        (request(), holding("lambert:0.5", false)),
        0.0333,
        &Moved(0.0),
    );
    let summary = complete(
        &measurement,
        &Job::of(&measurement, None).unwrap(),
        &|| Duration::ZERO,
        &Silent,
    )
    .unwrap();
    // Energy: a white furnace of albedo 0.5, seen almost whole by this rig.
    for albedo in &summary.evaluation.albedo {
        assert!(
            (albedo.measured_part.unwrap() / albedo.seen - 0.5).abs() < 0.005,
            "{albedo:?}"
        );
        assert!(albedo.seen > 0.95, "{albedo:?}");
    }
    assert!(summary.evaluation.reciprocity_residual_median.unwrap() < 0.005);
    assert!(measurement.path("figures/sphere.png").is_file() && measurement.path("report.html").is_file());

    let brdf = Brdf::open(&measurement.path("brdf.zarr")).unwrap();
    let wrong = rcg::brdf::sample::parse("lambert:0.45").unwrap();
    let error = evaluate(&brdf, Some(("lambert:0.45", wrong.as_ref())), &|_| {}).unwrap();
    let median = error
        .against_reference
        .unwrap()
        .relative_error
        .median
        .value()
        .unwrap();
    assert!((median - 1.0 / 9.0).abs() < 0.005, "{median}");
}

#[test]
fn a_real_sample_is_compared_with_nothing_unless_that_is_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    for reference in [None, Some("lambert:0.5")] {
        let rig = Rig::load("rcg-1-16bit").unwrap().with_image_size(16).unwrap();
        let request = Request {
            grid: Grid::ThetaPhi { step_deg: 30.0 },
            image_size: 16,
            sample_name: Some("plate 3".to_owned()),
            sample_description: Some("ground, batch 7".to_owned()),
            reference: reference.map(str::to_owned),
            ..Request::default()
        };
        // A plan without a virtual rig is one for a real instrument.
        let plan = Plan::new(request, &rig, 0.0333).unwrap();
        let dir = dir.path().join(reference.unwrap_or("none"));
        let measurement = Measurement::create(&dir, rig.clone(), plan).unwrap();
        let job = Job::of(&measurement, None).unwrap();
        let refused = rcg::measure::capture(&measurement, &job, &Silent)
            .unwrap_err()
            .to_string();
        assert!(
            refused.contains("expected drivers of a real camera and projector, found the virtual rig"),
            "{refused}"
        );

        let behaviour = Behaviour {
            noise: Noise::On,
            seed: 1,
            faults: Faults::default(),
            lamp_h: 0.0,
        };
        let held = Held::Sample(Arc::from(rcg::brdf::sample::parse("lambert:0.3").unwrap()));
        let mut instrument = Instrument::simulated(&Truth::of(&rig), held, behaviour).unwrap();
        let tally = measurement.capture(&mut instrument, &mut |_| {}).unwrap();
        let compared = job.reference.as_ref();
        let summary = conclude(&measurement, compared, tally, &|| Duration::ZERO, &Silent).unwrap();
        let against = summary.evaluation.against_reference;
        assert_eq!(
            against.as_ref().map(|against| against.reference.as_str()),
            reference
        );
        assert_eq!(summary.sample, "plate 3");
        let page = std::fs::read_to_string(measurement.path("report.html")).unwrap();
        assert!(
            page.contains("plate 3: ground, batch 7") && !page.contains("brass"),
            "{page}"
        );
        assert_eq!(page.contains("below lambert:0.5"), reference.is_some(), "{page}");
        if let Some(against) = against {
            let error = against.relative_error.median.value().unwrap();
            assert!((error - 0.4).abs() < 0.05, "{error}");
        }
    }
}
