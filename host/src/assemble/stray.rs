//! Stray light of a measurement's frames.

use super::correction::Correction;
use crate::instrument::calibration::AppliedCalibration;
use crate::instrument::calibration::stray::{PROJECTOR_TERMS, Removal};
use crate::instrument::rig::Rig;

/// How frames lose stray light, and what of it the pattern of each incident direction makes.
pub(super) struct StrayLight {
    removal: Removal,
    /// Of each incident direction, zero where it is not lit.
    lit: Vec<[f64; PROJECTOR_TERMS]>,
}

impl StrayLight {
    /// For frames of `rig` whose images have this `correction`; `None` if calibration did not look for it.
    pub(super) fn new(rig: &Rig, applied: &AppliedCalibration, correction: &Correction) -> Option<Self> {
        let found = &applied.photometry.as_ref()?.stray;
        Some(Self {
            removal: Removal::of(found, rig),
            lit: correction.lit_terms(),
        })
    }

    /// How frames of the incident direction of this `index` lose it.
    pub(super) fn of(&self, index: usize) -> (&Removal, &[f64; PROJECTOR_TERMS]) {
        (&self.removal, &self.lit[index])
    }
}
