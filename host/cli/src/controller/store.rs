//! `rcg controller store` and `rcg controller forget`: a schedule that the box runs without a host

use rcg::capture::device::Standalone;
use rcg::capture::steps::Limits;
use rcg::instrument::rig::Rig;
use rcg_protocol::{Extent, Start, Stored, Ticks};
use serde_json::{Value, json};

use super::TriggerBox;
use super::schedule::Schedule;
use crate::Done;
use crate::output::{Output, table};

/// Let the trigger box keep a schedule that it runs without a computer, whenever it is switched on.
///
/// It begins at once, or at edges of START or SYNC if you say so, and needs no computer then; one that comes can end it with `rcg controller
/// abort`. After a reset by itself, as after a defect, the box runs nothing. `rcg controller info` shows what is kept, `rcg controller
/// forget` ends that. What is kept before is replaced.
///
/// TIME is a number with its unit: s, ms, us, ns or ticks (of the trigger box's clock), such as 33.3ms or 3ticks.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    schedule: Schedule,
    /// Runs after the box is switched on, each time when what begins a run comes again [default: without end]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    repeat: Option<u32>,
}

pub(super) fn store(args: &Args, rig: &Rig, device: &mut TriggerBox, output: &Output) -> Done {
    let clock_hz = device.info().clock_hz;
    let schedule = &args.schedule;
    let limits = Limits::new(&device.info(), schedule.pace());
    let (steps, count) = schedule.steps(rig, limits)?;
    let extent = Extent::Table {
        steps: steps.len() as u32,
        cycles: count / steps.len() as u32,
    };
    let program = schedule.program(extent, clock_hz)?;
    let aux = schedule.aux(false, (&steps, &program), limits)?;
    let stored = device.store(&Standalone {
        program,
        steps,
        aux: aux.unwrap_or_default(),
        shortest_strobe: schedule.glitch(clock_hz)?.unwrap_or(Ticks::ZERO),
        runs: args.repeat.unwrap_or(0),
    })?;
    told(Some(stored), output)
}

pub(super) fn forget(device: &mut TriggerBox, output: &Output) -> Done {
    device.forget()?;
    told(None, output)
}

fn told(stored: Option<Stored>, output: &Output) -> Done {
    let value = json!({ "stored": stored.map(|stored| value(&stored)) });
    output.print(&value, || table(&[("stored schedule", sentence(stored))]))
}

/// What is kept, for programs.
pub(super) fn value(stored: &Stored) -> Value {
    json!({
        "steps": stored.steps,
        "begins": begins(stored.start),
        "runs": (stored.runs != 0).then_some(stored.runs),
    })
}

/// What is kept, for people.
pub(super) fn sentence(stored: Option<Stored>) -> String {
    let Some(stored) = stored else {
        return "none".to_owned();
    };
    let runs = match stored.runs {
        0 => "without end".to_owned(),
        1 => "once".to_owned(),
        runs => format!("{runs} times"),
    };
    format!(
        "{} steps, {}, {runs}; from each power-up on, without a computer",
        stored.steps,
        begins(stored.start)
    )
}

const fn begins(start: Start) -> &'static str {
    match start {
        Start::AtOnce => "at once",
        Start::OnSync => "on an edge of SYNC",
        Start::OnStartLine => "on an edge of START",
    }
}
