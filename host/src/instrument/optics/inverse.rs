//! The pixel that sees a given direction.
//!
//! # Design
//! With the optical centre at F2 the answer is closed: the light from F1 meets the mirror at
//! [`Ellipsoid::point_from_f1`](super::Ellipsoid::point_from_f1) and goes on to F2. Otherwise that point is
//! the start of a Newton iteration on the traced direction. The unknowns are the ray's undistorted image
//! coordinates, so the iteration does not go through the inverse of the distortion.

use glam::{DMat2, DVec2, DVec3};

use super::pinhole::image_coordinates;
use super::view::{Reflection, View, is_above_horizon};
use super::{Trace, Unmeasurable};

/// Newton steps before a direction is said to be in no pixel's sight.
const MAX_STEPS: usize = 20;
/// Deviation of the traced direction at which the iteration stops, radians.
const TOLERANCE: f64 = 1e-14;
/// Deviation that is accepted when rounding lets it get no smaller, radians.
const ACCEPTED: f64 = 1e-11;
/// Step of the difference quotient in image coordinates.
const DIFFERENCE: f64 = 1e-7;

impl View {
    /// Position (u, v) in pixels that sees the direction `w` (sample frame, unit, away from the surface).
    ///
    /// # Errors
    /// The reason why no pixel measures it.
    pub fn pixel(&self, w: DVec3) -> Result<DVec2, Unmeasurable> {
        if !is_above_horizon(w) {
            return Err(Unmeasurable::BelowHorizon);
        }
        let w_m = self.frame().to_mirror(w);
        let ideal_m = self.ellipsoid.point_from_f1(w_m);
        let (ray, reflection) = if self.at_focus {
            (
                self.ray_to(ideal_m),
                Reflection {
                    mirror_m: ideal_m,
                    direction: w_m,
                },
            )
        } else {
            self.ray_that_sees(w_m, ideal_m)
                .ok_or(Unmeasurable::OutsideImage)?
        };
        self.admit(&reflection)?;
        let pixel = self.pinhole.project(ray).ok_or(Unmeasurable::OutsideImage)?;
        if !self.pinhole.contains(pixel) {
            return Err(Unmeasurable::OutsideImage);
        }
        if !self.is_stigmatic() {
            let _: Trace = self.reach_sample(&reflection)?;
        }
        Ok(pixel)
    }

    /// Ray of the device's frame that is reflected into `w_m`, starting from the one to `start_m`.
    fn ray_that_sees(&self, w_m: DVec3, start_m: DVec3) -> Option<(DVec3, Reflection)> {
        let (e1, e2) = w_m.any_orthonormal_pair();
        let deviation = |found: &Reflection| DVec2::new(found.direction.dot(e1), found.direction.dot(e2));
        let start = self.ray_to(start_m);
        let mut xy = image_coordinates(start)?;
        let mut best: Option<(f64, DVec3, Reflection)> = None;
        for _ in 0..MAX_STEPS {
            let ray = xy.extend(1.0);
            let found = self.reflect_ray(ray)?;
            let missed_rad = (found.direction - w_m).length();
            let improves = best.is_none_or(|(least_rad, ..)| missed_rad < least_rad);
            if improves {
                best = Some((missed_rad, ray, found));
            }
            // Close to the answer a step that does not improve is rounding.
            if missed_rad <= TOLERANCE || (!improves && missed_rad < ACCEPTED) {
                break;
            }
            let here = deviation(&found);
            let along_x = deviation(&self.reflect_ray((xy + DIFFERENCE * DVec2::X).extend(1.0))?);
            let along_y = deviation(&self.reflect_ray((xy + DIFFERENCE * DVec2::Y).extend(1.0))?);
            let jacobian = DMat2::from_cols((along_x - here) / DIFFERENCE, (along_y - here) / DIFFERENCE);
            let step = jacobian.inverse() * here;
            if !step.is_finite() {
                return None;
            }
            xy -= step;
        }
        best.filter(|(missed_rad, ..)| *missed_rad < ACCEPTED)
            .map(|(_, ray, found)| (ray, found))
    }
}
