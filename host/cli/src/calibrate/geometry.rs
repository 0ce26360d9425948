//! `rcg calibrate geometry`

use std::fmt::Write as _;
use std::path::PathBuf;

use rcg::base::progress::Progress as _;
use rcg::calibrate::geometry::{Request, Views, calibrate, capture};
use rcg::instrument::calibration::Geometry;
use rcg::instrument::rig::Rig;
use rcg::store::Lock;

use crate::Done;
use crate::failure::Failure;
use crate::output::Output;
use crate::request::{ConditionArgs, PortArgs, image_size};

/// Find poses, lenses, mirror and sample frame with a flat mirror and a diffuse standard in the sample's place.
///
/// The projector shows stripes; the camera sees them in the flat mirror, which stands at a few known tilts, and the edges of
/// hole, rim and wire against the lit standard. Writes the calibrated rig (rig.toml), what was found with its covariance
/// (geometry.json) and the residuals (geometry-residuals.png). Where the directory holds the captures already, they are
/// fitted again.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The directory of the calibration
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Tilts of the flat mirror against the holder and the azimuths towards which it is tilted, degrees
    #[arg(
        long,
        value_name = "TILT:AZIMUTH,...",
        value_delimiter = ',',
        value_parser = tilt,
        default_value = "0:0,15:0,15:120,15:240"
    )]
    tilts: Vec<[f64; 2]>,
    /// Pixels a side of the camera's image
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = image_size)]
    image_size: u32,
    #[command(flatten)]
    conditions: ConditionArgs,
    #[command(flatten)]
    port: PortArgs,
}

fn tilt(text: &str) -> Result<[f64; 2], String> {
    let degrees = |text: &str| text.trim().parse::<f64>().ok();
    text.split_once(':')
        .and_then(|(tilt, azimuth)| Some([degrees(tilt)?, degrees(azimuth)?]))
        .filter(|[tilt_deg, azimuth_deg]| (0.0..=45.0).contains(tilt_deg) && azimuth_deg.abs() <= 360.0)
        .ok_or_else(|| {
            "expected TILT:AZIMUTH, a tilt from 0 to 45 and an azimuth up to 360 degrees".to_owned()
        })
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let _lock = Lock::folder(&args.out)?;
    if Views::exist(&args.out) {
        output.remark(&format!(
            "{}: holds captures, which are fitted again",
            args.out.display()
        ));
    } else {
        let request = Request {
            rig: Rig::load(rig)?,
            tilts: args.tilts.clone(),
            image_size: args.image_size,
        };
        let world = super::world(&args.conditions, &args.port)?;
        capture(&request, &args.out, &world, output)?;
    }
    let geometry = calibrate(&args.out).map_err(|error| Failure::from(error).at(args.out.display()))?;
    output.print(&geometry, || text(&geometry))
}

fn text(geometry: &Geometry) -> String {
    let mut text = String::new();
    for found in &geometry.parameters {
        writeln!(
            text,
            "{:<30} {:>14.7} ± {:<12.7} (nominal {:.7})",
            found.name, found.value, found.standard_uncertainty, found.nominal
        )
        .expect("strings take everything");
    }
    let edges = geometry
        .edge_residual_deg
        .map_or_else(|| "none".to_owned(), |deg| format!("{deg:.4}°"));
    writeln!(
        text,
        "{} matches, median residual {:.4}°; {} edge positions, {edges}\n\
         standard uncertainty of directions (k = 1): camera {:.4}°, projector {:.4}°",
        geometry.matches,
        geometry.match_residual_deg,
        geometry.edges,
        geometry.camera_deg,
        geometry.projector_deg
    )
    .expect("strings take everything");
    text
}
