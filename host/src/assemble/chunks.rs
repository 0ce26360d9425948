//! The chunks of the result, made from frames or from the cells that these were shared out into.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use super::coded::Cells;
use super::correction::Correction;
use super::probe::Probe;
use super::projection::Projection;
use super::radiometry::Work;
use super::share::Written;
use super::window::{Agree, Window};
use super::{AssembleError, CHUNK};
use crate::store::{BrdfWriter, RawStore, Segment, StoreError};

/// Chunks that are computed at a time.
const BATCH: usize = 32;

/// What the chunks are made with.
pub(super) struct Chunks<'a> {
    /// Of each incident direction, see [`places`](super::places).
    pub(super) places: Vec<Option<(usize, usize)>>,
    pub(super) projection: Projection,
    pub(super) correction: Correction,
    /// If patterns were codes.
    pub(super) cells: Option<Cells>,
    pub(super) writer: &'a BrdfWriter,
    pub(super) probe: Option<&'a Probe>,
}

impl Chunks<'_> {
    /// Writes the `chunks` of these numbers from the frames at `raw_path`.
    pub(super) fn write(
        &self,
        chunks: Range<usize>,
        raw_path: &Path,
        agree: &Agree<'_>,
        mismatch: impl Fn(String) -> AssembleError,
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<Vec<Written>, AssembleError> {
        let (mut all, mut frames) = (Vec::with_capacity(chunks.len()), 0);
        std::thread::scope(|scope| -> Result<(), AssembleError> {
            let mut window = Window::new(scope, RawStore::open(raw_path)?);
            for first in chunks.clone().step_by(BATCH) {
                let batch = first..(first + BATCH).min(chunks.end);
                let rows = batch.start * CHUNK..(batch.end * CHUNK).min(self.places.len());
                let needed = self.places[rows]
                    .iter()
                    .flatten()
                    .map(|place: &(usize, usize)| place.0);
                let (Some(low), Some(high)) = (needed.clone().min(), needed.max()) else {
                    all.extend(batch.map(Written::nothing));
                    continue;
                };
                window.move_to(low..=high, agree, &mismatch)?;
                let held = window.held();
                let made = batch
                    .into_par_iter()
                    .map_init(Work::default, |work, chunk| self.write_one(chunk, held, work))
                    .collect::<Result<Vec<_>, StoreError>>()?;
                frames += made.iter().map(|one| one.counts.frames).sum::<usize>();
                all.extend(made);
                progress(frames);
            }
            Ok(())
        })?;
        Ok(all)
    }

    /// Writes the `chunks` of these numbers from the cells that all frames were shared out into.
    pub(super) fn write_cells(mut self, chunks: Range<usize>) -> Result<Vec<Written>, StoreError> {
        let mut all = Vec::with_capacity(chunks.len());
        let chunks: Vec<usize> = chunks.collect();
        for batch in chunks.chunks(BATCH) {
            let made = batch
                .par_iter()
                .map_init(Work::default, |work, chunk| {
                    self.write_one(*chunk, &BTreeMap::new(), work)
                })
                .collect::<Result<Vec<_>, StoreError>>()?;
            all.extend(made);
        }
        if let Some(cells) = self.cells.take() {
            cells.remove()?;
        }
        Ok(all)
    }

    /// Writes one chunk, unless it has nothing.
    fn write_one(
        &self,
        chunk: usize,
        window: &BTreeMap<usize, Segment>,
        work: &mut Work,
    ) -> Result<Written, StoreError> {
        let range = chunk * CHUNK..((chunk + 1) * CHUNK).min(self.places.len());
        if self.places[range.clone()].iter().all(Option::is_none) {
            // An absent chunk means missing.
            return Ok(Written::nothing(chunk));
        }
        let places = &self.places[range];
        let mut counts = match &self.cells {
            None => self.projection.rows(chunk * CHUNK, places, window, work),
            Some(cells) => cells.rows(chunk * CHUNK, places, &self.projection, work)?,
        };
        let budget = self
            .correction
            .apply(chunk * CHUNK, &mut work.rows, &work.common, self.probe);
        counts.measured -= work.rows.seal();
        self.writer.write_chunk(chunk, &work.rows)?;
        Ok(Written {
            chunk,
            is_there: true,
            counts,
            budget,
        })
    }
}
