//! Parallax and blur: what a finite pixel or a finite spot does to a direction.
//!
//! # Design
//! A device beside F2 looks at (or lights) places of the sample that differ with the direction: the parallax. Its distance
//! between camera and projector says whether they look at the same piece of the sample at all. A pixel covers a cone of
//! directions and a patch of the sample; both are given as full widths of the pixel-sized square, from the derivatives of
//! the traced map.

use glam::{DVec2, DVec3};

use super::{Trace, Unmeasurable, View};

/// Half the distance in pixels over which the map is differenced.
const HALF_PX: f64 = 0.05;

/// How one position of an image spreads at the sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Where the ray meets the sample plane, from the sample's centre, sample frame x and y, metres.
    pub hit_m: DVec2,
    /// Longest and shortest full width of the pixel's cone of directions, radians.
    pub width_rad: [f64; 2],
    /// Longest full width of the pixel's patch on the sample, metres.
    pub patch_m: f64,
}

impl View {
    /// How the pixel that sees the direction `w` (sample frame, unit, away from the surface) spreads at the sample.
    ///
    /// # Errors
    /// The reason why no pixel measures it.
    pub fn spread(&self, w: DVec3) -> Result<Spread, Unmeasurable> {
        let at = self.pixel(w)?;
        let here = self.trace(at.x, at.y)?;
        let slope = |step: DVec2| -> Result<(DVec3, DVec3), Unmeasurable> {
            let trace = |by: DVec2| -> Result<Trace, Unmeasurable> {
                let reflection = self.reflect_pixel(at + by).ok_or(Unmeasurable::OutsideImage)?;
                self.reach_sample(&reflection)
            };
            let (up, down) = (trace(step * HALF_PX)?, trace(step * -HALF_PX)?);
            let per_px = 0.5 / HALF_PX;
            Ok((
                (up.direction - down.direction) * per_px,
                (up.hit_m - down.hit_m) * per_px,
            ))
        };
        let ((du, hu), (dv, hv)) = (slope(DVec2::X)?, slope(DVec2::Y)?);
        Ok(Spread {
            hit_m: here.hit_m.truncate(),
            width_rad: widths(du, dv),
            patch_m: widths(hu, hv)[0],
        })
    }
}

/// Singular values of the map that takes the unit square to the parallelogram of `a` and `b`, the longer first.
fn widths(a: DVec3, b: DVec3) -> [f64; 2] {
    let (aa, ab, bb) = (a.length_squared(), a.dot(b), b.length_squared());
    let middle = f64::midpoint(aa, bb);
    let half = ((aa - bb) / 2.0).hypot(ab);
    [(middle + half).sqrt(), (middle - half).max(0.0).sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;
    use crate::instrument::rig::Rig;

    #[test]
    fn the_widths_span_the_solid_angle_and_an_aligned_rig_has_no_parallax() {
        let view = View::camera(&Rig::load("rcg-1-16bit").unwrap());
        for theta_deg in [30.0, 50.0, 70.0, 85.0] {
            let w = from_degrees(theta_deg, 20.0);
            let spread = view.spread(w).unwrap();
            let at = view.pixel(w).unwrap();
            let sr = view.solid_angle_sr(at.x, at.y).unwrap();
            let [long, short] = spread.width_rad;
            assert!(
                long >= short && (long * short / sr - 1.0).abs() < 1e-4,
                "{theta_deg}: {spread:?} {sr}"
            );
            assert!(spread.hit_m.length() < 1e-12 && spread.patch_m < 1e-9);
        }
    }

    #[test]
    fn a_displaced_device_and_a_displaced_sample_have_parallax() {
        let mut rig = Rig::load("rcg-1-16bit").unwrap();
        rig.sample.offset_m = [1e-3, 0.0, 0.0];
        let w = from_degrees(50.0, 20.0);
        // The rays still meet at F1, which is now 1 mm beside the sample's centre.
        let spread = View::camera(&rig).spread(w).unwrap();
        assert!((spread.hit_m - DVec2::new(-1e-3, 0.0)).length() < 1e-12);
        // And with the sample lower than F1 the ray goes on: along −w for offset/cosθ.
        rig.sample.offset_m = [0.0, 0.0, -1e-3];
        let expected = -1e-3 * w.truncate() / w.z;
        assert!((View::camera(&rig).spread(w).unwrap().hit_m - expected).length() < 1e-12);
        rig.camera.lens.offset_m = [1e-3, 0.0, 0.0];
        let spread = View::camera(&rig).spread(w).unwrap();
        assert!((spread.hit_m - expected).length() > 1e-4 && spread.patch_m > 1e-8);
    }
}
