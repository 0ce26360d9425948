//! The closed loop.

use std::path::Path;

use crate::measure::goal::Adapted;
use glam::DVec3;
use serde_json::{Map, json};

use super::choose::{Outlook, Predicted, outlook};
use super::journal::{AdaptiveError, Asked, Journal, Segments, differs};
use super::predict::{Image, judged_cells, leave_one_out};
use super::start::{beginning, grid, in_degrees, listed, patterns};
use super::{BATCH, Goal, Stop};
use crate::assemble::{FrameAssembler, certainly_lit};
use crate::base::progress::Progress;
use crate::capture::Instrument;
use crate::capture::directory::{Measurement, MeasurementError, box_of, sweep_unfinished, take_segment};
use crate::capture::session::{Opening, Record};
use crate::hemisphere::disk::Disk;
use crate::hemisphere::incident::{DirectionList, Grid, IncidentSet};
use crate::instrument::calibration::{AppliedCalibration, Calibration};
use crate::instrument::optics::{Unmeasurable, View};
use crate::instrument::rig::Rig;
use crate::measure::{Job, MeasureError};
use crate::plan::pattern::{LitSet, PatternMaker};
use crate::plan::schedule::Timing;
use crate::plan::{BLACK_EXPOSURES, Directions, Exposure, Plan, PlanError, Request, Virtual};
use crate::store::{Lock, Segment};
use crate::virtual_rig::setup::Setup;

/// Nothing is chosen nearer to the horizon than this polar angle, in degrees.
const GRAZING_DEG: f64 = 85.0;
/// More captures do not help where interpolation makes less than this share of the error that noise makes.
const NOISE_RULES: f64 = 0.25;

/// The loop's fixed parts.
struct Loop<'a> {
    rig: &'a Rig,
    applied: &'a AppliedCalibration,
    /// Spots of light and exposures as in the plan that will come of it.
    plan: &'a Plan,
    timings: Vec<Timing>,
    maker: PatternMaker,
    /// Whether light from a direction clears all edges for certain.
    is_clear: Box<dyn Fn(DVec3) -> bool + 'a>,
    disk: Disk,
    /// Patterns of a segment.
    patterns: usize,
    /// Who hears how far it is, and may end it.
    progress: &'a dyn Progress,
}

/// Measures `request` on `rig` (as loaded) adaptively in `out`, which is new or empty, or with `resume` one in which this
/// was begun. `start` is the coarse beginning, the usual one if there is none; the grid of the request has no part. If
/// `setup` has a calibration, `rig` is its rig. Returns the job, the measurement, all of its frames captured, and how it went.
///
/// # Errors
/// [`AdaptiveError`].
#[allow(clippy::too_many_arguments)] // what, from where, how far, with what
pub fn measure(
    out: &Path,
    rig: &Rig,
    request: &Request,
    start: Option<&Grid>,
    goal: Goal,
    setup: &Setup,
    resume: bool,
    progress: &dyn Progress,
) -> Result<(Job, Measurement, Adapted), AdaptiveError> {
    if !request.light.is_single() {
        return Err(AdaptiveError::Light { found: request.light });
    }
    let request = Request {
        grid: grid(None),
        ..request.clone()
    };
    let begun = Request {
        grid: listed(&grid(start))?,
        ..request.clone()
    };
    let applied = setup.calibration.as_ref().map(Calibration::applied);
    let resumed = resume && Journal::exists(out);
    let (mut job, asked, lock) = if resumed {
        let lock = Lock::folder(out)?;
        let scaled = request.rig(rig).map_err(MeasurementError::from)?;
        let asked = resumed_as(out, &scaled, &request, start, goal, setup)?;
        let job = Job::with_times(rig, begun, &asked.exposures_s(), setup, progress)?;
        (job, asked, lock)
    } else {
        Measurement::check_new(out)?;
        let job = Job::new(rig, begun, setup, progress)?;
        let lock = Lock::folder(out)?;
        // The pilot capture takes its time.
        Measurement::check_new(out)?;
        let asked = Asked {
            exposure_s: job.plan.exposure_s,
            longer_s: job.plan.exposures_s().split_off(1),
            rig: job.rig.to_toml(),
            start: start.cloned(),
            goal,
            request: request.clone(),
            virtual_rig: setup.virtual_rig.clone(),
        };
        (job, asked, lock)
    };
    job.plan.black_first = true;
    let (scaled, plan) = (&job.rig, &job.plan);
    let known = applied.clone().unwrap_or_default();
    let fixed = Loop::new(scaled, &known, plan, request.image_size, progress)?;
    let first = fixed.first(start, goal.budget)?;
    // What is no whole batch can only be the end.
    let segments = Segments {
        captures: if first.len().is_multiple_of(BATCH) {
            goal.budget
        } else {
            first.len()
        },
        patterns: fixed.patterns,
        brackets: plan.brackets(),
    };
    let mut instrument = job.open().map_err(MeasureError::from)?;
    let inputs = job
        .world
        .as_ref()
        .map(|world| world.inputs.clone())
        .unwrap_or_default();
    let clock_hz = instrument.device.info().clock_hz;
    let journal = if resumed {
        Journal::open(out, scaled, segments, &inputs, clock_hz)?
    } else {
        Journal::create(out, &asked, scaled, applied.as_ref(), segments, &inputs, clock_hz)?
    };
    record(setup.session.as_ref(), out, &instrument)?;
    progress.begun(out);
    let (directions_deg, adapted) = fixed.run(&journal, first, segments.captures, goal, &mut instrument)?;

    let grid = Grid::List { directions_deg };
    let plan = published(&journal, &job, Request { grid, ..request }, segments)?;
    let facts = Map::from_iter([("adaptive".to_owned(), json!(adapted))]);
    let measurement =
        Measurement::create_in_with(out, scaled.clone(), plan, None, None, facts)?.holding(lock);
    journal.close()?;
    // It borrows the job.
    drop(fixed);
    let plan = measurement.plan.clone();
    Ok((Job { plan, ..job }, measurement, adapted))
}

/// Records in `out` in which `session` somebody measures there, and with which trigger box.
fn record(session: Option<&Opening>, out: &Path, instrument: &Instrument) -> Result<(), MeasurementError> {
    sweep_unfinished(out);
    if let Some(session) = session {
        session.note(out)?;
        Record::note_box(out, box_of(instrument))?;
    }
    Ok(())
}

/// The plan of `request`, whose grid is what `journal` holds in `segments`, with the frames where a measurement has them.
fn published(
    journal: &Journal,
    job: &Job,
    request: Request,
    segments: Segments,
) -> Result<Plan, AdaptiveError> {
    let plan = Plan::bracketed(request, &job.rig, &job.plan.exposures_s());
    let plan = Plan {
        segment: segments.patterns * segments.brackets,
        black_first: job.plan.black_first,
        watching_side: job.plan.watching_side,
        virtual_rig: job.plan.virtual_rig.clone(),
        ..plan.map_err(MeasurementError::from)?
    };
    let captures = plan.direction_count;
    journal.publish(&job.rig, &plan, Segments { captures, ..segments })?;
    Ok(plan)
}

/// An adaptive measurement as it was asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Begun {
    /// The request; its grid has no part.
    pub request: Request,
    /// The virtual rig.
    pub virtual_rig: Virtual,
    /// Coarse beginning, the usual one if there is none.
    pub start: Option<Grid>,
    /// What is to be reached.
    pub goal: Goal,
}

/// The adaptive measurement that was begun in `dir`, if one was.
///
/// # Errors
/// [`AdaptiveError`] if its file cannot be read.
pub fn begun(dir: &Path) -> Result<Option<Begun>, AdaptiveError> {
    if !Journal::exists(dir) {
        return Ok(None);
    }
    let Asked {
        request,
        virtual_rig,
        start,
        goal,
        ..
    } = Journal::asked(dir)?;
    Ok(Some(Begun {
        request,
        virtual_rig,
        start,
        goal,
    }))
}

/// Refuses to go on in `dir`, where an adaptive measurement was `begun`, with another goal or beginning.
///
/// # Errors
/// [`AdaptiveError::Differs`].
pub fn check_same(dir: &Path, begun: &Begun, start: Option<&Grid>, goal: Goal) -> Result<(), AdaptiveError> {
    if begun.goal != goal {
        return Err(differs(dir, "goal"));
    }
    if begun.start.as_ref() != start {
        return Err(differs(dir, "coarse start"));
    }
    Ok(())
}

/// What was begun in `out`, which must be what is asked for now.
fn resumed_as(
    out: &Path,
    scaled: &Rig,
    request: &Request,
    start: Option<&Grid>,
    goal: Goal,
    setup: &Setup,
) -> Result<Asked, AdaptiveError> {
    let asked = Journal::asked(out)?;
    let applied = setup.calibration.as_ref().map(Calibration::applied);
    let applied = applied.as_ref();
    if let Some(applied) = applied.filter(|_| !Journal::has_frames(out)) {
        applied.write(out).map_err(MeasureError::from)?;
    }
    let known = AppliedCalibration::read(out).map_err(|error| MeasureError::from(Box::new(error)))?;
    let fields = [
        ("rig", asked.rig == scaled.to_toml()),
        ("goal", asked.goal == goal),
        ("request", asked.request == *request),
        // What goes wrong on purpose changes no frame.
        (
            "virtual rig",
            asked.virtual_rig.calm() == setup.virtual_rig.calm(),
        ),
        ("coarse start", asked.start.as_ref() == start),
        (
            "calibration",
            applied.map_or(known == AppliedCalibration::default(), |applied| {
                known == *applied
            }),
        ),
    ];
    match fields.into_iter().find(|(_, same)| !same) {
        Some((field, _)) => Err(differs(out, field)),
        None => Ok(asked),
    }
}

impl<'a> Loop<'a> {
    /// For images of `image_size` pixels a side of `rig`, its camera image scaled.
    fn new(
        rig: &'a Rig,
        applied: &'a AppliedCalibration,
        plan: &'a Plan,
        image_size: u32,
        progress: &'a dyn Progress,
    ) -> Result<Self, AdaptiveError> {
        Ok(Self {
            rig,
            applied,
            plan,
            timings: plan.timings(),
            maker: PatternMaker::new(View::projector(rig), plan.spot_deg, rig.projector.irradiance),
            is_clear: Box::new(certainly_lit(rig, applied, plan).map_err(MeasureError::from)?),
            disk: Disk::new(image_size as usize),
            patterns: patterns(plan),
            progress,
        })
    }

    /// The coarse beginning, in degrees.
    fn first(&self, start: Option<&Grid>, budget: usize) -> Result<Vec<[f64; 2]>, AdaptiveError> {
        let (lit, reachable) = (|w| self.is_lit(w), |w| self.is_reachable(w));
        beginning(self.rig, start, budget, &lit, &reachable, self.spot_rad())
    }

    fn is_lit(&self, w: DVec3) -> bool {
        self.maker.lit_set(w).is_ok() && (self.is_clear)(w)
    }

    fn is_reachable(&self, w: DVec3) -> bool {
        w.z > GRAZING_DEG.to_radians().cos() && self.is_lit(w)
    }

    fn spot_rad(&self) -> f64 {
        self.plan.spot_deg.to_radians()
    }

    /// Captures `first` and what follows from it, at most `most` directions, until `goal` is reached.
    fn run(
        &self,
        journal: &Journal,
        first: Vec<[f64; 2]>,
        most: usize,
        goal: Goal,
        instrument: &mut Instrument,
    ) -> Result<(Vec<[f64; 2]>, Adapted), AdaptiveError> {
        let mut stored = journal.frames.whole_segments()?;
        let black = self.black(journal, &mut stored, instrument)?;
        let unusable = |name: &str, reason| {
            AdaptiveError::from(MeasurementError::Plan(PlanError::File {
                path: journal.path(name).display().to_string(),
                reason,
            }))
        };
        let mut assembler = FrameAssembler::new(self.rig, self.applied, &black, self.plan, self.disk)
            .map_err(|reason| unusable("adaptive.zarr", reason))?;
        drop(black);
        let cells = judged_cells(self.disk);
        // What was chosen before it was interrupted is gone through again round by round, so that it is told as if nothing had been.
        let (mut chosen, beginning) = (journal.directions_deg()?, first.len());
        if chosen.is_empty() {
            journal.choose(&first)?;
            chosen = first;
        }
        let mut directions_deg = chosen[..beginning.min(chosen.len())].to_vec();
        let mut images: Vec<Image> = Vec::new();
        let mut history = Vec::new();
        loop {
            let set = IncidentSet::List(DirectionList::new(&directions_deg)?.into());
            // Only those that are new.
            let reasons = (0..set.len())
                .map(|index| (index < images.len()).then_some(Unmeasurable::OutsideImage))
                .collect();
            let directions = Directions { grid: set, reasons };
            assembler
                .expect(self.plan, &directions)
                .map_err(|reason| unusable(AppliedCalibration::FILE, reason))?;
            let set = directions.grid;
            self.catch_up(journal, &set, &mut stored, &assembler, &mut images, instrument)?;
            let left_out = leave_one_out(&directions_deg, &set, &images, self.disk, &cells);
            let IncidentSet::List(list) = &set else {
                unreachable!("made so")
            };
            let wanted = BATCH.min(most - images.len());
            let reachable = |w| self.is_reachable(w);
            let Outlook { predicted, next } = outlook(list, &left_out, &reachable, self.spot_rad(), wanted);
            let captures = images.len();
            let Predicted { mse, noise_mse } = predicted.ok_or(AdaptiveError::NothingSeen { captures })?;
            let predicted_db = decibels(mse + noise_mse);
            history.push((captures, predicted_db));
            let words = predicted_db.map_or("no error".to_owned(), |db| format!("{db:.1} dB"));
            self.progress
                .remark(&format!("adaptive: {captures} captures, {words} predicted"));
            let is_reached = |target_db: f64| predicted_db.is_none_or(|db| db >= target_db);
            let stop = if goal.target_db.is_some_and(is_reached) {
                Some(Stop::Target)
            } else if captures == goal.budget {
                Some(Stop::Budget)
            } else if goal.target_db.is_some() && mse < NOISE_RULES * noise_mse {
                Some(Stop::Noise)
            } else if wanted == 0 || next.len() < wanted {
                Some(Stop::Spot)
            } else {
                None
            };
            if let Some(stop) = stop {
                let adapted = Adapted {
                    captures,
                    predicted_db,
                    noise_limit_db: decibels(noise_mse),
                    goal,
                    stop,
                    history,
                };
                return Ok((directions_deg, adapted));
            }
            let done = directions_deg.len();
            if chosen.len() > done {
                directions_deg.extend(&chosen[done..chosen.len().min(done + wanted)]);
                continue;
            }
            directions_deg.extend(next.into_iter().map(in_degrees));
            journal.choose(&directions_deg)?;
        }
    }

    /// Segments of black patterns, which come first.
    fn dark(&self) -> usize {
        BLACK_EXPOSURES / self.patterns
    }

    /// All segments of black patterns; captures those beyond the `stored` ones.
    fn black(
        &self,
        journal: &Journal,
        stored: &mut usize,
        instrument: &mut Instrument,
    ) -> Result<Vec<Segment>, AdaptiveError> {
        let dark = self.dark();
        for segment in *stored..dark {
            let first = segment * self.patterns;
            let black: Vec<Exposure> = (first..first + self.patterns).map(Exposure::black).collect();
            self.capture(journal, segment, &black, &vec![None; self.patterns], instrument)?;
        }
        *stored = (*stored).max(dark);
        let black = (0..dark)
            .map(|segment| journal.frames.read_segment(segment))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(black)
    }

    /// Adds the images that are still missing of the directions of `set`; captures those beyond the `stored` segments.
    fn catch_up(
        &self,
        journal: &Journal,
        set: &IncidentSet,
        stored: &mut usize,
        assembler: &FrameAssembler,
        images: &mut Vec<Image>,
        instrument: &mut Instrument,
    ) -> Result<(), AdaptiveError> {
        while images.len() < set.len() {
            let batch = images.len()..(images.len() + self.patterns).min(set.len());
            let segment = self.dark() + batch.start / self.patterns;
            if segment >= *stored {
                let exposures: Vec<Exposure> = batch.clone().map(Exposure::Incident).collect();
                let lit: Vec<Option<LitSet>> = batch
                    .clone()
                    .map(|index| self.maker.lit_set(set.direction(index)).ok())
                    .collect();
                self.capture(journal, segment, &exposures, &lit, instrument)?;
                *stored = segment + 1;
            }
            let stored = journal.frames.read_segment(segment)?;
            let luminance = assembler.luminance(&stored, batch.start);
            images.extend(luminance.into_iter().map(|(f, noise)| Image { f, noise }));
        }
        Ok(())
    }

    fn capture(
        &self,
        journal: &Journal,
        segment: usize,
        exposures: &[Exposure],
        lit: &[Option<LitSet>],
        instrument: &mut Instrument,
    ) -> Result<(), AdaptiveError> {
        // Black patterns that look alike have noise of their own wherever they are captured.
        let part = if exposures.iter().any(|exposure| exposure.is_black()) {
            segment as u64
        } else {
            0
        };
        instrument.camera.begin_part(part);
        let taken = take_segment(instrument, &self.timings, exposures, lit, &mut |_| {
            self.progress.reach(0);
        })?;
        Ok(taken.write(&journal.frames, segment)?)
    }
}

/// PSNR in dB of a mean squared error; `None` without an error.
fn decibels(mse: f64) -> Option<f64> {
    (mse > 0.0).then(|| -10.0 * mse.log10())
}
