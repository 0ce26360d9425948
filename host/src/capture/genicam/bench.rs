//! How many frames a second arrive whole.

use std::time::{Duration, Instant};

use aravis::{AcquisitionMode, Buffer, BufferStatus, CameraExt as _, StreamExt as _};
use serde::Serialize;

use super::ids::Ids;
use super::set::{format_or_set, set_image, set_network};
use super::stream::stream_of;
use super::{Refusal, open_device};
use crate::capture::camera::CameraError;
use crate::capture::flow::{About, Arrived, Source};
use crate::instrument::drivers::Genicam;

/// How long is waited for a frame at a time.
const POLL: Duration = Duration::from_millis(100);

/// What arrived of a free-running camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Throughput {
    /// The camera.
    pub id: String,
    /// Region that was read, pixels (width, height).
    pub region_px: (usize, usize),
    /// Pixel format.
    pub pixel_format: String,
    /// Bytes of a packet on the network.
    pub packet_bytes: Option<u32>,
    /// Frames that may wait.
    pub buffers: u32,
    /// How long was measured, s.
    pub elapsed_s: f64,
    /// Frames that arrived whole.
    pub frames: u64,
    /// Frames that the camera numbered and that did not arrive, or not whole.
    pub lost: u64,
    /// Frames for which no place was left, as this program was too slow.
    pub underruns: u64,
    /// Packets that were sent again.
    pub resent_packets: u64,
    /// Packets that never came.
    pub missing_packets: u64,
    /// Whole frames a second.
    pub frames_per_s: f64,
    /// Bytes of images a second.
    pub bytes_per_s: f64,
}

/// A camera that runs free. Dropped, it stops.
pub struct FreeRunning {
    id: String,
    camera: aravis::Camera,
    stream: aravis::Stream,
    region_px: (usize, usize),
    pixel_format: String,
    payload: u32,
    ids: Option<Ids>,
    /// Number of the newest frame, and how many arrived whole.
    newest: u64,
    frames: u64,
}

impl FreeRunning {
    /// Lets the camera of these `settings` run free, at `frames_per_s` if it can be told.
    ///
    /// # Errors
    /// [`CameraError`].
    pub fn start(settings: &Genicam, frames_per_s: Option<f64>) -> Result<Self, CameraError> {
        let (id, camera) = open_device(settings.device.as_deref())?;
        let refusal = Refusal(&id);
        let pixel_format = format_or_set(&refusal, &camera, settings)?;
        let region_px = set_image(&refusal, &camera, settings, &pixel_format)?;
        camera.clear_triggers().map_err(refusal.feature("TriggerMode"))?;
        if let Some(rate) = frames_per_s {
            camera
                .set_frame_rate(rate)
                .map_err(refusal.feature("AcquisitionFrameRate"))?;
        }
        camera
            .set_acquisition_mode(AcquisitionMode::Continuous)
            .map_err(refusal.feature("AcquisitionMode"))?;
        set_network(&refusal, &camera, settings)?;
        let (stream, payload) = stream_of(&refusal, &camera, settings.buffers)?;
        camera
            .start_acquisition()
            .map_err(refusal.feature("AcquisitionStart"))?;
        Ok(Self {
            id,
            camera,
            stream,
            region_px,
            pixel_format,
            payload,
            ids: None,
            newest: 0,
            frames: 0,
        })
    }

    /// What `of` makes of the next frame that arrives whole within `timeout`, and of its number.
    fn next_with<T>(&mut self, timeout: Duration, of: impl FnOnce(&Buffer, u64) -> T) -> Option<T> {
        let buffer = self.stream.timeout_pop_buffer(timeout.as_micros() as u64)?;
        let gige = self.camera.is_gv_device();
        let number = self
            .ids
            .get_or_insert_with(|| Ids::new(buffer.frame_id(), gige))
            .number_of(buffer.frame_id());
        self.newest = self.newest.max(number.unwrap_or(0));
        let whole = number.filter(|_| buffer.status() == BufferStatus::Success);
        let made = whole.map(|number| of(&buffer, number));
        self.frames += u64::from(made.is_some());
        self.stream.push_buffer(buffer);
        made
    }

    fn numbered(&self) -> u64 {
        if self.ids.is_some() { self.newest + 1 } else { 0 }
    }
}

impl Source for FreeRunning {
    fn about(&self) -> About {
        About {
            id: self.id.clone(),
            region_px: self.region_px,
            pixel_format: self.pixel_format.clone(),
        }
    }

    fn next(&mut self, bytes: &mut Vec<u8>, timeout: Duration) -> Result<Option<Arrived>, CameraError> {
        Ok(self.next_with(timeout, |buffer, number| {
            bytes.extend_from_slice(&buffer.image_data());
            Arrived {
                number,
                timestamp_s: buffer.timestamp() as f64 * 1e-9,
            }
        }))
    }

    fn lost(&self) -> u64 {
        self.numbered().saturating_sub(self.frames)
    }
}

impl Drop for FreeRunning {
    fn drop(&mut self) {
        self.camera.stop_acquisition().ok();
    }
}

/// Lets the camera of these `settings` run free for `duration`, at `frames_per_s` if it can be told, and counts.
///
/// # Errors
/// [`CameraError`].
pub fn bench(
    settings: &Genicam,
    frames_per_s: Option<f64>,
    duration: Duration,
    progress: &dyn Fn(u64),
) -> Result<Throughput, CameraError> {
    let mut running = FreeRunning::start(settings, frames_per_s)?;
    let began = Instant::now();
    while began.elapsed() < duration {
        let came = running.next_with(POLL, |_, _| ());
        if came.is_some() && running.frames.is_multiple_of(256) {
            progress(running.frames);
        }
    }
    let elapsed_s = began.elapsed().as_secs_f64();
    let FreeRunning { camera, stream, .. } = &running;
    camera
        .stop_acquisition()
        .map_err(Refusal(&running.id).feature("AcquisitionStop"))?;
    let frames = running.frames;
    Ok(Throughput {
        region_px: running.region_px,
        packet_bytes: camera
            .is_gv_device()
            .then(|| camera.gv_get_packet_size().ok())
            .flatten(),
        buffers: settings.buffers,
        elapsed_s,
        frames,
        lost: running.lost(),
        underruns: stream.statistics().2,
        resent_packets: stream.info_uint64_by_name("n_resent_packets"),
        missing_packets: stream.info_uint64_by_name("n_missing_packets"),
        frames_per_s: frames as f64 / elapsed_s,
        bytes_per_s: frames as f64 * f64::from(running.payload) / elapsed_s,
        pixel_format: running.pixel_format.clone(),
        id: running.id.clone(),
    })
}
