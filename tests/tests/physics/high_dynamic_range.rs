//! Exposure brackets: one program of the controller, merged into f over a million to one.

// Exposure times come back exactly.
#![allow(clippy::float_cmp)]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use rcg::assemble::Assembled;
use rcg::base::progress::Silent;
use rcg::brdf::Brdf;
use rcg::capture::directory::Measurement;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::rig::Rig;
use rcg::measure::{Job, assemble_measurement, capture, prepare};
use rcg::plan::brackets::Brackets;
use rcg::plan::{Faults, Request, Virtual};
use rcg::store::provenance::Provenance;
use rcg::store::{RawStore, Segment};
use rcg::virtual_rig::setup::Setup;

/// The clock of the simulated trigger box.
const CLOCK_HZ: f64 = 125e6;
const MILLION: f64 = 1e6;

fn request(brackets: &str) -> Request {
    Request {
        grid: Grid::ThetaPhi { step_deg: 15.0 },
        image_size: 48,
        brackets: brackets.parse().unwrap(),
        ..Request::default()
    }
}

fn holding(sample: &str, noise: bool) -> Virtual {
    Virtual {
        sample: sample.to_owned(),
        noise,
        seed: 3,
        ..Virtual::default()
    }
}

/// RCG-1 with a camera of `bits`.
fn rig(bits: u8) -> Rig {
    let mut rig = Rig::load("rcg-1-16bit").unwrap();
    rig.camera.bits = bits;
    if bits == 12 {
        rig.camera.dark_dn = 16.0;
    }
    rig
}

fn captured(dir: &Path, rig: &Rig, request: Request, virtual_rig: Virtual) -> Measurement {
    let (job, measurement) = prepare(dir, rig, request, &virtual_rig.into(), &Silent).unwrap();
    capture(&measurement, &job, &Silent).unwrap();
    measurement
}

/// Frames and records of all exposures, in their order.
fn exposures(measurement: &Measurement) -> Segment {
    let raw = RawStore::open(&measurement.path("raw.zarr")).unwrap();
    let mut all = Segment::default();
    for segment in 0..raw.segments() {
        let segment = raw.read_segment(segment).unwrap();
        all.frames.extend(segment.frames);
        all.records.extend(segment.records);
    }
    all
}

/// f and σ of the measured and merged samples by (incident direction, cell and channel), and how many are merged.
type Samples = BTreeMap<(usize, usize), (f64, f64)>;
fn samples(measurement: &Measurement) -> (Samples, usize, Assembled) {
    let assembled = assemble_measurement(measurement, &Silent).unwrap();
    let brdf = Brdf::open(&measurement.path("brdf.zarr")).unwrap();
    let (mut samples, mut merged) = (Samples::new(), 0);
    for chunk in 0..brdf.chunks() {
        let Some(rows) = brdf.chunk(chunk).unwrap() else {
            continue;
        };
        let cells = brdf.disk().len();
        let first = brdf.chunk_range(chunk).start;
        for (at, &code) in rows.provenance.iter().enumerate() {
            if code == Provenance::Missing.code() {
                continue;
            }
            merged += usize::from(code == Provenance::Merged.code());
            for channel in 0..3 {
                let (f, sigma) = (rows.f[at * 3 + channel], rows.sigma[at * 3 + channel]);
                let key = (first + at / cells, at % cells * 3 + channel);
                samples.insert(key, (f64::from(f), sigma.to_f64()));
            }
        }
    }
    (samples, merged, assembled)
}

#[test]
fn a_camera_of_12_bits_reaches_a_million_to_one_on_brass() {
    let dir = tempfile::tempdir().unwrap();
    let measure = |name: &str, bits, sample: &str, noise| {
        let request = request("3.5,25,160,1064");
        captured(
            &dir.path().join(name),
            &rig(bits),
            request,
            holding(sample, noise),
        )
    };
    let measurement = measure("brass", 12, "ward:brass", true);
    let (brass, merged, assembled) = samples(&measurement);
    assert!(assembled.dynamic_range.unwrap() > MILLION, "{assembled:?}");
    // Near the horizon f grows without bound.
    assert!(assembled.saturated < assembled.measured / 10_000, "{assembled:?}");
    assert!(
        merged * 3 > brass.len() / 2,
        "{merged} of {} are merged",
        brass.len() / 3
    );

    // What the camera did: range of the shortest exposure over the scatter of the longest's black frames.
    let all = exposures(&measurement);
    let (shortest_s, longest_s) = (0.0035, 1.064);
    let samples_a_frame = 48 * 48 * 3;
    let frames = all.records.iter().zip(all.frames.chunks_exact(samples_a_frame));
    let black: Vec<&[u16]> = frames
        .filter(|(record, _)| record.kind == 1 && record.exposure_s > 1.0)
        .map(|(_, frame)| frame)
        .collect();
    assert_eq!(black.len(), 16);
    let mut square = 0.0;
    for sample in 0..samples_a_frame {
        let mean = black.iter().map(|frame| f64::from(frame[sample])).sum::<f64>() / 16.0;
        square += black
            .iter()
            .map(|frame| (f64::from(frame[sample]) - mean).powi(2))
            .sum::<f64>()
            / 15.0;
    }
    let noise_dn = (square / samples_a_frame as f64).sqrt();
    let sensor = rig(12).with_image_size(48).unwrap();
    let range_dn = f64::from(sensor.saturation_dn()) - sensor.camera.dark_dn;
    let range = range_dn / shortest_s / (noise_dn / longest_s);
    assert!(range > MILLION, "{range:.3e} with a noise of {noise_dn} DN");
    assert!(
        // Near a whole number rounding with dither makes less noise than in the mean over all levels.
        (range / assembled.dynamic_range.unwrap() - 1.0).abs() < 0.05,
        "{range:.3e}, {assembled:?}"
    );

    // The stated uncertainty holds the truth, which is what 16 bits see without noise, at both ends.
    let (truth, ..) = samples(&measure("truth", 16, "ward:brass", false));
    let brightest = truth.values().map(|value| value.0).fold(0.0, f64::max);
    let darkest = truth.values().map(|value| value.0).fold(f64::MAX, f64::min);
    // In the highlight most of the stated uncertainty is that of the blur, which both captures share.
    for (decade, low, high, expected) in [
        ("darkest", 0.0, darkest * 10.0, 0.93..=0.97),
        ("brightest", brightest / 10.0, f64::MAX, 0.93..=1.0),
    ] {
        let scores: Vec<f64> = truth
            .iter()
            .filter(|(_, value)| (low..=high).contains(&value.0))
            .filter_map(|(at, value)| brass.get(at).map(|brass| (brass.0 - value.0) / brass.1))
            .collect();
        let count = scores.len() as f64;
        let within = scores.iter().filter(|score| score.abs() <= 2.0).count() as f64 / count;
        let mean = scores.iter().sum::<f64>() / count;
        assert!(count > 1000.0, "{count} samples of the {decade} decade");
        assert!(
            expected.contains(&within),
            "{within:.4} of the {decade} decade within k = 2"
        );
        assert!(
            mean.abs() < 0.1,
            "{decade} decade: off by {mean:.3} standard uncertainties"
        );
    }
}

#[test]
fn with_the_same_exposures_a_sample_a_million_times_darker_is_above_its_noise() {
    // At the full range of the shortest exposure, at normal incidence: 0.5/sr saturates 33.3 ms.
    let brightest = 0.5 * 33.3 / 3.5;
    let f = brightest / MILLION;
    let dir = tempfile::tempdir().unwrap();
    let dim = holding(&format!("lambert:{}", f * std::f64::consts::PI), true);
    let measurement = captured(&dir.path().join("m"), &rig(12), request("3.5,25,160,1064"), dim);
    let (dark, ..) = samples(&measurement);
    // The first ring in reach, 37.5°: cos θ is 0.79, which the brightest value has lost too.
    let ring = dark.iter().filter(|(at, _)| (48..72).contains(&at.0));
    let values: Vec<(f64, f64)> = ring.map(|value| *value.1).collect();
    let count = values.len() as f64;
    let cos = 37.5_f64.to_radians().cos();
    let sigma = (values.iter().map(|value| value.1.powi(2)).sum::<f64>() / count).sqrt();
    assert!(sigma * cos < f, "noise of {sigma:.2e} at {f:.2e}/sr");
    let mean = values.iter().map(|value| value.0).sum::<f64>() / count;
    // 16 black frames make an error that all directions share, a quarter of a pixel's noise; it differs by pixel.
    assert!(count > 10_000.0);
    assert!((mean - f).abs() < 0.1 * f, "{mean:.3e} instead of {f:.3e}");
}

#[test]
fn each_exposure_of_a_pattern_is_that_of_a_measurement_with_this_one_alone() {
    let dir = tempfile::tempdir().unwrap();
    let rig = Rig::load("rcg-2").unwrap();
    let brass = holding("ward:brass", false);
    let together = captured(
        &dir.path().join("together"),
        &rig,
        request("1,8,40"),
        brass.clone(),
    );
    let together = exposures(&together);
    let frame = 48 * 48 * 3;
    for (k, exposure_s) in [0.001, 0.008, 0.04].into_iter().enumerate() {
        let alone = Request {
            exposure_s: Some(exposure_s),
            ..request("1")
        };
        let dir = dir.path().join(format!("{k}"));
        let alone = exposures(&captured(&dir, &rig, alone, brass.clone()));
        assert_eq!(together.records.len(), 3 * alone.records.len());
        let its = together.frames.chunks_exact(frame).skip(k).step_by(3);
        assert!(
            its.eq(alone.frames.chunks_exact(frame)),
            "frames of {exposure_s} s differ: the pattern did not stay"
        );
        for (ours, theirs) in together.records.iter().skip(k).step_by(3).zip(&alone.records) {
            assert_eq!(
                (ours.incident, ours.kind, ours.exposure_s),
                (theirs.incident, theirs.kind, exposure_s)
            );
        }
    }
}

#[test]
fn the_edges_come_as_planned_to_the_tick() {
    for preset in ["rcg-1-16bit", "dmd"] {
        let dir = tempfile::tempdir().unwrap();
        let rig = Rig::load(preset).unwrap();
        let times = if preset == "dmd" {
            "0.01,0.08,0.6"
        } else {
            "1,8,40"
        };
        let measurement = captured(
            &dir.path().join("m"),
            &rig,
            request(times),
            holding("lambert:0.5", true),
        );
        let all = exposures(&measurement);
        let steps: Vec<_> = measurement
            .plan
            .timings()
            .iter()
            .map(|timing| timing.step(CLOCK_HZ as u32))
            .collect();
        assert!(!steps[0].proj.is_none() && steps[1].proj.is_none() && steps[2].proj.is_none());
        for segment in all.records.chunks(measurement.plan.segment) {
            let mut start = segment[0].trigger_tick - steps[0].cam.at.0;
            for (record, step) in segment.iter().zip(steps.iter().cycle()) {
                assert_eq!(record.trigger_tick, start + step.cam.at.0, "{preset}");
                assert_eq!(record.strobe_off_tick - record.strobe_on_tick, step.cam.width.0);
                start += step.period.0;
            }
        }
    }
}

#[test]
fn what_is_missing_is_taken_again_with_its_own_exposure_time() {
    let dir = tempfile::tempdir().unwrap();
    let rig = Rig::load("rcg-2").unwrap();
    let brass = holding("ward:brass", false);
    let request = request("1,8,40");
    let calm = captured(&dir.path().join("calm"), &rig, request.clone(), brass.clone());
    let rough = Virtual {
        faults: Faults {
            missed_triggers: 0.1,
            dropped_frames: 0.1,
            doubled_frames: 0.1,
        },
        ..brass
    };
    let hit = captured(&dir.path().join("hit"), &rig, request, rough);
    let (calm, hit) = (exposures(&calm), exposures(&hit));
    assert!(calm.frames == hit.frames, "frames differ");
    let mut again = [0; 3];
    for (place, (ours, theirs)) in hit.records.iter().zip(&calm.records).enumerate() {
        assert_eq!(ours.exposure_s, theirs.exposure_s);
        let open = ours.strobe_off_tick - ours.strobe_on_tick;
        assert_eq!(open as f64, (ours.exposure_s * CLOCK_HZ).round());
        again[place % 3] += u32::from(ours.attempts > 1);
    }
    assert!(
        again.iter().all(|&count| count > 20),
        "{again:?} of each exposure time"
    );
}

#[test]
fn a_capture_that_lost_its_end_is_completed_to_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig(12);
    let brass = holding("ward:brass", true);
    let measurement = captured(&dir.path().join("m"), &rig, request("4,20,100,500"), brass);
    let whole = exposures(&measurement);
    let frames = measurement.path("raw.zarr/frames");
    let mut chunks: Vec<_> = fs::read_dir(&frames)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.file_name().unwrap().to_string_lossy().starts_with("c."))
        .collect();
    chunks.sort();
    assert!(chunks.len() > 1, "several segments");
    fs::remove_file(chunks.last().unwrap()).unwrap();
    capture(&measurement, &Job::of(&measurement, None).unwrap(), &Silent).unwrap();
    assert!(exposures(&measurement) == whole, "frames or records differ");
}

#[test]
fn a_pilot_capture_proposes_what_the_sample_needs() {
    let dir = tempfile::tempdir().unwrap();
    let propose = |name: &str, sample: &str, brackets: &str| {
        let setup = Setup::from(holding(sample, true));
        let dir = dir.path().join(name);
        let prepared = prepare(&dir, &rig(12), request(brackets), &setup, &Silent);
        prepared.unwrap().1.plan.exposures_s()
    };
    // A mirror-like sample is a hundred thousand times as bright at its peak as beside it, paper-like samples are not.
    let metal = "ward:rd=0.0005,rs=0.3,ax=0.03,ay=0.03";
    let sharp = propose("sharp", metal, "auto");
    let white = propose("white", "lambert:0.5", "auto");
    assert!(sharp.len() > white.len(), "{sharp:?} {white:?}");
    for pair in sharp.windows(2).chain(white.windows(2)) {
        assert!(pair[0] < pair[1] && pair[1] / pair[0] <= rcg::plan::brackets::LARGEST_RATIO * 1.000_001);
    }
    // Nothing saturates the shortest: 0.16/sr fills the well in 33.3 ms × 0.5/0.16/cosθ, with θ = 27° where the hole ends.
    assert!(
        white[0] < 0.0333 * 0.5 / 0.16 / 27_f64.to_radians().cos(),
        "{white:?}"
    );
    let four = propose("four", metal, "4");
    assert_eq!(four.len(), 4);
    assert_eq!((four[0], four[3]), (sharp[0], *sharp.last().unwrap()));
    let given = propose("given", metal, "250,2,20");
    assert_eq!(given, [0.002, 0.02, 0.25]);
    assert_eq!("2,20,250".parse(), Ok(Brackets::TimesMs(vec![2.0, 20.0, 250.0])));
}

#[test]
fn no_pixel_saturates_in_rows_of_a_code_towards_the_horizon_neither() {
    // Velvet is brightest at grazing angles.
    let rig = rig(16);
    let coded = Request {
        light: "multiplexed".parse().unwrap(),
        ..request("1")
    };
    let folder = tempfile::tempdir().unwrap();
    let measurement = captured(folder.path(), &rig, coded, holding("velvet", false));
    let brightest = exposures(&measurement).frames.into_iter().max();
    let share = f64::from(brightest.unwrap()) / f64::from(rig.saturation_dn());
    println!("brightest: {share:.3} of the range");
    assert!((0.5..1.0).contains(&share), "{share}");
}
