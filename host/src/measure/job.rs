//! A measurement as it is to be done: what was asked for, every file read once and everything checked.

use std::path::Path;
use std::sync::Arc;

use crate::base::progress::Progress;
use crate::brdf::sample::{Sample, parse};
use crate::capture::Instrument;
use crate::capture::directory::{Measurement, MeasurementError};
use crate::capture::pilot::{auto_exposure_s, choose_light, choose_spot, propose};
use crate::capture::real;
use crate::capture::session::Opening;
use crate::instrument::calibration::Calibration;
use crate::instrument::monitor::watching;
use crate::instrument::rig::Rig;
use crate::measure::MeasureError;
use crate::plan::light::Light;
use crate::plan::{Plan, Request};
use crate::virtual_rig::setup::{Setup, SetupError, TriggerBox, World};

/// A known material that a result is compared with.
#[derive(Clone, Debug)]
pub struct Reference {
    /// How it was asked for.
    pub name: String,
    /// Itself.
    pub sample: Arc<dyn Sample>,
}

/// What is measured, with what, and what is known of it.
#[derive(Clone, Debug)]
pub struct Job {
    /// The rig as it is measured with: calibrated, its sample tilted, its camera image scaled.
    pub rig: Rig,
    /// The plan.
    pub plan: Plan,
    /// The virtual rig, with the sample that stands in it; `None` for a real instrument.
    pub world: Option<World>,
    /// What the result is compared with.
    pub reference: Option<Reference>,
    /// How the instrument really is, as far as calibration found out; it is written into a measurement that begins.
    pub calibration: Option<Calibration>,
    /// Who measures, when and with what; it is written into a measurement that begins, and into one that goes on when it captures.
    pub session: Option<Opening>,
}

impl Job {
    /// The job to measure `request` on `rig` (as loaded, its camera at full size; the calibration's if `setup` has one). A
    /// pilot capture finds the exposure times if `request` leaves them open.
    ///
    /// # Errors
    /// [`MeasureError`].
    pub fn new(
        rig: &Rig,
        request: Request,
        setup: &Setup,
        progress: &dyn Progress,
    ) -> Result<Self, MeasureError> {
        Self::like(rig, request, None, setup, progress)
    }

    /// As [`new`](Self::new), with the exposure times and segments of the plan `like` if there is one: a request in
    /// milliseconds does not have the times to the last bit, and noise is drawn by what is exposed in one run.
    ///
    /// # Errors
    /// [`MeasureError`].
    pub fn like(
        rig: &Rig,
        request: Request,
        like: Option<&Plan>,
        setup: &Setup,
        progress: &dyn Progress,
    ) -> Result<Self, MeasureError> {
        let given_s = like
            .map(Plan::exposures_s)
            .or_else(|| request.brackets.times_s())
            .or_else(|| request.exposure_s.map(|exposure_s| vec![exposure_s]));
        let any_s = given_s.clone().unwrap_or_else(|| vec![rig.camera.exposure_s]);
        let request = Request {
            // What a pilot capture chose stays.
            spot_deg: like
                .filter(|_| request.spot_auto)
                .map(|plan| plan.spot_deg)
                .or(request.spot_deg),
            ..request
        };
        let mut job = Self::with_times(rig, request, &any_s, setup, progress)?;
        match given_s {
            // What does not answer is named before anything is written.
            Some(_) if setup.trigger_box.is_some() => drop(job.open()?),
            Some(_) => {}
            None => job.find_times(progress)?,
        }
        if let Some(like) = like {
            job.plan.segment = like.segment;
        }
        Ok(job)
    }

    /// As [`new`](Self::new), with exposures of `exposures_s` seconds of each pattern, ascending; nothing is captured, but what
    /// chooses spot and light if that is asked for.
    ///
    /// # Errors
    /// [`MeasureError`].
    pub fn with_times(
        rig: &Rig,
        request: Request,
        exposures_s: &[f64],
        setup: &Setup,
        progress: &dyn Progress,
    ) -> Result<Self, MeasureError> {
        if let Some(calibration) = &setup.calibration {
            calibration.check_tilt(request.tilt).map_err(Box::new)?;
        }
        let world = if rig.is_real() { None } else { Some(setup.world()?) };
        if let Some(world) = &world {
            world.check_camera(rig)?;
        }
        let held = world.as_ref().map(|world| (&setup.virtual_rig.sample, world));
        let reference = reference(&request, held)?;
        let rig = request.rig(rig).map_err(MeasurementError::from)?;
        let chooses = request.spot_auto && request.spot_deg.is_none();
        let plan = Plan::bracketed(request, &rig, exposures_s).map_err(MeasurementError::from)?;
        let mut job = Self {
            plan: if world.is_some() {
                plan.on(setup.virtual_rig.clone())
            } else {
                plan
            },
            rig,
            world,
            reference,
            calibration: setup.calibration.clone(),
            session: setup.session.clone(),
        };
        job.watch();
        if chooses {
            job.find_spot(exposures_s, progress)?;
        }
        if job.plan.request.light == Light::Auto {
            job.find_light(progress)?;
        }
        Ok(job)
    }

    /// The job that shows what it would take to measure `request`: as [`new`](Self::new), but a single exposure that `request` leaves open has
    /// the rig's own time, and nothing is captured for it.
    ///
    /// # Errors
    /// [`MeasureError`].
    pub fn planned(
        rig: &Rig,
        request: Request,
        setup: &Setup,
        progress: &dyn Progress,
    ) -> Result<Self, MeasureError> {
        if !request.brackets.is_one() {
            return Self::new(rig, request, setup, progress);
        }
        let exposure_s = request.exposure_s.unwrap_or(rig.camera.exposure_s);
        Self::with_times(rig, request, &[exposure_s], setup, progress)
    }

    /// The rest of the job of a `measurement` that was begun, with the `trigger_box` that drives its virtual rig, or the
    /// simulated one.
    ///
    /// # Errors
    /// [`MeasureError`].
    pub fn of(measurement: &Measurement, trigger_box: Option<TriggerBox>) -> Result<Self, MeasureError> {
        let plan = measurement.plan.clone();
        let world = plan
            .virtual_rig
            .as_ref()
            .map(|spec| World::read(spec, trigger_box))
            .transpose()?;
        let sample = plan.virtual_rig.as_ref().map(|spec| &spec.sample);
        Ok(Self {
            reference: reference(&plan.request, sample.zip(world.as_ref()))?,
            rig: measurement.rig.clone(),
            plan,
            world,
            calibration: None,
            session: None,
        })
    }

    /// Begins to measure in the new directory `out`.
    ///
    /// # Errors
    /// [`MeasurementError`].
    pub fn begin(&self, out: &Path) -> Result<Measurement, MeasurementError> {
        let applied = self.calibration.as_ref().map(Calibration::applied);
        let (rig, plan) = (self.rig.clone(), self.plan.clone());
        Measurement::create_with(out, rig, plan, applied.as_ref(), self.session.as_ref())
    }

    /// The instrument.
    ///
    /// # Errors
    /// [`SetupError`].
    pub fn open(&self) -> Result<Instrument, SetupError> {
        let mut instrument = match &self.world {
            Some(world) => world.open(&self.rig, self.plan.request.tilt)?,
            None => real::open(&self.rig)?,
        };
        instrument.watching = watching(&self.rig, self.plan.watching_side);
        Ok(instrument)
    }

    /// Plans with the spot that a pilot capture chooses, and exposures of `exposures_s` seconds.
    fn find_spot(&mut self, exposures_s: &[f64], progress: &dyn Progress) -> Result<(), MeasureError> {
        progress.begin("pilot capture", 1, "runs");
        let mut instrument = self.open()?;
        let choice = choose_spot(&self.rig, &self.plan.request, &mut instrument, &|| {
            progress.reach(0);
        })?;
        progress.remark(&choice.to_string());
        progress.end();
        let request = Request {
            spot_deg: Some(choice.spot_deg),
            ..self.plan.request.clone()
        };
        self.plan_anew(request, exposures_s)
    }

    /// Plans with the light that a pilot capture chooses.
    fn find_light(&mut self, progress: &dyn Progress) -> Result<(), MeasureError> {
        progress.begin("pilot capture", 1, "runs");
        let mut instrument = self.open()?;
        let choice = choose_light(&self.rig, &self.plan.request, &mut instrument, &|| {
            progress.reach(0);
        })?;
        progress.remark(&choice.to_string());
        progress.end();
        self.plan.code = choice.code;
        Ok(())
    }

    /// Plans `request` with exposures of `exposures_s` seconds.
    fn plan_anew(&mut self, request: Request, exposures_s: &[f64]) -> Result<(), MeasureError> {
        let plan = Plan::bracketed(request, &self.rig, exposures_s).map_err(MeasurementError::from)?;
        self.plan = Plan {
            virtual_rig: self.plan.virtual_rig.take(),
            // What a pilot capture chose stays.
            code: plan.code.or(self.plan.code),
            ..plan
        };
        self.watch();
        Ok(())
    }

    /// Plans how much light watches the lamp.
    fn watch(&mut self) {
        let photometry = self
            .calibration
            .as_ref()
            .and_then(|found| found.photometry.as_ref());
        let longest_s = self.plan.exposures_s().into_iter().fold(0.0, f64::max);
        self.plan.watching_side =
            photometry.map_or(0, |found| found.lamp.side(longest_s, self.rig.range_dn()));
    }

    /// Plans with the exposure times that a pilot capture finds.
    fn find_times(&mut self, progress: &dyn Progress) -> Result<(), MeasureError> {
        progress.begin("pilot capture", 1, "runs");
        let mut instrument = self.open()?;
        let request = &self.plan.request;
        let exposures_s = if request.brackets.is_one() {
            vec![auto_exposure_s(
                &self.rig,
                request,
                self.plan.code,
                &mut instrument,
                &|| {
                    progress.reach(0);
                },
            )?]
        } else {
            let proposal = propose(&self.rig, request, self.plan.code, &mut instrument, &|| {
                progress.reach(0);
            })?;
            progress.remark(&proposal.to_string());
            proposal.exposures_s
        };
        progress.end();
        self.plan_anew(self.plan.request.clone(), &exposures_s)
    }
}

/// What the result of `request` is compared with: what is asked for, else what is known to stand in the virtual rig.
fn reference(request: &Request, held: Option<(&String, &World)>) -> Result<Option<Reference>, MeasureError> {
    let name = request.reference.as_ref().or(held.map(|(spec, _)| spec));
    name.map(|name| {
        let sample = match held {
            Some((spec, world)) if spec == name => world.sample.clone(),
            _ => Arc::from(parse(name)?),
        };
        Ok(Reference {
            name: name.clone(),
            sample,
        })
    })
    .transpose()
}
