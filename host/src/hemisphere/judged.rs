//! Which directions a result is judged by.

use glam::DVec3;

/// Errors are judged up to this polar angle of both directions, in degrees.
pub const JUDGED_THETA_DEG: f64 = 80.0;
/// The reciprocity residual is that of directions up to this polar angle in degrees, as others state it.
pub const RECIPROCAL_THETA_DEG: f64 = 70.0;

/// Whether a direction is among those that are judged.
pub(crate) fn is_judged(w: DVec3) -> bool {
    w.z >= JUDGED_THETA_DEG.to_radians().cos()
}
