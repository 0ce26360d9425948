//! `rcg turn`

use std::path::PathBuf;

use rcg::assemble::turn::{To, turn};
use rcg::judge::fit::Model;

use crate::Done;
use crate::fill::brdf_of;
use crate::fit::Kind;
use crate::output::Output;

/// Lay φ = 0 of a BRDF elsewhere on the sample.
///
/// What was measured stays as it is and where it was on the sample; azimuths count from another direction. No value is interpolated, and
/// turning back gives what was.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr or the directory of a measurement
    #[arg(value_name = "BRDF")]
    brdf: PathBuf,
    /// What becomes φ = 0: an azimuth of the file in degrees, or `auto`, the axis of `ax` of a fitted lobe
    #[arg(long, value_name = "DEG|auto", value_parser = azimuth)]
    azimuth: Asked,
    /// The model whose lobe is fitted
    #[arg(long, value_enum, default_value = "ward")]
    model: Kind,
    /// The brdf.zarr to write
    #[arg(long, value_name = "OUT")]
    out: PathBuf,
}

/// What becomes φ = 0.
#[derive(Clone, Copy, Debug)]
enum Asked {
    Deg(f64),
    Auto,
}

fn azimuth(text: &str) -> Result<Asked, String> {
    let expected = || "expected degrees from -360 to 360, or auto".to_owned();
    if text == "auto" {
        return Ok(Asked::Auto);
    }
    let deg: f64 = text.parse().map_err(|_| expected())?;
    if deg.abs() <= 360.0 {
        Ok(Asked::Deg(deg))
    } else {
        Err(expected())
    }
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let to = match args.azimuth {
        Asked::Deg(deg) => To::Azimuth(deg),
        Asked::Auto => To::Lobe(Model::from(args.model)),
    };
    let turned = turn(&brdf_of(&args.brdf), to, &args.out)?;
    output.print(&turned, || {
        format!("turned by {:.3}°: {}\n", turned.by_deg, turned.azimuth)
    })
}
