//! `rcg render`

use std::path::PathBuf;

use rcg::base::file_format::RENDERED;
use rcg::brdf::Source;
use rcg::judge::render::{
    automatic_exposure, azimuth_in_words, corrugated, save_described, save_linear, share_with_values, sheet,
    sphere, torus,
};
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, to_write};

/// Largest sheet of pictures: a byte for each of three colours must fit into memory a few times over.
const MAX_PIXELS: u64 = 1 << 28;
/// Lean of a corrugated sheet, degrees.
const TILT_DEG: f64 = 30.0;

/// Draw a BRDF or sample on a sphere, a corrugated sheet or a ring under distant lights.
///
/// One picture per light, side by side; with --scene both, the spheres above and the sheets below. Directions that were
/// not measured are hatched.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr, a measured .bsdf file, or a model such as ward:brass
    #[arg(value_name = "BRDF")]
    brdf: String,
    /// The picture to write: as a screen shows it (.png), or linear radiance under unit irradiance (.exr)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// What is drawn
    #[arg(long, value_enum, default_value_t = Scene::Sphere)]
    scene: Scene,
    /// Pixels a side of each picture
    #[arg(long, value_name = "N", default_value_t = 512, value_parser = clap::value_parser!(u32).range(8..=8192))]
    size: u32,
    /// Polar angle and azimuth of a light in degrees; 0,0 is behind the camera, azimuth 90 is above; may be repeated
    #[arg(long, value_name = "THETA,PHI", default_value = "45,90", value_parser = angles)]
    light: Vec<(f64, f64)>,
    /// Degrees by which the upper edge of the corrugated sheet leans away from the camera, 0 to 75 [default: 30]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    tilt: Option<f64>,
    /// Factor from radiance (light of unit irradiance) to white [default: bright parts are white]
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true)]
    exposure: Option<f32>,
}

/// What the sample covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Scene {
    /// A sphere
    Sphere,
    /// A sheet in folds, with cast shadows
    Corrugated,
    /// Spheres above, sheets below
    Both,
    /// A ring, seen obliquely, with a cast shadow
    Torus,
}

pub(crate) fn angles(text: &str) -> Result<(f64, f64), String> {
    let parsed = text.split_once(',').and_then(|(theta, phi)| {
        let (theta, phi): (f64, f64) = (theta.trim().parse().ok()?, phi.trim().parse().ok()?);
        ((0.0..=180.0).contains(&theta) && phi.abs() <= 3600.0).then_some((theta, phi))
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
    let tilt_deg = args.tilt.unwrap_or(TILT_DEG);
    if !(0.0..=75.0).contains(&tilt_deg) {
        return Err(Failure::input(format!(
            "--tilt: expected a number of degrees from 0 to 75, found {tilt_deg}"
        )));
    }
    let has_sheets = matches!(args.scene, Scene::Corrugated | Scene::Both);
    if args.tilt.is_some() && !has_sheets {
        return Err(Failure::input(format!(
            "--tilt: expected --scene corrugated or both beside it, as only sheets have one, found {tilt_deg} without a sheet"
        )));
    }
    let (size, pixels) = (args.size as usize, u64::from(args.size).pow(2));
    let scenes = if args.scene == Scene::Both { 2 } else { 1 };
    if pixels * args.light.len() as u64 * scenes > MAX_PIXELS {
        return Err(Failure::input(format!(
            "--size {size}: expected at most {MAX_PIXELS} pixels in all, found {} pictures of {pixels}",
            args.light.len() as u64 * scenes
        )));
    }
    to_write(&args.out, RENDERED)?;
    let is_linear = RENDERED.of(&args.out)? == "exr";
    if let Some(exposure) = args.exposure.filter(|_| is_linear) {
        return Err(Failure::input(format!(
            "--exposure: expected a .png beside it, as an .exr holds the radiance itself, found {exposure}"
        )));
    }
    let source = Source::open(&args.brdf)?;
    let material = source.reflectance();
    let mut rows = Vec::new();
    if args.scene == Scene::Torus {
        let pictures = args.light.iter().map(|&light| torus(material, size, light));
        rows.push(pictures.collect::<Result<Vec<_>, _>>()?);
    }
    if matches!(args.scene, Scene::Sphere | Scene::Both) {
        let pictures = args.light.iter().map(|&light| sphere(material, size, light));
        rows.push(pictures.collect::<Result<Vec<_>, _>>()?);
    }
    if has_sheets {
        let pictures = args
            .light
            .iter()
            .map(|&light| corrugated(material, size, tilt_deg, light));
        rows.push(pictures.collect::<Result<Vec<_>, _>>()?);
    }
    let exposure = args.exposure.unwrap_or_else(|| automatic_exposure(&rows));
    let zero = match &source {
        Source::Measured(brdf) => Some(brdf.azimuth().zero()),
        Source::Known(_) => None,
    };
    let azimuth = azimuth_in_words(zero.as_deref());
    if is_linear {
        save_linear(&rows, &args.out, &format!("{}; {azimuth}", args.brdf))?;
    } else {
        save_described(&sheet(&rows, exposure), &args.out, Some(&azimuth))?;
    }
    let share = share_with_values(&rows);
    let value = json!({
        "out": args.out, "size": args.size, "lights_deg": args.light, "exposure": exposure, "with_values": share,
        "azimuth": azimuth,
    });
    output.print(&value, || {
        format!("{} (exposure {exposure:.4})\n{azimuth}\n", args.out.display())
    })?;
    if share.is_none_or(|share| share <= 0.0) {
        let why = if share.is_none() {
            "nothing is lit"
        } else {
            "no lit direction has a value"
        };
        output.warn(&[format!("the picture shows nothing: {why}")]);
    }
    Ok(())
}
