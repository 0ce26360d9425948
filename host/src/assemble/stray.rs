//! Stray light of a measurement's frames.

use super::correction::Correction;
use super::radiometry::Radiometry;
use crate::instrument::calibration::AppliedCalibration;
use crate::instrument::calibration::LampFound;
use crate::instrument::calibration::photometry::COMMAND;
use crate::instrument::calibration::stray::{Bias, ByBand, Level, PROJECTOR_TERMS, Removal, Told};
use crate::instrument::rig::Rig;
use crate::plan::Plan;

/// How frames lose stray light, and what of it the pattern of each incident direction makes.
pub(super) struct StrayLight {
    removal: Removal,
    /// Of each incident direction, zero where it is not lit.
    lit: Vec<[f64; PROJECTOR_TERMS]>,
    /// Of each exposure time, what its frames are off by alike.
    bias: Vec<ByBand<Bias>>,
}

impl StrayLight {
    /// For frames of `rig` that `plan` made, whose images have this `correction`, while the lamp changed by this variance, if black
    /// frames tell; `None` if calibration did not look for it.
    pub(super) fn new(
        rig: &Rig,
        plan: &Plan,
        applied: &AppliedCalibration,
        correction: &Correction,
        lamp_variance: Option<f64>,
    ) -> Option<Self> {
        let found = applied.photometry.as_ref()?;
        Some(Self {
            removal: Removal::of(&found.stray, &found.lamp, plan.watching_side, rig).in_run(lamp_variance),
            lit: correction.lit_terms(),
            bias: Vec::new(),
        })
    }

    /// The lamp in the black frames over that of the calibration, from those exposures that tell it best.
    ///
    /// # Errors
    /// What is wrong if another lamp must have been in it.
    pub(super) fn lamp(&self, radiometry: &[Radiometry], channels: usize) -> Result<Level, String> {
        let of_each = radiometry.iter().filter_map(|one| {
            let [watching, others] = one.watched_image(channels)?;
            self.removal
                .level_of_watching(&watching, &others, one.counts, one.exposure_s)
        });
        let Some(best) = Level::best(of_each) else {
            return Ok(Level::of_all(1.0, LampFound::UNWATCHED as f32));
        };
        let level = Level::of_all(
            best.light,
            best.uncertainty.hypot(self.removal.level_uncertainty()),
        );
        if !level.is_same_lamp() {
            return Err(format!(
                "lamp: expected light within {} % of that of the calibration, found {:.1} ± {:.1} % of it; was the lamp \
                 changed? `{COMMAND}` again",
                100.0 * Level::LARGEST_CHANGE,
                100.0 * level.light,
                100.0 * level.uncertainty
            ));
        }
        Ok(level.beside(LampFound::UNWATCHED))
    }

    /// Learns what frames are off by alike from what some of them `told` of the lamp, [pattern][exposure time], beside black ones as in
    /// `radiometry`, from which it changed `slowly` by so much, relative (k = 1).
    pub(super) fn learn(
        &mut self,
        told: &[Vec<ByBand<Option<Told>>>],
        radiometry: &[Radiometry],
        slowly: f64,
    ) {
        let of = |(exposure, one): (usize, &Radiometry)| {
            let of_time: Vec<ByBand<Option<Told>>> = told.iter().map(|pattern| pattern[exposure]).collect();
            self.removal.bias(&of_time, one.counts[0], slowly)
        };
        self.bias = radiometry.iter().enumerate().map(of).collect();
    }

    /// See [`learn`](Self::learn); nothing before that.
    pub(super) fn bias(&self) -> &[ByBand<Bias>] {
        &self.bias
    }

    /// How frames lose it.
    pub(super) const fn removal(&self) -> &Removal {
        &self.removal
    }

    /// How frames of the incident direction of this `index` lose it.
    pub(super) fn of(&self, index: usize) -> (&Removal, &[f64; PROJECTOR_TERMS]) {
        (&self.removal, &self.lit[index])
    }

    /// How frames that light the incident directions of these `indices` together lose it.
    pub(super) fn of_all(
        &self,
        indices: impl IntoIterator<Item = usize>,
    ) -> (&Removal, [f64; PROJECTOR_TERMS]) {
        let mut all = [0.0; PROJECTOR_TERMS];
        for index in indices {
            for (all, lit) in all.iter_mut().zip(&self.lit[index]) {
                *all += lit;
            }
        }
        (&self.removal, all)
    }
}
