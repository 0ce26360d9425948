//! What drives the parts of an instrument: the keys of a rig file that say what stands on the table.
//!
//! # Design
//! `driver` names what is behind a seam; a table of the driver's name holds its settings. Nothing of it changes what an image
//! means: [`rig_hash`](crate::instrument::calibration::rig_hash) leaves it out, so that a calibration outlives another cable.
//!
//! | key | values |
//! |---|---|
//! | `camera.driver` | `virtual` (default), `genicam` with a table `[camera.genicam]`, `replay` with a table `[camera.replay]` |
//! | `projector.driver` | `virtual` (default), `files` with a table `[projector.files]`, `dlpc900` with a table `[projector.dlpc900]`, `window` with a table `[projector.window]` |
//! | `trigger.port` | a serial port, `serial:` and the box's serial number, or `auto` (default) to look for the box on USB |
//! | other keys of `[trigger]` | what lies between the box and the parts, see [`Trigger`] |
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
    /// A Texas Instruments DLPC900 with its micromirrors.
    Dlpc900,
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

/// Shortest exposure of a pattern of one bit on a DLPC900, µs: 9,523 patterns a second (DLPS037H).
pub const SHORTEST_US: u32 = 105;
/// Longest exposure, µs: 24 bits (DLPU018J, 2.4.4.3.4).
pub const LONGEST_US: u32 = (1 << 24) - 1;
/// Shortest time from an edge at TRIG_IN_1 to the pattern, µs.
pub const SHORTEST_DELAY_US: u16 = 104;
/// By how much the edges of TRIG_OUT_1 may be late, µs.
pub const SYNC_LATE_US: std::ops::RangeInclusive<i16> = -20..=20_000;

/// Settings of a DLPC900; see [`Dlpc900Projector`](crate::capture::dlpc900::Dlpc900Projector) for what they do.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Dlpc900 {
    /// Its serial number, a part of it or its device file, as `rcg projector list` shows them, or `tcp:HOST:PORT`; `None` for the only
    /// one there is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// How long a pattern is exposed and TRIG_OUT_1 frames it, µs; `None` for as long as the camera looks at it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure_us: Option<u32>,
    /// Whether a pattern stays until the next trigger, else it goes when its exposure is over.
    pub hold: bool,
    /// From the edge of PROJ at TRIG_IN_1 to the pattern, µs.
    pub trigger_delay_us: u16,
    /// Which edge of TRIG_IN_1 shows the next pattern.
    pub trigger_edge: Edge,
    /// Whether TRIG_OUT_1 is low while a pattern is exposed.
    pub sync_inverted: bool,
    /// By how much TRIG_OUT_1 is late, µs: its edge at the start of the exposure and that at its end.
    pub sync_late_us: [i16; 2],
    /// Whether red, green and blue lights are switched by the unit's outputs, so that it can show one primary alone.
    pub primaries: bool,
}

impl Default for Dlpc900 {
    fn default() -> Self {
        Self {
            device: None,
            exposure_us: None,
            hold: true,
            trigger_delay_us: 105,
            trigger_edge: Edge::Rising,
            sync_inverted: false,
            sync_late_us: [0, 0],
            primaries: false,
        }
    }
}

/// An edge of a trigger.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Edge {
    /// From low to high.
    #[default]
    Rising,
    /// From high to low.
    Falling,
}

/// A line of the trigger box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TriggerLine {
    /// To the projector's trigger.
    Proj,
    /// To the camera's trigger.
    Cam,
    /// From the projector.
    Sync,
    /// From the camera.
    Strobe,
    /// To a light source, a shutter or a second camera.
    AuxA,
    /// As [`AuxA`](Self::AuxA).
    AuxB,
    /// From a photodiode.
    Photo,
    /// From what begins a run.
    Start,
}

/// What a further output of the box does in every step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AuxOutput {
    /// What its delay counts from.
    pub from: AuxFrom,
    /// From there to the leading edge, at the box's pins, s.
    #[serde(default)]
    pub delay_s: f64,
    /// Length of the pulse, s; that of CAM where nothing is said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width_s: Option<f64>,
}

/// What the delay of a further output counts from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AuxFrom {
    /// The start of the step.
    Step,
    /// The leading edge of CAM; steps without CAM have no pulse.
    Cam,
}

/// What begins a run and its steps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TriggerPace {
    /// The box by itself.
    #[default]
    Free,
    /// An edge of SYNC begins the run.
    SyncStart,
    /// Each step begins on an edge of SYNC of its own.
    SyncEach,
    /// An edge of START begins the run.
    StartLine,
}

/// By how much what lies between delays a leading edge and a trailing one, s.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Delay(pub [f64; 2]);

/// The longest delay of an edge, s: optocouplers have some ten microseconds.
pub const LONGEST_DELAY_S: f64 = 1e-3;
/// The longest glitch of STROBE, s: what is longer is an exposure, or a pause between two.
pub const LONGEST_GLITCH_S: f64 = 1e-3;
/// The longest delay and the longest pulse of a further output, s: steps with such are no longer.
pub const LONGEST_AUX_S: f64 = 18.0;
/// The longest time that SYNC may be awaited, s.
pub const LONGEST_SYNC_TIMEOUT_S: f64 = 4294.0;

/// The trigger box, and what lies between it and the parts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Trigger {
    /// Its port, as [`link::open`](crate::capture::link::open) takes it.
    pub port: String,
    /// Lines that rest high and pulse low. The box keeps that over resets.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub active_low: Vec<TriggerLine>,
    /// What begins a run and its steps.
    #[serde(skip_serializing_if = "is_default")]
    pub pace: TriggerPace,
    /// How long SYNC may be awaited, s; 0 for ever.
    #[serde(skip_serializing_if = "is_default")]
    pub sync_timeout_s: f64,
    /// STROBE is taken for what it was where it changes for less than this, s; 0 for no glitches.
    #[serde(skip_serializing_if = "is_default")]
    pub strobe_filter_s: f64,
    /// From PROJ of the box to the projector's input.
    #[serde(skip_serializing_if = "is_default")]
    pub proj_delay_s: Delay,
    /// From CAM of the box to the camera's input.
    #[serde(skip_serializing_if = "is_default")]
    pub cam_delay_s: Delay,
    /// From the camera's output to STROBE of the box.
    #[serde(skip_serializing_if = "is_default")]
    pub strobe_delay_s: Delay,
    /// What AUX-A does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aux_a: Option<AuxOutput>,
    /// What AUX-B does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aux_b: Option<AuxOutput>,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl Default for Trigger {
    fn default() -> Self {
        Self {
            port: "auto".to_owned(),
            active_low: Vec::new(),
            pace: TriggerPace::default(),
            sync_timeout_s: 0.0,
            strobe_filter_s: 0.0,
            proj_delay_s: Delay::default(),
            cam_delay_s: Delay::default(),
            strobe_delay_s: Delay::default(),
            aux_a: None,
            aux_b: None,
        }
    }
}
