//! How a virtual rig really is: what its rig file says and what it does not.
//!
//! # Design
//! A measurement knows the *nominal* rig, or the one that a calibration made of it. The virtual rig is built from a
//! [`Truth`]: another rig, which may differ in pose, distortion, mirror and sample, and [`Flaws`] that no rig file has.
//! Plan, assembly and calibration never read it. A truth is a TOML file with the tables `rig` and `flaws`.
//!
//! The fields are sums of Gaussian bumps and the calibration's are not, so that it cannot be right by construction.

use std::ops::RangeInclusive;
use std::path::Path;

use rand::{RngExt as _, SeedableRng as _};
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};

use crate::instrument::rig::{Lens, Rig, RigError, explain};

/// Version of a truth's file: 2 has glare, ghost and direct light, 1 (which does not say so) has not.
const VERSION: u32 = 2;

/// A virtual rig as it really is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Truth {
    /// Version of this file.
    #[serde(default)]
    pub version: u32,
    /// Its true geometry, camera and light.
    pub rig: Rig,
    /// What no rig file says.
    #[serde(default)]
    pub flaws: Flaws,
}

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
    /// Light that dust, roughness and coatings throw aside on the way to the camera.
    pub glare: Glare,
    /// The image that the second surface of the beam splitter makes.
    pub ghost: Ghost,
    /// Light of the projector that reaches the camera without the sample.
    pub direct: Direct,
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

impl Glare {
    fn drawn(rng: &mut Xoshiro256PlusPlus) -> Self {
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
    fn drawn(rng: &mut Xoshiro256PlusPlus) -> Self {
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
    fn drawn(rng: &mut Xoshiro256PlusPlus) -> Self {
        Self {
            share: log_uniform(DIRECTS, rng),
            camera: Field::drawn(0.5, rng),
            projector: Field::drawn(0.5, rng),
        }
    }
}

/// A number whose logarithm is drawn uniformly.
fn log_uniform(range: RangeInclusive<f64>, rng: &mut Xoshiro256PlusPlus) -> f64 {
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
        let half = |index: usize, size: usize| 2.0 * (index as f64 + 0.5) / size as f64 - 1.0;
        (0..width_px * height_px)
            .map(|index| {
                self.at(
                    half(index % width_px, width_px),
                    half(index / width_px, height_px),
                )
            })
            .collect()
    }

    /// Bumps that make a field of ±`amplitude`, drawn from `rng`.
    fn drawn(amplitude: f64, rng: &mut Xoshiro256PlusPlus) -> Self {
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

/// How far a drawn truth strays from the nominal rig, as standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerances {
    /// Each coordinate of the optical centres of camera and projector and of the sample's centre, metres.
    pub position_m: f64,
    /// Each rotation of camera, projector, sample and the mirror's edges, degrees.
    pub angle_deg: f64,
    /// Half the range of the fields of throughput and intensity, relative: not a deviation but what is reached.
    pub field: f64,
    /// Light of a lit projector pixel over that of a black one; `None` draws it from [`CONTRASTS`], log-uniformly.
    pub contrast: Option<f64>,
    /// Share of light that is thrown aside; `None` draws it from [`GLARES`], log-uniformly.
    pub glare: Option<f64>,
    /// Light of the ghost over that of the image; `None` draws it from [`GHOSTS`], log-uniformly.
    pub ghost: Option<f64>,
    /// Radiance of direct light over that of a white sample; `None` draws it between 10⁻⁴ and 3·10⁻³, log-uniformly.
    pub direct: Option<f64>,
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
/// Half the range by which the light of black pixels varies over the image beside that of lit ones: black depends on the angle
/// at which light meets the modulator.
const BLACK_FIELD: f64 = 0.2;

impl Truth {
    /// A rig that is truly as `rig` says.
    #[must_use]
    pub fn of(rig: &Rig) -> Self {
        Self {
            version: VERSION,
            rig: rig.clone(),
            flaws: Flaws::default(),
        }
    }

    /// A rig that strays from `nominal` by chance, within `tolerances`.
    ///
    /// # Errors
    /// [`RigError::Field`] if the tolerances lead to a rig that cannot be built.
    pub fn drawn(nominal: &Rig, tolerances: Tolerances, seed: u64) -> Result<Self, RigError> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut rig = nominal.clone();
        let Tolerances {
            position_m,
            angle_deg,
            field,
            contrast,
            glare,
            ghost,
            direct,
        } = tolerances;
        // Shapes and lenses are made better than they are mounted: a tenth of the way in the same proportion.
        let relative = position_m / nominal.mirror.a_m;
        let mut normal = || -> f64 { rng.sample(StandardNormal) };
        let mut stray = |lens: &mut Lens| {
            for at in 0..3 {
                lens.offset_m[at] += position_m * normal();
                lens.rotation_deg[at] += angle_deg * normal();
            }
            lens.focal_px *= 1.0 + 0.1 * relative * normal();
            for at in 0..2 {
                lens.centre_px[at] += 0.1 * relative * f64::from(lens.width_px) * normal();
            }
            for (k, size) in lens.distortion.iter_mut().zip([0.02, 0.02, 2e-4, 2e-4, 0.0]) {
                *k += size * normal();
            }
        };
        stray(&mut rig.camera.lens);
        stray(&mut rig.projector.lens);
        rig.mirror.a_m *= 1.0 + 0.1 * relative * normal();
        rig.mirror.b_m *= 1.0 + 0.1 * relative * normal();
        rig.mirror.edge_rotation_deg = nominal
            .mirror
            .edge_rotation_deg
            .map(|deg| deg + angle_deg * normal());
        rig.sample.offset_m = nominal.sample.offset_m.map(|m| m + position_m * normal());
        rig.sample.tilt_deg += angle_deg * normal();
        rig.sample.roll_deg += angle_deg * normal();
        rig.sample.azimuth_deg += angle_deg * normal();
        rig.light.full_scale_f_sr *= 1.0 + 0.1 * normal();
        rig.camera.read_noise_e *= 1.0 + 0.1 * normal().clamp(-3.0, 3.0);
        rig.camera.full_well_e *= 1.0 + 0.05 * normal().clamp(-3.0, 3.0);
        rig.validate()?;
        let (throughput, intensity) = (Field::drawn(field, &mut rng), Field::drawn(field, &mut rng));
        let drawn = log_uniform(CONTRASTS, &mut rng);
        let mut flaws = Flaws {
            throughput,
            intensity,
            black_level: contrast.unwrap_or(drawn).recip(),
            black: Field::drawn(BLACK_FIELD, &mut rng),
            gamma: 2.2,
            nonlinearity: 0.01,
            interreflection: 0.005,
            glare: Glare::drawn(&mut rng),
            ghost: Ghost::drawn(&mut rng),
            direct: Direct::drawn(&mut rng),
        };
        flaws.glare.share = glare.unwrap_or(flaws.glare.share);
        flaws.ghost.share = ghost.unwrap_or(flaws.ghost.share);
        flaws.direct.share = direct.unwrap_or(flaws.direct.share);
        Ok(Self {
            version: VERSION,
            rig,
            flaws,
        })
    }

    /// Reads the truth at `path`.
    ///
    /// # Errors
    /// [`RigError`], one sentence.
    pub fn load(path: &Path) -> Result<Self, RigError> {
        let text = crate::base::text::read(path).map_err(|found| RigError::Unreadable {
            path: path.to_path_buf(),
            found: found.into(),
        })?;
        let truth: Self = toml::from_str(&text).map_err(|error| explain(&text, path, &error))?;
        truth.check(path)?;
        Ok(truth)
    }

    /// Refuses another version, and flaws that nothing real has; `path` is where it was read.
    fn check(&self, path: &Path) -> Result<(), RigError> {
        let refuse = |field: &str, expected: String, found: String| RigError::Field {
            path: path.to_path_buf(),
            field: field.to_owned(),
            expected,
            found,
        };
        if self.version != VERSION {
            let expected = format!(
                "{VERSION}, which also has glare, the splitter's ghost and direct light; `rcg truth` draws one"
            );
            let found = if self.version == 0 {
                "none".to_owned()
            } else {
                self.version.to_string()
            };
            return Err(refuse("version", expected, found));
        }
        self.rig.validate()?;
        let Flaws {
            glare, ghost, direct, ..
        } = &self.flaws;
        let of_glare = |low: f64| if glare.share > 0.0 { low } else { 0.0 };
        for (field, found, low, high) in [
            ("flaws.black_level", self.flaws.black_level, 0.0, 1.0),
            ("flaws.gamma", self.flaws.gamma, 0.0, 10.0),
            ("flaws.nonlinearity", self.flaws.nonlinearity, -0.49, 0.49),
            ("flaws.interreflection", self.flaws.interreflection, 0.0, 0.5),
            ("flaws.glare.share", glare.share, 0.0, 0.5),
            ("flaws.glare.core", glare.core, of_glare(1e-4), 1.0),
            ("flaws.glare.slope", glare.slope, of_glare(0.1), 10.0),
            ("flaws.glare.veil", glare.veil, 0.0, 1.0),
            ("flaws.glare.stretch", glare.stretch, 0.0, 1.0),
            ("flaws.ghost.share", ghost.share, 0.0, 0.5),
            ("flaws.ghost.shift[0]", ghost.shift[0], -1.0, 1.0),
            ("flaws.ghost.shift[1]", ghost.shift[1], -1.0, 1.0),
            ("flaws.direct.share", direct.share, 0.0, 1.0),
        ] {
            if !(low..=high).contains(&found) {
                return Err(refuse(
                    field,
                    format!("a number from {low} to {high}"),
                    found.to_string(),
                ));
            }
        }
        Ok(())
    }

    /// The truth as TOML that [`Truth::load`] reads back to the same numbers.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("invariant: a truth is tables of numbers, strings and flags")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drawn_truth_strays_as_far_as_it_may_and_reads_back() {
        let nominal = Rig::load("rcg-1").unwrap();
        let tolerances = Tolerances {
            position_m: 1e-3,
            angle_deg: 0.5,
            field: 0.3,
            contrast: None,
            glare: None,
            ghost: None,
            direct: None,
        };
        let mut squares = 0.0;
        for seed in 0..50 {
            let truth = Truth::drawn(&nominal, tolerances, seed).unwrap();
            squares += truth.rig.camera.lens.offset_m.map(|m| m * m).iter().sum::<f64>();
            assert!(CONTRASTS.contains(&truth.flaws.black_level.recip()));
            assert!(GLARES.contains(&truth.flaws.glare.share) && GHOSTS.contains(&truth.flaws.ghost.share));
            truth.check(Path::new("truth.toml")).unwrap();
            for field in [&truth.flaws.throughput, &truth.flaws.intensity] {
                let values = field.over(64, 64);
                let extreme = |pick: fn(f64, f64) -> f64, from| values.iter().copied().fold(from, pick);
                assert!((extreme(f64::max, 0.0) - 1.3).abs() < 1e-9);
                assert!((extreme(f64::min, 9.0) - 0.7).abs() < 1e-9);
            }
        }
        let rms_m = (squares / 150.0).sqrt();
        assert!((rms_m / 1e-3 - 1.0).abs() < 0.2, "{rms_m}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.toml");
        let truth = Truth::drawn(&nominal, tolerances, 7).unwrap();
        std::fs::write(&path, truth.to_toml()).unwrap();
        assert_eq!(Truth::load(&path).unwrap(), truth);
    }
}
