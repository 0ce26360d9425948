//! Which cameras there are, and what they can do.

use std::sync::{Mutex, OnceLock, PoisonError};

use aravis::CameraExt as _;
use serde::Serialize;

use super::{Refusal, open_device};
use crate::capture::camera::CameraError;

/// A camera that answers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Listed {
    /// What opens it: maker, model and serial number.
    pub id: String,
    /// Maker.
    pub vendor: String,
    /// Model.
    pub model: String,
    /// `GigEVision` or `USB3Vision`.
    pub protocol: String,
    /// Network address, or place on the bus.
    pub address: String,
}

/// The cameras that answer on the network and USB; on the network that takes a second.
#[must_use]
pub fn list() -> Vec<Listed> {
    static ARAVIS: OnceLock<Mutex<aravis::Aravis>> = OnceLock::new();
    let aravis = ARAVIS.get_or_init(|| {
        Mutex::new(aravis::Aravis::initialize().expect("invariant: it is initialised here alone"))
    });
    let aravis = aravis.lock().unwrap_or_else(PoisonError::into_inner);
    let text = |text: std::ffi::CString| text.to_string_lossy().into_owned();
    let mut found: Vec<Listed> = aravis
        .get_device_list()
        .into_iter()
        .map(|device| Listed {
            id: text(device.id),
            vendor: text(device.vendor),
            model: text(device.model),
            protocol: text(device.protocol),
            address: text(device.address),
        })
        .collect();
    found.sort_by(|a, b| a.id.cmp(&b.id));
    found.dedup();
    found
}

/// What a camera can do and how it is set.
#[expect(clippy::struct_excessive_bools, reason = "each is a capability of its own")]
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Details {
    /// Its identity.
    pub id: String,
    /// Maker.
    pub vendor: String,
    /// Model.
    pub model: String,
    /// Serial number.
    pub serial: String,
    /// Size of the sensor, pixels (width, height).
    pub sensor_px: (u32, u32),
    /// Region that is read, pixels (x, y, width, height).
    pub region_px: (u32, u32, u32, u32),
    /// Pixel format.
    pub pixel_format: String,
    /// Pixel formats that there are.
    pub pixel_formats: Vec<String>,
    /// What can trigger it.
    pub trigger_sources: Vec<String>,
    /// Whether the width of the trigger pulse can say how long is exposed.
    pub trigger_width: bool,
    /// Whether a line can put out that it is exposed.
    pub exposure_active: bool,
    /// Whether it can be triggered by software.
    pub software_trigger: bool,
    /// Shortest and longest exposure time, s.
    pub exposure_s: (f64, f64),
    /// Gain and its range, in the camera's unit.
    pub gain: Option<(f64, f64, f64)>,
    /// Bytes of a packet on the network.
    pub packet_bytes: Option<u32>,
    /// Whether frames can carry chunks of data.
    pub chunks: bool,
}

/// What the camera can do of which `device` is the identity, the address, or a part of the identity; the only one without it.
///
/// # Errors
/// [`CameraError`] where there is none, or more than one.
pub fn details(device: Option<&str>) -> Result<Details, CameraError> {
    let (id, camera) = open_device(device)?;
    let refusal = Refusal(&id);
    let has = |feature: &str| camera.is_feature_available(feature).unwrap_or(false);
    let entry = |feature: &str, value: &str| {
        camera
            .dup_available_enumerations_as_strings(feature)
            .is_ok_and(|entries| entries.iter().any(|one| one == value))
    };
    let words = |words: Result<Vec<aravis::glib::GString>, aravis::glib::Error>| -> Vec<String> {
        words
            .unwrap_or_default()
            .iter()
            .map(ToString::to_string)
            .collect()
    };
    let (width, height) = camera.sensor_size().map_err(refusal.feature("SensorWidth"))?;
    let (x, y, columns, rows) = camera.region().map_err(refusal.feature("Width"))?;
    let (shortest_us, longest_us) = camera.exposure_time_bounds().unwrap_or((f64::NAN, f64::NAN));
    let positive = |number: i32| u32::try_from(number).unwrap_or(0);
    Ok(Details {
        vendor: camera
            .vendor_name()
            .map_err(refusal.feature("DeviceVendorName"))?
            .to_string(),
        model: camera
            .model_name()
            .map_err(refusal.feature("DeviceModelName"))?
            .to_string(),
        serial: camera
            .device_serial_number()
            .map_or_else(|_| "unknown".to_owned(), |serial| serial.to_string()),
        sensor_px: (positive(width), positive(height)),
        region_px: (positive(x), positive(y), positive(columns), positive(rows)),
        pixel_format: camera
            .pixel_format_as_string()
            .map_err(refusal.feature("PixelFormat"))?
            .to_string(),
        pixel_formats: words(camera.dup_available_pixel_formats_as_strings()),
        trigger_sources: words(camera.dup_available_trigger_sources()),
        trigger_width: entry("ExposureMode", "TriggerWidth"),
        exposure_active: entry("LineSource", "ExposureActive"),
        software_trigger: has("TriggerSoftware"),
        exposure_s: (shortest_us * 1e-6, longest_us * 1e-6),
        gain: camera
            .gain()
            .ok()
            .zip(camera.gain_bounds().ok())
            .map(|(gain, (low, high))| (gain, low, high)),
        packet_bytes: if camera.is_gv_device() {
            camera.gv_get_packet_size().ok()
        } else {
            None
        },
        chunks: has("ChunkModeActive"),
        id,
    })
}
