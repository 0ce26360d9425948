//! The wire that holds the sample: a strip of directions that it hides, seen from F1.
//!
//! # Design
//! The wire runs from the sample along one half plane through the mirror's axis. It hides the directions
//! within a constant angle of that half plane, which is what a straight wire of constant angular width does.

use glam::DVec3;

use crate::instrument::parts::Wire;

/// The hidden strip, in the mirror frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WireStrip {
    /// Unit vector across the mirror's axis along which the wire runs.
    along: DVec3,
    /// Unit vector across both the wire and the mirror's axis.
    across: DVec3,
    /// Sine of half the strip's angular width.
    half_width: f64,
}

impl WireStrip {
    /// The strip of a rig's wire.
    pub fn of(wire: &Wire) -> WireStrip {
        let (sin, cos) = wire.azimuth_deg.to_radians().sin_cos();
        WireStrip {
            along: DVec3::new(cos, sin, 0.0),
            across: DVec3::new(-sin, cos, 0.0),
            half_width: wire.half_width_deg.to_radians().sin(),
        }
    }

    /// Angle from the strip to the unit direction `w_m` at F1, radians, negative within it; `None` on the side without a
    /// wire.
    pub fn distance_rad(&self, w_m: DVec3) -> Option<f64> {
        let beside_rad = w_m.dot(self.across).abs().min(1.0).asin() - self.half_width.asin();
        (w_m.dot(self.along) > 0.0).then_some(beside_rad)
    }

    /// On which side of the wire's plane the vector `m` from F1 (mirror frame) points; `None` on the side without a wire.
    pub(super) fn is_left(&self, m: DVec3) -> Option<bool> {
        (m.dot(self.along) > 0.0).then(|| m.dot(self.across) > 0.0)
    }

    /// Whether the wire hides the unit direction `w_m` at F1 (mirror frame).
    pub fn hides(&self, w_m: DVec3) -> bool {
        w_m.dot(self.along) > 0.0 && w_m.dot(self.across).abs() <= self.half_width
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;

    #[test]
    fn the_strip_has_the_same_width_at_every_height_and_one_side_only() {
        let strip = WireStrip::of(&Wire {
            azimuth_deg: 30.0,
            half_width_deg: 2.0,
        });
        for theta_deg in [10.0, 30.0, 60.0, 90.0] {
            let sin_theta = f64::to_radians(theta_deg).sin();
            let half_deg = (2_f64.to_radians().sin() / sin_theta).asin().to_degrees();
            for (phi_deg, hidden) in [
                (30.0, true),
                (30.0 + 0.999 * half_deg, true),
                (30.0 - 0.999 * half_deg, true),
                (30.0 + 1.001 * half_deg, false),
                (30.0 - 1.001 * half_deg, false),
                (210.0, false),
            ] {
                assert_eq!(
                    strip.hides(from_degrees(theta_deg, phi_deg)),
                    hidden,
                    "{theta_deg} {phi_deg}"
                );
            }
        }
    }
}
