//! The logic of the RCG trigger box, without hardware.
//!
//! # Design
//! Messages and hardware events go in with the time they happened at; actions come out. No clock, no
//! register and no interrupt is touched here, so the firmware on the board, the simulated controller of
//! the host and the tests all run these very lines.
//!
//! - [`pulse`]: a step of the schedule → words for the PIO, and the words read back into edges
//! - [`store`]: the words of the schedule, as a table or as a stream
//! - [`block`]: whole steps put together for the DMA
//! - [`burst`]: a table of very short steps, played by the DMA from where it lies
//! - [`progress`]: how far the DMA and the clock say that the pulse engine has got
//! - [`edges`]: what the PIO counted, as times of edges
//! - [`sequencer`]: idle → loaded → armed → running → done | stopped | aborted | fault
//! - [`vsync`]: whether SYNC comes as regularly as it should
//! - [`witness`]: what the camera's STROBE line says about each trigger
//! - [`outbox`]: messages that wait for the link, and the records of the next one
//! - [`session`]: requests in, responses, events and engine commands out
//! - `virtual_time`: the box without a board, for tests and what stands in for one

#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod block;
pub mod burst;
pub mod edges;
pub mod outbox;
pub mod progress;
pub mod pulse;
pub mod sequencer;
pub mod session;
pub mod store;
#[cfg(not(target_os = "none"))]
pub mod virtual_time;
pub mod vsync;
pub mod witness;

/// Version of the firmware: major, minor, patch.
pub const VERSION: (u8, u8, u8) = (0, 1, 0);
