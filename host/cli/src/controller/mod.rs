//! `rcg controller`

mod bench;
mod further;
mod lines;
mod probe;
mod run;
mod schedule;
mod store;
mod update;

use std::time::Duration;

use rcg::capture::device::{Device, Patience};
use rcg::capture::link::{self, Link};
use rcg::instrument::rig::Rig;
use rcg::virtual_rig::VirtualController;
use rcg_protocol::{State, Status, Unit};
use serde_json::{Value, json};

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table};

/// Talk to the trigger box.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    action: Action,
    /// Port of the trigger box (/dev/ttyACM0, COM3), serial: and its serial number, auto for the only one on USB, or sim for the simulated one
    #[arg(long, global = true, default_value = "auto", value_name = "PORT")]
    port: String,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// What it is and can do
    Info,
    /// How things stand, and what was counted since it was switched on
    Status,
    Run(Box<run::Args>),
    Store(Box<store::Args>),
    /// Let the trigger box keep no schedule any more that it runs without a computer
    Forget,
    /// End the run after the current step
    Stop,
    /// End the run at once
    Abort,
    Bench(bench::Args),
    Pulse(lines::PulseArgs),
    Hold(lines::HoldArgs),
    Probe(probe::ProbeArgs),
    Selftest(probe::SelftestArgs),
    Update(update::Args),
}

type TriggerBox = Device<Box<dyn Link>>;

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let rig = Rig::load(rig)?;
    if let Action::Update(update) = &args.action {
        return update::run(update, &args.port, output);
    }
    let link: Box<dyn Link> = if args.port == "sim" {
        Box::new(VirtualController::alone(&rig))
    } else {
        link::open(&args.port)?
    };
    let mut device = Device::connect(link, link::nonce(), Patience::default())?;
    let status = match &args.action {
        Action::Info => return info(&mut device, output),
        Action::Run(args) => return run::run(args, &rig, &mut device, output),
        Action::Store(args) => return store::store(args, &rig, &mut device, output),
        Action::Forget => return store::forget(&mut device, output),
        Action::Bench(args) => return bench::run(args, &mut device, output),
        Action::Pulse(args) => return lines::pulse(args, &mut device, output),
        Action::Hold(args) => return lines::hold(args, &mut device, output),
        Action::Probe(args) => return probe::probe(args, &mut device, output),
        Action::Selftest(args) => return probe::selftest(args, &mut device, output),
        Action::Update(_) => unreachable!("it opens the port by itself"),
        Action::Status => device.status()?,
        Action::Stop => {
            device.stop()?;
            settle(&mut device)?
        }
        Action::Abort => device.abort()?,
    };
    let clock_hz = device.info().clock_hz;
    output.print(&status_value(&status, clock_hz), || {
        table(&status_lines(&status, clock_hz))
    })
}

fn info(device: &mut TriggerBox, output: &Output) -> Done {
    let unit = device.unit()?;
    let keeps = device.protocol() >= 5;
    let stored = if keeps { device.stored()? } else { None };
    let info = device.info();
    let (major, minor, patch) = info.firmware;
    let tick_ns = 1e9 / f64::from(info.clock_hz);
    let longest_s = info.longest_period.0 as f64 / f64::from(info.clock_hz);
    let value = json!({
        "port": device.link().peer(),
        "protocol": device.protocol(),
        "firmware": format!("{major}.{minor}.{patch}"),
        "clock_hz": info.clock_hz,
        "tick_ns": tick_ns,
        "max_steps": info.max_steps,
        "max_words": info.max_words,
        "shortest_pulse_ticks": info.shortest_free,
        "shortest_pulse_with_sync_ticks": info.shortest_sync,
        "longest_period_s": longest_s,
        "serial": unit.and_then(serial),
        "commit": unit.and_then(commit),
        "chip": unit.map(|unit| unit.chip.to_string()),
        "last_reset": unit.map(|unit| unit.reset.to_string()),
        "stored": stored.map(|stored| store::value(&stored)),
    });
    let shortest = |ticks: u32| format!("{ticks} ticks, {} ns", f64::from(ticks) * tick_ns);
    output.print(&value, || {
        let mut lines = unit_lines(unit, device.protocol());
        lines.extend([
            ("port", device.link().peer().to_owned()),
            (
                "firmware",
                format!("{major}.{minor}.{patch}, protocol {}", device.protocol()),
            ),
            ("clock", format!("{} MHz", f64::from(info.clock_hz) / 1e6)),
            ("tick", format!("{tick_ns} ns")),
            ("shortest pulse", shortest(info.shortest_free)),
            ("  paced by SYNC", shortest(info.shortest_sync)),
            ("longest step", format!("{longest_s} s")),
            (
                "table",
                format!("{} steps, {} words", info.max_steps, info.max_words),
            ),
        ]);
        if keeps {
            lines.push(("stored schedule", store::sentence(stored)));
        }
        table(&lines)
    })
}

/// Its serial number, if it has one that can be read.
fn serial(unit: Unit) -> Option<String> {
    (unit.serial != 0).then(|| format!("{:016x}", unit.serial))
}

/// What its firmware was built from, if that is known.
fn commit(unit: Unit) -> Option<String> {
    let modified = if unit.modified { " and changes" } else { "" };
    (unit.commit != 0).then(|| format!("{:08x}{modified}", unit.commit))
}

/// Which box it is, or what it lacks for saying so.
fn unit_lines(unit: Option<Unit>, protocol: u16) -> Vec<(&'static str, String)> {
    let mut lacks = Vec::new();
    if protocol < 2 {
        lacks.push(
            "has no serial number, tells no noise on its inputs from a defect, may take a SYNC edge at the end of a step for another",
        );
    }
    if protocol < 3 {
        lacks.push(
            "does not tell what stands at its inputs, goes to no boot loader by itself, keeps no polarity",
        );
    }
    if protocol < 4 {
        lacks.push("has no lines AUX-A, AUX-B, PHOTO and START, repeats no runs");
    }
    if protocol < 5 {
        lacks.push("keeps no schedule to run without a computer");
    }
    let mut lines = Vec::new();
    if !lacks.is_empty() {
        let lacks = lacks.join(", ");
        let older =
            format!("its firmware is older than this program: it {lacks}; flash this program's firmware");
        lines.push(("older", older));
    }
    let Some(unit) = unit else { return lines };
    let unknown = || "unknown".to_owned();
    lines.extend([
        ("serial number", serial(unit).unwrap_or_else(unknown)),
        ("chip", unit.chip.to_string()),
        ("built from", commit(unit).unwrap_or_else(unknown)),
        ("last reset by", unit.reset.to_string()),
    ]);
    lines
}

fn status_value(status: &Status, clock_hz: u32) -> Value {
    let counters = &status.counters;
    json!({
        "state": status.state.to_string(),
        "run": status.run,
        "steps_done": status.steps_done,
        "fault": status.fault.map(|fault| fault.to_string()),
        "uptime_s": status.now.0 as f64 / f64::from(clock_hz),
        "counters": {
            "frames": counters.frames,
            "corrupt": counters.corrupt,
            "repeated": counters.repeated,
            "stale": counters.stale,
            "executed": counters.executed,
            "records_lost": counters.records_lost,
            "spurious_strobes": counters.spurious_strobes,
        },
    })
}

fn status_lines(status: &Status, clock_hz: u32) -> Vec<(&'static str, String)> {
    let counters = &status.counters;
    let fault = status.fault.map_or(String::new(), |fault| format!(": {fault}"));
    vec![
        ("state", format!("{}{fault}", status.state)),
        ("run", format!("{}, {} steps done", status.run, status.steps_done)),
        (
            "switched on for",
            format!("{:.3} s", status.now.0 as f64 / f64::from(clock_hz)),
        ),
        (
            "requests",
            format!("{} frames, {} executed", counters.frames, counters.executed),
        ),
        (
            "  not executed",
            format!(
                "{} repeated, {} stale, {} corrupt",
                counters.repeated, counters.stale, counters.corrupt
            ),
        ),
        ("records lost", counters.records_lost.to_string()),
        ("spurious strobes", counters.spurious_strobes.to_string()),
    ]
}

/// Waits for the end of the run.
fn settle(device: &mut TriggerBox) -> Result<Status, Failure> {
    loop {
        let status = device.status()?;
        if !matches!(status.state, State::Armed | State::Running) {
            return Ok(status);
        }
        device.next_event(Duration::from_millis(50))?;
    }
}
