//! `rcg measure`

use std::path::{Path, PathBuf};
use std::time::Instant;

use rcg::capture::directory::{Measurement, State};
use rcg::instrument::rig::Rig;
use rcg::measure::adaptive::{self, Begun};
use rcg::measure::report::{Summary, lines};
use rcg::measure::{Job, complete};
use rcg::plan::{Plan, Request, Virtual};
use rcg::virtual_rig::setup::Setup;

use crate::Done;
use crate::adaptive::AdaptiveArgs;
use crate::calibrate::first::calibrated;
use crate::failure::Failure;
use crate::output::{Output, table};
use crate::queue::{self, Next, QueueArgs};
use crate::request::{CalibrationArgs, PortArgs, RequestArgs, VirtualArgs};
use crate::session::SessionArgs;

/// Plan, capture, assemble, evaluate and report in one go.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Args {
    /// Directory of the measurement: new or empty, or with --resume one that was begun; with --queue the folder of all, perhaps a collection
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    queue: QueueArgs,
    #[command(flatten)]
    request: RequestArgs,
    /// Known material to compare the result with, as --sample takes it [default: what stands in the virtual rig]
    #[arg(long, value_name = "SAMPLE")]
    reference: Option<String>,
    #[command(flatten)]
    adaptive: AdaptiveArgs,
    /// Measure as this plan.toml says, directions and exposure time; it must be one of the same rig
    #[arg(long, value_name = "FILE", conflicts_with_all = ["grid", "step"])]
    replay: Option<PathBuf>,
    #[command(flatten)]
    calibration: CalibrationArgs,
    /// Go on with a measurement that was interrupted
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    virtual_rig: VirtualArgs,
    #[command(flatten)]
    port: PortArgs,
    #[command(flatten)]
    session: SessionArgs,
}

/// The job of the measurement that was begun, adaptively if there is a `begun`, which must be what is asked for.
fn resumed(
    args: &Args,
    rig: &Rig,
    setup: &Setup,
    begun: Option<&Begun>,
    replay: Option<&Plan>,
) -> Result<(Job, Measurement), Failure> {
    let mut measurement = Measurement::open_to_write(&args.out)?;
    measurement.check_rig(rig, setup.calibration.as_ref())?;
    let held = &measurement.plan;
    let (request, virtual_rig) = match (begun, args.adaptive.is_given()) {
        (Some(begun), true) => {
            let (start, goal) = args.adaptive.asked(&args.request, Some(begun))?;
            adaptive::check_same(&args.out, begun, start.as_ref(), goal)?;
            let (request, virtual_rig) = args.asked(Some(&begun.request), Some(&begun.virtual_rig))?;
            let grid = held.request.grid.clone();
            (Request { grid, ..request }, virtual_rig)
        }
        (None, true) => {
            return Err(Failure::input(format!(
                "{}: expected a measurement that was begun with --adaptive, found one of a {}",
                args.out.display(),
                held.request.grid
            )));
        }
        (_, false) => match replay {
            Some(plan) => args.asked(Some(&plan.replayed()), plan.virtual_rig.as_ref())?,
            None => args.asked(Some(&held.request), held.virtual_rig.as_ref())?,
        },
    };
    let virtual_rig = (!rig.is_real()).then_some(&virtual_rig);
    measurement.check_same(&request, virtual_rig)?;
    measurement.rig = measurement.rig.driven_as(rig);
    let job = Job {
        session: setup.session.clone(),
        ..Job::of(&measurement, setup.trigger_box.clone())?
    };
    Ok((job, measurement))
}

/// The job of a measurement that begins, or of one that was `begun` adaptively and has no plan yet.
fn begin(
    args: &Args,
    rig: &Rig,
    mut setup: Setup,
    begun: Option<&Begun>,
    replay: Option<&Plan>,
    output: &Output,
) -> Result<(Job, Measurement), Failure> {
    if args.adaptive.is_given() || begun.is_some() {
        let (start, goal) = args.adaptive.asked(&args.request, begun)?;
        let (request, virtual_rig) = args.asked(
            begun.map(|begun| &begun.request),
            begun.map(|begun| &begun.virtual_rig),
        )?;
        setup.virtual_rig = virtual_rig;
        let (out, start) = (&args.out, start.as_ref());
        let (job, measurement, _) =
            adaptive::measure(out, rig, &request, start, goal, &setup, args.resume, output)?;
        return Ok((job, measurement));
    }
    Measurement::check_new(&args.out)?;
    let before = replay.map(Plan::replayed);
    let (request, virtual_rig) =
        args.asked(before.as_ref(), replay.and_then(|plan| plan.virtual_rig.as_ref()))?;
    setup.virtual_rig = virtual_rig;
    let like = replay.zip(before).and_then(|(plan, before)| {
        let times = |request: &Request| (request.exposure_s, request.brackets.clone());
        let is_same = times(&request) == times(&before) && request.image_size == before.image_size;
        is_same.then_some(plan)
    });
    let job = Job::like(rig, request, like, &setup, output)?;
    if rig.is_real() {
        // What does not answer is named before anything is written.
        drop(job.open()?);
    }
    let measurement = job.begin(&args.out)?;
    Ok((job, measurement))
}

/// A measurement that is done.
pub(crate) struct Measured {
    measurement: Measurement,
    summary: Summary,
    calibration: Option<String>,
}

/// Whether nothing is left to do of a measurement.
fn is_reported(measurement: &Measurement) -> bool {
    measurement.noted("state") == Some(State::Reported)
}

/// Whether a measurement that is finished already is done again from its frames on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Finished {
    Again,
    Kept,
}

/// Measures; nothing if the measurement that goes on is one that is `finished` and kept.
pub(crate) fn measured(
    args: &Args,
    named: &str,
    finished: Finished,
    output: &Output,
) -> Result<Option<Measured>, Failure> {
    let is_adaptive = args.adaptive.check(&args.request)?;
    if is_adaptive && args.replay.is_some() {
        return Err(Failure::input(
            "--adaptive: expected no --replay, which measures the directions of a plan and no others, found one (--grid \
             with the list of directions lets an adaptive measurement start from them)",
        ));
    }
    let rig = args.port.real(Rig::load(named)?)?;
    args.virtual_rig.check(&rig)?;
    let trigger_box = args.port.trigger_box(&rig)?;
    let replay = args
        .replay
        .as_ref()
        .map(|path| Plan::of_rig(path, &rig))
        .transpose()?;
    let begun = if args.resume {
        adaptive::begun(&args.out)?
    } else {
        None
    };
    let goes_on = args.resume && Measurement::exists(&args.out);
    if args.resume && !goes_on {
        Measurement::sweep(&args.out)?;
    }
    let first = if goes_on || rig.is_real() || !args.calibration.is_open() {
        // What goes on has its calibration.
        None
    } else {
        args.calibrated_first(named, &rig, begun.as_ref(), replay.as_ref(), output)?
    };
    let known = args.calibration.or(first);
    let (rig, calibration) = known.rig(rig)?;
    let used = known.dir().zip(calibration.as_ref());
    let setup = Setup {
        trigger_box,
        session: Some(args.session.opening("measure", used)?),
        calibration,
        ..Setup::default()
    };
    let (job, measurement) = if goes_on {
        resumed(args, &rig, &setup, begun.as_ref(), replay.as_ref())?
    } else {
        begin(args, &rig, setup, begun.as_ref(), replay.as_ref(), output)?
    };
    if goes_on && finished == Finished::Kept && is_reported(&measurement) {
        return Ok(None);
    }
    output.log_into(measurement.dir());
    let began = Instant::now();
    let summary = complete(&measurement, &job, &|| began.elapsed(), output)?;
    Ok(Some(Measured {
        measurement,
        summary,
        calibration: known.dir().map(|dir| dir.display().to_string()),
    }))
}

pub(crate) fn run(args: &Args, named: &str, output: &Output) -> Done {
    if let Some(file) = args.queue.file() {
        return queue::run(args, file, named, output);
    }
    args.queue.check()?;
    let done = measured(args, named, Finished::Again, output)?;
    let done = done.expect("invariant: nothing is kept as it is");
    let answer = Answer {
        summary: &done.summary,
        calibration: done.calibration.as_deref(),
    };
    output.print(&answer, || {
        let mut lines = lines(&done.summary);
        lines.extend(done.calibration.clone().map(|dir| ("calibration", dir)));
        let report = done.measurement.path("report.html");
        lines.push(("report", report.display().to_string()));
        table(&lines)
    })?;
    output.warn(&done.summary.evaluation.warnings);
    output.log("done");
    Ok(())
}

impl Measured {
    /// What cannot be stated of it, in sentences.
    pub(crate) fn warnings(&self) -> &[String] {
        &self.summary.evaluation.warnings
    }
}

/// What came of it.
#[derive(serde::Serialize)]
struct Answer<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    /// The directory of the calibration that was taken into account.
    calibration: Option<&'a str>,
}

impl Args {
    /// The folder of all measurements of a queue.
    pub(crate) fn folder(&self) -> &Path {
        &self.out
    }

    /// Whether no sample of a queue is asked for.
    pub(crate) const fn asks_nothing(&self) -> bool {
        self.queue.asks_nothing()
    }

    /// Whether what is to be measured is finished already.
    pub(crate) fn is_finished(&self) -> bool {
        Measurement::open(&self.out).is_ok_and(|found| is_reported(&found))
    }

    /// These for the sample `next` of a queue, into the directory `out`.
    pub(crate) fn of(&self, next: &Next, out: &Path) -> Self {
        let mut one = self.clone();
        out.clone_into(&mut one.out);
        one.queue = QueueArgs::default();
        one.resume = Measurement::exists(out) || out.is_dir();
        one.request
            .name(next.sample_name.as_ref(), next.sample_description.as_ref());
        one.virtual_rig.hold(next.sample.as_ref());
        one.replay = next.plan.clone().or(one.replay);
        one
    }

    /// The directory of a calibration of the virtual `rig`, which `named` is the argument of; what cannot be measured with it is refused
    /// before that. `None` for one that is as its file says: nothing of it is to be found.
    fn calibrated_first(
        &self,
        named: &str,
        rig: &Rig,
        begun: Option<&Begun>,
        replay: Option<&Plan>,
        output: &Output,
    ) -> Result<Option<PathBuf>, Failure> {
        if begun.is_none() {
            Measurement::check_new(&self.out)?;
        }
        let before = begun
            .map(|begun| begun.request.clone())
            .or(replay.map(Plan::replayed));
        let virtual_rig = begun
            .map(|begun| &begun.virtual_rig)
            .or(replay.and_then(|plan| plan.virtual_rig.as_ref()));
        let (request, virtual_rig) = self.asked(before.as_ref(), virtual_rig)?;
        if virtual_rig.truth.is_none() {
            return Ok(None);
        }
        Setup::from(virtual_rig.clone()).world()?.check_camera(rig)?;
        request.rig(rig)?;
        calibrated(named, rig, &virtual_rig, request.tilt, output).map(Some)
    }

    /// What is asked for, with what there was before in place of the defaults.
    fn asked(
        &self,
        request: Option<&Request>,
        virtual_rig: Option<&Virtual>,
    ) -> Result<(Request, Virtual), Failure> {
        let mut asked = self.request.request(request)?;
        if self.reference.is_some() {
            asked.reference.clone_from(&self.reference);
        }
        Ok((asked.located(), self.virtual_rig.virtual_rig(virtual_rig)))
    }
}
