//! The real firmware binary of the RCG under test: what is flashed is what is tested.
//!
//! # Design
//! A *device under test* ([`dut`]) is an emulated Pico or a board. A [`bench::Bench`] has one connected, with the
//! same client that the host's command uses; the trials (`tests/trials`) ask the bench for what they need and are
//! ignored, with the reason, where a device cannot give it. The emulated Pico runs in virtual time: requests, time-outs
//! and the dead-man switch are all counted in its cycles, so every trial gives the same trace each time.
//!
//! A [`bridge`] gives an emulated Pico a serial port and wires, for the host's command as it is.
//!
//! A camera for the host's driver is [`gige`]: GigE Vision, real up to the sensor; a projector is [`dlpc900`], real up to the mirrors. A
//! [`table`] has a camera and, with the virtual rig's light, such a projector, a folder for its patterns or a screen that a window fills.
//!
//! Every figure that a trial finds goes into [`figures`] together with its limit, is checked there, and is printed.

pub mod bench;
pub mod bridge;
pub mod dlpc900;
pub mod dut;
pub mod emulator;
pub mod figures;
pub mod gige;
pub mod image;
pub mod log;
pub mod pico;
pub mod places;
mod projection;
#[cfg(feature = "window")]
pub mod screen;
pub mod table;
pub mod trace;
