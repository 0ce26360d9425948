//! The schedule: what the two output lines do, in ticks.

use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::units::{Micros, Ticks};

/// How many steps one [`crate::Request::Append`] carries at most.
pub const STEPS_PER_APPEND: usize = 8;
/// How many step records one [`crate::Event::Records`] carries at most.
pub const RECORDS_PER_EVENT: usize = 8;

/// The lines between the controller and the instrument.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Line {
    /// Output: the projector shows its next pattern.
    Proj,
    /// Output: the camera exposes.
    Cam,
    /// Input: the projector's vsync, its trigger output, or a photodiode.
    Sync,
    /// Input: the camera's exposure-active output.
    Strobe,
}

/// Logical level of a line: `Active` is high unless [`Polarity`] says otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Level {
    /// The resting level.
    Inactive,
    /// The asserted level.
    Active,
}

/// One pulse of one line within a step. A width of zero means no pulse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Pulse {
    /// Ticks from the start of the step to the leading edge.
    pub at: Ticks,
    /// Ticks from the leading to the trailing edge.
    pub width: Ticks,
}

impl Pulse {
    /// No pulse.
    pub const NONE: Self = Self {
        at: Ticks::ZERO,
        width: Ticks::ZERO,
    };

    /// A pulse of `width` ticks, `at` ticks into the step.
    #[must_use]
    pub const fn new(at: u64, width: u64) -> Self {
        Self {
            at: Ticks(at),
            width: Ticks(width),
        }
    }

    /// Whether the line stays at rest.
    #[must_use]
    pub const fn is_none(self) -> bool {
        self.width.0 == 0
    }
}

/// One step: usually one pattern shown and one exposure taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Step {
    /// Pulse on [`Line::Proj`].
    pub proj: Pulse,
    /// Pulse on [`Line::Cam`].
    pub cam: Pulse,
    /// Length of the step; both pulses end within it.
    pub period: Ticks,
}

/// Which lines rest high and pulse low, and which input edge counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
#[allow(clippy::struct_excessive_bools)] // four independent lines, one bit each
pub struct Polarity {
    /// PROJ rests high and pulses low.
    pub proj_active_low: bool,
    /// CAM rests high and pulses low.
    pub cam_active_low: bool,
    /// The falling edge of SYNC counts.
    pub sync_active_low: bool,
    /// STROBE is low while the camera exposes.
    pub strobe_active_low: bool,
}

/// How long the schedule is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Extent {
    /// `steps` steps are loaded once and played `cycles` times.
    Table {
        /// Steps in the table, at least 1.
        steps: u32,
        /// How often the table is played, at least 1.
        cycles: u32,
    },
    /// Steps are appended while others play, until one [`crate::Request::Append`] is marked the last.
    Stream,
}

/// When the first step begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Start {
    /// As soon as [`crate::Request::Start`] is handled.
    AtOnce,
    /// At the first SYNC edge after it.
    OnSync,
}

/// What begins each further step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Pace {
    /// The end of the step before it.
    FreeRunning,
    /// A SYNC edge of its own, the first one after the end of the step before it. The first step waits too.
    EachOnSync,
}

/// Everything about a schedule but its steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
#[repr(C)] // ends with a whole word: what follows it in a `Request` is moved word by word then, and not shifted
pub struct Program {
    /// Table or stream.
    pub extent: Extent,
    /// What begins the first step.
    pub start: Start,
    /// What begins each step.
    pub pace: Pace,
    /// Resting levels.
    pub polarity: Polarity,
    /// How long a SYNC edge may be awaited before the run ends with a fault; 0 waits for ever.
    pub sync_timeout: Micros,
    /// If no frame arrives from the host for this long during a run, the run is aborted; 0 never.
    pub dead_man: Micros,
}

impl Program {
    /// A program that starts at once and runs free, with all lines active high and no time-outs.
    #[must_use]
    pub const fn new(extent: Extent) -> Self {
        Self {
            extent,
            start: Start::AtOnce,
            pace: Pace::FreeRunning,
            polarity: Polarity {
                proj_active_low: false,
                cam_active_low: false,
                sync_active_low: false,
                strobe_active_low: false,
            },
            sync_timeout: Micros(0),
            dead_man: Micros(0),
        }
    }
}

/// Steps of one [`crate::Request::Append`].
pub(crate) type StepBatch = Vec<Step, STEPS_PER_APPEND>;
