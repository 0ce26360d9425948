//! `rcg map`

use std::io::{self, Write as _};

use rcg::hemisphere::direction::from_degrees;
use rcg::instrument::optics::{Spread, Unmeasurable, View};
use rcg::instrument::rig::{Rig, Tilt};
use serde_json::json;

use crate::Done;
use crate::numbers::directions_of;
use crate::output::Output;
use crate::request::CalibrationArgs;
use crate::request::image_size;

/// Directions on stdin to camera and projector pixels.
///
/// Reads lines `theta phi` (degrees, sample frame; blank lines and what follows a # are skipped) and
/// answers each with `cam_u cam_v proj_u proj_v` (pixels, centre of the first pixel = 0.5), or with
/// `- reason`. With --spread each answer goes on with `parallax_mm cam_deg cam_mm proj_deg proj_mm`: how far apart camera
/// and projector meet the sample, and for each of them the longest full width of its pixel's cone of directions (degrees)
/// and of its patch on the sample (millimetres).
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Give pixels of a camera image of this size instead of the rig's own
    #[arg(long, value_name = "N", value_parser = image_size)]
    image_size: Option<u32>,
    /// Tilt of the sample by its holder, as in `rcg measure --tilt` [default: none]
    #[arg(long, value_name = "TILT:TOWARDS[:TURN]", allow_hyphen_values = true)]
    tilt: Option<Tilt>,
    #[command(flatten)]
    calibration: CalibrationArgs,
    /// Give parallax and blur of each direction too
    #[arg(long)]
    spread: bool,
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let (rig, _) = args.calibration.rig(Rig::load(rig)?)?;
    let mut rig = rig.tilted(args.tilt)?;
    if let Some(size) = args.image_size {
        rig = rig.with_image_size(size)?;
    }
    let (camera, projector) = (View::camera(&rig), View::projector(&rig));
    let mut out = io::BufWriter::new(io::stdout().lock());
    let mut answers = Vec::new();
    for line in directions_of(io::stdin().lock(), "theta phi in degrees") {
        let [theta_deg, phi_deg] = line?;
        let w = from_degrees(theta_deg, phi_deg);
        let pixels = || -> Result<_, Unmeasurable> {
            let spreads = if args.spread {
                Some((camera.spread(w)?, projector.spread(w)?))
            } else {
                None
            };
            Ok((camera.pixel(w)?, projector.pixel(w)?, spreads))
        };
        match (pixels(), output.is_json()) {
            (Ok((cam, proj, spreads)), false) => {
                write!(out, "{:.6} {:.6} {:.6} {:.6}", cam.x, cam.y, proj.x, proj.y)?;
                for number in spreads.iter().flat_map(in_millimetres_and_degrees) {
                    write!(out, " {number:.4}")?;
                }
                writeln!(out)?;
            }
            (Err(reason), false) => writeln!(out, "- {reason}")?,
            (Ok((cam, proj, spreads)), true) => {
                let mut answer = json!({
                    "theta_deg": theta_deg, "phi_deg": phi_deg,
                    "cam_px": [cam.x, cam.y], "proj_px": [proj.x, proj.y],
                });
                if let Some(spreads) = &spreads {
                    let [parallax_mm, cam_deg, cam_mm, proj_deg, proj_mm] =
                        in_millimetres_and_degrees(spreads);
                    answer["spread"] = json!({
                        "parallax_mm": parallax_mm, "cam_deg": cam_deg, "cam_mm": cam_mm,
                        "proj_deg": proj_deg, "proj_mm": proj_mm,
                    });
                }
                answers.push(answer);
            }
            (Err(reason), true) => {
                let reason = reason.to_string();
                answers.push(json!({ "theta_deg": theta_deg, "phi_deg": phi_deg, "reason": reason }));
            }
        }
    }
    out.flush()?;
    drop(out);
    output.print(&json!({ "rig": rig.name, "directions": answers }), String::new)
}

/// Parallax, then longest cone and patch of the camera's pixel and of the projector's.
fn in_millimetres_and_degrees((camera, projector): &(Spread, Spread)) -> [f64; 5] {
    let of = |spread: &Spread| [spread.width_rad[0].to_degrees(), 1e3 * spread.patch_m];
    let ([cam_deg, cam_mm], [proj_deg, proj_mm]) = (of(camera), of(projector));
    [
        1e3 * camera.hit_m.distance(projector.hit_m),
        cam_deg,
        cam_mm,
        proj_deg,
        proj_mm,
    ]
}
