//! `rcg calibrate geometry`

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use rcg::base::progress::Progress as _;
use rcg::calibrate::geometry::{
    ByHand, Mask, Request, Said, TILT_UNCERTAINTY_DEG, TILTS, Views, calibrate, capture,
};
use rcg::calibrate::photometry;
use rcg::instrument::calibration::{AS_STATED, Geometry, RIG};
use rcg::instrument::rig::Rig;
use rcg::store::Lock;
use serde::Serialize;

use super::Site;
use super::hands::{HandArgs, Lines, is_stopped};
use crate::Done;
use crate::failure::Failure;
use crate::output::Output;
use crate::request::{ConditionArgs, PortArgs, image_size};
use crate::session::SessionArgs;

/// Pixels a side of the camera's image.
const IMAGE_SIZE: u32 = 256;

/// Find poses, lenses, mirror and sample frame with a flat mirror and a diffuse standard in the sample's place.
///
/// The projector shows stripes; the camera sees them in the flat mirror, which stands at a few known tilts, and the edges of
/// hole, rim and wire against the lit standard. Writes the calibrated rig (rig.toml), what was found with its covariance
/// (geometry.json), the residuals (geometry-residuals.png) and what the camera sees of the standard (geometry-standard.png).
/// Where the directory holds the captures already, they are fitted again.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The directory of the calibration
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Tilts of the flat mirror against the holder and the azimuths towards which it is tilted, degrees; captures that are there already are
    /// fitted again with them [default: as when captured, else 0:0,15:0,15:120,15:240]
    #[arg(
        long,
        value_name = "TILT:AZIMUTH,...",
        value_delimiter = ',',
        value_parser = tilt
    )]
    tilts: Vec<[f64; 2]>,
    /// Standard uncertainty (k = 1) of each of these tilts, in its plane and across it, degrees [default: as when captured, else 0.05, of
    /// mounts that are read to 5 minutes of arc]
    #[arg(long, value_name = "DEG", value_parser = tilt_uncertainty)]
    tilt_uncertainty_deg: Option<f64>,
    /// Pixels a side of the camera's image [default: as when captured, else 256]
    #[arg(long, value_name = "N", value_parser = image_size)]
    image_size: Option<u32>,
    /// Picture (PNG, square) that is white where something is before the mirror, painted over geometry-standard.png: there nothing is
    /// measured; it is kept as mask.png and holds from then on
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    #[command(flatten)]
    hands: HandArgs,
    #[command(flatten)]
    conditions: ConditionArgs,
    #[command(flatten)]
    port: PortArgs,
    #[command(flatten)]
    session: SessionArgs,
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

fn tilt_uncertainty(text: &str) -> Result<f64, String> {
    let found = text.trim().parse::<f64>().ok();
    found
        .filter(|deg| (0.001..=5.0).contains(deg))
        .ok_or_else(|| "expected 0.001 to 5 degrees".to_owned())
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let Some((geometry, warning)) = calibrated(args, rig, output)? else {
        return Ok(());
    };
    let answer = Answer {
        geometry: &geometry,
        warning: warning.as_deref(),
    };
    output.print(&answer, || match &warning {
        Some(warning) => format!("{}warning: {warning}\n", text(&geometry)),
        None => text(&geometry),
    })?;
    output.warn(warning.as_slice());
    Ok(())
}

/// What was found, and what is to be said of it; `None` if somebody who puts targets in stopped before all was captured.
pub(super) fn calibrated(
    args: &Args,
    rig: &str,
    output: &Output,
) -> Result<Option<(Geometry, Option<String>)>, Failure> {
    let session = args.session.opening("calibrate geometry", None)?;
    let _lock = Lock::folder(&args.out)?;
    session.check(&args.out)?;
    let tilts = (!args.tilts.is_empty()).then(|| args.tilts.clone());
    let mut said = Said {
        tilts,
        tilt_uncertainty_deg: args.tilt_uncertainty_deg,
        image_size: args.image_size,
        mask: args.mask.as_deref().map(Mask::read).transpose()?,
    };
    let request = || -> Result<Request, Failure> {
        Ok(Request {
            rig: args.port.real(Rig::load(rig)?)?,
            tilts: said.tilts.clone().unwrap_or_else(|| TILTS.to_vec()),
            image_size: args.image_size.unwrap_or(IMAGE_SIZE),
            tilt_uncertainty_deg: args.tilt_uncertainty_deg.unwrap_or(TILT_UNCERTAINTY_DEG),
        })
    };
    if let Some(redo) = args.hands.redo() {
        let request = request()?;
        let site = Site::of(&request.rig, &args.conditions, &args.port)?;
        let mut by_hand = ByHand::open(&request, &said, &args.out, site.place(), redo)
            .map_err(|error| Failure::from(error).at(args.out.display()))?;
        // Each day is a session, however it ends.
        session.note(&args.out)?;
        let how_far = by_hand.take(site.bench().as_mut(), &mut Lines { output }, output)?;
        if is_stopped(&how_far, "geometry", &args.out, output)? {
            return Ok(None);
        }
    } else if Views::exist(&args.out) {
        output.remark(&format!(
            "{}: holds captures, which are fitted again",
            args.out.display()
        ));
    } else {
        let request = request()?;
        let world = super::world(&request.rig, &args.conditions, &args.port)?;
        capture(&request, &args.out, &world, output)?;
        said = Said {
            mask: said.mask,
            ..Said::default()
        };
    }
    let before = fs::read(args.out.join(RIG)).ok();
    let geometry =
        calibrate(&args.out, &said).map_err(|error| Failure::from(error).at(args.out.display()))?;
    session.note(&args.out)?;
    let has_photometry = photometry::Views::exist(&args.out);
    let is_another = before.is_some_and(|before| fs::read(args.out.join(RIG)).ok() != Some(before));
    let warning = (has_photometry && is_another).then(|| {
        format!(
            "{}: its photometric captures were lit as the geometry before had it, and nothing takes them with this one: fit the geometry as it was \
             again, or capture both into another directory",
            args.out.display()
        )
    });
    Ok(Some((geometry, warning)))
}

/// What was found, and what is to be known of it.
#[derive(Serialize)]
struct Answer<'a> {
    #[serde(flatten)]
    geometry: &'a Geometry,
    #[serde(skip_serializing_if = "Option::is_none")]
    warning: Option<&'a str>,
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
    for (device, image) in ["camera", "projector"].iter().zip(&geometry.images) {
        if image != AS_STATED {
            writeln!(
                text,
                "{device}: its image is {image}, against the rig file; the calibrated rig has it so"
            )
            .expect("strings take everything");
        }
    }
    for tilt in &geometry.tilts {
        let [stated, leans, uncertainty] = [tilt.stated_deg, tilt.leans_deg, tilt.standard_uncertainty_deg];
        writeln!(
            text,
            "flat mirror at {}:{}: leans {:+.4} ± {:.4}° in the plane of the tilt, {:+.4} ± {:.4}° across, residual {:.4}°",
            stated[0],
            stated[1],
            leans[0],
            uncertainty[0],
            leans[1],
            uncertainty[1],
            tilt.match_residual_deg
        )
        .expect("strings take everything");
    }
    let edges = geometry
        .edge_residual_deg
        .map_or_else(|| "none".to_owned(), |deg| format!("{deg:.4}°"));
    writeln!(
        text,
        "{} matches, median residual {:.4}°; {} edge positions, {edges}\n\
         standard uncertainty of directions (k = 1): camera {:.4}°, projector {:.4}°; of where azimuth 0 of the holder lies {:.4}°",
        geometry.matches,
        geometry.match_residual_deg,
        geometry.edges,
        geometry.camera_deg,
        geometry.projector_deg,
        geometry.azimuth_deg
    )
    .expect("strings take everything");
    text
}
