//! One sample of the result, looked at while it is made: what makes its uncertainty.
//!
//! # Design
//! `brdf.zarr` has one uncertainty per sample, and shares of its causes by regions. What each cause makes of a chosen sample is not stored:
//! that would be eleven numbers for each. So the frames are assembled once more, as far as that sample needs, and it is looked at on
//! the way, in the same code.

use std::sync::{Mutex, PoisonError};

use super::CHUNK;
use crate::brdf::CAUSES;
use crate::instrument::optics::Unmeasurable;

/// A sample that is wanted, and what was found of it.
#[derive(Debug)]
pub struct Probe {
    incident: usize,
    cell: usize,
    found: Mutex<Vec<Probed>>,
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
    /// Of the `cell` of the outgoing disk for an `incident` direction.
    #[must_use]
    pub const fn new(incident: usize, cell: usize) -> Self {
        Self {
            incident,
            cell,
            found: Mutex::new(Vec::new()),
        }
    }

    /// What was found, by channel; nothing if the sample has no value.
    #[must_use]
    pub fn found(self) -> Vec<Probed> {
        let mut found = self.found.into_inner().unwrap_or_else(PoisonError::into_inner);
        found.sort_by_key(|one| one.channel);
        found
    }

    pub(super) const fn is_at(&self, incident: usize, cell: usize) -> bool {
        self.incident == incident && self.cell == cell
    }

    pub(super) fn take(&self, one: Probed) {
        self.found
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(one);
    }

    /// Why each incident direction is not made: for `reasons`, or because a probe wants others.
    pub(super) fn left(
        probe: Option<&Self>,
        mut reasons: Vec<Option<Unmeasurable>>,
    ) -> Vec<Option<Unmeasurable>> {
        for (incident, reason) in reasons.iter_mut().enumerate() {
            if probe.is_some_and(|probe| probe.incident / CHUNK != incident / CHUNK) {
                // Any will do: nobody reads what is made on the way.
                reason.get_or_insert(Unmeasurable::OutsideImage);
            }
        }
        reasons
    }
}
