//! `rcg assemble`

use std::path::PathBuf;

use rcg::measurement::Measurement;

use crate::Done;
use crate::output::Output;

/// Turn the captured frames of a measurement into brdf.zarr.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Directory of the measurement
    #[arg(value_name = "DIR")]
    dir: PathBuf,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let measurement = Measurement::open_to_write(&args.dir)?;
    let assembled = rcg::measure::assemble_measurement(&measurement, output)?;
    output.print(&assembled, || {
        format!(
            "{} incident directions, {} samples measured, {} saturated, dynamic range {:.0} : 1: {}\n",
            assembled.directions,
            assembled.measured,
            assembled.saturated,
            assembled.dynamic_range,
            measurement.path("brdf.zarr").display()
        )
    })
}
