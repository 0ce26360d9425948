//! The residuals over the camera's image, one panel per view.

use std::path::Path;

use image::{GrayImage, Luma, Rgb, RgbImage};

use super::capture::Views;
use super::sightings::Sightings;
use super::solve::Solution;
use crate::calibrate::CalibrateError;
use crate::judge::chart::captioned;
use crate::judge::render::{save, srgb};

/// Side of a panel, pixels.
const PANEL_PX: u32 = 300;
/// Half the side of a mark, pixels.
const MARK_PX: i64 = 2;

/// Draws the diffuse standard as the camera sees it, a pixel for each of its own: what is dark in it hides something, and a mask is painted
/// over it.
pub(super) fn save_standard(seen: &Sightings, path: &Path) -> Result<(), CalibrateError> {
    let mut sorted = seen.standard.clone();
    sorted.sort_by(f32::total_cmp);
    let white = sorted
        .get(sorted.len() * 99 / 100)
        .copied()
        .unwrap_or(0.0)
        .max(1.0);
    let width = seen.width as u32;
    let picture = GrayImage::from_fn(width, seen.standard.len() as u32 / width.max(1), |x, y| {
        Luma([srgb(seen.standard[(y * width + x) as usize] / white)])
    });
    Ok(save(&picture, path)?)
}

/// Draws the magnitude of each match's residual where the camera saw it, dark blue for nothing and yellow for four times
/// the usual; of edge positions in the last panel.
pub(super) fn save_panels(
    views: &Views,
    seen: &Sightings,
    solution: &Solution,
    path: &Path,
) -> Result<(), CalibrateError> {
    let panels = views.tilts.len() as u32 + 1;
    let mut image = RgbImage::from_pixel(PANEL_PX * panels, PANEL_PX, Rgb([255; 3]));
    let per_px = f64::from(PANEL_PX) / f64::from(views.image_size);
    let mut dot = |panel: u32, at: glam::DVec2, share: f64| {
        let centre = (at * per_px).as_i64vec2();
        for dy in -MARK_PX..=MARK_PX {
            for dx in -MARK_PX..=MARK_PX {
                let (x, y) = (centre.x + dx, centre.y + dy);
                if (0..i64::from(PANEL_PX)).contains(&x) && (0..i64::from(PANEL_PX)).contains(&y) {
                    image.put_pixel(panel * PANEL_PX + x as u32, y as u32, colour(share));
                }
            }
        }
    };
    let (matches, edges) = solution.residuals.split_at(seen.matches.len());
    for (found, residual) in seen.matches.iter().zip(matches) {
        if let Some(residual) = residual {
            dot(
                found.view as u32,
                found.camera_px,
                residual.length() / (4.0 * solution.scales_rad[0]),
            );
        }
    }
    for (at, residual) in seen.edges_px.iter().zip(edges) {
        if let Some(residual) = residual {
            dot(
                panels - 1,
                *at,
                residual.length() / (4.0 * solution.scales_rad[1]),
            );
        }
    }
    let yellow_deg = solution.scales_rad.map(|rad| (4.0 * rad).to_degrees());
    let mut captions: Vec<String> = views
        .tilts
        .iter()
        .map(|[tilt_deg, azimuth_deg]| format!("{tilt_deg}° to {azimuth_deg}°, yellow {:.3}°", yellow_deg[0]))
        .collect();
    captions.push(format!("edges, yellow {:.3}°", yellow_deg[1]));
    Ok(save(&captioned(&image, &captions), path)?)
}

/// Dark blue, then green, then yellow.
fn colour(share: f64) -> Rgb<u8> {
    const STOPS: [[f64; 3]; 4] = [
        [48.0, 18.0, 92.0],
        [38.0, 110.0, 142.0],
        [70.0, 190.0, 112.0],
        [253.0, 231.0, 37.0],
    ];
    let at = share.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let step = (at as usize).min(STOPS.len() - 2);
    let part = at - step as f64;
    Rgb(std::array::from_fn(|channel| {
        let (a, b) = (STOPS[step][channel], STOPS[step + 1][channel]);
        (a + (b - a) * part).round() as u8
    }))
}
