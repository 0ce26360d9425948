//! Tells which pixels of camera and projector belong to a direction at the sample, and which direction to a pixel.
//!
//! `cargo run --release --example map_directions [RIG]`, where RIG is rcg-1-16bit (as if nothing is given), rcg-2, rcg-3, dmd or the
//! path of a rig file.

use std::error::Error;

use rcg::hemisphere::direction::{angle_between, from_degrees, to_degrees};
use rcg::instrument::optics::{Unmeasurable, View};
use rcg::instrument::rig::Rig;

fn main() -> Result<(), Box<dyn Error>> {
    let name = std::env::args()
        .nth(1)
        .unwrap_or_else(|| "rcg-1-16bit".to_owned());
    let rig = Rig::load(&name)?;
    let (camera, projector) = (View::camera(&rig), View::projector(&rig));

    // Positions are in pixels; the centre of the first pixel is 0.5.
    println!(
        "{}: direction (θ, φ) → camera pixel (u, v), projector pixel (u, v)",
        rig.name
    );
    for (theta_deg, phi_deg) in [
        (10.0, 0.0),
        (30.0, 0.0),
        (45.0, 90.0),
        (60.0, 210.0),
        (80.0, 270.0),
        (95.0, 0.0),
    ] {
        let w = from_degrees(theta_deg, phi_deg);
        let words = |found: Result<glam::DVec2, Unmeasurable>| match found {
            Ok(px) => format!("({:8.2}, {:8.2})", px.x, px.y),
            Err(reason) => format!("{:>20}", reason.to_string()),
        };
        println!(
            "  ({theta_deg:4}°, {phi_deg:3}°) → {} {}",
            words(camera.pixel(w)),
            words(projector.pixel(w))
        );
    }

    println!("camera pixel (u, v) → direction (θ, φ), and how far off the way back ends");
    let (width_px, height_px) = (
        f64::from(camera.pinhole().width_px()),
        f64::from(camera.pinhole().height_px()),
    );
    for (across, down) in [(0.5, 0.5), (0.7, 0.5), (0.5, 0.1), (0.25, 0.25), (0.01, 0.01)] {
        let (u_px, v_px) = (across * width_px, down * height_px);
        // Both ways give a reason where there is nothing: an image has corners, the mirror has a hole.
        match camera.direction(u_px, v_px) {
            Err(reason) => println!("  ({u_px:7.1}, {v_px:7.1}) → {reason}"),
            Ok(w) => {
                let (theta_deg, phi_deg) = to_degrees(w);
                let back = camera.pixel(w)?;
                let off_px = (back.x - u_px).hypot(back.y - v_px);
                println!("  ({u_px:7.1}, {v_px:7.1}) → ({theta_deg:6.2}°, {phi_deg:6.2}°), {off_px:.1e} px");
            }
        }
    }

    // As drawn, camera and projector stand exactly at the focus: whatever they see is the centre of the sample.
    println!(
        "what the pixel that sees (60°, 210°) covers, as drawn and with the camera 0.5 mm beside the focus:"
    );
    let mut beside = rig.clone();
    beside.camera.lens.offset_m[0] += 0.5e-3;
    let w = from_degrees(60.0, 210.0);
    for camera in [camera, View::camera(&beside)] {
        let (seen, lit) = (camera.spread(w)?, projector.spread(w)?);
        let [longest_deg, shortest_deg] = seen.width_rad.map(f64::to_degrees);
        println!(
            "  cone {longest_deg:.3}° × {shortest_deg:.3}°, patch {:.1} µm, parallax to the projector {:.1} µm",
            1e6 * seen.patch_m,
            1e6 * seen.hit_m.distance(lit.hit_m)
        );
    }
    // The pixel of before sees another direction now.
    let px = View::camera(&rig).pixel(w)?;
    let now = View::camera(&beside).direction(px.x, px.y)?;
    println!(
        "  the pixel of before looks {:.3}° away from there",
        angle_between(now, w).to_degrees()
    );
    Ok(())
}
