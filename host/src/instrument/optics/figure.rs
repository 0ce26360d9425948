//! Where a real mirror is not the ellipsoid.
//!
//! # Tradeoffs
//! The normal is turned, the place is not moved: heights are some micrometres where slopes are some tenths of a milliradian,
//! and a ray that is displaced by so little goes elsewhere by a tenth of what the slope does.

use glam::DVec3;

/// By how much a mirror's surface is not the ellipsoid: its figure error.
pub trait Figure: std::fmt::Debug + Send + Sync {
    /// Gradient of the height of the real surface above the ellipsoid, towards the inside, at the place `mirror_m` of it
    /// (mirror frame, metres); mirror frame, radians. What of it is along the normal does not count.
    fn slope(&self, mirror_m: DVec3) -> DVec3;
}
