//! Demultiplexing: coded exposures → the frame of each cell, by a fast Walsh–Hadamard transform.
//!
//! # Design
//! S⁻¹·y is −2/(n+1) times the Walsh–Hadamard transform of (0, y), less its first row. That first row is Σ_i y_i, all
//! that the variance needs ([`Code::variance`]).
//!
//! The transform runs over exposures, the same for all pixels. A tile of `LANES` pixels of all exposures is copied
//! to where the first-level cache holds it, transformed by butterflies of whole rows (radix 4), and copied back: main
//! memory is read once and written once. Tiles are independent, so all cores share them.
//!
//! NaN stands for a saturated pixel, and the sums spread it: one saturated exposure spoils all cells of the block at
//! that pixel, as it must.

use rayon::prelude::*;

use super::code::Code;

/// Pixels of a tile: one cache line.
const LANES: usize = 16;
/// Pixels that one task takes.
const TASK: usize = 512;

type Row = [f32; LANES];

/// Turns the exposures of a block into the frames of its cells, in place.
///
/// `frames` is [exposure, pixel] with [`Code::order`] rows of `sums.len()` pixels (any values that are linear in the
/// light, channels as further pixels, dark level subtracted). Afterwards row j holds cell j; the rows of cells that are
/// not used hold noise about 0. `sums` becomes the sum over all exposures of each pixel.
///
/// # Panics
/// If `frames` has another length.
pub fn demultiplex(code: Code, frames: &mut [f32], sums: &mut [f32]) {
    let (order, pixels) = (code.order(), sums.len());
    assert_eq!(frames.len(), order * pixels, "frames are [exposure, pixel]");
    let mut tasks: Vec<(&mut [f32], Vec<&mut [f32]>)> = sums
        .chunks_mut(TASK)
        .map(|sums| (sums, Vec::with_capacity(order)))
        .collect();
    for frame in frames.chunks_exact_mut(pixels.max(1)) {
        for (task, columns) in tasks.iter_mut().zip(frame.chunks_mut(TASK)) {
            task.1.push(columns);
        }
    }
    let scale = -2.0 / (order as f32 + 1.0);
    tasks.into_par_iter().for_each_init(
        || vec![[0.0; LANES]; order + 1],
        |tile, (sums, mut rows)| {
            for from in (0..sums.len()).step_by(LANES) {
                let to = (from + LANES).min(sums.len());
                tile[0] = [0.0; LANES];
                for (tile, row) in tile[1..].iter_mut().zip(&rows) {
                    if let Some(whole) = row.get(from..from + LANES) {
                        tile.copy_from_slice(whole);
                    } else {
                        tile[..to - from].copy_from_slice(&row[from..to]);
                    }
                }
                walsh_hadamard(tile);
                sums[from..to].copy_from_slice(&tile[0][..to - from]);
                for (tile, row) in tile[1..].iter().zip(&mut rows) {
                    for (value, tile) in row[from..to].iter_mut().zip(tile) {
                        *value = tile * scale;
                    }
                }
            }
        },
    );
}

/// The unscaled transform of 2^k rows in natural (Hadamard) order.
fn walsh_hadamard(rows: &mut [Row]) {
    let mut half = 1;
    if rows.len().trailing_zeros() % 2 == 1 {
        for pair in rows.chunks_exact_mut(2) {
            let [a, b] = pair else { unreachable!("two rows") };
            (*a, *b) = (added(a, b), subtracted(a, b));
        }
        half = 2;
    }
    // Two levels at a time: each row is loaded and stored once for both.
    while half < rows.len() {
        for group in rows.chunks_exact_mut(4 * half) {
            let (low, high) = group.split_at_mut(2 * half);
            let (a, b) = low.split_at_mut(half);
            let (c, d) = high.split_at_mut(half);
            for (((a, b), c), d) in a.iter_mut().zip(b).zip(c).zip(d) {
                let (ab, a_b) = (added(a, b), subtracted(a, b));
                let (cd, c_d) = (added(c, d), subtracted(c, d));
                (*a, *b) = (added(&ab, &cd), added(&a_b, &c_d));
                (*c, *d) = (subtracted(&ab, &cd), subtracted(&a_b, &c_d));
            }
        }
        half *= 4;
    }
}

#[inline]
fn added(a: &Row, b: &Row) -> Row {
    std::array::from_fn(|lane| a[lane] + b[lane])
}

#[inline]
fn subtracted(a: &Row, b: &Row) -> Row {
    std::array::from_fn(|lane| a[lane] - b[lane])
}
