//! `rcg paper`

use std::path::PathBuf;
use std::time::Instant;

use rcg::study::Settings;
use rcg::study::paper::paper;

use crate::Done;
use crate::output::Output;
use crate::request::image_size;

/// Make every figure of the RCG paper from our own data, with a page that puts each beside what the paper says.
///
/// Measures brass on the virtual rig rcg-1-16bit and two model cloths on rcg-2, runs the sampling study, draws all figures and
/// writes paper.html. Takes about two minutes and, with the defaults, 2 GB of disk.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// New or empty directory for page, figures and measurements
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Degrees between incident directions of the cloths' measurements; must divide 90
    #[arg(
        long,
        value_name = "DEG",
        default_value_t = 3.0,
        allow_negative_numbers = true
    )]
    step: f64,
    /// Camera images of the measurements: pixels a side
    #[arg(long, value_name = "N", default_value_t = 96, value_parser = image_size)]
    image_size: u32,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let began = Instant::now();
    let (settings, clock) = (Settings::default(), || began.elapsed());
    let made = paper(&args.out, args.step, args.image_size, &settings, &clock, output)?;
    output.print(&made, || format!("{}\n", made.page))
}
