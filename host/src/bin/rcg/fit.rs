//! `rcg fit`

use std::fmt::Write as _;
use std::path::PathBuf;

use rcg::file_format::CHART;
use rcg::fit::{Fit, Model};
use rcg::reflectance::Source;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, to_write};

/// Fit the parameters of a model, with their covariance.
///
/// `ax` and `ay` are the roughness along the sample's x and y, `rd` the diffuse reflectance, `rs` (Ward) or `f0` (GGX) the
/// strength of the lobe, per channel. Samples with θ up to 80° both ways take part, weighted by their uncertainty; the blur
/// of light and pixels is part of the model. Uncertainties are standard uncertainties (k = 1).
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr, a measured .bsdf file, or a model such as ggx:satin
    #[arg(value_name = "BRDF")]
    brdf: String,
    /// What to fit
    #[arg(long, value_enum)]
    model: Kind,
    /// Draw the residuals against the angle of the half vector (.svg, .png)
    #[arg(long, value_name = "FILE")]
    residuals: Option<PathBuf>,
}

/// Models on the command line.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Kind {
    /// Ward 1992, with elliptical lobe
    Ward,
    /// Anisotropic GGX with a Lambert base
    Ggx,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let model = match args.model {
        Kind::Ward => Model::Ward,
        Kind::Ggx => Model::Ggx,
    };
    if let Some(path) = &args.residuals {
        to_write(path, CHART)?;
    }
    let fit = match Source::open(&args.brdf)? {
        Source::Measured(brdf) => Fit::of_brdf(model, &brdf),
        Source::Known(sample) => Fit::of_sample(model, sample.as_ref()),
    }
    .map_err(|error| Failure::from(error).at(&args.brdf))?;
    if let Some(path) = &args.residuals {
        fit.save_residuals(&args.brdf, path)?;
    }
    output.print(&fit, || text(&fit))
}

fn text(fit: &Fit) -> String {
    let mut text = String::new();
    for parameter in &fit.parameters {
        let relative = 100.0 * parameter.standard_uncertainty / parameter.value.abs();
        writeln!(
            text,
            "{:<5} {:>9.5} ± {:.5} ({relative:.2} %, k = 1)",
            parameter.name, parameter.value, parameter.standard_uncertainty
        )
        .expect("strings take everything");
    }
    writeln!(
        text,
        "{} samples, χ² per degree of freedom {:.3}",
        fit.samples, fit.chi_squared_per_degree
    )
    .expect("strings take everything");
    text
}
