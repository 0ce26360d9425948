//! Samples of the result, looked at while they are made: what makes their uncertainty.
//!
//! # Design
//! `brdf.zarr` has one uncertainty per sample, and shares of its causes by regions. What each cause makes of a chosen sample is not stored:
//! that would be eleven numbers for each. So the frames are assembled once more, as far as the chosen samples need, and these are
//! looked at on the way, in the same code.

use std::sync::{Mutex, PoisonError};

use super::CHUNK;
use crate::brdf::CAUSES;
use crate::instrument::optics::Unmeasurable;

/// Samples that are wanted, and what was found of them.
#[derive(Debug)]
pub struct Probe {
    /// Incident direction and cell of the outgoing disk, by index.
    samples: Vec<[usize; 2]>,
    /// With the place of the sample among them.
    found: Mutex<Vec<(usize, Probed)>>,
}

/// What was found of one channel of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probed {
    /// The channel.
    pub channel: usize,
    /// f, sr⁻¹.
    pub f: f32,
    /// What of it was taken away as light that returned onto the sample, sr⁻¹.
    pub returned: f32,
    /// Variance of f by each of [`CAUSES`], sr⁻².
    pub variances: [f32; CAUSES.len()],
}

impl Probe {
    /// Of these `samples`: incident direction and cell of the outgoing disk, by index.
    #[must_use]
    pub const fn new(samples: Vec<[usize; 2]>) -> Self {
        Self {
            samples,
            found: Mutex::new(Vec::new()),
        }
    }

    /// What was found of each sample, by channel; nothing of one that has no value.
    #[must_use]
    pub fn found(self) -> Vec<Vec<Probed>> {
        let mut all = vec![Vec::new(); self.samples.len()];
        for (sample, one) in self.found.into_inner().unwrap_or_else(PoisonError::into_inner) {
            all[sample].push(one);
        }
        for found in &mut all {
            found.sort_by_key(|one| one.channel);
        }
        all
    }

    /// Takes what was found of a sample, if that is wanted.
    pub(super) fn take(&self, sample: [usize; 2], found: impl Fn() -> Probed) {
        for (place, wanted) in self.samples.iter().enumerate() {
            if *wanted == sample {
                let mut all = self.found.lock().unwrap_or_else(PoisonError::into_inner);
                all.push((place, found()));
            }
        }
    }

    /// Why each incident direction is not made: for `reasons`, or because a probe wants others.
    pub(super) fn left(
        probe: Option<&Self>,
        mut reasons: Vec<Option<Unmeasurable>>,
    ) -> Vec<Option<Unmeasurable>> {
        for (incident, reason) in reasons.iter_mut().enumerate() {
            let is_beside = |[wanted, _]: &[usize; 2]| wanted / CHUNK != incident / CHUNK;
            if probe.is_some_and(|probe| probe.samples.iter().all(is_beside)) {
                // Any will do: nobody reads what is made on the way.
                reason.get_or_insert(Unmeasurable::OutsideImage);
            }
        }
        reasons
    }
}
