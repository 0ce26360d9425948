//! How many frames a second arrive whole.

use std::time::{Duration, Instant};

use aravis::{AcquisitionMode, Buffer, BufferStatus, CameraExt as _, StreamExt as _};
use serde::Serialize;

use super::ids::Ids;
use super::set::{format_or_set, set_image, set_network};
use super::stream::stream_of;
use super::{Refusal, open_device};
use crate::capture::camera::CameraError;
use crate::instrument::drivers::Genicam;

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
    let stream = stream_of(&refusal, &camera)?;
    let payload = camera.payload().map_err(refusal.feature("PayloadSize"))?;
    for _ in 0..settings.buffers {
        stream.push_buffer(Buffer::new_allocate(payload as usize));
    }
    camera
        .start_acquisition()
        .map_err(refusal.feature("AcquisitionStart"))?;
    let began = Instant::now();
    let mut ids: Option<Ids> = None;
    let (mut frames, mut last) = (0, 0);
    while began.elapsed() < duration {
        let Some(buffer) = stream.timeout_pop_buffer(100_000) else {
            continue;
        };
        let number = ids
            .get_or_insert_with(|| Ids::new(buffer.frame_id(), camera.is_gv_device()))
            .number_of(buffer.frame_id());
        last = last.max(number.unwrap_or(0));
        if buffer.status() == BufferStatus::Success {
            frames += 1;
            if frames % 256 == 0 {
                progress(frames);
            }
        }
        stream.push_buffer(buffer);
    }
    let elapsed_s = began.elapsed().as_secs_f64();
    camera
        .stop_acquisition()
        .map_err(refusal.feature("AcquisitionStop"))?;
    let numbered = if ids.is_some() { last + 1 } else { 0 };
    Ok(Throughput {
        region_px,
        packet_bytes: camera
            .is_gv_device()
            .then(|| camera.gv_get_packet_size().ok())
            .flatten(),
        buffers: settings.buffers,
        elapsed_s,
        frames,
        lost: numbered.saturating_sub(frames),
        underruns: stream.statistics().2,
        resent_packets: stream.info_uint64_by_name("n_resent_packets"),
        missing_packets: stream.info_uint64_by_name("n_missing_packets"),
        frames_per_s: frames as f64 / elapsed_s,
        bytes_per_s: frames as f64 * f64::from(payload) / elapsed_s,
        pixel_format,
        id,
    })
}
