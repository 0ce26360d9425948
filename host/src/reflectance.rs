//! Anything that has a BRDF value: a measured table or a known sample.
//!
//! # Design
//! All of them have values for the same directions, those above the horizon ([`crate::direction::is_above_horizon`]), less
//! what an instrument did not see; for any other direction they give the reason, never a number.

use std::path::Path;

use glam::DVec3;
use rayon::prelude::*;

use crate::brdf::{Brdf, BrdfError, Missing, Value};
use crate::sample::{Sample, SampleError, parse};
use crate::store::StoreError;

/// A source of values of f in sr⁻¹.
pub trait Reflectance: Sync {
    /// f for pairs of unit vectors (incident, outgoing), both away from the surface, in the order asked.
    ///
    /// # Errors
    /// [`StoreError`] if a file cannot be read.
    fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError>;
}

impl Reflectance for Brdf {
    fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
        Brdf::values(self, pairs)
    }
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
        missing.map_or_else(|| Ok(sample.f(wi, wo).map(|f| f as f32)), Err)
    };
    pairs.par_iter().map(value).collect()
}

/// Why there is no such source.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// A measured BRDF.
    #[error(transparent)]
    Brdf(#[from] BrdfError),
    /// A sample.
    #[error(transparent)]
    Sample(#[from] SampleError),
}

/// A measured BRDF or a known sample.
pub enum Source {
    /// A `brdf.zarr`.
    Measured(Box<Brdf>),
    /// A model or a measured file.
    Known(Box<dyn Sample>),
}

impl Source {
    /// Opens `spec`: a `brdf.zarr`, or a sample as in [`parse`].
    ///
    /// # Errors
    /// [`SourceError`].
    pub fn open(spec: &str) -> Result<Self, SourceError> {
        let path = Path::new(spec);
        if path.is_dir() || path.extension().is_some_and(|extension| extension == "zarr") {
            Ok(Self::Measured(Box::new(Brdf::open(path)?)))
        } else {
            Ok(Self::Known(parse(spec)?))
        }
    }

    /// As something that has values.
    #[must_use]
    pub fn reflectance(&self) -> &dyn Reflectance {
        match self {
            Self::Measured(brdf) => brdf.as_ref(),
            Self::Known(sample) => sample,
        }
    }
}
