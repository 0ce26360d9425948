//! Directions and solid angles of a view's pixels, traced where they are first asked for.
//!
//! # Design
//! A pattern lights some hundred of a projector's millions of pixels. They are traced by squares of [`TILE_PX`], each
//! once, by whoever asks first; values are those of [`super::DirectionMap`] to the bit.

use std::ops::Range;
use std::sync::OnceLock;

use glam::DVec3;
use rayon::prelude::*;

use super::map::trace_rows;
use super::{Unmeasurable, View};

/// Side of what is traced at once, pixels.
const TILE_PX: usize = 16;

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
        let (width_px, height_px) = view.size_px();
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

    /// Direction (sample frame, unit, away from the surface) and solid angle (steradians) of the pixel with the
    /// row-major index `index`; `None` where it sees none, or lies outside of the image.
    #[must_use]
    pub fn pixel(&self, index: usize) -> Option<(DVec3, f64)> {
        let (width_px, height_px) = self.view.size_px();
        let (column, row) = (index % width_px, index / width_px);
        if row >= height_px {
            return None;
        }
        let across = column / TILE_PX;
        let tile = row / TILE_PX * width_px.div_ceil(TILE_PX) + across;
        // The last one of a row may be narrower.
        let columns = TILE_PX.min(width_px - across * TILE_PX);
        let (direction, sr) = self.tile(tile)[(row % TILE_PX) * columns + column % TILE_PX];
        Some((direction.ok()?, sr))
    }

    /// Those of the pixels with the row-major indices `of` that see a direction. What lies side by side, ascending, is looked up
    /// together.
    #[must_use]
    pub fn seeing(&self, of: &[u32]) -> Vec<u32> {
        let (width_px, height_px) = self.view.size_px();
        let (mut row, mut from) = (0..0, 0);
        let (mut tile, mut values): (Range<usize>, &[Traced]) = (0..0, &[]);
        let sees = |pixel: &u32| {
            let index = *pixel as usize;
            if !row.contains(&index) {
                from = index / width_px;
                row = from * width_px..(from + 1) * width_px;
                tile = 0..0;
            }
            if from >= height_px {
                return false;
            }
            let column = index - row.start;
            if !tile.contains(&column) {
                let across = column / TILE_PX;
                tile = across * TILE_PX..((across + 1) * TILE_PX).min(width_px);
                let all = self.tile(from / TILE_PX * width_px.div_ceil(TILE_PX) + across);
                values = &all[(from % TILE_PX) * tile.len()..][..tile.len()];
            }
            values[column - tile.start].0.is_ok()
        };
        of.iter().copied().filter(sees).collect()
    }

    /// Traces all that is not yet, on all cores: for who will ask for every pixel.
    pub fn trace_all(&self) {
        (0..self.tiles.len()).into_par_iter().for_each(|tile| {
            self.tile(tile);
        });
    }

    /// The pixels of a tile, row by row.
    fn tile(&self, tile: usize) -> &[Traced] {
        self.tiles[tile].get_or_init(|| {
            let [columns, rows] = self.span(tile);
            trace_rows(&self.view, columns, rows).collect()
        })
    }

    /// Columns and rows of a tile.
    fn span(&self, tile: usize) -> [Range<usize>; 2] {
        let (width_px, height_px) = self.view.size_px();
        let across = width_px.div_ceil(TILE_PX);
        [(tile % across, width_px), (tile / across, height_px)]
            .map(|(at, size)| at * TILE_PX..((at + 1) * TILE_PX).min(size))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instrument::optics::DirectionMap;
    use crate::instrument::rig::Rig;

    #[test]
    fn every_pixel_is_that_of_the_map() {
        for (preset, size_px) in [("rcg-1-16bit", 75), ("rcg-2", 64)] {
            let view = View::camera(&Rig::load(preset).unwrap().with_image_size(size_px).unwrap());
            let map = DirectionMap::of(&view);
            let tiles = DirectionTiles::of(view);
            assert_eq!(tiles.view().size_px(), (map.width_px, map.height_px));
            for (index, (direction, &sr)) in map.directions.iter().zip(&map.solid_angles_sr).enumerate() {
                assert_eq!(
                    tiles.pixel(index),
                    direction.ok().map(|direction| (direction, sr))
                );
                let index = index as u32;
                let seeing = if direction.is_ok() {
                    vec![index]
                } else {
                    Vec::new()
                };
                assert_eq!(tiles.seeing(&[index]), seeing);
            }
            let all: Vec<u32> = (0..=map.directions.len() as u32).collect();
            let seeing = all
                .iter()
                .copied()
                .filter(|pixel| tiles.pixel(*pixel as usize).is_some());
            assert_eq!(tiles.seeing(&all), seeing.collect::<Vec<_>>());
            assert_eq!(tiles.pixel(map.directions.len()), None);
        }
    }
}
