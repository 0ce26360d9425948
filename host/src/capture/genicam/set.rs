//! What a camera is told, and what it answers where it cannot.

use aravis::glib;
use aravis::{AcquisitionMode, CameraExt as _, ExposureMode};

use super::Refusal;
use crate::capture::camera::CameraError;
use crate::instrument::drivers::Genicam;

/// Sets pixel format and region. Returns the region's size, (width, height).
pub(super) fn set_image(
    refusal: &Refusal,
    camera: &aravis::Camera,
    settings: &Genicam,
    format_name: &str,
) -> Result<(usize, usize), CameraError> {
    let available = camera
        .dup_available_pixel_formats_as_strings()
        .map_err(refusal.feature("PixelFormat"))?;
    if !available.iter().any(|one| one == format_name) {
        let names: Vec<&str> = available.iter().map(glib::GString::as_str).collect();
        return Err(refusal.failed(format!(
            "camera.genicam.pixel_format: expected one of {}, found {format_name}",
            names.join(", ")
        )));
    }
    camera
        .set_pixel_format_from_string(format_name)
        .map_err(refusal.feature("PixelFormat"))?;
    let (sensor_width, sensor_height) = camera.sensor_size().map_err(refusal.feature("SensorWidth"))?;
    let [x, y, width, height] = match settings.region_px {
        None => [0, 0, sensor_width, sensor_height],
        Some(region) => region.map(|pixels| i32::try_from(pixels).unwrap_or(i32::MAX)),
    };
    let fits =
        |at: i32, size: i32, sensor: i32| size > 0 && at.checked_add(size).is_some_and(|end| end <= sensor);
    if !fits(x, width, sensor_width) || !fits(y, height, sensor_height) {
        return Err(refusal.failed(format!(
            "camera.genicam.region_px: expected [x, y, width, height] within the sensor of {sensor_width}×{sensor_height} \
             pixels, found [{x}, {y}, {width}, {height}]"
        )));
    }
    camera
        .set_region(x, y, width, height)
        .map_err(refusal.feature("Width, Height, OffsetX, OffsetY"))?;
    let found = camera.region().map_err(refusal.feature("Width, Height"))?;
    if found != (x, y, width, height) {
        let (x_px, y_px, width_px, height_px) = found;
        return Err(refusal.failed(format!(
            "camera.genicam.region_px: expected a region that the camera can read, found that it takes [{x_px}, {y_px}, \
             {width_px}, {height_px}] for [{x}, {y}, {width}, {height}]"
        )));
    }
    Ok((width as usize, height as usize))
}

/// Switches off what would change by itself, and sets gain and black level.
pub(super) fn set_levels(
    refusal: &Refusal,
    camera: &aravis::Camera,
    settings: &Genicam,
) -> Result<(), CameraError> {
    for feature in ["ExposureAuto", "GainAuto", "BlackLevelAuto", "BalanceWhiteAuto"] {
        if camera.is_feature_available(feature).unwrap_or(false) {
            camera
                .set_string(feature, "Off")
                .map_err(refusal.feature(feature))?;
        }
    }
    for (feature, value) in [("Gain", settings.gain), ("BlackLevel", settings.black_level)] {
        if let Some(value) = value {
            camera
                .set_float(feature, value)
                .map_err(refusal.feature(feature))?;
        }
    }
    Ok(())
}

/// Lets a line put out that the sensor is exposed.
pub(super) fn set_strobe(
    refusal: &Refusal,
    camera: &aravis::Camera,
    settings: &Genicam,
) -> Result<(), CameraError> {
    if settings.strobe_line.is_empty() {
        return Ok(());
    }
    let line = settings.strobe_line.as_str();
    let set = |feature: &str, value: &str| {
        camera.set_string(feature, value).map_err(|error| {
            refusal.failed(format!(
                "camera.genicam.strobe_line: expected a line {line} that puts out ExposureActive, found that {feature} = {value} \
                 is not to be had: {} (an empty strobe_line leaves it as it is)",
                error.message()
            ))
        })
    };
    set("LineSelector", line)?;
    // Many lines are outputs by their wiring, and cannot be set.
    if camera.string("LineMode").is_ok_and(|mode| mode != "Output") {
        set("LineMode", "Output")?;
    }
    set("LineSource", "ExposureActive")
}

/// Sets the size of packets, where there is a network.
pub(super) fn set_network(
    refusal: &Refusal,
    camera: &aravis::Camera,
    settings: &Genicam,
) -> Result<(), CameraError> {
    if !camera.is_gv_device() {
        return Ok(());
    }
    match settings.packet_bytes {
        None => camera
            .gv_auto_packet_size()
            .map_err(refusal.feature("GevSCPSPacketSize")),
        Some(bytes) => camera
            .gv_set_packet_size(i32::try_from(bytes).unwrap_or(i32::MAX))
            .map_err(refusal.feature("camera.genicam.packet_bytes")),
    }
}

/// The pixel format of the `settings`, or the one that is set.
pub(super) fn format_or_set(
    refusal: &Refusal,
    camera: &aravis::Camera,
    settings: &Genicam,
) -> Result<String, CameraError> {
    match &settings.pixel_format {
        Some(format) => Ok(format.clone()),
        None => Ok(camera
            .pixel_format_as_string()
            .map_err(refusal.feature("PixelFormat"))?
            .to_string()),
    }
}

/// Lets software trigger it, again and again, for `ExposureTime`.
pub(super) fn let_software_trigger(refusal: &Refusal, camera: &aravis::Camera) -> Result<(), CameraError> {
    set_mode(camera, "Timed").map_err(refusal.feature("ExposureMode"))?;
    camera
        .set_acquisition_mode(AcquisitionMode::Continuous)
        .map_err(refusal.feature("AcquisitionMode"))?;
    camera
        .set_trigger("Software")
        .map_err(refusal.feature("TriggerSource"))
}

/// Sets `ExposureMode`, where the camera has one.
fn set_mode(camera: &aravis::Camera, mode: &str) -> Result<(), glib::Error> {
    if camera.is_feature_available("ExposureMode")? {
        camera.set_string("ExposureMode", mode)?;
    }
    Ok(())
}

/// Lets the trigger line fire it, for as long as the line is active.
pub(super) fn set_trigger(
    refusal: &Refusal,
    camera: &aravis::Camera,
    settings: &Genicam,
) -> Result<(), CameraError> {
    let line = settings.trigger_line.as_str();
    let sources = camera
        .dup_available_trigger_sources()
        .map_err(refusal.feature("TriggerSource"))?;
    if !sources.iter().any(|one| one == line) {
        let names: Vec<&str> = sources.iter().map(glib::GString::as_str).collect();
        return Err(refusal.failed(format!(
            "camera.genicam.trigger_line: expected one of {}, found {line}",
            names.join(", ")
        )));
    }
    camera
        .set_trigger(line)
        .map_err(refusal.feature("TriggerSource"))?;
    camera.set_exposure_mode(ExposureMode::TriggerWidth).map_err(|error| {
        refusal.failed(format!(
            "ExposureMode: expected TriggerWidth, with which the trigger line says how long is exposed, found that the camera \
             has none: {}",
            error.message()
        ))
    })
}
