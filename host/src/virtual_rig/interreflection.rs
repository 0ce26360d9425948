//! Light that leaves the sample and comes back onto it.

use glam::DVec3;

use crate::brdf::sample::{Sample, albedo};
use crate::hemisphere::direction::from_angles;

/// Light that comes back onto the sample from everywhere.
pub(super) struct Interreflection {
    /// Directional albedo by θ, [step, channel].
    albedo: Vec<[f64; 3]>,
    share: f64,
}

impl Interreflection {
    /// Steps of θ from 0 to 90°.
    const STEPS: usize = 18;

    pub(super) fn of(sample: &dyn Sample, share: f64) -> Self {
        let step_rad = std::f64::consts::FRAC_PI_2 / Self::STEPS as f64;
        let albedo = (0..=Self::STEPS)
            .map(|step| {
                let theta_rad = (step as f64 * step_rad).min(89.5_f64.to_radians());
                albedo(sample, from_angles(theta_rad, 0.0))
            })
            .collect();
        Self { albedo, share }
    }

    fn albedo(&self, w: DVec3) -> [f64; 3] {
        let at = w.z.clamp(0.0, 1.0).acos() / std::f64::consts::FRAC_PI_2 * Self::STEPS as f64;
        let step = (at as usize).min(Self::STEPS - 1);
        std::array::from_fn(|channel| {
            let (a, b) = (self.albedo[step][channel], self.albedo[step + 1][channel]);
            a + (b - a) * (at - step as f64)
        })
    }

    /// What it adds to f, in sr⁻¹.
    pub(super) fn f(&self, wi: DVec3, wo: DVec3) -> [f64; 3] {
        let (to, from) = (self.albedo(wi), self.albedo(wo));
        std::array::from_fn(|channel| self.share * to[channel] * from[channel] / std::f64::consts::PI)
    }
}
