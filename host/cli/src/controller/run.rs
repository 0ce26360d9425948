//! `rcg controller run`

use std::collections::BTreeMap;
use std::path::PathBuf;

use rcg::capture::follow::Ending;
use rcg::capture::records::{RecordFile, flag_names};
use rcg::capture::steps::{Bracket, Limits, Span};
use rcg::instrument::rig::Rig;
use rcg_protocol::{
    AuxPolarity, Event, Extent, Micros, Pace, Polarity, Program, Start, State, Step, StepRecord, Ticks,
};
use serde_json::json;

use super::further::{self, Pulses};
use super::{TriggerBox, status_value};
use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table};

/// Fire a schedule and wait for its end.
///
/// TIME is a number with its unit: s, ms, us, ns or ticks (of the trigger box's clock), such as 33.3ms or 3ticks.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Steps to fire, a multiple of the number of exposure times [default: 100 or the next multiple]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    steps: Option<u32>,
    /// Exposure time (length of the CAM pulse, 0us for none), or several that take turns [default: the rig's]
    #[arg(
        long,
        value_name = "TIME[,TIME…]",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    exposure: Vec<Span>,
    /// Length of a step [default: as short as the rig and the other times allow]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    period: Option<Span>,
    /// Leading edge of CAM from the start of the step [default: the rig's settling time, or less if --period says so]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    cam_at: Option<Span>,
    /// Length of the PROJ pulse, which begins the step; 0us for none [default: 5us]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    proj_width: Option<Span>,
    /// Send the steps while others play, instead of a table beforehand
    #[arg(long)]
    stream: bool,
    /// Begin at an edge of SYNC
    #[arg(long)]
    start_on_sync: bool,
    /// Begin each step at an edge of SYNC of its own
    #[arg(long)]
    each_on_sync: bool,
    /// End with a fault if SYNC does not come for so long [default: wait for ever]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    sync_timeout: Option<Span>,
    /// Abort if this program is silent for so long, at least 20ms; 0s for never [default: 2s]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    dead_man: Option<Span>,
    /// Take what STROBE does for less than this, up to 1ms, for a glitch [default: nothing is one]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    strobe_filter: Option<Span>,
    /// Lines that rest high and pulse low
    #[arg(long, value_name = "LINE[,LINE…]", value_delimiter = ',')]
    active_low: Vec<Line>,
    #[command(flatten)]
    further: further::Args,
    /// Write a line for each step into this file (.csv, or .jsonl for JSON); it appears when the run has ended
    #[arg(long, value_name = "FILE")]
    records: Option<PathBuf>,
}

/// A host cannot be sure to be heard in less.
const SHORTEST_DEAD_MAN: Micros = Micros(20_000);

/// What is longer is an exposure, or a pause between two.
const LONGEST_GLITCH_S: f64 = 1e-3;

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Line {
    Proj,
    Cam,
    Sync,
    Strobe,
    AuxA,
    AuxB,
    Photo,
    Start,
}

/// That of lines of which these rest high and pulse low.
pub(super) fn polarity(active_low: &[Line]) -> Polarity {
    let low = |line| active_low.contains(&line);
    Polarity {
        proj_active_low: low(Line::Proj),
        cam_active_low: low(Line::Cam),
        sync_active_low: low(Line::Sync),
        strobe_active_low: low(Line::Strobe),
    }
}

/// That of the further lines, of which these rest high and pulse low.
pub(super) fn aux_polarity(active_low: &[Line]) -> AuxPolarity {
    let low = |line| active_low.contains(&line);
    AuxPolarity {
        a_active_low: low(Line::AuxA),
        b_active_low: low(Line::AuxB),
        photo_active_low: low(Line::Photo),
        start_active_low: low(Line::Start),
    }
}

impl Args {
    /// The steps that take turns, and how many are fired.
    fn steps(&self, rig: &Rig, limits: Limits) -> Result<(Vec<Step>, u32), Failure> {
        let bracket = Bracket {
            exposures: self.exposure.clone(),
            cam_at: self.cam_at,
            proj_width: self.proj_width,
            period: self.period,
        };
        let steps = bracket.steps(rig, limits)?;
        let turn = steps.len() as u32;
        let count = self.steps.unwrap_or_else(|| 100_u32.next_multiple_of(turn));
        if count.is_multiple_of(turn) {
            Ok((steps, count))
        } else {
            Err(Failure::input(format!(
                "--steps: expected a multiple of {turn}, the number of exposure times, found {count}"
            )))
        }
    }

    /// What of STROBE is a glitch.
    fn glitch(&self, clock_hz: u32) -> Result<Option<Ticks>, Failure> {
        let Some(span) = self.strobe_filter else {
            return Ok(None);
        };
        let (seconds, ticks) = (span.seconds(clock_hz), span.ticks(clock_hz));
        if seconds.abs() <= 0.0 || (seconds <= LONGEST_GLITCH_S && ticks > Ticks::ZERO) {
            Ok(Some(ticks))
        } else {
            Err(Failure::input(format!(
                "--strobe-filter: expected 0s for none or from 1 tick to {} ms, found {span}",
                LONGEST_GLITCH_S * 1e3
            )))
        }
    }

    const fn pace(&self) -> Pace {
        if self.each_on_sync {
            Pace::EachOnSync
        } else {
            Pace::FreeRunning
        }
    }

    fn program(&self, extent: Extent, clock_hz: u32) -> Result<Program, Failure> {
        let micros = |name: &str, span: Option<Span>, least: Micros, default: Micros| {
            let Some(span) = span else { return Ok(default) };
            let none = span.seconds(clock_hz) <= 0.0;
            span.micros(clock_hz)
                .filter(|micros| none || *micros >= least)
                .ok_or_else(|| {
                    let least_ms = f64::from(least.0) * 1e-3;
                    Failure::input(format!(
                        "--{name}: expected 0s for none or from {least_ms} ms to 4294 s, found {span}"
                    ))
                })
        };
        Ok(Program {
            extent,
            start: match (self.start_on_sync, self.further.start_on_line) {
                (true, _) => Start::OnSync,
                (false, true) => Start::OnStartLine,
                (false, false) => Start::AtOnce,
            },
            pace: self.pace(),
            polarity: polarity(&self.active_low),
            sync_timeout: micros("sync-timeout", self.sync_timeout, Micros(1), Micros(0))?,
            dead_man: micros(
                "dead-man",
                self.dead_man,
                SHORTEST_DEAD_MAN,
                Micros::DEFAULT_DEAD_MAN,
            )?,
        })
    }
}

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
    let ended = match (args.stream, args.further.repeat) {
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
    let limits = Limits::new(&device.info(), args.pace());
    let (steps, count) = args.steps(rig, limits)?;
    let cycles = count / steps.len() as u32;
    let extent = if args.stream {
        Extent::Stream
    } else {
        Extent::Table {
            steps: steps.len() as u32,
            cycles,
        }
    };
    let program = args.program(extent, clock_hz)?;
    let aux = args
        .further
        .aux(aux_polarity(&args.active_low), (&steps, &program), limits)?;
    if let Some(glitch) = args.glitch(clock_hz)? {
        device.filter_strobe(glitch)?;
    }
    if let Some(aux) = &aux {
        device.aux(aux)?;
    }
    let mut tally = Tally {
        file: args.records.as_deref().map(RecordFile::create).transpose()?,
        pulses: Pulses::to(args.further.photo.as_deref())?,
        ..Tally::default()
    };
    let (runs, ending) = fire(args, device, &program, (&steps, count), &mut tally)?;
    if args.further.photo.is_some() {
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
    if args.further.photo.is_some() {
        value["photo"] = json!({ "pulses": told, "lost": lost });
    }
    if args.further.repeat.is_some() {
        value["runs"] = json!(runs);
    }
    if let (State::Fault, Some(fault)) = (ending.state, ending.fault) {
        let done = ending.steps_done;
        let port = rcg::capture::link::Link::peer(device.link());
        let of = args
            .further
            .repeat
            .map_or(String::new(), |of| format!(" of run {} of {of}", runs + 1));
        let error =
            anyhow::anyhow!("port {port}: expected {count} steps{of}, found an end after {done}: {fault}");
        return Err(Failure::Partly(error, value));
    }
    if args.further.photo.is_some() && tally.pulses.runs < runs {
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
        if args.further.photo.is_some() {
            lines.push(("PHOTO", format!("{told} pulses, {lost} lost")));
        }
        if let Some(of) = args.further.repeat {
            lines.insert(0, ("runs", format!("{runs} of {of}, the last one:")));
        }
        table(&lines)
    })
}
