//! Anything that has a BRDF value: a measured table or a known sample.
//!
//! # Design
//! All of them have values for the same directions, those above the horizon ([`crate::hemisphere::direction::is_above_horizon`]), less
//! what an instrument did not see; for any other direction they give the reason, never a number.

use glam::DVec3;
use rayon::prelude::*;

use crate::brdf::sample::Sample;
use crate::hemisphere::direction::is_above_horizon;
use crate::instrument::optics::Unmeasurable;
use crate::store::StoreError;

/// Why there is no value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Missing {
    /// The instrument does not reach the incident direction.
    Incident(Unmeasurable),
    /// The instrument does not reach the outgoing direction.
    Outgoing(Unmeasurable),
    /// The camera saturated there.
    Saturated,
    /// A file of another program has none.
    Unknown,
}

impl Missing {
    /// Why no source whatever has f for these directions (incident, outgoing): one of them is not above the horizon.
    #[must_use]
    pub fn at_horizon(wi: DVec3, wo: DVec3) -> Option<Self> {
        let below = Unmeasurable::BelowHorizon;
        if !is_above_horizon(wi) {
            Some(Self::Incident(below))
        } else if !is_above_horizon(wo) {
            Some(Self::Outgoing(below))
        } else {
            None
        }
    }
}

impl std::fmt::Display for Missing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Incident(reason) | Self::Outgoing(reason) => reason.fmt(f),
            Self::Saturated => f.write_str("saturated"),
            Self::Unknown => f.write_str("no value in the file"),
        }
    }
}

/// f in sr⁻¹ per channel (a single channel is repeated), or why not.
pub type Value = Result<[f32; 3], Missing>;

/// A source of values of f in sr⁻¹.
pub trait Reflectance: Sync {
    /// f for pairs of unit vectors (incident, outgoing), both away from the surface, in the order asked.
    ///
    /// # Errors
    /// [`StoreError`] if a file cannot be read.
    fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError>;
}

impl Reflectance for &dyn Sample {
    fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
        Ok(known_values(*self, pairs))
    }
}

impl Reflectance for Box<dyn Sample> {
    fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
        Ok(known_values(self.as_ref(), pairs))
    }
}

fn known_values(sample: &dyn Sample, pairs: &[(DVec3, DVec3)]) -> Vec<Value> {
    let value = |&(wi, wo): &(DVec3, DVec3)| {
        let missing = Missing::at_horizon(wi, wo);
        if let Some(missing) = missing {
            return Err(missing);
        }
        let f = sample.f(wi, wo);
        if f.iter().any(|f| f.is_nan()) {
            Err(Missing::Unknown)
        } else {
            Ok(f.map(|f| f as f32))
        }
    };
    pairs.par_iter().map(value).collect()
}
