//! How a virtual rig really is: what its rig file says and what it does not.
//!
//! # Design
//! A measurement knows the *nominal* rig, or the one that a calibration made of it. The virtual rig is built from a
//! [`Truth`]: another rig, which may differ in pose, distortion, mirror and sample, and [`Flaws`] that no rig file has.
//! Plan, assembly and calibration never read it. A truth is a TOML file with the tables `rig` and `flaws`.
//!
//! The fields are sums of Gaussian bumps and the calibration's are not, so that it cannot be right by construction.

use std::path::Path;
use std::sync::Arc;

use rand::{RngExt as _, SeedableRng as _};
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};

use crate::brdf::sample::Sample;
use crate::instrument::rig::{Lens, Rig, RigError, explain};

use super::flaws::Flaws;
use super::held::Off;
use super::tolerances::Tolerances;

/// Version of a truth's file; 1 does not say so.
const VERSION: u32 = 9;
/// What came with each later version.
const NEWS: [(u32, &str); 8] = [
    (2, "glare, the splitter's ghost and direct light"),
    (
        3,
        "the lamp's drift and flicker and pixels of the camera that differ",
    ),
    (4, "pupils, whose images are what is seen and lit of the sample"),
    (
        5,
        "the mirror's figure and the bend of the camera's response near its full well",
    ),
    (
        6,
        "how well things are seated in the holder, how sharp the projector is and how the camera's offset wanders",
    ),
    (7, "charge that leaks between the camera's colours"),
    (8, "the lag of liquid crystals and how far light is polarised"),
    (9, "how far the flat mirror leans from the tilt that was set"),
];

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

impl Truth {
    /// A rig that is truly as `rig` says.
    #[must_use]
    pub fn of(rig: &Rig) -> Self {
        Self {
            version: VERSION,
            rig: rig.clone(),
            flaws: Flaws {
                black_level: rig.projector.contrast.map_or(0.0, f64::recip),
                ..Flaws::default()
            },
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
            ..
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
        let flaws = tolerances.flaws(nominal, seed, &mut rng);
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

    /// What was expected and found, if this is no truth of this version.
    fn other_version(&self) -> Option<(String, String)> {
        if self.version == VERSION {
            return None;
        }
        let news = NEWS.iter().filter(|(since, _)| *since > self.version);
        let news: Vec<&str> = news.map(|(_, what)| *what).collect();
        let also = if news.is_empty() {
            String::new()
        } else {
            format!(", which also has {}", news.join(", and "))
        };
        let found = match self.version {
            0 => "none".to_owned(),
            version => version.to_string(),
        };
        Some((format!("{VERSION}{also}; `rcg truth` draws one"), found))
    }

    /// Refuses another version, and flaws that nothing real has; `path` is where it was read.
    fn check(&self, path: &Path) -> Result<(), RigError> {
        let refuse = |field: &str, expected: String, found: String| RigError::Field {
            path: path.to_path_buf(),
            field: field.to_owned(),
            expected,
            found,
        };
        if let Some((expected, found)) = self.other_version() {
            return Err(refuse("version", expected, found));
        }
        self.rig.validate()?;
        let Flaws {
            glare,
            ghost,
            direct,
            lamp,
            pixels,
            pupils,
            figure,
            knee,
            crosstalk,
            seating,
            focus,
            lag,
            polarisation,
            ..
        } = &self.flaws;
        let of_glare = |low: f64| if glare.share > 0.0 { low } else { 0.0 };
        for (field, found, low, high) in [
            ("flaws.black_level", self.flaws.black_level, 0.0, 1.0),
            ("flaws.gamma", self.flaws.gamma, 0.0, 10.0),
            ("flaws.nonlinearity", self.flaws.nonlinearity, -0.49, 0.49),
            ("flaws.interreflection", self.flaws.interreflection, 0.0, 0.5),
            ("flaws.standards[0]", self.flaws.standards[0], -0.5, 0.5),
            ("flaws.standards[1]", self.flaws.standards[1], -0.5, 0.5),
            ("flaws.glare.share", glare.share, 0.0, 0.5),
            ("flaws.glare.core", glare.core, of_glare(1e-4), 1.0),
            ("flaws.glare.slope", glare.slope, of_glare(0.1), 10.0),
            ("flaws.glare.veil", glare.veil, 0.0, 1.0),
            ("flaws.glare.stretch", glare.stretch, 0.0, 1.0),
            ("flaws.ghost.share", ghost.share, 0.0, 0.5),
            ("flaws.ghost.shift[0]", ghost.shift[0], -1.0, 1.0),
            ("flaws.ghost.shift[1]", ghost.shift[1], -1.0, 1.0),
            ("flaws.direct.share", direct.share, 0.0, 1.0),
            ("flaws.lamp.change", lamp.change, -0.9, 9.0),
            ("flaws.lamp.drift_per_h", lamp.drift_per_h, -0.2, 0.2),
            ("flaws.lamp.flicker", lamp.flicker, 0.0, 0.1),
            ("flaws.pixels.prnu", pixels.prnu, 0.0, 0.1),
            ("flaws.pixels.dsnu_e", pixels.dsnu_e, 0.0, 100.0),
            ("flaws.pixels.wander_e", pixels.wander_e, 0.0, 1e3),
            ("flaws.pixels.hot", pixels.hot, 0.0, 0.1),
            ("flaws.pixels.row_noise_e", pixels.row_noise_e, 0.0, 100.0),
            ("flaws.pupils.camera_m", pupils.camera_m, 0.0, 0.2),
            ("flaws.pupils.projector_m", pupils.projector_m, 0.0, 0.2),
            ("flaws.pupils.falloff", pupils.falloff, 0.0, 1.0),
            ("flaws.pupils.blades_deg", pupils.blades_deg, -360.0, 360.0),
            ("flaws.figure.slope_rad", figure.slope_rad, 0.0, 0.01),
            ("flaws.crosstalk.share", crosstalk.share, 0.0, 0.2),
            ("flaws.crosstalk.oblique", crosstalk.oblique, 0.0, 1.0),
            ("flaws.crosstalk.straight[0]", crosstalk.straight[0], -1.0, 1.0),
            ("flaws.crosstalk.straight[1]", crosstalk.straight[1], -1.0, 1.0),
            ("flaws.knee.start", knee.start, 0.0, 0.99),
            ("flaws.knee.loss", knee.loss, 0.0, 0.5),
            ("flaws.seating.height_m", seating.height_m, 0.0, 0.01),
            ("flaws.seating.mirror_deg", seating.mirror_deg, 0.0, 10.0),
            ("flaws.lag.share", lag.share, 0.0, 0.5),
            ("flaws.polarisation.projector", polarisation.projector, -0.5, 0.5),
            ("flaws.polarisation.camera", polarisation.camera, -0.5, 0.5),
            ("flaws.focus.blur_px", focus.blur_px, 0.0, 10.0),
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

    /// What stands in the holder when the standard of this number, 0 or 1, does, which is said to be `stated`.
    pub(super) fn standard(&self, number: usize, stated: Arc<dyn Sample>) -> Arc<dyn Sample> {
        let off = self.flaws.standards[number];
        if off == 0.0 {
            stated
        } else {
            Arc::new(Off {
                stated,
                factor: 1.0 + off,
            })
        }
    }

    /// The truth as TOML that [`Truth::load`] reads back to the same numbers.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("invariant: a truth is tables of numbers, strings and flags")
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::crosstalk::CROSSTALKS;
    use super::super::flaws::{CONTRASTS, GHOSTS, GLARES, PRNUS, ROW_NOISES_E};
    use super::*;

    #[test]
    fn a_drawn_truth_strays_as_far_as_it_may_and_reads_back() {
        let nominal = Rig::load("rcg-1-16bit").unwrap();
        let tolerances = Tolerances {
            position_m: 1e-3,
            angle_deg: 0.5,
            field: 0.3,
            standard: 0.0025,
            ..Tolerances::DRAWN
        };
        let mut squares = 0.0;
        for seed in 0..50 {
            let truth = Truth::drawn(&nominal, tolerances, seed).unwrap();
            squares += truth.rig.camera.lens.offset_m.map(|m| m * m).iter().sum::<f64>();
            assert!(CONTRASTS.contains(&truth.flaws.black_level.recip()));
            assert!(CROSSTALKS.contains(&truth.flaws.crosstalk.share));
            assert!(GLARES.contains(&truth.flaws.glare.share) && GHOSTS.contains(&truth.flaws.ghost.share));
            let pixels = &truth.flaws.pixels;
            assert!(PRNUS.contains(&pixels.prnu) && ROW_NOISES_E.contains(&pixels.row_noise_e));
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

    #[test]
    fn another_version_and_flaws_that_nothing_real_has_are_refused() {
        let truth = Truth::of(&Rig::load("rcg-1-16bit").unwrap());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.toml");
        let refusal = |text: String| {
            std::fs::write(&path, text).unwrap();
            Truth::load(&path).unwrap_err().to_string()
        };
        let older = refusal(truth.to_toml().replacen("version = 9\n", "", 1));
        assert!(
            older.contains("version: expected 9, which also has glare") && older.ends_with("found none"),
            "{older}"
        );
        let before = refusal(truth.to_toml().replacen("version = 9\n", "version = 2\n", 1));
        assert!(
            before.contains("version: expected 9, which also has the lamp's drift")
                && before.ends_with("found 2"),
            "{before}"
        );
        for (field, spoil) in [
            (
                "flaws.glare.share",
                (|flaws| flaws.glare.share = 0.7) as fn(&mut Flaws),
            ),
            ("flaws.glare.core", |flaws| flaws.glare.share = 0.01),
            ("flaws.ghost.shift[1]", |flaws| flaws.ghost.shift[1] = -1.5),
            ("flaws.standards[0]", |flaws| flaws.standards[0] = -0.9),
            ("flaws.pixels.prnu", |flaws| flaws.pixels.prnu = 0.2),
            ("flaws.pixels.dsnu_e", |flaws| flaws.pixels.dsnu_e = -1.0),
            ("flaws.pixels.hot", |flaws| flaws.pixels.hot = f64::INFINITY),
            ("flaws.pixels.row_noise_e", |flaws| {
                flaws.pixels.row_noise_e = f64::NAN;
            }),
            ("flaws.figure.slope_rad", |flaws| flaws.figure.slope_rad = 0.1),
            ("flaws.crosstalk.share", |flaws| flaws.crosstalk.share = 0.3),
            ("flaws.lag.share", |flaws| flaws.lag.share = 0.6),
            ("flaws.polarisation.camera", |flaws| {
                flaws.polarisation.camera = -0.6;
            }),
            ("flaws.knee.start", |flaws| flaws.knee.start = 1.0),
            ("flaws.seating.height_m", |flaws| flaws.seating.height_m = -1e-4),
            ("flaws.seating.mirror_deg", |flaws| {
                flaws.seating.mirror_deg = 11.0;
            }),
            ("flaws.focus.blur_px", |flaws| flaws.focus.blur_px = 11.0),
            ("flaws.pixels.wander_e", |flaws| flaws.pixels.wander_e = -1.0),
            ("flaws.black_level", |flaws| flaws.black_level = f64::NAN),
        ] {
            let mut wrong = truth.clone();
            spoil(&mut wrong.flaws);
            let sentence = refusal(wrong.to_toml());
            assert!(
                sentence.contains(field) && sentence.contains("expected a number from"),
                "{sentence}"
            );
        }
    }

    #[test]
    fn a_standard_reflects_what_it_does_and_not_what_is_stated() {
        let mut truth = Truth::of(&Rig::load("rcg-1-16bit").unwrap());
        truth.flaws.standards = [0.004, 0.0];
        let stated: Arc<dyn Sample> = Arc::from(crate::brdf::sample::parse("lambert:0.5").unwrap());
        let [first, second] =
            [0, 1].map(|number| truth.standard(number, stated.clone()).f(DVec3::Z, DVec3::Z)[0]);
        assert!((first / second - 1.004).abs() < 1e-12, "{first} {second}");
    }
}
