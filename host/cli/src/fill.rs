//! `rcg fill`

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use rcg::assemble::fill::{Filled, Options, Way, fill};
use rcg::capture::directory::Measurement;

use crate::Done;
use crate::output::Output;

/// Fill what a capture does not reach: from captures at other tilts, from reciprocity, from neighbours, from a model.
///
/// Further captures are of the same sample, tilted otherwise in the mirror (`rcg measure --tilt`), with the same image size;
/// their scale and what their tilts were not quite are found in the
/// overlap. Where their incident directions differ (adaptive ones, lists), the result has all of them, as a list. What is left comes from the exchanged pair of directions, across the wire from both its sides, and from a fitted
/// GGX with a Lambert base. Every value says where it comes from.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr or the directory of a measurement, then those of further captures
    #[arg(value_name = "BRDF", required = true)]
    brdfs: Vec<PathBuf>,
    /// The brdf.zarr to write
    #[arg(long, value_name = "OUT")]
    out: PathBuf,
    /// Leave out ways to fill; without all of them captures are merged and nothing else
    #[arg(long, value_name = "WAY,...", value_enum, value_delimiter = ',')]
    without: Vec<Kind>,
    /// Bring further captures to the brightness of the first, however far they are from it; else they are refused where that is more than the
    /// uncertainty that both state as common to all values
    #[arg(long)]
    any_scale: bool,
}

/// Ways to fill on the command line.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Kind {
    /// The exchanged pair of directions
    Reciprocity,
    /// From both sides of the wire
    Wire,
    /// A fitted GGX with a Lambert base
    Model,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let mut paths = args.brdfs.iter().map(|path| brdf_of(path));
    let first = paths.next().expect("invariant: at least one is required");
    let way = |kind: &Kind| match kind {
        Kind::Reciprocity => Way::Reciprocity,
        Kind::Wire => Way::Wire,
        Kind::Model => Way::Model,
    };
    let options = Options {
        without: args.without.iter().map(way).collect(),
        is_any_scale: args.any_scale,
    };
    let filled = fill(&first, &paths.collect::<Vec<_>>(), &args.out, &options, output)?;
    output.print(&filled, || text(&filled))?;
    output.warn(&filled.warnings);
    Ok(())
}

/// The brdf.zarr at `path`, or that of the measurement there.
pub(crate) fn brdf_of(path: &Path) -> PathBuf {
    if Measurement::exists(path) {
        path.join("brdf.zarr")
    } else {
        path.to_owned()
    }
}

fn text(filled: &Filled) -> String {
    let mut text = String::new();
    for one in &filled.alignments {
        let [x, y, z] = one.turn_deg;
        let [ux, uy, uz] = one.turn_uncertainty_deg;
        writeln!(
            text,
            "{}: scale {:.4} ± {:.4}, turned by {x:.3} ± {ux:.3}°, {y:.3} ± {uy:.3}°, {z:.3} ± {uz:.3}° about x, y, z \
             (k = 1; {} common pairs)",
            one.path, one.scale, one.scale_uncertainty, one.overlap
        )
        .expect("strings take everything");
    }
    if let Some(model) = &filled.model {
        let parameters: Vec<String> = model
            .parameters
            .iter()
            .map(|p| match p.standard_uncertainty {
                Some(sigma) => format!("{} {:.4} ± {sigma:.4}", p.name, p.value),
                None => format!("{} {:.4}", p.name, p.value),
            })
            .collect();
        let verdict = if model.acceptable {
            ""
        } else {
            "; it is not acceptable"
        };
        writeln!(text, "model: ggx, {}{verdict}", parameters.join(", ")).expect("strings take everything");
    }
    let none = if filled.shares.is_empty() { " none" } else { "" };
    writeln!(text, "pairs of directions with θ ≤ 85°:{none}").expect("strings take everything");
    for share in filled.shares.iter().filter(|share| share.share > 0.0) {
        writeln!(text, "{:<14} {:6.2} %", share.provenance, 100.0 * share.share)
            .expect("strings take everything");
    }
    text
}
