//! `rcg evaluate`

use std::path::PathBuf;

use rcg::brdf::Brdf;
use rcg::evaluate::{Evaluation, Repeatability, evaluate, repeatability};
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
    /// Another capture of the same sample with the same directions, for the repeatability
    #[arg(long, value_name = "BRDF")]
    repeat: Option<PathBuf>,
}

/// What others state, for comparison.
const PUBLISHED: &str = "NIST five-axis goniospectrometer 0.5 % (k = 2), KRISS below 3 % (k = 2), a coaxial \
                         projector-camera scanner within 5.5 %; reciprocity of published diffuse files 1.4-1.7 %";

/// What is printed.
#[derive(serde::Serialize)]
struct Answer {
    #[serde(flatten)]
    evaluation: Evaluation,
    #[serde(skip_serializing_if = "Option::is_none")]
    repeatability: Option<Repeatability>,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let brdf = Brdf::open(&args.brdf)?;
    let sample = args.reference.as_deref().map(rcg::sample::parse).transpose()?;
    let reference = args.reference.as_deref().zip(sample.as_deref());
    output.begin("evaluate", brdf.chunks(), "chunks");
    let evaluation = evaluate(&brdf, reference, &|done| output.reach(done))?;
    output.end();
    let repeatability = match &args.repeat {
        Some(path) => Some(repeatability(&brdf, &Brdf::open(path)?)?),
        None => None,
    };
    let answer = Answer {
        evaluation,
        repeatability,
    };
    output.print(&answer, || {
        let mut lines = rcg::report::evaluation_lines(&answer.evaluation);
        if let Some(found) = &answer.repeatability {
            lines.push((
                "repeatability",
                format!(
                    "{:.2} % standard deviation (median), {:.2} of the stated uncertainty",
                    100.0 * found.relative_standard_deviation,
                    found.normalised_difference
                ),
            ));
        }
        lines.push(("others state", PUBLISHED.to_owned()));
        table(&lines)
    })
}
