//! From camera pixels to the outgoing disk.
//!
//! # Design
//! Each cell of the disk is interpolated linearly between the four pixels around its direction. Where one of them does not
//! see the sample with all of its area the cell has no value, but that pixel's reason: the others look beside the
//! cell's direction, and how f goes on there is what nobody saw. The flank of a lobe whose peak lies behind the sample's
//! holder may rise tenfold from one pixel to the next.

use glam::DVec3;

use super::surroundings::Surroundings;
use crate::hemisphere::disk::{Disk, bilinear};
use crate::instrument::optics::{DirectionMap, Unmeasurable, View};

/// How one cell of the disk is made from camera pixels. A pixel of weight 0 repeats one that has some, so that nothing
/// unwanted (a saturated pixel) can slip in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Taps {
    /// Index of the cell.
    pub(crate) cell: u32,
    /// Row-major indices of the pixels: two of a row, then two of the next.
    pub(crate) pixel: [u32; 4],
    /// Their weights, which sum to 1.
    pub(crate) weight: [f32; 4],
}

impl Taps {
    /// The cell, and the pixel that makes most of it.
    pub(crate) fn heaviest(&self) -> (usize, usize) {
        let most = (0..self.weight.len()).max_by(|a, b| self.weight[*a].total_cmp(&self.weight[*b]));
        (self.cell as usize, self.pixel[most.unwrap_or(0)] as usize)
    }
}

/// A weight that is nothing but rounding.
const NOTHING: f64 = 1e-9;

/// The way from a camera image to the disk.
#[derive(Debug)]
pub(crate) struct Resampling {
    /// The cells that can be made.
    pub(crate) taps: Vec<Taps>,
    /// Per cell, why there is nothing to take; `None` where there is.
    pub(crate) reasons: Vec<Option<Unmeasurable>>,
    /// Per cell, the solid angle in sr of the camera pixel there; NaN where there is none.
    pub(crate) pixel_sr: Vec<f64>,
    /// If pixels are to know of their surroundings.
    pub(crate) surroundings: Option<Surroundings>,
}

impl Resampling {
    /// From the pixels of `camera`; those take no part for which `cut` has a reason.
    pub(crate) fn new(camera: &View, cut: &[Option<Unmeasurable>], disk: Disk) -> Self {
        let map = DirectionMap::of(camera);
        let mut taps = Vec::new();
        let mut pixel_sr = vec![f64::NAN; disk.len()];
        let reasons = (0..disk.len())
            .map(|cell| {
                let found = disk
                    .direction(cell)
                    .ok_or(Unmeasurable::BelowHorizon)
                    .and_then(|w| tap(camera, &map, cut, w));
                let (pixel, weight, sr) = match found {
                    Ok(found) => found,
                    Err(reason) => return Some(reason),
                };
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
            surroundings: None,
        }
    }
}

/// The pixels around direction `w` and their weights, which sum to 1, and the solid angle of the nearest in sr.
fn tap(
    camera: &View,
    map: &DirectionMap,
    cut: &[Option<Unmeasurable>],
    w: DVec3,
) -> Result<([u32; 4], [f32; 4], f64), Unmeasurable> {
    let around = bilinear(camera.pixel(w)?, map.width_px, map.height_px);
    let blind = around
        .iter()
        .filter(|(_, weight)| *weight > NOTHING)
        .filter_map(|(pixel, weight)| Some((cut[*pixel]?, weight)))
        .max_by(|a, b| a.1.total_cmp(b.1));
    if let Some((reason, _)) = blind {
        // The direction is above the horizon, even if the pixels around it look below: none looks there.
        return Err(match reason {
            Unmeasurable::BelowHorizon => Unmeasurable::OutsideImage,
            reason => reason,
        });
    }
    let heaviest = around.iter().max_by(|a, b| a.1.total_cmp(&b.1));
    let stand_in = heaviest.map_or(around[0].0, |tap| tap.0);
    let counts = |weight: f64| weight > NOTHING;
    let pixel = around.map(|(pixel, weight)| if counts(weight) { pixel } else { stand_in } as u32);
    let weight = around.map(|(_, weight)| if counts(weight) { weight as f32 } else { 0.0 });
    Ok((pixel, weight, map.solid_angles_sr[stand_in]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::angle_between;
    use crate::instrument::rig::Rig;

    #[test]
    fn taps_interpolate_the_direction_of_their_cell() {
        for preset in ["rcg-1-16bit", "rcg-2"] {
            let rig = Rig::load(preset).unwrap().with_image_size(96).unwrap();
            let camera = View::camera(&rig);
            let disk = Disk::new(64);
            let resampling = Resampling::new(&camera, &camera.cut_pixels(0.0), disk);
            let map = DirectionMap::of(&camera);
            for taps in &resampling.taps {
                assert!((taps.weight.iter().sum::<f32>() - 1.0).abs() < 1e-5);
                let w = disk.direction(taps.cell as usize).unwrap();
                let seen = |(pixel, weight): (u32, f32)| {
                    f64::from(weight) * map.directions[pixel as usize].expect("it sees the sample")
                };
                let look: DVec3 = taps.pixel.into_iter().zip(taps.weight).map(seen).sum();
                let error = angle_between(look.normalize(), w);
                let pixel_rad = resampling.pixel_sr[taps.cell as usize].sqrt();
                assert!(error < 0.05 * pixel_rad, "{preset}: {w} {error}");
            }
        }
    }

    #[test]
    fn every_cell_has_taps_or_a_reason() {
        let rig = Rig::load("rcg-1-16bit").unwrap().with_image_size(96).unwrap();
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
