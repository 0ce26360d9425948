//! `rcg measure`

use std::path::PathBuf;
use std::time::Instant;

use rcg::measure::{complete, prepare};
use rcg::measurement::Measurement;
use rcg::report::lines;
use rcg::rig::Rig;

use crate::Done;
use crate::output::{Output, table};
use crate::request::{RequestArgs, SetupArgs};

/// Plan, capture, assemble, evaluate and report in one go.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Directory of the measurement: new or empty, or with --resume one that was begun
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    request: RequestArgs,
    /// Go on with a measurement that was interrupted
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    setup: SetupArgs,
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let setup = args.setup.setup()?;
    let rig = Rig::load(rig)?;
    let measurement = if args.resume && Measurement::exists(&args.out) {
        let measurement = Measurement::open(&args.out)?;
        let request = args.request.request(Some(&measurement.plan.request))?;
        measurement.check_same(&request, &rig.name)?;
        measurement
    } else {
        if args.resume {
            Measurement::sweep(&args.out)?;
        }
        prepare(&args.out, &rig, args.request.request(None)?, &setup, output)?
    };
    let began = Instant::now();
    let summary = complete(&measurement, &setup, &|| began.elapsed(), output)?;
    output.print(&summary, || {
        let mut lines = lines(&summary);
        lines.push(("report", measurement.path("report.html").display().to_string()));
        table(&lines)
    })
}
