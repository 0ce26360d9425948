//! The stream of frames, and how its blocks are numbered.

use std::time::{Duration, Instant};

use aravis::glib::prelude::ObjectExt as _;
use aravis::{BufferStatus, CameraExt as _, CameraExtManual as _, StreamExt as _};

use super::Refusal;
use super::set::let_software_trigger;
use crate::capture::camera::CameraError;

/// How many packets of a frame are asked for again at most, as a share of its packets.
const PACKET_REQUESTS: &str = "packet-request-ratio";
/// What a frame by software may take.
const SOFTWARE: Duration = Duration::from_secs(1);
/// How many of them are tried.
pub(super) const PROBES: u64 = 4;

/// The stream of frames. Packets that are lost are asked for again as often as it takes: with few packets to a frame, libaravis' limit
/// of a quarter of them is none.
pub(super) fn stream_of(refusal: &Refusal, camera: &aravis::Camera) -> Result<aravis::Stream, CameraError> {
    let stream = camera.create_stream().map_err(refusal.feature("stream"))?;
    if stream.find_property(PACKET_REQUESTS).is_some() {
        stream.set_property(PACKET_REQUESTS, 2.0_f64);
    }
    Ok(stream)
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
    let feature = "TriggerSoftware";
    if !camera.is_feature_available(feature).unwrap_or(false) {
        return Err(refusal.failed(
            "expected a software trigger, by which is learnt how the camera numbers its frames, found none",
        ));
    }
    let_software_trigger(refusal, camera)?;
    take_back(stream);
    camera
        .start_acquisition()
        .map_err(refusal.feature("AcquisitionStart"))?;
    let mut found = Ok(None);
    for lost in 0..PROBES {
        let came = camera.software_trigger().map(|()| whole(stream, SOFTWARE));
        let is_over = !matches!(came, Ok(None));
        found = came.map(|id| id.map(|id| Probe { id, lost }));
        if is_over {
            break;
        }
    }
    camera
        .stop_acquisition()
        .map_err(refusal.feature("AcquisitionStop"))?;
    match found.map_err(refusal.feature(feature))? {
        Some(probe) => Ok(probe),
        None => Err(refusal.failed(format!(
            "expected a whole frame within {} s of one of {PROBES} triggers by software, found none",
            SOFTWARE.as_secs()
        ))),
    }
}

/// The id of the next frame that arrives whole within `patience`.
fn whole(stream: &aravis::Stream, patience: Duration) -> Option<u64> {
    let began = Instant::now();
    while let Some(left) = patience.checked_sub(began.elapsed()) {
        let buffer = stream.timeout_pop_buffer(left.as_micros() as u64)?;
        let id = (buffer.status() == BufferStatus::Success).then(|| buffer.frame_id());
        stream.push_buffer(buffer);
        if id.is_some() {
            return id;
        }
    }
    None
}
