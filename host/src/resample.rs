//! From camera pixels to the outgoing disk.
//!
//! # Design
//! Each cell of the disk is interpolated linearly between the four pixels around its direction. Pixels that do
//! not see the sample take no part; where they would carry more than half of the weight the cell has no value,
//! but their reason.

use glam::DVec3;

use crate::disk::{Disk, bilinear};
use crate::optics::{DirectionMap, Unmeasurable, View};

/// How one cell of the disk is made from camera pixels. A pixel that takes no part has weight 0 and repeats one
/// that does, so that nothing unwanted (a saturated pixel) can slip in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Taps {
    /// Index of the cell.
    pub(crate) cell: u32,
    /// Row-major indices of the pixels.
    pub(crate) pixel: [u32; 4],
    /// Their weights, which sum to 1.
    pub(crate) weight: [f32; 4],
}

/// The way from a camera image to the disk.
#[derive(Debug)]
pub(crate) struct Resampling {
    /// The cells that can be made.
    pub(crate) taps: Vec<Taps>,
    /// Per cell, why there is nothing to take; `None` where there is.
    pub(crate) reasons: Vec<Option<Unmeasurable>>,
    /// Per cell, the solid angle in sr of the camera pixel there; NaN where there is none.
    pub(crate) pixel_sr: Vec<f64>,
}

impl Resampling {
    pub(crate) fn new(camera: &View, disk: Disk) -> Self {
        let map = DirectionMap::of(camera);
        let mut taps = Vec::new();
        let mut pixel_sr = vec![f64::NAN; disk.len()];
        let reasons = (0..disk.len())
            .map(|cell| {
                let w = disk.direction(cell).ok_or(Unmeasurable::BelowHorizon);
                match w.and_then(|w| tap(camera, &map, w)) {
                    Ok((pixel, weight, sr)) => {
                        taps.push(Taps {
                            cell: cell as u32,
                            pixel,
                            weight,
                        });
                        pixel_sr[cell] = sr;
                        None
                    }
                    Err(reason) => Some(reason),
                }
            })
            .collect();
        Self {
            taps,
            reasons,
            pixel_sr,
        }
    }
}

/// The pixels around direction `w` that see the sample, with weights that sum to 1, and the solid angle of the
/// nearest in sr.
fn tap(camera: &View, map: &DirectionMap, w: DVec3) -> Result<([u32; 4], [f32; 4], f64), Unmeasurable> {
    let around = bilinear(camera.pixel(w)?, map.width_px, map.height_px);
    let mut seen = 0.0;
    let mut blind = (0.0, Unmeasurable::OutsideImage);
    for (pixel, weight) in around {
        match map.directions[pixel] {
            Ok(_) => seen += weight,
            Err(reason) if weight >= blind.0 => blind = (weight, reason),
            Err(_) => {}
        }
    }
    if seen < 0.5 {
        // The direction is above the horizon, even if the pixels around it look below: none looks there.
        return Err(match blind.1 {
            Unmeasurable::BelowHorizon => Unmeasurable::OutsideImage,
            reason => reason,
        });
    }
    let is_seen = |pixel: usize| map.directions[pixel].is_ok();
    let heaviest = around
        .iter()
        .filter(|tap| is_seen(tap.0))
        .max_by(|a, b| a.1.total_cmp(&b.1));
    let stand_in = heaviest.map_or(around[0].0, |tap| tap.0);
    let pixel = around.map(|(pixel, weight)| if is_seen(pixel) && weight > 0.0 { pixel } else { stand_in } as u32);
    let weight = around.map(|(pixel, weight)| {
        if is_seen(pixel) {
            (weight / seen) as f32
        } else {
            0.0
        }
    });
    let sr = map.solid_angles_sr[stand_in];
    Ok((pixel, weight, sr))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direction::angle_between;
    use crate::rig::Rig;

    #[test]
    fn taps_interpolate_the_direction_of_their_cell() {
        for preset in ["rcg-1", "rcg-2"] {
            let rig = Rig::load(preset).unwrap().with_image_size(96).unwrap();
            let camera = View::camera(&rig);
            let map = DirectionMap::of(&camera);
            let disk = Disk::new(64);
            let resampling = Resampling::new(&camera, disk);
            for taps in &resampling.taps {
                assert!((taps.weight.iter().sum::<f32>() - 1.0).abs() < 1e-5);
                let mean: DVec3 = taps
                    .pixel
                    .iter()
                    .zip(taps.weight)
                    .map(|(&pixel, weight)| map.directions[pixel as usize].unwrap() * f64::from(weight))
                    .sum();
                let w = disk.direction(taps.cell as usize).unwrap();
                // At the rim of the hole only half of the pixels may see: they stand up to a pixel away.
                let error = angle_between(mean.normalize(), w);
                assert!(
                    error < resampling.pixel_sr[taps.cell as usize].sqrt(),
                    "{preset}: {w} {error}"
                );
            }
        }
    }

    #[test]
    fn every_cell_has_taps_or_a_reason() {
        let rig = Rig::load("rcg-1").unwrap().with_image_size(96).unwrap();
        let disk = Disk::new(96);
        let resampling = Resampling::new(&View::camera(&rig), disk);
        let with_reason = resampling.reasons.iter().flatten().count();
        assert_eq!(resampling.taps.len() + with_reason, disk.len());
        let at = |theta_deg: f64| {
            let position = disk
                .position(crate::direction::from_degrees(theta_deg, 10.0))
                .unwrap();
            resampling.reasons[position.y as usize * 96 + position.x as usize]
        };
        assert_eq!(at(5.0), Some(Unmeasurable::Hole));
        assert_eq!(at(45.0), None);
        assert_eq!(resampling.reasons[0], Some(Unmeasurable::BelowHorizon));
    }
}
