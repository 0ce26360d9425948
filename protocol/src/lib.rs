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
//! test that is never edited. A host speaks the versions before its own too ([`SPOKEN`]) and asks a controller of one of
//! these nothing that it does not know.
//!
//! Version 2 added [`Request::Identify`], [`Request::Filter`], [`Fault::SyncUnclear`] and [`Fault::InputTooFast`]; version 3
//! [`Request::Watch`], [`Request::Inputs`], [`Request::Boot`], [`Request::Keep`] and [`Request::Kept`]; version 4
//! the lines AUX-A, AUX-B, PHOTO and START: [`Request::Aux`], [`Request::KeepAux`], [`Request::KeptAux`], [`Request::Photo`],
//! [`Event::Photo`], [`Start::OnStartLine`] and [`Request::Repeat`]; version 5 schedules that run without a host: [`Request::Store`] and
//! [`Request::Stored`].

#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

mod fault;
mod framing;
mod message;
mod schedule;
mod stored;
mod units;
mod varint;

pub use fault::{Command, Fault, State};
pub use framing::{Decoder, FrameError, MAX_FRAME, checksum, decode, encode};
pub use message::{
    Chip, Counters, Event, Identity, Info, Input, Inputs, Photo, PhotoPulse, Reply, Request, Reset, Response,
    RunId, SCHEMA_HASH, Status, StepFlags, StepRecord, Strobe, ToDevice, ToHost, Unit,
};
pub use schedule::{
    Aux, AuxPolarity, AuxPulse, Extent, Level, Line, PULSES_PER_EVENT, Pace, Polarity, Program, Pulse,
    RECORDS_PER_EVENT, STEPS_PER_APPEND, Start, Step,
};
pub use stored::{FIRST_PAGE, PAGE_BYTES, PAGES, Stored};
pub use units::{Micros, Seq, SessionId, StepId, Ticks};

/// Version of the messages; raised with every change that a peer could notice.
pub const PROTOCOL_VERSION: u16 = 5;

/// Versions that a host of this one speaks, each with the [`SCHEMA_HASH`] that it had: this one and those before it, whose
/// messages are all among those of this one.
pub const SPOKEN: [(u16, u64); 5] = [
    (1, 0x82fe_7021_e662_6436),
    (2, 0xd033_3967_ff23_5268),
    (3, 0x35dc_ce3f_25d4_e40d),
    (4, 0x642b_c5ea_88d0_b9a3),
    (PROTOCOL_VERSION, SCHEMA_HASH),
];
