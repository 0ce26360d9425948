//! What calibration has not seen the standard at: there the sample is missed, wholly or in part.
//!
//! # Design
//! By the rig file a ray that meets the sample plane within the sample's radius is on the sample. Where camera, projector and
//! sample really are, the frames of the standard tell ([`Sight`]). Camera pixels and incident directions at which it was
//! not seen give no value, for the reason [`Unmeasurable::OffSample`].

use glam::DVec3;

use super::AssembleError;
use crate::instrument::calibration::AppliedCalibration;
use crate::instrument::calibration::Sight;
use crate::instrument::optics::{Unmeasurable, View};
use crate::plan::Plan;

/// Camera pixels and incident directions that are on the sample.
pub(super) struct OffSample<'a> {
    sight: Option<&'a Sight>,
}

impl<'a> OffSample<'a> {
    /// Of what `applied` says of samples that stand as in `plan`.
    ///
    /// # Errors
    /// [`AssembleError::Mismatch`] if the standard was not captured at the tilt of the sample.
    pub(super) fn new(applied: &'a AppliedCalibration, plan: &Plan) -> Result<Self, AssembleError> {
        let sight = applied.photometry.as_ref().map(|photometry| {
            photometry
                .sight(plan.request.tilt)
                .map_err(|error| AssembleError::Mismatch {
                    path: AppliedCalibration::FILE.to_owned(),
                    reason: error.to_string(),
                })
        });
        Ok(Self {
            sight: sight.transpose()?,
        })
    }

    /// Adds to the reasons `cut` of the pixels of `camera` those that look past the sample.
    pub(super) fn cut_pixels(&self, cut: &mut [Option<Unmeasurable>], camera: &View) {
        let Some(sight) = self.sight else { return };
        let (width_px, height_px) = (camera.pinhole().width_px(), camera.pinhole().height_px());
        let on_sample = sight.pixels(width_px as usize, height_px as usize);
        for (reason, _) in cut.iter_mut().zip(on_sample).filter(|(_, on)| !on) {
            reason.get_or_insert(Unmeasurable::OffSample);
        }
    }

    /// Whether light from `w` misses the sample.
    pub(super) fn is_missed(&self, w: DVec3) -> bool {
        self.sight.is_some_and(|sight| !sight.is_lit(w))
    }
}
