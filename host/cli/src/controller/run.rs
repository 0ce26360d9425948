//! `rcg controller run`

use std::collections::BTreeMap;
use std::path::PathBuf;

use rcg::capture::follow::Ending;
use rcg::capture::records::{RecordFile, flag_names};
use rcg::capture::steps::{Limits, Span};
use rcg::instrument::rig::Rig;
use rcg_protocol::{Event, Extent, Micros, Program, State, Step, StepRecord};
use serde_json::json;

use super::further::Pulses;
use super::schedule::{Schedule, micros};
use super::{TriggerBox, status_value};
use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table};

/// Fire a schedule and wait for its end.
///
/// TIME is a number with its unit: s, ms, us, ns or ticks (of the trigger box's clock), such as 33.3ms or 3ticks.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    schedule: Schedule,
    /// Send the steps while others play, instead of a table beforehand
    #[arg(long)]
    stream: bool,
    /// Abort if this program is silent for so long, at least 20ms; 0s for never [default: 2s]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    dead_man: Option<Span>,
    /// Write a line for each step into this file (.csv, or .jsonl for JSON); it appears when the run has ended
    #[arg(long, value_name = "FILE")]
    records: Option<PathBuf>,
    /// Stamp the pulses of PHOTO, and write a line for each into this file (.csv, or .jsonl for JSON)
    #[arg(long, value_name = "FILE")]
    photo: Option<PathBuf>,
    /// Run so often, each time when what begins a run comes again
    #[arg(long, value_name = "N", conflicts_with = "stream", value_parser = clap::value_parser!(u32).range(1..))]
    repeat: Option<u32>,
}

/// A host cannot be sure to be heard in less.
const SHORTEST_DEAD_MAN: Micros = Micros(20_000);

/// What the records say.
#[derive(Default)]
struct Tally {
    file: Option<RecordFile>,
    records: u64,
    strobes: u64,
    flags: BTreeMap<String, u64>,
    pulses: Pulses,
}

impl Tally {
    fn take(&mut self, event: Option<&Event>) -> Result<(), Failure> {
        let Some(event) = event else { return Ok(()) };
        self.pulses.take(event)?;
        if let Event::Records { records, .. } = event {
            for record in records {
                self.add(record)?;
            }
        }
        Ok(())
    }

    fn add(&mut self, record: &StepRecord) -> Result<(), Failure> {
        self.records += 1;
        self.strobes += u64::from(record.strobe.is_some());
        for name in flag_names(record.flags) {
            *self.flags.entry(name).or_default() += 1;
        }
        let written = self.file.as_mut().map_or(Ok(()), |file| file.write(record));
        if written.is_err() {
            // Half of the records do not pass for all.
            self.file = None;
        }
        Ok(written?)
    }

    /// The flags, with their numbers.
    fn flags(&self) -> String {
        let flags: Vec<String> = self
            .flags
            .iter()
            .map(|(name, count)| format!("{count} {name}"))
            .collect();
        if flags.is_empty() {
            "none".to_owned()
        } else {
            flags.join(", ")
        }
    }
}

/// Fires `count` steps, in turns of `steps`, as often as was asked for. Returns how many runs were done, and how the last one ended.
fn fire(
    args: &Args,
    device: &mut TriggerBox,
    program: &Program,
    (steps, count): (&[Step], u32),
    tally: &mut Tally,
) -> Result<(u32, Ending), Failure> {
    let ended = match (args.stream, args.repeat) {
        (true, _) => {
            let stream = steps.iter().copied().cycle().take(count as usize);
            device
                .stream(program, stream, |event| tally.take(event))
                .map(|ending| (1, ending))
        }
        (false, Some(runs)) => device.play_series(program, steps, runs, |event| tally.take(event)),
        (false, None) => device
            .play(program, steps, |event| tally.take(event))
            .map(|ending| (1, ending)),
    };
    // What was recorded before a run broke off is kept.
    if let Some(file) = tally.file.take_if(|_| ended.is_ok() || tally.records > 0) {
        file.finish()?;
    }
    if ended.is_ok() || tally.pulses.told > 0 {
        tally.pulses.finish()?;
    }
    ended
}

pub(super) fn run(args: &Args, rig: &Rig, device: &mut TriggerBox, output: &Output) -> Done {
    let clock_hz = device.info().clock_hz;
    let schedule = &args.schedule;
    let limits = Limits::new(&device.info(), schedule.pace());
    let (steps, count) = schedule.steps(rig, limits)?;
    let cycles = count / steps.len() as u32;
    let extent = if args.stream {
        Extent::Stream
    } else {
        Extent::Table {
            steps: steps.len() as u32,
            cycles,
        }
    };
    let dead_man = ("--dead-man", args.dead_man);
    let program = Program {
        dead_man: micros(dead_man, [SHORTEST_DEAD_MAN, Micros::DEFAULT_DEAD_MAN], clock_hz)?,
        ..schedule.program(extent, clock_hz)?
    };
    let aux = schedule.aux(args.photo.is_some(), (&steps, &program), limits)?;
    if let Some(glitch) = schedule.glitch(clock_hz)? {
        device.filter_strobe(glitch)?;
    }
    if let Some(aux) = &aux {
        device.aux(aux)?;
    }
    let mut tally = Tally {
        file: args.records.as_deref().map(RecordFile::create).transpose()?,
        pulses: Pulses::to(args.photo.as_deref())?,
        ..Tally::default()
    };
    let (runs, ending) = fire(args, device, &program, (&steps, count), &mut tally)?;
    if args.photo.is_some() {
        tally.pulses.count(u64::from(device.photo()?.pulses));
    }
    report(args, (runs, ending), (&steps, count), &tally, device, output)
}

/// Tells what came of it.
fn report(
    args: &Args,
    (runs, ending): (u32, Ending),
    (steps, count): (&[Step], u32),
    tally: &Tally,
    device: &mut TriggerBox,
    output: &Output,
) -> Done {
    let clock_hz = device.info().clock_hz;
    let status = device.status()?;
    let duration_s = ending.at.map_or(0.0, |at| at.0 as f64 / f64::from(clock_hz));
    let mut value = status_value(&status, clock_hz);
    value["records"] = json!(tally.records);
    value["strobes"] = json!(tally.strobes);
    value["flags"] = json!(tally.flags);
    value["period_ticks"] = json!(steps[0].period.0);
    value["duration_s"] = json!(duration_s);
    let Pulses { told, lost, .. } = &tally.pulses;
    if args.photo.is_some() {
        value["photo"] = json!({ "pulses": told, "lost": lost });
    }
    if args.repeat.is_some() {
        value["runs"] = json!(runs);
    }
    if let (State::Fault, Some(fault)) = (ending.state, ending.fault) {
        let done = ending.steps_done;
        let port = rcg::capture::link::Link::peer(device.link());
        let of = args
            .repeat
            .map_or(String::new(), |of| format!(" of run {} of {of}", runs + 1));
        let error =
            anyhow::anyhow!("port {port}: expected {count} steps{of}, found an end after {done}: {fault}");
        return Err(Failure::Partly(error, value));
    }
    if args.photo.is_some() && tally.pulses.runs < runs {
        let port = rcg::capture::link::Link::peer(device.link());
        let error = anyhow::anyhow!(
            "port {port}: expected to be told of PHOTO in {runs} runs, found {}: steps are too short for its stamps, or the link lost some",
            tally.pulses.runs
        );
        return Err(Failure::Partly(error, value));
    }
    output.print(&value, || {
        let mut lines = vec![
            ("state", ending.state.to_string()),
            ("steps", format!("{} of {count}", ending.steps_done)),
            ("duration", format!("{duration_s:.6} s")),
            (
                "records",
                format!("{}, {} with a strobe", tally.records, tally.strobes),
            ),
            ("flags", tally.flags()),
        ];
        if args.photo.is_some() {
            lines.push(("PHOTO", format!("{told} pulses, {lost} lost")));
        }
        if let Some(of) = args.repeat {
            lines.insert(0, ("runs", format!("{runs} of {of}, the last one:")));
        }
        table(&lines)
    })
}
