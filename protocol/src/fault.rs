//! What can go wrong on the controller, as plain values that travel the wire.

use core::fmt;

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::schedule::Line;
use crate::units::StepId;

/// State of the controller's sequencer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum State {
    /// No complete schedule is loaded.
    #[default]
    Idle,
    /// A schedule is loaded.
    Loaded,
    /// The pulse engine is primed; outputs rest.
    Armed,
    /// Steps are being fired, or the first SYNC edge is awaited.
    Running,
    /// Every step was fired.
    Done,
    /// Ended between two steps because the host asked for it.
    Stopped,
    /// Ended at once because the host asked for it.
    Aborted,
    /// Ended by itself; [`crate::Status::fault`] says why.
    Fault,
}

/// The requests that change the state, as named in [`Fault::Refused`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Command {
    /// [`crate::Request::Load`].
    Load,
    /// [`crate::Request::Append`].
    Append,
    /// [`crate::Request::Arm`].
    Arm,
    /// [`crate::Request::Start`].
    Start,
    /// [`crate::Request::Stop`].
    Stop,
    /// [`crate::Request::Clear`].
    Clear,
    /// [`crate::Request::Watch`]. Since version 3.
    Watch,
    /// [`crate::Request::Boot`]. Since version 3.
    Boot,
    /// [`crate::Request::Keep`]. Since version 3.
    Keep,
    /// [`crate::Request::Store`]. Since version 5.
    Store,
}

/// Why a request was not carried out, or why a run ended by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Fault {
    /// The request belongs to a session that another [`crate::Request::Hello`] has replaced.
    StaleSession,
    /// The command is not possible in this state.
    Refused {
        /// What was asked.
        command: Command,
        /// The state it was asked in.
        state: State,
    },
    /// The schedule has no steps or no cycles.
    EmptySchedule,
    /// More steps than the table holds.
    TooManySteps {
        /// How many it holds.
        limit: u32,
    },
    /// More output words than the table holds (long periods take several words).
    TooManyWords {
        /// How many it holds.
        limit: u32,
    },
    /// A batch of steps did not begin where the batch before it ended.
    StepsOutOfOrder {
        /// Index of the next step that is wanted.
        expected: u64,
        /// Index that was sent.
        found: u64,
    },
    /// The stream has no room for this batch now; nothing of it was taken.
    StreamFull {
        /// Steps that fit now.
        free: u32,
    },
    /// Two edges, or an edge and a border of the step, are closer than the pulse engine can make.
    EdgesTooClose {
        /// Index of the step in the table or stream.
        step: u64,
        /// The shortest distance in ticks.
        shortest: u32,
    },
    /// A pulse does not end within its step.
    PulseOutsidePeriod {
        /// Index of the step in the table or stream.
        step: u64,
    },
    /// A step is longer than the engine can make.
    PeriodTooLong {
        /// Index of the step in the table or stream.
        step: u64,
    },
    /// The stream ran dry; the run ended before this step.
    Underrun {
        /// The first step that was not fired.
        step: StepId,
    },
    /// No SYNC edge came in time; the run ended before this step.
    SyncTimeout {
        /// The step that waited.
        step: StepId,
    },
    /// Nothing was heard from the host for the dead-man time.
    HostLost,
    /// The pulse engine lost its timing; the run was ended at once.
    Engine,
    /// A SYNC edge came where a step ends or a glitch where one was awaited, and it is not certain which edge began the
    /// step. Since version 2.
    SyncUnclear {
        /// The step.
        step: StepId,
    },
    /// An input has more edges than can be told apart: noise, or an open line. Since version 2.
    InputTooFast {
        /// [`Line::Sync`], [`Line::Strobe`] or, since version 4, [`Line::Photo`] or [`Line::Start`].
        line: Line,
    },
    /// A run that begins on START has no steps that wait for SYNC. Since version 4.
    StartPaced,
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Idle => "idle",
            Self::Loaded => "loaded",
            Self::Armed => "armed",
            Self::Running => "running",
            Self::Done => "done",
            Self::Stopped => "stopped",
            Self::Aborted => "aborted",
            Self::Fault => "fault",
        })
    }
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Load => "load",
            Self::Append => "append",
            Self::Arm => "arm",
            Self::Start => "start",
            Self::Stop => "stop",
            Self::Clear => "clear",
            Self::Watch => "watch the inputs",
            Self::Boot => "go to the boot loader",
            Self::Keep => "keep a polarity",
            Self::Store => "store a schedule",
        })
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::StaleSession => f.write_str("another host has taken over the controller"),
            Self::Refused { command, state } => write!(f, "cannot {command} while {state}"),
            Self::EmptySchedule => f.write_str("the schedule has no steps or no cycles"),
            Self::TooManySteps { limit } => write!(f, "the schedule has more than {limit} steps"),
            Self::TooManyWords { limit } => write!(f, "the schedule needs more than {limit} output words"),
            Self::StepsOutOfOrder { expected, found } => {
                write!(f, "expected steps from index {expected}, found index {found}")
            }
            Self::StreamFull { free } => write!(f, "the stream has room for {free} steps only"),
            Self::EdgesTooClose { step, shortest } => {
                write!(f, "step {step} has edges closer than {shortest} ticks")
            }
            Self::PulseOutsidePeriod { step } => {
                write!(f, "step {step} has a pulse that ends after its period")
            }
            Self::PeriodTooLong { step } => write!(f, "step {step} is longer than the controller can make"),
            Self::Underrun { step } => write!(f, "the stream ran dry before {step}"),
            Self::SyncTimeout { step } => write!(f, "no SYNC edge came for {step}"),
            Self::HostLost => f.write_str("the host was silent for longer than the dead-man time"),
            Self::Engine => f.write_str("the pulse engine lost its timing"),
            Self::SyncUnclear { step } => {
                write!(
                    f,
                    "it is not certain which SYNC edge began {step}: its edges come when a step ends, or the line rings"
                )
            }
            Self::InputTooFast { line } => {
                write!(
                    f,
                    "{line} has more edges than can be told apart: expected pulses, found noise or an open line"
                )
            }
            Self::StartPaced => {
                f.write_str("a run that begins on START cannot have steps that wait for SYNC")
            }
        }
    }
}

impl core::error::Error for Fault {}
