//! Calibration: how the instrument really is, found with targets in place of the sample.
//!
//! # Design
//! | module | finds | with |
//! |---|---|---|
//! | [`geometry`] | poses, lenses, mirror, sample frame | a flat mirror at known tilts, a diffuse standard |
//! | [`photometry`] | camera, projector's response, light and throughput, interreflection | reflectance standards |
//!
//! What is found, and its files, is [`crate::instrument::calibration`]. Who puts the targets in is [`by_hand`]. Before anything is calibrated
//! somebody aligns the rig, and looks at it while they do: [`live`]. Of the virtual rig it is [`kept`].

pub mod by_hand;
pub mod geometry;
pub mod kept;
pub mod live;
pub mod photometry;

use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::Path;

use serde::Serialize;

use crate::base::blame::Blame;
use crate::capture::directory::MeasurementError;
use crate::capture::{CaptureError, Captured, Tally};
use crate::instrument::calibration::{CalibrationError, RIG, file};
use crate::instrument::rig::{Rig, RigError};
use crate::plan::PlanError;
use crate::plan::schedule::SHORTEST_EXPOSURE_S;
use crate::store::checksum::sum;
use crate::store::raw::SUBJECT;
use crate::store::whole_file::FileError;
use crate::store::{ExposureRecord, RawLayout, RawStore, Segment, StoreError};
use crate::virtual_rig::setup::SetupError;

/// Kind of exposures that show a view of a calibration.
const VIEW: u8 = crate::store::exposure_record::KINDS[2].0;

/// Why there is no calibration.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// The instrument.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// Its captures.
    #[error(transparent)]
    Measurement(#[from] MeasurementError),
    /// A file that cannot be written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file of the calibration.
    #[error(transparent)]
    Found(#[from] CalibrationError),
    /// A store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The rig.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The picture of the residuals.
    #[error(transparent)]
    Picture(#[from] crate::judge::render::PictureError),
    /// What is said of the standards does not go together.
    #[error("standards: expected {expected}, found {found}")]
    Standards {
        /// What was expected.
        expected: String,
        /// What there is.
        found: String,
    },
    /// A mask by hand.
    #[error("{path}: expected {expected}, found {found}")]
    Mask {
        /// The picture.
        path: String,
        /// What was expected.
        expected: String,
        /// What there is.
        found: String,
    },
    /// What somebody chose to be shown, held or moved cannot be: a sentence.
    #[error("{0}")]
    Choice(String),
    /// Somebody who puts targets in stopped before all was prepared.
    #[error("views by hand: expected the targets that are asked for, found that somebody stopped")]
    Stopped,
    /// The views do not determine what they should.
    #[error("calibration views: expected {expected}, found {found}; {advice}")]
    Views {
        /// What was expected.
        expected: String,
        /// What there is.
        found: String,
        /// What to do.
        advice: &'static str,
    },
}

impl CalibrateError {
    /// Captures of which something else is said than how they were made.
    fn otherwise(what: &str, captured: impl Display, found: impl Display) -> Self {
        Self::Views {
            expected: format!("{what} as captured, {captured}"),
            found: found.to_string(),
            advice: "leave it out, or capture into another directory",
        }
    }
}

/// Refuses an image of another size than that of the captures, if one is said.
fn check_image_size(captured: u32, said: Option<u32>) -> Result<(), CalibrateError> {
    match said {
        Some(said) if said != captured => Err(CalibrateError::otherwise("--image-size", captured, said)),
        _ => Ok(()),
    }
}

impl Blame for CalibrateError {
    fn is_input(&self) -> bool {
        match self {
            Self::Setup(error) => error.is_input(),
            Self::Measurement(error) => error.is_input(),
            Self::Store(error) => error.is_input(),
            Self::File(_) | Self::Picture(_) | Self::Stopped => false,
            Self::Rig(_)
            | Self::Found(_)
            | Self::Choice(_)
            | Self::Mask { .. }
            | Self::Standards { .. }
            | Self::Views { .. } => true,
        }
    }
}

impl From<CaptureError> for CalibrateError {
    fn from(error: CaptureError) -> Self {
        Self::Measurement(error.into())
    }
}

impl From<PlanError> for CalibrateError {
    fn from(error: PlanError) -> Self {
        Self::Measurement(error.into())
    }
}

/// Share of the light that the flat mirror of the virtual rig reflects: black glass.
const REFLECTANCE: f64 = 0.04;

/// Share of the light that the flat mirror of the virtual `rig` reflects in views of its geometry: it stands behind a neutral filter where
/// its image would fill more than a quarter of the well in the shortest exposures.
fn black_glass(rig: &Rig) -> f64 {
    let electrons = rig.projector.irradiance * rig.sensitivity_e() * 2.0 * SHORTEST_EXPOSURE_S;
    REFLECTANCE.min(rig.camera.full_well_e / 4.0 / electrons)
}

/// Makes the file of the frames that will be taken of the views in the file `views`, which will hold `text`, by a trigger box with this
/// clock.
fn create_raw(
    path: &Path,
    layout: RawLayout,
    clock_hz: u32,
    views: &str,
    text: &str,
) -> Result<RawStore, CalibrateError> {
    let layout = RawLayout { clock_hz, ..layout };
    let mut attributes = serde_json::Map::new();
    let sums = BTreeMap::from([(views, sum(text.as_bytes()))]);
    attributes.insert(SUBJECT.to_owned(), serde_json::json!(sums));
    Ok(RawStore::create(path, layout, attributes)?)
}

/// Removes the `frames` of a virtual capture in `dir` that was killed before it wrote the file `views`, which says what they are: nobody can
/// use them, and the same capture makes them again.
fn discard_unfinished(dir: &Path, frames: &[&str], views: &str) -> Result<(), CalibrateError> {
    if dir.join(views).exists() {
        return Ok(());
    }
    for path in frames.iter().map(|name| dir.join(name)) {
        if RawStore::open(&path).is_ok() {
            std::fs::remove_dir_all(&path).map_err(|source| FileError::at(&path, source))?;
        }
    }
    Ok(())
}

/// Refuses to add frames of a trigger box with another clock to the file `raw` at `path`.
fn check_clock(path: &Path, raw: &RawStore, clock_hz: u32) -> Result<(), CalibrateError> {
    if raw.layout().clock_hz == clock_hz {
        return Ok(());
    }
    Err(CalibrationError::Content {
        path: path.display().to_string(),
        field: "ticks_per_second".to_owned(),
        expected: format!("{} as of the trigger box before", raw.layout().clock_hz),
        found: clock_hz.to_string(),
    }
    .into())
}

/// Opens the frames `raw` in `dir`, which must have been taken of the views in the file `views` as it is.
fn open_raw(dir: &Path, raw: &str, views: &str) -> Result<RawStore, CalibrateError> {
    let path = dir.join(views);
    let content = |expected: String, found: String| CalibrationError::Content {
        path: path.display().to_string(),
        field: "file".to_owned(),
        expected,
        found,
    };
    let bytes =
        std::fs::read(&path).map_err(|error| content("a readable file".to_owned(), error.to_string()))?;
    let found = sum(&bytes);
    let raw = RawStore::open(&dir.join(raw))?;
    let expected = raw
        .attributes()
        .get(SUBJECT)
        .and_then(|sums| sums[views].as_str());
    if expected == Some(&found) {
        return Ok(raw);
    }
    Err(content(
        format!(
            "the one of which the frames beside it were taken (SHA-256 {:.12})",
            expected.unwrap_or("unknown")
        ),
        format!("another ({found:.12}); put it back, or calibrate into a new directory"),
    )
    .into())
}

/// Frames and records of exposures that show no incident direction of a plan.
fn segment_of(shots: Vec<Captured>, tally: Tally, exposure_s: f64) -> Segment {
    let mut segment = Segment {
        tally,
        ..Segment::default()
    };
    for shot in shots {
        let [trigger, on, off] = shot.ticks;
        segment.records.push(ExposureRecord {
            incident: -1,
            kind: VIEW,
            exposure_s,
            trigger_tick: trigger.0,
            strobe_on_tick: on.0,
            strobe_off_tick: off.0,
            frame_id: shot.frame_id,
            camera_timestamp_s: shot.camera_timestamp_s,
            attempts: shot.attempts,
            flags: u16::from(shot.flags),
            lit_solid_angle_sr: f64::NAN,
            lit_irradiance: f64::NAN,
        });
        segment.frames.extend(shot.dn);
    }
    segment
}

/// Mean over the channels of each pixel of a frame.
fn brightness(frame: &[u16], channels: usize) -> Vec<f32> {
    let pixels = frame.chunks_exact(channels);
    pixels
        .map(|dn| dn.iter().map(|&dn| f32::from(dn)).sum::<f32>() / channels as f32)
        .collect()
}

/// Refuses a `value` in which a number is not finite.
///
/// # Errors
/// [`CalibrateError::Views`] with the field.
fn check(value: &impl Serialize) -> Result<(), CalibrateError> {
    let value = serde_json::to_value(value).expect("JSON values can be written");
    file::absent(&value).map_or(Ok(()), |field| {
        Err(CalibrateError::Views {
            expected: format!("views that determine {field}"),
            found: "no finite number for it".to_owned(),
            advice: "look at the frames: are the targets in place and lit, and is there noise?",
        })
    })
}
