//! What drives the parts of an instrument: the keys of a rig file that say what stands on the table.
//!
//! # Design
//! `driver` names what is behind a seam; a table of the driver's name holds its settings. Nothing of it changes what an image
//! means: [`rig_hash`](crate::instrument::calibration::rig_hash) leaves it out, so that a calibration outlives another cable.
//!
//! | key | values |
//! |---|---|
//! | `camera.driver` | `virtual` (default), `genicam` with a table `[camera.genicam]`, `replay` with a table `[camera.replay]` |
//! | `projector.driver` | `virtual` (default), `files` with a table `[projector.files]`, `window` with a table `[projector.window]` |
//! | `trigger.port` | a serial port, or `auto` (default) to look for the box on USB |
//!
//! Camera and projector are real together, or virtual together: a real camera does not see a simulated lamp.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// What drives the camera.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CameraDriver {
    /// The virtual rig.
    #[default]
    Virtual,
    /// A GigE Vision or USB3 Vision camera.
    Genicam,
    /// An earlier measurement is shown again.
    Replay,
}

/// What drives the projector.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ProjectorDriver {
    /// The virtual rig.
    #[default]
    Virtual,
    /// Patterns are handed to another program as files.
    Files,
    /// A monitor that a window fills.
    Window,
}

impl CameraDriver {
    /// Whether it is the virtual rig.
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
    pub(super) fn is_virtual(&self) -> bool {
        *self == Self::Virtual
    }
}

impl ProjectorDriver {
    /// Whether it is the virtual rig.
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
    pub(super) fn is_virtual(&self) -> bool {
        *self == Self::Virtual
    }
}

/// Settings of a GenICam camera; names of features are those of the Standard Features Naming Convention (SFNC 2.7).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Genicam {
    /// Its identity, or a part of it that no other camera has: maker, model and serial number as `rcg camera list` shows them;
    /// `None` for the only one there is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// Region of the sensor that is read, [x, y, width, height] in pixels, which `camera.lens` describes; without a rig `None`
    /// stands for the whole sensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region_px: Option<[u32; 4]>,
    /// Name of the [`PixelFormat`](crate::instrument::pixel_format::PixelFormat), of as many channels and bits as the rig's camera has;
    /// without a rig `None` stands for what is set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_format: Option<String>,
    /// `TriggerSource`: the line that CAM of the trigger box is wired to.
    pub trigger_line: String,
    /// `LineSelector` of the line that puts out `ExposureActive`, wired to STROBE of the trigger box; empty where it is set by
    /// other means.
    pub strobe_line: String,
    /// `Gain`, in the camera's unit; `None` leaves what is set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    /// `BlackLevel`, in the camera's unit; `None` leaves what is set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub black_level: Option<f64>,
    /// Size of the network's packets, bytes; `None` to let the camera and the network find the largest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub packet_bytes: Option<u32>,
    /// Frames that may wait between the network and this program.
    pub buffers: u32,
}

impl Default for Genicam {
    fn default() -> Self {
        Self {
            device: None,
            region_px: None,
            pixel_format: None,
            trigger_line: "Line1".to_owned(),
            strobe_line: "Line2".to_owned(),
            gain: None,
            black_level: None,
            packet_bytes: None,
            buffers: 256,
        }
    }
}

/// The earlier measurement that is shown again.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Replay {
    /// Its folder, or its `raw.zarr`; see [`ReplayCamera`](crate::capture::replay::ReplayCamera).
    pub file: PathBuf,
}

/// Where the patterns go that another program shows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Files {
    /// The folder; see [`FilesProjector`](crate::capture::files::FilesProjector) for what is in it.
    pub folder: PathBuf,
    /// How long the program that shows them may take to load a sequence, s.
    #[serde(default = "a_minute")]
    pub patience_s: f64,
}

const fn a_minute() -> f64 {
    60.0
}

/// A monitor that a window fills, and a photodiode before it; see `capture/window`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Window {
    /// The X display, such as `:0`; `None` for the one that the variable `DISPLAY` names.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub display: Option<String>,
    /// Name of the monitor, or its number from 0 on; `None` for the only one there is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub monitor: Option<String>,
    /// What the photodiode looks at, whose light passes beside the mirror: [x, y, width, height] in pixels of the image.
    pub patch_px: [u32; 4],
    /// Display frames a second that the monitor must be set to; `None` for whatever it says that it is set to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refresh_hz: Option<f64>,
    /// Who says when a display frame begins.
    #[serde(default, skip_serializing_if = "Pace::is_vsync")]
    pub pace: Pace,
}

/// Who says when a display frame begins.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pace {
    /// The X server, by the Present extension.
    #[default]
    Vsync,
    /// A program that looks at the display, by messages to the window.
    Messages,
}

impl Pace {
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
    fn is_vsync(&self) -> bool {
        *self == Self::Vsync
    }
}

/// The trigger box.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Trigger {
    /// Its port, as [`link::open`](crate::capture::link::open) takes it.
    pub port: String,
}

impl Default for Trigger {
    fn default() -> Self {
        Self {
            port: "auto".to_owned(),
        }
    }
}
