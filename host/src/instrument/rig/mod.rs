//! Description of an instrument: mirror, sample, camera, projector and light.
//!
//! A rig is read from a TOML file or from one of the embedded presets (`rcg-1`, `rcg-2`, `dmd`). The
//! preset files comment every key with its unit and are the reference for writing one's own.
//!
//! # Design
//! [`Rig`] ([`crate::instrument::parts`]) holds numbers exactly as the file has them: metres, seconds, pixels and degrees, with the unit
//! in the name. It computes nothing optical; [`crate::instrument::optics::View`] turns it into a map between pixels
//! and directions. Every way of reading a rig ends in [`Rig::validate`], so a rig that was read is one that
//! can be built: each number is in its range and camera and projector see part of the hemisphere.
//!
//! # Tradeoffs
//! Unknown keys are refused. A rig of a newer version cannot be read by an older program, but a misspelt
//! optional key (`rotaton_deg`) never silently becomes zero.

mod error;
mod read;
mod signal;
mod tilt;
mod validate;

pub use crate::instrument::parts::{CameraPart, Lens, Light, Mirror, ProjectorPart, Rig, Sample, Wire};
pub use error::RigError;
pub(crate) use read::explain;
pub use tilt::Tilt;

/// Names of the embedded rigs, in the order in which they are listed to people.
pub const PRESETS: [&str; 3] = ["rcg-1", "rcg-2", "dmd"];

impl Rig {
    /// Shortest time in seconds from one exposure of `exposure_s` seconds to the next with a new pattern.
    ///
    /// The pattern settles, the camera waits out its exposure delay and exposes. A camera that cannot
    /// overlap then reads out before the next pattern is worth showing; one that can only needs its
    /// read-out to be over before the next one ends. Never shorter than the projector's pattern period.
    pub fn step_period_s(&self, exposure_s: f64) -> f64 {
        let lit_s = self.projector.settle_s + self.camera.exposure_delay_s + exposure_s;
        let camera_s = if self.camera.overlap {
            lit_s.max(self.camera.readout_s)
        } else {
            lit_s + self.camera.readout_s
        };
        camera_s.max(self.projector.min_period_s)
    }

    /// The same rig with a read noise of `read_noise_e` electrons. The dark level is raised to six times that, if it is
    /// lower, as in any camera with such a noise: else the converter would cut off what is below 0.
    ///
    /// # Errors
    /// [`RigError::Field`] for a number out of range.
    pub fn with_read_noise(&self, read_noise_e: f64) -> Result<Rig, RigError> {
        let mut rig = self.clone();
        rig.camera.read_noise_e = read_noise_e;
        rig.validate()?;
        // The gain follows from the dark level: dark_dn = share · (saturation_dn − dark_dn).
        let share = 6.0 * read_noise_e / rig.camera.full_well_e;
        let dark_dn = f64::from(rig.saturation_dn()) * share / (1.0 + share);
        rig.camera.dark_dn = rig.camera.dark_dn.max(dark_dn);
        rig.validate()?;
        Ok(rig)
    }

    /// The same rig with the camera's image scaled to `size_px` × `size_px` pixels.
    ///
    /// Takes the central square of the sensor and scales focal length and principal point, so that a
    /// direction stays at the same relative place. Sensor keys stay as they are: a binned pixel is
    /// described like a pixel, because `light.full_scale_f_sr` ties its signal to its full well.
    ///
    /// # Errors
    /// [`RigError::Field`] when `size_px` is 0 or above 32768, or when the central square of the sensor
    /// sees nothing.
    pub fn with_image_size(&self, size_px: u32) -> Result<Rig, RigError> {
        let mut rig = self.clone();
        let lens = &mut rig.camera.lens;
        let (width_px, height_px) = (f64::from(lens.width_px), f64::from(lens.height_px));
        let square_px = width_px.min(height_px);
        let scale = f64::from(size_px) / square_px;
        lens.focal_px *= scale;
        lens.centre_px[0] = (lens.centre_px[0] - (width_px - square_px) / 2.0) * scale;
        lens.centre_px[1] = (lens.centre_px[1] - (height_px - square_px) / 2.0) * scale;
        lens.width_px = size_px;
        lens.height_px = size_px;
        rig.validate()?;
        Ok(rig)
    }
}

#[cfg(test)]
mod tests;
