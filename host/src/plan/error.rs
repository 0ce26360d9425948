//! Why there is no plan.

use super::light::CellError;
use super::schedule::ScheduleError;
use crate::base::blame::Blame;
use crate::hemisphere::incident::IncidentError;
use crate::instrument::optics::Unmeasurable;
use crate::instrument::rig::RigError;

/// Why there is no plan.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The incident directions.
    #[error(transparent)]
    Incident(#[from] IncidentError),
    /// The image is too small or too large.
    #[error("image-size: expected a number of pixels from 8 to 4096, found {0}")]
    ImageSize(u32),
    /// Two exposures of a pattern do not overlap.
    #[error(
        "brackets: expected neighbouring exposure times at most {largest:.0} times apart, or the signals between \
         saturate the one and drown in the noise of the other; found {shorter_ms} and {longer_ms} ms, {found:.0} times \
         (put a time between them, or let `--brackets auto` choose)"
    )]
    Apart {
        /// The shorter in ms.
        shorter_ms: f64,
        /// The longer in ms.
        longer_ms: f64,
        /// Their ratio.
        found: f64,
        /// The largest ratio that the camera bridges.
        largest: f64,
    },
    /// No code lights these directions.
    #[error(transparent)]
    Light(#[from] CellError),
    /// The times do not fit together.
    #[error(transparent)]
    Schedule(#[from] ScheduleError),
    /// The projector lights none of the directions.
    #[error(
        "rig {rig}: expected incident directions that the projector can light, found none (most often: {reason})"
    )]
    NothingToMeasure {
        /// Name of the rig.
        rig: String,
        /// The reason of the first direction.
        reason: Unmeasurable,
    },
    /// The plan file is not TOML, or a field is unknown, missing or of the wrong type.
    #[error(transparent)]
    Toml(#[from] RigError),
    /// The plan was made for another rig.
    #[error("{path}: expected a plan of rig {rig}, found one of rig {plan}")]
    OtherRig {
        /// The file.
        path: String,
        /// The rig that it was made for.
        plan: String,
        /// The rig that there is.
        rig: String,
    },
    /// The plan file cannot be used.
    #[error("{path}: {reason}")]
    File {
        /// The file.
        path: String,
        /// What is wrong with it.
        reason: String,
    },
}

impl Blame for PlanError {
    fn is_input(&self) -> bool {
        true
    }
}
