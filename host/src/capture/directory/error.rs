//! Why a measurement cannot go on.

use crate::base::blame::Blame;
use crate::capture::CaptureError;
use crate::capture::session::SessionError;
use crate::hemisphere::incident::IncidentError;
use crate::instrument::calibration::CalibrationError;
use crate::instrument::rig::RigError;
use crate::plan::PlanError;
use crate::store::StoreError;
use crate::store::whole_file::FileError;

/// Why a measurement cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum MeasurementError {
    /// The directory is taken.
    #[error("{path}: expected a new or empty directory, found {found}")]
    Exists {
        /// The directory.
        path: String,
        /// What is there.
        found: &'static str,
    },
    /// The directory holds no measurement.
    #[error("{path}: expected a measurement (with plan.toml and rig.toml), found none")]
    NotOne {
        /// The directory.
        path: String,
    },
    /// What was asked for is not what the directory holds.
    #[error("{path}: {field}: expected {expected} as in the measurement that is resumed, found {found}")]
    Differs {
        /// The directory.
        path: String,
        /// What differs.
        field: &'static str,
        /// What the directory holds.
        expected: String,
        /// What was asked for.
        found: String,
    },
    /// A file is not the one with which the measurement was begun.
    #[error(
        "{path}: expected {expected} as when the measurement was begun, found {found}; put it back as it was, or measure \
         into a new directory"
    )]
    Changed {
        /// The file.
        path: String,
        /// What was there, in words.
        expected: String,
        /// What is there, in words.
        found: String,
    },
    /// The manifest is not as this program left it.
    #[error(
        "{path}: expected the record of what this measurement was begun with, found {found}; put it back as it was, or \
         measure into a new directory"
    )]
    Manifest {
        /// The file.
        path: String,
        /// What is there.
        found: String,
    },
    /// A file cannot be written or read.
    #[error(transparent)]
    File(#[from] FileError),
    /// The rig.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The calibration.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// A store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The capture.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// Who measured, when and with what.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// A result would be written where something else belongs.
    #[error("{path}: output: expected a brdf.zarr of its own, found {found}")]
    NotApart {
        /// The place.
        path: String,
        /// What is there.
        found: String,
    },
    /// Frames that were captured with another geometry.
    #[error(
        "{path}: geometry: expected the one with which the patterns of {measurement} were lit (rig with SHA-256 {expected:.12}), found \
         another ({found:.12}), by which the lit pixels pointed elsewhere; assemble with another photometry of the same geometry, or \
         measure again"
    )]
    OtherGeometry {
        /// The rig of the calibration.
        path: String,
        /// The measurement.
        measurement: String,
        /// Hash of its rig.
        expected: String,
        /// That of the calibration's, its camera image scaled and its sample tilted likewise.
        found: String,
    },
}

impl Blame for MeasurementError {
    fn is_input(&self) -> bool {
        match self {
            Self::Exists { .. }
            | Self::NotOne { .. }
            | Self::Differs { .. }
            | Self::Changed { .. }
            | Self::Manifest { .. }
            | Self::NotApart { .. }
            | Self::OtherGeometry { .. }
            | Self::Rig(_)
            | Self::Plan(_)
            | Self::Calibration(_) => true,
            Self::Store(error) => error.is_input(),
            Self::Session(error) => error.is_input(),
            Self::File(_) | Self::Capture(_) => false,
        }
    }
}

impl From<IncidentError> for MeasurementError {
    fn from(error: IncidentError) -> Self {
        Self::Plan(error.into())
    }
}
