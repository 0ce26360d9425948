//! All images of a file in memory.

use rayon::prelude::*;

use super::{Brdf, BrdfError};
use crate::brdf::interpolation::Image;

/// Memory that a file may take as a whole, in bytes.
const MOST_BYTES: usize = 8_000_000_000;

/// f of every incident direction.
#[derive(Debug)]
pub(super) struct Images {
    cells: usize,
    channels: usize,
    /// f in sr⁻¹, [incident, cell, channel]; NaN where there is none.
    f: Vec<f32>,
}

impl Images {
    /// Reads those of `brdf`.
    ///
    /// # Errors
    /// [`BrdfError`] if they cannot be read or do not fit into memory.
    pub(super) fn read(brdf: &Brdf) -> Result<Self, BrdfError> {
        let (cells, channels) = (brdf.disk.len(), brdf.channels());
        let samples = brdf.grid.len() * cells;
        let bytes = samples * channels * size_of::<f32>();
        if bytes > MOST_BYTES {
            return Err(brdf.too_large(MOST_BYTES, bytes));
        }
        let mut f = vec![f32::NAN; samples * channels];
        // All chunks but the last have as many rows as the first.
        let chunk = brdf.chunk_range(0).len() * cells * channels;
        f.par_chunks_mut(chunk)
            .enumerate()
            .try_for_each(|(index, f)| -> Result<(), BrdfError> {
                if let Some(rows) = brdf.chunk(index)? {
                    f.copy_from_slice(&rows.f);
                }
                Ok(())
            })?;
        Ok(Self { cells, channels, f })
    }

    /// The image of incident direction `row`.
    pub(super) fn of(&self, row: usize) -> Image<'_> {
        Image {
            f: &self.f[row * self.cells * self.channels..][..self.cells * self.channels],
            provenance: None,
            channels: self.channels,
        }
    }
}
