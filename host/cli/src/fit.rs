//! `rcg fit`

use std::fmt::Write as _;
use std::path::PathBuf;

use rcg::base::file_format::CHART;
use rcg::brdf::Source;
use rcg::judge::fit::{AZIMUTH, Fit, Model};

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, to_write};

/// Fit the parameters of a model, with their covariance.
///
/// `ax` and `ay` are the roughness along the axes of the lobe, `azimuth_deg` the azimuth of the first (-45 to 45; none of a lobe that is as wide
/// both ways), `rd` the diffuse reflectance, `rs` (Ward) or `f0` (GGX) the strength of the lobe, per channel. Samples with θ up to 80° both ways take part, weighted by their uncertainty; the blur
/// of light and pixels is part of the model. Uncertainties are standard uncertainties (k = 1); a fit whose residuals
/// refute the model, that has not converged or that left what is physical has none, and says so.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr, a measured .bsdf file, or a model such as ggx:satin
    #[arg(value_name = "BRDF")]
    brdf: String,
    /// What to fit
    #[arg(long, value_enum)]
    model: Kind,
    /// Draw the residuals against the angle of the half vector (.svg, .pdf, .png)
    #[arg(long, value_name = "FILE")]
    residuals: Option<PathBuf>,
}

/// Models on the command line.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum Kind {
    /// Ward 1992, with elliptical lobe
    Ward,
    /// Anisotropic GGX with a Lambert base
    Ggx,
}

impl From<Kind> for Model {
    fn from(kind: Kind) -> Self {
        match kind {
            Kind::Ward => Self::Ward,
            Kind::Ggx => Self::Ggx,
        }
    }
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let model = Model::from(args.model);
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
    output.print(&fit, || text(&fit))?;
    output.warn(&fit.warnings);
    Ok(())
}

fn text(fit: &Fit) -> String {
    let mut text = String::new();
    for parameter in &fit.parameters {
        let uncertainty = match parameter.standard_uncertainty {
            Some(sigma) if parameter.value > 0.0 && parameter.name != AZIMUTH => {
                format!("{sigma:.5} ({:.2} %, k = 1)", 100.0 * sigma / parameter.value)
            }
            Some(sigma) => format!("{sigma:.5} (k = 1)"),
            None => "none".to_owned(),
        };
        let bound = if parameter.at_bound { ", at its bound" } else { "" };
        writeln!(
            text,
            "{:<11} {:>9.5} ± {uncertainty}{bound}",
            parameter.name, parameter.value
        )
        .expect("strings take everything");
    }
    if let Some(zero) = &fit.azimuth_zero {
        writeln!(text, "{zero}").expect("strings take everything");
    }
    let lack = fit
        .lack_of_fit_percent
        .map_or_else(|| "none".to_owned(), |percent| format!("{percent:.2} %"));
    writeln!(
        text,
        "{} samples, χ² per degree of freedom {:.3}, lack of fit {lack}",
        fit.samples, fit.chi_squared_per_degree
    )
    .expect("strings take everything");
    let verdict = if fit.acceptable {
        "the fit is acceptable"
    } else {
        "the fit is not acceptable"
    };
    writeln!(text, "{verdict}").expect("strings take everything");
    for warning in &fit.warnings {
        writeln!(text, "{warning}").expect("strings take everything");
    }
    text
}
