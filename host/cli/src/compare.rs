//! `rcg compare`

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use rcg::base::file_format::CHART_OR_TABLE;
use rcg::brdf::{Brdf, Source};
use rcg::judge::compare::{Agreement, Compared, compare};
use serde_json::json;

use crate::Done;
use crate::output::{Output, table, to_write};

/// Compare a measurement with another, with a measured file, or with a model, by their uncertainties.
///
/// By regions of the polar angles and of the azimuth between light and view: by how much the second is brighter, the standard
/// uncertainty of that (noise counts as each value's own, everything else as common to the region), and E_n, the bias over
/// its expanded uncertainty (k = 2): above 1 the uncertainties do not explain the difference. The first is looked up at
/// the directions of the second; both may be of other rigs and grids.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr, a measured .bsdf file, or a model such as ward:brass, which counts as exact
    #[arg(value_name = "A")]
    a: String,
    /// A brdf.zarr of the same sample
    #[arg(value_name = "B")]
    b: PathBuf,
    /// Both were measured by the same standard, as files with the same certificate say by themselves: what is wrong with it cancels, and
    /// is no excuse for a difference
    #[arg(long)]
    same_standard: bool,
    /// Also write a chart of the biases (.svg, .pdf, .png) or the table (.csv)
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    if let Some(out) = &args.out {
        to_write(out, CHART_OR_TABLE)?;
    }
    let a = Source::open(&args.a)?;
    let b = Brdf::open(&args.b)?;
    let compared = compare(&a, &b, args.same_standard)?;
    if let Some(out) = &args.out {
        compared.save(&title(&args.a, &args.b), out)?;
    }
    let value = json!({ "a": args.a, "b": args.b, "compared": compared, "out": args.out });
    output.print(&value, || text(&compared))?;
    output.warn(&compared.warnings);
    Ok(())
}

fn title(a: &str, b: &Path) -> String {
    format!("{} over {a}", b.display())
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "none".to_owned(), |share| format!("{:.2} %", 100.0 * share))
}

fn bias(one: &Agreement) -> String {
    let e_n = one
        .e_n
        .map_or_else(|| "none".to_owned(), |e_n| format!("{e_n:.2}"));
    format!(
        "{} ± {} (k = 1), E_n {e_n}",
        percent(one.relative_bias),
        percent(one.standard_uncertainty)
    )
}

fn text(compared: &Compared) -> String {
    let names: Vec<String> = (0..compared.overall.len())
        .map(|channel| compared.bias_of(channel))
        .collect();
    let mut lines: Vec<(&str, String)> = vec![(
        "pairs",
        format!(
            "{} with θ ≤ 80° measured in both, {} of those that were looked up",
            compared.pairs,
            percent(compared.share)
        ),
    )];
    lines.extend(
        names
            .iter()
            .map(String::as_str)
            .zip(compared.overall.iter().map(bias)),
    );
    lines.push((
        "scatter",
        compared.normalised_scatter.map_or_else(
            || "none".to_owned(),
            |scatter| {
                format!("{scatter:.2} of the stated uncertainty of single differences, beside the biases")
            },
        ),
    ));
    if compared.shares_standard {
        lines.push((
            "standard",
            "the same in both: what is wrong with it cancels".to_owned(),
        ));
    }
    lines.push((
        "regions",
        format!(
            "{} of {} regions and channels with E_n ≤ 1",
            compared.agreeing, compared.judged
        ),
    ));
    let mut text = table(&lines);
    text.push_str("\nregion                         bias ± u (k = 1), percent      E_n (largest)  scatter\n");
    for region in &compared.regions {
        let worst = region.channels.iter().filter_map(|one| one.e_n).reduce(f64::max);
        let biases: Vec<String> = region
            .channels
            .iter()
            .map(|one| {
                one.relative_bias
                    .map_or_else(|| "none".to_owned(), |bias| format!("{:+.2}", 100.0 * bias))
            })
            .collect();
        let largest = |of: &dyn Fn(&Agreement) -> Option<f64>| {
            percent(region.channels.iter().filter_map(of).reduce(f64::max))
        };
        writeln!(
            text,
            "{:30} {:>20} ± {:8} {:>12}  {}",
            region.region.name(),
            biases.join(" "),
            largest(&|one| one.standard_uncertainty),
            worst.map_or_else(|| "none".to_owned(), |e_n| format!("{e_n:.2}")),
            largest(&|one| one.relative_scatter)
        )
        .expect("strings take everything");
    }
    text
}
