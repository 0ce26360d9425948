//! What an adaptive measurement has on disk until it has a plan.
//!
//! | file | holds |
//! |---|---|
//! | `adaptive.toml` | what was asked for, and the exposure times |
//! | `directions.txt` | lines `θ φ` in degrees in the order of capture; written before the batch is captured; a checksum first |
//! | `adaptive.zarr` | raw frames: black patterns, then those with light, a batch in one segment or several |
//! | `calibration.json` | what was known of the instrument, as in every measurement |
//!
//! `adaptive.zarr` has the checksums of `adaptive.toml`, `calibration.json`, sample and truth; the checksum in
//! `directions.txt` goes over `adaptive.toml` too: no file can be exchanged alone.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{Goal, GoalError};
use crate::base::blame::Blame;
use crate::capture::directory::{FRAMES_BEFORE_PLAN as FRAMES, MeasurementError, Sums, sums_at};
use crate::hemisphere::incident::{Grid, IncidentError};
use crate::instrument::calibration::AppliedCalibration;
use crate::instrument::rig::{Rig, RigError, explain};
use crate::measure::MeasureError;
use crate::plan::light::Light;
use crate::plan::{BLACK_EXPOSURES, Plan, Request, Virtual};
use crate::store::checksum::sum;
use crate::store::raw::SUBJECT;
use crate::store::whole_file::{FileError, write_whole};
use crate::store::{RawLayout, RawStore, StoreError};

const ASKED: &str = "adaptive.toml";
const DIRECTIONS: &str = "directions.txt";
/// What stands before the checksum in the first line of the list of directions.
const SEALED: &str = "# θ φ in degrees, in the order of capture; checksum ";

/// Why an adaptive measurement failed.
#[derive(Debug, thiserror::Error)]
pub enum AdaptiveError {
    /// The goal.
    #[error(transparent)]
    Goal(#[from] GoalError),
    /// Everything that any measurement can fail at.
    #[error(transparent)]
    Measure(#[from] MeasureError),
    /// The file of what was asked for.
    #[error(transparent)]
    Toml(#[from] RigError),
    /// Another measurement is in the directory.
    #[error("{path}: expected what was asked for when it was begun, found another {field}")]
    Differs {
        /// The file.
        path: String,
        /// What differs.
        field: &'static str,
    },
    /// Codes light many directions at once.
    #[error(
        "light: expected single with --adaptive, which looks at each direction before it chooses the next, found {found}"
    )]
    Light {
        /// What was asked for.
        found: Light,
    },
    /// Nothing was seen that an error could be predicted from.
    #[error(
        "adaptive: expected images from which errors can be predicted, found none in {captures} captures: they are saturated, \
         or see nothing up to θ = 80° (another --exposure-ms, --brackets or --tilt may help)"
    )]
    NothingSeen {
        /// Captures with light.
        captures: usize,
    },
    /// The rig reaches too few directions.
    #[error("rig {rig}: expected incident directions all around that the projector can light, found {found}")]
    OutOfReach {
        /// Name of the rig.
        rig: String,
        /// How many.
        found: usize,
    },
}

impl Blame for AdaptiveError {
    fn is_input(&self) -> bool {
        match self {
            Self::Goal(_)
            | Self::Toml(_)
            | Self::Differs { .. }
            | Self::Light { .. }
            | Self::OutOfReach { .. } => true,
            Self::Measure(error) => error.is_input(),
            Self::NothingSeen { .. } => false,
        }
    }
}

impl From<MeasurementError> for AdaptiveError {
    fn from(error: MeasurementError) -> Self {
        Self::Measure(error.into())
    }
}

impl From<FileError> for AdaptiveError {
    fn from(error: FileError) -> Self {
        Self::Measure(MeasurementError::from(error).into())
    }
}

impl From<StoreError> for AdaptiveError {
    fn from(error: StoreError) -> Self {
        Self::Measure(MeasurementError::from(error).into())
    }
}

impl From<IncidentError> for AdaptiveError {
    fn from(error: IncidentError) -> Self {
        Self::Measure(MeasurementError::from(error).into())
    }
}

/// What was asked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Asked {
    /// Exposure time in s; of several the shortest.
    pub(super) exposure_s: f64,
    /// The other exposure times of each pattern in s, ascending.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) longer_s: Vec<f64>,
    /// The rig as TOML.
    pub(super) rig: String,
    /// Coarse beginning; the usual one if there is nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) start: Option<Grid>,
    pub(super) goal: Goal,
    /// The request; its grid has no part in it.
    pub(super) request: Request,
    /// The virtual rig.
    #[serde(rename = "virtual")]
    pub(super) virtual_rig: Virtual,
}

impl Asked {
    /// Exposure times in s of each pattern, ascending.
    pub(super) fn exposures_s(&self) -> Vec<f64> {
        std::iter::once(self.exposure_s)
            .chain(self.longer_s.iter().copied())
            .collect()
    }
}

/// How frames lie in their segments.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segments {
    /// Captures with light, at most.
    pub(super) captures: usize,
    /// Patterns of a segment.
    pub(super) patterns: usize,
    /// Exposures of a pattern.
    pub(super) brackets: usize,
}

/// The files.
pub(super) struct Journal {
    dir: PathBuf,
    /// SHA-256 of `adaptive.toml`.
    sum: String,
    pub(super) frames: RawStore,
}

impl Journal {
    /// Whether an adaptive measurement was begun in `dir`.
    pub(super) fn exists(dir: &Path) -> bool {
        dir.join(ASKED).is_file()
    }

    /// Begins in `dir`, which is new or empty; `rig` has its camera image scaled.
    /// `applied` is the calibration to take into account, if there is one.
    pub(super) fn create(
        dir: &Path,
        asked: &Asked,
        rig: &Rig,
        applied: Option<&AppliedCalibration>,
        segments: Segments,
        inputs: &Sums,
        clock_hz: u32,
    ) -> Result<Self, AdaptiveError> {
        fs::create_dir_all(dir).map_err(|source| FileError::at(dir, source))?;
        let text = toml::to_string(asked).expect("plain data");
        write_whole(&dir.join(ASKED), text.as_bytes())?;
        if let Some(applied) = applied {
            applied.write(dir)?;
        }
        Self::open(dir, rig, segments, inputs, clock_hz)
    }

    /// What was asked for in `dir`.
    pub(super) fn asked(dir: &Path) -> Result<Asked, AdaptiveError> {
        let path = dir.join(ASKED);
        let text = crate::base::text::read(&path).map_err(|error| FileError::at(&path, error.into()))?;
        Ok(toml::from_str(&text).map_err(|error| explain(&text, &path, &error))?)
    }

    /// Opens what was begun in `dir`, its frames in `segments` unless there are some already, with a trigger box whose clock
    /// has the same rate and sample and truth of the same content, `inputs`.
    pub(super) fn open(
        dir: &Path,
        rig: &Rig,
        segments: Segments,
        inputs: &Sums,
        clock_hz: u32,
    ) -> Result<Self, AdaptiveError> {
        let content = |name: &str| {
            let path = dir.join(name);
            fs::read(&path).map_err(|source| FileError::at(&path, source))
        };
        let sum_of_asked = sum(&content(ASKED)?);
        let mut sums = inputs.clone();
        sums.insert(ASKED.to_owned(), sum_of_asked.clone());
        if dir.join(AppliedCalibration::FILE).exists() {
            sums.insert(
                AppliedCalibration::FILE.to_owned(),
                sum(&content(AppliedCalibration::FILE)?),
            );
        }
        let path = dir.join(FRAMES);
        let frames = if path.exists() {
            let frames = RawStore::open(&path)?;
            let held = frames.attributes().get(SUBJECT);
            let held = |name: &str| held.and_then(|sums| sums.get(name)).and_then(|sum| sum.as_str());
            for (name, field) in [
                ("sample", "sample"),
                ("truth", "truth"),
                (ASKED, "content"),
                (AppliedCalibration::FILE, "calibration"),
            ] {
                if held(name) != sums.get(name).map(String::as_str) {
                    return Err(differs(dir, field));
                }
            }
            if frames.layout().clock_hz != clock_hz {
                return Err(differs(dir, "clock rate of the trigger box"));
            }
            frames
        } else {
            RawStore::create(&path, layout(rig, segments, clock_hz), about(&sums))?
        };
        Ok(Self {
            dir: dir.to_owned(),
            sum: sum_of_asked,
            frames,
        })
    }

    /// Whether frames were captured in `dir`: until then a calibration may not be there yet.
    pub(super) fn has_frames(dir: &Path) -> bool {
        dir.join(FRAMES).exists()
    }

    /// A file of it.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.dir.join(name)
    }

    /// The directions that were chosen, in degrees; none at the beginning.
    pub(super) fn directions_deg(&self) -> Result<Vec<[f64; 2]>, AdaptiveError> {
        let path = self.dir.join(DIRECTIONS);
        if !path.exists() {
            return Ok(Vec::new());
        }
        let text = fs::read_to_string(&path).map_err(|source| FileError::at(&path, source))?;
        let lines = text.split_once('\n').map(|(_, lines)| lines);
        if lines.is_none_or(|lines| text != self.sealed(lines)) {
            return Err(MeasurementError::Changed {
                path: path.display().to_string(),
                expected: "the list".to_owned(),
                found: "another".to_owned(),
            }
            .into());
        }
        match Grid::read_list(&path)? {
            Grid::List { directions_deg } => Ok(directions_deg),
            _ => Ok(Vec::new()),
        }
    }

    /// Writes down what is captured next.
    pub(super) fn choose(&self, directions_deg: &[[f64; 2]]) -> Result<(), AdaptiveError> {
        let lines: Vec<String> = directions_deg
            .iter()
            .map(|[theta_deg, phi_deg]| format!("{theta_deg} {phi_deg}\n"))
            .collect();
        let text = self.sealed(&lines.concat());
        Ok(write_whole(&self.dir.join(DIRECTIONS), text.as_bytes())?)
    }

    /// `lines` with their checksum before them.
    fn sealed(&self, lines: &str) -> String {
        format!(
            "{SEALED}{}\n{lines}",
            sum(format!("{}\n{lines}", self.sum).as_bytes())
        )
    }

    /// Makes `raw.zarr` of `plan` for `rig`: of as many of the frames as `segments` hold.
    pub(super) fn publish(&self, rig: &Rig, plan: &Plan, segments: Segments) -> Result<(), AdaptiveError> {
        let path = self.dir.join("raw.zarr");
        if path.exists() {
            // Of a run that ended before its plan was written.
            fs::remove_dir_all(&path).map_err(|source| FileError::at(&path, source))?;
        }
        let mut attributes = about(&sums_at(&self.dir, rig, plan)?);
        attributes.insert("rig".to_owned(), rig.name.clone().into());
        attributes.insert(
            "source".to_owned(),
            concat!("rcg ", env!("CARGO_PKG_VERSION")).into(),
        );
        let layout = layout(rig, segments, self.frames.layout().clock_hz);
        let raw = RawStore::create(&path, layout, attributes)?;
        for segment in 0..raw.segments() {
            raw.write_segment(segment, &self.frames.read_segment(segment)?)?;
        }
        Ok(())
    }

    /// Removes the frames, which `raw.zarr` holds now.
    pub(super) fn close(self) -> Result<(), AdaptiveError> {
        let path = self.dir.join(FRAMES);
        Ok(fs::remove_dir_all(&path).map_err(|source| FileError::at(&path, source))?)
    }
}

pub(super) fn differs(dir: &Path, field: &'static str) -> AdaptiveError {
    AdaptiveError::Differs {
        path: dir.join(ASKED).display().to_string(),
        field,
    }
}

/// Attributes of frames that were captured with what has these sums.
fn about(sums: &Sums) -> serde_json::Map<String, serde_json::Value> {
    serde_json::Map::from_iter([(SUBJECT.to_owned(), serde_json::json!(sums))])
}

fn layout(rig: &Rig, segments: Segments, clock_hz: u32) -> RawLayout {
    let format = rig.frame_format();
    RawLayout {
        exposures: (BLACK_EXPOSURES + segments.captures) * segments.brackets,
        segment: segments.patterns * segments.brackets,
        height: format.height_px,
        width: format.width_px,
        channels: format.channels,
        bits: format.bits,
        clock_hz,
    }
}
