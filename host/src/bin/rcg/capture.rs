//! `rcg capture`

use std::path::PathBuf;

use rcg::measurement::Measurement;

use crate::Done;
use crate::output::Output;
use crate::request::MischiefArgs;

/// Capture the frames of a planned measurement, or what is missing of them.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Directory of the measurement, as `rcg plan --out` made it
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    #[command(flatten)]
    mischief: MischiefArgs,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let measurement = Measurement::open(&args.dir)?;
    let tally = rcg::measure::capture(&measurement, args.mischief.mischief(), output)?;
    output.print(&tally, || {
        format!(
            "{} exposures paired; {} triggers missed, {} frames dropped, {} taken again\n",
            tally.paired, tally.missed_triggers, tally.dropped_frames, tally.repeated
        )
    })
}
