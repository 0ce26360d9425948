//! The messages. See the crate's page for the rule of their evolution.

use heapless::Vec;
use postcard_schema::{Schema, key::hash::fnv1a64};
use serde::{Deserialize, Serialize};

use crate::fault::{Fault, State};
use crate::schedule::{Aux, AuxPolarity, PULSES_PER_EVENT, Polarity, Program, RECORDS_PER_EVENT, StepBatch};
use crate::stored::{PAGE_BYTES, Stored};
use crate::units::{Seq, SessionId, StepId, Ticks};

/// Hash of the shape of all messages, in both directions; equal only if both ends agree on every field.
pub const SCHEMA_HASH: u64 = {
    let down = u64::from_le_bytes(fnv1a64::hash_ty_path::<ToDevice>("rcg/to-device"));
    let up = u64::from_le_bytes(fnv1a64::hash_ty_path::<ToHost>("rcg/to-host"));
    down ^ up.rotate_left(1)
};

/// One run of the sequencer; counted up by every [`Request::Arm`], so that late events cannot be mistaken.
pub type RunId = u32;

/// A frame from the host.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct ToDevice {
    /// Session that [`Request::Hello`] opened; ignored for `Hello` itself.
    pub session: SessionId,
    /// Number of the request.
    pub seq: Seq,
    /// What is asked.
    pub request: Request,
}

/// What the host asks. Variants are appended, never reordered.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
#[allow(clippy::large_enum_variant)] // lives on the stack for the length of one frame; there is no heap to box into
pub enum Request {
    /// Opens a session and closes the one before it. Frozen for all versions. Answered by [`Reply::Identity`].
    Hello {
        /// Drawn by the host; the same nonce again is a retry and opens nothing new.
        nonce: u32,
    },
    /// Answered by [`Reply::Info`].
    Describe,
    /// Answered by [`Reply::Pong`].
    Ping(u32),
    /// Answered by [`Reply::Status`].
    Status,
    /// Forgets the schedule and begins a new one. Answered by [`Reply::Room`].
    Load(Program),
    /// Adds steps to the schedule. Answered by [`Reply::Room`].
    Append {
        /// Index of the first of these steps in the table or stream.
        first: u64,
        /// The steps.
        steps: StepBatch,
        /// A stream ends with these; a table says so by its length.
        last: bool,
    },
    /// Primes the pulse engine. Answered by [`Reply::Armed`].
    Arm,
    /// Fires. Answered by [`Reply::Status`].
    Start,
    /// Ends the run after the current step. Answered by [`Reply::Status`]; [`Event::Ended`] follows.
    Stop,
    /// Ends the run at once with both outputs at rest; allowed in every state. Answered by [`Reply::Status`].
    Abort,
    /// Forgets the schedule. Answered by [`Reply::Status`].
    Clear,
    /// Answered by [`Reply::Unit`]. Since version 2.
    Identify,
    /// What is to be taken for a glitch of an input, from the next [`Request::Arm`] on until the end of the session; nothing is
    /// at first. Answered by [`Reply::Status`]. Since version 2.
    Filter {
        /// STROBE is active, or at rest, for less than this: it stays as it was.
        strobe: Ticks,
    },
    /// Counts the edges of both inputs from now on, until the next [`Request::Arm`]; refused while a run goes on. Answered by
    /// [`Reply::Status`]. Since version 3.
    Watch,
    /// Answered by [`Reply::Inputs`]. Since version 3.
    Inputs,
    /// Leaves the firmware for the chip's boot loader, which takes another one; refused while a run goes on. Answered by
    /// [`Reply::Status`], and then by nothing any more. Since version 3.
    Boot,
    /// Keeps this polarity over resets: outputs and pulls rest like that from the boot on, until a schedule says otherwise.
    /// Refused while a run goes on. Answered by [`Reply::Status`]. Since version 3.
    Keep(Polarity),
    /// Answered by [`Reply::Kept`]. Since version 3.
    Kept,
    /// What the further lines do, from the next [`Request::Load`] on until the end of the session; they rest at first. Answered by
    /// [`Reply::Status`]. Since version 4.
    Aux(Aux),
    /// Keeps this polarity of the further lines over resets, as [`Request::Keep`] does of the others. Answered by [`Reply::Status`].
    /// Since version 4.
    KeepAux(AuxPolarity),
    /// Answered by [`Reply::KeptAux`]. Since version 4.
    KeptAux,
    /// Answered by [`Reply::Photo`]. Since version 4.
    Photo,
    /// From the next [`Request::Arm`] on until the end of the session a run of a table that is done is armed and started again by the
    /// controller, as a run of its own, until there were so many; 0 for ever, and one at first. Answered by [`Reply::Status`]. Since
    /// version 4.
    Repeat {
        /// Runs.
        runs: u32,
    },
    /// Keeps bytes of a schedule over resets, to be run without a host: see [`Stored`]. Refused while a run goes on. Answered by
    /// [`Reply::Status`]; what came of it says [`Request::Stored`]. Since version 5.
    Store {
        /// Page of the memory: 0 for [`Stored`], as a frame, or empty to forget what is there; from [`FIRST_PAGE`](crate::FIRST_PAGE) on, in their
        /// order, for the requests.
        page: u16,
        /// All bytes of the page but for zeros at its end.
        bytes: Vec<u8, PAGE_BYTES>,
    },
    /// Answered by [`Reply::Stored`]. Since version 5.
    Stored,
}

/// A frame from the controller.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
#[allow(clippy::large_enum_variant)] // as `Request`
pub enum ToHost {
    /// The answer to a request.
    Response(Response),
    /// Something happened.
    Event(Event),
}

/// The answer to a request.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Response {
    /// Session of the request (for `Hello`: 0).
    pub session: SessionId,
    /// Number of the request.
    pub seq: Seq,
    /// What came of it.
    pub result: Result<Reply, Fault>,
}

/// What a request was answered with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Reply {
    /// Who answers. Frozen for all versions.
    Identity(Identity),
    /// What the controller can do.
    Info(Info),
    /// The number that was sent.
    Pong(u32),
    /// How things stand.
    Status(Status),
    /// How many more steps fit.
    Room {
        /// Free places for steps.
        steps: u32,
    },
    /// The engine is primed for this run.
    Armed {
        /// Number of the run.
        run: RunId,
    },
    /// Which box it is, of all of its kind. Since version 2.
    Unit(Unit),
    /// What stands at the inputs. Since version 3.
    Inputs(Inputs),
    /// The polarity that is kept over resets. Since version 3.
    Kept(Polarity),
    /// The polarity of the further lines that is kept over resets. Since version 4.
    KeptAux(AuxPolarity),
    /// What stands at PHOTO. Since version 4.
    Photo(Photo),
    /// What is kept to be run without a host, if it is whole. Since version 5.
    Stored(Option<Stored>),
}

/// Who answers. Frozen for all versions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Identity {
    /// [`crate::PROTOCOL_VERSION`] of the controller.
    pub protocol: u16,
    /// [`SCHEMA_HASH`] of the controller.
    pub schema: u64,
    /// The nonce of the `Hello` that is answered.
    pub nonce: u32,
    /// The session that is now open.
    pub session: SessionId,
}

/// What the controller is and can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Info {
    /// Firmware version: major, minor, patch.
    pub firmware: (u8, u8, u8),
    /// Ticks per second.
    pub clock_hz: u32,
    /// Steps that a table holds.
    pub max_steps: u32,
    /// Output words that a table holds.
    pub max_words: u32,
    /// Shortest distance of two edges in ticks, free running.
    pub shortest_free: u32,
    /// Shortest distance of two edges in ticks, when each step waits for SYNC.
    pub shortest_sync: u32,
    /// Longest step.
    pub longest_period: Ticks,
}

/// What stands at the inputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Inputs {
    /// When it was looked at, on the controller's clock.
    pub at: Ticks,
    /// Since when edges are counted: the last [`Request::Watch`], or the start of the last run.
    pub since: Ticks,
    /// SYNC.
    pub sync: Input,
    /// STROBE.
    pub strobe: Input,
}

/// What stands at one input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Input {
    /// Whether the pin is high, whatever the polarity.
    pub high: bool,
    /// Whether the controller pulls the line up, else down: a line that nobody drives is there.
    pub pulled_up: bool,
    /// Changes of level; `None` where they were not looked for, as in a table of very short steps.
    pub edges: Option<u32>,
    /// The last two of these, the later one behind, on the controller's clock and up to a tick late.
    pub last: [Option<Ticks>; 2],
}

/// What stands at PHOTO.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Photo {
    /// The input, whose edges are counted as [`Inputs::since`] says; `None` for their number in a run that does not stamp it.
    pub input: Input,
    /// Pulses of the present or last run that [`Event::Photo`] told of, or was to: what has not come by the end of the run was lost
    /// on the way.
    pub pulses: u32,
}

/// Which box it is, of all of its kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Unit {
    /// The number that its flash memory or its chip was made with; 0 if it cannot be read.
    pub serial: u64,
    /// The first 32 bits of the commit that its firmware was built from; 0 if that is not known.
    pub commit: u32,
    /// Whether what it was built from was another than that commit.
    pub modified: bool,
    /// What it runs on.
    pub chip: Chip,
    /// Why it was reset last.
    pub reset: Reset,
}

/// What the firmware runs on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Chip {
    /// No chip: the host simulates it.
    Simulated,
    /// RP2040.
    Rp2040,
    /// RP2350.
    Rp2350,
}

/// Why the box was reset last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Reset {
    /// Power, the reset pin, or a debugger.
    PowerOn,
    /// The main loop hung and the watchdog bit.
    Hang,
    /// The firmware panicked.
    Panic,
    /// The CPU met what it cannot execute or reach.
    HardFault,
    /// USB did not get on any more.
    UsbStuck,
}

impl core::fmt::Display for Chip {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Simulated => "simulated",
            Self::Rp2040 => "RP2040",
            Self::Rp2350 => "RP2350",
        })
    }
}

impl core::fmt::Display for Reset {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::PowerOn => "power-up or reset pin",
            Self::Hang => "the watchdog, as the firmware hung",
            Self::Panic => "a panic of the firmware",
            Self::HardFault => "a hard fault",
            Self::UsbStuck => "USB that did not get on",
        })
    }
}

/// How things stand on the controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Status {
    /// State of the sequencer.
    pub state: State,
    /// Number of the present or last run; 0 before the first.
    pub run: RunId,
    /// Steps whose period has begun and was not cut short, in that run.
    pub steps_done: u64,
    /// Why the last run ended by itself.
    pub fault: Option<Fault>,
    /// Time on the controller's clock.
    pub now: Ticks,
    /// What was counted since boot.
    pub counters: Counters,
}

/// What the controller counted since boot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Counters {
    /// Frames that were accepted.
    pub frames: u32,
    /// Frames that were dropped: COBS, CRC or content wrong, or too long.
    pub corrupt: u32,
    /// Requests that were answered again without being executed again.
    pub repeated: u32,
    /// Requests that came too late, from a former session or out of order, and were not executed.
    pub stale: u32,
    /// Requests that were executed.
    pub executed: u32,
    /// Step records that could not be sent because the link was too slow.
    pub records_lost: u32,
    /// STROBE pulses that no trigger explains.
    pub spurious_strobes: u32,
}

/// What happens unasked.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
#[allow(clippy::large_enum_variant)] // as `Request`
pub enum Event {
    /// The first step begins.
    Started {
        /// The run.
        run: RunId,
        /// When, on the controller's clock; step records count from here.
        at: Ticks,
    },
    /// What the camera did at each step. Records are in the order of their steps, without gaps but for those
    /// that [`Counters::records_lost`] counts.
    Records {
        /// The run.
        run: RunId,
        /// The records.
        records: Vec<StepRecord, RECORDS_PER_EVENT>,
    },
    /// The camera exposed although nothing had triggered it.
    SpuriousStrobe {
        /// The run.
        run: RunId,
        /// When, from the start of the run.
        on: Ticks,
    },
    /// The stream has room again.
    Room {
        /// The run.
        run: RunId,
        /// Steps that fit now.
        steps: u32,
    },
    /// The run is over.
    Ended {
        /// The run.
        run: RunId,
        /// `Done`, `Stopped`, `Aborted` or `Fault`.
        state: State,
        /// Why, if `Fault`.
        fault: Option<Fault>,
        /// Steps that were fired whole.
        steps_done: u64,
        /// When, from the start of the run.
        at: Ticks,
    },
    /// Pulses of PHOTO, in their order; none at the end of the run, to tell how many there were. Since version 4.
    Photo {
        /// The run.
        run: RunId,
        /// Number of the first of them in the run, from 0: where it is more than one after the last that came, those between were lost.
        first: u32,
        /// The pulses.
        pulses: Vec<PhotoPulse, PULSES_PER_EVENT>,
    },
}

/// One pulse of PHOTO.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct PhotoPulse {
    /// Leading edge, from the start of the run.
    pub on: Ticks,
    /// Its length; `None` if it had not ended when the run did.
    pub width: Option<Ticks>,
}

/// What happened at one step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct StepRecord {
    /// The step.
    pub step: StepId,
    /// Leading edge of CAM, or the start of the step if it has none; from the start of the run.
    pub trigger: Ticks,
    /// What STROBE did; `None` if it stayed at rest.
    pub strobe: Option<Strobe>,
    /// What is to be said of this step.
    pub flags: StepFlags,
}

/// One pulse of the STROBE line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Strobe {
    /// Leading edge after the trigger.
    pub delay: Ticks,
    /// Length of the pulse.
    pub width: Ticks,
}

/// Flags of a [`StepRecord`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct StepFlags(pub u8);

impl StepFlags {
    /// The step fired CAM but the camera did not expose.
    pub const MISSED: Self = Self(1);
    /// The camera exposed more than once.
    pub const DOUBLE: Self = Self(2);
    /// The step had no CAM pulse.
    pub const NO_TRIGGER: Self = Self(4);
    /// The exposure was still going on when the next trigger came or the run ended; its end is not known.
    pub const OVERRUN: Self = Self(8);
    /// At least one SYNC edge did not come before the one that began this step, or during the step.
    pub const SYNC_MISSED: Self = Self(16);
    /// SYNC had an edge more than its period allows, at the start of this step or before the next one.
    pub const SYNC_EXTRA: Self = Self(32);

    /// Whether all flags of `other` are set.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Both sets of flags.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}
