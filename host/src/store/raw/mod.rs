//! `raw.zarr`: the frames as the camera gave them and the record of each exposure, append-only.
//!
//! # Design
//! A *segment* is a fixed number of consecutive exposures: one chunk along the exposure axis, and
//! what a crash may lose. Its records and its tally are written first, then its frames, each file
//! atomically, and its seal last: the seal is the commit marker, and binds the others to each other and
//! to the measurement. A segment that is written again first loses its seal.
//! [`RawStore::whole_segments`] reads everything up to the first gap, so a capture that was killed
//! goes on at a segment for which nothing is half true.
//!
//! | array | axes | type |
//! |---|---|---|
//! | `frames` | exposure, y, x, channel | u8 up to 8 bits, else u16 |
//! | one per field of [`ExposureRecord`] | exposure | see [`super::exposure_record`] |
//! | one per count of [`Tally`] | segment | u64 |
//! | `orphan_frame_id`, `orphan_timestamp_s` | segment, orphan | u64, f64 |
//! | `seal` | segment | u64, see `seal.rs` |
//!
//! Attributes of the group: `ticks_per_second`, the rate of the clock of all ticks; `segment_exposures`; `sha256`, what the
//! frames were captured with (given by the measurement).
//!
//! # Tradeoffs
//! One process writes; the [lock](super::lock) of the folder around sees to it. Frames of cameras with 8 or 16 bits have no
//! number to spare: where no such frame was stored yet, `attempts` says so (its fill value).

use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use serde_json::{Map, Value};

use super::array::{ArraySpec, ElementType, ZarrArray};
use super::atomic::AtomicStore;
use super::described::described;
use super::error::StoreError;
use super::exposure_record::{ExposureRecord, RecordColumns};
use super::group;
use super::header::Header;
use super::seal::Seals;
use super::tally::{Tally, TallyColumns};

mod write;

pub use write::SegmentWriter;

/// Name of the format in the group's attributes.
const FORMAT: &str = "raw";
/// Name and axes of the array of frames.
const FRAMES: &str = "frames";
const FRAME_DIMS: &[&str] = &["exposure", "y", "x", "channel"];
/// Attribute of the frames: how many of a sample's bits carry data.
const BITS: &str = "significant_bits";
/// Attribute of the group: ticks per second of the controller's clock.
const CLOCK: &str = "ticks_per_second";
/// Attribute of the group: exposures of a segment.
const SEGMENT: &str = "segment_exposures";
/// Attribute of the group: the checksums of what the frames were captured with.
pub const SUBJECT: &str = "sha256";

/// Size of a `raw.zarr`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawLayout {
    /// Exposures of the schedule.
    pub exposures: usize,
    /// Exposures per chunk: what a crash may lose.
    pub segment: usize,
    /// Rows of a frame.
    pub height: usize,
    /// Columns of a frame.
    pub width: usize,
    /// Samples per pixel.
    pub channels: usize,
    /// Significant bits of a sample, 1–16.
    pub bits: u8,
    /// Ticks per second of the controller's clock, above 0.
    pub clock_hz: u32,
}

impl RawLayout {
    fn frames(&self) -> ArraySpec<'static> {
        ArraySpec {
            name: FRAMES,
            element: if self.bits <= 8 {
                ElementType::U8
            } else {
                ElementType::U16
            },
            shape: vec![self.exposures, self.height, self.width, self.channels],
            chunk: self.segment,
            dims: FRAME_DIMS,
            packed: false,
        }
    }

    fn about_frames(&self) -> Map<String, Value> {
        let mut about = described("1", "raw camera frames, digital numbers");
        about.insert(BITS.into(), self.bits.into());
        about.insert("ancillary_variables".into(), "attempts flags".into());
        // A number that no such camera gives.
        match self.bits {
            8 | 16 => None,
            ..8 => Some(u16::from(u8::MAX)),
            _ => Some(u16::MAX),
        }
        .map(|fill| about.insert("_FillValue".into(), fill.into()));
        about
    }

    /// The largest sample.
    fn largest_sample(&self) -> u16 {
        u16::MAX >> (16 - u32::from(self.bits.clamp(1, 16)))
    }
}

/// One segment's exposures in order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Segment {
    /// Digital numbers, axes exposure, y, x, channel, row-major.
    pub frames: Vec<u16>,
    /// One record per exposure.
    pub records: Vec<ExposureRecord>,
    /// What happened on the way.
    pub tally: Tally,
}

/// What the writer knows about the content.
#[derive(Debug)]
struct Progress {
    /// Length of the whole prefix, once it is known.
    next: Option<usize>,
    /// Whether the leftovers of killed writers are gone.
    swept: bool,
}

/// An open `raw.zarr`.
#[derive(Debug)]
pub struct RawStore {
    store: Arc<AtomicStore>,
    layout: RawLayout,
    attributes: Map<String, Value>,
    frames: ZarrArray,
    records: RecordColumns,
    tallies: TallyColumns,
    seals: Seals,
    progress: Mutex<Progress>,
}

impl RawStore {
    /// Makes an empty file with these attributes of the group (`rcg_…` names are the store's own).
    ///
    /// # Errors
    /// [`StoreError::AlreadyExists`]; [`StoreError::Argument`] for a layout with an empty axis, bits
    /// outside 1–16 or a segment above 4 GiB; [`StoreError::Io`] or [`StoreError::DiskFull`].
    pub fn create(
        path: &Path,
        layout: RawLayout,
        attributes: Map<String, Value>,
    ) -> Result<Self, StoreError> {
        if !(1..=16).contains(&layout.bits) {
            return Err(StoreError::argument(
                path,
                "bits",
                "1 to 16",
                layout.bits.to_string(),
            ));
        }
        if layout.clock_hz == 0 {
            return Err(StoreError::argument(path, "clock_hz", "above 0", "0"));
        }
        layout.frames().check(path)?;
        let partial = group::start(path, FORMAT, false)?;
        let store = Arc::new(AtomicStore::new(&partial)?);
        let mut all = group::attributes_of(FORMAT, Map::new());
        all.insert(CLOCK.into(), layout.clock_hz.into());
        all.insert(SEGMENT.into(), layout.segment.into());
        for (name, value) in attributes {
            all.entry(name).or_insert(value);
        }
        describe(&store, &layout, &all)?;
        group::publish(&partial, path, FORMAT, false)?;
        Self::open(path)
    }

    /// Opens a file; its layout comes from its metadata.
    ///
    /// # Errors
    /// [`StoreError::NotAGroup`], [`StoreError::ArrayMissing`], [`StoreError::Metadata`] or
    /// [`StoreError::Io`].
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        let attributes = group::read_attributes(path, FORMAT)?;
        let store = Arc::new(AtomicStore::new(path)?);
        let header = Header::read(&store, FRAMES, Some(FRAME_DIMS.len()))?;
        let bits = header.attributes.get(BITS);
        let Some(bits) = bits
            .and_then(Value::as_u64)
            .and_then(|n| u8::try_from(n).ok())
            .filter(|n| (1..=16).contains(n))
        else {
            let found = bits.map_or_else(|| "nothing".to_owned(), group::short);
            return Err(StoreError::metadata(
                &header.path,
                format!("attributes.{BITS}"),
                "1 to 16",
                found,
            ));
        };
        let clock = attributes.get(CLOCK);
        let clock_hz = clock
            .and_then(Value::as_u64)
            .and_then(|hz| u32::try_from(hz).ok())
            .filter(|&hz| hz > 0)
            .ok_or_else(|| {
                let found = clock.map_or_else(|| "nothing".to_owned(), group::short);
                StoreError::metadata(
                    &path.join("zarr.json"),
                    format!("attributes.{CLOCK}"),
                    "a whole number above 0",
                    found,
                )
            })?;
        let (shape, segment) = (&header.shape, header.chunk_shape[0]);
        let layout = RawLayout {
            exposures: shape[0],
            segment,
            height: shape[1],
            width: shape[2],
            channels: shape[3],
            bits,
            clock_hz,
        };
        let frames = ZarrArray::open(&store, &layout.frames(), &header)?;
        let records = RecordColumns::open(&store, layout.exposures, layout.segment)?;
        let segments = frames.chunks();
        let tallies = TallyColumns::open(&store, segments, layout.segment)?;
        let seals = Seals::open(&store, segments, subject(&attributes))?;
        group::check_sum(path, &attributes)?;
        let progress = Mutex::new(Progress {
            next: None,
            swept: false,
        });
        Ok(Self {
            store,
            layout,
            attributes,
            frames,
            records,
            tallies,
            seals,
            progress,
        })
    }

    /// The size of the file.
    pub fn layout(&self) -> &RawLayout {
        &self.layout
    }

    /// All attributes of the group.
    pub fn attributes(&self) -> &Map<String, Value> {
        &self.attributes
    }

    /// Number of segments, the last perhaps shorter.
    pub fn segments(&self) -> usize {
        self.frames.chunks()
    }

    /// The exposures of segment `index`; empty beyond the last segment.
    pub fn segment_range(&self, index: usize) -> Range<usize> {
        self.frames.range(index)
    }

    /// Number of segments from the first on that are whole: every chunk there and undamaged.
    ///
    /// Reads them all. What lies behind the first damaged or missing segment does not count.
    ///
    /// # Errors
    /// [`StoreError::Io`] if a file that exists cannot be read.
    pub fn whole_segments(&self) -> Result<usize, StoreError> {
        let whole = self.count_whole_segments()?;
        self.progress.lock().unwrap_or_else(PoisonError::into_inner).next = Some(whole);
        Ok(whole)
    }

    fn count_whole_segments(&self) -> Result<usize, StoreError> {
        for index in 0..self.segments() {
            // The marker first: beyond the last segment it is missing, and nothing needs to be read.
            if !self.seals.is_present(index) {
                return Ok(index);
            }
            match self.read_segment(index) {
                Ok(_) => {}
                Err(StoreError::Checksum { .. } | StoreError::Chunk { .. }) => return Ok(index),
                Err(error) => return Err(error),
            }
        }
        Ok(self.segments())
    }

    /// Whether segment `index` is there and undamaged, whichever others are.
    ///
    /// # Errors
    /// [`StoreError::Io`] if a file that exists cannot be read.
    pub fn is_whole(&self, index: usize) -> Result<bool, StoreError> {
        if !self.seals.is_present(index) {
            return Ok(false);
        }
        match self.read_segment(index) {
            Ok(_) => Ok(true),
            Err(StoreError::Checksum { .. } | StoreError::Chunk { .. }) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// The arrays of which every segment has one chunk.
    fn parts(&self) -> impl Iterator<Item = &ZarrArray> {
        std::iter::once(&self.frames)
            .chain(self.records.arrays())
            .chain(self.tallies.arrays())
    }

    /// What happened on the way to the segments that are whole, in all.
    ///
    /// # Errors
    /// [`StoreError::Checksum`] or [`StoreError::Chunk`] if a tally is damaged or missing; [`StoreError::Io`].
    pub fn tally(&self) -> Result<Tally, StoreError> {
        let mut total = Tally::default();
        for index in 0..self.segments() {
            if !self.seals.is_present(index) {
                break;
            }
            total.add(&self.tallies.read(index)?);
        }
        Ok(total)
    }

    /// What tells these frames from all others: SHA-256 of the seals of all segments, which are digests of the checksums of all chunks
    /// and of what the file is about.
    ///
    /// # Errors
    /// [`StoreError::Checksum`] or [`StoreError::Chunk`] if a seal is damaged or missing; [`StoreError::Io`].
    pub fn sum(&self) -> Result<String, StoreError> {
        self.seals.sum(self.segments())
    }

    /// Reads the records of segment `index`, without its frames and whether they belong together.
    ///
    /// # Errors
    /// As [`read_segment`](Self::read_segment).
    pub fn read_records(&self, index: usize) -> Result<Vec<ExposureRecord>, StoreError> {
        self.records.read(index)
    }

    /// Reads segment `index`.
    ///
    /// # Errors
    /// [`StoreError::Checksum`] or [`StoreError::Chunk`] if a part of it is damaged, missing or not its own;
    /// [`StoreError::Argument`] if there is no such segment; [`StoreError::Io`].
    pub fn read_segment(&self, index: usize) -> Result<Segment, StoreError> {
        let frames = if self.layout.bits <= 8 {
            self.frames
                .read_present::<u8>(index)?
                .into_iter()
                .map(u16::from)
                .collect()
        } else {
            self.frames.read_present(index)?
        };
        let segment = Segment {
            frames,
            records: self.records.read(index)?,
            tally: self.tallies.read(index)?,
        };
        self.seals.check(index, self.parts())?;
        Ok(segment)
    }
}

/// Writes the metadata of a file of this `layout` with these attributes of its group.
fn describe(
    store: &Arc<AtomicStore>,
    layout: &RawLayout,
    attributes: &Map<String, Value>,
) -> Result<(), StoreError> {
    let frames = ZarrArray::create(store, &layout.frames(), layout.about_frames())?;
    let records = RecordColumns::create(store, layout.exposures, layout.segment, layout.clock_hz)?;
    let segments = frames.chunks();
    let tallies = TallyColumns::create(store, segments, layout.segment)?;
    let seals = Seals::create(store, segments, subject(attributes))?;
    let arrays = std::iter::once(&frames)
        .chain(records.arrays())
        .chain(tallies.arrays())
        .chain([seals.array()]);
    let metadata = arrays
        .map(|array| (array.name().to_owned(), array.metadata()))
        .collect();
    group::write(store, attributes, &metadata)
}

/// What the file with these attributes of the group is about, as its seals take it.
fn subject(attributes: &Map<String, Value>) -> String {
    attributes.get(SUBJECT).map(Value::to_string).unwrap_or_default()
}

#[cfg(test)]
mod tests;
