//! How an open camera is set, in words: what `rig check` shows.

use aravis::CameraExt as _;
use aravis::glib;

use crate::instrument::drivers::Genicam;

/// Region, pixel format, trigger and strobe of the `camera` that was set as `settings` say, each with what else there is.
pub(super) fn said_of(camera: &aravis::Camera, settings: &Genicam) -> Vec<String> {
    let mut said = Vec::new();
    if let (Ok((x, y, width, height)), Ok((columns, rows))) = (camera.region(), camera.sensor_size()) {
        said.push(format!(
            "region {width}×{height} at ({x}, {y}) of {columns}×{rows} pixels"
        ));
    }
    if let Ok(format) = camera.pixel_format_as_string() {
        let all = camera.dup_available_pixel_formats_as_strings();
        said.push(format!("format {format}{}", of_all(all)));
    }
    let sources = camera.dup_available_trigger_sources();
    said.push(format!(
        "triggered by {}{}",
        settings.trigger_line,
        of_all(sources)
    ));
    if settings.strobe_line.is_empty() {
        said.push("lines that put out are as they were".to_owned());
    } else {
        let lines = camera.dup_available_enumerations_as_strings("LineSelector");
        let line = &settings.strobe_line;
        said.push(format!("exposure put out on {line}{}", of_all(lines)));
    }
    said
}

/// ` of A, B, C`, where the camera says so.
fn of_all(names: Result<Vec<glib::GString>, glib::Error>) -> String {
    match names {
        Ok(names) if !names.is_empty() => {
            let names: Vec<&str> = names.iter().map(glib::GString::as_str).collect();
            format!(" of {}", names.join(", "))
        }
        _ => String::new(),
    }
}
