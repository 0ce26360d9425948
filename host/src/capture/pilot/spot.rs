//! The pilot capture that chooses how wide the spots of light are.
//!
//! # Design
//! A wide spot stands out beside the light of black projector pixels, and blurs what it shows. From a few patterns with the
//! usual spot and some black ones follow, for every pixel and any other spot, the noise (signal, black light and reading out, in an
//! exposure that fills the camera) and the blur (the second difference of the image over that of directions, which says how
//! f bends; it is taken to bend over the incident directions as it does over the outgoing ones, as a function of the half
//! vector does). Of both together the median over the pixels counts, and as much their mean weighted by the signal: the one
//! knows no highlights, the other nothing else.

use std::fmt;

use super::{PILOT_TARGET, TestExposures, judged, patterns};
use crate::base::median::median;
use crate::brdf::quadrature::spot_rad;
use crate::capture::Instrument;
use crate::capture::directory::MeasurementError;
use crate::instrument::optics::{DirectionMap, View};
use crate::instrument::rig::Rig;
use crate::plan::{Request, SPOTS_DEG};

/// Black patterns, whose mean counts.
const BLACK: usize = 4;
/// Spots are tried in steps of this.
const STEP: f64 = std::f64::consts::SQRT_2;
/// The widest there is if the grid does not say, degrees.
const WIDEST_DEG: f64 = 15.0;
/// Pixels that count, about.
const PIXELS: usize = 20_000;
/// Second differences count by what they have beyond so many times their variance by noise.
const BENT: f64 = 9.0;
/// Signals below this share of the brightest say nothing of a material.
const LEAST: f64 = 1e-4;

/// A spot, and what it was chosen for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpotChoice {
    /// Its opening, degrees.
    pub spot_deg: f64,
    /// Relative noise of f with it, median over the pixels.
    pub noise: f64,
    /// Relative error by its blur, mean over the pixels weighted by their signal.
    pub blur: f64,
    /// Light of all black projector pixels over that of the spot, median over the pixels.
    pub black: f64,
    /// Relative noise with a projector of twice the contrast.
    pub noise_at_twice_the_contrast: f64,
}

impl fmt::Display for SpotChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |share: f64| format!("{:.2} %", 100.0 * share);
        write!(
            f,
            "pilot: a spot of {:.2}° leaves {} of noise (median) and {} of blur where it is bright; black projector pixels shine \
             {:.1} times as bright as it, with a projector of twice the contrast the noise would be {}",
            self.spot_deg,
            percent(self.noise),
            percent(self.blur),
            self.black,
            percent(self.noise_at_twice_the_contrast)
        )
    }
}

/// A pixel in a test exposure.
struct Pixel {
    /// Electrons of the spot and of black light.
    signal_e: f64,
    black_e: f64,
    /// Relative blur over the variance of the light along an axis, radians⁻².
    bent: f64,
}

/// The spot that leaves least, between half the usual one of `request` on `rig`, whose camera image is scaled as it will be
/// measured, and the step of the grid; `taken` is called while exposures are taken.
///
/// # Errors
/// [`MeasurementError`].
pub fn choose_spot(
    rig: &Rig,
    request: &Request,
    instrument: &mut Instrument,
    taken: &dyn Fn(),
) -> Result<SpotChoice, MeasurementError> {
    let mut all = vec![Vec::new(); BLACK];
    all.extend(patterns(rig, request, None)?);
    let tests = TestExposures::take_of(None, rig, &all, instrument, taken)?;
    let pixels = pixels(rig, &tests);
    let usual_deg = request.spot_deg(rig);
    let widest_deg = request.grid.step_deg().unwrap_or(WIDEST_DEG).min(WIDEST_DEG);
    let mut best: Option<(f64, SpotChoice)> = None;
    let mut spot_deg = (usual_deg / 2.0).max(*SPOTS_DEG.start());
    while spot_deg <= widest_deg.max(usual_deg) * (1.0 + 1e-9) {
        let light = Light {
            rig,
            exposure_s: tests.exposure_s,
            wider: (spot_deg / usual_deg).powi(2),
            contrast: 1.0,
        };
        if let Some((cost, choice)) = light.judge(&pixels, spot_deg)
            && best.is_none_or(|(least, _)| cost < least)
        {
            best = Some((cost, choice));
        }
        spot_deg *= STEP;
    }
    // Nothing was bright: as the rig has it.
    let none = SpotChoice {
        spot_deg: usual_deg,
        noise: f64::NAN,
        blur: f64::NAN,
        black: f64::NAN,
        noise_at_twice_the_contrast: f64::NAN,
    };
    Ok(best.map_or(none, |(_, choice)| choice))
}

/// Some judged pixels of the lit frames, of all channels together.
fn pixels(rig: &Rig, tests: &TestExposures) -> Vec<Pixel> {
    let camera = View::camera(rig);
    let (map, cut) = (DirectionMap::of(&camera), camera.cut_pixels(0.0));
    let channels = rig.channels();
    // An edge is no shape of a lobe.
    let whole = judged(rig).step_by(channels).zip(&cut);
    let judged: Vec<bool> = whole.map(|(judged, cut)| judged && cut.is_none()).collect();
    let light_e = |dn: &[u16]| -> Vec<f64> {
        let of = |pixel: &[u16]| {
            let sum: f64 = pixel
                .iter()
                .map(|dn| rig.light_e_per_s(*dn, tests.exposure_s) * tests.exposure_s)
                .sum();
            sum / channels as f64
        };
        dn.chunks_exact(channels).map(of).collect()
    };
    let dark: Vec<Vec<f64>> = tests.shots[..BLACK]
        .iter()
        .map(|shot| light_e(&shot.dn))
        .collect();
    let black: Vec<f64> = (0..judged.len())
        .map(|pixel| dark.iter().map(|frame| frame[pixel]).sum::<f64>() / BLACK as f64)
        .collect();
    let lit = &tests.shots[BLACK..];
    let every = (judged.len() * lit.len() / PIXELS).max(1) | 1;
    let read_e2 = rig.dark_variance_e2(tests.exposure_s);
    let mut found = Vec::new();
    for (number, shot) in lit.iter().enumerate() {
        let all = light_e(&shot.dn);
        let signal: Vec<f64> = all.iter().zip(&black).map(|(all, black)| all - black).collect();
        let brightest = signal.iter().copied().fold(0.0, f64::max);
        let width = map.width_px;
        for pixel in (number % every..judged.len()).step_by(every) {
            let (x, y) = (pixel % width, pixel / width);
            let inside = (1..width - 1).contains(&x) && (1..map.height_px - 1).contains(&y);
            let is_seen = |at: usize| judged[at];
            if !inside
                || ![pixel, pixel - 1, pixel + 1, pixel - width, pixel + width]
                    .into_iter()
                    .all(is_seen)
            {
                continue;
            }
            let value = signal[pixel];
            if value <= LEAST * brightest {
                continue;
            }
            // Of a mean over the channels.
            let variance = (all[pixel].max(0.0) + read_e2) / channels as f64;
            let bend = |step: usize| {
                let second = signal[pixel - step] + signal[pixel + step] - 2.0 * value;
                (second * second - BENT * 6.0 * variance).max(0.0).sqrt()
            };
            let pixel_sr = map.solid_angles_sr[pixel];
            found.push(Pixel {
                signal_e: value,
                black_e: black[pixel].max(0.0),
                bent: 0.5 * (bend(1) + bend(width)) / (value * pixel_sr),
            });
        }
    }
    found
}

/// A light that is tried.
#[derive(Clone, Copy)]
struct Light<'a> {
    rig: &'a Rig,
    /// Of the test exposures, seconds.
    exposure_s: f64,
    /// Light of the spot, and contrast, over those of the test exposures.
    wider: f64,
    contrast: f64,
}

impl Light<'_> {
    /// The time of an exposure that fills the camera, over that of the test exposures.
    fn longer(&self, pixels: &[Pixel]) -> f64 {
        let brightest_e = pixels
            .iter()
            .map(|pixel| self.wider * pixel.signal_e + pixel.black_e / self.contrast)
            .fold(1.0, f64::max);
        let camera = &self.rig.camera;
        (PILOT_TARGET * camera.full_well_e / brightest_e).min(camera.exposure_s / self.exposure_s)
    }

    /// Relative noise of every pixel.
    fn noise(&self, pixels: &[Pixel]) -> Vec<f64> {
        let longer = self.longer(pixels);
        let read_e2 = self.rig.dark_variance_e2(self.exposure_s * longer);
        let of = |pixel: &Pixel| {
            let signal_e = longer * self.wider * pixel.signal_e;
            (signal_e + longer * pixel.black_e / self.contrast + read_e2).sqrt() / signal_e
        };
        pixels.iter().map(of).collect()
    }

    /// What it costs to light spots of `spot_deg` degrees with it; `None` without pixels.
    fn judge(&self, pixels: &[Pixel], spot_deg: f64) -> Option<(f64, SpotChoice)> {
        let variance = spot_rad(spot_deg).powi(2);
        let noise = self.noise(pixels);
        let blur: Vec<f64> = pixels.iter().map(|pixel| pixel.bent * variance).collect();
        let weighted = |of: &[f64]| {
            let sum: f64 = of
                .iter()
                .zip(pixels)
                .map(|(value, pixel)| value * pixel.signal_e)
                .sum();
            sum / pixels.iter().map(|pixel| pixel.signal_e).sum::<f64>()
        };
        let both: Vec<f64> = noise
            .iter()
            .zip(&blur)
            .map(|(noise, blur)| noise.hypot(*blur))
            .collect();
        let cost = median(both.clone())? + weighted(&both);
        let better = Self {
            contrast: 2.0,
            ..*self
        };
        let choice = SpotChoice {
            spot_deg,
            noise: median(noise)?,
            blur: weighted(&blur),
            black: median(
                pixels
                    .iter()
                    .map(|pixel| pixel.black_e / (self.wider * pixel.signal_e))
                    .collect(),
            )?,
            noise_at_twice_the_contrast: median(better.noise(pixels))?,
        };
        Some((cost, choice))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixels(bent: f64) -> Vec<Pixel> {
        let one = |at: usize| Pixel {
            signal_e: 1000.0 + at as f64,
            black_e: 9000.0,
            bent,
        };
        (0..100).map(one).collect()
    }

    fn best(bent: f64) -> SpotChoice {
        let rig = Rig::load("rcg-3").unwrap();
        let of = |step: i32| {
            let spot_deg = 0.5 * STEP.powi(step);
            let light = Light {
                rig: &rig,
                exposure_s: 0.001,
                wider: spot_deg * spot_deg,
                contrast: 1.0,
            };
            light.judge(&pixels(bent), spot_deg).unwrap()
        };
        let all = (0..10).map(of);
        all.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap().1
    }

    #[test]
    fn the_smoother_the_material_the_wider_the_spot() {
        let [flat, wide, sharp] = [0.0, 30.0, 30_000.0].map(best);
        assert!(flat.spot_deg > 10.0, "{flat:?}");
        assert!((1.0..10.0).contains(&wide.spot_deg), "{wide:?}");
        assert!(sharp.spot_deg < 1.0, "{sharp:?}");
        // Nine times the light of a spot of 1° is black light.
        assert!(
            (sharp.black * sharp.spot_deg.powi(2) / 8.6 - 1.0).abs() < 0.1,
            "{sharp:?}"
        );
        assert!(sharp.noise_at_twice_the_contrast < 0.8 * sharp.noise, "{sharp:?}");
        assert!(
            sharp
                .to_string()
                .contains("with a projector of twice the contrast"),
            "{sharp}"
        );
    }
}
