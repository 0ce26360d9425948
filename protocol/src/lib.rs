//! What both ends of the RCG trigger box speak: messages, units, faults, schedule, framing.
//!
//! # Design
//! No behaviour lives here; the firmware acts and the host asks. The crate is `no_std` and never
//! allocates, so the very same code runs on the microcontroller and on the host.
//!
//! A conversation is request and response, both carrying a session and a sequence number, so that a
//! request that is sent again after a lost response is answered again and *not* executed again.
//! [`Event`]s come unasked. [`Request::Hello`] and [`Identity`] are frozen for all versions: they are
//! how two ends of different versions find that out.
//!
//! # Evolution
//! postcard encodes enum variants by position: append variants, never reorder or remove them, and raise
//! [`PROTOCOL_VERSION`] with every change of a message. The literal bytes of each version stand in a
//! test that is never edited.

#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

mod fault;
mod framing;
mod message;
mod schedule;
mod units;
mod varint;

pub use fault::{Command, Fault, State};
pub use framing::{Decoder, FrameError, MAX_FRAME, decode, encode};
pub use message::{
    Counters, Event, Identity, Info, Reply, Request, Response, RunId, SCHEMA_HASH, Status, StepFlags,
    StepRecord, Strobe, ToDevice, ToHost,
};
pub use schedule::{
    Extent, Level, Line, Pace, Polarity, Program, Pulse, RECORDS_PER_EVENT, STEPS_PER_APPEND, Start, Step,
};
pub use units::{Micros, Seq, SessionId, StepId, Ticks};

/// Version of the messages; raised with every change that a peer could notice.
pub const PROTOCOL_VERSION: u16 = 1;
