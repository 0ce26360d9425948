//! Laws of merging, on pixels of the virtual camera.

use super::*;
use crate::assemble::radiometry::of_black;
use crate::instrument::rig::Rig;
use crate::store::{ExposureRecord, Segment};
use crate::virtual_rig::{Noise, sense};

/// Times of four brackets in s.
const TIMES_S: [f64; 4] = [0.004, 0.024, 0.16, 1.0];
/// Pixels of a trial, all of the same signal: as many repetitions with other noise.
const PIXELS: usize = 40_000;

/// RCG-1 with a camera of 12 bits.
fn rig() -> Rig {
    let mut rig = Rig::load("rcg-1-16bit").unwrap();
    (rig.camera.bits, rig.camera.dark_dn) = (12, 16.0);
    rig
}

/// The radiometry of `times_s` from so many black frames of `samples` numbers.
fn radiometry(rig: &Rig, times_s: &[f64], samples: usize, blacks: u64, noise: Noise) -> Vec<Radiometry> {
    let each = |&exposure_s: &f64| {
        let mut black = Segment::default();
        for frame in 0..blacks {
            let dark_e = vec![0.0; samples];
            black
                .frames
                .extend(sense(rig, &dark_e, exposure_s, noise, 1000 + frame));
            black.records.push(ExposureRecord {
                incident: -1,
                exposure_s,
                ..ExposureRecord::default()
            });
        }
        of_black(rig, None, &black, exposure_s, samples).unwrap()
    };
    times_s.iter().map(each).collect()
}

/// Frames of pixels that gather `rate_e` electrons per second.
fn frames(rig: &Rig, times_s: &[f64], rate_e: f64, samples: usize, seed: u64) -> Vec<u16> {
    let each = times_s.iter().enumerate();
    each.flat_map(|(k, t)| {
        let signal_e = vec![(rate_e * t) as f32; samples];
        sense(rig, &signal_e, *t, Noise::On, seed * 10 + k as u64)
    })
    .collect()
}

/// The numbers of `frames` as `exposures` tell.
fn linear(frames: &[u16], exposures: &[Radiometry]) -> Vec<f32> {
    let of = |dn: &u16| exposures[0].numbers.unsaturated(*dn);
    frames.iter().map(of).collect()
}

/// Mean and standard deviation of (merged − true rate), both relative to the stated standard uncertainty, and the share
/// of stated intervals at k = 2 that hold the truth.
fn trial(rate_e: f64) -> (f64, f64, f64) {
    let rig = rig();
    // Frames so many that the dark level, which is the same for all of a pixel's repetitions, has no error.
    let exposures = radiometry(&rig, &TIMES_S, PIXELS, 1, Noise::Off);
    let exposures: Vec<Radiometry> = exposures
        .into_iter()
        .map(|one| {
            let dark_e = rig.camera.dark_current_e_per_s * one.exposure_s;
            let dark = rig.camera.dark_dn + dark_e / rig.gain_e_per_dn();
            Radiometry {
                dark: vec![dark as f32; PIXELS],
                // Without the part of the mean black frame: one frame doubles the variance.
                dark_variance: one.dark_variance / 2.0,
                means: 1.0,
                ..one
            }
        })
        .collect();
    let mut merged = Merged::default();
    Merge::new(&exposures).frames::<1>(
        &linear(&frames(&rig, &TIMES_S, rate_e, PIXELS, 7), &exposures),
        &[Levels::SAME; TIMES_S.len()],
        Offset::default(),
        &mut merged,
    );
    let truth = rate_e * TIMES_S[0] / rig.gain_e_per_dn();
    let errors = merged.signal.iter().map(|signal| f64::from(signal.x) - truth);
    let squares = merged.variance.iter().map(|variance| f64::from(variance.x));
    let count = PIXELS as f64;
    // Each by its own uncertainty would not do: where a value is high by chance, so is what is stated.
    let stated = (squares.clone().sum::<f64>() / count).sqrt();
    let mean = errors.clone().sum::<f64>() / count;
    let deviation = (errors.clone().map(|e| (e - mean).powi(2)).sum::<f64>() / count).sqrt();
    let inside = errors
        .zip(squares)
        .filter(|(error, square)| error * error <= 4.0 * square);
    let (mean, deviation, within) = (mean / stated, deviation / stated, inside.count() as f64 / count);
    (mean, deviation, within)
}

#[test]
fn at_any_signal_the_mean_is_true_and_the_spread_as_stated() {
    // From a thousandth of the read noise in the longest exposure to nearly saturated in the shortest.
    for rate_e in [
        0.003, 1.0, 5.0, 20.0, 100.0, 1e3, 8e3, 1.5e4, 3e4, 1e5, 4e5, 1e6, 4e6, 4.8e6,
    ] {
        let (mean, deviation, within) = trial(rate_e);
        // The mean of 40,000 is known to 0.005.
        assert!(
            mean.abs() < 0.025,
            "{rate_e} e/s: off by {mean:.3} standard uncertainties"
        );
        // Without light too much is stated, by up to 6 %: an expected signal is never negative.
        let least = if rate_e < 20.0 { 0.93 } else { 0.98 };
        assert!(
            (least..1.02).contains(&deviation),
            "{rate_e} e/s: spread {deviation:.3}"
        );
        // Where the noise is less than a number, intervals hold one number more or less.
        if rate_e >= 1e3 {
            assert!(
                (0.945..=0.965).contains(&within),
                "{rate_e} e/s: {within:.4} within k = 2"
            );
        }
    }
}

#[test]
fn no_other_weights_do_better() {
    // Against each exposure alone, and against the one of the first, read-noise weighted, mean.
    let rig = rig();
    let exposures = radiometry(&rig, &TIMES_S, 1, 4, Noise::Off);
    let merge = Merge::new(&exposures);
    for rate_e in [1.0, 100.0, 1e4, 1e5, 1e6] {
        let first_dn = rate_e * TIMES_S[0] / rig.gain_e_per_dn();
        let numbers: Vec<Number> = merge
            .brackets
            .iter()
            .map(|one| {
                let dn = first_dn * f64::from(one.time);
                let usable = if dn < 4079.0 { 1.0 } else { 0.0 };
                Number {
                    signal: Vec4::splat(dn as f32),
                    usable: Vec4::splat(usable),
                    dark_variance: Vec4::splat(one.dark_variance),
                }
            })
            .collect();
        let Pixel { signal, variance, .. } = merge.pixel::<1>(&numbers);
        assert!((f64::from(signal.x) / first_dn - 1.0).abs() < 1e-5);
        let shot = f64::from(exposures[0].numbers.shot_per_dn);
        let alone = merge
            .brackets
            .iter()
            .zip(&numbers)
            .filter(|one| one.1.usable.x > 0.0);
        for (bracket, _) in alone.clone() {
            let time = f64::from(bracket.time);
            let its = (first_dn * time * shot + f64::from(bracket.dark_variance)) / (time * time);
            assert!(f64::from(variance.x) <= its * 1.000_001, "{rate_e} e/s, {time}");
        }
        let (mut squares, mut sum) = (0.0, 0.0);
        for (bracket, _) in alone {
            let (time, dark) = (f64::from(bracket.time), f64::from(bracket.dark_variance));
            squares += (time / dark).powi(2) * (first_dn * time * shot + dark);
            sum += time * time / dark;
        }
        assert!(
            f64::from(variance.x) <= squares / (sum * sum) * 1.06,
            "{rate_e} e/s"
        );
    }
}

#[test]
fn saturated_and_dark_samples_take_no_part() {
    let rig = rig();
    let exposures = radiometry(&rig, &TIMES_S, 3, 4, Noise::Off);
    let merged = |dn: [u16; 4]| {
        let mut out = Merged::default();
        let frames: Vec<u16> = dn.into_iter().flat_map(|dn| [dn, dn, dn]).collect();
        Merge::new(&exposures).frames::<3>(
            &linear(&frames, &exposures),
            &vec![Levels::SAME; exposures.len()],
            Offset::default(),
            &mut out,
        );
        (out.signal[0].y, out.several[0])
    };
    // Two saturate: what they hold is not known, so that it must not matter. The first two are shot-noise limited.
    let (signal, several) = merged([416, 2416, 4095, 4095]);
    assert!((signal - 400.0).abs() < 1.0 && several, "{signal}");
    // Only the shortest is left.
    let (signal, several) = merged([3016, 4095, 4095, 4095]);
    assert!((signal - 3000.0).abs() < 0.01 && !several, "{signal}");
    // A signal that only the longest sees: the others' numbers, which say otherwise, do not matter.
    let (signal, several) = merged([17, 17, 17, 18]);
    assert!((signal - 1.0 / 250.0).abs() < 1e-6 && !several, "{signal}");
    let (signal, _) = merged([4095; 4]);
    assert!(signal.is_nan());
}

#[test]
fn an_exposure_time_without_black_frames_is_named() {
    let rig = rig();
    let error = of_black(&rig, None, &Segment::default(), 0.25, 3).err().unwrap();
    assert!(
        error.contains("250 ms") && error.contains("found none"),
        "{error}"
    );
}
