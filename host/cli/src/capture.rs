//! `rcg capture`

use std::path::PathBuf;

use rcg::capture::directory::Measurement;

use crate::Done;
use crate::output::Output;
use crate::request::SetupArgs;

/// Capture the frames of a planned measurement, or what is missing of them.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Directory of the measurement, as `rcg plan --out` made it
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    #[command(flatten)]
    setup: SetupArgs,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let setup = args.setup.setup()?;
    let measurement = Measurement::open_to_write(&args.dir)?;
    let tally = rcg::measure::capture(&measurement, &setup, output)?;
    output.print(&tally, || {
        format!(
            "{} exposures paired; {} triggers missed, {} frames dropped, {} taken again\n",
            tally.paired, tally.missed_triggers, tally.dropped_frames, tally.repeated
        )
    })
}
