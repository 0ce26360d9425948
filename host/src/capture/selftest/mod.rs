//! Whether the trigger box is wired as it should be: each output pulses alone, and both inputs are looked at.
//!
//! # Design
//! With jumpers from PROJ to SYNC and from CAM to STROBE the box is its own projector and camera; with the real ones their
//! answers are looked at in the same way. An input that nobody drives is where the box pulls it, so it is looked at under both pulls.
//! Every pulse is a run of its own, whose edges the box has counted and stamped.
//!
//! # Tradeoffs
//! Two crossed wires look alike at either end: swapping them at one end puts both right. Only a camera whose exposure is as long as its
//! trigger, beside a projector whose answer is not, shows at which end they are crossed; so pulses of two lengths take turns.

mod findings;
mod photo;
#[cfg(test)]
mod tests;

use std::time::Duration;

use rcg_protocol::{Event, Extent, Input, Inputs, Line, Micros, Pace, Polarity, Program, Step, Ticks};

use crate::base::blame::Blame;
use crate::capture::device::{Device, DeviceError};
use crate::capture::link::Link;
use crate::capture::steps::{Limits, Output, Span, StepsError};

pub use findings::Finding;
pub use photo::{PhotoTested, selftest_photo};

/// The outputs, each with the input that it should reach.
pub const PAIRS: [(Output, Line); 2] = [(Output::Proj, Line::Sync), (Output::Cam, Line::Strobe)];

/// What is to be tried.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Which lines should rest high and pulse low.
    pub polarity: Polarity,
    /// Length of every other pulse, the others are twice as long.
    pub width: Span,
    /// How long an answer may take to begin and to end, counted from the start of the pulse.
    pub period: Span,
    /// Pulses of each output.
    pub count: u32,
}

/// Why nothing was found out.
#[derive(Debug, thiserror::Error)]
pub enum SelftestError {
    /// The trigger box.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// Pulses that it cannot make.
    #[error(transparent)]
    Steps(#[from] StepsError),
    /// A pulse that did not come to its end.
    #[error("port {peer}: expected a pulse of {output}, found an end by {fault}")]
    Broken {
        /// The peer.
        peer: String,
        /// The output.
        output: Line,
        /// What the box says.
        fault: String,
    },
}

impl Blame for SelftestError {
    fn is_input(&self) -> bool {
        match self {
            Self::Device(error) => error.is_input(),
            Self::Steps(error) => error.is_input(),
            Self::Broken { .. } => false,
        }
    }
}

/// Where an input is while both outputs rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rest {
    /// Something holds it low.
    Low,
    /// Something holds it high.
    High,
    /// It is wherever the box pulls it.
    Open,
}

impl Rest {
    /// That of an input which is high or not while the box pulls it up, and down.
    const fn of(high: [bool; 2]) -> Self {
        match high {
            [true, false] => Self::Open,
            [_, true] => Self::High,
            [_, false] => Self::Low,
        }
    }
}

impl std::fmt::Display for Rest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Low => "low",
            Self::High => "high",
            Self::Open => "open",
        })
    }
}

/// What one input did at one pulse of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Length of the pulse.
    pub pulse: Ticks,
    /// Edges of the input, until the period was over.
    pub edges: u32,
    /// Of an answer with two edges: from the start of the pulse to that of the answer, and how long it lasted; up to a tick late, and in
    /// steps of two.
    pub delay_and_width: Option<(Ticks, Ticks)>,
}

/// What was seen of one input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seen {
    /// The input.
    pub line: Line,
    /// Where it is at rest.
    pub rest: Rest,
    /// Edges while both outputs rested.
    pub by_itself: u32,
    /// What it did at each pulse of PROJ, and of CAM; PHOTO at those of AUX-A, and of AUX-B.
    pub answers: [Vec<Answer>; 2],
}

impl Seen {
    /// At how many pulses of `output` it had an edge.
    #[must_use]
    pub fn answered(&self, output: Output) -> usize {
        self.of(output).iter().filter(|answer| answer.edges > 0).count()
    }

    /// What it did at each pulse of `output`.
    #[must_use]
    pub fn of(&self, output: Output) -> &[Answer] {
        match output {
            Output::Proj | Output::AuxA => &self.answers[0],
            Output::Cam | Output::AuxB => &self.answers[1],
        }
    }
}

/// What was seen, and what is to be said of it.
#[derive(Clone, Debug)]
pub struct Tested {
    /// SYNC and STROBE.
    pub inputs: [Seen; 2],
    /// What is not as it should be.
    pub findings: Vec<Finding>,
}

/// Tries the wires of `device`. The schedule that was loaded is forgotten.
///
/// # Errors
/// [`SelftestError`]; [`DeviceError::Older`] if the firmware does not tell what stands at its inputs.
pub fn selftest<L: Link>(device: &mut Device<L>, settings: &Settings) -> Result<Tested, SelftestError> {
    // One that is too old for it moves no output.
    device.watch()?;
    let info = device.info();
    let limits = Limits::new(&info, Pace::FreeRunning);
    let (width, period) = (settings.width, Some(settings.period));
    let twice = twice(width);
    // What cannot be made is refused before any output moves.
    let mut steps = Vec::new();
    for (output, _) in PAIRS {
        let pulses = [
            limits.pulse(output, width, period)?.0,
            limits.pulse(output, twice, period)?.0,
        ];
        steps.push((output, pulses));
    }

    let rest = &steps[0].1[0];
    let up = at_rest(device, rest, settings.polarity, true)?;
    let down = at_rest(device, rest, settings.polarity, false)?;
    let by_itself = activity(device, settings.period.seconds(info.clock_hz))?;

    let mut inputs = [Line::Sync, Line::Strobe].map(|line| Seen {
        line,
        rest: Rest::of([up, down].map(|inputs| of(&inputs, line).high)),
        by_itself: of(&by_itself, line).edges.unwrap_or(0),
        answers: [Vec::new(), Vec::new()],
    });
    for (place, (output, pulses)) in steps.iter().enumerate() {
        for number in 0..settings.count {
            let step = &pulses[number as usize % 2];
            let began = pulse(device, *output, step, settings.polarity)?;
            // Its period is over.
            let after = device.inputs()?;
            for seen in &mut inputs {
                let width = step.proj.width.max(step.cam.width);
                let answer = answer(of(&after, seen.line), began, width);
                seen.answers[place].push(answer);
            }
        }
    }
    let findings = findings::of(&inputs, settings.polarity);
    Ok(Tested { inputs, findings })
}

const fn of(inputs: &Inputs, line: Line) -> &Input {
    match line {
        Line::Strobe => &inputs.strobe,
        _ => &inputs.sync,
    }
}

fn program(polarity: Polarity) -> Program {
    Program {
        polarity,
        dead_man: Micros::DEFAULT_DEAD_MAN,
        ..Program::new(Extent::Table { steps: 1, cycles: 1 })
    }
}

/// What stands at the inputs while both outputs rest and the box pulls the inputs up, or down.
fn at_rest<L: Link>(
    device: &mut Device<L>,
    step: &Step,
    polarity: Polarity,
    up: bool,
) -> Result<Inputs, DeviceError> {
    let pulled = Polarity {
        sync_active_low: up,
        strobe_active_low: up,
        ..polarity
    };
    // Pulls are those of the schedule from the moment on in which it is armed.
    device.load(&program(pulled), &[*step])?;
    device.arm()?;
    let inputs = device.inputs();
    device.abort()?;
    inputs
}

/// What the inputs do in some `period_s` while both outputs rest.
fn activity<L: Link>(device: &mut Device<L>, period_s: f64) -> Result<Inputs, DeviceError> {
    device.watch()?;
    let_pass(device, period_s)?;
    device.inputs()
}

/// Lets about `period_s` pass.
fn let_pass<L: Link>(device: &mut Device<L>, period_s: f64) -> Result<(), DeviceError> {
    /// Time for a dozen frames of a projector.
    const LEAST_S: f64 = 0.2;
    let until = device.link().now() + Duration::from_secs_f64(period_s.clamp(LEAST_S, 1.0));
    while device.link().now() < until {
        let left = until.saturating_sub(device.link().now());
        device.next_event(left)?;
    }
    Ok(())
}

const fn twice(width: Span) -> Span {
    match width {
        Span::Seconds(seconds) => Span::Seconds(2.0 * seconds),
        Span::Ticks(ticks) => Span::Ticks(2 * ticks),
    }
}

/// Plays one `step`, in which `output` pulses. Returns when it began, if that was heard.
fn pulse<L: Link>(
    device: &mut Device<L>,
    output: Output,
    step: &Step,
    polarity: Polarity,
) -> Result<Option<Ticks>, SelftestError> {
    let mut began = None;
    let ending = device.play(&program(polarity), &[*step], |event| {
        if let Some(Event::Started { at, .. }) = event {
            began = Some(*at);
        }
        Ok::<(), DeviceError>(())
    })?;
    if ending.steps_done != 1 {
        return Err(SelftestError::Broken {
            peer: device.link().peer().to_owned(),
            output: output.line(),
            fault: ending
                .fault
                .map_or_else(|| ending.state.to_string(), |fault| fault.to_string()),
        });
    }
    Ok(began)
}

/// What `input` did at a pulse of length `pulse` that began at `began`.
fn answer(input: &Input, began: Option<Ticks>, pulse: Ticks) -> Answer {
    let edges = input.edges.unwrap_or(0);
    let timed = match (began, input.last) {
        (Some(began), [Some(from), Some(to)]) if edges == 2 => Some((from.saturating_sub(began), to - from)),
        _ => None,
    };
    Answer {
        pulse,
        edges,
        delay_and_width: timed,
    }
}
