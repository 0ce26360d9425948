//! What the tests across the crates need: serial links that fail, and controllers at their other end.
//!
//! # Design
//! Everything lives in virtual time, which passes only while a client waits, and every fault is drawn from
//! a seed: a test of ten seconds' patience takes a millisecond, and what failed once fails again.
//!
//! - [`mod@line`]: one direction of a link, with what can go wrong on it
//! - [`world`]: the clock, the lines, the peer; and [`MockLink`], a client's end of it
//! - [`books`]: the laws that hold after whatever has happened
//! - [`bridge`]: the firmware's own logic behind a real port and real wires; the one thing in real time
//! - [`controller`]: the firmware's own logic as a peer, with a journal of what it really did
//! - [`measurements`]: what the whole chain measured, held against what is there
//! - [`mixed`]: a whole instrument on which everything goes wrong at once
//! - [`older`]: a controller of the version before
//! - [`strangers`]: peers that are no controller of this version

#![forbid(unsafe_code)]

pub mod books;
pub mod bridge;
pub mod controller;
pub mod line;
pub mod measurements;
pub mod mixed;
pub mod older;
pub mod strangers;
pub mod world;

pub use bridge::Bridge;
pub use controller::{Controller, TICK_NS};
pub use line::Faults;
pub use world::{MockLink, Peer};

/// Whether the long tests are wanted: `./test.sh full`.
#[must_use]
pub fn is_full() -> bool {
    std::env::var_os("RCG_FULL").is_some()
}
