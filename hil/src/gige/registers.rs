//! The camera's memory: what can be read and written where, and what that means.
//!
//! # Design
//! All that a client can set is in the bytes of this memory alone; [`Registers::config`] reads it from there.

use std::net::{Ipv4Addr, SocketAddrV4};

use super::gvcp::{self, Status};
use super::map;
use super::pixel_format::PixelFormat;
use super::settings::{
    AcquisitionMode, Chunks, Config, ExposureMode, Region, Settings, Trigger, TriggerActivation,
    TriggerSource,
};
use super::xml;

/// What has to happen because a register was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Effect {
    /// A test packet is to be fired.
    TestPacket,
    /// The stream channel was opened.
    Opened,
    /// The acquisition was started.
    Started,
    /// The frame trigger's software command came.
    SoftwareTrigger,
    /// The time is to be latched.
    Latch,
    /// The clock is to be reset.
    Reset,
}

/// The memory.
pub(super) struct Registers {
    bootstrap: Vec<u8>,
    device: Vec<u8>,
    xml: Vec<u8>,
    settings: Settings,
}

impl Registers {
    pub(super) fn new(settings: &Settings, stream_port: u16) -> Self {
        let mut text = xml::describe(settings).into_bytes();
        let url = format!("Local:rcg_camera.xml;{:x};{:x}", map::XML, text.len());
        // Memory is read in words.
        text.resize(text.len().next_multiple_of(4), 0);
        let mut registers = Self {
            bootstrap: vec![0; map::BOOTSTRAP_BYTES],
            device: vec![0; map::DEVICE_BYTES],
            xml: text,
            settings: settings.clone(),
        };
        registers.fill_bootstrap(&url, stream_port);
        registers.fill_device();
        registers
    }

    fn fill_bootstrap(&mut self, url: &str, stream_port: u16) {
        let settings = self.settings.clone();
        let address = settings.address.to_bits();
        let (extended, resend) = (u32::from(settings.extended_ids), u32::from(settings.resend));
        for (at, value) in [
            (
                map::VERSION,
                if settings.extended_ids { 0x2_0000 } else { 0x1_0002 },
            ),
            (map::DEVICE_MODE, 0x8000_0001),
            // A locally administered MAC address.
            (map::MAC_HIGH, 0x0200),
            (map::MAC_LOW, address),
            (map::IP_CAPABILITY, 5),
            (map::IP_CONFIGURATION, 5),
            (map::IP_ADDRESS, address),
            (map::SUBNET, 0xff00_0000),
            (map::INTERFACES, 1),
            (map::LINK_SPEED, 1000),
            (map::STREAM_CHANNELS, 1),
            (map::ACTIVE_LINKS, 1),
            (map::GVSP_CAPABILITY, 0xc000_0000),
            (map::GVCP_CAPABILITY, 0xf840_0003 | resend << 2),
            (map::HEARTBEAT, 3000),
            (map::TICK_HZ + 4, settings.tick_hz as u32),
            (map::PENDING_TIMEOUT, 50),
            (map::GVSP_CONFIGURATION, extended * map::EXTENDED_IDS),
            (map::LINK_CAPABILITY, 1),
            (map::PACKET_SIZE, settings.packet_bytes),
            (map::SOURCE_PORT, u32::from(stream_port)),
            (map::STREAM_CAPABILITY, u32::from(settings.chunks)),
            (map::STREAM_CONFIGURATION, u32::from(settings.chunks)),
        ] {
            self.set(at, value);
        }
        for ((at, bytes), text) in [
            (map::VENDOR, "RCG"),
            (map::MODEL, "Test camera"),
            (map::DEVICE_VERSION, env!("CARGO_PKG_VERSION")),
            (map::INFORMATION, "camera of the tests"),
            (map::SERIAL, settings.serial.as_str()),
            (map::URL, url),
        ] {
            let at = at as usize;
            // A zero remains behind each.
            debug_assert!(text.len() < bytes);
            self.bootstrap[at..at + text.len()].copy_from_slice(text.as_bytes());
        }
    }

    fn fill_device(&mut self) {
        let settings = self.settings.clone();
        let (width, height) = settings.sensor_px;
        for (at, value) in [
            (map::SENSOR_WIDTH, width),
            (map::SENSOR_HEIGHT, height),
            (map::WIDTH, width),
            (map::HEIGHT, height),
            (map::PIXEL_FORMAT, settings.formats[0].code()),
            // Line 2 is an output.
            (map::LINE + map::LINE_BANK, 1),
            (map::CHUNK_ENABLE, 1),
        ] {
            self.set(at, value);
        }
        self.set_f64(map::EXPOSURE_TIME, 100.0_f64.max(settings.exposure_step_us));
        self.set_f64(map::FRAME_RATE, 100.0);
        self.state_payload();
    }

    /// `length` bytes from `address`; an area is read up to its end only.
    fn area(&self, address: u32, length: usize) -> Result<&[u8], Status> {
        for (start, area) in [
            (0, &self.bootstrap),
            (map::DEVICE, &self.device),
            (map::XML, &self.xml),
        ] {
            let Some(at) = address.checked_sub(start).map(|at| at as usize) else {
                continue;
            };
            if at < area.len() {
                return area.get(at..at + length).ok_or(Status::InvalidAddress);
            }
        }
        Err(Status::InvalidAddress)
    }

    /// The register at `address`.
    pub(super) fn read(&self, address: u32) -> Result<u32, Status> {
        if !address.is_multiple_of(4) {
            return Err(Status::BadAlignment);
        }
        self.area(address, 4).map(|bytes| gvcp::u32_at(bytes, 0))
    }

    /// `count` bytes from `address`.
    pub(super) fn read_memory(&self, address: u32, count: u16) -> Result<&[u8], Status> {
        if !address.is_multiple_of(4) {
            return Err(Status::BadAlignment);
        }
        if !count.is_multiple_of(4) || !(4..=536).contains(&count) {
            return Err(Status::InvalidParameter);
        }
        self.area(address, usize::from(count))
    }

    /// What a discovery is answered with.
    pub(super) fn discovery(&self) -> &[u8] {
        &self.bootstrap[..map::DISCOVERY_BYTES]
    }

    /// A register that is known to exist.
    pub(super) fn get(&self, address: u32) -> u32 {
        self.area(address, 4).map_or(0, |bytes| gvcp::u32_at(bytes, 0))
    }

    fn get_f64(&self, address: u32) -> f64 {
        self.area(address, 8)
            .map_or(0.0, |bytes| f64::from_bits(gvcp::u64_at(bytes, 0)))
    }

    /// Sets a register that is known to exist, whatever clients may.
    pub(super) fn set(&mut self, address: u32, value: u32) {
        let (area, at) = if address < map::DEVICE {
            (&mut self.bootstrap, address as usize)
        } else {
            (&mut self.device, (address - map::DEVICE) as usize)
        };
        area[at..at + 4].copy_from_slice(&value.to_be_bytes());
    }

    fn set_f64(&mut self, address: u32, value: f64) {
        let bits = value.to_bits();
        self.set(address, (bits >> 32) as u32);
        self.set(address + 4, bits as u32);
    }

    /// Who controls the camera, for those who ask.
    pub(super) fn state_controller(&mut self, controller: Option<(SocketAddrV4, u32)>) {
        let (privilege, port, address) = controller.map_or((0, 0, 0), |(who, privilege)| {
            (privilege, u32::from(who.port()), who.ip().to_bits())
        });
        self.set(map::PRIVILEGE, privilege);
        self.set(map::CONTROLLER_PORT, port);
        self.set(map::CONTROLLER_ADDRESS, address);
    }

    /// Ends acquisition and stream, as when nobody controls the camera.
    pub(super) fn end_stream(&mut self) {
        self.set(map::ACQUISITION, 0);
        self.set(map::PARAMETERS_LOCKED, 0);
        self.set(map::STREAM_PORT, 0);
    }

    fn state_payload(&mut self) {
        let config = self.config(None);
        let bytes = super::gvsp::payload_bytes(config.image_bytes(), config.chunks);
        self.set(map::PAYLOAD_SIZE, bytes as u32);
    }

    /// Writes `value` at `address`, as a client may.
    pub(super) fn write(&mut self, address: u32, value: u32) -> Result<Option<Effect>, Status> {
        if !address.is_multiple_of(4) {
            return Err(Status::BadAlignment);
        }
        self.area(address, 4)?;
        self.check_lock(address)?;
        let (stored, effect) = self.accept(address, value)?;
        if let Some(stored) = stored {
            self.set(address, stored);
            self.state_payload();
        }
        Ok(effect)
    }

    /// Writes `bytes` from `address`: whole registers, one after the other.
    pub(super) fn write_memory(
        &mut self,
        address: u32,
        bytes: &[u8],
        effects: &mut Vec<Effect>,
    ) -> Result<(), (Status, usize)> {
        if !address.is_multiple_of(4) {
            return Err((Status::BadAlignment, 0));
        }
        if !bytes.len().is_multiple_of(4) {
            return Err((Status::InvalidParameter, 0));
        }
        let (name_at, name_bytes) = map::USER_NAME;
        if address == name_at && bytes.len() <= name_bytes {
            let at = name_at as usize;
            self.bootstrap[at..at + name_bytes].fill(0);
            self.bootstrap[at..at + bytes.len()].copy_from_slice(bytes);
            return Ok(());
        }
        let mut done = 0;
        while done < bytes.len() {
            let failed = |status| (status, done);
            let at = address
                .checked_add(done as u32)
                .ok_or((Status::InvalidAddress, done))?;
            if is_f64(at) {
                let value = bytes
                    .get(done..done + 8)
                    .ok_or((Status::InvalidParameter, done))?;
                let value = f64::from_bits(gvcp::u64_at(value, 0));
                self.write_f64(at, value).map_err(failed)?;
                done += 8;
            } else {
                let value = gvcp::u32_at(bytes, done);
                effects.extend(self.write(at, value).map_err(failed)?);
                done += 4;
            }
        }
        Ok(())
    }

    fn write_f64(&mut self, address: u32, value: f64) -> Result<(), Status> {
        let (least, most) = match address {
            map::EXPOSURE_TIME => map::EXPOSURE_US,
            map::GAIN => map::GAIN_DB,
            map::BLACK_LEVEL => map::BLACK_LEVELS,
            _ => map::FRAME_RATES_HZ,
        };
        if !(least..=most).contains(&value) {
            return Err(Status::InvalidParameter);
        }
        let value = if address == map::EXPOSURE_TIME {
            let step = self.settings.exposure_step_us;
            (value / step).round().max(1.0) * step
        } else {
            value
        };
        self.set_f64(address, value);
        Ok(())
    }

    fn check_lock(&self, address: u32) -> Result<(), Status> {
        let chunk_enable = map::CHUNK_ENABLE..map::CHUNK_ENABLE + 16;
        let lockable = matches!(
            address,
            map::WIDTH
                | map::HEIGHT
                | map::OFFSET_X
                | map::OFFSET_Y
                | map::PIXEL_FORMAT
                | map::ACQUISITION_MODE
                | map::CHUNK_MODE
        ) || chunk_enable.contains(&address);
        let locked = self.get(map::PARAMETERS_LOCKED) != 0 || self.get(map::ACQUISITION) != 0;
        if lockable && locked {
            return Err(Status::AccessDenied);
        }
        Ok(())
    }

    /// What is stored for `value` at `address`, if anything, and what it does.
    fn accept(&self, address: u32, value: u32) -> Result<(Option<u32>, Option<Effect>), Status> {
        let kept = |allowed: bool| {
            if allowed {
                Ok((Some(value), None))
            } else {
                Err(Status::InvalidParameter)
            }
        };
        let (sensor, step) = (self.settings.sensor_px, self.settings.step_px);
        let fits = |step: u32, beside: u32, sensor: u32| {
            value.is_multiple_of(step) && u64::from(value) + u64::from(beside) <= u64::from(sensor)
        };
        match address {
            map::WIDTH => kept(value > 0 && fits(step.0, self.get(map::OFFSET_X), sensor.0)),
            map::HEIGHT => kept(value > 0 && fits(step.1, self.get(map::OFFSET_Y), sensor.1)),
            map::OFFSET_X => kept(fits(step.0, self.get(map::WIDTH), sensor.0)),
            map::OFFSET_Y => kept(fits(step.1, self.get(map::HEIGHT), sensor.1)),
            map::PIXEL_FORMAT => kept(
                PixelFormat::from_code(value).is_some_and(|format| self.settings.formats.contains(&format)),
            ),
            map::ACQUISITION_MODE
            | map::FRAME_RATE_ENABLE
            | map::PARAMETERS_LOCKED
            | map::EXPOSURE_MODE
            | map::TRIGGER_SELECTOR => kept(value <= 1),
            map::LINE_SELECTOR => kept(value <= 2),
            map::CHUNK_SELECTOR => kept(value <= 3),
            map::CHUNK_MODE => kept(value == 0 || (value == 1 && self.settings.chunks)),
            map::ACQUISITION => {
                let (stored, _) = kept(value <= 1)?;
                let starts = value == 1 && self.get(map::ACQUISITION) == 0;
                Ok((stored, starts.then_some(Effect::Started)))
            }
            _ if is_f64(address) || is_f64(address.wrapping_sub(4)) => Err(Status::InvalidParameter),
            _ if address >= map::DEVICE => self.accept_banked(address, value),
            _ => self.accept_bootstrap(address, value),
        }
    }

    /// Registers that exist once for each trigger, line or chunk.
    fn accept_banked(&self, address: u32, value: u32) -> Result<(Option<u32>, Option<Effect>), Status> {
        let most = match address.checked_sub(map::TRIGGER) {
            Some(0x00 | 0x10 | 0x08 | 0x18) => 1,
            Some(0x04 | 0x14) => 2,
            Some(0x0c) if value == 1 => return Ok((None, Some(Effect::SoftwareTrigger))),
            // There is no acquisition to be started by it.
            Some(0x1c) if value == 1 => return Ok((None, None)),
            Some(0x0c | 0x1c) => return Err(Status::InvalidParameter),
            _ => match address.checked_sub(map::LINE) {
                // The source of the output.
                Some(0x0c) => 1,
                // The image is a chunk always, whatever is written.
                Some(0x20) if self.settings.chunks && value <= 1 => return Ok((Some(1), None)),
                Some(0x20 | 0x24 | 0x28 | 0x2c) if self.settings.chunks => 1,
                _ => return Err(Status::WriteProtect),
            },
        };
        if value > most {
            return Err(Status::InvalidParameter);
        }
        Ok((Some(value), None))
    }

    fn accept_bootstrap(&self, address: u32, value: u32) -> Result<(Option<u32>, Option<Effect>), Status> {
        let within = |(least, most): (u32, u32), value: u32| (least..=most).contains(&value);
        let (stored, effect) = match address {
            map::HEARTBEAT => (within(map::HEARTBEAT_MS, value).then_some(value), None),
            map::TIMESTAMP_CONTROL => {
                let effect = match value {
                    1 => Effect::Reset,
                    2 => Effect::Latch,
                    _ => return Err(Status::InvalidParameter),
                };
                return Ok((None, Some(effect)));
            }
            map::GVCP_CONFIGURATION => {
                let known = map::HEARTBEAT_DISABLE | map::EXTENDED_STATUS;
                ((value & !known == 0).then_some(value), None)
            }
            map::GVSP_CONFIGURATION => {
                let known = if self.settings.extended_ids {
                    map::EXTENDED_IDS
                } else {
                    0
                };
                ((value & !known == 0).then_some(value), None)
            }
            map::STREAM_PORT => {
                let opens = value != 0 && self.get(map::STREAM_PORT) == 0;
                (
                    (value <= 0xffff).then_some(value),
                    opens.then_some(Effect::Opened),
                )
            }
            map::PACKET_SIZE => {
                let size = value & 0xffff;
                let known = map::FIRE_TEST | map::DO_NOT_FRAGMENT | 0xffff;
                let right = value & !known == 0 && size.is_multiple_of(4) && within(map::PACKET_BYTES, size);
                let fires = value & map::FIRE_TEST != 0;
                (
                    right.then_some(value & !map::FIRE_TEST),
                    fires.then_some(Effect::TestPacket),
                )
            }
            map::PACKET_DELAY => (Some(value), None),
            map::DESTINATION => {
                // From a loopback address only this machine can be reached, as whoever controls the camera is.
                let near = Ipv4Addr::from(value).is_loopback() || value == self.get(map::CONTROLLER_ADDRESS);
                let reached = value == 0 || near || !self.settings.address.is_loopback();
                (reached.then_some(value), None)
            }
            _ => return Err(Status::WriteProtect),
        };
        stored
            .map(|stored| (Some(stored), effect))
            .ok_or(Status::InvalidParameter)
    }

    fn trigger(&self, selector: u32) -> Trigger {
        let bank = map::TRIGGER + selector * map::TRIGGER_BANK;
        Trigger {
            on: self.get(bank) == 1,
            source: match self.get(bank + 4) {
                0 => TriggerSource::Software,
                1 => TriggerSource::Line1,
                _ => TriggerSource::Line3,
            },
            activation: match self.get(bank + 8) {
                0 => TriggerActivation::RisingEdge,
                _ => TriggerActivation::FallingEdge,
            },
        }
    }

    /// What clients have set.
    pub(super) fn config(&self, controller: Option<SocketAddrV4>) -> Config {
        let port = self.get(map::STREAM_PORT) as u16;
        let destination = SocketAddrV4::new(self.get(map::DESTINATION).into(), port);
        let chunk = |selector: u32| self.get(map::CHUNK_ENABLE + 4 * selector) == 1;
        Config {
            region: Region {
                width: self.get(map::WIDTH),
                height: self.get(map::HEIGHT),
                offset_x: self.get(map::OFFSET_X),
                offset_y: self.get(map::OFFSET_Y),
            },
            format: PixelFormat::from_code(self.get(map::PIXEL_FORMAT)).unwrap_or(PixelFormat::Mono8),
            exposure_us: self.get_f64(map::EXPOSURE_TIME),
            exposure_mode: match self.get(map::EXPOSURE_MODE) {
                0 => ExposureMode::Timed,
                _ => ExposureMode::TriggerWidth,
            },
            gain_db: self.get_f64(map::GAIN),
            black_level: self.get_f64(map::BLACK_LEVEL),
            frame_start: self.trigger(0),
            acquisition_start: self.trigger(1),
            exposure_active: self.get(map::LINE + map::LINE_BANK + 4) == 1,
            acquiring: self.get(map::ACQUISITION) == 1,
            acquisition_mode: match self.get(map::ACQUISITION_MODE) {
                0 => AcquisitionMode::Continuous,
                _ => AcquisitionMode::SingleFrame,
            },
            frame_rate_hz: (self.get(map::FRAME_RATE_ENABLE) == 1).then(|| self.get_f64(map::FRAME_RATE)),
            chunks: Chunks {
                active: self.get(map::CHUNK_MODE) == 1,
                frame_id: chunk(1),
                timestamp: chunk(2),
                exposure_time: chunk(3),
            },
            extended_ids: self.get(map::GVSP_CONFIGURATION) & map::EXTENDED_IDS != 0,
            packet_bytes: self.get(map::PACKET_SIZE) & 0xffff,
            destination: (port != 0 && !destination.ip().is_unspecified()).then_some(destination),
            controller,
        }
    }
}

/// Whether a 64-bit floating-point number stands at `address`.
const fn is_f64(address: u32) -> bool {
    matches!(
        address,
        map::EXPOSURE_TIME | map::GAIN | map::BLACK_LEVEL | map::FRAME_RATE
    )
}
