//! Description of an instrument: mirror, sample, camera, projector and light.
//!
//! A rig is read from a TOML file or from one of the embedded presets (`rcg-1`, `rcg-1-16bit`, `rcg-2`, `rcg-3`, `dmd`). The
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

mod binned;
mod driven;
mod error;
mod photodiode;
mod read;
mod signal;
mod tilt;
mod validate;
mod wired;

pub use crate::instrument::parts::{
    Binned, CameraPart, Lens, Light, Mirror, Panel, ProjectorPart, Rig, Sample, Wire,
};
pub(crate) use binned::ROUNDING_DN2;
pub use error::RigError;
pub(crate) use read::explain;
pub use tilt::Tilt;

/// Names of the embedded rigs, in the order in which they are listed to people.
pub const PRESETS: [&str; 5] = ["rcg-1", "rcg-1-16bit", "rcg-2", "rcg-3", "dmd"];

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

    /// The same rig with the camera's image binned to `size_px` × `size_px` pixels, each the mean of the sensor's pixels
    /// behind it (weighted by area) of the central square, in numbers of 16 bits.
    ///
    /// # Errors
    /// [`RigError::Field`] when `size_px` is 0 or more than the sensor has, or when the central square of the sensor
    /// sees nothing.
    pub fn with_image_size(&self, size_px: u32) -> Result<Rig, RigError> {
        let lens = &self.camera.lens;
        let square_px = lens.width_px.min(lens.height_px);
        if !(1..=square_px).contains(&size_px) {
            return Err(RigError::Field {
                path: self.name.clone().into(),
                field: "image size".to_owned(),
                expected: format!("1 to {square_px} pixels, as many as the camera has"),
                found: size_px.to_string(),
            });
        }
        let mut rig = self.clone();
        rig.camera = binned::camera(&self.camera, size_px);
        rig.validate()?;
        Ok(rig)
    }

    /// The same rig with a projector that has one pixel for each square of `side_px` × `side_px` pixels: the rig as it is where that
    /// does not come out even.
    #[must_use]
    pub(crate) fn with_coarse_projector(&self, side_px: u32) -> Rig {
        let mut rig = self.clone();
        let lens = &mut rig.projector.lens;
        if [lens.width_px, lens.height_px]
            .iter()
            .all(|size| size.is_multiple_of(side_px))
        {
            let times = f64::from(side_px);
            lens.width_px /= side_px;
            lens.height_px /= side_px;
            lens.focal_px /= times;
            lens.centre_px = lens.centre_px.map(|at| at / times);
        }
        rig
    }

    /// The rig whose image was binned to this one's, with the sensor of `full`, of which it takes the central square.
    ///
    /// # Errors
    /// [`RigError::Field`] when the sensor sees nothing.
    pub(crate) fn with_sensor_of(&self, full: &Rig) -> Result<Rig, RigError> {
        let mut rig = self.clone();
        let size_px = full.camera.lens.width_px.min(full.camera.lens.height_px);
        rig.camera = CameraPart {
            lens: binned::lens(&self.camera.lens, size_px),
            ..full.camera.clone()
        };
        rig.validate()?;
        Ok(rig)
    }
}

#[cfg(test)]
mod tests;
