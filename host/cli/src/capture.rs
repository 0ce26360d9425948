//! `rcg capture`

use std::path::PathBuf;

use rcg::capture::directory::Measurement;
use rcg::measure::Job;

use crate::Done;
use crate::failure::Failure;
use crate::output::Output;
use crate::request::{FaultArgs, PortArgs};
use crate::session::SessionArgs;

/// Capture the frames of a planned measurement, or what is missing of them.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Directory of the measurement, as `rcg plan --out` made it
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    #[command(flatten)]
    faults: FaultArgs,
    #[command(flatten)]
    port: PortArgs,
    #[command(flatten)]
    session: SessionArgs,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let session = args.session.opening("capture", None)?;
    let mut measurement = Measurement::open_to_write(&args.dir)?;
    output.log_into(measurement.dir());
    measurement.rig = args.port.real(measurement.rig)?;
    let trigger_box = args.port.trigger_box(&measurement.rig)?;
    if let Some(option) = args
        .faults
        .given()
        .filter(|_| measurement.plan.virtual_rig.is_none())
    {
        return Err(Failure::input(format!(
            "{option}: expected nothing of the virtual rig in a measurement by a real instrument"
        )));
    }
    if let Some(virtual_rig) = &mut measurement.plan.virtual_rig {
        virtual_rig.faults = args.faults.faults(virtual_rig.faults);
    }
    let job = Job {
        session: Some(session),
        ..Job::of(&measurement, trigger_box)?
    };
    let tally = rcg::measure::capture(&measurement, &job, output)?;
    output.print(&tally, || {
        format!(
            "{} exposures paired; {} triggers missed, {} frames dropped, {} taken again\n",
            tally.paired, tally.missed_triggers, tally.dropped_frames, tally.repeated
        )
    })
}
