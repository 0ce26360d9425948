//! A measurement: a directory with everything that belongs to it, and the stages that fill it.
//!
//! # Design
//! `rig.toml` and `plan.toml` come first and never change; they say what all later stages do. `raw.zarr` grows
//! by whole segments; a run that was killed goes on with the next one. What is derived (`brdf.zarr`, figures,
//! report) appears under its name only when it is whole. `manifest.json` says how far things are.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc::sync_channel;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use sha2::{Digest as _, Sha256};

use crate::capture::{CaptureError, Instrument, Tally};
use crate::incident::IncidentError;
use crate::optics::View;
use crate::pattern::{LitSet, PatternMaker};
use crate::plan::{Directions, Exposure, Plan, PlanError, Request};
use crate::rig::{Rig, RigError};
use crate::store::{RawLayout, RawStore, Segment, StoreError};
use crate::text::Maybe;
use crate::whole_file::is_partial;

mod files;
mod segment;

pub use files::write_whole;
use files::{io, write_synced};
pub(crate) use segment::take_segment;

/// Files that a directory can hold before it is a measurement.
const BEGINNINGS: [&str; 6] = [
    "rig.tmp",
    "rig.toml",
    "plan.tmp",
    "adaptive.tmp",
    "calibration.tmp",
    "calibration.json",
];

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
    /// A file cannot be written or read.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// The rig.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The capture.
    #[error(transparent)]
    Capture(#[from] CaptureError),
}

impl From<IncidentError> for MeasurementError {
    fn from(error: IncidentError) -> Self {
        Self::Plan(error.into())
    }
}

/// How far a measurement is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum State {
    /// The plan is written.
    Planned,
    /// All frames are stored.
    Captured,
    /// `brdf.zarr` is whole.
    Assembled,
    /// Figures and report are written.
    Reported,
}

/// A measurement's directory, with its rig (camera image scaled as planned) and plan.
#[derive(Clone, Debug)]
pub struct Measurement {
    dir: PathBuf,
    /// The rig, its camera image of the planned size.
    pub rig: Rig,
    /// The plan.
    pub plan: Plan,
    /// The incident directions.
    pub directions: Directions,
}

impl Measurement {
    /// Whether `dir` could become a new measurement: absent or empty.
    ///
    /// # Errors
    /// [`MeasurementError::Exists`].
    pub fn check_new(dir: &Path) -> Result<(), MeasurementError> {
        let taken = |found| MeasurementError::Exists {
            path: dir.display().to_string(),
            found,
        };
        match fs::read_dir(dir).map(|mut entries| entries.next().is_some()) {
            Ok(false) => Ok(()),
            Ok(true) if Self::exists(dir) => Err(taken("a measurement; use --resume to go on with it")),
            Ok(true) => Err(taken("one with files in it")),
            Err(_) if !dir.exists() => Ok(()),
            Err(_) if !dir.is_dir() => Err(taken("a file")),
            Err(source) => Err(io(dir, source)),
        }
    }

    /// Removes what [`create`](Self::create) leaves in `dir` if it ends before there is a plan (killed, disk full);
    /// where there is a plan, or anything else, all stays as it is.
    ///
    /// # Errors
    /// [`MeasurementError::Io`].
    pub fn sweep(dir: &Path) -> Result<(), MeasurementError> {
        let Ok(entries) = fs::read_dir(dir) else {
            return Ok(());
        };
        let names: Vec<_> = entries.flatten().map(|entry| entry.file_name()).collect();
        let ours = names
            .iter()
            .all(|name| is_partial(name) || BEGINNINGS.iter().any(|beginning| name == beginning));
        let has = |wanted: &str| names.iter().any(|name| name == wanted);
        if ours && (has("plan.tmp") || !has("rig.toml")) {
            for name in names {
                let path = dir.join(name);
                fs::remove_file(&path).map_err(|source| io(&path, source))?;
            }
        }
        Ok(())
    }

    /// Begins a measurement in `dir`. `rig` has its camera image scaled to the plan's size.
    ///
    /// # Errors
    /// [`MeasurementError`].
    pub fn create(dir: &Path, rig: Rig, plan: Plan) -> Result<Self, MeasurementError> {
        Self::check_new(dir)?;
        Self::found(dir, rig, plan)
    }

    /// As [`create`](Self::create), in a directory that holds what belongs to the measurement already.
    ///
    /// # Errors
    /// [`MeasurementError`].
    pub fn found(dir: &Path, rig: Rig, plan: Plan) -> Result<Self, MeasurementError> {
        let directions = Directions::new(&rig, &plan.request.grid)?;
        let measurement = Self {
            dir: dir.to_owned(),
            rig,
            plan,
            directions,
        };
        fs::create_dir_all(dir).map_err(|source| io(dir, source))?;
        // A directory with a plan is a measurement, so the plan gets its name last. Until then it lies beside the rig
        // under its temporary one, which tells `sweep` that the rig is ours.
        let (plan, temporary) = (measurement.path("plan.toml"), measurement.path("plan.tmp"));
        write_synced(&temporary, measurement.plan.to_toml().as_bytes())?;
        write_whole(
            &measurement.path("rig.toml"),
            measurement.rig.to_toml().as_bytes(),
        )?;
        fs::rename(&temporary, &plan).map_err(|source| io(&plan, source))?;
        measurement.note(State::Planned, Map::new())?;
        Ok(measurement)
    }

    /// Opens the measurement in `dir`.
    ///
    /// # Errors
    /// [`MeasurementError::NotOne`], or what is wrong with its rig or plan.
    pub fn open(dir: &Path) -> Result<Self, MeasurementError> {
        if !Self::exists(dir) {
            return Err(MeasurementError::NotOne {
                path: dir.display().to_string(),
            });
        }
        let rig_path = dir.join("rig.toml");
        let rig = Rig::load(&rig_path.to_string_lossy())?;
        let plan = Plan::read(&dir.join("plan.toml"))?;
        plan.check(&dir.join("plan.toml"))?;
        if plan.rig != rig.name {
            return Err(MeasurementError::Differs {
                path: rig_path.display().to_string(),
                field: "name",
                expected: plan.rig,
                found: rig.name,
            });
        }
        let directions = Directions::new(&rig, &plan.request.grid)?;
        let lens = &rig.camera.lens;
        if directions.measurable().count() != plan.directions || lens.width_px != plan.request.image_size {
            return Err(MeasurementError::Differs {
                path: rig_path.display().to_string(),
                field: "rig",
                expected: format!(
                    "{} measurable directions and {} pixels a side",
                    plan.directions, plan.request.image_size
                ),
                found: format!("{} and {}", directions.measurable().count(), lens.width_px),
            });
        }
        Ok(Self {
            dir: dir.to_owned(),
            rig,
            plan,
            directions,
        })
    }

    /// Whether `dir` holds a measurement.
    #[must_use]
    pub fn exists(dir: &Path) -> bool {
        dir.join("plan.toml").is_file()
    }

    /// Refuses to go on if something else is asked for than what this measurement holds.
    ///
    /// # Errors
    /// [`MeasurementError::Differs`] with the first field that differs.
    pub fn check_same(&self, request: &Request, rig_name: &str) -> Result<(), MeasurementError> {
        let held = &self.plan.request;
        let differs = |field, expected: String, found: String| MeasurementError::Differs {
            path: self.dir.display().to_string(),
            field,
            expected,
            found,
        };
        let name = |name: &Option<String>| Maybe(name.as_deref()).to_string();
        let on = |noise: bool| if noise { "on" } else { "off" }.to_owned();
        let ms = |exposure_s: Option<f64>| Maybe(exposure_s.map(|s| (s * 1e12).round() * 1e-9)).to_string();
        let other_grid = if held.grid != request.grid && held.grid.to_string() == request.grid.to_string() {
            format!("another {}", request.grid)
        } else {
            request.grid.to_string()
        };
        let fields: [(&'static str, String, String); 10] = [
            ("rig", self.rig.name.clone(), rig_name.to_owned()),
            ("grid", held.grid.to_string(), other_grid),
            (
                "image-size",
                held.image_size.to_string(),
                request.image_size.to_string(),
            ),
            ("exposure-ms", ms(held.exposure_s), ms(request.exposure_s)),
            (
                "brackets",
                held.brackets.to_string(),
                request.brackets.to_string(),
            ),
            ("sample", name(&held.sample), name(&request.sample)),
            ("truth", name(&held.truth), name(&request.truth)),
            (
                "tilt",
                Maybe(held.tilt).to_string(),
                Maybe(request.tilt).to_string(),
            ),
            ("noise", on(held.noise), on(request.noise)),
            ("seed", held.seed.to_string(), request.seed.to_string()),
        ];
        match fields.into_iter().find(|(_, held, asked)| held != asked) {
            Some((field, expected, found)) => Err(differs(field, expected, found)),
            None => Ok(()),
        }
    }

    /// The directory.
    #[must_use]
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// A file of the measurement.
    #[must_use]
    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.join(name)
    }

    /// Captures what is not stored yet; `progress(exposures)` is told how many are done in all. The tally is that of
    /// all calls that came to their end.
    ///
    /// # Errors
    /// [`MeasurementError`]; what was stored before stays.
    pub fn capture(
        &self,
        instrument: &mut Instrument,
        progress: &mut dyn FnMut(usize),
    ) -> Result<Tally, MeasurementError> {
        let raw_path = self.path("raw.zarr");
        let raw = if raw_path.exists() {
            RawStore::open(&raw_path)?
        } else {
            self.create_raw(&raw_path)?
        };
        let patterns = self.plan.patterns(&self.directions);
        let brackets = self.plan.brackets();
        let maker = self.pattern_maker();
        let stored = raw.whole_segments()?;
        if stored > 0 {
            tracing::info!(
                segments = stored,
                of = raw.segments(),
                "segments are stored already"
            );
        }
        let mut tally: Tally = self.noted("capture").unwrap_or_default();
        let mut result = Ok(());
        std::thread::scope(|scope| {
            // One segment is written while the next is captured.
            let (tx, rx) = sync_channel::<(usize, Segment)>(1);
            let raw = &raw;
            let writer = scope.spawn(move || -> Result<(), StoreError> {
                for (index, segment) in rx {
                    raw.write_segment(index, &segment)?;
                }
                Ok(())
            });
            for index in stored..raw.segments() {
                let range = raw.segment_range(index);
                progress(range.start);
                let mut report = |done: usize| progress(range.start + done);
                match self.capture_segment(
                    instrument,
                    &maker,
                    &patterns[range.start / brackets..range.end / brackets],
                    &mut tally,
                    &mut report,
                ) {
                    Ok(segment) => {
                        if tx.send((index, segment)).is_err() {
                            break; // the writer has failed; its error follows
                        }
                    }
                    Err(error) => {
                        result = Err(error);
                        break;
                    }
                }
            }
            drop(tx);
            let written = writer
                .join()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            if let Err(error) = written {
                result = Err(error.into());
            }
        });
        result?;
        progress(self.plan.len());
        let mut facts = Map::new();
        facts.insert("capture".to_owned(), json!(tally));
        self.note(State::Captured, facts)?;
        Ok(tally)
    }

    fn create_raw(&self, path: &Path) -> Result<RawStore, MeasurementError> {
        let format = self.rig.frame_format();
        let layout = RawLayout {
            exposures: self.plan.len(),
            segment: self.plan.segment,
            height: format.height_px,
            width: format.width_px,
            channels: format.channels,
            bits: format.bits,
        };
        let mut attributes = Map::new();
        attributes.insert("rig".to_owned(), json!(self.rig.name));
        attributes.insert(
            "source".to_owned(),
            json!(concat!("rcg ", env!("CARGO_PKG_VERSION"))),
        );
        Ok(RawStore::create(path, layout, attributes)?)
    }

    fn pattern_maker(&self) -> PatternMaker {
        PatternMaker::new(
            View::projector(&self.rig),
            self.plan.spot_deg,
            self.rig.projector.irradiance,
        )
    }

    fn capture_segment(
        &self,
        instrument: &mut Instrument,
        maker: &PatternMaker,
        patterns: &[Exposure],
        tally: &mut Tally,
        progress: &mut dyn FnMut(usize),
    ) -> Result<Segment, MeasurementError> {
        let lit = self.lit_sets(maker, patterns);
        take_segment(instrument, &self.plan.timings(), patterns, &lit, tally, progress)
    }

    fn lit_sets(&self, maker: &PatternMaker, patterns: &[Exposure]) -> Vec<Option<LitSet>> {
        patterns
            .par_iter()
            .map(|pattern| match pattern {
                Exposure::Black => None,
                Exposure::Incident(index) => maker.lit_set(self.directions.grid.direction(*index)).ok(),
            })
            .collect()
    }

    /// What `manifest.json` says of `fact`, if it does.
    pub(crate) fn noted<T: serde::de::DeserializeOwned>(&self, fact: &str) -> Option<T> {
        let bytes = fs::read(self.path("manifest.json")).ok()?;
        let mut manifest: Map<String, Value> = serde_json::from_slice(&bytes).ok()?;
        serde_json::from_value(manifest.remove(fact)?).ok()
    }

    /// Writes the state and `facts` into `manifest.json`, beside what it holds already.
    ///
    /// # Errors
    /// [`MeasurementError::Io`].
    pub fn note(&self, state: State, facts: Map<String, Value>) -> Result<(), MeasurementError> {
        let path = self.path("manifest.json");
        let old = fs::read(&path)
            .ok()
            .and_then(|bytes| serde_json::from_slice::<Map<String, Value>>(&bytes).ok());
        let mut manifest = old.unwrap_or_default();
        manifest.insert("state".to_owned(), json!(state));
        manifest.insert(
            "program".to_owned(),
            json!(concat!("rcg ", env!("CARGO_PKG_VERSION"))),
        );
        manifest.insert("protocol".to_owned(), json!(rcg_protocol::PROTOCOL_VERSION));
        manifest.insert("seed".to_owned(), json!(self.plan.request.seed));
        let mut sums = Map::new();
        for name in ["rig.toml", "plan.toml"] {
            let path = self.path(name);
            let bytes = fs::read(&path).map_err(|source| io(&path, source))?;
            sums.insert(name.to_owned(), json!(hex(&Sha256::digest(&bytes))));
        }
        manifest.insert("sha256".to_owned(), Value::Object(sums));
        manifest.extend(facts);
        let text = serde_json::to_string_pretty(&manifest).expect("JSON values can be written");
        write_whole(&path, text.as_bytes())
    }
}

pub(crate) fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").expect("strings take everything");
        text
    })
}
