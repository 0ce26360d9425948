//! The logic of the RCG trigger box, without hardware.
//!
//! # Design
//! Messages and hardware events go in with the time they happened at; actions come out. No clock, no
//! register and no interrupt is touched here, so the firmware on the board, the simulated controller of
//! the host and the tests all run these very lines.
//!
//! - [`pulse`]: a step of the schedule → words for the PIO, and the words read back into edges
//! - [`starts`]: which SYNC edges began steps
//! - [`store`]: the words of the schedule, as a table or as a stream
//! - [`block`]: whole steps put together for the DMA
//! - [`burst`]: a table of very short steps, played by the DMA from where it lies
//! - [`progress`]: how far the DMA and the clock say that the pulse engine has got
//! - [`control`]: session and pulse engine together
//! - [`edges`]: what the PIO counted, as times of edges
//! - [`kept`]: the polarity that is kept over resets
//! - [`sequencer`]: idle → loaded → armed → running → done | stopped | aborted | fault
//! - [`stored`]: a schedule that is kept and run without a host
//! - [`usb_watch`]: whether USB still gets on
//! - [`vsync`]: whether SYNC comes as regularly as it should
//! - [`witness`]: what the camera's STROBE line says about each trigger
//! - [`outbox`]: messages that wait for the link, and the records of the next one
//! - [`packets`]: frames cut into packets, and what is lost when nobody takes them
//! - [`session`]: requests in, responses, events and engine commands out
//! - `uf2`: firmware as a file that the boot loader takes
//! - `virtual_flash`, `virtual_time`: the box without a board, for tests and what stands in for one

#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod block;
pub mod burst;
pub mod control;
pub mod edges;
pub mod kept;
pub mod outbox;
pub mod packets;
pub mod progress;
pub mod pulse;
pub mod sequencer;
pub mod session;
pub mod starts;
pub mod store;
pub mod stored;
#[cfg(not(target_os = "none"))]
pub mod uf2;
pub mod usb_watch;
#[cfg(not(target_os = "none"))]
pub mod virtual_flash;
#[cfg(not(target_os = "none"))]
pub mod virtual_time;
pub mod vsync;
pub mod witness;

/// Version of the firmware: major, minor, patch.
pub const VERSION: (u8, u8, u8) = (
    number(env!("CARGO_PKG_VERSION_MAJOR")),
    number(env!("CARGO_PKG_VERSION_MINOR")),
    number(env!("CARGO_PKG_VERSION_PATCH")),
);

/// The number that these digits are; one that is too large does not compile.
const fn number(digits: &str) -> u8 {
    let digits = digits.as_bytes();
    let (mut number, mut at) = (0, 0);
    while at < digits.len() {
        number = 10 * number + (digits[at] - b'0');
        at += 1;
    }
    number
}
