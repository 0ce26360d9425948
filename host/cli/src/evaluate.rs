//! `rcg evaluate`

use std::path::PathBuf;

use rcg::base::progress::Progress as _;
use rcg::brdf::Source;
use rcg::brdf::sample::Sample;
use rcg::brdf::{Brdf, KnownBrdf};
use rcg::judge::evaluate::{Evaluation, Repeatability, evaluate, repeatability};
use rcg::measure::budget_text;
use rcg::measure::report::PUBLISHED;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table};

/// Judge a BRDF by itself and against a known sample.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr
    #[arg(value_name = "BRDF")]
    brdf: PathBuf,
    /// What it should be: a model such as ward:brass, a measured .bsdf file, or another brdf.zarr
    #[arg(long, value_name = "SAMPLE")]
    reference: Option<String>,
    /// Another capture of the same sample with the same directions, for the repeatability
    #[arg(long, value_name = "BRDF")]
    repeat: Option<PathBuf>,
    /// Show which cause makes how much of the uncertainty, by regions of directions
    #[arg(long)]
    budget: bool,
}

/// What others state, for comparison.
fn published() -> String {
    let stated = PUBLISHED.map(|(who, uncertainty)| format!("{who} {uncertainty}"));
    stated.join(", ") + "; reciprocity of published diffuse files 1.4-1.7 %"
}

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
    let sample = args
        .reference
        .as_deref()
        .map(|spec| reference(spec, &brdf))
        .transpose()?;
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
        let mut lines = rcg::measure::report::evaluation_lines(&answer.evaluation);
        if let Some(found) = &answer.repeatability {
            let figure = |figure: Option<String>| figure.unwrap_or_else(|| "none".to_owned());
            let percent = |share: Option<f64>| figure(share.map(|share| format!("{:.2} %", 100.0 * share)));
            lines.push((
                "repeatability",
                format!(
                    "the second is brighter by {} ± {} (k = 1); beside that {} standard deviation (median); differences are {} of the stated \
                     uncertainty; from {} of the pairs",
                    percent(found.relative_bias),
                    percent(found.relative_bias_uncertainty),
                    percent(found.relative_standard_deviation),
                    figure(found.normalised_difference.map(|share| format!("{share:.2}"))),
                    percent(found.share)
                ),
            ));
        }
        lines.push(("others state", published()));
        let mut text = table(&lines);
        if args.budget {
            text.push_str(&budget_text(&answer.evaluation.budget));
        }
        text
    })?;
    output.warn(&answer.evaluation.warnings);
    if let Some(found) = &answer.repeatability {
        output.warn(&found.warnings);
    }
    Ok(())
}

/// What `brdf` is compared with: a known sample, or another measurement of it.
pub(crate) fn reference(spec: &str, brdf: &Brdf) -> Result<Box<dyn Sample>, Failure> {
    Ok(match Source::open(spec)? {
        Source::Known(sample) => sample,
        Source::Measured(other) => Box::new(KnownBrdf::beside(&other, brdf)?),
    })
}
