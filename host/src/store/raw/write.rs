//! How segments come into the file.
//!
//! # Design
//! Frames go to the disk from where they lie, one behind the other, under a temporary name; a segment is never copied together. It
//! becomes whole with [`SegmentWriter::finish`], which keeps the order that a crash can rely on: seal and frames of before go, records
//! and tally come, then the frames get their name, then the seal.

use std::fs::File;
use std::sync::{MutexGuard, PoisonError};

use super::{Progress, RawStore, Segment, describe};
use crate::store::chunk::ChunkWriter;
use crate::store::{ExposureRecord, StoreError, Tally};

/// Samples that are narrowed to bytes at a time.
const NARROWED: usize = 1 << 16;

/// The next segment of a file on its way to the disk, frame by frame.
#[derive(Debug)]
pub struct SegmentWriter<'a> {
    store: &'a RawStore,
    index: usize,
    frames: ChunkWriter<'a>,
}

impl SegmentWriter<'_> {
    /// Adds `frames`, each the little-endian bytes of its samples, axes y, x, channel, row-major.
    ///
    /// # Errors
    /// [`StoreError::Argument`] if there are more than the segment has exposures, or if a sample has more bits than the layout says: nothing was
    /// added then. [`StoreError::DiskFull`] or [`StoreError::Io`].
    pub fn push(&mut self, frames: &[&[u8]]) -> Result<(), StoreError> {
        let bits = self.store.layout.bits;
        if bits != 8 && bits != 16 {
            let largest = frames.iter().flat_map(|frame| samples(frame, bits)).max();
            self.store.check_sample(self.index, largest)?;
        }
        self.frames.push(frames)
    }

    /// Adds `samples` as they are; they were checked.
    fn push_samples(&mut self, samples: &[u16]) -> Result<(), StoreError> {
        if self.store.layout.bits <= 8 {
            let mut narrow = Vec::with_capacity(NARROWED.min(samples.len()));
            for piece in samples.chunks(NARROWED) {
                narrow.clear();
                // Every sample fits.
                narrow.extend(piece.iter().map(|&sample| sample as u8));
                self.frames.push(&[&narrow])?;
            }
            return Ok(());
        }
        if cfg!(target_endian = "big") {
            let swapped: Vec<u8> = samples.iter().flat_map(|sample| sample.to_le_bytes()).collect();
            return self.frames.push(&[&swapped]);
        }
        self.frames.push(&[bytemuck::cast_slice(samples)])
    }

    /// Frames that are still missing, 0 of a segment that can be finished.
    #[must_use]
    pub fn missing(&self) -> usize {
        let range = self.store.segment_range(self.index).len();
        let frame = self.store.frames.bytes_of(self.index) / range.max(1);
        self.frames.missing().div_ceil(frame.max(1))
    }

    /// Makes the segment whole: all of its frames are there, each has its record in `records`, in their order.
    ///
    /// # Errors
    /// [`StoreError::Argument`] if frames or records are missing or too many. [`StoreError::DiskFull`] or [`StoreError::Io`]: the segment is not
    /// whole and can be written again.
    pub fn finish(self, records: &[ExposureRecord], tally: &Tally) -> Result<(), StoreError> {
        if self.missing() > 0 {
            let what = format!("frames of segment {}", self.index);
            let found = format!("{} less", self.missing());
            let expected = self.store.segment_range(self.index).len().to_string();
            return Err(StoreError::argument(
                self.store.store.root(),
                what,
                expected,
                found,
            ));
        }
        self.store.check_records(self.index, records.len())?;
        self.seal(records, tally)
    }

    /// As [`finish`](Self::finish) where frames are missing at the end: they, and their records, are no data.
    ///
    /// # Errors
    /// As for [`finish`](Self::finish).
    pub fn finish_short(self, mut records: Vec<ExposureRecord>, tally: &Tally) -> Result<(), StoreError> {
        let (store, index, missing) = (self.store, self.index, self.missing());
        let exposures = store.segment_range(index).len();
        store.check_records(index, records.len() + missing)?;
        records.resize(exposures, ExposureRecord::NONE);
        self.seal(&records, tally)
    }

    fn seal(self, records: &[ExposureRecord], tally: &Tally) -> Result<(), StoreError> {
        let (store, index) = (self.store, self.index);
        let mut progress = store.progress();
        store.expect_next(index, &mut progress)?;
        progress.next = Some(index);
        self.commit(records, tally)?;
        progress.next = Some(index + 1);
        Ok(())
    }

    /// Writes what is not frames, and names these.
    fn commit(self, records: &[ExposureRecord], tally: &Tally) -> Result<(), StoreError> {
        let Self { store, index, frames } = self;
        store.seals.erase(index)?;
        store.frames.erase(index)?;
        store.records.write(index, records)?;
        store.tallies.write(index, tally)?;
        frames.finish()?;
        store.seals.write(index, store.parts())
    }
}

/// The samples in the little-endian bytes of a frame of so many `bits`.
fn samples(frame: &[u8], bits: u8) -> impl Iterator<Item = u16> + '_ {
    let bytes = if bits <= 8 { 1 } else { 2 };
    frame
        .chunks(bytes)
        .map(|sample| u16::from_le_bytes([sample[0], sample.get(1).copied().unwrap_or(0)]))
}

impl RawStore {
    /// Begins segment `index`, which must be the next one or, again, the one written last; its frames come one by one.
    ///
    /// # Errors
    /// [`StoreError::Argument`] if it is another segment; [`StoreError::DiskFull`] or [`StoreError::Io`].
    pub fn begin_segment(&self, index: usize) -> Result<SegmentWriter<'_>, StoreError> {
        let mut progress = self.progress();
        self.expect_next(index, &mut progress)?;
        self.begin(index, &mut progress)
    }

    /// Writes segment `index`, which must be the next one or, again, the one written last.
    ///
    /// # Errors
    /// [`StoreError::Argument`] if it is another segment, if the lengths are not those of
    /// [`Self::segment_range`], or if a sample has more bits than the layout says: nothing is
    /// written then. [`StoreError::DiskFull`] or [`StoreError::Io`]: the segment is not whole and
    /// can be written again.
    pub fn write_segment(&self, index: usize, segment: &Segment) -> Result<(), StoreError> {
        self.write_frames(index, &[&segment.frames], &segment.records, &segment.tally)
    }

    /// As [`write_segment`](Self::write_segment), with `frames` that need not lie together: their samples follow each other in the order of the
    /// slices.
    ///
    /// # Errors
    /// As for [`write_segment`](Self::write_segment).
    pub fn write_frames(
        &self,
        index: usize,
        frames: &[impl AsRef<[u16]>],
        records: &[ExposureRecord],
        tally: &Tally,
    ) -> Result<(), StoreError> {
        self.check(index, frames, records)?;
        let mut progress = self.progress();
        self.expect_next(index, &mut progress)?;
        progress.next = Some(index);
        self.put(index, frames, records, tally, &mut progress)?;
        progress.next = Some(index + 1);
        Ok(())
    }

    /// Writes segment `index`, whichever others are there, in place of an older one: of captures in which each segment is one by itself.
    ///
    /// # Errors
    /// As for [`write_segment`](Self::write_segment).
    pub fn put_segment(&self, index: usize, segment: &Segment) -> Result<(), StoreError> {
        let frames = [&segment.frames];
        self.check(index, &frames, &segment.records)?;
        let mut progress = self.progress();
        progress.next = None;
        self.put(index, &frames, &segment.records, &segment.tally, &mut progress)
    }

    /// Ends the file after so many `exposures`, at least 1 and no more than it was made for: of captures of which nobody knew before how
    /// many there would be. What was written beyond is no part of it any more.
    ///
    /// # Errors
    /// [`StoreError::Argument`] for another number; [`StoreError::DiskFull`] or [`StoreError::Io`], after which the file may be refused.
    pub fn end_after(self, exposures: usize) -> Result<Self, StoreError> {
        let root = self.store.root().to_owned();
        if !(1..=self.layout.exposures).contains(&exposures) {
            let expected = format!("1 to {}", self.layout.exposures);
            return Err(StoreError::argument(
                &root,
                "exposures",
                expected,
                exposures.to_string(),
            ));
        }
        let layout = super::RawLayout {
            exposures,
            ..self.layout
        };
        describe(&self.store, &layout, &self.attributes)?;
        Self::open(&root)
    }

    /// Waits until the disk has the frames that were written: what a killed process leaves needs that not, a computer without power does.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub fn sync(&self) -> Result<(), StoreError> {
        for path in (0..self.segments()).map(|index| self.frames.path_of(index)) {
            if path.is_file() {
                File::open(&path)
                    .and_then(|file| file.sync_all())
                    .map_err(|error| StoreError::io(&path, "write", error))?;
            }
        }
        Ok(())
    }

    fn progress(&self) -> MutexGuard<'_, Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Refuses a segment `index` that is neither the next one nor the one written last.
    fn expect_next(&self, index: usize, progress: &mut Progress) -> Result<(), StoreError> {
        let next = match progress.next {
            Some(next) => next,
            None => self.count_whole_segments()?,
        };
        progress.next = Some(next);
        if index == next || index.checked_add(1) == Some(next) {
            return Ok(());
        }
        Err(StoreError::argument(
            self.store.root(),
            "index of the segment to write",
            format!("{next}, the next one"),
            index.to_string(),
        ))
    }

    /// Refuses a segment `index` that is not as the layout says.
    fn check(
        &self,
        index: usize,
        frames: &[impl AsRef<[u16]>],
        records: &[ExposureRecord],
    ) -> Result<(), StoreError> {
        let samples = || frames.iter().map(AsRef::as_ref);
        self.frames.check_len(index, samples().map(<[u16]>::len).sum())?;
        self.check_records(index, records.len())?;
        let largest = samples().filter_map(|frame| frame.iter().copied().max()).max();
        self.check_sample(index, largest)
    }

    fn check_records(&self, index: usize, found: usize) -> Result<(), StoreError> {
        let expected = self.segment_range(index).len();
        if found == expected {
            return Ok(());
        }
        Err(StoreError::argument(
            self.store.root(),
            format!("records of segment {index}"),
            expected.to_string(),
            found.to_string(),
        ))
    }

    /// Refuses a `largest` sample of segment `index` that has more bits than the layout says.
    fn check_sample(&self, index: usize, largest: Option<u16>) -> Result<(), StoreError> {
        let allowed = self.layout.largest_sample();
        match largest.filter(|&sample| sample > allowed) {
            None => Ok(()),
            Some(sample) => Err(StoreError::argument(
                self.store.root(),
                format!("samples of segment {index}"),
                format!("at most {allowed} ({} bits)", self.layout.bits),
                sample.to_string(),
            )),
        }
    }

    /// Begins the frames of segment `index`, whichever others are there.
    fn begin(&self, index: usize, progress: &mut Progress) -> Result<SegmentWriter<'_>, StoreError> {
        if !progress.swept {
            self.store.remove_temporaries()?;
            progress.swept = true;
        }
        Ok(SegmentWriter {
            store: self,
            index,
            frames: ChunkWriter::begin(&self.frames, index)?,
        })
    }

    /// Writes the parts of segment `index`, its seal last.
    fn put(
        &self,
        index: usize,
        frames: &[impl AsRef<[u16]>],
        records: &[ExposureRecord],
        tally: &Tally,
        progress: &mut Progress,
    ) -> Result<(), StoreError> {
        let mut writer = self.begin(index, progress)?;
        for frame in frames {
            writer.push_samples(frame.as_ref())?;
        }
        writer.commit(records, tally)
    }
}
