//! Stray light of a measurement's frames.

use rayon::prelude::*;

use crate::instrument::calibration::AppliedCalibration;
use crate::instrument::calibration::stray::{PROJECTOR_TERMS, Removal, dark_pixels, lit_terms};
use crate::instrument::optics::View;
use crate::instrument::rig::Rig;
use crate::plan::pattern::PatternMaker;
use crate::plan::{Directions, Plan};

/// How frames lose stray light, and what of it the pattern of each incident direction makes.
pub(super) struct StrayLight {
    removal: Removal,
    /// Of each incident direction, zero where it is not lit.
    lit: Vec<[f64; PROJECTOR_TERMS]>,
}

impl StrayLight {
    /// For frames of `rig` that show the patterns of `plan`; `None` if calibration did not look for it.
    pub(super) fn new(
        rig: &Rig,
        plan: &Plan,
        directions: &Directions,
        applied: &AppliedCalibration,
    ) -> Option<Self> {
        let found = &applied.photometry.as_ref()?.stray;
        let camera = View::camera(rig);
        let format = rig.frame_format();
        let dark = dark_pixels(&camera.cut_pixels(0.0), format.width_px);
        let projector = View::projector(rig);
        let maker = PatternMaker::new(projector, plan.spot_deg, rig.projector.irradiance);
        let (width_px, height_px) = maker.size_px();
        let lit = |index: usize| {
            let lit = maker.lit_set(directions.grid.direction(index)).ok();
            lit.filter(|_| directions.reasons[index].is_none())
                .map_or([0.0; PROJECTOR_TERMS], |lit| {
                    lit_terms(&lit.pixels, width_px, height_px)
                })
        };
        Some(Self {
            removal: Removal::new(found, format.width_px, format.height_px, dark),
            lit: (0..directions.grid.len()).into_par_iter().map(lit).collect(),
        })
    }

    /// How frames of the incident direction of this `index` lose it.
    pub(super) fn of(&self, index: usize) -> (&Removal, &[f64; PROJECTOR_TERMS]) {
        (&self.removal, &self.lit[index])
    }
}
