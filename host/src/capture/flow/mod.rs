//! How many frames a second go from a camera to the disk, and whether any is lost on the way.
//!
//! # Design
//! What a measurement does with frames, without a trigger box: a thread takes them in, a [ring](super::ring) holds what waits, and the
//! caller's thread writes them as segments of a `raw.zarr`. Buffers go round: from the source through the ring to the writer and
//! back; all of them are made before the first frame comes. In memory are the ring's frames and at most 1 MiB that is being written.
//! A frame that a source has numbered and not handed over is lost; where it should have been nothing is stored but its number's
//! gap.
//!
//! # Tradeoffs
//! Nothing is compressed, as everywhere in [`store`](crate::store). The system writes to the disk when it likes, and a full memory of pages
//! makes the writer wait; that is what the ring is for. [`Flow::synced_s`] says when the disk had everything.

mod keeper;
mod synthetic;

use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use serde::Serialize;

use super::camera::CameraError;
use super::ring::{Gone, Inlet, Outlet, frames_in_ring, ring};
use crate::base::blame::Blame;
use crate::instrument::pixel_format::PixelFormat;
use crate::store::StoreError;

use keeper::{File, Keeper};
pub use synthetic::Synthetic;

/// Bytes that go to the system with one call, at least one frame.
const BATCH_BYTES: usize = 1 << 20;
/// How long is waited for a frame at a time.
const POLL: Duration = Duration::from_millis(20);

/// What frames come from.
pub trait Source: Send {
    /// What it is.
    fn about(&self) -> About;

    /// The next frame: its bytes go to the empty `bytes`. `None` if none came within `timeout`.
    ///
    /// # Errors
    /// [`CameraError`].
    fn next(&mut self, bytes: &mut Vec<u8>, timeout: Duration) -> Result<Option<Arrived>, CameraError>;

    /// Frames so far that were numbered and not handed over.
    fn lost(&self) -> u64;
}

/// What a source is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct About {
    /// What a person knows it by.
    pub id: String,
    /// Columns and rows of a frame.
    pub region_px: (usize, usize),
    /// Name of its [`PixelFormat`].
    pub pixel_format: String,
}

/// What is known of a frame beside its bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrived {
    /// Number of the frame, those that were lost included.
    pub number: u64,
    /// Start of its exposure on the source's clock, s.
    pub timestamp_s: f64,
}

/// What came of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Flow {
    /// The source.
    pub source: String,
    /// Columns and rows of a frame.
    pub region_px: (usize, usize),
    /// Pixel format.
    pub pixel_format: String,
    /// Where frames were written.
    pub to: Option<PathBuf>,
    /// From the beginning until the last frame was written, s.
    pub elapsed_s: f64,
    /// Until the disk had them all, s from the beginning; `None` if nothing was written.
    pub synced_s: Option<f64>,
    /// Frames that were taken in, and written where they were to be.
    pub frames: u64,
    /// Frames that were numbered and did not come.
    pub lost: u64,
    /// Frames a second.
    pub frames_per_s: f64,
    /// Bytes of frames a second.
    pub bytes_per_s: f64,
    /// Frames that fit into the ring.
    pub ring_frames: usize,
    /// How many were in it at most.
    pub ring_high_water: usize,
    /// How often there was no room in it at first.
    pub ring_waits: u64,
    /// Frames of a segment of the file.
    pub segment_frames: Option<usize>,
}

/// Why frames did not flow.
#[derive(Debug, thiserror::Error)]
pub enum FlowError {
    /// The camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The file.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Pixels that nobody here can take apart.
    #[error("camera {id}: PixelFormat: expected Mono, Bayer or RGB of 8 to 16 bits, found {found}")]
    Format {
        /// The camera.
        id: String,
        /// Its pixel format.
        found: String,
    },
    /// A frame of another length.
    #[error("camera {id}: expected frames of {expected} bytes, found one of {found}")]
    Length {
        /// The camera.
        id: String,
        /// Bytes of a frame.
        expected: usize,
        /// What came.
        found: usize,
    },
    /// Nothing came.
    #[error("camera {id}: expected frames, found none in {elapsed_s:.1} s")]
    Nothing {
        /// The camera.
        id: String,
        /// How long was waited.
        elapsed_s: f64,
    },
}

impl Blame for FlowError {
    fn is_input(&self) -> bool {
        match self {
            Self::Camera(error) => error.is_input(),
            Self::Store(error) => error.is_input(),
            Self::Format { .. } => true,
            Self::Length { .. } | Self::Nothing { .. } => false,
        }
    }
}

/// A frame on its way.
struct Filled {
    arrived: Arrived,
    bytes: Vec<u8>,
}

/// Takes in what `source` gives for `duration`, and writes it as `raw.zarr` into the folder `to`, if there is one. `progress` is told how many
/// frames are done.
///
/// # Errors
/// [`FlowError`]; what was written is whole by segments.
pub fn flow(
    source: &mut dyn Source,
    duration: Duration,
    to: Option<&Path>,
    progress: &dyn Fn(u64),
) -> Result<Flow, FlowError> {
    let about = source.about();
    let format = PixelFormat::of(&about.pixel_format).ok_or_else(|| FlowError::Format {
        id: about.id.clone(),
        found: about.pixel_format.clone(),
    })?;
    let frame_bytes = format.bytes(about.region_px.0 * about.region_px.1);
    let file = to
        .map(|folder| File::create(folder, &about, format, duration))
        .transpose()?;
    let keeper = file.as_ref().map(|file| Keeper::new(&file.raw, format, &about));
    let (inlet, outlet) = ring(frames_in_ring(frame_bytes));
    let (give_back, empty) = channel();
    // All memory is there before the first frame: a page that the system has to find first makes a source wait.
    let written = (BATCH_BYTES / frame_bytes.max(1)).max(1);
    for _ in 0..=outlet.capacity() + written {
        give_back.send(vec![1; frame_bytes]).ok();
    }
    let began = Instant::now();
    let (kept, read) = thread::scope(|scope| {
        let reader = scope.spawn(move || read(source, duration, inlet, empty));
        let kept = keep(outlet, &give_back, keeper, written, progress);
        let read = reader.join();
        (kept, read.unwrap_or_else(|panic| resume_unwind(panic)))
    });
    let elapsed_s = began.elapsed().as_secs_f64();
    let kept = kept?;
    let source_lost = read?;
    let id = about.id.clone();
    if kept.frames == 0 {
        return Err(FlowError::Nothing { id, elapsed_s });
    }
    let segment_frames = file.as_ref().map(|file| file.raw.layout().segment);
    let to = file.map(|file| file.end(kept.frames)).transpose()?;
    Ok(Flow {
        source: id,
        region_px: about.region_px,
        pixel_format: about.pixel_format,
        synced_s: to.is_some().then(|| began.elapsed().as_secs_f64()),
        to,
        elapsed_s,
        frames: kept.frames,
        lost: source_lost,
        frames_per_s: kept.frames as f64 / elapsed_s,
        bytes_per_s: (kept.frames * frame_bytes as u64) as f64 / elapsed_s,
        ring_frames: kept.ring_frames,
        ring_high_water: kept.high_water,
        ring_waits: kept.waits,
        segment_frames,
    })
}

/// The thread that takes frames in. Returns how many were lost.
#[expect(
    clippy::needless_pass_by_value,
    reason = "who keeps them learns by its end that nothing more comes"
)]
fn read(
    source: &mut dyn Source,
    duration: Duration,
    inlet: Inlet<Filled>,
    empty: Receiver<Vec<u8>>,
) -> Result<u64, CameraError> {
    let began = Instant::now();
    let mut bytes: Vec<u8> = Vec::new();
    while began.elapsed() < duration && !inlet.is_left() {
        let Some(arrived) = source.next(&mut bytes, POLL)? else {
            continue;
        };
        let mut next = empty.try_recv().unwrap_or_default();
        next.clear();
        let bytes = std::mem::replace(&mut bytes, next);
        if inlet.push(Filled { arrived, bytes }) == Err(Gone) {
            break;
        }
    }
    Ok(source.lost())
}

/// What became of the frames.
struct Kept {
    frames: u64,
    ring_frames: usize,
    high_water: usize,
    waits: u64,
}

/// Keeps what comes out of the ring, `most` frames at a time, until nothing more comes. Where it cannot, the ring goes, and who fills it ends.
#[expect(
    clippy::needless_pass_by_value,
    reason = "who fills the ring learns by its end that nobody keeps anything"
)]
fn keep(
    outlet: Outlet<Filled>,
    give_back: &Sender<Vec<u8>>,
    mut keeper: Option<Keeper<'_>>,
    most: usize,
    progress: &dyn Fn(u64),
) -> Result<Kept, FlowError> {
    let mut batch: Vec<Filled> = Vec::with_capacity(most);
    let mut frames = 0;
    loop {
        match outlet.pop(POLL) {
            Ok(Some(frame)) => batch.push(frame),
            Ok(None) => continue,
            Err(Gone) => break,
        }
        while batch.len() < most
            && let Ok(Some(frame)) = outlet.try_pop()
        {
            batch.push(frame);
        }
        if let Some(keeper) = &mut keeper {
            keeper.add(&batch)?;
        }
        frames += batch.len() as u64;
        for frame in batch.drain(..) {
            // A source that has ended needs no more.
            give_back.send(frame.bytes).ok();
        }
        progress(frames);
    }
    if let Some(keeper) = keeper {
        keeper.end()?;
    }
    Ok(Kept {
        frames,
        ring_frames: outlet.capacity(),
        high_water: outlet.high_water(),
        waits: outlet.waits(),
    })
}

#[cfg(test)]
mod tests;
