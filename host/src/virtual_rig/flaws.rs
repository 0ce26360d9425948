//! Imperfections of the virtual rig that no rig file has, and how large they are drawn.

use std::ops::RangeInclusive;

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::crosstalk::Crosstalk;
use super::figure::Figure;
use super::knee::Knee;
use super::lag::Lag;
use super::polarisation::Polarisation;
use super::seating::Seating;
use crate::instrument::frame_format::place_of_pixel;

/// Imperfections of light, mirror and camera; none by default.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Flaws {
    /// `T_o`, throughput over the camera's image, relative.
    pub throughput: Field,
    /// `E_p`, intensity over the projector's image, relative.
    pub intensity: Field,
    /// Intensity of a black projector pixel, as a share of that of a lit one: one over the contrast.
    pub black_level: f64,
    /// How that share varies over the projector's image, relative.
    pub black: Field,
    /// Exponent of the projector's response: intensity = (level/255)^gamma; 0 stands for 1.
    pub gamma: f64,
    /// Share of a signal at saturation that the camera does not show: g = s·(1 − nonlinearity·s/full scale).
    pub nonlinearity: f64,
    /// Share of the light from the sample that mirror and optics throw back onto it, from all directions alike.
    pub interreflection: f64,
    /// By how much the reflectance of the first and of the second standard differs from what is stated, relative.
    pub standards: [f64; 2],
    /// Light that dust, roughness and coatings throw aside on the way to the camera.
    pub glare: Glare,
    /// The image that the second surface of the beam splitter makes.
    pub ghost: Ghost,
    /// Light of the projector that reaches the camera without the sample.
    pub direct: Direct,
    /// How the pixels of the camera's sensor differ from each other.
    pub pixels: Pixels,
    /// How steady the light is.
    pub lamp: Lamp,
    /// Pupils that are no points.
    pub pupils: Pupils,
    /// Slopes of the mirror beyond an ellipsoid.
    pub figure: Figure,
    /// Charge that leaks between the camera's colours.
    pub crosstalk: Crosstalk,
    /// How the camera's response bends near its full well.
    pub knee: Knee,
    /// How well things are seated in the holder.
    pub seating: Seating,
    /// How sharp the projector's image is.
    pub focus: Focus,
    /// What is left of the pattern before.
    pub lag: Lag,
    /// How far light is polarised.
    pub polarisation: Polarisation,
}

/// How sharp the projector's image is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Focus {
    /// Standard deviation of where the light of a projector pixel goes, by defocus and by leaks into its neighbours, pixels.
    pub blur_px: f64,
}

impl Focus {
    /// By chance. Its chance is its own, so that it changes no other flaw that follows from the `seed`.
    pub(super) fn drawn(seed: u64) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed ^ FOCUS_STREAM);
        Self {
            blur_px: log_uniform(BLURS_PX, &mut rng),
        }
    }
}

/// The pupils of camera and projector, whose images are what is seen and lit of the sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pupils {
    /// Diameter of the camera's, metres; if either is 0 both are points.
    pub camera_m: f64,
    /// Diameter of the projector's, metres.
    pub projector_m: f64,
    /// By which share the light of the projector's pupil is dimmer at its edge than in its middle.
    pub falloff: f64,
    /// By how much the camera's iris is turned, degrees.
    pub blades_deg: f64,
}

/// How well diameters of pupils are known, relative: f-numbers are marked to a sixth of a stop and better.
const PUPIL: f64 = 0.03;

impl Pupils {
    /// Those of lenses that are said to have these diameters.
    pub(super) fn drawn([camera_m, projector_m]: [f64; 2], rng: &mut Xoshiro256PlusPlus) -> Self {
        let mut near = |said: f64| -> f64 {
            let normal: f64 = rng.sample(rand_distr::StandardNormal);
            said * (1.0 + PUPIL * normal.clamp(-3.0, 3.0))
        };
        let [camera_m, projector_m] = [near(camera_m), near(projector_m)];
        Self {
            camera_m,
            projector_m,
            falloff: log_uniform(FALLOFFS, rng),
            blades_deg: rng.random_range(0.0..60.0),
        }
    }

    /// Whether they are more than points.
    pub(super) fn are_wide(&self) -> bool {
        self.camera_m > 0.0 && self.projector_m > 0.0
    }
}

/// The projector's lamp or LED over time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lamp {
    /// By how much its light differs from that of the rig file, as another lamp's does, relative.
    pub change: f64,
    /// By how much its light changes in an hour, relative.
    pub drift_per_h: f64,
    /// Standard deviation of the light from exposure to exposure, relative.
    pub flicker: f64,
}

/// Slow ups and downs beside the steady drift, as a share of what it does in an hour, and how many hours one takes.
const WAVE: f64 = 0.2;
const WAVE_H: f64 = 0.15;

impl Lamp {
    pub(super) fn drawn(rng: &mut Xoshiro256PlusPlus) -> Self {
        let sign = if rng.random_bool(0.7) { -1.0 } else { 1.0 };
        Self {
            change: 0.0,
            drift_per_h: sign * log_uniform(DRIFTS, rng),
            flicker: log_uniform(FLICKERS, rng),
        }
    }

    /// Its light after so many hours, relative to that of the rig file, without flicker.
    pub(super) fn level(&self, hours: f64) -> f64 {
        let wave = WAVE * (std::f64::consts::TAU * hours / WAVE_H).sin();
        (1.0 + self.change) * (1.0 + self.drift_per_h * (hours + wave))
    }
}

/// Light thrown aside: a round core with long tails, and a veil over the whole image.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Glare {
    /// Share of all light that is thrown aside.
    pub share: f64,
    /// Radius of the core, half widths of the image.
    pub core: f64,
    /// Exponent s of the tails: (1 + (r/core)²)^−s.
    pub slope: f64,
    /// Share of that light which is spread over the whole image.
    pub veil: f64,
    /// By which share the tails are brighter along one line than across it.
    pub stretch: f64,
    /// The direction of that line in the image, degrees.
    pub azimuth_deg: f64,
}

/// A second, dimmer image.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ghost {
    /// Its light over that of the first.
    pub share: f64,
    /// Where it is, half widths of the image.
    pub shift: [f64; 2],
}

/// Light that goes from the projector over the beam splitter into the camera.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Direct {
    /// Its radiance over that of a white sample that has the same light of the projector.
    pub share: f64,
    /// How it varies over the camera's image, relative.
    pub camera: Field,
    /// How it varies over the projector's image, relative.
    pub projector: Field,
}

/// What the pixels of the camera's sensor differ by, each from what a perfect one shows; terms of EMVA 1288 (release 4.0).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pixels {
    /// Seed of what differs and stays: the same sensor whatever the size of its image.
    pub seed: u64,
    /// Photo-response non-uniformity: standard deviation over the pixels of what each shows of the same light, relative.
    pub prnu: f64,
    /// Dark-signal non-uniformity: standard deviation over the pixels of their offset, electrons.
    pub dsnu_e: f64,
    /// Share of pixels that are hot: their dark currents lie between 10² and 10⁵ e⁻/s, log-uniformly.
    pub hot: f64,
    /// Standard deviation of what all pixels of a row have in common in one frame, electrons.
    pub row_noise_e: f64,
    /// Standard deviation of what the offset of all pixels is off by over the hours, as temperature changes, electrons.
    pub wander_e: f64,
}

impl Pixels {
    /// A sensor by chance. Its chance is its own, so that it changes no other flaw that follows from the `seed`.
    pub(super) fn drawn(seed: u64) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed ^ SENSOR_STREAM);
        Self {
            // Files hold no larger numbers.
            seed: rng.random::<u64>() >> 33,
            prnu: log_uniform(PRNUS, &mut rng),
            dsnu_e: log_uniform(DSNUS_E, &mut rng),
            hot: log_uniform(HOT_SHARES, &mut rng),
            row_noise_e: log_uniform(ROW_NOISES_E, &mut rng),
            wander_e: log_uniform(WANDERS_E, &mut rng),
        }
    }
}

/// Waves in which offsets wander: hours of a whole one, and its amplitude for a standard deviation of 1 in all. A camera warms up in
/// about an hour, and air conditioning goes on and off four times in one.
const OFFSET_WAVES: [[f64; 2]; 2] = [[0.9, 1.2], [0.23, 0.75]];

impl Pixels {
    /// What the offset of each pixel of the sensor is off by after so many hours, electrons.
    pub(super) fn wandered_e(&self, hours: f64) -> f64 {
        let wave = |[period_h, amplitude]: [f64; 2]| {
            // Every sensor begins elsewhere.
            amplitude * (std::f64::consts::TAU * hours / period_h + self.seed as f64 * period_h).sin()
        };
        self.wander_e * OFFSET_WAVES.map(wave).iter().sum::<f64>()
    }
}

impl Glare {
    pub(super) fn drawn(rng: &mut Xoshiro256PlusPlus) -> Self {
        Self {
            share: log_uniform(GLARES, rng),
            core: log_uniform(0.01..=0.05, rng),
            slope: rng.random_range(1.1..1.5),
            veil: rng.random_range(0.1..0.3),
            stretch: rng.random_range(0.0..0.4),
            azimuth_deg: rng.random_range(0.0..180.0),
        }
    }
}

impl Ghost {
    pub(super) fn drawn(rng: &mut Xoshiro256PlusPlus) -> Self {
        let (shift, turn) = (
            log_uniform(0.005..=0.05, rng),
            rng.random_range(0.0..std::f64::consts::TAU),
        );
        Self {
            share: log_uniform(GHOSTS, rng),
            shift: [shift * turn.cos(), shift * turn.sin()],
        }
    }
}

impl Direct {
    pub(super) fn drawn(rng: &mut Xoshiro256PlusPlus) -> Self {
        Self {
            share: log_uniform(DIRECTS, rng),
            camera: Field::drawn(0.5, rng),
            projector: Field::drawn(0.5, rng),
        }
    }
}

/// A number whose logarithm is drawn uniformly.
pub(super) fn log_uniform(range: RangeInclusive<f64>, rng: &mut Xoshiro256PlusPlus) -> f64 {
    range.start() * (range.end() / range.start()).powf(rng.random_range(0.0..1.0))
}

/// 1 + a sum of Gaussian bumps over an image.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Field {
    /// Of each: centre x and y in half widths of the image from its middle, standard width in half widths, amplitude.
    pub bumps: Vec<[f64; 4]>,
}

impl Field {
    /// The field at (`x`, `y`), each −1 to 1 over the image.
    #[must_use]
    pub fn at(&self, x: f64, y: f64) -> f64 {
        let bump = |&[cx, cy, width, amplitude]: &[f64; 4]| {
            amplitude * (-((x - cx).powi(2) + (y - cy).powi(2)) / (2.0 * width * width)).exp()
        };
        1.0 + self.bumps.iter().map(bump).sum::<f64>()
    }

    /// The field at every pixel centre of an image, row by row.
    pub(super) fn over(&self, width_px: usize, height_px: usize) -> Vec<f64> {
        (0..width_px * height_px)
            .into_par_iter()
            .map(|index| {
                let [x, y] = place_of_pixel(index, width_px, height_px);
                self.at(x, y)
            })
            .collect()
    }

    /// Bumps that make a field of ±`amplitude`, drawn from `rng`.
    pub(super) fn drawn(amplitude: f64, rng: &mut Xoshiro256PlusPlus) -> Self {
        // One broad fall-off to the border and two wide bumps: what vignetting and lamps do.
        let mut bumps = vec![[0.0, 0.0, 0.9, 1.0]];
        for _ in 0..2 {
            let (x, y) = (rng.random_range(-0.8..0.8), rng.random_range(-0.8..0.8));
            bumps.push([x, y, rng.random_range(0.4..0.7), rng.random_range(-0.8..0.8)]);
        }
        // Scaled so that the field spans just what was asked for.
        let mut field = Self { bumps };
        let values = field.over(64, 64);
        let (low, high) = values
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
                (low.min(*v), high.max(*v))
            });
        let scale = 2.0 * amplitude / (high - low);
        for bump in &mut field.bumps {
            bump[3] *= scale;
        }
        // A very wide bump is a constant: it brings the middle of the range to 1.
        let middle = 1.0 + scale * (f64::midpoint(low, high) - 1.0);
        field.bumps.push([0.0, 0.0, 1e6, 1.0 - middle]);
        field
    }
}

/// Contrasts of projectors, full on over full off: 400 is the LCD projector of the first instrument of this kind (2007), DMD
/// and LCoS projectors without a dynamic iris reach 1,000 to 3,000 (data sheets).
pub const CONTRASTS: RangeInclusive<f64> = 400.0..=3000.0;
/// Shares of glare: a clean lens has 0.1 % with a long tail, a good one about 0.3 % and a dusty one of many elements 1 % and
/// more (veiling glare index, ISO 9358).
pub const GLARES: RangeInclusive<f64> = 1e-3..=1e-2;
/// Shares of the splitter's ghost: the second surface reflects 0.5 % (V coating) to 4 % (bare glass, Fresnel's equations).
pub const GHOSTS: RangeInclusive<f64> = 5e-3..=4e-2;
/// Shares of direct light: black velvet and light traps behind a splitter return 10⁻⁴ to 3·10⁻³ of a white sample's light.
pub(super) const DIRECTS: RangeInclusive<f64> = 1e-4..=3e-3;
/// Drifts of the light in an hour: LEDs that are regulated stay within 0.2 %, a lamp that ages or warms up does not within 2 %.
pub const DRIFTS: RangeInclusive<f64> = 2e-3..=2e-2;
/// Standard deviations of the light from exposure to exposure: of a constant current 0.05 %, of a discharge lamp's arc up to 0.5 %.
pub const FLICKERS: RangeInclusive<f64> = 5e-4..=5e-3;
/// Half the range by which the light of black pixels varies over the image beside that of lit ones: black depends on the angle
/// at which light meets the modulator.
pub(super) const BLACK_FIELD: f64 = 0.2;
/// Falloffs of light over the image of a pupil: of integrators that mix the light well 2 %, without one 20 % (uniformity in data
/// sheets of projectors is that of the picture; that of a pupil is no better).
pub const FALLOFFS: RangeInclusive<f64> = 2e-2..=0.2;

/// Blur of a projector's image in pixels: a Gaussian one of 0.4 pixels has a contrast of 45 % for alternating lines of one pixel, one
/// of 0.8 has 4 %; of data sheets that say more than "lines are resolved" a third to a half is usual.
pub const BLURS_PX: RangeInclusive<f64> = 0.3..=0.8;
/// What tells the chance of a focus from that of the rest of the rig: the letters of `focus`.
const FOCUS_STREAM: u64 = 0x66_6f63_7573;
/// What tells the chance of a sensor from that of the rest of the rig: the letters of `pixels`.
const SENSOR_STREAM: u64 = 0x7069_7865_6c73;
/// PRNU of CMOS sensors with a global shutter: 0.2 to 1 %, usually 0.5 % (data sheets by EMVA 1288).
pub const PRNUS: RangeInclusive<f64> = 2e-3..=1e-2;
/// DSNU of such sensors in electrons: 0.3 to 3, usually 1 (the same data sheets).
pub(super) const DSNUS_E: RangeInclusive<f64> = 0.3..=3.0;
/// Shares of hot pixels: some ten to some thousand in a sensor of 1 to 4 million (defect maps that makers deliver).
pub(super) const HOT_SHARES: RangeInclusive<f64> = 1e-5..=1e-3;
/// Standard deviations of how the offset wanders, electrons: cameras that clamp it to masked pixels stay within a tenth of a digital
/// number of 12 bits, others move by half of one per 5 K (EMVA 1288 data sheets state the offset at two temperatures).
pub const WANDERS_E: RangeInclusive<f64> = 0.1..=1.0;
/// Dark currents of hot pixels, electrons per second.
pub(super) const HOT_E_PER_S: RangeInclusive<f64> = 1e2..=1e5;
/// Row noise of such sensors in electrons: a tenth of the read noise where rows are read well (0.1 to 0.3), as much as a third
/// of it where they are not.
pub const ROW_NOISES_E: RangeInclusive<f64> = 0.1..=1.0;
