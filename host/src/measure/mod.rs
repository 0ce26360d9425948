//! The main job: plan, capture, assemble, evaluate and report on a virtual rig, in one go.

pub mod adaptive;
pub mod again;
mod budget;
mod disk_space;
mod forecast;
pub mod goal;
pub mod gum;
mod job;
pub mod page;
pub mod report;

use std::path::Path;
use std::time::Duration;

use serde_json::{Map, json};

use crate::assemble::share::Share;
use crate::assemble::{AssembleError, Assembled};
use crate::base::blame::Blame;
use crate::base::progress::Progress;
use crate::brdf::sample::SampleError;
use crate::brdf::{Brdf, BrdfError};
use crate::capture::Tally;
use crate::capture::directory::{Measurement, MeasurementError, State};
use crate::instrument::calibration::CalibrationError;
use crate::instrument::rig::Rig;
use crate::judge::evaluate::evaluate;
use crate::measure::report::{Elapsed, ReportError, Summary, report};
use crate::plan::Request;
use crate::plan::predicted_time::instrument_s;
use crate::store::StoreError;
use crate::store::whole_file::FileError;
use crate::virtual_rig::setup::{Setup, SetupError};

pub use budget::{budget_line, budget_text};
pub use disk_space::DiskSpace;
pub use forecast::Forecast;
pub use job::{Job, Reference};

/// Why a measurement failed.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// Planning, capture and storage.
    #[error(transparent)]
    Measurement(#[from] MeasurementError),
    /// Assembly.
    #[error(transparent)]
    Assemble(#[from] AssembleError),
    /// The calibration of the measurement.
    #[error(transparent)]
    Calibration(#[from] Box<CalibrationError>),
    /// The BRDF.
    #[error(transparent)]
    Brdf(#[from] BrdfError),
    /// The sample.
    #[error(transparent)]
    Sample(#[from] SampleError),
    /// The instrument.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// Figures and report.
    #[error(transparent)]
    Report(#[from] ReportError),
}

impl Blame for MeasureError {
    fn is_input(&self) -> bool {
        match self {
            Self::Measurement(error) => error.is_input(),
            Self::Brdf(error) => error.is_input(),
            Self::Assemble(error) => error.is_input(),
            Self::Sample(error) => error.is_input(),
            Self::Calibration(error) => error.is_input(),
            Self::Setup(error) => error.is_input(),
            Self::Report(error) => error.is_input(),
        }
    }
}

impl From<FileError> for MeasureError {
    fn from(error: FileError) -> Self {
        Self::Measurement(error.into())
    }
}

impl From<StoreError> for MeasureError {
    fn from(error: StoreError) -> Self {
        Self::Brdf(error.into())
    }
}

/// Plans a measurement of `request` on `rig` (as loaded, its camera at full size; the calibration's if `setup` has one) in the
/// new directory `out`, and the job to do there.
///
/// # Errors
/// [`MeasureError`].
pub fn prepare(
    out: &Path,
    rig: &Rig,
    request: Request,
    setup: &Setup,
    progress: &dyn Progress,
) -> Result<(Job, Measurement), MeasureError> {
    Measurement::check_new(out)?;
    let job = Job::new(rig, request, setup, progress)?;
    let measurement = job.begin(out)?;
    Ok((job, measurement))
}

/// Captures what is missing of `measurement` with the instrument of its `job`.
///
/// # Errors
/// [`MeasureError`].
pub fn capture(measurement: &Measurement, job: &Job, progress: &dyn Progress) -> Result<Tally, MeasureError> {
    let mut instrument = job.open()?;
    if let Some(world) = &job.world {
        measurement.check_read(&world.inputs)?;
    }
    // Nothing can be refused any more.
    if let Some(session) = &job.session {
        measurement.note_session(session)?;
    }
    measurement.note_box(&instrument)?;
    progress.begin("capture", measurement.plan.len(), "exposures");
    let tally = measurement.capture(&mut instrument, &mut |done| progress.reach(done))?;
    progress.end();
    Ok(tally)
}

/// Assembles the frames of `measurement`.
///
/// # Errors
/// [`MeasureError`].
pub fn assemble_measurement(
    measurement: &Measurement,
    progress: &dyn Progress,
) -> Result<Assembled, MeasureError> {
    assemble_share(measurement, Share::Whole, progress)
}

/// Assembles this `share` of the result of `measurement`; a part of it leaves the measurement itself as it is.
///
/// # Errors
/// [`MeasureError`].
pub fn assemble_share(
    measurement: &Measurement,
    share: Share,
    progress: &dyn Progress,
) -> Result<Assembled, MeasureError> {
    let to = again::To {
        out: &measurement.path("brdf.zarr"),
        probe: None,
        share,
    };
    let assembled = again::assembled(measurement, None, to, progress)?;
    if !matches!(share, Share::Part(_)) {
        let mut facts = Map::new();
        facts.insert("assembled".to_owned(), json!(assembled));
        measurement.note(State::Assembled, facts)?;
    }
    Ok(assembled)
}

/// All stages that are still to be done for `measurement`, whose `job` this is.
///
/// # Errors
/// [`MeasureError`].
pub fn complete(
    measurement: &Measurement,
    job: &Job,
    clock: &dyn Fn() -> Duration,
    progress: &dyn Progress,
) -> Result<Summary, MeasureError> {
    let began = clock();
    let tally = capture(measurement, job, progress)?;
    let capture_s = clock().saturating_sub(began).as_secs_f64();
    let mut summary = conclude(measurement, job.reference.as_ref(), tally, clock, progress)?;
    summary.elapsed_s.capture = capture_s;
    Ok(summary)
}

/// All stages after the capture of `measurement`, of which there is a `tally`; the result is compared with `reference` if
/// there is one.
///
/// # Errors
/// [`MeasureError`].
pub fn conclude(
    measurement: &Measurement,
    reference: Option<&Reference>,
    tally: Tally,
    clock: &dyn Fn() -> Duration,
    progress: &dyn Progress,
) -> Result<Summary, MeasureError> {
    let mut elapsed = Elapsed::default();
    let captured = clock();
    let assembled = assemble_measurement(measurement, progress)?;
    let built = clock();
    elapsed.assemble = (built.saturating_sub(captured)).as_secs_f64();

    let brdf = Brdf::open(&measurement.path("brdf.zarr"))?;
    progress.begin("evaluate", brdf.chunks(), "chunks");
    let against = reference.map(|reference| (reference.name.as_str(), reference.sample.as_ref()));
    let evaluation = evaluate(&brdf, against, &|done| progress.reach(done))?;
    progress.end();
    let judged = clock();
    elapsed.evaluate = (judged.saturating_sub(built)).as_secs_f64();

    let plan = &measurement.plan;
    let mut summary = Summary {
        out: measurement.dir().display().to_string(),
        rig: measurement.rig.name.clone(),
        sample: plan.sample().unwrap_or_default().to_owned(),
        sample_description: plan.request.sample_description.clone(),
        grid: plan.request.grid.to_string(),
        step_deg: plan.request.grid.step_deg(),
        adaptive: measurement.noted("adaptive"),
        image_size: plan.request.image_size,
        incident_directions: measurement.directions.grid.len(),
        exposures: plan.len(),
        exposure_s: plan.exposure_s,
        exposures_s: plan.exposures_s(),
        instrument_s: instrument_s(plan, &measurement.rig),
        capture: tally,
        assembled,
        evaluation,
        elapsed_s: elapsed,
    };
    progress.begin("draw", 1, "reports");
    let beside = reference.map(|reference| reference.sample.as_ref());
    report(measurement, &brdf, beside, &summary)?;
    progress.end();
    summary.elapsed_s.report = (clock().saturating_sub(judged)).as_secs_f64();
    measurement.note(State::Reported, Map::new())?;
    Ok(summary)
}
