//! Directions on the sphere and the angles that name them.
//!
//! # Design
//! Inside the program a direction is a unit vector (`glam::DVec3`) that points *away* from the
//! surface, the incident one too. Angles exist only at the edges: files, the command line, reports.
//! θ is measured from the surface normal +z, φ from +x towards +y.

use std::f64::consts::TAU;

use glam::DVec3;

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
