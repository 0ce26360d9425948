//! Projector pixels that watch the lamp.
//!
//! # Design
//! What the projector shows beside the mirror lights no sample, but some of it comes directly into the camera, and there into
//! pixels that are dark otherwise. Lit in every pattern, the black one too, it tells how bright the lamp was in each exposure;
//! whatever else it does is the same in all of them and goes with the black ones.
//!
//! The image is cut into blocks of [`BLOCK_PX`], in the middle of which a square of `side` pixels is lit. So its light grows with
//! side², wherever the projector is brighter or darker.

use crate::instrument::optics::View;
use crate::instrument::rig::Rig;

/// Side of a block in pixels, and so the largest side of what is lit in it.
pub const BLOCK_PX: u32 = 16;
/// No block is nearer to what the mirror may reflect, heights of the image.
const CLEAR: f64 = 0.022;

/// Row-major indices of the pixels of the projector of `rig` that watch the lamp, with a square of `side` pixels (up to
/// [`BLOCK_PX`]) in each block; none for 0.
#[must_use]
pub fn watching(rig: &Rig, side: u32) -> Vec<u32> {
    let (width_px, height_px) = (rig.projector.lens.width_px, rig.projector.lens.height_px);
    let projector = View::projector(rig);
    let side = side.min(BLOCK_PX);
    let first = (BLOCK_PX - side) / 2;
    let mut pixels = Vec::new();
    for top in (0..=height_px.saturating_sub(BLOCK_PX)).step_by(BLOCK_PX as usize) {
        for left in (0..=width_px.saturating_sub(BLOCK_PX)).step_by(BLOCK_PX as usize) {
            if side == 0 || !is_beside(&projector, [left, top, BLOCK_PX, BLOCK_PX]) {
                continue;
            }
            for y in top + first..(top + first + side).min(height_px) {
                let row = y * width_px + left + first;
                pixels.extend(row..row + side);
            }
        }
    }
    pixels
}

/// Whether all light of a part of the image ([left, top, width, height] in pixels) passes beside the mirror, and more than a little.
pub(crate) fn is_beside(projector: &View, [left, top, width, height]: [u32; 4]) -> bool {
    let clear_px = CLEAR * projector.size_px().1 as f64;
    // Its ends and the places between them, no farther apart than those of a block.
    let places = |size_px: u32| {
        let reach_px = f64::from(size_px) + 2.0 * clear_px;
        let gaps = (2.0 * reach_px / (f64::from(BLOCK_PX) + 2.0 * clear_px)).ceil();
        (0..=gaps as u32).map(move |place| f64::from(place) / gaps * reach_px - clear_px)
    };
    let rim_rad = |x: f64, y: f64| projector.edge_distances_rad(f64::from(left) + x, f64::from(top) + y)[1];
    places(height).all(|y| places(width).all(|x| rim_rad(x, y).is_none_or(|rad| rad < 0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instrument::optics::DirectionTiles;

    #[test]
    fn watching_pixels_light_no_sample_and_grow_with_the_square_of_their_side() {
        for preset in crate::instrument::rig::PRESETS {
            let rig = Rig::load(preset).unwrap();
            let tiles = DirectionTiles::of(View::projector(&rig));
            let (whole, some) = (watching(&rig, BLOCK_PX), watching(&rig, 4));
            let blocks = whole.len() / (BLOCK_PX * BLOCK_PX) as usize;
            assert!(blocks > 300, "{preset}: {blocks}");
            assert_eq!((whole.len(), some.len()), (blocks * 256, blocks * 16), "{preset}");
            assert!(whole.iter().all(|pixel| tiles.pixel(*pixel as usize).is_none()));
            assert!(some.iter().all(|pixel| whole.contains(pixel)), "{preset}");
            assert!(watching(&rig, 0).is_empty());
        }
    }
}
