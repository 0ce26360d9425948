//! What part of the sample a camera pixel sees, and what part a spot of light lights.
//!
//! # Design
//! The mirror images the pupil of camera or projector at F2 onto the sample at F1. Along a direction whose ray runs r₂ to the
//! mirror and r₁ from there to the sample the image is r₁/r₂ times as large as the pupil, both ways across the ray (to the first
//! order; light meets the mirror at one angle, so both ways are alike), and on the sample 1/cosθ times as long in the plane of
//! incidence. A wide pupil's image is displaced and stretched besides (coma): the rays through four places of its edge say by
//! how much. It is taken for an ellipse, a [`Patch`].
//!
//! A pixel shows the mean radiance of its patch. Where the patch of the light, or the sample, ends within it the pixel shows
//! less: the share of [`Patch::lit`], which depends on both directions together and is no product of a throughput and an
//! intensity.

use std::sync::LazyLock;

use glam::{DMat2, DVec2};

use super::{Unmeasurable, View};

/// Places within a patch where an edge crosses it.
const PLACES: usize = 37;
/// Times that an edge is gone towards.
const REFINEMENTS: usize = 3;
/// The golden angle, radians: places at such turns are spread evenly over a disk (Vogel 1979).
const GOLDEN_RAD: f64 = 2.399_963_229_728_653;
/// Them, in the unit disk.
static AT: LazyLock<[DVec2; PLACES]> = LazyLock::new(|| {
    std::array::from_fn(|place| {
        DVec2::from_angle(place as f64 * GOLDEN_RAD) * ((place as f64 + 0.5) / PLACES as f64).sqrt()
    })
});

/// The image of a pupil on the sample plane; sample frame, from the sample's centre, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Its centre.
    pub centre_m: DVec2,
    /// Half axes: takes the unit disk to the patch about its centre.
    pub axes_m: DMat2,
}

impl View {
    /// The patch of the position (`u_px`, `v_px`) with a pupil of the diameter `pupil_m`, whatever is in the way of the ray.
    ///
    /// # Errors
    /// [`Unmeasurable`] where there is no ray, or it does not come from above the sample.
    pub fn patch(&self, u_px: f64, v_px: f64, pupil_m: f64) -> Result<Patch, Unmeasurable> {
        let at = DVec2::new(u_px, v_px);
        let reflection = self.reflect_pixel(at).ok_or(Unmeasurable::OutsideImage)?;
        let trace = self.meet_plane(&reflection)?;
        let w = trace.direction;
        if w.z <= 0.0 {
            return Err(Unmeasurable::BelowHorizon);
        }
        let to_device_m = (reflection.mirror_m - self.centre_m).length();
        let to_sample_m = (self.to_sample_place(reflection.mirror_m) - trace.hit_m).length();
        let radius_m = 0.5 * pupil_m * to_sample_m / to_device_m;
        let along = w.truncate().try_normalize().unwrap_or(DVec2::X);
        let first_order = [along * (radius_m / w.z), along.perp() * radius_m];
        let middle_m = trace.hit_m.truncate();
        // Towards the edge of the pupil, as far as rays go that reach it.
        let edge = |step: DVec2| -> DVec2 {
            let mut at = step;
            for _ in 0..REFINEMENTS {
                match self.pupil_at(middle_m + at, w) {
                    Some(there) if there.length() > 0.0 => at *= 0.5 * pupil_m / there.length(),
                    _ => return step,
                }
            }
            at
        };
        let ends = first_order.map(|step| [edge(step), edge(-step)]);
        let [[a, minus_a], [b, minus_b]] = ends;
        Ok(Patch {
            // Of the edge all around: half from either pair.
            centre_m: middle_m + (a + minus_a + b + minus_b) / 4.0,
            axes_m: DMat2::from_cols((a - minus_a) / 2.0, (b - minus_b) / 2.0),
        })
    }
}

/// A patch of light, ready to be compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LitPatch {
    centre_m: DVec2,
    /// Takes the patch about its centre to the unit disk.
    to_unit: DMat2,
    /// By which share its edge is darker than its middle: the light is 1 − falloff·ρ², ρ being 1 at the edge.
    falloff: f64,
}

impl LitPatch {
    /// That of `patch`; `None` if it has no area.
    #[must_use]
    pub fn new(patch: &Patch, falloff: f64) -> Option<Self> {
        let to_unit = patch.axes_m.inverse();
        to_unit.is_finite().then_some(Self {
            centre_m: patch.centre_m,
            to_unit,
            falloff,
        })
    }
}

/// Largest stretch of a matrix, or a little more: the root of the sum of its squares.
fn stretch(matrix: DMat2) -> f64 {
    (matrix.x_axis.length_squared() + matrix.y_axis.length_squared()).sqrt()
}

impl Patch {
    /// Mean light of `lit` over the patch, of a sample of `radius_m`, over that of the middle of `lit`: 0 to 1.
    #[must_use]
    pub fn lit(&self, lit: &LitPatch, radius_m: f64) -> f64 {
        let middle = lit.to_unit * (self.centre_m - lit.centre_m);
        let shape = lit.to_unit * self.axes_m;
        let (reach, reach_m) = (stretch(shape), stretch(self.axes_m));
        let (away, away_m) = (middle.length(), self.centre_m.length());
        if away - reach >= 1.0 || away_m - reach_m >= radius_m {
            return 0.0;
        }
        if away + reach <= 1.0 && away_m + reach_m <= radius_m {
            // Of ρ² over an ellipse: that of its middle and a quarter of the squares of its half axes.
            return 1.0 - lit.falloff * (middle.length_squared() + 0.25 * reach * reach);
        }
        // An edge is as soft as the places lie apart.
        let apart = (PLACES as f64).sqrt().recip();
        let inside = |from: f64, edge: f64, softness: f64| ((edge - from) / softness + 0.5).clamp(0.0, 1.0);
        let light = |at: &DVec2| {
            let (here, here_m) = (middle + shape * *at, self.centre_m + self.axes_m * *at);
            let rho2 = here.length_squared();
            inside(rho2.sqrt(), 1.0, reach * apart)
                * inside(here_m.length(), radius_m, reach_m * apart)
                * (1.0 - lit.falloff * rho2.min(1.0))
        };
        AT.iter().map(light).sum::<f64>() / PLACES as f64
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_6;

    use super::*;
    use crate::hemisphere::direction::from_degrees;
    use crate::instrument::rig::Rig;

    fn patch(view: &View, theta_deg: f64, phi_deg: f64, pupil_m: f64) -> Patch {
        let at = view.pixel(from_degrees(theta_deg, phi_deg)).unwrap();
        view.patch(at.x, at.y, pupil_m).unwrap()
    }

    #[test]
    fn a_small_pupil_is_imaged_by_the_lengths_of_the_ray_and_stretched_by_the_cosine() {
        let rig = Rig::load("rcg-1-16bit").unwrap();
        let view = View::projector(&rig);
        for theta_deg in [30.0_f64, 60.0, 80.0] {
            let found = patch(&view, theta_deg, 90.0, 1e-4);
            // Of the mirror: r₁ = a²/(b + c·cosθ), and both lengths make 2b.
            let (a, b) = (rig.mirror.a_m, rig.mirror.b_m);
            let c = (b * b - a * a).sqrt();
            let r1 = a * a / (b + c * theta_deg.to_radians().cos());
            let radius_m = 0.5e-4 * r1 / (2.0 * b - r1);
            let long_m = radius_m / theta_deg.to_radians().cos();
            assert!(found.centre_m.length() < 1e-8, "{found:?}");
            // The pupil is seen at an angle of up to 11°.
            assert!(
                (found.axes_m.x_axis.length() / long_m - 1.0).abs() < 0.02,
                "{found:?}"
            );
            assert!(
                (found.axes_m.y_axis.length() / radius_m - 1.0).abs() < 0.02,
                "{found:?}"
            );
            assert!(found.axes_m.x_axis.normalize().dot(DVec2::Y).abs() > 0.999_999);
        }
    }

    #[test]
    fn rays_through_the_edge_of_a_wide_patch_cross_the_edge_of_the_pupil() {
        let mut rig = Rig::load("rcg-3").unwrap();
        rig.projector.lens.offset_m = [1e-3, -1e-3, 1e-3];
        rig.sample.offset_m = [5e-4, 5e-4, -5e-4];
        let view = View::projector(&rig);
        for (theta_deg, phi_deg) in [
            (10.0, 20.0),
            (45.0, 180.0),
            (60.0, 90.0),
            (75.0, 0.0),
            (75.0, 225.0),
        ] {
            let w = from_degrees(theta_deg, phi_deg);
            let found = patch(&view, theta_deg, phi_deg, 0.04);
            for turn in 0..12 {
                let place = found.centre_m + found.axes_m * DVec2::from_angle(f64::from(turn) * FRAC_PI_6);
                let radius = view.pupil_at(place, w).unwrap().length() / 0.02;
                assert!(
                    (radius - 1.0).abs() < 0.05,
                    "{theta_deg} {phi_deg} {turn}: {radius}"
                );
            }
        }
    }

    #[test]
    fn shares_are_those_of_circles() {
        let disk = |x: f64, radius: f64| Patch {
            centre_m: DVec2::new(x, 0.0),
            axes_m: DMat2::IDENTITY * radius,
        };
        let lit = LitPatch::new(&disk(0.0, 1.0), 0.0).unwrap();
        assert!((disk(0.2, 0.1).lit(&lit, 9.0) - 1.0).abs() < 1e-12);
        assert!(disk(1.3, 0.2).lit(&lit, 9.0).abs() < 1e-12);
        // Half of a small one on the edge; of two alike one radius apart 0.391 (lens of two circles).
        assert!((disk(1.0, 0.01).lit(&lit, 9.0) - 0.5).abs() < 0.03);
        assert!((disk(1.0, 1.0).lit(&lit, 9.0) - 0.391).abs() < 0.02);
        // A larger one collects the ratio of the areas; the sample's edge cuts too.
        assert!((disk(0.0, 2.0).lit(&lit, 9.0) - 0.25).abs() < 0.02);
        assert!((disk(0.5, 0.01).lit(&lit, 0.5) - 0.5).abs() < 0.03);
        // Light that falls off by a fifth to its edge: 1 − 0.2·ρ², over a disk of 0.4 around 0.3.
        let dimmer = LitPatch::new(&disk(0.0, 1.0), 0.2).unwrap();
        let mean2 = 0.3 * 0.3 + 0.4 * 0.4 / 2.0;
        assert!((disk(0.3, 0.4).lit(&dimmer, 9.0) - (1.0 - 0.2 * mean2)).abs() < 1e-12);
        assert!(LitPatch::new(&disk(0.0, 0.0), 0.0).is_none());
    }
}
