//! Why assembly failed.

use crate::base::blame::Blame;
use crate::brdf::BrdfError;
use crate::store::StoreError;

/// Why assembly failed.
#[derive(Debug, thiserror::Error)]
pub enum AssembleError {
    /// A store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// What was assembled cannot be read again.
    #[error(transparent)]
    Brdf(#[from] BrdfError),
    /// The raw frames do not belong to the plan.
    #[error("{path}: {reason}")]
    Mismatch {
        /// The raw store.
        path: String,
        /// What is wrong.
        reason: String,
    },
}

impl Blame for AssembleError {
    fn is_input(&self) -> bool {
        match self {
            Self::Brdf(error) => error.is_input(),
            Self::Store(error) => error.is_input(),
            Self::Mismatch { .. } => true,
        }
    }
}
