//! `rcg measure`

use std::path::PathBuf;
use std::time::Instant;

use rcg::adaptive::{self, AdaptiveError, Goal};
use rcg::measure::{complete, prepare};
use rcg::measurement::Measurement;
use rcg::plan::{Plan, Request};
use rcg::report::lines;
use rcg::rig::Rig;
use rcg::setup::Setup;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table};
use crate::request::{CalibrationArgs, RequestArgs, SetupArgs};

/// Plan, capture, assemble, evaluate and report in one go.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Directory of the measurement: new or empty, or with --resume one that was begun
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    request: RequestArgs,
    /// Choose the incident directions on the way, where the predicted error is largest, until --target or --budget
    #[arg(long, conflicts_with_all = ["grid", "step", "replay", "brackets", "calibration"])]
    adaptive: bool,
    /// With --adaptive: stop at this predicted PSNR of f·cosθi at exposure 1, clipped to 1
    #[arg(long, value_name = "dB", requires = "adaptive", allow_hyphen_values = true)]
    target: Option<String>,
    /// With --adaptive: stop after so many captures with light
    #[arg(long, value_name = "N", requires = "adaptive")]
    budget: Option<usize>,
    /// Measure as this plan.toml says, directions and exposure time; it must be one of the same rig
    #[arg(long, value_name = "FILE", conflicts_with_all = ["grid", "step"])]
    replay: Option<PathBuf>,
    #[command(flatten)]
    calibration: CalibrationArgs,
    /// Go on with a measurement that was interrupted
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    setup: SetupArgs,
}

impl Args {
    fn goal(&self) -> Result<Goal, Failure> {
        Ok(Goal::new(self.target.as_deref(), self.budget).map_err(AdaptiveError::from)?)
    }

    /// What `--replay` asks for.
    fn replayed(&self, rig: &Rig) -> Result<Option<Request>, Failure> {
        let plan = self.replay.as_deref().map(|path| Plan::of_rig(path, rig));
        Ok(plan.transpose()?.map(Plan::replayed))
    }
}

/// The measurement that was begun, which must be what is asked for.
fn resumed(args: &Args, rig: &Rig, setup: &Setup) -> Result<Measurement, Failure> {
    let mut measurement = Measurement::open_to_write(&args.out)?;
    measurement.check_rig(rig, setup.calibration.as_ref())?;
    let before = args.replayed(rig)?;
    let held = measurement.plan.request.clone();
    measurement.check_same(&args.request.request(Some(before.as_ref().unwrap_or(&held)))?)?;
    if args.adaptive {
        measurement.check_goal(args.goal()?)?;
    }
    Ok(measurement)
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let mut setup = args.setup.setup()?;
    let rig = args.calibration.rig(Rig::load(rig)?, &mut setup)?;
    let measurement = if args.resume && Measurement::exists(&args.out) {
        resumed(args, &rig, &setup)?
    } else {
        if args.resume {
            Measurement::sweep(&args.out)?;
        }
        let request = args.request.request(args.replayed(&rig)?.as_ref())?;
        if args.adaptive {
            adaptive::measure(
                &args.out,
                &rig,
                &request,
                args.goal()?,
                &setup,
                args.resume,
                output,
            )?
            .0
        } else {
            prepare(&args.out, &rig, request, &setup, output)?
        }
    };
    let began = Instant::now();
    let summary = complete(&measurement, &setup, &|| began.elapsed(), output)?;
    output.print(&summary, || {
        let mut lines = lines(&summary);
        lines.push(("report", measurement.path("report.html").display().to_string()));
        table(&lines)
    })
}
