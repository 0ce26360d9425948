//! What the numbers of a rig say about its signal.

use super::Rig;
use crate::instrument::frame_format::FrameFormat;
use crate::instrument::optics::cone_sr;

impl Rig {
    /// Shape of the camera's frames.
    #[must_use]
    pub fn frame_format(&self) -> FrameFormat {
        FrameFormat {
            width_px: self.camera.lens.width_px as usize,
            height_px: self.camera.lens.height_px as usize,
            channels: self.camera.channels as usize,
            bits: self.camera.bits,
        }
    }

    /// The largest digital number.
    #[must_use]
    pub fn saturation_dn(&self) -> u16 {
        self.frame_format().saturation_dn()
    }

    /// Electrons per digital number: the full well fills the range above the dark level.
    #[must_use]
    pub fn gain_e_per_dn(&self) -> f64 {
        self.camera.full_well_e / (f64::from(self.saturation_dn()) - self.camera.dark_dn)
    }

    /// K of the signal model (see [`crate::assemble`]) in electrons: charge per (f in sr⁻¹ × Σ E·cosθ·Δω × exposure time in s).
    ///
    /// `light.full_scale_f_sr` fills the well with the default exposure and a spot of 1° at normal incidence.
    #[must_use]
    pub fn sensitivity_e(&self) -> f64 {
        let irradiance = self.projector.irradiance * cone_sr(1.0);
        self.camera.full_well_e / (self.light.full_scale_f_sr * irradiance * self.camera.exposure_s)
    }
}
