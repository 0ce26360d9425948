//! Which pixels see the sample with all of their area.
//!
//! # Design
//! A pixel that the horizon, an edge of the sample, of the hole or of the rim, the wire or an obstacle cuts collects light from a part
//! of its area only, and what it reads is less than its direction's. A pixel is whole if its centre and its four corners
//! see the sample, each clear of the edges, and no two of them lie on different sides of the wire. Edges are straight
//! enough over a pixel for the corners to speak for all of its border.

use glam::DVec2;
use rayon::prelude::*;

use super::{Unmeasurable, View};

impl View {
    /// For each pixel, row by row from the top, why it does not see the sample as a whole, at least `clearance_rad` radians
    /// (seen from F1) from the edges of hole, rim and wire; `None` where it does.
    pub fn cut_pixels(&self, clearance_rad: f64) -> Vec<Option<Unmeasurable>> {
        let (width_px, height_px) = (self.pinhole.width_px(), self.pinhole.height_px());
        (0..width_px * height_px)
            .into_par_iter()
            .map(|index| {
                let corner = DVec2::new(f64::from(index % width_px), f64::from(index / width_px));
                self.sees_whole(corner, clearance_rad).err()
            })
            .collect()
    }

    /// Whether the pixel whose upper left corner is `corner` is whole.
    fn sees_whole(&self, corner: DVec2, clearance_rad: f64) -> Result<(), Unmeasurable> {
        const PLACES: [[f64; 2]; 5] = [[0.5, 0.5], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        if !self.obstacles.is_empty() && self.may_hold_obstacle(corner) {
            return Err(Unmeasurable::Occluded);
        }
        let mut side_before = None;
        for place in PLACES {
            let at = corner + DVec2::from_array(place);
            let reflection = self.reflect_pixel(at).ok_or(Unmeasurable::OutsideImage)?;
            self.admit(&reflection)?;
            self.reach_sample(&reflection)?;
            let from_f1 = reflection.mirror_m - self.ellipsoid.f1();
            let side = self.wire.and_then(|wire| wire.is_left(from_f1));
            let across = side_before.is_some() && side.is_some() && side != side_before;
            side_before = side_before.or(side);
            match self.edge_within_of(&reflection, clearance_rad) {
                Some(reason) => return Err(reason),
                None if across => return Err(Unmeasurable::Occluded),
                None => {}
            }
        }
        Ok(())
    }
}

impl View {
    /// Whether an obstacle, be it smaller than the pixel whose upper left corner is `corner`, may be in it.
    fn may_hold_obstacle(&self, corner: DVec2) -> bool {
        let at = |x: f64, y: f64| self.from_f1(corner.x + x, corner.y + y);
        let Some(middle) = at(0.5, 0.5) else { return false };
        let corners = [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)];
        let radius_rad = corners
            .into_iter()
            .flatten()
            .map(|w| w.angle_between(middle))
            .fold(0.0, f64::max);
        self.is_behind_obstacle(middle, radius_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instrument::rig::Rig;

    /// A pixel's area in 15 × 15 places.
    fn sees_all_over(view: &View, index: usize, width_px: usize) -> bool {
        let (x, y) = ((index % width_px) as f64, (index / width_px) as f64);
        (0..225).all(|part| {
            let place = |step: usize| (step as f64 + 0.5) / 15.0;
            view.direction(x + place(part % 15), y + place(part / 15)).is_ok()
        })
    }

    #[test]
    fn a_pixel_is_occluded_only_where_the_wire_is() {
        for preset in ["rcg-1-16bit", "dmd"] {
            for (size, azimuth_deg) in [
                (40, None),
                (48, None),
                (41, None),
                (48, Some(0.0)),
                (47, Some(33.0)),
            ] {
                let mut rig = Rig::load(preset).unwrap().with_image_size(size).unwrap();
                let wire = rig.wire.as_mut().expect("a preset with a wire");
                wire.azimuth_deg = azimuth_deg.unwrap_or(wire.azimuth_deg);
                let view = View::camera(&rig);
                let size = size as usize;
                let occluded = |index: usize| {
                    let (x, y) = ((index % size) as f64, (index / size) as f64);
                    (0..1681).any(|part| {
                        let place = |step: usize| (step as f64 - 10.0) / 20.0;
                        view.direction(x + place(part % 41), y + place(part / 41))
                            == Err(Unmeasurable::Occluded)
                    })
                };
                for (index, reason) in view.cut_pixels(0.0).iter().enumerate() {
                    // Half a pixel around is searched too: a strip may be thinner than the places lie apart.
                    assert!(
                        *reason != Some(Unmeasurable::Occluded) || occluded(index),
                        "{preset}, {size}: {index}"
                    );
                }
            }
        }
    }

    #[test]
    fn whole_pixels_see_with_all_of_their_area_and_the_others_do_not() {
        for (preset, size, thin) in [
            ("rcg-1-16bit", 32, false),
            ("rcg-1-16bit", 48, true),
            ("rcg-2", 24, false),
            ("dmd", 40, false),
        ] {
            let mut rig = Rig::load(preset).unwrap().with_image_size(size).unwrap();
            rig.camera.lens.offset_m = [1e-3, -2e-3, 5e-4];
            if let Some(wire) = rig.wire.as_mut().filter(|_| thin) {
                wire.half_width_deg = 0.1;
            }
            let view = View::camera(&rig);
            let cut = view.cut_pixels(0.0);
            let (mut whole, mut differ) = (0, 0);
            for (index, reason) in cut.iter().enumerate() {
                whole += u32::from(reason.is_none());
                let truly = sees_all_over(&view, index, size as usize);
                assert!(truly || reason.is_some(), "{preset}: {index}");
                differ += u32::from(truly != reason.is_none());
            }
            // A corner may be cut that no place within shows.
            assert!(whole > 200 && differ < whole / 20, "{preset}: {whole} {differ}");
            let clear = view.cut_pixels(0.02);
            let fewer = clear.iter().filter(|reason| reason.is_none()).count();
            assert!(fewer as u32 <= whole, "{preset}");
            assert!(
                cut.iter()
                    .zip(&clear)
                    .all(|(cut, clear)| cut.is_none() || clear.is_some())
            );
        }
    }
}
