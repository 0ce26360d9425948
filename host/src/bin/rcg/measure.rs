//! `rcg measure`

use std::path::PathBuf;
use std::time::Instant;

use rcg::adaptive::{self, AdaptiveError, Goal};
use rcg::measure::{complete, prepare};
use rcg::measurement::Measurement;
use rcg::plan::Plan;
use rcg::report::lines;
use rcg::rig::Rig;

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

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    // The parser forgets that these need --adaptive where --step stands beside them, which excludes it.
    let of_adaptive = [
        ("--target", args.target.is_some()),
        ("--budget", args.budget.is_some()),
    ];
    if let Some((name, _)) = of_adaptive.iter().find(|(_, given)| *given && !args.adaptive) {
        return Err(Failure::input(format!(
            "{name}: expected --adaptive beside it, found none"
        )));
    }
    let mut setup = args.setup.setup()?;
    let rig = args.calibration.rig(Rig::load(rig)?, &mut setup)?;
    let measurement = if args.resume && Measurement::exists(&args.out) {
        let measurement = Measurement::open(&args.out)?;
        let request = args.request.request(Some(&measurement.plan.request))?;
        measurement.check_same(&request, &rig.name)?;
        measurement.check_calibration(setup.calibration.as_ref())?;
        measurement
    } else {
        if args.resume {
            Measurement::sweep(&args.out)?;
        }
        let before = match &args.replay {
            Some(path) => Some(Plan::of_rig(path, &rig)?.replayed()),
            None => None,
        };
        let request = args.request.request(before.as_ref())?;
        if args.adaptive {
            let goal = Goal::new(args.target.as_deref(), args.budget).map_err(AdaptiveError::from)?;
            adaptive::measure(&args.out, &rig, &request, goal, &setup, args.resume, output)?.0
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
