//! The file that frames flow into.

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::{Map, json};

use super::{About, Filled, FlowError};
use crate::instrument::pixel_format::PixelFormat;
use crate::store::{ExposureRecord, Lock, RawLayout, RawStore, SegmentWriter, StoreError, Tally};

/// Name of the file in its folder.
const RAW: &str = "raw.zarr";
/// A segment holds about this many bytes of frames, as in a measurement …
const SEGMENT_BYTES: usize = 16 << 20;
/// … and so many frames.
const SEGMENT: std::ops::RangeInclusive<usize> = 8..=4096;
/// More frames a second than any source has: nobody knows before how many there will be.
const MOST_PER_S: f64 = 4e6;
/// Nanoseconds: there is no box whose ticks could be meant.
const CLOCK_HZ: u32 = 1_000_000_000;

/// A `raw.zarr` in a folder of which this process has the right to write.
pub(super) struct File {
    pub(super) raw: RawStore,
    path: PathBuf,
    _lock: Lock,
}

impl File {
    /// Makes it in `folder` for frames of `about`, as many as come in `duration`.
    pub(super) fn create(
        folder: &Path,
        about: &About,
        format: PixelFormat,
        duration: Duration,
    ) -> Result<Self, StoreError> {
        let lock = Lock::folder(folder)?;
        let path = folder.join(RAW);
        let (width, height) = about.region_px;
        let stored = if format.bits() <= 8 { 1 } else { 2 };
        let frame_bytes = width * height * format.values() * stored;
        let layout = RawLayout {
            exposures: (MOST_PER_S * duration.as_secs_f64()).ceil() as usize + 1,
            segment: (SEGMENT_BYTES / frame_bytes.max(1)).clamp(*SEGMENT.start(), *SEGMENT.end()),
            height,
            width,
            channels: format.values(),
            bits: format.bits(),
            clock_hz: CLOCK_HZ,
        };
        let mut attributes = Map::new();
        attributes.insert("camera".to_owned(), json!(about.id));
        attributes.insert("pixel_format".to_owned(), json!(about.pixel_format));
        attributes.insert(
            "source".to_owned(),
            json!(concat!("rcg ", env!("CARGO_PKG_VERSION"))),
        );
        let raw = RawStore::create(&path, layout, attributes)?;
        Ok(Self {
            raw,
            path,
            _lock: lock,
        })
    }

    /// Ends it after so many `frames`, at least 1, waits until the disk has them, and returns its path.
    pub(super) fn end(self, frames: u64) -> Result<PathBuf, StoreError> {
        self.raw.end_after(frames as usize)?.sync()?;
        Ok(self.path)
    }
}

/// Writes frames as segments.
pub(super) struct Keeper<'a> {
    raw: &'a RawStore,
    format: PixelFormat,
    pixels: usize,
    camera: String,
    /// The segment that is open, its number, and what is known of its frames.
    open: Option<SegmentWriter<'a>>,
    index: usize,
    records: Vec<ExposureRecord>,
    tally: Tally,
    /// Number that the next frame should have.
    next: u64,
}

impl<'a> Keeper<'a> {
    pub(super) fn new(raw: &'a RawStore, format: PixelFormat, about: &About) -> Self {
        Self {
            raw,
            format,
            pixels: about.region_px.0 * about.region_px.1,
            camera: about.id.clone(),
            open: None,
            index: 0,
            records: Vec::new(),
            tally: Tally::default(),
            next: 0,
        }
    }

    /// Writes frames behind those of before.
    pub(super) fn add(&mut self, mut frames: &[Filled]) -> Result<(), FlowError> {
        while !frames.is_empty() {
            let writer = match self.open.take() {
                Some(open) => open,
                None => self.raw.begin_segment(self.index)?,
            };
            let (now, later) = frames.split_at(writer.missing().min(frames.len()));
            let writer = self.write(writer, now)?;
            if writer.missing() == 0 {
                writer.finish(&self.records, &self.tally)?;
                self.index += 1;
                self.records.clear();
                self.tally = Tally::default();
            } else {
                self.open = Some(writer);
            }
            frames = later;
        }
        Ok(())
    }

    fn write(
        &mut self,
        mut writer: SegmentWriter<'a>,
        frames: &[Filled],
    ) -> Result<SegmentWriter<'a>, FlowError> {
        let expected = self.format.bytes(self.pixels);
        for Filled { arrived, bytes } in frames {
            if bytes.len() != expected {
                return Err(FlowError::Length {
                    id: self.camera.clone(),
                    expected,
                    found: bytes.len(),
                });
            }
            self.records
                .push(ExposureRecord::of_frame(arrived.number, arrived.timestamp_s));
            self.tally.dropped_frames += arrived.number.saturating_sub(self.next);
            self.next = self.next.max(arrived.number + 1);
        }
        if self.format.is_stored_as_it_is() {
            let pieces: Vec<&[u8]> = frames.iter().map(|frame| frame.bytes.as_slice()).collect();
            writer.push(&pieces)?;
            return Ok(writer);
        }
        for frame in frames {
            let values = self
                .format
                .values_of(&frame.bytes, self.pixels)
                .unwrap_or_default();
            let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
            writer.push(&[&bytes])?;
        }
        Ok(writer)
    }

    /// Writes what is left of the segment that is open.
    pub(super) fn end(self) -> Result<(), FlowError> {
        if let Some(open) = self.open {
            open.finish_short(self.records, &self.tally)?;
        }
        Ok(())
    }
}
