//! `rcg info`

use rcg::brdf::Source;
use rcg::brdf::format::info::{ALIKE, Info, of};

use crate::Done;
use crate::output::{Output, table};

/// Say what a file of reflectance is: format, grid, range, gaps, symmetry, reciprocity, energy.
///
/// Symmetries are mean differences of luminance over its mean, at random pairs of directions with θ ≤ 70° both ways, half of them near
/// gloss: turned about the normal together (isotropic), mirrored at the plane of +x and the normal (bilateral), exchanged (reciprocal).
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr or the directory of a measurement, a measured file, or a model such as ward:brass
    #[arg(value_name = "BRDF")]
    brdf: String,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let source = Source::open(&args.brdf)?;
    let info = of(&args.brdf, &source)?;
    output.print(&info, || text(&info))?;
    output.warn(&info.warnings);
    Ok(())
}

fn text(info: &Info) -> String {
    let mut lines = vec![("format", info.format.clone())];
    lines.extend(
        info.facts
            .iter()
            .map(|(name, content)| (name.as_str(), content.clone())),
    );
    lines.push(match info.range {
        Some([least, median, most]) => (
            "f",
            format!("{least:.4e} to {most:.4e} /sr, median {median:.4e} (luminance, without the cosine)"),
        ),
        None => ("f", "no value".to_owned()),
    });
    lines.push((
        "values",
        format!(
            "{:.2} % missing, {:.2} % below 0, {:.2} % 0",
            100.0 * info.missing,
            100.0 * info.negative,
            100.0 * info.zero
        ),
    ));
    for (what, words, of) in [
        ("turned", "isotropic", info.turned),
        ("mirrored", "bilateral", info.mirrored),
        ("exchanged", "reciprocal", info.exchanged),
    ] {
        let told = of.map_or_else(
            || "nothing to compare".to_owned(),
            |of| {
                let not = if of <= ALIKE { "" } else { "not " };
                format!("differs by {:.3} % on the mean: {not}{words}", 100.0 * of)
            },
        );
        lines.push((what, told));
    }
    for (theta_deg, [r, g, b]) in &info.albedo {
        lines.push((
            "albedo",
            format!("{r:.4} {g:.4} {b:.4} for light at {theta_deg}° (φ = 0)"),
        ));
    }
    if info.albedo.is_empty() {
        lines.push(("albedo", "too much is missing".to_owned()));
    }
    table(&lines)
}
