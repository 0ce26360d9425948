//! How the sample frame S stands in the mirror frame M.
//!
//! Both have their axes right-handed; S has its origin at F1. Without tilt and azimuth the axes are parallel.
//! The tilt turns about the mirror's y, so that the normal leans towards the mirror's +x; the azimuth then
//! turns the sample's +x about the normal, counter-clockwise for one who looks at the sample. The roll turns all
//! that about the mirror's x: with it the normal can lean in any direction.

use glam::{DMat3, DVec3};

use crate::instrument::parts::Sample;

/// Rotation between sample frame and mirror frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleFrame {
    /// Columns are the sample's x, y and z (the normal) in the mirror frame.
    pub s_to_m: DMat3,
}

impl SampleFrame {
    /// The frame of a rig's sample: `R_x(roll) · R_y(tilt) · R_z(azimuth)`.
    pub fn of(sample: &Sample) -> SampleFrame {
        let tilt = DMat3::from_rotation_y(sample.tilt_deg.to_radians());
        let lean = DMat3::from_rotation_x(sample.roll_deg.to_radians()) * tilt;
        SampleFrame {
            s_to_m: lean * DMat3::from_rotation_z(sample.azimuth_deg.to_radians()),
        }
    }

    /// The vector `w_s` of the sample frame in the mirror frame.
    pub fn to_mirror(&self, w_s: DVec3) -> DVec3 {
        self.s_to_m * w_s
    }

    /// The vector `w_m` of the mirror frame in the sample frame.
    pub fn to_sample(&self, w_m: DVec3) -> DVec3 {
        DVec3::new(
            self.s_to_m.x_axis.dot(w_m),
            self.s_to_m.y_axis.dot(w_m),
            self.s_to_m.z_axis.dot(w_m),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(tilt_deg: f64, azimuth_deg: f64) -> SampleFrame {
        SampleFrame::of(&Sample {
            tilt_deg,
            azimuth_deg,
            ..Sample::default()
        })
    }

    #[test]
    fn the_normal_leans_towards_x_of_the_mirror() {
        let (sin, cos) = 45_f64.to_radians().sin_cos();
        for azimuth_deg in [0.0, 77.0] {
            let normal = frame(45.0, azimuth_deg).to_mirror(DVec3::Z);
            assert!((normal - DVec3::new(sin, 0.0, cos)).length() < 1e-15);
        }
        assert!((frame(45.0, 0.0).to_mirror(DVec3::X) - DVec3::new(cos, 0.0, -sin)).length() < 1e-15);
    }

    #[test]
    fn the_azimuth_turns_x_towards_y() {
        assert!((frame(0.0, 90.0).to_mirror(DVec3::X) - DVec3::Y).length() < 1e-15);
    }

    #[test]
    fn there_and_back_is_the_identity() {
        let frame = frame(33.0, 123.0);
        let w = DVec3::new(0.36, 0.48, 0.8);
        assert!((frame.to_sample(frame.to_mirror(w)) - w).length() < 1e-15);
    }
}
