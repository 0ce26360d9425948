//! Blocks of cells that share no projector pixel.
//!
//! # Design
//! Cell j of block b is direction b + j·(number of blocks): a block is a comb over the whole hemisphere, in which
//! neighbours of the incident set are never together. So their spots do not touch, and each pixel of the camera gets
//! about the same light from every block. Where spots overlap all the same (a spot wider than the stride), the
//! binary pattern would light the common pixels once and not twice; that is refused, not mended.

use std::collections::HashMap;

use super::code::{Code, CodeError};
use crate::plan::pattern::LitSet;

/// Directions split into blocks of at most `order` cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blocks {
    directions: usize,
    count: usize,
}

/// Cells that cannot be lit together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CellError {
    /// No code has as many cells.
    #[error(transparent)]
    Code(#[from] CodeError),
    /// The order is larger than the number of directions.
    #[error(
        "order: expected at most the {directions} cells (incident directions that can be lit), found {order}"
    )]
    TooFew {
        /// Cells that there are.
        directions: usize,
        /// What was asked for.
        order: usize,
    },
    /// Frames of a block of so many cells would fill the memory.
    #[error(
        "light: expected at most {most} cells (incident directions) of a block, whose frames are held in memory together, found \
         {order}"
    )]
    TooLarge {
        /// Cells whose frames can be held.
        most: usize,
        /// What was asked for.
        order: usize,
    },
    /// Two cells of a block have a projector pixel in common.
    #[error(
        "cells of one block: expected disjoint patterns, found projector pixel {pixel} in those of incident directions \
         {first} and {second} (a smaller order or a smaller light.spot_deg keeps them apart)"
    )]
    Overlap {
        /// The pixel, row-major.
        pixel: u32,
        /// Number of the one direction among those that can be lit.
        first: usize,
        /// Number of the other.
        second: usize,
    },
}

impl Blocks {
    /// `directions` directions in blocks of at most `order` cells, as equal in size as can be.
    ///
    /// # Errors
    /// [`CellError::Code`] for an order of 0 or beyond the largest code, [`CellError::TooFew`] for more cells than
    /// directions.
    pub fn new(directions: usize, order: usize) -> Result<Self, CellError> {
        Code::for_cells(order)?;
        if order > directions {
            return Err(CellError::TooFew { directions, order });
        }
        Ok(Self {
            directions,
            count: directions.div_ceil(order),
        })
    }

    /// Number of blocks.
    #[must_use]
    pub const fn count(self) -> usize {
        self.count
    }

    /// The directions of a block, in the order of its cells.
    pub fn cells(self, block: usize) -> impl Iterator<Item = usize> + Clone {
        (block..self.directions).step_by(self.count)
    }

    /// The code of a block.
    #[must_use]
    pub fn code(self, block: usize) -> Code {
        Code::for_cells(self.cells(block).count())
            .expect("no block is larger than the order that was checked")
    }

    /// Exposures of all blocks.
    #[must_use]
    pub fn exposures(self) -> usize {
        (0..self.count).map(|block| self.code(block).order()).sum()
    }
}

/// Refuses cells that have a pixel in common; `cells` are numbers of directions with what each lights.
///
/// # Errors
/// [`CellError::Overlap`] with the first two that do.
pub fn check_disjoint<'a>(cells: impl IntoIterator<Item = (usize, &'a LitSet)>) -> Result<(), CellError> {
    let mut owner = HashMap::new();
    for (second, lit) in cells {
        for &pixel in &lit.pixels {
            if let Some(first) = owner.insert(pixel, second) {
                return Err(CellError::Overlap { pixel, first, second });
            }
        }
    }
    Ok(())
}

/// The blocks of `cells`, each with what it lights, of at most `order` cells, none of which overlap.
///
/// # Errors
/// As [`Blocks::new`] and [`check_disjoint`].
pub fn disjoint_blocks(cells: &[LitSet], order: usize) -> Result<Blocks, CellError> {
    let blocks = Blocks::new(cells.len(), order)?;
    for block in 0..blocks.count() {
        check_disjoint(blocks.cells(block).map(|cell| (cell, &cells[cell])))?;
    }
    Ok(blocks)
}

/// The pixels that `exposure` of `code` lights: the union of its lit cells. `cells` is in the order of the code.
#[must_use]
pub fn union(code: Code, exposure: usize, cells: &[&LitSet]) -> Vec<u32> {
    let lit = cells
        .iter()
        .enumerate()
        .filter(|(cell, _)| code.lights(exposure, *cell));
    lit.flat_map(|(_, set)| set.pixels.iter().copied()).collect()
}
