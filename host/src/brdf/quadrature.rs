//! The mean of f over a small light and a small pixel.
//!
//! # Design
//! Four directions of light and four places within the pixel, each in the order ++, +−, −+, −−, make 16
//! combinations. The half fraction x₄ = x₁x₂x₃ of them is evaluated (a 2⁴⁻¹ design): 8 evaluations in which no two of
//! the four coordinates are correlated, so all second moments of the joint blur are right.

use glam::DVec3;

use crate::brdf::sample::Outgoing;

/// Light (s₁, s₂) goes with the places (+, s₁s₂) and (−, −s₁s₂).
pub(crate) const PLACES: [[usize; 2]; 4] = [[0, 3], [1, 2], [1, 2], [0, 3]];

/// Mean of f in sr⁻¹ over the four `lobes`, one per direction of light, and the four outgoing directions `places`. Places
/// that see nothing (`None`) count as dark.
pub(crate) fn mean_f(lobes: &[Box<dyn Outgoing + '_>; 4], places: &[Option<DVec3>; 4]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (lobe, pair) in lobes.iter().zip(PLACES) {
        for place in pair {
            let Some(wo) = places[place] else { continue };
            let f = lobe.f(wo);
            sum = [sum[0] + f[0], sum[1] + f[1], sum[2] + f[2]];
        }
    }
    sum.map(|sum| sum / 8.0)
}

/// Four directions at ±`rad` along two tangents of `w`, in the order ++, +−, −+, −−.
pub(crate) fn around(w: DVec3, rad: f64) -> [DVec3; 4] {
    let (a, b) = w.any_orthonormal_pair();
    [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(x, y)| (w + rad * (x * a + y * b)).normalize())
}

/// Standard deviation in radians along each axis of a spot of light of `diameter_deg` degrees: a quarter of the diameter.
pub(crate) fn spot_rad(diameter_deg: f64) -> f64 {
    diameter_deg.to_radians() / 4.0
}

/// Standard deviation in radians along each axis of a square pixel of `pixel_sr` between which is interpolated linearly.
///
/// A square of side s has s/√12, and interpolation adds s/√6: together s/2.
pub(crate) fn interpolated_pixel_rad(pixel_sr: f64) -> f64 {
    pixel_sr.sqrt() / 2.0
}
