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

/// Polar angle θ ∈ [0, π] and azimuth φ ∈ [0, 2π) of the unit vector `w`, in radians.
///
/// Exact near the pole, where `acos(z)` would lose half of the digits.
#[must_use]
pub fn to_angles(w: DVec3) -> (f64, f64) {
    let theta_rad = w.x.hypot(w.y).atan2(w.z);
    let phi_rad = w.y.atan2(w.x);
    (theta_rad, if phi_rad < 0.0 { phi_rad + TAU } else { phi_rad })
}

/// Angle between two unit vectors in radians, exact for small angles.
///
/// Source: W. Kahan, "How futile are mindless assessments of roundoff", §12: 2·atan2(|a−b|, |a+b|).
#[must_use]
pub fn angle_between(a: DVec3, b: DVec3) -> f64 {
    2.0 * (a - b).length().atan2((a + b).length())
}
