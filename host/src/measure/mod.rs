//! The main job: plan, capture, assemble, evaluate and report on a virtual rig, in one go.

pub mod adaptive;
pub mod goal;
pub mod report;

use std::path::Path;
use std::time::Duration;

use serde_json::{Map, json};

use crate::assemble::{AssembleError, Assembled, assemble};
use crate::base::blame::Blame;
use crate::base::progress::Progress;
use crate::brdf::sample::SampleError;
use crate::brdf::{Brdf, BrdfError};
use crate::capture::Tally;
use crate::capture::directory::{Measurement, MeasurementError, State};
use crate::capture::pilot::{auto_exposure_s, propose};
use crate::instrument::calibration::{AppliedCalibration, Calibration, CalibrationError};
use crate::instrument::rig::Rig;
use crate::judge::evaluate::evaluate;
use crate::measure::report::{Elapsed, ReportError, Summary, report};
use crate::plan::{Plan, Request};
use crate::store::StoreError;
use crate::store::whole_file::FileError;
use crate::virtual_rig::setup::{DEFAULT_SAMPLE, Setup, SetupError};

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
            Self::Report(_) => false,
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

/// The plan of `request` on `rig` (as loaded, its camera at full size), and the rig as [`Request::rig`] makes it; a pilot
/// capture finds the exposure times if `request` leaves them open.
///
/// # Errors
/// [`MeasureError`].
pub fn planned(
    rig: &Rig,
    request: Request,
    setup: &Setup,
    progress: &dyn Progress,
) -> Result<(Rig, Plan), MeasureError> {
    planned_like(rig, request, None, setup, progress)
}

/// As [`planned`], with the exposure times and segments of the plan `like` if there is one: a request in milliseconds does not
/// have the times to the last bit, and noise is drawn by what is exposed in one run.
fn planned_like(
    rig: &Rig,
    request: Request,
    like: Option<&Plan>,
    setup: &Setup,
    progress: &dyn Progress,
) -> Result<(Rig, Plan), MeasureError> {
    // Checks what was asked for before anything is built.
    crate::brdf::sample::parse(request.sample.as_deref().unwrap_or(DEFAULT_SAMPLE))?;
    let given_s = like
        .map(Plan::exposures_s)
        .or_else(|| request.brackets.times_s())
        .or_else(|| request.exposure_s.map(|exposure_s| vec![exposure_s]));
    if let Some(calibration) = &setup.calibration {
        calibration.check_tilt(request.tilt).map_err(Box::new)?;
    }
    let any_s = given_s.clone().unwrap_or_else(|| vec![rig.camera.exposure_s]);
    let scaled = request.rig(rig).map_err(MeasurementError::from)?;
    Plan::bracketed(request.clone(), &scaled, &any_s).map_err(MeasurementError::from)?;
    let exposures_s = if let Some(exposures_s) = given_s {
        if setup.trigger_box.is_some() {
            // What does not answer is named before anything is written.
            setup.open(&scaled, &request)?;
        }
        exposures_s
    } else {
        progress.begin("pilot capture", 1, "runs");
        let mut instrument = setup.open(&scaled, &request)?;
        let exposures_s = if request.brackets.is_one() {
            vec![auto_exposure_s(&scaled, &request.grid, &mut instrument)?]
        } else {
            let proposal = propose(&scaled, &request.grid, &request.brackets, &mut instrument)?;
            progress.remark(&proposal.to_string());
            proposal.exposures_s
        };
        progress.end();
        exposures_s
    };
    let mut plan = Plan::bracketed(request, &scaled, &exposures_s).map_err(MeasurementError::from)?;
    if let Some(like) = like {
        plan.segment = like.segment;
    }
    Ok((scaled, plan))
}

/// Plans a measurement of `request` on `rig` (as loaded, its camera at full size) in the new directory `out`; the
/// exposure time is found by a pilot capture if `request` leaves it open. If `setup`
/// has a calibration, `rig` is its rig.
///
/// # Errors
/// [`MeasureError`].
pub fn prepare(
    out: &Path,
    rig: &Rig,
    request: Request,
    setup: &Setup,
    progress: &dyn Progress,
) -> Result<Measurement, MeasureError> {
    prepare_like(out, rig, request, None, setup, progress)
}

/// As [`prepare`], with the exposure times and segments of the plan `like` if there is one.
///
/// # Errors
/// [`MeasureError`].
pub fn prepare_like(
    out: &Path,
    rig: &Rig,
    request: Request,
    like: Option<&Plan>,
    setup: &Setup,
    progress: &dyn Progress,
) -> Result<Measurement, MeasureError> {
    Measurement::check_new(out)?;
    let (scaled, plan) = planned_like(rig, request, like, setup, progress)?;
    let applied = setup.calibration.as_ref().map(Calibration::applied);
    Ok(Measurement::create_with(out, scaled, plan, applied.as_ref())?)
}

/// Captures what is missing of `measurement` with the instrument that `setup` opens.
///
/// # Errors
/// [`MeasureError`].
pub fn capture(
    measurement: &Measurement,
    setup: &Setup,
    progress: &dyn Progress,
) -> Result<Tally, MeasureError> {
    let mut instrument = setup.open(&measurement.rig, &measurement.plan.request)?;
    measurement.check_inputs()?;
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
    let frames = measurement.plan.direction_count * measurement.plan.brackets();
    progress.begin("assemble", frames, "frames");
    let Measurement {
        rig,
        plan,
        directions,
        ..
    } = measurement;
    let (raw, brdf) = (measurement.path("raw.zarr"), measurement.path("brdf.zarr"));
    // Frames of another measurement are not combined with this one's plan.
    measurement.raw()?;
    let applied = AppliedCalibration::read(measurement.dir()).map_err(Box::new)?;
    let assembled = assemble(rig, plan, directions, &applied, &raw, &brdf, &|done| {
        progress.reach(done);
    })?;
    progress.end();
    let mut facts = Map::new();
    facts.insert("assembled".to_owned(), json!(assembled));
    measurement.note(State::Assembled, facts)?;
    Ok(assembled)
}

/// All stages that are still to be done for `measurement`.
///
/// # Errors
/// [`MeasureError`].
pub fn complete(
    measurement: &Measurement,
    setup: &Setup,
    clock: &dyn Fn() -> Duration,
    progress: &dyn Progress,
) -> Result<Summary, MeasureError> {
    let mut elapsed = Elapsed::default();
    let began = clock();
    let tally = capture(measurement, setup, progress)?;
    let captured = clock();
    elapsed.capture = (captured.saturating_sub(began)).as_secs_f64();
    let assembled = assemble_measurement(measurement, progress)?;
    let built = clock();
    elapsed.assemble = (built.saturating_sub(captured)).as_secs_f64();

    let brdf = Brdf::open(&measurement.path("brdf.zarr"))?;
    let spec = measurement
        .plan
        .request
        .sample
        .as_deref()
        .unwrap_or(DEFAULT_SAMPLE);
    let sample = crate::brdf::sample::parse(spec)?;
    measurement.check_inputs()?;
    progress.begin("evaluate", brdf.chunks(), "chunks");
    let evaluation = evaluate(&brdf, Some((spec, sample.as_ref())), &|done| progress.reach(done))?;
    progress.end();
    let judged = clock();
    elapsed.evaluate = (judged.saturating_sub(built)).as_secs_f64();

    let plan = &measurement.plan;
    let mut summary = Summary {
        out: measurement.dir().display().to_string(),
        rig: measurement.rig.name.clone(),
        sample: spec.to_owned(),
        grid: plan.request.grid.to_string(),
        step_deg: plan.request.grid.step_deg(),
        adaptive: measurement.noted("adaptive"),
        image_size: plan.request.image_size,
        incident_directions: measurement.directions.grid.len(),
        exposures: plan.len(),
        exposure_s: plan.exposure_s,
        exposures_s: plan.exposures_s(),
        instrument_s: plan.duration_s(),
        capture: tally,
        assembled,
        evaluation,
        elapsed_s: elapsed,
    };
    progress.begin("draw", 1, "reports");
    report(measurement, &brdf, sample.as_ref(), &summary)?;
    progress.end();
    summary.elapsed_s.report = (clock().saturating_sub(judged)).as_secs_f64();
    measurement.note(State::Reported, Map::new())?;
    Ok(summary)
}
