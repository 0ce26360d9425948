//! The stream of frames, and how its blocks are numbered.

use std::time::{Duration, Instant};

use aravis::glib::prelude::ObjectExt as _;
use aravis::{Buffer, BufferStatus, CameraExt as _, CameraExtManual as _, StreamExt as _};

use super::Refusal;
use super::set::let_software_trigger;
use crate::capture::camera::CameraError;

/// How many packets of a frame are asked for again at most, as a share of its packets.
const PACKET_REQUESTS: &str = "packet-request-ratio";
/// The feature that triggers a frame.
const SOFTWARE_TRIGGER: &str = "TriggerSoftware";
/// What a frame by software may take.
const SOFTWARE: Duration = Duration::from_secs(1);
/// How many of them are tried.
const PROBES: u64 = 4;

/// The stream of frames, with so many `buffers`, and the bytes of each. Packets that are lost are asked for again as often as it takes:
/// with few packets to a frame, libaravis' limit of a quarter of them is none.
pub(super) fn stream_of(
    refusal: &Refusal,
    camera: &aravis::Camera,
    buffers: u32,
) -> Result<(aravis::Stream, u32), CameraError> {
    let stream = camera.create_stream().map_err(refusal.feature("stream"))?;
    if stream.find_property(PACKET_REQUESTS).is_some() {
        stream.set_property(PACKET_REQUESTS, 2.0_f64);
    }
    let payload = camera.payload().map_err(refusal.feature("PayloadSize"))?;
    for _ in 0..buffers {
        stream.push_buffer(Buffer::new_allocate(payload as usize));
    }
    Ok((stream, payload))
}

/// Gives the buffers that are full back to the `stream`.
pub(super) fn take_back(stream: &aravis::Stream) {
    while let Some(buffer) = stream.try_pop_buffer() {
        stream.push_buffer(buffer);
    }
}

/// Block ids of an acquisition of frames that software triggers, until one arrives whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Probe {
    /// The id that arrived.
    pub(super) id: u64,
    /// How many frames before it did not.
    pub(super) lost: u64,
}

/// Triggers frames by software.
pub(super) fn probe(
    refusal: &Refusal,
    camera: &aravis::Camera,
    stream: &aravis::Stream,
) -> Result<Probe, CameraError> {
    if !camera.is_feature_available(SOFTWARE_TRIGGER).unwrap_or(false) {
        return Err(refusal.failed(
            "expected a software trigger, by which is learnt how the camera numbers its frames, found none",
        ));
    }
    let (buffer, lost) = by_software(refusal, camera, stream, SOFTWARE)?;
    let id = buffer.frame_id();
    stream.push_buffer(buffer);
    Ok(Probe { id, lost })
}

/// An acquisition of frames that software triggers, until one arrives whole within `patience`: that, and how many before it did not.
pub(super) fn by_software(
    refusal: &Refusal,
    camera: &aravis::Camera,
    stream: &aravis::Stream,
    patience: Duration,
) -> Result<(Buffer, u64), CameraError> {
    let_software_trigger(refusal, camera)?;
    take_back(stream);
    camera
        .start_acquisition()
        .map_err(refusal.feature("AcquisitionStart"))?;
    let mut found = Ok(None);
    for lost in 0..PROBES {
        let came = camera.software_trigger().map(|()| whole(stream, patience));
        let is_over = !matches!(came, Ok(None));
        found = came.map(|buffer| buffer.map(|buffer| (buffer, lost)));
        if is_over {
            break;
        }
    }
    camera
        .stop_acquisition()
        .map_err(refusal.feature("AcquisitionStop"))?;
    found.map_err(refusal.feature(SOFTWARE_TRIGGER))?.ok_or_else(|| {
        refusal.failed(format!(
            "expected a whole frame within {} s of one of {PROBES} triggers by software, found none",
            patience.as_secs_f64()
        ))
    })
}

/// The next frame that arrives whole within `patience`.
fn whole(stream: &aravis::Stream, patience: Duration) -> Option<Buffer> {
    let began = Instant::now();
    while let Some(left) = patience.checked_sub(began.elapsed()) {
        let buffer = stream.timeout_pop_buffer(left.as_micros() as u64)?;
        if buffer.status() == BufferStatus::Success {
            return Some(buffer);
        }
        stream.push_buffer(buffer);
    }
    None
}
