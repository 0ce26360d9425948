//! Figure error of the virtual rig's mirror: slopes beyond an ellipsoid.
//!
//! # Design
//! The height is a sum of a few long waves through space, cut by the mirror. Each has the same slope, since what bends long
//! bends high. A ray is turned by twice the slope.

use std::f64::consts::TAU;
use std::ops::RangeInclusive;
use std::sync::Arc;

use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};

use super::flaws::log_uniform;
use crate::hemisphere::direction::from_angles;
use crate::instrument::optics::{self, Ellipsoid};
use crate::instrument::rig::Rig;

/// Slope errors (RMS) of mirrors as deep as these: diamond-turned metal has 0.05 mrad, a polished one 0.1 to 0.2 mrad, an
/// electroformed replica 0.5 mrad (catalogues of ellipsoidal reflectors, where they state any).
pub const FIGURES_RAD: RangeInclusive<f64> = 5e-5..=5e-4;
/// Waves of a mirror, and how many periods of one there are in the semi-axis across: what turning, clamping and pulling off a
/// mandrel leave is long.
const WAVES: usize = 6;
const PERIODS: RangeInclusive<f64> = 0.4..=1.2;
/// Places of the mirror over which its slope is said.
const PLACES: u32 = 2000;
/// What tells the chance of a mirror from that of the rest of the rig: the letters of `figure`.
const STREAM: u64 = 0x6669_6775_7265;

/// Slopes of the mirror beyond an ellipsoid.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Figure {
    /// Their RMS over the mirror, radians.
    pub slope_rad: f64,
    /// Of each wave, periods in the mirror's semi-axis across along x, y and z of the mirror frame, and phase, radians.
    pub waves: Vec<[f64; 4]>,
}

impl Figure {
    /// A mirror by chance. Its chance is its own, so that it changes no other flaw that follows from the `seed`.
    pub(super) fn drawn(seed: u64) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed ^ STREAM);
        let slope_rad = log_uniform(FIGURES_RAD, &mut rng);
        let wave = |_| {
            let (z, phi): (f64, f64) = (rng.random_range(-1.0..1.0), rng.random_range(0.0..TAU));
            let [x, y, z] = (from_angles(z.acos(), phi) * log_uniform(PERIODS, &mut rng)).to_array();
            [x, y, z, rng.random_range(0.0..TAU)]
        };
        Self {
            slope_rad,
            waves: (0..WAVES).map(wave).collect(),
        }
    }

    /// Of the mirror of `rig`; `None` if that is an ellipsoid.
    pub(crate) fn of(&self, rig: &Rig) -> Option<Arc<dyn optics::Figure>> {
        if self.slope_rad <= 0.0 || self.waves.is_empty() {
            return None;
        }
        let ellipsoid = Ellipsoid::of(rig);
        let mut slopes = Slopes {
            waves: self
                .waves
                .iter()
                .map(|&[x, y, z, phase_rad]| {
                    let periods = DVec3::new(x, y, z);
                    (
                        periods * (TAU / ellipsoid.a_m),
                        periods.normalize_or_zero(),
                        phase_rad,
                    )
                })
                .collect(),
        };
        let rms_rad = slopes.rms_rad(&ellipsoid);
        let scale = self.slope_rad / rms_rad;
        for (_, slope, _) in &mut slopes.waves {
            *slope *= scale;
        }
        scale
            .is_finite()
            .then(|| Arc::new(slopes) as Arc<dyn optics::Figure>)
    }
}

/// Waves: radians per metre, largest slope, phase.
#[derive(Debug)]
struct Slopes {
    waves: Vec<(DVec3, DVec3, f64)>,
}

impl optics::Figure for Slopes {
    fn slope(&self, mirror_m: DVec3) -> DVec3 {
        let of = |&(per_m, slope, phase_rad): &(DVec3, DVec3, f64)| {
            slope * (per_m.dot(mirror_m) + phase_rad).cos()
        };
        self.waves.iter().map(of).sum()
    }
}

impl Slopes {
    /// RMS over the directions in which the mirror is seen from the sample.
    fn rms_rad(&self, ellipsoid: &Ellipsoid) -> f64 {
        // The golden angle spreads places evenly (Vogel 1979).
        let golden_rad = TAU * (1.0 - 1.0 / 1.618_033_988_749_895);
        let (mut sum, mut count) = (0.0, 0_u32);
        for place in 0..PLACES {
            let z = 1.0 - (2.0 * f64::from(place) + 1.0) / f64::from(PLACES);
            let w = from_angles(z.acos(), f64::from(place) * golden_rad);
            let at_m = ellipsoid.point_from_f1(w);
            if ellipsoid.in_hole(w) || ellipsoid.is_beyond_rim(at_m) {
                continue;
            }
            let normal = ellipsoid.normal(at_m);
            let slope = optics::Figure::slope(self, at_m);
            sum += slope.reject_from_normalized(normal).length_squared();
            count += 1;
        }
        (sum / f64::from(count)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::angle_between;
    use crate::instrument::optics::View;

    /// Angles in radians by which the figure turns what the `view` of a rig sees.
    fn turns_rad(rig: &Rig, figure: &Figure, view: fn(&Rig) -> View) -> Vec<f64> {
        let (ideal, real) = (view(rig), view(rig).with_figure(figure.of(rig)));
        let (width, height) = ideal.size_px();
        let places = (0..40).flat_map(|row| (0..40).map(move |column| (column, row)));
        let at = |step: usize, size: usize| (step as f64 + 0.5) / 40.0 * size as f64;
        places
            .filter_map(|(column, row)| {
                let (u, v) = (at(column, width), at(row, height));
                let (before, after) = (ideal.direction(u, v).ok()?, real.direction(u, v).ok()?);
                // The way back is as good as that of an ellipsoid.
                if let Ok(back) = real.pixel(after) {
                    assert!((back.x - u).hypot(back.y - v) < 1e-6, "{back} {u} {v}");
                }
                Some(angle_between(before, after))
            })
            .collect()
    }

    #[test]
    fn rays_of_camera_and_projector_are_turned_by_twice_the_slope() {
        for preset in ["rcg-1-16bit", "rcg-3"] {
            let rig = Rig::load(preset).unwrap();
            for seed in 0..6 {
                let figure = Figure {
                    slope_rad: 3e-4,
                    ..Figure::drawn(seed)
                };
                for view in [View::camera as fn(&Rig) -> View, View::projector] {
                    let turns = turns_rad(&rig, &figure, view);
                    let squares = turns.iter().map(|turn| turn * turn).sum::<f64>();
                    let rms_rad = (squares / turns.len() as f64).sqrt();
                    // Across the plane of incidence a slope turns a ray by less, by the cosine of the angle at the mirror.
                    assert!((4e-4..7.5e-4).contains(&rms_rad), "{preset} {seed}: {rms_rad}");
                    // Smooth, and not far beyond its RMS.
                    assert!(turns.iter().all(|turn| *turn < 4.0 * rms_rad));
                }
            }
        }
    }

    #[test]
    fn a_mirror_that_is_an_ellipsoid_has_no_figure() {
        let rig = Rig::load("rcg-1-16bit").unwrap();
        assert!(Figure::default().of(&rig).is_none());
        let flat = Figure {
            slope_rad: 0.0,
            ..Figure::drawn(1)
        };
        assert!(flat.of(&rig).is_none());
        assert!(FIGURES_RAD.contains(&Figure::drawn(1).slope_rad));
    }
}
