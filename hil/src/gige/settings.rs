//! What a camera is, and what a client has made of it.

use std::net::{Ipv4Addr, SocketAddrV4};

use super::GigeError;
use super::map;
use super::pixel_format::PixelFormat;

/// What a camera is.
#[expect(clippy::struct_excessive_bools, reason = "each is a capability of its own")]
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Its address. Loopback addresses (127.0.0.2 …) of their own let several cameras run at once.
    pub address: Ipv4Addr,
    /// Serial number, at most 15 bytes of ASCII.
    pub serial: String,
    /// Width and height of the sensor, at most 16,384 each.
    pub sensor_px: (u32, u32),
    /// Widths and horizontal offsets, heights and vertical offsets are multiples of these; at least 1.
    pub step_px: (u32, u32),
    /// Pixel formats that a client can choose; the first is chosen at the start.
    pub formats: Vec<PixelFormat>,
    /// Exposure times are rounded to multiples of this, in µs.
    pub exposure_step_us: f64,
    /// Whether block ids have 64 bits when a client connects; else there are those of 16 bits only.
    pub extended_ids: bool,
    /// Whether packets are sent again when a client asks for them.
    pub resend: bool,
    /// Whether frames can carry chunks.
    pub chunks: bool,
    /// The id of the first frame after the stream channel was opened; of 16-bit ids 65,535 is followed by 1.
    pub first_id: u64,
    /// Whether ids begin again with each start of the acquisition, too.
    pub ids_per_acquisition: bool,
    /// Size of the stream's IP datagrams at the start in bytes, a multiple of 4 from 220 to 65,500.
    pub packet_bytes: u32,
    /// Ticks of its clock in a second, up to 10^9.
    pub tick_hz: u64,
    /// Whether it is found by broadcast, too: by one camera of a machine at a time, the others are found at their
    /// addresses.
    pub broadcast: bool,
}

impl Default for Settings {
    /// A camera of 2,048 × 2,048 pixels at 127.0.0.2, as most are: 16-bit ids from 1, resends, chunks, ticks of 1 ns.
    fn default() -> Self {
        Self {
            address: Ipv4Addr::new(127, 0, 0, 2),
            serial: "RCG1".into(),
            sensor_px: (2048, 2048),
            step_px: (1, 1),
            formats: vec![
                PixelFormat::Mono8,
                PixelFormat::Mono12,
                PixelFormat::Mono12Packed,
                PixelFormat::Mono16,
                PixelFormat::BayerRG8,
                PixelFormat::BayerRG12,
                PixelFormat::BayerRG16,
                PixelFormat::Rgb8,
                PixelFormat::Rgb16,
            ],
            exposure_step_us: 1.0,
            extended_ids: false,
            resend: true,
            chunks: true,
            first_id: 1,
            ids_per_acquisition: false,
            packet_bytes: 1500,
            tick_hz: 1_000_000_000,
            broadcast: true,
        }
    }
}

impl Settings {
    pub(super) fn check(&self) -> Result<(), GigeError> {
        let refused = |field, expected: &str, found: String| {
            Err(GigeError::Settings {
                field,
                expected: expected.into(),
                found,
            })
        };
        let (width, height) = self.sensor_px;
        if !(1..=16_384).contains(&width) || !(1..=16_384).contains(&height) {
            return refused("sensor_px", "1 to 16384 pixels", format!("{width} × {height}"));
        }
        let (across, down) = self.step_px;
        let whole = |step: u32, size: u32| step > 0 && size.is_multiple_of(step);
        if !whole(across, width) || !whole(down, height) {
            return refused("step_px", "divisors of the sensor", format!("{across} × {down}"));
        }
        if self.serial.is_empty() || self.serial.len() > 15 || !self.serial.is_ascii() {
            return refused("serial", "1 to 15 bytes of ASCII", self.serial.clone());
        }
        if self.formats.is_empty() {
            return refused("formats", "at least one", "none".into());
        }
        if !(self.exposure_step_us.is_finite() && self.exposure_step_us > 0.0) {
            let found = self.exposure_step_us.to_string();
            return refused("exposure_step_us", "a positive time", found);
        }
        let last = if self.extended_ids { u64::MAX } else { 65_535 };
        if !(1..=last).contains(&self.first_id) {
            return refused("first_id", "from 1 to the largest id", self.first_id.to_string());
        }
        let (least, most) = map::PACKET_BYTES;
        if !(least..=most).contains(&self.packet_bytes) || !self.packet_bytes.is_multiple_of(4) {
            let found = self.packet_bytes.to_string();
            return refused("packet_bytes", "a multiple of 4 from 220 to 65500", found);
        }
        if !(1..=1_000_000_000).contains(&self.tick_hz) {
            return refused("tick_hz", "1 to 1000000000", self.tick_hz.to_string());
        }
        Ok(())
    }
}

/// A part of the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Columns left of it.
    pub offset_x: u32,
    /// Rows above it.
    pub offset_y: u32,
}

/// What starts an exposure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TriggerSource {
    /// The command `TriggerSoftware`.
    Software,
    /// The trigger line.
    Line1,
    /// Another input, with nothing at it.
    Line3,
}

/// Which change of the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TriggerActivation {
    /// From low to high.
    RisingEdge,
    /// From high to low.
    FallingEdge,
}

/// One of the two triggers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trigger {
    /// `TriggerMode`.
    pub on: bool,
    /// `TriggerSource`.
    pub source: TriggerSource,
    /// `TriggerActivation`.
    pub activation: TriggerActivation,
}

/// How long is exposed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExposureMode {
    /// As `ExposureTime` says.
    Timed,
    /// As long as the trigger line is active.
    TriggerWidth,
}

/// When an acquisition ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AcquisitionMode {
    /// When it is stopped.
    Continuous,
    /// After one frame.
    SingleFrame,
}

/// Which chunks frames carry.
#[expect(clippy::struct_excessive_bools, reason = "each is a register of its own")]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Chunks {
    /// `ChunkModeActive`; without it there are none, whatever is enabled.
    pub active: bool,
    /// The frame's id.
    pub frame_id: bool,
    /// The frame's time-stamp in ticks.
    pub timestamp: bool,
    /// The exposure time in µs.
    pub exposure_time: bool,
}

/// What clients have set.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The part of the sensor that is read.
    pub region: Region,
    /// The pixel format.
    pub format: PixelFormat,
    /// `ExposureTime` in µs.
    pub exposure_us: f64,
    /// `ExposureMode`.
    pub exposure_mode: ExposureMode,
    /// `Gain` in dB.
    pub gain_db: f64,
    /// `BlackLevel` in digital numbers.
    pub black_level: f64,
    /// The trigger of single frames.
    pub frame_start: Trigger,
    /// The trigger of the acquisition. While it is on no frame is exposed, as nothing gives it here.
    pub acquisition_start: Trigger,
    /// Whether the output, line 2, is active during exposures.
    pub exposure_active: bool,
    /// Whether images are acquired.
    pub acquiring: bool,
    /// `AcquisitionMode`.
    pub acquisition_mode: AcquisitionMode,
    /// `AcquisitionFrameRate` in Hz where that is enabled.
    pub frame_rate_hz: Option<f64>,
    /// Chunks.
    pub chunks: Chunks,
    /// Whether block ids have 64 bits.
    pub extended_ids: bool,
    /// Size of the stream's IP datagrams in bytes.
    pub packet_bytes: u32,
    /// Where the stream goes, if its channel is open.
    pub destination: Option<SocketAddrV4>,
    /// Who controls the camera.
    pub controller: Option<SocketAddrV4>,
}

impl Config {
    /// Bytes of an image.
    pub fn image_bytes(&self) -> usize {
        self.format.image_bytes(self.region.width, self.region.height)
    }
}
