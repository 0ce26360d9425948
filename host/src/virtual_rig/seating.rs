//! How samples and standards are seated in the holder of the virtual rig.
//!
//! # Design
//! Whatever is put into the holder, or tilted in it, comes to lie a little higher or lower and a little turned: samples differ in
//! thickness and are wedges, seats have dust. Three balls under a plate hold it to some hundredths of a millimetre, a hand that presses
//! it against a frame to a tenth (tolerances of optical mounts). Everything is as before where the same is put there again: a capture
//! that is resumed has the same bits.

use std::ops::RangeInclusive;

use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};

use super::flaws::log_uniform;
use crate::brdf::sample::Sample;
use crate::hemisphere::direction::from_degrees;
use crate::instrument::optics::SampleFrame;
use crate::instrument::rig::{Rig, Tilt};

/// Standard deviations of the height, metres: 0.05 mm usually.
pub const SEATINGS_M: RangeInclusive<f64> = 2e-5..=1e-4;
/// Standard deviations of a mirror's lean from the tilt that was set, degrees: 0.025 usually. Stages are read by verniers of 5 minutes of
/// arc, to half a step; coarse ones to twice that.
pub const TILTS_DEG: RangeInclusive<f64> = 0.01..=0.05;
/// What lies higher on one side by that leans over this length, metres.
const LEVER_M: f64 = 0.1;
/// What tells its chance from that of the rest of the rig: the letters of `seat`.
const STREAM: u64 = 0x7365_6174;

/// How well things are seated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seating {
    /// Standard deviation of the height over its seat, metres; over 0.1 m that of how it leans, both ways.
    pub height_m: f64,
    /// Standard deviation of how far the flat mirror leans from the tilt that was set, in the plane of the tilt and across it, degrees.
    pub mirror_deg: f64,
}

impl Seating {
    /// By chance. Its chance is its own, so that it changes no other flaw that follows from the `seed`.
    pub(super) fn drawn(seed: u64) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed ^ STREAM);
        Self {
            height_m: log_uniform(SEATINGS_M, &mut rng),
            mirror_deg: log_uniform(TILTS_DEG, &mut rng),
        }
    }

    /// The flat mirror of this normal as it comes to lie; `seed` is that of the measurement.
    pub(super) fn lean(self, normal: DVec3, seed: u64) -> DVec3 {
        let placing = normal.to_array().into_iter().fold(seed ^ STREAM, mix);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(placing);
        let mut by = || -> f64 {
            let by: f64 = rng.sample(StandardNormal);
            (self.mirror_deg * by).to_radians()
        };
        let (e1, e2) = normal.any_orthonormal_pair();
        (normal + by() * e1 + by() * e2).normalize()
    }

    /// Moves the sample of `rig` to where `sample` comes to lie at `tilt`; `seed` is that of the measurement.
    pub(super) fn seat(self, rig: &mut Rig, sample: &dyn Sample, tilt: Option<Tilt>, seed: u64) {
        if self.height_m <= 0.0 {
            return;
        }
        let looks = sample.f(from_degrees(20.0, 0.0), from_degrees(30.0, 180.0));
        let stands = [rig.sample.tilt_deg, rig.sample.roll_deg, rig.sample.azimuth_deg];
        let tilts = if tilt.is_some() { stands } else { [0.0; 3] };
        let placing = looks.into_iter().chain(tilts).fold(seed ^ STREAM, mix);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(placing);
        let mut normal = || -> f64 { rng.sample(StandardNormal) };
        let up = SampleFrame::of(&rig.sample).to_mirror(DVec3::Z) * self.height_m * normal();
        for (offset, up) in rig.sample.offset_m.iter_mut().zip(up.to_array()) {
            *offset += up;
        }
        let lean_deg = (self.height_m / LEVER_M).to_degrees();
        rig.sample.tilt_deg += lean_deg * normal();
        rig.sample.roll_deg += lean_deg * normal();
    }
}

/// Mixes `value` into `hash`. By the multiplier of SplitMix64: what differs little has nothing in common.
fn mix(hash: u64, value: f64) -> u64 {
    (hash ^ value.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::sample::parse;

    #[test]
    fn what_is_put_there_again_lies_as_before_and_anything_else_elsewhere() {
        let rig = Rig::load("rcg-3").unwrap();
        let seating = Seating {
            height_m: 5e-5,
            mirror_deg: 0.03,
        };
        let seated = |spec: &str, seed: u64| {
            let mut rig = rig.clone();
            seating.seat(&mut rig, parse(spec).unwrap().as_ref(), None, seed);
            rig.sample
        };
        assert_eq!(seated("lambert:0.5", 1), seated("lambert:0.5", 1));
        assert_ne!(seated("lambert:0.5", 1), seated("lambert:0.4", 1));
        let normal = SampleFrame::of(&rig.sample).to_mirror(DVec3::Z);
        let (mut height2, mut lean2) = (0.0, 0.0);
        for seed in 0..400 {
            let sample = seated("ward:brass", seed);
            height2 += DVec3::from_array(sample.offset_m).dot(normal).powi(2) / 400.0;
            lean2 += (sample.tilt_deg - rig.sample.tilt_deg).powi(2) / 400.0;
        }
        assert!((height2.sqrt() / 5e-5 - 1.0).abs() < 0.15, "{height2}");
        assert!((lean2.sqrt() / 0.0286 - 1.0).abs() < 0.15, "{lean2}");
        let stands = from_degrees(15.0, 120.0);
        let lean2_deg = |seed: u64| {
            (seating.lean(stands, seed) - stands)
                .length_squared()
                .to_degrees()
                .to_degrees()
        };
        let mean2: f64 = (0..400).map(lean2_deg).sum::<f64>() / 400.0;
        // Two ways.
        assert!(((mean2 / 2.0).sqrt() / 0.03 - 1.0).abs() < 0.1, "{mean2}");
        assert_eq!(seating.lean(stands, 7), seating.lean(stands, 7));
        let mut same = rig.clone();
        Seating::default().seat(&mut same, parse("ward:brass").unwrap().as_ref(), None, 1);
        assert_eq!(same, rig);
    }
}
