//! A measured BRDF or a known sample, whichever a user names.

use std::path::Path;

use glam::DVec3;

use super::{Brdf, BrdfError};
use crate::base::blame::Blame;
use crate::brdf::reflectance::{Reflectance, Value};
use crate::brdf::sample::{Sample, SampleError, parse};
use crate::store::StoreError;

impl Reflectance for Brdf {
    fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
        Brdf::values(self, pairs)
    }
}

/// Name of the BRDF in the directory of a measurement.
const MEASURED: &str = "brdf.zarr";

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

impl Blame for SourceError {
    fn is_input(&self) -> bool {
        match self {
            Self::Brdf(error) => error.is_input(),
            Self::Sample(_) => true,
        }
    }
}

/// A measured BRDF or a known sample.
pub enum Source {
    /// A `brdf.zarr`.
    Measured(Box<Brdf>),
    /// A model or a measured file.
    Known(Box<dyn Sample>),
}

impl Source {
    /// Opens `spec`, to be held in memory where many values are asked of a file ([`Brdf::held_when_busy`]): a `brdf.zarr`, the directory of a measurement that has one, or a sample as in [`parse`].
    ///
    /// # Errors
    /// [`SourceError`].
    pub fn open(spec: &str) -> Result<Self, SourceError> {
        let path = Path::new(spec);
        let own = path.join(MEASURED);
        if own.is_dir() {
            Ok(Self::Measured(Box::new(Brdf::open(&own)?.held_when_busy())))
        } else if path.is_dir() || path.extension().is_some_and(|extension| extension == "zarr") {
            Ok(Self::Measured(Box::new(Brdf::open(path)?.held_when_busy())))
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
