//! A measurement: a directory with everything that belongs to it, and the stages that fill it.
//!
//! # Design
//! `rig.toml`, `plan.toml` and `calibration.json` (if there is one) come first and never change; they say what all later
//! stages do. `manifest.json` holds their checksums and those of what they name elsewhere (sample, truth) from the start,
//! `raw.zarr` holds them too: every stage compares them with what it finds. `raw.zarr` grows by whole segments; a run that
//! was killed goes on with the next one. What is derived (`brdf.zarr`, figures, report) appears under its name only when it is
//! whole. `manifest.json` also says how far things are. Who writes has the directory's [`Lock`].

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::sync_channel;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use crate::capture::camera_clock::CameraClock;
use crate::capture::session::Opening;
use crate::capture::{CaptureError, Instrument, Tally};
use crate::instrument::calibration::AppliedCalibration;
use crate::instrument::optics::View;
use crate::instrument::rig::Rig;
use crate::plan::light::together;
use crate::plan::pattern::{LitSet, PatternMaker};
use crate::plan::{Directions, Exposure, Plan};
use crate::store::raw::SUBJECT;
use crate::store::whole_file::{FileError, write_whole};
use crate::store::{Lock, RawLayout, RawStore, StoreError};

mod begin;
mod error;
mod files;
mod identity;
mod lineage;
mod manifest;
mod resume;
mod segment;

use begin::sweep_moved;
pub(crate) use begin::{FIGURES, FRAMES_BEFORE_PLAN, PICTURES, sweep_unfinished};
pub use error::MeasurementError;
use files::write_synced;
pub(crate) use identity::{Sums, stamps_of, sums_at, sums_of};
pub(crate) use lineage::box_of;
use manifest::Manifest;
use segment::planned;
pub(crate) use segment::{Taken, take_segment};

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
    /// What it was begun with.
    sums: Sums,
    /// The right to write in the directory, if it was asked for.
    _lock: Option<Arc<Lock>>,
    /// The rig, its camera image of the planned size.
    pub rig: Rig,
    /// The plan.
    pub plan: Plan,
    /// The incident directions.
    pub directions: Directions,
}

impl Measurement {
    /// Begins a measurement in `dir`, with the right to write there. `rig` has its camera image scaled to the plan's size.
    ///
    /// # Errors
    /// [`MeasurementError`].
    pub fn create(dir: &Path, rig: Rig, plan: Plan) -> Result<Self, MeasurementError> {
        Self::create_with(dir, rig, plan, None, None)
    }

    /// As [`create`](Self::create), with what a calibration found of the instrument, and with the session in which it begins.
    ///
    /// # Errors
    /// [`MeasurementError`].
    pub fn create_with(
        dir: &Path,
        rig: Rig,
        plan: Plan,
        calibration: Option<&AppliedCalibration>,
        session: Option<&Opening>,
    ) -> Result<Self, MeasurementError> {
        Self::check_new(dir)?;
        let lock = Lock::folder(dir)?;
        Self::check_new(dir)?;
        let facts = Map::new();
        Ok(Self::create_in_with(dir, rig, plan, calibration, session, facts)?.holding(lock))
    }

    /// As [`create`](Self::create), in a directory that holds what belongs to the measurement already, its calibration
    /// perhaps among it, and to which the caller has the right to write.
    ///
    /// # Errors
    /// [`MeasurementError`].
    pub fn create_in(dir: &Path, rig: Rig, plan: Plan) -> Result<Self, MeasurementError> {
        Self::create_in_with(dir, rig, plan, None, None, Map::new())
    }

    /// As [`create_in`](Self::create_in), with the `calibration` and the `session` to write and `facts` for the manifest. Sessions that are
    /// recorded there already stay.
    ///
    /// # Errors
    /// [`MeasurementError`].
    pub fn create_in_with(
        dir: &Path,
        rig: Rig,
        plan: Plan,
        calibration: Option<&AppliedCalibration>,
        session: Option<&Opening>,
        mut facts: Map<String, Value>,
    ) -> Result<Self, MeasurementError> {
        let directions = Directions::new(&rig, &plan.request.grid)?;
        // A directory with a plan is a measurement, so the plan gets its name last. Until then it lies there under its
        // temporary one, which tells `sweep` that the others are ours.
        let temporary = dir.join("plan.tmp");
        write_synced(&temporary, plan.to_toml().as_bytes())?;
        write_whole(&dir.join("rig.toml"), rig.to_toml().as_bytes())?;
        if let Some(calibration) = calibration {
            calibration.write(dir)?;
        }
        if let Some(session) = session {
            session.note(dir)?;
        }
        facts.extend(lineage::first_session(dir)?);
        let measurement = Self {
            dir: dir.to_owned(),
            sums: sums_at(dir, &rig, &plan)?,
            _lock: None,
            rig,
            plan,
            directions,
        };
        let seed = measurement.plan.virtual_rig.as_ref().map(|spec| spec.seed);
        Manifest::new(dir, &measurement.sums, seed, facts).write()?;
        let path = measurement.path("plan.toml");
        fs::rename(&temporary, &path).map_err(|source| FileError::at(&path, source))?;
        Ok(measurement)
    }

    /// With the right to write in its directory.
    #[must_use]
    pub fn holding(self, lock: Lock) -> Self {
        Self {
            _lock: Some(Arc::new(lock)),
            ..self
        }
    }

    /// Opens the measurement in `dir` with the right to write there, which this process alone has until it is dropped.
    ///
    /// # Errors
    /// As for [`open`](Self::open); [`StoreError::Busy`] if another process is writing there.
    pub fn open_to_write(dir: &Path) -> Result<Self, MeasurementError> {
        if !Self::exists(dir) {
            return Err(MeasurementError::NotOne {
                path: dir.display().to_string(),
            });
        }
        let lock = Lock::folder(dir)?;
        sweep_unfinished(dir);
        let measurement = Self::open(dir)?.holding(lock);
        sweep_moved(dir)?;
        Ok(measurement)
    }

    /// Opens the measurement in `dir` to make a part of its result, together with others; nobody writes the measurement meanwhile.
    ///
    /// # Errors
    /// As for [`open_to_write`](Self::open_to_write).
    pub fn open_together(dir: &Path) -> Result<Self, MeasurementError> {
        if !Self::exists(dir) {
            return Err(MeasurementError::NotOne {
                path: dir.display().to_string(),
            });
        }
        let lock = Lock::folder_together(dir)?;
        Ok(Self::open(dir)?.holding(lock))
    }

    /// Opens the measurement in `dir` to read it; a writer's right it neither has nor needs.
    ///
    /// # Errors
    /// [`MeasurementError::NotOne`], what is wrong with its rig, plan or manifest, or [`MeasurementError::Changed`] if one of
    /// its files is not the one with which it was begun.
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
        if plan.bands != rig.shown_bands() {
            return Err(MeasurementError::Differs {
                path: rig_path.display().to_string(),
                field: "bands",
                expected: format!("{} pictures of each pattern", plan.bands),
                found: rig.shown_bands().to_string(),
            });
        }
        let directions = Directions::new(&rig, &plan.request.grid)?;
        let lens = &rig.camera.lens;
        if directions.measurable().count() != plan.direction_count || lens.width_px != plan.request.image_size
        {
            return Err(MeasurementError::Differs {
                path: rig_path.display().to_string(),
                field: "rig",
                expected: format!(
                    "{} measurable directions and {} pixels a side",
                    plan.direction_count, plan.request.image_size
                ),
                found: format!("{} and {}", directions.measurable().count(), lens.width_px),
            });
        }
        let measurement = Self {
            dir: dir.to_owned(),
            sums: Manifest::read(dir)?.sums(),
            _lock: None,
            rig,
            plan,
            directions,
        };
        measurement.check_files()?;
        measurement.record()?;
        Ok(measurement)
    }

    /// Whether `dir` holds a measurement.
    #[must_use]
    pub fn exists(dir: &Path) -> bool {
        dir.join("plan.toml").is_file()
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
    /// all segments, whenever they were captured.
    ///
    /// # Errors
    /// [`MeasurementError`]; what was stored before stays.
    pub fn capture(
        &self,
        instrument: &mut Instrument,
        progress: &mut dyn FnMut(usize),
    ) -> Result<Tally, MeasurementError> {
        let clock_hz = instrument.device.info().clock_hz;
        let raw_path = self.path("raw.zarr");
        let raw = if raw_path.exists() {
            self.raw()?
        } else {
            self.create_raw(&raw_path, clock_hz)?
        };
        if raw.layout().clock_hz != clock_hz {
            return Err(MeasurementError::Differs {
                path: raw_path.display().to_string(),
                field: "ticks_per_second",
                expected: raw.layout().clock_hz.to_string(),
                found: format!("a trigger box with {clock_hz}"),
            });
        }
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
        let mut result = Ok(());
        std::thread::scope(|scope| {
            // One segment is written while the next is captured.
            let (tx, rx) = sync_channel::<(usize, Taken)>(1);
            let raw = &raw;
            let writer = scope.spawn(move || -> Result<(), StoreError> {
                for (index, taken) in rx {
                    taken.write(raw, index)?;
                }
                Ok(())
            });
            for index in stored..raw.segments() {
                let range = raw.segment_range(index);
                progress(range.start);
                let mut report = |done: usize| progress(range.start + done);
                let shown = range.start / brackets..range.end / brackets;
                // Segments that show the same, which only black ones do, are told apart by their number among these.
                let before = patterns[..shown.start].chunks(shown.len().max(1));
                let same = before
                    .filter(|before| **before == patterns[shown.clone()])
                    .count();
                instrument.camera.begin_part(same as u64);
                match self.capture_segment(instrument, &maker, range.start, &patterns[shown], &mut report) {
                    Ok(taken) => {
                        // Here the trigger box waits where the disk is slower.
                        if tx.send((index, taken)).is_err() {
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
        let tally = raw.tally()?;
        let mut facts = Map::new();
        facts.insert("capture".to_owned(), json!(tally));
        facts.insert("camera_clock".to_owned(), json!(camera_clock(&raw)?));
        self.note(State::Captured, facts)?;
        Ok(tally)
    }

    /// The stored frames, which must be of this measurement.
    ///
    /// # Errors
    /// [`MeasurementError::Changed`] if they were captured with another rig, plan, calibration, sample or truth;
    /// [`MeasurementError::Store`].
    pub fn raw(&self) -> Result<RawStore, MeasurementError> {
        let path = self.path("raw.zarr");
        let raw = RawStore::open(&path)?;
        let found = raw.attributes().get(SUBJECT);
        if found != Some(&json!(self.sums)) {
            let of = |name: &str| found.and_then(|sums| sums.get(name)).and_then(Value::as_str);
            let name = self.sums.iter().find(|(name, sum)| of(name) != Some(*sum));
            let (name, sum) = name.map_or(("all", ""), |(name, sum)| (name, sum));
            return Err(MeasurementError::Changed {
                path: path.display().to_string(),
                expected: format!("frames that were captured with its own {name} (SHA-256 {sum:.12})"),
                found: format!("frames of another one ({:.12})", of(name).unwrap_or("none")),
            });
        }
        let (layout, bits) = (raw.layout(), self.rig.frame_format().bits);
        if (layout.segment, layout.bits) != (self.plan.segment, bits) {
            return Err(MeasurementError::Changed {
                path: path.display().to_string(),
                expected: format!("segments of {} exposures of {bits} bits", self.plan.segment),
                found: format!("{} of {} bits", layout.segment, layout.bits),
            });
        }
        Ok(raw)
    }

    fn create_raw(&self, path: &Path, clock_hz: u32) -> Result<RawStore, MeasurementError> {
        let format = self.rig.frame_format();
        let layout = RawLayout {
            exposures: self.plan.len(),
            segment: self.plan.segment,
            height: format.height_px,
            width: format.width_px,
            channels: format.channels,
            bits: format.bits,
            clock_hz,
        };
        let mut attributes = Map::new();
        attributes.insert(SUBJECT.to_owned(), json!(self.sums));
        attributes.insert("rig".to_owned(), json!(self.rig.name));
        if let Some(bands) = &self.rig.bands {
            attributes.insert("bands".to_owned(), bands.to_json());
        }
        if let Some(code) = self.plan.code {
            attributes.insert("light".to_owned(), json!(code.light()));
            let meaning =
                "incident is -3 - number of the code pattern, which lights many incident directions";
            attributes.insert("code_patterns".to_owned(), json!(meaning));
        }
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
        first: usize,
        patterns: &[Exposure],
        progress: &mut dyn FnMut(usize),
    ) -> Result<Taken, MeasurementError> {
        let lit = self.lit_sets(maker, patterns);
        let timings = self.plan.timings();
        let planned = planned(first, &timings, patterns, &lit);
        instrument.camera.expect(&planned).map_err(CaptureError::from)?;
        take_segment(instrument, &timings, patterns, &lit, progress)
    }

    fn lit_sets(&self, maker: &PatternMaker, patterns: &[Exposure]) -> Vec<Option<LitSet>> {
        let codes = self.plan.code_patterns();
        let measurable: Vec<usize> = self.directions.measurable().collect();
        let of = |index: usize| maker.lit_set(self.directions.grid.direction(index)).ok();
        patterns
            .par_iter()
            .map(|pattern| match pattern {
                Exposure::Black | Exposure::Unwatched => None,
                Exposure::Incident(index) => of(*index),
                Exposure::Coded(number) => {
                    let lit = codes.iter().flat_map(|codes| codes.lit(*number));
                    let cells: Vec<LitSet> = lit.filter_map(|cell| of(measurable[cell])).collect();
                    Some(together(&cells))
                }
            })
            .collect()
    }

    /// What `manifest.json` says of `fact`, if it does: how far the measurement is as `state` ([`State`]), and what came of each stage.
    #[must_use]
    pub fn noted<T: serde::de::DeserializeOwned>(&self, fact: &str) -> Option<T> {
        Manifest::read(&self.dir).ok()?.get(fact)
    }

    /// Writes the state and `facts` into `manifest.json`, beside what it holds already.
    ///
    /// # Errors
    /// [`MeasurementError::Manifest`]; [`MeasurementError::File`].
    pub fn note(&self, state: State, facts: Map<String, Value>) -> Result<(), MeasurementError> {
        let mut manifest = Manifest::read(&self.dir)?;
        manifest.note(state, facts);
        manifest.write()
    }
}

/// What the frames of `raw` say of the camera's clock; a jump of it is worth a word.
fn camera_clock(raw: &RawStore) -> Result<CameraClock, StoreError> {
    let clock = CameraClock::of(raw)?;
    for jump in &clock.jumps {
        tracing::warn!(
            exposure = jump.exposure,
            by_s = jump.by_s,
            "the camera's clock has jumped"
        );
    }
    Ok(clock)
}
