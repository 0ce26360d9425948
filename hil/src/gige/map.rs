//! Where the registers stand.
//!
//! # Bootstrap registers (GigE Vision 2.x, "Bootstrap registers"; big-endian, bit 0 is the most significant one)
//! | address | register | access | here |
//! |---|---|---|---|
//! | 0000 | version | R | 2.0, without 64-bit ids 1.2 |
//! | 0004 | device mode | R | 8000_0001: big-endian, transmitter, UTF-8 |
//! | 0008, 000c | MAC address | R | 02:00 and the IP address |
//! | 0010, 0014 | interface capability, configuration | R | persistent IP, LLA |
//! | 0024, 0034, 0044 | IP address, subnet mask, gateway | R | that of the settings, 255.0.0.0, 0 |
//! | 0048, 0068, 0088, 00a8 | vendor (32 B), model (32), version (32), information (48) | R | |
//! | 00d8, 00e8 | serial number (16), user-defined name (16) | R, R/W | |
//! | 0200, 0400 | URLs of the XML (512 each) | R | `Local:…;address;length` in hexadecimal digits |
//! | 0600, 0670 | number of interfaces, link speed in Mbit/s | R | 1, 1000 |
//! | 0900, 0904, 0910 | message channels, stream channels, active links | R | 0, 1, 1 |
//! | 092c | GVSP capability | R | source port, 16-bit ids |
//! | 0934 | GVCP capability | R | name, serial number, heartbeat disable, link speed, CCP address, extended status, resend, write memory, concatenation |
//! | 0938 | heartbeat time-out in ms | R/W | 500 or more, at first 3000 |
//! | 093c, 0940 | tick frequency in Hz, high and low | R | |
//! | 0944, 0948, 094c | time-stamp control (2 latch, 1 reset), latched value | W, R | |
//! | 0954 | GVCP configuration | R/W | bit 31 heartbeat disable, bit 29 extended status |
//! | 0958 | pending time-out in ms | R | 50 |
//! | 0960 | GVSP configuration | R/W | bit 1: 64-bit ids |
//! | 0964, 0968 | link configuration capability, in use | R | 1, 0 |
//! | 0a00, 0a04, 0a14 | control channel privilege (2 control, 1 exclusive), port and address of who has it | R/W, R | |
//! | 0d00 | stream channel port | R/W | 0 closes the channel |
//! | 0d04 | stream packet size | R/W | bit 0 fires a test packet, bit 1 do not fragment (kept only), bytes of IP datagrams in bits 16–31 |
//! | 0d08 | packet delay in ticks | R/W | kept only |
//! | 0d18, 0d1c | destination's address, source port | R/W, R | |
//! | 0d20, 0d24 | stream channel capability, configuration | R | extended chunk data |
//!
//! # Registers of this camera (described to clients by the XML, names of the GenICam SFNC 2.x)
//! Four bytes each, but for the 64-bit floating-point numbers marked `f64`. Those with `*` are locked while
//! `TLParamsLocked` is 1 or images are acquired.
//!
//! | address | register | values |
//! |---|---|---|
//! | 10000, 10004 | `SensorWidth`, `SensorHeight` | read only |
//! | 10008, 1000c * | `Width`, `Height` | a step … what the sensor has beyond the offset |
//! | 10010, 10014 * | `OffsetX`, `OffsetY` | 0 … |
//! | 10018 * | `PixelFormat` | PFNC |
//! | 1001c | `PayloadSize` | read only, with chunks |
//! | 10020 * | `AcquisitionMode` | 0 continuous, 1 single frame |
//! | 10024 | `AcquisitionStart`, `AcquisitionStop` | 1, 0 |
//! | 10028 | `AcquisitionFrameRateEnable` | 0, 1 |
//! | 1002c | `TLParamsLocked` | 0, 1 |
//! | 10030 | `ExposureMode` | 0 timed, 1 width of the trigger |
//! | 10034 | `TriggerSelector` | 0 frame start, 1 acquisition start |
//! | 10038 | `LineSelector` | 0 line 1 (in), 1 line 2 (out), 2 line 3 (in) |
//! | 1003c | `ChunkSelector` | 0 image, 1 frame id, 2 time-stamp, 3 exposure time |
//! | 10040 * | `ChunkModeActive` | 0, 1 |
//! | 10048 | `ExposureTime` | f64, µs |
//! | 10050 | `Gain` | f64, dB |
//! | 10058 | `BlackLevel` | f64, digital numbers |
//! | 10060 | `AcquisitionFrameRate` | f64, Hz |
//! | 10080 + 16 selector | `TriggerMode` (0 off, 1 on), `TriggerSource` (0 software, 1 line 1, 2 line 3), `TriggerActivation` (0 rising, 1 falling), `TriggerSoftware` (1) | |
//! | 100a0 + 8 line | `LineMode` (0 in, 1 out; read only), `LineSource` (0 off, 1 exposure active; line 2 only) | |
//! | 100c0 + 4 selector * | `ChunkEnable` | 0, 1; that of the image stays 1 |
//! | 20000 | the XML | read only |

pub(super) const VERSION: u32 = 0x0000;
pub(super) const DEVICE_MODE: u32 = 0x0004;
pub(super) const MAC_HIGH: u32 = 0x0008;
pub(super) const MAC_LOW: u32 = 0x000c;
pub(super) const IP_CAPABILITY: u32 = 0x0010;
pub(super) const IP_CONFIGURATION: u32 = 0x0014;
pub(super) const IP_ADDRESS: u32 = 0x0024;
pub(super) const SUBNET: u32 = 0x0034;
pub(super) const VENDOR: (u32, usize) = (0x0048, 32);
pub(super) const MODEL: (u32, usize) = (0x0068, 32);
pub(super) const DEVICE_VERSION: (u32, usize) = (0x0088, 32);
pub(super) const INFORMATION: (u32, usize) = (0x00a8, 48);
pub(super) const SERIAL: (u32, usize) = (0x00d8, 16);
pub(super) const USER_NAME: (u32, usize) = (0x00e8, 16);
/// What a discovery is answered with: the memory up to here.
pub(super) const DISCOVERY_BYTES: usize = 0xf8;
pub(super) const URL: (u32, usize) = (0x0200, 512);
pub(super) const INTERFACES: u32 = 0x0600;
pub(super) const LINK_SPEED: u32 = 0x0670;
pub(super) const STREAM_CHANNELS: u32 = 0x0904;
pub(super) const ACTIVE_LINKS: u32 = 0x0910;
pub(super) const GVSP_CAPABILITY: u32 = 0x092c;
pub(super) const GVCP_CAPABILITY: u32 = 0x0934;
pub(super) const HEARTBEAT: u32 = 0x0938;
pub(super) const TICK_HZ: u32 = 0x093c;
pub(super) const TIMESTAMP_CONTROL: u32 = 0x0944;
pub(super) const TIMESTAMP: u32 = 0x0948;
pub(super) const GVCP_CONFIGURATION: u32 = 0x0954;
pub(super) const PENDING_TIMEOUT: u32 = 0x0958;
pub(super) const GVSP_CONFIGURATION: u32 = 0x0960;
pub(super) const LINK_CAPABILITY: u32 = 0x0964;
pub(super) const PRIVILEGE: u32 = 0x0a00;
pub(super) const CONTROLLER_PORT: u32 = 0x0a04;
pub(super) const CONTROLLER_ADDRESS: u32 = 0x0a14;
pub(super) const STREAM_PORT: u32 = 0x0d00;
pub(super) const PACKET_SIZE: u32 = 0x0d04;
pub(super) const PACKET_DELAY: u32 = 0x0d08;
pub(super) const DESTINATION: u32 = 0x0d18;
pub(super) const SOURCE_PORT: u32 = 0x0d1c;
pub(super) const STREAM_CAPABILITY: u32 = 0x0d20;
pub(super) const STREAM_CONFIGURATION: u32 = 0x0d24;
/// The bootstrap registers end here.
pub(super) const BOOTSTRAP_BYTES: usize = 0x1000;

/// In the stream packet size: fire a test packet.
pub(super) const FIRE_TEST: u32 = 1 << 31;
/// In the stream packet size: do not fragment.
pub(super) const DO_NOT_FRAGMENT: u32 = 1 << 30;
/// In the GVSP configuration: 64-bit block ids.
pub(super) const EXTENDED_IDS: u32 = 1 << 30;
/// In the GVCP configuration: the heartbeat is disabled.
pub(super) const HEARTBEAT_DISABLE: u32 = 1;
/// In the GVCP configuration: resent packets say that they are.
pub(super) const EXTENDED_STATUS: u32 = 1 << 2;
/// In the privilege: exclusive access.
pub(super) const EXCLUSIVE: u32 = 1;
/// In the privilege: control access.
pub(super) const CONTROL: u32 = 2;

/// This camera's own registers.
pub(super) const DEVICE: u32 = 0x1_0000;
pub(super) const DEVICE_BYTES: usize = 0xd0;
pub(super) const SENSOR_WIDTH: u32 = DEVICE;
pub(super) const SENSOR_HEIGHT: u32 = DEVICE + 0x04;
pub(super) const WIDTH: u32 = DEVICE + 0x08;
pub(super) const HEIGHT: u32 = DEVICE + 0x0c;
pub(super) const OFFSET_X: u32 = DEVICE + 0x10;
pub(super) const OFFSET_Y: u32 = DEVICE + 0x14;
pub(super) const PIXEL_FORMAT: u32 = DEVICE + 0x18;
pub(super) const PAYLOAD_SIZE: u32 = DEVICE + 0x1c;
pub(super) const ACQUISITION_MODE: u32 = DEVICE + 0x20;
pub(super) const ACQUISITION: u32 = DEVICE + 0x24;
pub(super) const FRAME_RATE_ENABLE: u32 = DEVICE + 0x28;
pub(super) const PARAMETERS_LOCKED: u32 = DEVICE + 0x2c;
pub(super) const EXPOSURE_MODE: u32 = DEVICE + 0x30;
pub(super) const TRIGGER_SELECTOR: u32 = DEVICE + 0x34;
pub(super) const LINE_SELECTOR: u32 = DEVICE + 0x38;
pub(super) const CHUNK_SELECTOR: u32 = DEVICE + 0x3c;
pub(super) const CHUNK_MODE: u32 = DEVICE + 0x40;
pub(super) const EXPOSURE_TIME: u32 = DEVICE + 0x48;
pub(super) const GAIN: u32 = DEVICE + 0x50;
pub(super) const BLACK_LEVEL: u32 = DEVICE + 0x58;
pub(super) const FRAME_RATE: u32 = DEVICE + 0x60;
/// The first trigger's bank, of the start of a frame.
pub(super) const TRIGGER: u32 = DEVICE + 0x80;
/// From one trigger to the next.
pub(super) const TRIGGER_BANK: u32 = 16;
/// The first line's bank.
pub(super) const LINE: u32 = DEVICE + 0xa0;
/// From one line to the next.
pub(super) const LINE_BANK: u32 = 8;
/// The first chunk's switch.
pub(super) const CHUNK_ENABLE: u32 = DEVICE + 0xc0;
/// Where the XML begins.
pub(super) const XML: u32 = 0x2_0000;

/// Sizes of GVSP packets, as IP datagrams in bytes. The largest leaves a UDP datagram whole.
pub(super) const PACKET_BYTES: (u32, u32) = (220, 65_500);
/// Exposure times, in µs.
pub(super) const EXPOSURE_US: (f64, f64) = (1.0, 1e7);
/// Gains, in dB.
pub(super) const GAIN_DB: (f64, f64) = (0.0, 24.0);
/// Black levels, in digital numbers.
pub(super) const BLACK_LEVELS: (f64, f64) = (0.0, 255.0);
/// Frame rates, in Hz.
pub(super) const FRAME_RATES_HZ: (f64, f64) = (0.1, 1e5);
/// Heartbeat time-outs, in ms.
pub(super) const HEARTBEAT_MS: (u32, u32) = (500, 3_600_000);
