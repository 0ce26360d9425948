//! `rcg map`

use std::io::{self, Write as _};

use rcg::direction::from_degrees;
use rcg::optics::View;
use rcg::rig::Rig;
use serde_json::json;

use crate::Done;
use crate::numbers::lines_of;
use crate::output::Output;

/// Directions on stdin to camera and projector pixels.
///
/// Reads lines `theta phi` (degrees, sample frame; blank lines and those that begin with # are skipped) and
/// answers each with `cam_u cam_v proj_u proj_v` (pixels, centre of the first pixel = 0.5), or with
/// `- reason`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Give pixels of a camera image of this size instead of the rig's own
    #[arg(long, value_name = "N")]
    image_size: Option<u32>,
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let mut rig = Rig::load(rig)?;
    if let Some(size) = args.image_size {
        rig = rig.with_image_size(size)?;
    }
    let (camera, projector) = (View::camera(&rig), View::projector(&rig));
    let mut out = io::BufWriter::new(io::stdout().lock());
    let mut answers = Vec::new();
    for line in lines_of(io::stdin().lock(), "theta phi in degrees") {
        let [theta_deg, phi_deg] = line?;
        let w = from_degrees(theta_deg, phi_deg);
        let pixels = camera.pixel(w).and_then(|cam| Ok((cam, projector.pixel(w)?)));
        match (pixels, output.is_json()) {
            (Ok((cam, proj)), false) => {
                writeln!(out, "{:.6} {:.6} {:.6} {:.6}", cam.x, cam.y, proj.x, proj.y)?;
            }
            (Err(reason), false) => writeln!(out, "- {reason}")?,
            (Ok((cam, proj)), true) => answers.push(json!({
                "theta_deg": theta_deg, "phi_deg": phi_deg,
                "cam_px": [cam.x, cam.y], "proj_px": [proj.x, proj.y],
            })),
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
