//! What the trigger box shall fire, as people say it: times with their units, and brackets of exposures.
//!
//! # Design
//! The trigger box refuses what it cannot make, but knows neither names nor units; so it is checked here before, against
//! the limits that the box tells of itself. A time that is not 0 never becomes 0 by rounding: 0 has a meaning of its own.

mod further;
#[cfg(test)]
mod tests;

use std::fmt;
use std::str::FromStr;

use rcg_protocol::{Aux, AuxPulse, Extent, Info, Line, Micros, Pace, Program, Pulse, Step, Ticks};

use crate::base::blame::Blame;
use crate::instrument::rig::Rig;
use crate::plan::schedule::{ScheduleError, Timing};

pub use further::{AuxSpan, further};

/// A length of time with its unit: `5us`, `33.3 ms`, `3ticks`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Span {
    /// In seconds, not negative.
    Seconds(f64),
    /// In ticks of the controller's clock.
    Ticks(u64),
}

impl FromStr for Span {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        const EXPECTED: &str = "expected a time with its unit (s, ms, us, ns or ticks), such as 5us";
        let unit_at = text
            .find(|c: char| c.is_alphabetic() && !matches!(c, 'e' | 'E'))
            .ok_or(EXPECTED)?;
        let (number, unit) = (text[..unit_at].trim(), &text[unit_at..]);
        let scale = match unit {
            "s" => 1.0,
            "ms" => 1e-3,
            "us" | "\u{b5}s" | "\u{3bc}s" => 1e-6,
            "ns" => 1e-9,
            "tick" | "ticks" => return number.parse().map(Self::Ticks).map_err(|_| EXPECTED),
            _ => return Err(EXPECTED),
        };
        let number: f64 = number.parse().map_err(|_| EXPECTED)?;
        let fits = number.is_finite() && number >= 0.0;
        fits.then_some(Self::Seconds(number * scale)).ok_or(EXPECTED)
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Ticks(ticks) => write!(f, "{ticks} ticks"),
            Self::Seconds(s) if s > 0.0 && s < 1e-3 => write!(f, "{} ns", (s * 1e15).round() / 1e6),
            Self::Seconds(s) => write!(f, "{s} s"),
        }
    }
}

impl Span {
    /// In ticks of a clock of `clock_hz`, the nearest.
    #[must_use]
    pub fn ticks(self, clock_hz: u32) -> Ticks {
        match self {
            Self::Seconds(s) => Ticks((s * f64::from(clock_hz)).round() as u64),
            Self::Ticks(ticks) => Ticks(ticks),
        }
    }

    /// In seconds.
    #[must_use]
    pub fn seconds(self, clock_hz: u32) -> f64 {
        match self {
            Self::Seconds(s) => s,
            Self::Ticks(ticks) => ticks as f64 / f64::from(clock_hz),
        }
    }

    /// In microseconds, the nearest, for time-outs; `None` above 71 minutes.
    #[must_use]
    pub fn micros(self, clock_hz: u32) -> Option<Micros> {
        let micros = (self.seconds(clock_hz) * 1e6).round();
        (micros <= f64::from(u32::MAX)).then_some(Micros(micros as u32))
    }
}

/// An output of the trigger box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// The projector's trigger.
    Proj,
    /// The camera's trigger.
    Cam,
    /// The first further output.
    AuxA,
    /// The second one.
    AuxB,
}

impl Output {
    /// The line.
    #[must_use]
    pub const fn line(self) -> Line {
        match self {
            Self::Proj => Line::Proj,
            Self::Cam => Line::Cam,
            Self::AuxA => Line::AuxA,
            Self::AuxB => Line::AuxB,
        }
    }
}

/// What the trigger box can make, for one pace.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Ticks per second.
    pub clock_hz: u32,
    /// Shortest distance of two edges, or of an edge and a border of the step, in ticks.
    pub shortest: Ticks,
    /// Longest step.
    pub longest_period: Ticks,
}

impl Limits {
    /// Those of the trigger box that says `info` of itself.
    #[must_use]
    pub fn new(info: &Info, pace: Pace) -> Self {
        let shortest = match pace {
            Pace::FreeRunning => info.shortest_free,
            Pace::EachOnSync => info.shortest_sync,
        };
        Self {
            clock_hz: info.clock_hz,
            shortest: Ticks(u64::from(shortest)),
            longest_period: info.longest_period,
        }
    }

    /// A step that pulses one `output` from its start on, or none if `width` is 0, and lasts for `period`, else twice as long as the
    /// pulse; and what the further outputs do in it.
    ///
    /// # Errors
    /// [`StepsError`] if the trigger box cannot make it.
    pub fn pulse(self, output: Output, width: Span, period: Option<Span>) -> Result<(Step, Aux), StepsError> {
        let width = self.ticks("--width", width)?;
        let period = match period {
            Some(period) => self.ticks("--period", period)?,
            None => Ticks(width.0.saturating_mul(2)).max(self.shortest),
        };
        let pulse = Pulse {
            at: Ticks::ZERO,
            width,
        };
        let of = |line| if line == output { pulse } else { Pulse::NONE };
        let aux = |line| match of(line) {
            Pulse::NONE => AuxPulse::Off,
            pulse => AuxPulse::InStep(pulse),
        };
        let step = Step {
            proj: of(Output::Proj),
            cam: of(Output::Cam),
            period,
        };
        let aux = Aux {
            a: aux(Output::AuxA),
            b: aux(Output::AuxB),
            ..Aux::default()
        };
        let program = Program::new(Extent::Table { steps: 1, cycles: 1 });
        check(0, &step, self)?;
        further(&aux, &[step], &program, self)?;
        Ok((step, aux))
    }

    /// `ticks` as people read it, such as `2 ms` or `24 ns (3 ticks)`.
    fn words(self, ticks: Ticks) -> String {
        let s = ticks.0 as f64 / f64::from(self.clock_hz);
        let (scale, unit) = match s {
            s if s >= 1.0 => (1.0, "s"),
            s if s >= 1e-3 => (1e3, "ms"),
            s if s >= 1e-6 => (1e6, "us"),
            _ => (1e9, "ns"),
        };
        let number = (s * scale * 1e6).round() / 1e6;
        if ticks.0 < 1000 {
            format!("{number} {unit} ({} ticks)", ticks.0)
        } else {
            format!("{number} {unit}")
        }
    }

    /// `span` in ticks; what is not 0 must not become 0.
    fn ticks(self, option: &'static str, span: Span) -> Result<Ticks, StepsError> {
        let ticks = span.ticks(self.clock_hz);
        if ticks == Ticks::ZERO && span.seconds(self.clock_hz) > 0.0 {
            return Err(StepsError::BelowTick {
                option,
                found: span,
                tick_ns: 1e9 / f64::from(self.clock_hz),
                shortest: self.words(self.shortest),
            });
        }
        Ok(ticks)
    }
}

/// Why the trigger box cannot fire that.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StepsError {
    /// An exposure time out of range.
    #[error(transparent)]
    Schedule(#[from] ScheduleError),
    /// A time rounds to nothing.
    #[error(
        "{option}: expected 0 or at least {shortest}, found {found}, which rounds to 0 ticks of {tick_ns} ns"
    )]
    BelowTick {
        /// The option.
        option: &'static str,
        /// What was asked for.
        found: Span,
        /// Length of a tick in ns.
        tick_ns: f64,
        /// The shortest time that the trigger box makes.
        shortest: String,
    },
    /// A pulse does not end within its step.
    #[error(
        "step {step}: expected the {pulse} pulse to end within the period of {period}, found that it begins at {begins} \
         and lasts {width}, {by} too long"
    )]
    Outside {
        /// Number of the step.
        step: usize,
        /// Which pulse.
        pulse: &'static str,
        /// Its leading edge.
        begins: String,
        /// Its length.
        width: String,
        /// The period.
        period: String,
        /// How much it is too long.
        by: String,
    },
    /// Two edges are too close.
    #[error("step {step}: expected at least {shortest} between {first} and {second}, found {apart}")]
    TooClose {
        /// Number of the step.
        step: usize,
        /// The earlier one.
        first: &'static str,
        /// The later one.
        second: &'static str,
        /// How far they are apart.
        apart: String,
        /// How far they must be.
        shortest: String,
    },
    /// A step is too long, or there is none.
    #[error("step {step}: expected a period of {shortest} to {longest}, found {period}")]
    Period {
        /// Number of the step.
        step: usize,
        /// What was asked for.
        period: String,
        /// The shortest.
        shortest: String,
        /// The longest.
        longest: String,
    },
}

impl Blame for StepsError {
    fn is_input(&self) -> bool {
        true
    }
}

/// Steps that differ in their exposure time only. What is not given comes from the rig, as far as it fits what is given.
#[derive(Clone, Debug, Default)]
pub struct Bracket {
    /// Exposure times, one step each; 0 for a step without CAM.
    pub exposures: Vec<Span>,
    /// Leading edge of CAM from the start of the step.
    pub cam_at: Option<Span>,
    /// Length of the PROJ pulse, which begins the step; 0 for none.
    pub proj_width: Option<Span>,
    /// Length of every step; else each is as short as the rig allows.
    pub period: Option<Span>,
}

impl Bracket {
    /// The steps, in the order of the exposure times; the trigger box with these `limits` can make them.
    ///
    /// # Errors
    /// [`StepsError`] names the step and what in it cannot be.
    pub fn steps(&self, rig: &Rig, limits: Limits) -> Result<Vec<Step>, StepsError> {
        let default = [Span::Seconds(rig.camera.exposure_s)];
        let exposures = if self.exposures.is_empty() {
            &default[..]
        } else {
            &self.exposures
        };
        let given = |option, span: Option<Span>| span.map(|span| limits.ticks(option, span)).transpose();
        let cam_at = given("--cam-at", self.cam_at)?;
        let proj_width = given("--proj-width", self.proj_width)?;
        let period = given("--period", self.period)?;
        exposures
            .iter()
            .enumerate()
            .map(|(index, &exposure)| {
                let width = limits.ticks("--exposure", exposure)?;
                // The rig bounds the pace from a microsecond on; a pulse may well be shorter.
                let exposure_s = exposure.seconds(limits.clock_hz).max(1e-6);
                let rigs = Timing::new(rig, exposure_s)?.step(limits.clock_hz);
                let shortest = limits.shortest;
                // Where the period is given, what is not given makes room for what is.
                let room = period.map_or(Ticks(u64::MAX), |period| period.saturating_sub(shortest));
                let cam_at = cam_at.unwrap_or_else(|| rigs.cam.at.min(room.saturating_sub(width)));
                let cam = Pulse { at: cam_at, width };
                let proj = Pulse {
                    at: Ticks::ZERO,
                    width: proj_width.unwrap_or_else(|| clear_of(rigs.proj.width.min(room), cam, shortest)),
                };
                let end = |pulse: Pulse| pulse.at.checked_add(pulse.width).unwrap_or(pulse.at);
                let needed = end(proj)
                    .max(end(cam))
                    .checked_add(shortest)
                    .unwrap_or(Ticks::ZERO);
                let step = Step {
                    proj,
                    cam,
                    period: period.unwrap_or_else(|| rigs.period.max(needed)),
                };
                check(index, &step, limits).map(|()| step)
            })
            .collect()
    }
}

/// The length of a PROJ pulse of `width`, or a little less, that ends with an edge of `cam` or clear of both.
fn clear_of(width: Ticks, cam: Pulse, shortest: Ticks) -> Ticks {
    let edges = [cam.at, cam.at + cam.width];
    let near = |at: Ticks| at != width && at.0.abs_diff(width.0) < shortest.0;
    match edges.into_iter().find(|&at| !cam.is_none() && near(at)) {
        Some(edge) => edge,
        None => width,
    }
}

/// A pulse, and the names of its line and of its edges.
type Named = (&'static str, Pulse, [&'static str; 2]);

/// Whether the trigger box can make `step`, the `index`-th.
fn check(index: usize, step: &Step, limits: Limits) -> Result<(), StepsError> {
    check_with(index, step, &[], limits)
}

/// Whether it can with these further pulses.
fn check_with(index: usize, step: &Step, more: &[Named], limits: Limits) -> Result<(), StepsError> {
    let words = |ticks| limits.words(ticks);
    let period = step.period;
    if period < limits.shortest || period > limits.longest_period {
        return Err(StepsError::Period {
            step: index,
            period: words(period),
            shortest: words(limits.shortest),
            longest: words(limits.longest_period),
        });
    }
    let mut edges = vec![(Ticks::ZERO, "the start of the step"), (period, "its end")];
    let pulses = [
        (
            "PROJ",
            step.proj,
            ["the leading edge of PROJ", "the trailing edge of PROJ"],
        ),
        (
            "CAM",
            step.cam,
            ["the leading edge of CAM", "the trailing edge of CAM"],
        ),
    ];
    for &(pulse, Pulse { at, width }, names) in pulses.iter().chain(more) {
        if width == Ticks::ZERO {
            continue;
        }
        let end = at.0.saturating_add(width.0);
        if end > period.0 {
            return Err(StepsError::Outside {
                step: index,
                pulse,
                begins: words(at),
                width: words(width),
                period: words(period),
                by: words(Ticks(end - period.0)),
            });
        }
        edges.extend([(at, names[0]), (Ticks(end), names[1])]);
    }
    edges.sort_by_key(|edge| edge.0);
    let close = edges.windows(2).find(|pair| {
        let apart = pair[1].0 - pair[0].0;
        apart > Ticks::ZERO && apart < limits.shortest
    });
    match close {
        None => Ok(()),
        Some(pair) => Err(StepsError::TooClose {
            step: index,
            first: pair[0].1,
            second: pair[1].1,
            apart: words(pair[1].0 - pair[0].0),
            shortest: words(limits.shortest),
        }),
    }
}
