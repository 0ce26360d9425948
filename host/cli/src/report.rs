//! `rcg report`

use std::path::{Path, PathBuf};

use rcg::base::file_format::PAGE;
use rcg::base::progress::Progress as _;
use rcg::brdf::Source;
use rcg::capture::directory::Measurement;
use rcg::judge::evaluate::evaluate;
use rcg::measure::page::{Capture, Page};
use rcg::measure::report::evaluation_lines;
use rcg::plan::predicted_time::instrument_s;
use rcg::store::whole_file::write_whole;
use serde_json::json;

use crate::Done;
use crate::evaluate::reference;
use crate::failure::Failure;
use crate::output::{Output, table, to_write};

/// Write a page about a BRDF that one sends to a colleague: one file, with views to turn and to compare.
///
/// The page needs no network and no other file. A measurement has one already, its report.html; this makes one of any brdf.zarr, or
/// beside another reference, which may be a second measurement.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr, or the directory of a measurement that has one
    #[arg(value_name = "BRDF")]
    brdf: PathBuf,
    /// What it is compared with: a model such as ward:brass, a measured file, another measurement or its brdf.zarr
    #[arg(long, value_name = "SAMPLE")]
    reference: Option<String>,
    /// The page to write (HTML)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    to_write(&args.out, PAGE)?;
    let named = args.brdf.display().to_string();
    let Source::Measured(brdf) = Source::open(&named)? else {
        return Err(Failure::input(format!(
            "{named}: expected a brdf.zarr or the directory of a measurement, found another file"
        )));
    };
    let sample = args
        .reference
        .as_deref()
        .map(|spec| reference(spec, &brdf))
        .transpose()?;
    output.begin("evaluate", brdf.chunks(), "chunks");
    let against = args.reference.as_deref().zip(sample.as_deref());
    let evaluation = evaluate(&brdf, against, &|done| output.reach(done))?;
    output.end();
    let is_own = |dir: &Path| brdf.path() == dir.join("brdf.zarr") && Measurement::exists(dir);
    let measurement = if is_own(&args.brdf) {
        Some(Measurement::open(&args.brdf)?)
    } else {
        None
    };
    let title = measurement
        .as_ref()
        .and_then(|measurement| measurement.plan.sample());
    let page = Page {
        title: title.unwrap_or(&named),
        lines: evaluation_lines(&evaluation),
        evaluation: &evaluation,
        pictures: None,
        capture: measurement.as_ref().map(Capture::of).transpose()?,
        instrument_s: measurement
            .as_ref()
            .map(|measurement| instrument_s(&measurement.plan, &measurement.rig)),
    };
    let html = page.html(&brdf, sample.as_deref())?;
    write_whole(&args.out, html.as_bytes())?;
    let answer = json!({
        "out": args.out,
        "bytes": html.len(),
        "reference": args.reference,
        "warnings": evaluation.warnings,
    });
    output.print(&answer, || {
        table(&[
            ("written", args.out.display().to_string()),
            ("size", format!("{} bytes", html.len())),
        ])
    })?;
    output.warn(&evaluation.warnings);
    Ok(())
}
