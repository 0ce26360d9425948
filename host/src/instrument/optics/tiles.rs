//! Directions and solid angles of a view's pixels, traced where they are first asked for.
//!
//! # Design
//! A pattern lights some hundred of a projector's millions of pixels. They are traced by squares of [`TILE_PX`], each
//! once, by whoever asks first; values are those of [`super::DirectionMap`] to the bit.

use std::sync::OnceLock;

use glam::DVec3;
use rayon::prelude::*;

use super::map::trace_rows;
use super::{Unmeasurable, View};

/// Side of what is traced at once, pixels.
const TILE_PX: usize = 32;

/// Direction (sample frame, unit, away from the surface) or why there is none, and solid angle in steradians.
type Traced = (Result<DVec3, Unmeasurable>, f64);

/// The pixels of a view.
#[derive(Debug)]
pub struct DirectionTiles {
    view: View,
    tiles: Vec<OnceLock<Box<[Traced]>>>,
}

impl DirectionTiles {
    /// Those of `view`; nothing is traced yet.
    #[must_use]
    pub fn of(view: View) -> Self {
        let (width_px, height_px) = size_px(&view);
        let tiles = width_px.div_ceil(TILE_PX) * height_px.div_ceil(TILE_PX);
        Self {
            view,
            tiles: (0..tiles).map(|_| OnceLock::new()).collect(),
        }
    }

    /// The view.
    #[must_use]
    pub const fn view(&self) -> &View {
        &self.view
    }

    /// Size of its image in pixels (width, height).
    #[must_use]
    pub fn size_px(&self) -> (usize, usize) {
        size_px(&self.view)
    }

    /// Direction (sample frame, unit, away from the surface) and solid angle (steradians) of the pixel with the
    /// row-major index `index`; `None` where it sees none, or lies outside of the image.
    #[must_use]
    pub fn pixel(&self, index: usize) -> Option<(DVec3, f64)> {
        let (width_px, height_px) = self.size_px();
        let (column, row) = (index % width_px, index / width_px);
        if row >= height_px {
            return None;
        }
        let (across, down) = (column / TILE_PX, row / TILE_PX);
        let columns = across * TILE_PX..((across + 1) * TILE_PX).min(width_px);
        let traced = self.tile(across, down)[(row % TILE_PX) * columns.len() + column % TILE_PX];
        Some((traced.0.ok()?, traced.1))
    }

    /// Traces all that is not yet, on all cores: for who will ask for every pixel.
    pub fn trace_all(&self) {
        let across = self.size_px().0.div_ceil(TILE_PX);
        (0..self.tiles.len()).into_par_iter().for_each(|tile| {
            self.tile(tile % across, tile / across);
        });
    }

    fn tile(&self, across: usize, down: usize) -> &[Traced] {
        let (width_px, height_px) = self.size_px();
        let span = |tile: usize, size: usize| tile * TILE_PX..((tile + 1) * TILE_PX).min(size);
        self.tiles[down * width_px.div_ceil(TILE_PX) + across]
            .get_or_init(|| trace_rows(&self.view, span(across, width_px), span(down, height_px)).collect())
    }
}

fn size_px(view: &View) -> (usize, usize) {
    (
        view.pinhole().width_px() as usize,
        view.pinhole().height_px() as usize,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instrument::optics::DirectionMap;
    use crate::instrument::rig::Rig;

    #[test]
    fn every_pixel_is_that_of_the_map() {
        for (preset, size_px) in [("rcg-1", 75), ("rcg-2", 64)] {
            let view = View::camera(&Rig::load(preset).unwrap().with_image_size(size_px).unwrap());
            let map = DirectionMap::of(&view);
            let tiles = DirectionTiles::of(view);
            assert_eq!(tiles.size_px(), (map.width_px, map.height_px));
            for (index, (direction, &sr)) in map.directions.iter().zip(&map.solid_angles_sr).enumerate() {
                assert_eq!(
                    tiles.pixel(index),
                    direction.ok().map(|direction| (direction, sr))
                );
            }
            assert_eq!(tiles.pixel(map.directions.len()), None);
        }
    }
}
