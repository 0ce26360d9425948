//! What an adaptive measurement has on disk until it has a plan.
//!
//! | file | holds |
//! |---|---|
//! | `adaptive.toml` | what was asked for, and the exposure time |
//! | `directions.txt` | lines `θ φ` in degrees in the order of capture; written before the batch is captured |
//! | `adaptive.zarr` | raw frames: a segment of black patterns, then one segment per batch |
//!
//! `adaptive.zarr` has the checksums of `adaptive.toml`, sample and truth; the checksum in `directions.txt` goes over
//! `adaptive.toml` too: no file can be exchanged alone.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{BATCH, Goal, GoalError};
use crate::incident::IncidentError;
use crate::measure::MeasureError;
use crate::measurement::{MeasurementError, Sums, sum, sums_at, sums_of, write_whole};
use crate::plan::{Plan, Request};
use crate::rig::{Rig, RigError, explain};
use crate::store::raw::SUBJECT;
use crate::store::{RawLayout, RawStore, StoreError};

const ASKED: &str = "adaptive.toml";
const DIRECTIONS: &str = "directions.txt";
const FRAMES: &str = "adaptive.zarr";
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
    /// The rig reaches too few directions.
    #[error("rig {rig}: expected incident directions all around that the projector can light, found {found}")]
    OutOfReach {
        /// Name of the rig.
        rig: String,
        /// How many.
        found: usize,
    },
}

impl From<MeasurementError> for AdaptiveError {
    fn from(error: MeasurementError) -> Self {
        Self::Measure(error.into())
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
    /// Exposure time in s.
    pub(super) exposure_s: f64,
    /// The rig as TOML.
    pub(super) rig: String,
    pub(super) goal: Goal,
    /// The request; its grid has no part in it.
    pub(super) request: Request,
}

/// The files.
pub(super) struct Journal {
    dir: PathBuf,
    /// SHA-256 of `adaptive.toml`.
    sum: String,
    pub(super) asked: Asked,
    pub(super) frames: RawStore,
}

impl Journal {
    /// Whether an adaptive measurement was begun in `dir`.
    pub(super) fn exists(dir: &Path) -> bool {
        dir.join(ASKED).is_file()
    }

    /// Begins in `dir`, which is new or empty; `rig` has its camera image scaled.
    pub(super) fn create(dir: &Path, asked: Asked, rig: &Rig, clock_hz: u32) -> Result<Self, AdaptiveError> {
        fs::create_dir_all(dir).map_err(|source| io(dir, source))?;
        let text = toml::to_string(&asked).expect("plain data");
        write_whole(&dir.join(ASKED), text.as_bytes())?;
        Self::with(dir, asked, &text, rig, clock_hz)
    }

    /// Opens what was begun in `dir`, with a trigger box whose clock has the same rate.
    pub(super) fn open(dir: &Path, rig: &Rig, clock_hz: u32) -> Result<Self, AdaptiveError> {
        let path = dir.join(ASKED);
        let text = fs::read_to_string(&path).map_err(|source| io(&path, source))?;
        let asked: Asked = toml::from_str(&text).map_err(|error| explain(&text, &path, &error))?;
        if asked.rig != rig.to_toml() {
            return Err(differs(dir, "rig"));
        }
        Self::with(dir, asked, &text, rig, clock_hz)
    }

    /// `text` is that of the file.
    fn with(dir: &Path, asked: Asked, text: &str, rig: &Rig, clock_hz: u32) -> Result<Self, AdaptiveError> {
        let path = dir.join(FRAMES);
        let sum = sum(text.as_bytes());
        let mut sums = sums_of(&asked.request)?;
        sums.insert(ASKED.to_owned(), sum.clone());
        let frames = if path.exists() {
            let frames = RawStore::open(&path)?;
            let held = frames.attributes().get(SUBJECT);
            let held = |name: &str| held.and_then(|sums| sums.get(name)).and_then(|sum| sum.as_str());
            for (name, field) in [("sample", "sample"), ("truth", "truth"), (ASKED, "content")] {
                if held(name) != sums.get(name).map(String::as_str) {
                    return Err(differs(dir, field));
                }
            }
            if frames.layout().clock_hz != clock_hz {
                return Err(differs(dir, "clock rate of the trigger box"));
            }
            frames
        } else {
            let layout = layout(rig, BATCH + asked.goal.budget, clock_hz);
            RawStore::create(&path, layout, about(&sums))?
        };
        Ok(Self {
            dir: dir.to_owned(),
            sum,
            asked,
            frames,
        })
    }

    /// The directions that were chosen, in degrees; none at the beginning.
    pub(super) fn directions_deg(&self) -> Result<Vec<[f64; 2]>, AdaptiveError> {
        let path = self.dir.join(DIRECTIONS);
        if !path.exists() {
            return Ok(Vec::new());
        }
        let text = fs::read_to_string(&path).map_err(|source| io(&path, source))?;
        let lines = text.split_once('\n').map(|(_, lines)| lines);
        if lines.is_none_or(|lines| text != self.sealed(lines)) {
            return Err(MeasurementError::Changed {
                path: path.display().to_string(),
                expected: "the list".to_owned(),
                found: "another".to_owned(),
            }
            .into());
        }
        match crate::incident::Grid::read_list(&path)? {
            crate::incident::Grid::List { directions_deg } => Ok(directions_deg),
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

    /// Makes `raw.zarr` of the first captures, those of `plan` for `rig`, which has segments of [`BATCH`].
    pub(super) fn publish(&self, rig: &Rig, plan: &Plan) -> Result<(), AdaptiveError> {
        let path = self.dir.join("raw.zarr");
        if path.exists() {
            // Of a run that ended before its plan was written.
            fs::remove_dir_all(&path).map_err(|source| io(&path, source))?;
        }
        let mut attributes = about(&sums_at(&self.dir, rig, plan)?);
        attributes.insert("rig".to_owned(), rig.name.clone().into());
        attributes.insert(
            "source".to_owned(),
            concat!("rcg ", env!("CARGO_PKG_VERSION")).into(),
        );
        let layout = layout(rig, BATCH + plan.directions, self.frames.layout().clock_hz);
        let raw = RawStore::create(&path, layout, attributes)?;
        for segment in 0..raw.segments() {
            raw.write_segment(segment, &self.frames.read_segment(segment)?)?;
        }
        Ok(())
    }

    /// Removes the frames, which `raw.zarr` holds now.
    pub(super) fn close(self) -> Result<(), AdaptiveError> {
        let path = self.dir.join(FRAMES);
        Ok(fs::remove_dir_all(&path).map_err(|source| io(&path, source))?)
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

fn layout(rig: &Rig, exposures: usize, clock_hz: u32) -> RawLayout {
    let format = rig.frame_format();
    RawLayout {
        exposures,
        segment: BATCH,
        height: format.height_px,
        width: format.width_px,
        channels: format.channels,
        bits: format.bits,
        clock_hz,
    }
}

fn io(path: &Path, source: std::io::Error) -> MeasurementError {
    MeasurementError::Io {
        path: path.display().to_string(),
        source,
    }
}
