//! `rcg evaluate`

use std::path::PathBuf;

use rcg::brdf::Brdf;
use rcg::evaluate::evaluate;
use rcg::progress::Progress as _;

use crate::Done;
use crate::output::{Output, table};

/// Judge a BRDF by itself and against a known sample.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr
    #[arg(value_name = "BRDF")]
    brdf: PathBuf,
    /// What it should be: a model such as ward:brass, or a measured .bsdf file
    #[arg(long, value_name = "SAMPLE")]
    reference: Option<String>,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let brdf = Brdf::open(&args.brdf)?;
    let sample = args.reference.as_deref().map(rcg::sample::parse).transpose()?;
    let reference = args.reference.as_deref().zip(sample.as_deref());
    output.begin("evaluate", brdf.chunks(), "chunks");
    let evaluation = evaluate(&brdf, reference, &|done| output.reach(done))?;
    output.end();
    output.print(&evaluation, || table(&rcg::report::evaluation_lines(&evaluation)))
}
