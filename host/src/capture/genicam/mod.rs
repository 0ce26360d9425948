//! GigE Vision and USB3 Vision cameras, by libaravis.
//!
//! # Design
//! Features are those of the Standard Features Naming Convention (SFNC 2.7). The camera exposes for as long as its trigger line
//! is active (`ExposureMode` = `TriggerWidth`), so that the trigger box alone decides how long, and puts out `ExposureActive`.
//!
//! A frame's number is the block id of the stream (GigE Vision 2.2, 24: 16 bits that count from 1 and leave out 0, or 64
//! bits), counted from the first of an acquisition. Which one that is must be known, as a lost first frame could not be told else: two
//! frames by software when the camera is opened show whether it counts anew in each acquisition; where it goes on, one more
//! such frame before each acquisition shows how far it is. Frames that did not arrive whole are left out; the gap in the numbers tells.
//! Time-stamps are the device's.
//!
//! What is asked of the camera is read back, and a camera that took something else is refused.

mod bench;
mod grab;
mod ids;
mod list;
mod said;
mod set;
mod stream;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use aravis::glib;
use aravis::{Buffer, BufferStatus, CameraExt as _, DeviceExt as _, StreamExt as _};

use crate::capture::camera::{Camera, CameraError, Frame};
use crate::capture::native::Binner;
use crate::instrument::drivers::Genicam;
use crate::instrument::frame_format::FrameFormat;
use crate::instrument::pixel_format::PixelFormat;
use crate::instrument::rig::Rig;

pub use bench::{FreeRunning, Throughput, bench};
pub use grab::{Grabbed, grab};
use ids::Ids;
pub use list::{Details, Listed, details, list};
use said::said_of;
use set::{set_image, set_levels, set_network, set_strobe, set_trigger};
use stream::{probe, stream_of, take_back};

/// A camera that is told to begin needs no longer.
const POLL: Duration = Duration::from_millis(50);

/// A GenICam camera whose trigger line fires it.
pub struct GenicamCamera {
    name: String,
    camera: aravis::Camera,
    stream: aravis::Stream,
    binner: Binner,
    /// Columns and rows of a frame.
    region_px: (i32, i32),
    pixel_format: aravis::PixelFormat,
    settings: Genicam,
    ids: Ids,
    /// The first id of an acquisition, where each counts anew.
    anew: Option<u64>,
    gone: Arc<AtomicBool>,
    acquiring: bool,
}

/// What the driver wants of a camera and does not get.
struct Refusal<'a>(&'a str);

impl Refusal<'_> {
    fn failed(&self, reason: impl Into<String>) -> CameraError {
        CameraError::Failed {
            camera: self.0.to_owned(),
            reason: reason.into(),
        }
    }

    /// What libaravis says when it is asked for `feature`.
    fn feature(&self, feature: &str) -> impl Fn(glib::Error) -> CameraError {
        move |error| match error.kind::<aravis::DeviceError>() {
            Some(aravis::DeviceError::Timeout | aravis::DeviceError::NotConnected) => {
                CameraError::Disconnected {
                    camera: self.0.to_owned(),
                }
            }
            _ => self.failed(format!("{feature}: {}", error.message())),
        }
    }
}

/// The camera of which `device` is the identity, the address, or a part of the identity; the only one without it.
fn open_device(device: Option<&str>) -> Result<(String, aravis::Camera), CameraError> {
    let wanted = device.unwrap_or("any");
    let refusal = Refusal(wanted);
    let is_address = device.is_some_and(|device| device.parse::<std::net::Ipv4Addr>().is_ok());
    let id = if is_address {
        wanted.to_owned()
    } else {
        let all = list();
        let found: Vec<&Listed> = all
            .iter()
            .filter(|one| device.is_none_or(|device| one.id.contains(device)))
            .collect();
        let names = |all: &[&Listed]| {
            let names: Vec<&str> = all.iter().map(|one| one.id.as_str()).collect();
            names.join(", ")
        };
        let which = |expected, found: String| CameraError::Which {
            camera: wanted.to_owned(),
            expected,
            found,
        };
        match found.as_slice() {
            [one] => one.id.clone(),
            [] if all.is_empty() => {
                return Err(which(
                    "a camera",
                    "none on the network or USB (is it on, in this network, and not open elsewhere?)"
                        .to_owned(),
                ));
            }
            [] => {
                let all: Vec<&Listed> = all.iter().collect();
                return Err(which("a camera of that name", names(&all)));
            }
            several => {
                return Err(which(
                    "one camera",
                    format!(
                        "{}: {}; say which in camera.genicam.device",
                        several.len(),
                        names(several)
                    ),
                ));
            }
        }
    };
    let camera = aravis::Camera::new(Some(&id)).map_err(|error| {
        refusal.failed(format!(
            "expected a camera that can be opened, found none: {} (does another program hold it?)",
            error.message()
        ))
    })?;
    Ok((id, camera))
}

impl GenicamCamera {
    /// The camera of `rig`, whose image has the size that is to be stored.
    ///
    /// # Errors
    /// [`CameraError`] where there is none, or where it has no such trigger, format or region.
    pub fn open(rig: &Rig) -> Result<Self, CameraError> {
        let settings = rig.camera.genicam.clone().unwrap_or_default();
        let (name, camera) = open_device(settings.device.as_deref())?;
        let refusal = Refusal(&name);
        // A rig that was read names one that is known.
        let format_name = settings.pixel_format.as_deref().unwrap_or_default();
        let format = PixelFormat::of(format_name)
            .ok_or_else(|| refusal.failed("expected a pixel format in the rig file, found none"))?;
        let region_px = set_image(&refusal, &camera, &settings, format_name)?;
        let side = rig.camera.lens.width_px as usize;
        let binner = Binner::new(format, region_px, side, usize::from(rig.camera.channels))
            .map_err(|error| refusal.failed(error.to_string()))?;
        set_levels(&refusal, &camera, &settings)?;
        set_strobe(&refusal, &camera, &settings)?;
        set_network(&refusal, &camera, &settings)?;

        let gone = Arc::new(AtomicBool::new(false));
        if let Some(device) = camera.device() {
            let gone = Arc::clone(&gone);
            device.connect_control_lost(move |_| gone.store(true, Ordering::Relaxed));
        }
        let (stream, _) = stream_of(&refusal, &camera, settings.buffers)?;
        let probes = [
            probe(&refusal, &camera, &stream)?,
            probe(&refusal, &camera, &stream)?,
        ];
        let mut ids = Ids::new(probes[0].id, camera.is_gv_device());
        let [first, second] = probes.map(|probe| ids.before(probe.id, probe.lost));
        let anew = if first == second {
            Some(first)
        } else if second == ids.after(probes[0].id) {
            None
        } else {
            return Err(refusal.failed(format!(
                "expected numbers of frames that begin anew with each acquisition, or go on, found {first} and then {second}: \
                 a first frame that is lost could not be told"
            )));
        };
        ids.restart(first);
        set_trigger(&refusal, &camera, &settings)?;
        Ok(Self {
            region_px: (region_px.0 as i32, region_px.1 as i32),
            pixel_format: camera.pixel_format().map_err(refusal.feature("PixelFormat"))?,
            settings,
            binner,
            ids,
            anew,
            gone,
            acquiring: false,
            camera,
            stream,
            name,
        })
    }

    fn disconnected(&self) -> CameraError {
        CameraError::Disconnected {
            camera: self.name.clone(),
        }
    }
}

impl Camera for GenicamCamera {
    /// Maker, model and serial number.
    fn name(&self) -> &str {
        &self.name
    }

    fn format(&self) -> FrameFormat {
        self.binner.image()
    }

    fn settings(&self) -> Vec<String> {
        said_of(&self.camera, &self.settings)
    }

    fn arm(&mut self) -> Result<(), CameraError> {
        if self.gone.load(Ordering::Relaxed) {
            return Err(self.disconnected());
        }
        let refusal = Refusal(&self.name);
        if self.acquiring {
            self.camera
                .stop_acquisition()
                .map_err(refusal.feature("AcquisitionStop"))?;
        }
        let first = if let Some(first) = self.anew {
            first
        } else {
            let last = probe(&refusal, &self.camera, &self.stream)?.id;
            set_trigger(&refusal, &self.camera, &self.settings)?;
            self.ids.after(last)
        };
        take_back(&self.stream);
        self.ids.restart(first);
        self.camera
            .start_acquisition()
            .map_err(refusal.feature("AcquisitionStart"))?;
        self.acquiring = true;
        Ok(())
    }

    fn next_frame(&mut self, timeout: Duration) -> Result<Option<Frame>, CameraError> {
        let began = Instant::now();
        loop {
            let left = timeout.saturating_sub(began.elapsed());
            let buffer = if left.is_zero() {
                self.stream.try_pop_buffer()
            } else {
                self.stream.timeout_pop_buffer(left.min(POLL).as_micros() as u64)
            };
            let Some(buffer) = buffer else {
                if self.gone.load(Ordering::Relaxed) {
                    return Err(self.disconnected());
                }
                if left.is_zero() {
                    return Ok(None);
                }
                continue;
            };
            let frame = self.frame_of(&buffer);
            self.stream.push_buffer(buffer);
            // What did not arrive whole is told by its missing number.
            if let Some(frame) = frame? {
                return Ok(Some(frame));
            }
        }
    }
}

impl GenicamCamera {
    /// The frame in `buffer`; `None` if it did not arrive whole, or is of a run before.
    fn frame_of(&mut self, buffer: &Buffer) -> Result<Option<Frame>, CameraError> {
        if buffer.status() != BufferStatus::Success {
            return Ok(None);
        }
        let Some(id) = self.ids.number_of(buffer.frame_id()) else {
            return Ok(None);
        };
        let bytes = buffer.image_data();
        // libaravis cuts what does not fit to its buffer, and calls it whole.
        let (_, _, width, height) = buffer.image_region();
        let is_as_set = (width, height) == self.region_px
            && buffer.image_pixel_format() == self.pixel_format
            && bytes.len() == self.binner.frame_bytes();
        let dn = self.binner.image_of(&bytes, id).filter(|_| is_as_set).ok_or_else(|| {
            Refusal(&self.name).failed(format!(
                "expected frames of {}×{} pixels and {} bytes in the pixel format that was set, found one of {width}×{height} and {} \
                 bytes: has somebody else set its region or pixel format?",
                self.region_px.0,
                self.region_px.1,
                self.binner.frame_bytes(),
                bytes.len()
            ))
        })?;
        Ok(Some(Frame {
            id,
            timestamp_s: buffer.timestamp() as f64 * 1e-9,
            dn,
        }))
    }
}

impl Drop for GenicamCamera {
    fn drop(&mut self) {
        if self.acquiring {
            self.camera.stop_acquisition().ok();
        }
    }
}
