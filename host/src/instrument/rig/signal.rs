//! What the numbers of a rig say about its signal.

use super::{ROUNDING_DN2, Rig};
use crate::instrument::bands::{MadeBy, PRIMARIES};
use crate::instrument::frame_format::FrameFormat;
use crate::instrument::optics::cone_sr;

impl Rig {
    /// Whether the projector makes the bands, before a camera without colours: each pattern is shown in one primary after the other, and
    /// the frames of all are the channels of one image.
    #[must_use]
    pub fn shows_bands(&self) -> bool {
        let made_by = self.bands.as_ref().map(|bands| bands.made_by);
        made_by == Some(MadeBy::Projector)
    }

    /// How often each pattern is shown: in each of the projector's primaries where these are the bands, else once, in white.
    #[must_use]
    pub fn shown_bands(&self) -> usize {
        if self.shows_bands() { PRIMARIES } else { 1 }
    }

    /// Channels of images and results: those of the camera's frames, or the bands that the projector makes before a camera of one.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.camera.channels as usize * self.shown_bands()
    }

    /// This rig with bands as `other` has them, as far as the camera makes both: what they are called changes no image.
    #[must_use]
    pub fn with_bands_of(&self, other: &Self) -> Self {
        let is_by_projector = self.shows_bands() || other.shows_bands();
        Self {
            bands: if is_by_projector {
                &self.bands
            } else {
                &other.bands
            }
            .clone(),
            ..self.clone()
        }
    }

    /// Shape of the images of a measurement, all bands in one.
    #[must_use]
    pub fn frame_format(&self) -> FrameFormat {
        FrameFormat {
            channels: self.channels(),
            ..self.camera_format()
        }
    }

    /// Shape of the camera's own frames.
    #[must_use]
    pub fn camera_format(&self) -> FrameFormat {
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

    /// Digital numbers from the dark level to saturation.
    #[must_use]
    pub fn range_dn(&self) -> f64 {
        f64::from(self.saturation_dn()) - self.camera.dark_dn
    }

    /// Electrons per digital number: the full well fills the range above the dark level.
    #[must_use]
    pub fn gain_e_per_dn(&self) -> f64 {
        self.camera.full_well_e / self.range_dn()
    }

    /// Variance of a pixel without light in an exposure of `exposure_s` seconds, in electrons²: read noise, rounding, and the
    /// shot noise of the dark current.
    #[must_use]
    pub fn dark_variance_e2(&self, exposure_s: f64) -> f64 {
        let (camera, gain) = (&self.camera, self.gain_e_per_dn());
        camera.read_noise_e.powi(2) + gain * gain * ROUNDING_DN2 + camera.dark_current_e_per_s * exposure_s
    }

    /// Electrons of light per second that a pixel shows with the digital number `dn` after `exposure_s` seconds.
    #[must_use]
    pub fn light_e_per_s(&self, dn: u16, exposure_s: f64) -> f64 {
        let camera = &self.camera;
        (f64::from(dn) - camera.dark_dn) * self.gain_e_per_dn() / exposure_s - camera.dark_current_e_per_s
    }

    /// K of the signal model (see [`crate::assemble`]) in electrons: charge per (f in sr⁻¹ × Σ E·cosθ·Δω × exposure time in s).
    ///
    /// `light.full_scale_f_sr` fills the well with the default exposure and a spot of 1° at normal incidence: in white light, or in each
    /// band where the projector makes them.
    #[must_use]
    pub fn sensitivity_e(&self) -> f64 {
        let irradiance = self.projector.irradiance * cone_sr(1.0);
        self.camera.full_well_e / (self.light.full_scale_f_sr * irradiance * self.camera.exposure_s)
    }
}
