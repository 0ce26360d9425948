//! Solid angle at the sample that a pixel covers.
//!
//! # Design
//! The directions of a pixel's four corners span a spherical quadrilateral, whose excess is its solid angle.
//! Corners are traced on the whole ellipsoid, so that pixels at the edge of the mirror or of the image have
//! their full solid angle: a pixel counts as measurable, or not, by its centre.

use glam::{DVec2, DVec3};

use super::{Unmeasurable, View};

/// Side of the square that stands in for a pixel whose corners cannot be traced, pixels.
const SMALL_PX: f64 = 1e-3;

/// Solid angle in sr of a cone whose full opening is `spot_deg` degrees.
#[must_use]
pub fn cone_sr(spot_deg: f64) -> f64 {
    let half_rad = spot_deg.to_radians() / 2.0;
    // 2π(1 − cos h) without the cancellation.
    4.0 * std::f64::consts::PI * (half_rad / 2.0).sin().powi(2)
}

impl View {
    /// Solid angle in steradians at the sample of the pixel-sized square centred at (`u_px`, `v_px`).
    ///
    /// # Errors
    /// The reason why its centre sees no direction.
    pub fn solid_angle_sr(&self, u_px: f64, v_px: f64) -> Result<f64, Unmeasurable> {
        self.trace(u_px, v_px)?;
        let centre = DVec2::new(u_px, v_px);
        Ok(self
            .square_sr(centre, 1.0)
            .unwrap_or_else(|| self.small_square_sr(centre)))
    }

    /// Solid angle from the derivative at `centre`, for a pixel with a corner that has no ray.
    pub(super) fn small_square_sr(&self, centre: DVec2) -> f64 {
        self.square_sr(centre, SMALL_PX)
            .map_or(0.0, |small_sr| small_sr / (SMALL_PX * SMALL_PX))
    }

    fn square_sr(&self, centre: DVec2, side_px: f64) -> Option<f64> {
        let at = |du: f64, dv: f64| {
            self.reflect_pixel(centre + side_px * DVec2::new(du, dv))
                .map(|found| found.direction)
        };
        Some(quadrilateral_sr([
            at(-0.5, -0.5)?,
            at(0.5, -0.5)?,
            at(0.5, 0.5)?,
            at(-0.5, 0.5)?,
        ]))
    }
}

/// Solid angle of the spherical quadrilateral with the unit vectors `corners`, in order, steradians ≥ 0.
pub(super) fn quadrilateral_sr([a, b, c, d]: [DVec3; 4]) -> f64 {
    (triangle_sr(a, b, c) + triangle_sr(a, c, d)).abs()
}

/// Signed solid angle of a spherical triangle of unit vectors, steradians.
///
/// Van Oosterom and Strackee, "The solid angle of a plane triangle", IEEE Trans. Biomed. Eng. 30 (1983):
/// tan(Ω/2) = a·(b×c) / (1 + a·b + b·c + c·a). The triple product is written with differences, which keeps
/// its digits for small triangles.
fn triangle_sr(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    let triple = a.dot((b - a).cross(c - a));
    2.0 * triple.atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;
    use crate::hemisphere::direction::from_angles;

    #[test]
    fn an_octant_is_an_eighth_of_the_sphere() {
        assert!((triangle_sr(DVec3::X, DVec3::Y, DVec3::Z) - FRAC_PI_2).abs() < 1e-15);
        assert!((triangle_sr(DVec3::Y, DVec3::X, DVec3::Z) + FRAC_PI_2).abs() < 1e-15);
    }

    #[test]
    fn a_small_quadrilateral_is_flat() {
        let side_rad = 1e-5;
        let corner = |u: f64, v: f64| from_angles(FRAC_PI_2 - v * side_rad, u * side_rad);
        let sr = quadrilateral_sr([
            corner(0.0, 0.0),
            corner(1.0, 0.0),
            corner(1.0, 1.0),
            corner(0.0, 1.0),
        ]);
        assert!((sr / (side_rad * side_rad) - 1.0).abs() < 1e-9);
    }
}
