//! The schedule: what the output lines do, in ticks.

use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::units::{Micros, Ticks};

/// How many steps one [`crate::Request::Append`] carries at most.
pub const STEPS_PER_APPEND: usize = 8;
/// How many pulses of PHOTO one [`crate::Event::Photo`] carries at most.
pub const PULSES_PER_EVENT: usize = 8;
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
    /// Output: a light source, a shutter, a second camera. Since version 4.
    AuxA,
    /// Output: as [`Line::AuxA`]. Since version 4.
    AuxB,
    /// Input: a photodiode, whose pulses are stamped. Since version 4.
    Photo,
    /// Input: what begins a run from outside. Since version 4.
    Start,
}

impl core::fmt::Display for Line {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Proj => "PROJ",
            Self::Cam => "CAM",
            Self::Sync => "SYNC",
            Self::Strobe => "STROBE",
            Self::AuxA => "AUX-A",
            Self::AuxB => "AUX-B",
            Self::Photo => "PHOTO",
            Self::Start => "START",
        })
    }
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

/// Which of the further lines rest high and pulse low. Since version 4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
#[allow(clippy::struct_excessive_bools)] // as `Polarity`
pub struct AuxPolarity {
    /// AUX-A rests high and pulses low.
    pub a_active_low: bool,
    /// AUX-B rests high and pulses low.
    pub b_active_low: bool,
    /// PHOTO is low while there is light.
    pub photo_active_low: bool,
    /// The falling edge of START counts.
    pub start_active_low: bool,
}

/// What a further output does in every step. Since version 4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum AuxPulse {
    /// It stays at rest.
    #[default]
    Off,
    /// This pulse; none if its width is zero.
    InStep(Pulse),
    /// A pulse with that of CAM; none where CAM has none.
    WithCam {
        /// From the leading edge of CAM to its own.
        after: Ticks,
        /// Its length; zero for that of CAM.
        width: Ticks,
    },
}

/// What the further lines do, from the next [`crate::Request::Load`] on. Since version 4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Aux {
    /// Resting levels.
    pub polarity: AuxPolarity,
    /// AUX-A.
    pub a: AuxPulse,
    /// AUX-B.
    pub b: AuxPulse,
    /// Whether pulses of PHOTO are told of.
    pub photo: bool,
}

impl Aux {
    /// Lines at rest, on the sides that `polarity` says.
    #[must_use]
    pub const fn resting(polarity: AuxPolarity) -> Self {
        Self {
            polarity,
            a: AuxPulse::Off,
            b: AuxPulse::Off,
            photo: false,
        }
    }

    /// Whether an output pulses.
    #[must_use]
    pub const fn has_pulses(&self) -> bool {
        !matches!((self.a, self.b), (AuxPulse::Off, AuxPulse::Off))
    }
}

impl AuxPulse {
    /// The pulse in `step`; `None` if a time of it is beyond all bounds.
    #[must_use]
    pub fn of(self, step: &Step) -> Option<Pulse> {
        match self {
            Self::Off => Some(Pulse::NONE),
            Self::InStep(pulse) => Some(pulse),
            Self::WithCam { .. } if step.cam.is_none() => Some(Pulse::NONE),
            Self::WithCam { after, width } => Some(Pulse {
                at: step.cam.at.checked_add(after)?,
                width: if width == Ticks::ZERO {
                    step.cam.width
                } else {
                    width
                },
            }),
        }
    }
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
    /// At the first edge of [`Line::Start`] after it, which is awaited for as long as the host is heard. Steps are then free running.
    /// Since version 4.
    OnStartLine,
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
