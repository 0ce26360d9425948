//! The camera by itself: dark level, photon transfer, linearity.
//!
//! # Design
//! Photon transfer (Janesick, Photon Transfer, SPIE 2007): over repeated exposures the variance of a pixel is
//! `σ_read² + signal/gain + 1/6`, the last for rounding with dither. Dark frames say what it is without signal. Pixels of all
//! exposure times are binned by their mean; the line is fitted to the bins with weights of the variance's own variance. The
//! series has the standard in the light, so that the bins reach from darkness to near saturation.
//!
//! The lamp flickers: of frames of one pattern each is as bright as all its pixels together say, before they are compared. Where the bands
//! of a frame are lit one after the other, those of each band say it of that band.
//!
//! Linearity: what a pixel shows of light, over the exposure time, must be constant; light of black projector pixels is as
//! good as that of the spot. The camera is described by one number β: of a signal s it shows s·(1 − β·s/range), and
//! s'·(1 + β·s'/range) brings it back to first order. All pixels together determine β by least squares, each with a rate of
//! its own. Up to where that holds is told by `knee`.

use super::knee::linear_to;
use super::pixels::{DarkPattern, Layout};
use crate::instrument::calibration::CameraFound;
use crate::instrument::rig::ROUNDING_DN2;

use crate::calibrate::CalibrateError;

/// Bins of the photon-transfer curve.
const BINS: usize = 40;
/// Flicker of a steady lamp, relative: noise below that does not make frames count more.
const STEADY: f64 = 1e-3;
/// Fewest pixels in a bin that counts.
const FEWEST: u32 = 50;
/// Share of the range up to which signals count: what comes above bends by a law of its own.
const HIGHEST: f64 = 0.88;

/// Share of the range above which a pixel shows linearity.
const SHOWN: f64 = 0.05;
/// Exposure times in which a pixel is bright that shows linearity, and how many such pixels there must be.
const LEAST_TIMES: usize = 3;
const BRIGHT: usize = 10;

/// Frames of one exposure time, [frame][pixel × channel], digital numbers.
pub(super) struct Times<'a> {
    pub(super) exposure_s: f64,
    pub(super) lit: Vec<&'a [u16]>,
    pub(super) black: Vec<&'a [u16]>,
    pub(super) dark: Vec<&'a [u16]>,
    /// Light of the lamp in the lit frames, relative to the other times: one for all channels, or one for each where bands are lit one
    /// after the other.
    pub(super) lamp: Vec<f64>,
}

impl Times<'_> {
    /// The lamp in a band over that in the first.
    pub(super) fn beside_the_first(&self, band: usize) -> f64 {
        self.lamp[band] / self.lamp[0]
    }
}

/// Light of each of `frames` of one pattern over their mean, as far as it is more than their noise, of a band (number, of how many);
/// `dark` is their level without light.
fn lamp_of(frames: &[&[u16]], dark: f64, band: (usize, usize)) -> Vec<f64> {
    let Some((light, noise2)) = light_of(frames, dark, band) else {
        return vec![1.0; frames.len()];
    };
    let squares: f64 = light.iter().map(|light| (light - 1.0).powi(2)).sum();
    let trust = (1.0 - noise2 * (light.len() as f64 - 1.0) / squares).max(0.0);
    light
        .into_iter()
        .map(|light| (1.0 + trust * (light - 1.0)).max(0.1))
        .collect()
}

/// Light of each of `frames` of one pattern over their mean, and the variance of that by the noise of their pixels, of a band; `None` if
/// there is no light.
fn light_of(frames: &[&[u16]], dark: f64, (band, bands): (usize, usize)) -> Option<(Vec<f64>, f64)> {
    let light = |frame: &&[u16]| {
        let of_band = frame.iter().skip(band).step_by(bands);
        of_band.map(|dn| f64::from(*dn) - dark).sum::<f64>()
    };
    let all: Vec<f64> = frames.iter().map(light).collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    let noise: f64 = moments(frames).1.iter().skip(band).step_by(bands).sum();
    (mean > 0.0).then(|| {
        (
            all.iter().map(|light| light / mean).collect(),
            noise / (mean * mean),
        )
    })
}

/// As [`moments`], had the lamp been as bright in all frames, in each of so many `bands`; `dark` is their level without light.
fn steady(frames: &[&[u16]], dark: f64, bands: usize) -> (Vec<f64>, Vec<f64>) {
    let lamp: Vec<Vec<f64>> = (0..bands)
        .map(|band| lamp_of(frames, dark, (band, bands)))
        .collect();
    moments_of(frames, |frame, at, dn| {
        dark + (dn - dark) / lamp[at % bands][frame]
    })
}

/// Standard deviation of the lamp's light from exposure to exposure, relative, by the brighter half of the series: frames count as much
/// as their noise lets them tell.
pub(super) fn flicker(series: &[Times], dark: f64) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    let bright = series[series.len() / 2..].iter();
    let bands = series[0].lamp.len();
    let of_bands = bright
        .flat_map(|times| [&times.lit, &times.black])
        .flat_map(|frames| (0..bands).map(move |band| (frames, band)));
    for (frames, band) in of_bands {
        let Some((light, noise2)) = light_of(frames, dark, (band, bands)) else {
            continue;
        };
        let squares: f64 = light.iter().map(|light| (light - 1.0).powi(2)).sum();
        let degrees = light.len() as f64 - 1.0;
        let weight = (noise2 + STEADY * STEADY).powi(-2);
        sum += weight * (squares - degrees * noise2);
        weights += weight * degrees;
    }
    if weights > 0.0 {
        (sum / weights).max(0.0).sqrt()
    } else {
        0.0
    }
}

/// Mean and unbiased variance of each value over frames.
pub(super) fn moments(frames: &[&[u16]]) -> (Vec<f64>, Vec<f64>) {
    moments_of(frames, |_, _, dn| dn)
}

/// The same of what `of` makes of the number of a frame at a place.
fn moments_of(frames: &[&[u16]], of: impl Fn(usize, usize, f64) -> f64) -> (Vec<f64>, Vec<f64>) {
    let count = frames.len() as f64;
    (0..frames[0].len())
        .map(|at| {
            let all = || {
                let frames = frames.iter().enumerate();
                frames.map(|(number, frame)| of(number, at, f64::from(frame[at])))
            };
            let mean = all().sum::<f64>() / count;
            let squares = all().map(|dn| (dn - mean).powi(2));
            (mean, squares.sum::<f64>() / (count - 1.0))
        })
        .unzip()
}

/// What the series says of the camera but for the response of its pixels; `saturation_dn` is its largest number.
///
/// # Errors
/// [`CalibrateError::Views`] if noise or brightness of the series say nothing.
pub(super) fn camera(
    series: &[Times],
    saturation_dn: f64,
    layout: &Layout,
) -> Result<CameraFound, CalibrateError> {
    let (dark_dn, dark_dn_per_s) = dark(series);
    let range = saturation_dn - dark_dn;
    let pattern = DarkPattern::of(series, layout);
    let transfer = photon_transfer(series, (dark_dn, dark_dn_per_s), range, pattern.row_dn2);
    let (gain_e_per_dn, read_noise_dn) = transfer.ok_or_else(|| CalibrateError::Views {
        expected: "frames whose noise grows with the light".to_owned(),
        found: "noise that does not".to_owned(),
        advice: "take them with --noise on, with more pixels, and with the standard in place",
    })?;
    let mut found = CameraFound {
        dark_dn,
        dark_dn_per_s,
        gain_e_per_dn,
        read_noise_e: read_noise_dn * gain_e_per_dn,
        nonlinearity: 0.0,
        linearity_residual: 0.0,
        linear_to: 1.0,
        prnu: 0.0,
        prnu_is_assumed: false,
        row_noise_e: pattern.row_dn2.sqrt() * gain_e_per_dn,
        dsnu_e: pattern.offset_dn2.sqrt() * gain_e_per_dn,
        hot: pattern.hot,
    };
    set_linearity(&mut found, series, saturation_dn)?;
    Ok(found)
}

/// Finds how linear the camera `found` is, with the lamp as the `series` knows it.
///
/// # Errors
/// [`CalibrateError::Views`] if too little of the series is bright.
pub(super) fn set_linearity(
    found: &mut CameraFound,
    series: &[Times],
    saturation_dn: f64,
) -> Result<(), CalibrateError> {
    let dark = (found.dark_dn, found.dark_dn_per_s);
    let linearity = linearity(series, dark, saturation_dn - found.dark_dn, found.gain_e_per_dn);
    (found.nonlinearity, found.linearity_residual) = linearity.ok_or_else(|| CalibrateError::Views {
        expected: format!(
            "{BRIGHT} pixels or more that the light brings above a twentieth of the range in {LEAST_TIMES} exposure times"
        ),
        found: "fewer".to_owned(),
        advice: "take them with a longer --exposure-ms, with more light, or with a brighter --standard",
    })?;
    let range = saturation_dn - found.dark_dn;
    let beta = found.nonlinearity;
    found.linear_to = linear_to(series, dark, range, |signal| {
        signal * (1.0 + beta * signal / range)
    });
    Ok(())
}

/// Level and slope over time of the dark frames' mean.
fn dark(series: &[Times]) -> (f64, f64) {
    let mean = |times: &Times| {
        let (mean, _) = moments(&times.dark);
        mean.iter().sum::<f64>() / mean.len() as f64
    };
    let points: Vec<(f64, f64)> = series
        .iter()
        .map(|times| (times.exposure_s, mean(times)))
        .collect();
    line(&points.iter().map(|&(x, y)| (x, y, 1.0)).collect::<Vec<_>>())
}

/// Intercept and slope of the weighted line through points (x, y, weight).
fn line(points: &[(f64, f64, f64)]) -> (f64, f64) {
    let sum = |of: &dyn Fn(f64, f64) -> f64| points.iter().map(|&(x, y, w)| w * of(x, y)).sum::<f64>();
    let (w, wx, wy) = (sum(&|_, _| 1.0), sum(&|x, _| x), sum(&|_, y| y));
    let (wxx, wxy) = (sum(&|x, _| x * x), sum(&|x, y| x * y));
    let slope = (w * wxy - wx * wy) / (w * wxx - wx * wx);
    ((wy - slope * wx) / w, slope)
}

/// Gain in electrons per digital number and read noise in digital numbers, without that of rows, which has the variance
/// `row_dn2`; `None` if the noise does not show them.
fn photon_transfer(series: &[Times], dark: (f64, f64), range: f64, row_dn2: f64) -> Option<(f64, f64)> {
    let (dark_dn, dark_dn_per_s) = dark;
    let mut bins = vec![(0.0, 0.0, 0_u32); BINS];
    for times in series {
        let level = dark_dn + dark_dn_per_s * times.exposure_s;
        for (mean, variance) in [
            steady(&times.lit, level, times.lamp.len()),
            steady(&times.black, level, times.lamp.len()),
            moments(&times.dark),
        ] {
            for (mean, variance) in mean.into_iter().zip(variance) {
                let share = ((mean - dark_dn) / range).max(0.0);
                if share < HIGHEST {
                    // Square roots spread the dark end, where most pixels are.
                    let bin = &mut bins[(share.sqrt() * BINS as f64) as usize];
                    *bin = (bin.0 + mean - dark_dn, bin.1 + variance, bin.2 + 1);
                }
            }
        }
    }
    let points: Vec<(f64, f64, f64)> = bins
        .into_iter()
        .filter(|bin| bin.2 >= FEWEST)
        .map(|(signal, variance, count)| {
            let (signal, variance) = (signal / f64::from(count), variance / f64::from(count));
            (signal, variance, f64::from(count) / variance.max(0.1).powi(2))
        })
        .collect();
    let (_, slope) = line(&points);
    // Without signal: the dark frames of all times, less the shot noise of the dark current.
    let mut without = 0.0;
    for times in series {
        let (_, variance) = moments(&times.dark);
        let mean = variance.iter().sum::<f64>() / variance.len() as f64;
        without += mean - slope * (dark_dn_per_s * times.exposure_s).max(0.0);
    }
    without /= series.len() as f64;
    // With a single bin there is no line, and no number.
    (slope > 0.0 && slope.is_finite())
        .then(|| (slope.recip(), (without - row_dn2 - ROUNDING_DN2).max(0.0).sqrt()))
}

/// What a pixel shows of light, how far nonlinearity of β = 1 bends it, and its weight.
type Signal = (f64, f64, f64);

/// β and what deviation is left; `None` if too few pixels are bright enough. `dark` is the level without light and its slope
/// over time.
fn linearity(series: &[Times], dark: (f64, f64), range: f64, gain: f64) -> Option<(f64, f64)> {
    // Per exposure time and pixel.
    let mut signals: Vec<(f64, Vec<Signal>)> = series
        .iter()
        .map(|times| {
            // As if the lamp had been as bright in all bands as in the first.
            let one = |(at, lit): (usize, f64)| {
                let (dark_dn, per_s) = dark;
                let lamp = times.beside_the_first(at % times.lamp.len());
                let signal = lit - dark_dn;
                let weight = if signal < HIGHEST * range {
                    gain / signal.max(1.0)
                } else {
                    0.0
                };
                let light = signal - per_s * times.exposure_s;
                (light / lamp, signal * signal / range / lamp, weight * lamp * lamp)
            };
            let (lit, _) = moments(&times.lit);
            (
                times.exposure_s * times.lamp[0],
                lit.into_iter().enumerate().map(one).collect(),
            )
        })
        .collect();
    let pixels = signals[0].1.len();
    for pixel in 0..pixels {
        // By all times together: to choose by its own noise would bend the line.
        let (light, time) = signals.iter().fold((0.0, 0.0), |sum, (t, all)| {
            let (signal, _, weight) = all[pixel];
            (sum.0 + weight * t * signal, sum.1 + weight * t * t)
        });
        for (t, all) in &mut signals {
            if light * *t < SHOWN * range * time {
                all[pixel].2 = 0.0;
            }
        }
    }
    let (mut ab, mut bb, mut bright) = (0.0, 0.0, 0);
    for pixel in 0..pixels {
        let points = || {
            signals
                .iter()
                .map(|(t, all)| (all[pixel].0 / t, all[pixel].1 / t, all[pixel].2 * t * t))
        };
        let weight: f64 = points().map(|p| p.2).sum();
        if points().filter(|p| p.2 > 0.0).count() < LEAST_TIMES {
            continue;
        }
        bright += 1;
        let a_mean = points().map(|p| p.0 * p.2).sum::<f64>() / weight;
        let b_mean = points().map(|p| p.1 * p.2).sum::<f64>() / weight;
        for (a, b, w) in points() {
            ab += w * (a - a_mean) * (b - b_mean);
            bb += w * (b - b_mean) * (b - b_mean);
        }
    }
    if bright < BRIGHT || bb <= 0.0 {
        return None;
    }
    let beta = -ab / bb;
    // The mean rate of the pixels that are good at a time, against their own mean over all times.
    let mut worst = 0.0_f64;
    for (t, all) in &signals {
        let (mut sum, mut expected) = (0.0, 0.0);
        for (pixel, &(signal, bend, weight)) in all.iter().enumerate().filter(|(_, one)| one.2 > 0.0) {
            let good = || signals.iter().filter(move |(_, all)| all[pixel].2 > 0.0);
            let rate = |t: f64, one: Signal| (one.0 + beta * one.1) / t;
            let mean = good().map(|(t, all)| rate(*t, all[pixel])).sum::<f64>() / good().count() as f64;
            sum += rate(*t, (signal, bend, weight));
            expected += mean;
        }
        if expected > 0.0 {
            worst = worst.max((sum / expected - 1.0).abs());
        }
    }
    Some((beta, worst))
}
