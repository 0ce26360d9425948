//! What the digital numbers of a camera say.

use std::sync::Arc;

use crate::instrument::calibration::CameraFound;
use crate::instrument::rig::{ROUNDING_DN2, Rig};

/// What the digital numbers of an image say, the same for all exposure times.
#[derive(Clone)]
pub(in super::super) struct Numbers {
    /// What each would be if the camera were linear; nothing if it is.
    linear: Option<Arc<[f32]>>,
    /// The one without any charge.
    pub(in super::super) level: f32,
    pub(in super::super) saturation: u16,
    /// The least that counts as saturated: up to there the camera is linear.
    pub(in super::super) trusted: u16,
    /// Variance by reading out and rounding, in DN².
    pub(super) read_variance: f32,
    /// Variance of what all of an image's row have in common, in DN².
    pub(super) row_variance: f32,
    /// Standard deviation of the response of pixels, relative.
    pub(in super::super) prnu: f32,
    /// Variance per DN of signal, in DN.
    pub(in super::super) shot_per_dn: f32,
    /// f per (DN / (s × irradiance)).
    pub(in super::super) scale: f64,
}

impl Numbers {
    /// Of the images of `rig`; `camera` is what calibration found, if it did.
    pub(super) fn new(rig: &Rig, camera: Option<&CameraFound>) -> Self {
        let camera = camera.map(|camera| camera.of_image(&rig.camera.binned));
        let gain = camera.map_or_else(|| rig.gain_e_per_dn(), |camera| camera.gain_e_per_dn);
        let read_noise_e = camera.map_or(rig.camera.read_noise_e, |camera| camera.read_noise_e);
        let level = camera.map_or(rig.camera.dark_dn, |camera| camera.dark_dn);
        let saturation = rig.saturation_dn();
        let linear = camera.map(|camera| {
            let range = f64::from(saturation) - level;
            let of = |dn: u16| {
                let signal = f64::from(dn) - level;
                (level + signal * (1.0 + camera.nonlinearity * signal / range)) as f32
            };
            (0..=saturation).map(of).collect()
        });
        let trusted = |camera: CameraFound| camera.trusted_dn(f64::from(saturation)).floor() as u16;
        Self {
            linear,
            level: level as f32,
            saturation,
            trusted: camera.map_or(saturation, |camera| trusted(camera).min(saturation)),
            read_variance: ((read_noise_e / gain).powi(2) + ROUNDING_DN2) as f32,
            row_variance: camera.map_or(0.0, |camera| camera.row_variance_dn2()) as f32,
            prnu: camera.map_or(0.0, |camera| camera.prnu) as f32,
            shot_per_dn: (1.0 / gain) as f32,
            scale: rig.gain_e_per_dn() / rig.sensitivity_e(),
        }
    }

    /// `dn` as a linear camera would give it; the table ends at saturation, and what a file has above that is saturated too.
    #[inline]
    pub(in super::super) fn linear(&self, dn: u16) -> f32 {
        self.linear.as_ref().map_or(f32::from(dn), |linear| {
            linear[usize::from(dn).min(linear.len() - 1)]
        })
    }

    /// The same; NaN where it is saturated.
    #[inline]
    pub(in super::super) fn unsaturated(&self, dn: u16) -> f32 {
        if dn >= self.trusted {
            f32::NAN
        } else {
            self.linear(dn)
        }
    }

    /// Variance of so much light by reading out and photons, in DN².
    #[inline]
    pub(super) fn noise_variance(&self, dn: f32) -> f32 {
        self.read_variance + dn.max(0.0) * self.shot_per_dn
    }

    /// Largest signal, DN.
    pub(super) fn range(&self) -> f32 {
        self.linear(self.trusted) - self.level
    }
}
