//! Directions on the sphere and the angles that name them.
//!
//! # Design
//! Inside the program a direction is a unit vector (`glam::DVec3`) that points *away* from the
//! surface, the incident one too. Angles exist only at the edges: files, the command line, reports.
//! θ is measured from the surface normal +z, φ from +x towards +y.
//!
//! *The horizon.* f is the radiance that leaves over the irradiance that arrives. At θ = 90° none arrives, so that f is not
//! defined there, and models with a cosine in their denominator grow without bound towards it. Therefore every source of f
//! (model, measured file, measurement) has values for the open hemisphere θ < 90° and answers `below horizon` from 90° on
//! ([`is_above_horizon`]). A direction at 90° still has its place in an image: optics speak of the closed hemisphere.

use std::f64::consts::TAU;

use glam::DVec3;
use rand::RngExt;

/// Directions whose cosine is at or below this count as at the horizon.
///
/// A direction at exactly 90° has a cosine of 6·10⁻¹⁷ rather than 0 in `f64`; ten thousand times that leaves room
/// for a rotation of frames, and is still far below the angle of any pixel (6·10⁻¹¹ degrees).
pub const HORIZON_COS: f64 = 1e-12;

/// Whether f is defined for the unit vector `w`: its polar angle is below 90°. What is no direction at all (NaN) is not.
#[must_use]
pub fn is_above_horizon(w: DVec3) -> bool {
    w.z > HORIZON_COS
}

/// Unit vector of polar angle `theta_rad` and azimuth `phi_rad`, both in radians.
#[must_use]
pub fn from_angles(theta_rad: f64, phi_rad: f64) -> DVec3 {
    let (sin_theta, cos_theta) = theta_rad.sin_cos();
    let (sin_phi, cos_phi) = phi_rad.sin_cos();
    DVec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta)
}

/// Unit vector of polar angle `theta_deg` and azimuth `phi_deg`, both in degrees.
#[must_use]
pub fn from_degrees(theta_deg: f64, phi_deg: f64) -> DVec3 {
    from_angles(theta_deg.to_radians(), phi_deg.to_radians())
}

/// A unit vector that `rng` draws, evenly by solid angle, up to `theta_deg` degrees from the normal.
pub(crate) fn drawn(rng: &mut impl RngExt, theta_deg: f64) -> DVec3 {
    let z: f64 = rng.random_range(theta_deg.to_radians().cos()..1.0);
    from_degrees(z.acos().to_degrees(), rng.random_range(0.0..360.0))
}

/// Polar angle θ ∈ [0, π] and azimuth φ ∈ [0, 2π) of the unit vector `w`, in radians; φ = 0 at the poles.
///
/// Exact near the pole, where `acos(z)` would lose half of the digits.
#[must_use]
pub fn to_angles(w: DVec3) -> (f64, f64) {
    let theta_rad = w.x.hypot(w.y).atan2(w.z);
    (theta_rad, turned_up(w.y.atan2(w.x), TAU))
}

/// As [`to_angles`] in degrees: θ ∈ [0, 180] and φ ∈ [0, 360).
#[must_use]
pub fn to_degrees(w: DVec3) -> (f64, f64) {
    let (theta_rad, phi_rad) = to_angles(w);
    (theta_rad.to_degrees(), turned_up(phi_rad.to_degrees(), 360.0))
}

/// Cosine of the azimuth between the unit vectors `a` and `b`; 0, that of a quarter turn, where one of them is the normal.
#[must_use]
pub(crate) fn azimuth_cosine(a: DVec3, b: DVec3) -> f64 {
    let (a, b) = (a.truncate(), b.truncate());
    let lengths = a.length() * b.length();
    if lengths > 1e-12 {
        (a.dot(b) / lengths).clamp(-1.0, 1.0)
    } else {
        0.0
    }
}

/// An azimuth from minus one turn to one turn, brought to [0, `turn`). What lies below 0 by less than rounding would come
/// to a whole turn, and so may what is converted from a number just below one.
fn turned_up(phi: f64, turn: f64) -> f64 {
    let up = if phi < 0.0 { phi + turn } else { phi };
    // The sum makes 0 of −0.
    if up < turn { up + 0.0 } else { 0.0 }
}

/// Angle between two unit vectors in radians, exact for small angles.
///
/// Source: W. Kahan, "How futile are mindless assessments of roundoff", §12: 2·atan2(|a−b|, |a+b|).
#[must_use]
pub fn angle_between(a: DVec3, b: DVec3) -> f64 {
    2.0 * (a - b).length().atan2((a + b).length())
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    /// Components that put azimuths at, and next to, the places where they are rounded or turned.
    fn awkward() -> Vec<f64> {
        let mut all = vec![0.0, f64::MIN_POSITIVE, f64::from_bits(1), f64::EPSILON, 1.0];
        all.extend((-60..0).map(|power| 2_f64.powi(power)));
        all.extend([0.5, 1.5, 2.5, 3.5].map(|ulps| ulps * f64::EPSILON));
        all.extend([f64::from(f32::EPSILON), f64::from(f32::MIN_POSITIVE)]);
        all.iter().flat_map(|v| [*v, -v]).collect()
    }

    #[test]
    fn azimuths_are_within_one_turn_and_name_their_direction() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let awkward = awkward();
        let pairs = awkward.iter().flat_map(|x| awkward.iter().map(move |y| (*x, *y)));
        let crafted = pairs.map(|(x, y)| DVec3::new(x, y, 0.5).normalize_or(DVec3::Z));
        // What single precision has rounded is a direction too.
        let drawn = (0..20_000).flat_map(|_| {
            let (theta_rad, turn) = (rng.random_range(0.0..3.2), rng.random_range(-60..0));
            let w = from_angles(theta_rad, rng.random_range(0.0..TAU));
            let near_turn = from_angles(theta_rad, -(2_f64.powi(turn)));
            [
                w,
                near_turn,
                w.as_vec3().as_dvec3(),
                near_turn.as_vec3().as_dvec3(),
            ]
        });
        for w in crafted.chain(drawn) {
            let (theta_rad, phi_rad) = to_angles(w);
            let (theta_deg, phi_deg) = to_degrees(w);
            assert!(
                (0.0..TAU).contains(&phi_rad) && phi_rad.is_sign_positive(),
                "{w}: {phi_rad}"
            );
            assert!(
                (0.0..360.0).contains(&phi_deg) && phi_deg.is_sign_positive(),
                "{w}: {phi_deg}"
            );
            assert!((0.0..=180.0).contains(&theta_deg), "{w}: {theta_deg}");
            let w = w.normalize();
            assert!(angle_between(from_angles(theta_rad, phi_rad), w) < 1e-14, "{w}");
            assert!(angle_between(from_degrees(theta_deg, phi_deg), w) < 1e-14, "{w}");
        }
    }
}
