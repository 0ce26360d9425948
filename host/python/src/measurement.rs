//! Measuring on the virtual rig.

use std::path::{Path, PathBuf};
use std::time::Instant;

use pyo3::prelude::*;
use rcg::base::progress::Progress;
use rcg::base::text::shown;
use rcg::capture::directory::Measurement;
use rcg::capture::session::{CalibrationUsed, Opening, Said, Session, is_words};
use rcg::hemisphere::incident::Grid;
use rcg::instrument::calibration::Calibration;
use rcg::instrument::rig::Rig;
use rcg::measure::adaptive::{self, AdaptiveError, Begun, Goal};
use rcg::measure::{Forecast, Job, complete};
use rcg::plan::{PlanError, Request, SPOTS_DEG, Virtual};
use rcg::virtual_rig::setup::Setup;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::failure::Failure;
use crate::files::json;
use crate::long_work;

/// What Python asks for.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Asked {
    rig: String,
    calibration: Option<PathBuf>,
    /// File of incident directions; in place of those of the request.
    directions: Option<PathBuf>,
    /// Keys of [`Request`] that are given.
    request: Map<String, Value>,
    /// Keys of [`Virtual`] that are given.
    #[serde(rename = "virtual")]
    virtual_rig: Map<String, Value>,
    /// How far directions are chosen on the way; of a measurement that chooses none, nothing.
    adaptive: Option<Far>,
    session: Asker,
}

/// How far an adaptive measurement goes.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Far {
    target_db: Option<f64>,
    budget: Option<usize>,
}

/// Who asks.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Asker {
    began: String,
    host: Option<String>,
    operator: Option<String>,
    notes: Vec<String>,
}

impl Asked {
    fn read(text: &str) -> Result<Self, Failure> {
        serde_json::from_str(text).map_err(Failure::input)
    }

    /// The request and the virtual rig, what is not given as in `before`.
    fn over(&self, before: (&Request, &Virtual)) -> Result<(Request, Virtual), Failure> {
        let mut request: Request = over(before.0, &self.request)?;
        if let Some(path) = &self.directions {
            request.grid = Grid::read_list(path).map_err(PlanError::from)?;
        }
        if let Some(spot_deg) = request.spot_deg.filter(|spot| !SPOTS_DEG.contains(spot)) {
            let (least, most) = (SPOTS_DEG.start(), SPOTS_DEG.end());
            return Err(Failure::input(format!(
                "spot_deg: expected a number of degrees from {least} to {most}, found {spot_deg}"
            )));
        }
        for (name, words) in [
            ("sample_name", &request.sample_name),
            ("sample_description", &request.sample_description),
        ] {
            if let Some(words) = words.as_deref().filter(|words| !is_words(words)) {
                return Err(Failure::input(format!(
                    "{name}: expected some words on one line, of at most 1000 bytes, found {}",
                    shown(words)
                )));
            }
        }
        let virtual_rig: Virtual = over(before.1, &self.virtual_rig)?;
        Ok((request.located(), virtual_rig.located()))
    }

    /// From which directions an adaptive measurement starts and how far it goes; what is not given is as it was `begun`. `None` if none is
    /// asked for.
    fn goal(
        &self,
        begun: Option<&Begun>,
        request: &Request,
    ) -> Result<Option<(Option<Grid>, Goal)>, Failure> {
        let is_given = self.directions.is_some() || self.request.contains_key("grid");
        let start = is_given.then(|| request.grid.clone());
        let start = start.or_else(|| begun.and_then(|begun| begun.start.clone()));
        let goal = match (&self.adaptive, begun) {
            (Some(far), _) => {
                let target = far.target_db.map(|db| db.to_string());
                Goal::new(target.as_deref(), far.budget).map_err(AdaptiveError::from)?
            }
            (None, Some(begun)) => begun.goal,
            (None, None) => return Ok(None),
        };
        Ok(Some((start, goal)))
    }

    /// The rig to measure with and what is known of it.
    fn setup(&self, command: &str) -> Result<(Rig, Setup), Failure> {
        let rig = Rig::load(&self.rig)?;
        let calibration = match &self.calibration {
            Some(dir) => Some(Calibration::open(dir, &rig)?),
            None => None,
        };
        let used = self.calibration.as_deref().zip(calibration.as_ref());
        let setup = Setup {
            session: Some(self.session.opening(command, used)?),
            calibration: calibration.clone(),
            ..Setup::default()
        };
        Ok((calibration.map_or(rig, |found| found.rig), setup))
    }
}

impl Asker {
    fn opening(&self, command: &str, calibration: Option<(&Path, &Calibration)>) -> Result<Opening, Failure> {
        let session = Session {
            began: self.began.clone(),
            command: command.to_owned(),
            program: concat!("rcg ", env!("CARGO_PKG_VERSION"), ", Python").to_owned(),
            host: self.host.clone(),
            ..Session::default()
        };
        let said = Said {
            operator: self.operator.clone(),
            notes: self.notes.clone(),
            ..Said::default()
        };
        let used = calibration.map(|(dir, found)| CalibrationUsed::read(dir, found.photometry.as_ref()));
        Ok(Opening {
            calibration: used.transpose()?,
            ..Opening::new(session, said)?
        })
    }
}

/// `before` with the keys that are `given` in place of its own.
fn over<T: Serialize + DeserializeOwned>(before: &T, given: &Map<String, Value>) -> Result<T, Failure> {
    let mut all = serde_json::to_value(before).expect("invariant: it was read from such text");
    for (key, value) in given {
        all[key] = value.clone();
        // One by one, so that a complaint has a name.
        if let Err(error) = T::deserialize(&all) {
            return Err(Failure::input(format!("{key}: {error}")));
        }
    }
    serde_json::from_value(all).map_err(Failure::input)
}

/// Measures, or goes on with a measurement; the summary as JSON.
#[pyfunction]
pub(crate) fn measure(py: Python<'_>, out: PathBuf, asked: &str, resume: bool) -> PyResult<String> {
    let asked = Asked::read(asked)?;
    long_work::run(py, |patience| {
        let (rig, setup) = asked.setup("measure")?;
        let before = if resume { adaptive::begun(&out)? } else { None };
        let before = before.as_ref();
        let (job, measurement) = if resume && Measurement::exists(&out) {
            resumed(&out, &asked, &rig, setup, before)?
        } else {
            if resume {
                Measurement::sweep(&out)?;
            }
            begun(&out, &asked, &rig, setup, before, resume, patience)?
        };
        let began = Instant::now();
        let summary = complete(&measurement, &job, &|| began.elapsed(), patience)?;
        Ok(json(&summary))
    })
}

/// The job of a measurement that begins, or of one that was begun adaptively `before` and has no plan yet.
fn begun(
    out: &Path,
    asked: &Asked,
    rig: &Rig,
    mut setup: Setup,
    before: Option<&Begun>,
    resume: bool,
    progress: &dyn Progress,
) -> Result<(Job, Measurement), Failure> {
    let usual = (Request::default(), Virtual::default());
    let base = before.map_or((&usual.0, &usual.1), |begun| (&begun.request, &begun.virtual_rig));
    let (request, virtual_rig) = asked.over(base)?;
    setup.virtual_rig = virtual_rig;
    let Some((start, goal)) = asked.goal(before, &request)? else {
        return Ok(rcg::measure::prepare(out, rig, request, &setup, progress)?);
    };
    let start = start.as_ref();
    let (job, measurement, _) = adaptive::measure(out, rig, &request, start, goal, &setup, resume, progress)?;
    Ok((job, measurement))
}

fn resumed(
    out: &Path,
    asked: &Asked,
    rig: &Rig,
    setup: Setup,
    before: Option<&Begun>,
) -> Result<(Job, Measurement), Failure> {
    let mut measurement = Measurement::open_to_write(out)?;
    measurement.check_rig(rig, setup.calibration.as_ref())?;
    let held = &measurement.plan;
    let (request, virtual_rig) = match (before, &asked.adaptive) {
        (Some(before), Some(_)) => {
            let (request, virtual_rig) = asked.over((&before.request, &before.virtual_rig))?;
            if let Some((start, goal)) = asked.goal(Some(before), &request)? {
                adaptive::check_same(out, before, start.as_ref(), goal)?;
            }
            let grid = held.request.grid.clone();
            (Request { grid, ..request }, virtual_rig)
        }
        (None, Some(_)) => {
            return Err(Failure::input(format!(
                "{}: expected a measurement that was begun with target_db or budget, found one of a {}",
                out.display(),
                held.request.grid
            )));
        }
        (_, None) => {
            let virtual_rig = held.virtual_rig.clone().unwrap_or_default();
            asked.over((&held.request, &virtual_rig))?
        }
    };
    measurement.check_same(&request, Some(&virtual_rig))?;
    let job = Job {
        session: setup.session,
        ..Job::of(&measurement, None)?
    };
    Ok((job, measurement))
}

/// What a measurement would take, as JSON.
#[pyfunction]
pub(crate) fn plan(py: Python<'_>, asked: &str) -> PyResult<String> {
    let asked = Asked::read(asked)?;
    long_work::run(py, |patience| {
        let (rig, mut setup) = asked.setup("plan")?;
        let (request, virtual_rig) = asked.over((&Request::default(), &Virtual::default()))?;
        setup.virtual_rig = virtual_rig;
        let job = Job::planned(&rig, request, &setup, patience)?;
        Ok(json(&Forecast::of(&job.plan, &job.rig)?))
    })
}
