//! `rcg render`

use std::path::PathBuf;

use rcg::reflectance::Source;
use rcg::render::{automatic_exposure, save, sheet, sphere};
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::Output;

/// Draw a sphere of a BRDF or sample under a light.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr, a measured .bsdf file, or a model such as ward:brass
    #[arg(value_name = "BRDF")]
    brdf: String,
    /// The picture to write (PNG)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Pixels a side
    #[arg(long, value_name = "N", default_value_t = 512, value_parser = clap::value_parser!(u32).range(8..=8192))]
    size: u32,
    /// Polar angle and azimuth of the light in degrees; 0,0 is behind the camera, azimuth 90 is above
    #[arg(long, value_name = "THETA,PHI", default_value = "45,90", value_parser = angles)]
    light: (f64, f64),
    /// Factor from radiance (light of unit irradiance) to white [default: bright parts are white]
    #[arg(long, value_name = "FACTOR")]
    exposure: Option<f32>,
}

fn angles(text: &str) -> Result<(f64, f64), String> {
    let parsed = text.split_once(',').and_then(|(theta, phi)| {
        let (theta, phi): (f64, f64) = (theta.trim().parse().ok()?, phi.trim().parse().ok()?);
        ((0.0..=180.0).contains(&theta) && phi.is_finite()).then_some((theta, phi))
    });
    parsed.ok_or_else(|| "expected two angles in degrees such as 45,90".to_owned())
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    if let Some(exposure) = args.exposure
        && !(exposure.is_finite() && exposure > 0.0)
    {
        return Err(Failure::input(format!(
            "--exposure: expected a positive number, found {exposure}"
        )));
    }
    let source = Source::open(&args.brdf)?;
    let rows = [vec![sphere(
        source.reflectance(),
        args.size as usize,
        args.light,
    )?]];
    let exposure = args.exposure.unwrap_or_else(|| automatic_exposure(&rows));
    save(&sheet(&rows, exposure), &args.out)?;
    let value = json!({ "out": args.out, "size": args.size, "exposure": exposure });
    output.print(&value, || {
        format!("{} (exposure {exposure:.4})\n", args.out.display())
    })
}
