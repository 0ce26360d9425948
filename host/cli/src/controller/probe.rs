//! `rcg controller probe` and `rcg controller selftest`: what stands at the inputs, and whether the wires are right

use std::time::Duration;

use rcg::capture::device::DeviceError;
use rcg::capture::link::Link as _;
use rcg::capture::selftest::{PAIRS, Seen, Settings, selftest as try_wires, selftest_photo};
use rcg::capture::steps::{Output as Line, Span};
use rcg_protocol::{Input, Inputs};
use serde_json::{Value, json};

use super::TriggerBox;
use super::schedule::{self, aux_polarity, polarity};
use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table};

/// Show levels, edges and rates of SYNC, STROBE and PHOTO, while all outputs rest.
///
/// The trigger box counts every edge that lasts for 32 ns at least. An input that nobody drives is where the box pulls it: `rcg
/// controller selftest` tells whether one is open.
///
/// TIME is a number with its unit: s, ms or us, such as 5s.
#[derive(Debug, clap::Args)]
pub(crate) struct ProbeArgs {
    /// For how long, up to 1000s
    #[arg(
        long = "for",
        value_name = "TIME",
        default_value = "1s",
        allow_hyphen_values = true
    )]
    lasting: Span,
    /// From one line to the next, at least 10ms
    #[arg(
        long,
        value_name = "TIME",
        default_value = "250ms",
        allow_hyphen_values = true
    )]
    every: Span,
}

/// Pulse each output alone and see which input answers: levels at rest, delays, pulse widths, polarity, and what is wired wrong.
///
/// With jumpers from PROJ to SYNC (pins 4 and 6) and from CAM to STROBE (pins 5 and 7), or with projector and camera. Exit code 1 if
/// something is not as it should be.
///
/// TIME is a number with its unit: s, ms, us, ns or ticks (of the trigger box's clock), such as 2ms.
#[derive(Debug, clap::Args)]
pub(crate) struct SelftestArgs {
    /// Length of every other pulse; those between are twice as long
    #[arg(long, value_name = "TIME", default_value = "1ms", allow_hyphen_values = true)]
    width: Span,
    /// Time from the start of a pulse in which its answer begins and ends
    #[arg(long, value_name = "TIME", default_value = "50ms", allow_hyphen_values = true)]
    period: Span,
    /// Pulses of each output
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1000))]
    count: u32,
    /// Lines that should rest high and pulse low
    #[arg(long, value_name = "LINE[,LINE…]", value_delimiter = ',')]
    active_low: Vec<schedule::Line>,
    /// Pulse AUX-A and AUX-B too, of which PHOTO should answer this one: by a jumper (pins 9 and 11, or 10 and 11), or a light source and a
    /// photodiode
    #[arg(long, value_name = "LINE")]
    photo: Option<Further>,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Further {
    AuxA,
    AuxB,
}

impl Further {
    const fn output(self) -> Line {
        match self {
            Self::AuxA => Line::AuxA,
            Self::AuxB => Line::AuxB,
        }
    }
}

/// What is high or low for four ticks is seen for certain, and an optocoupler makes it shorter.
const SHORTEST_TICKS: u64 = 8;

/// A span of `option` in seconds, if it is one of `from` to `to` seconds.
fn seconds(option: &str, span: Span, clock_hz: u32, [from, to]: [f64; 2]) -> Result<Duration, Failure> {
    let s = span.seconds(clock_hz);
    if (from..=to).contains(&s) {
        Ok(Duration::from_secs_f64(s))
    } else {
        Err(Failure::input(format!(
            "--{option}: expected from {from} s to {to} s, found {span}"
        )))
    }
}

/// Edges per second of an input between two looks.
fn rate(before: &Input, after: &Input, elapsed_s: f64) -> Option<f64> {
    let edges = after.edges?.checked_sub(before.edges?)?;
    Some(f64::from(edges) / elapsed_s)
}

/// All inputs at a moment; PHOTO is none where the firmware has no such line.
#[derive(Clone, Copy)]
struct Look {
    inputs: Inputs,
    photo: Option<Input>,
}

impl Look {
    fn at(device: &mut TriggerBox) -> Result<Self, Failure> {
        let inputs = device.inputs()?;
        let photo = match device.photo() {
            Ok(photo) => Some(photo.input),
            Err(DeviceError::Older { .. }) => None,
            Err(error) => return Err(error.into()),
        };
        Ok(Self { inputs, photo })
    }

    /// What is to be told of it, with the rates since the one `before`.
    fn told(&self, before: &Self, clock_hz: u32) -> (Value, String) {
        let s = |ticks: u64| ticks as f64 / f64::from(clock_hz);
        let (then, now) = (&before.inputs, &self.inputs);
        let elapsed_s = s((now.at - then.at).0.max(1));
        let of = |before: &Input, after: &Input| {
            let level = if after.high { "high" } else { "low" };
            let rate = rate(before, after, elapsed_s);
            let value = json!({
                "level": level, "pulled": if after.pulled_up { "up" } else { "down" },
                "edges": after.edges, "edges_per_s": rate,
            });
            let text = match (after.edges, rate) {
                (Some(edges), Some(rate)) => format!("{level:<4} {edges:>8} edges {rate:>10.1}/s"),
                _ => format!("{level:<4} edges not counted"),
            };
            (value, text)
        };
        let (sync, strobe) = (of(&then.sync, &now.sync), of(&then.strobe, &now.strobe));
        let photo = before.photo.zip(self.photo).map(|(then, now)| of(&then, &now));
        let at_s = s((now.at - now.since).0);
        let mut value = json!({ "at_s": at_s, "SYNC": sync.0, "STROBE": strobe.0 });
        let mut text = format!("{at_s:>9.3} s   SYNC {}   STROBE {}", sync.1, strobe.1);
        if let Some((photo, words)) = photo {
            value["PHOTO"] = photo;
            text.push_str("   PHOTO ");
            text.push_str(&words);
        }
        (value, text + "\n")
    }
}

pub(super) fn probe(args: &ProbeArgs, device: &mut TriggerBox, output: &Output) -> Done {
    let clock_hz = device.info().clock_hz;
    let lasting = seconds("for", args.lasting, clock_hz, [0.01, 1000.0])?;
    let every = seconds("every", args.every, clock_hz, [0.01, 1000.0])?;
    device.watch()?;
    let first = Look::at(device)?;
    let began = device.link().now();
    let (mut before, mut looks) = (first, Vec::new());
    for next in 1.. {
        let until = (every * next).min(lasting);
        while device.link().now() < began + until {
            let left = (began + until).saturating_sub(device.link().now());
            device.next_event(left)?;
        }
        let now = Look::at(device)?;
        if now.inputs.since != first.inputs.since {
            return Err(Failure::Failed(anyhow::anyhow!(
                "port {}: expected to be alone, found that somebody else has the trigger box count anew",
                device.link().peer()
            )));
        }
        let (value, line) = now.told(&before, clock_hz);
        if output.is_json() {
            looks.push(value);
        } else {
            output.print(&value, || line)?;
        }
        before = now;
        if until == lasting {
            break;
        }
    }
    if output.is_json() {
        let (mut whole, _) = before.told(&first, clock_hz);
        whole["looks"] = Value::Array(looks);
        output.print(&whole, String::new)?;
    }
    Ok(())
}

/// The range of what answers took, in microseconds.
fn range(answers: impl Iterator<Item = u64> + Clone, clock_hz: u32) -> Option<[f64; 2]> {
    let us = |ticks: u64| ticks as f64 / f64::from(clock_hz) * 1e6;
    let (least, most) = answers.clone().min().zip(answers.max())?;
    Some([us(least), us(most)])
}

/// What an input did at the pulses of one output.
fn answers(seen: &Seen, output: Line, clock_hz: u32) -> (Value, String) {
    let timed = || seen.of(output).iter().filter_map(|answer| answer.delay_and_width);
    let delay = range(timed().map(|(delay, _)| delay.0), clock_hz);
    let longer = seen.of(output).iter().filter_map(|answer| {
        let (_, width) = answer.delay_and_width?;
        Some((width.0, answer.pulse.0))
    });
    let us = |ticks: f64| ticks / f64::from(clock_hz) * 1e6;
    let excess: Vec<f64> = longer
        .map(|(width, pulse)| us(width as f64 - pulse as f64))
        .collect();
    let most = excess.iter().copied().reduce(f64::max);
    let least = excess.iter().copied().reduce(f64::min);
    let width = range(timed().map(|(_, width)| width.0), clock_hz);
    let (count, of) = (seen.answered(output), seen.of(output).len());
    let value = json!({
        "pulses": of, "answered": count, "delay_us": delay, "width_us": width,
        "longer_than_pulse_us": least.zip(most).map(|(least, most)| [least, most]),
    });
    let text = match (delay, width, least.zip(most)) {
        (Some([from, to]), Some([short, long]), Some((least, most))) => format!(
            "{count} of {of}, {from:.3} to {to:.3} us behind, {short:.3} to {long:.3} us long \
             ({least:+.3} to {most:+.3} us against the pulse)"
        ),
        _ => format!("{count} of {of}"),
    };
    (value, text)
}

pub(super) fn selftest(args: &SelftestArgs, device: &mut TriggerBox, output: &Output) -> Done {
    let clock_hz = device.info().clock_hz;
    if args.width.ticks(clock_hz).0 < SHORTEST_TICKS {
        return Err(Failure::input(format!(
            "--width: expected at least {SHORTEST_TICKS} ticks, which an input sees for certain, found {}",
            args.width
        )));
    }
    let settings = Settings {
        polarity: polarity(&args.active_low),
        width: args.width,
        period: args.period,
        count: args.count,
    };
    let tested = try_wires(device, &settings)?;
    let mut value = json!({
        "port": device.link().peer(),
    });
    let photo = args.photo.map(|own| {
        let polarity = aux_polarity(&args.active_low);
        selftest_photo(device, &settings, polarity, own.output())
    });
    let photo = photo.transpose()?;
    let findings = photo.iter().flat_map(|photo| &photo.findings);
    let findings: Vec<String> = tested
        .findings
        .iter()
        .chain(findings)
        .map(ToString::to_string)
        .collect();
    value["findings"] = json!(findings);
    let mut lines = Vec::new();
    let inputs = tested
        .inputs
        .iter()
        .map(|seen| (seen, PAIRS.map(|(output, _)| output)));
    let photo = photo.iter().map(|photo| (&photo.seen, [Line::AuxA, Line::AuxB]));
    for (seen, outputs) in inputs.chain(photo) {
        let name = seen.line.to_string();
        value[&name] = json!({
            "at_rest": (seen.by_itself == 0).then(|| seen.rest.to_string()),
            "edges_by_itself": seen.by_itself,
        });
        let words = match seen.by_itself {
            0 => format!("{} at rest", seen.rest),
            edges => format!("{edges} edges by itself: what it answers cannot be told"),
        };
        lines.push((name.clone(), words));
        for out in outputs {
            let (facts, words) = answers(seen, out, clock_hz);
            if seen.by_itself == 0 {
                value[&name][out.line().to_string()] = facts;
                lines.push((format!("  answers {}", out.line()), words));
            }
        }
    }
    if !findings.is_empty() {
        let further = args.photo.map_or(String::new(), |own| {
            format!(", and {} to reach PHOTO", own.output().line())
        });
        let error = anyhow::anyhow!(
            "port {}: expected PROJ to reach SYNC and CAM to reach STROBE{further}, found that {}",
            device.link().peer(),
            findings.join("; ")
        );
        return Err(Failure::Partly(error, value));
    }
    lines.push(("found".to_owned(), "nothing wrong".to_owned()));
    output.print(&value, || {
        let lines: Vec<(&str, String)> = lines
            .iter()
            .map(|(name, text)| (name.as_str(), text.clone()))
            .collect();
        table(&lines)
    })
}
