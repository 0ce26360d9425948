//! `rcg assemble`

use std::path::PathBuf;

use rcg::capture::directory::Measurement;
use rcg::measure::report::dynamic_range;

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
            "{} incident directions, {} samples measured, {} saturated, dynamic range {}: {}\n",
            assembled.directions,
            assembled.measured,
            assembled.saturated,
            dynamic_range(assembled.dynamic_range),
            measurement.path("brdf.zarr").display()
        )
    })?;
    if assembled.measured == 0 {
        output.warn(&["nothing was measured: no sample has a value".to_owned()]);
    }
    Ok(())
}
