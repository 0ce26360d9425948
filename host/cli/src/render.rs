//! `rcg render`

use std::path::{Path, PathBuf};

use rcg::base::file_format::RENDERED;
use rcg::brdf::Source;
use rcg::brdf::reflectance::Reflectance;
use rcg::judge::render::{
    Around, CameraColours, Environment, Picture, automatic_exposure, azimuth_in_words, corrugated,
    corrugated_in, save_described, save_linear, share_with_values, sheet, sphere, sphere_in, torus, torus_in,
};
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, to_write};

/// Largest sheet of pictures: a byte for each of three colours must fit into memory a few times over.
const MAX_PIXELS: u64 = 1 << 28;
/// Largest picture in an environment, pixels a side.
const MAX_AROUND: u32 = 2048;
/// Lean of a corrugated sheet, degrees.
const TILT_DEG: f64 = 30.0;

/// Draw a BRDF or sample on a sphere, a corrugated sheet or a ring under distant lights, or in an environment.
///
/// One picture per light, side by side; with --scene both, the spheres above and the sheets below. Directions that were
/// not measured are hatched. Red, green and blue are the channels of the source, shown as sRGB as they are, unless --colours says
/// what they look like.
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
    /// Light from all around instead: a latitude-longitude map (.hdr, .exr), twice as wide as high, whose middle is what the camera sees
    /// behind the object and whose upper edge is above
    #[arg(long, value_name = "FILE", conflicts_with = "light")]
    environment: Option<PathBuf>,
    /// Degrees by which the environment is turned to the right [default: 0]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    turn: Option<f64>,
    /// Patches of known colours (.csv): columns r,g,b of the camera and X,Y,Z under D65, or sR,sG,sB, from which a matrix is fitted
    #[arg(long, value_name = "FILE")]
    colours: Option<PathBuf>,
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

impl Scene {
    /// Whether there are sheets in it.
    const fn has_sheets(self) -> bool {
        matches!(self, Self::Corrugated | Self::Both)
    }
}

pub(crate) fn angles(text: &str) -> Result<(f64, f64), String> {
    let parsed = text.split_once(',').and_then(|(theta, phi)| {
        let (theta, phi): (f64, f64) = (theta.trim().parse().ok()?, phi.trim().parse().ok()?);
        ((0.0..=180.0).contains(&theta) && phi.abs() <= 3600.0).then_some((theta, phi))
    });
    parsed.ok_or_else(|| "expected two angles in degrees such as 45,90".to_owned())
}

/// What the options say together.
fn check(args: &Args) -> Done {
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
    if args.tilt.is_some() && !args.scene.has_sheets() {
        return Err(Failure::input(format!(
            "--tilt: expected --scene corrugated or both beside it, as only sheets have one, found {tilt_deg} without a sheet"
        )));
    }
    if let Some(turn) = args.turn.filter(|turn| !(-360.0..=360.0).contains(turn)) {
        return Err(Failure::input(format!(
            "--turn: expected a number of degrees from -360 to 360, found {turn}"
        )));
    }
    if let Some(turn) = args.turn.filter(|_| args.environment.is_none()) {
        return Err(Failure::input(format!(
            "--turn: expected --environment beside it, found {turn} without"
        )));
    }
    let pixels = u64::from(args.size).pow(2);
    let scenes = if args.scene == Scene::Both { 2 } else { 1 };
    if pixels * args.light.len() as u64 * scenes > MAX_PIXELS {
        return Err(Failure::input(format!(
            "--size {}: expected at most {MAX_PIXELS} pixels in all, found {} pictures of {pixels}",
            args.size,
            args.light.len() as u64 * scenes
        )));
    }
    if args.environment.is_some() && args.size > MAX_AROUND {
        return Err(Failure::input(format!(
            "--size {}: expected at most {MAX_AROUND} with --environment, which looks at hundreds of directions for each pixel",
            args.size
        )));
    }
    to_write(&args.out, RENDERED)?;
    if let Some(exposure) = args.exposure.filter(|_| is_linear(args)) {
        return Err(Failure::input(format!(
            "--exposure: expected a .png beside it, as an .exr holds the radiance itself, found {exposure}"
        )));
    }
    Ok(())
}

fn is_linear(args: &Args) -> bool {
    RENDERED.of(&args.out).is_ok_and(|format| format == "exr")
}

/// The pictures, row by row, and of those in an environment how well that is done: root mean square and largest error in the unit of the
/// map, and the largest share of light without a value.
type Drawn = (Vec<Vec<Picture>>, Option<([f64; 2], f64)>);

fn draw(args: &Args, material: &dyn Reflectance) -> Result<Drawn, Failure> {
    let size = args.size as usize;
    if let Some(path) = &args.environment {
        return draw_around(args, material, path);
    }
    let mut rows = Vec::new();
    if args.scene == Scene::Torus {
        let pictures = args.light.iter().map(|&light| torus(material, size, light));
        rows.push(pictures.collect::<Result<Vec<_>, _>>()?);
    }
    if matches!(args.scene, Scene::Sphere | Scene::Both) {
        let pictures = args.light.iter().map(|&light| sphere(material, size, light));
        rows.push(pictures.collect::<Result<Vec<_>, _>>()?);
    }
    if args.scene.has_sheets() {
        let tilt_deg = args.tilt.unwrap_or(TILT_DEG);
        let pictures = args.light.iter();
        let pictures = pictures.map(|&light| corrugated(material, size, tilt_deg, light));
        rows.push(pictures.collect::<Result<Vec<_>, _>>()?);
    }
    Ok((rows, None))
}

/// As [`draw`], in the environment at `path`: of several objects the largest figures.
fn draw_around(args: &Args, material: &dyn Reflectance, path: &Path) -> Result<Drawn, Failure> {
    let environment = Environment::read(path)?.turned(args.turn.unwrap_or(0.0));
    let size = args.size as usize;
    let mut objects: Vec<Around> = Vec::new();
    if args.scene == Scene::Torus {
        objects.push(torus_in(material, size, &environment)?);
    }
    if matches!(args.scene, Scene::Sphere | Scene::Both) {
        objects.push(sphere_in(material, size, &environment)?);
    }
    if args.scene.has_sheets() {
        let tilt_deg = args.tilt.unwrap_or(TILT_DEG);
        objects.push(corrugated_in(material, size, tilt_deg, &environment)?);
    }
    let most = |of: &dyn Fn(&Around) -> f64| objects.iter().map(of).fold(0.0, f64::max);
    let error = [most(&|object| object.error[0]), most(&|object| object.error[1])];
    let unseen = most(&|object| object.unseen);
    let rows = objects.into_iter().map(|object| vec![object.picture]).collect();
    Ok((rows, Some((error, unseen))))
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    check(args)?;
    let colours = args.colours.as_deref().map(CameraColours::read).transpose()?;
    let source = Source::open(&args.brdf)?;
    let (mut rows, around) = draw(args, source.reflectance())?;
    if let Some(colours) = &colours {
        let all = rows.into_iter();
        rows = all
            .map(|row| row.into_iter().map(|picture| colours.shown(picture)).collect())
            .collect();
    }
    let exposure = args.exposure.unwrap_or_else(|| automatic_exposure(&rows));
    let zero = match &source {
        Source::Measured(brdf) => Some(brdf.azimuth().zero()),
        Source::Known(_) => None,
    };
    let azimuth = azimuth_in_words(zero.as_deref());
    let seen = colours.as_ref().map_or_else(
        || "red, green and blue of the source, shown as sRGB as they are".to_owned(),
        CameraColours::words,
    );
    let description = format!("{}; {azimuth}; colours: {seen}", args.brdf);
    if is_linear(args) {
        save_linear(&rows, &args.out, &description)?;
    } else {
        save_described(&sheet(&rows, exposure), &args.out, Some(&description))?;
    }
    let share = share_with_values(&rows);
    let mut value = json!({
        "out": args.out, "size": args.size, "exposure": exposure, "with_values": share, "azimuth": azimuth, "colours": colours,
    });
    let mut text = format!(
        "{} (exposure {exposure:.4})\n{azimuth}\ncolours: {seen}\n",
        args.out.display()
    );
    match around {
        None => value["lights_deg"] = json!(args.light),
        Some(([rms, largest], unseen)) => {
            value["environment"] = json!({
                "file": args.environment, "turn_deg": args.turn.unwrap_or(0.0), "rms_error": rms, "largest_error": largest, "unseen": unseen,
            });
            let [rms, largest] = [rms, largest].map(|error| 100.0 * error * f64::from(exposure));
            text = format!(
                "{text}integral over the environment: off by {rms:.3} % of white (root mean square), {largest:.3} % at most\n"
            );
            if unseen > 0.0 {
                text = format!(
                    "{text}light from directions without a value: up to {:.2} %, replaced by the rest\n",
                    100.0 * unseen
                );
            }
        }
    }
    output.print(&value, || text)?;
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
