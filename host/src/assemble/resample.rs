//! From camera pixels to the outgoing disk.
//!
//! # Design
//! Each cell of the disk is interpolated linearly between the four pixels around its direction. Pixels that do
//! not see the sample with all of their area take no part; where they would carry more than half of the weight the cell
//! has no value, but their reason. Where they carry less, the others look beside the cell's direction, by an angle that
//! is known and enters the uncertainty.

use glam::DVec3;

use crate::hemisphere::disk::{Disk, bilinear};
use crate::instrument::optics::{DirectionMap, Unmeasurable, View};

/// The pixels of a cell are all around it if they look by less than this share of a pixel beside it.
const CENTRED: f64 = 0.1;

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
    /// Per cell, the mean direction of its pixels (unit); where there are none, its own, or `None` beyond the horizon.
    pub(crate) looks: Vec<Option<DVec3>>,
    /// Per cell, the angle in radians by which its pixels look beside it; 0 where they are all around it.
    pub(crate) beside_rad: Vec<f64>,
}

impl Resampling {
    /// From the pixels of `camera`; those take no part for which `cut` has a reason.
    pub(crate) fn new(camera: &View, cut: &[Option<Unmeasurable>], disk: Disk) -> Self {
        let map = DirectionMap::of(camera);
        let mut taps = Vec::new();
        let mut pixel_sr = vec![f64::NAN; disk.len()];
        let mut looks: Vec<Option<DVec3>> = (0..disk.len()).map(|cell| disk.direction(cell)).collect();
        let mut beside_rad = vec![0.0; disk.len()];
        let reasons = (0..disk.len())
            .map(|cell| {
                let found = disk
                    .direction(cell)
                    .ok_or(Unmeasurable::BelowHorizon)
                    .and_then(|w| Ok((w, tap(camera, &map, cut, w)?)));
                let (w, (pixel, weight, sr)) = match found {
                    Ok(found) => found,
                    Err(reason) => return Some(reason),
                };
                let part = |(pixel, weight): (u32, f32)| {
                    Some(f64::from(weight) * map.directions[pixel as usize].ok()?)
                };
                let look = pixel
                    .into_iter()
                    .zip(weight)
                    .filter_map(part)
                    .sum::<DVec3>()
                    .normalize();
                let rad = look.angle_between(w);
                if rad > CENTRED * sr.sqrt() {
                    beside_rad[cell] = rad;
                }
                looks[cell] = Some(look);
                pixel_sr[cell] = sr;
                taps.push(Taps {
                    cell: cell as u32,
                    pixel,
                    weight,
                });
                None
            })
            .collect();
        Self {
            taps,
            reasons,
            pixel_sr,
            looks,
            beside_rad,
        }
    }

    /// Without the cells whose pixels look beside them.
    pub(crate) fn centred(mut self) -> Self {
        let beside_rad = &self.beside_rad;
        self.taps.retain(|taps| beside_rad[taps.cell as usize] <= 0.0);
        self
    }
}

/// The pixels around direction `w` that take part, with weights that sum to 1, and the solid angle of the nearest in sr.
fn tap(
    camera: &View,
    map: &DirectionMap,
    cut: &[Option<Unmeasurable>],
    w: DVec3,
) -> Result<([u32; 4], [f32; 4], f64), Unmeasurable> {
    let around = bilinear(camera.pixel(w)?, map.width_px, map.height_px);
    let mut seen = 0.0;
    let mut blind = (0.0, Unmeasurable::OutsideImage);
    for (pixel, weight) in around {
        match cut[pixel] {
            None => seen += weight,
            Some(reason) if weight >= blind.0 => blind = (weight, reason),
            Some(_) => {}
        }
    }
    if seen < 0.5 {
        // The direction is above the horizon, even if the pixels around it look below: none looks there.
        return Err(match blind.1 {
            Unmeasurable::BelowHorizon => Unmeasurable::OutsideImage,
            reason => reason,
        });
    }
    let is_seen = |pixel: usize| cut[pixel].is_none();
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
    use crate::hemisphere::direction::angle_between;
    use crate::instrument::rig::Rig;

    #[test]
    fn taps_interpolate_the_direction_of_their_cell() {
        for preset in ["rcg-1", "rcg-2"] {
            let rig = Rig::load(preset).unwrap().with_image_size(96).unwrap();
            let camera = View::camera(&rig);
            let disk = Disk::new(64);
            let resampling = Resampling::new(&camera, &camera.cut_pixels(0.0), disk);
            for taps in &resampling.taps {
                assert!((taps.weight.iter().sum::<f32>() - 1.0).abs() < 1e-5);
                let w = disk.direction(taps.cell as usize).unwrap();
                // At the rim of the hole only half of the pixels may see: they stand up to a pixel away.
                let error = angle_between(resampling.looks[taps.cell as usize].unwrap(), w);
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
        let camera = View::camera(&rig);
        let resampling = Resampling::new(&camera, &camera.cut_pixels(0.0), disk);
        let with_reason = resampling.reasons.iter().flatten().count();
        assert_eq!(resampling.taps.len() + with_reason, disk.len());
        let at = |theta_deg: f64| {
            let position = disk
                .position(crate::hemisphere::direction::from_degrees(theta_deg, 10.0))
                .unwrap();
            resampling.reasons[position.y as usize * 96 + position.x as usize]
        };
        assert_eq!(at(5.0), Some(Unmeasurable::Hole));
        assert_eq!(at(45.0), None);
        assert_eq!(resampling.reasons[0], Some(Unmeasurable::BelowHorizon));
    }
}
