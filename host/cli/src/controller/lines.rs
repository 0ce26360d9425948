//! `rcg controller pulse` and `rcg controller hold`: one output by itself, for a scope or a meter at the wires

use clap::ValueEnum;
use rcg::capture::steps::{self, Limits, Span};
use rcg_protocol::{
    Aux, AuxPolarity, Event, Extent, Line, Micros, Pace, Polarity, Program, State, Step, Strobe, Ticks,
};
use serde_json::{Value, json};

use super::TriggerBox;
use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table};

/// Pulse one output, the others stay at rest; of CAM it is told what STROBE did.
///
/// TIME is a number with its unit: s, ms, us, ns or ticks (of the trigger box's clock), such as 33.3ms or 3ticks.
#[derive(Debug, clap::Args)]
pub(crate) struct PulseArgs {
    /// The output
    line: Out,
    /// Length of a pulse
    #[arg(long, value_name = "TIME", default_value = "1ms", allow_hyphen_values = true)]
    width: Span,
    /// Pulses
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    count: u32,
    /// From the start of a pulse to that of the next [default: twice their length]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    period: Option<Span>,
    /// The output rests high and pulses low
    #[arg(long)]
    active_low: bool,
}

/// Hold one output high or low for a while, the others at rest; before and after all are at rest.
///
/// An output rests low, or high with --active-low. It goes to rest at once, too, if this program is silent for 2 s.
#[derive(Debug, clap::Args)]
pub(crate) struct HoldArgs {
    /// The output
    line: Out,
    /// Where it is held
    level: Level,
    /// For how long: a number with its unit, such as 5s
    #[arg(
        long = "for",
        value_name = "TIME",
        default_value = "1s",
        allow_hyphen_values = true
    )]
    lasting: Span,
    /// The output rests high
    #[arg(long)]
    active_low: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Out {
    Proj,
    Cam,
    AuxA,
    AuxB,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Level {
    High,
    Low,
}

impl Out {
    const fn output(self) -> steps::Output {
        match self {
            Self::Proj => steps::Output::Proj,
            Self::Cam => steps::Output::Cam,
            Self::AuxA => steps::Output::AuxA,
            Self::AuxB => steps::Output::AuxB,
        }
    }

    const fn line(self) -> Line {
        self.output().line()
    }

    const fn is_further(self) -> bool {
        matches!(self, Self::AuxA | Self::AuxB)
    }

    /// Plays `step` so many times, with this output active low or not. Returns what STROBE did at each, as far as it is known.
    fn play(
        self,
        (step, aux): (Step, Aux),
        cycles: u32,
        is_low: bool,
        device: &mut TriggerBox,
    ) -> Result<Vec<Strobe>, Failure> {
        let polarity = Polarity {
            proj_active_low: is_low && matches!(self, Self::Proj),
            cam_active_low: is_low && matches!(self, Self::Cam),
            ..Polarity::default()
        };
        if self.is_further() {
            device.aux(&Aux {
                polarity: AuxPolarity {
                    a_active_low: is_low && matches!(self, Self::AuxA),
                    b_active_low: is_low && matches!(self, Self::AuxB),
                    ..AuxPolarity::default()
                },
                ..aux
            })?;
        }
        let program = Program {
            polarity,
            dead_man: Micros::DEFAULT_DEAD_MAN,
            ..Program::new(Extent::Table { steps: 1, cycles })
        };
        let mut strobes = Vec::new();
        let ending = device.play(&program, &[step], |event| {
            if let Some(Event::Records { records, .. }) = event {
                strobes.extend(records.iter().filter_map(|record| record.strobe));
            }
            Ok::<(), Failure>(())
        })?;
        if let (State::Fault, Some(fault)) = (ending.state, ending.fault) {
            return Err(Failure::Failed(anyhow::anyhow!(
                "expected {cycles} pulses of {}, found an end after {}: {fault}",
                self.line(),
                ending.steps_done
            )));
        }
        Ok(strobes)
    }
}

/// What a pulse of CAM made STROBE do.
fn of_strobe(strobes: &[Strobe], count: u32, clock_hz: u32) -> (Value, String) {
    let us = |ticks: u64| ticks as f64 / f64::from(clock_hz) * 1e6;
    let widest = |of: fn(&Strobe) -> u64| {
        let range = strobes.iter().map(of).min().zip(strobes.iter().map(of).max());
        range.map(|(least, most)| [us(least), us(most)])
    };
    let (delay, width) = (widest(|strobe| strobe.delay.0), widest(|strobe| strobe.width.0));
    let value = json!({ "pulses": strobes.len(), "delay_us": delay, "width_us": width });
    let words = match (delay, width) {
        (Some([from, to]), Some([short, long])) => format!(
            "{} of {count}, {from:.3} to {to:.3} us behind, {short:.3} to {long:.3} us long",
            strobes.len()
        ),
        _ => format!("none of {count}: at rest all the time"),
    };
    (value, words)
}

pub(super) fn pulse(args: &PulseArgs, device: &mut TriggerBox, output: &Output) -> Done {
    let info = device.info();
    let (step, aux) =
        Limits::new(&info, Pace::FreeRunning).pulse(args.line.output(), args.width, args.period)?;
    let seconds = |ticks: Ticks| ticks.0 as f64 / f64::from(info.clock_hz);
    let further = [aux.a, aux.b].map(|pulse| pulse.of(&step));
    let widths = further.into_iter().flatten().map(|pulse| pulse.width);
    let width = widths.fold(step.proj.width.max(step.cam.width), Ticks::max);
    if width == Ticks::ZERO {
        return Err(Failure::input(format!(
            "--width: expected a pulse of more than 0 s, found {}",
            args.width
        )));
    }
    let strobes = args.line.play((step, aux), args.count, args.active_low, device)?;
    let (strobe, words) = of_strobe(&strobes, args.count, info.clock_hz);
    let is_cam = matches!(args.line, Out::Cam);
    let value = json!({
        "line": args.line.line().to_string(), "pulses": args.count,
        "width_s": seconds(width), "period_s": seconds(step.period),
        "strobe": if is_cam { strobe } else { Value::Null },
    });
    output.print(&value, || {
        let mut lines = vec![
            ("line", args.line.line().to_string()),
            ("pulses", args.count.to_string()),
            ("width", format!("{} us", seconds(width) * 1e6)),
            ("period", format!("{} us", seconds(step.period) * 1e6)),
        ];
        if is_cam {
            lines.push(("STROBE", words));
        }
        table(&lines)
    })
}

pub(super) fn hold(args: &HoldArgs, device: &mut TriggerBox, output: &Output) -> Done {
    let info = device.info();
    let limits = Limits::new(&info, Pace::FreeRunning);
    let is_rest = (args.level == Level::Low) != args.active_low;
    // At rest it needs no pulse; else the pulse is all of the step but its end.
    let end = limits.shortest;
    let lasting = args.lasting.ticks(info.clock_hz);
    if lasting == Ticks::ZERO {
        return Err(Failure::input(format!(
            "--for: expected a time of at least a tick, found {}",
            args.lasting
        )));
    }
    let width = if is_rest { 0 } else { lasting.0 };
    let period = Span::Ticks(lasting.0.saturating_add(end.0));
    let step = limits.pulse(args.line.output(), Span::Ticks(width), Some(period))?;
    args.line.play(step, 1, args.active_low, device)?;
    let held_s = lasting.0 as f64 / f64::from(info.clock_hz);
    let level = if args.level == Level::High { "high" } else { "low" };
    let value = json!({ "line": args.line.line().to_string(), "level": level, "held_s": held_s });
    output.print(&value, || {
        table(&[
            ("line", args.line.line().to_string()),
            ("held", format!("{level} for {held_s} s")),
        ])
    })
}
