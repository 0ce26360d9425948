//! `rcg controller`

mod bench;
mod run;

use std::time::Duration;

use rcg::capture::device::{Device, Patience};
use rcg::capture::link::{self, Link};
use rcg::instrument::rig::Rig;
use rcg::virtual_rig::VirtualController;
use rcg_protocol::{PROTOCOL_VERSION, State, Status};
use serde_json::{Value, json};

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table};

/// Talk to the trigger box.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    action: Action,
    /// Port of the trigger box (/dev/ttyACM0, COM3), auto for the only one on USB, or sim for the simulated one
    #[arg(long, global = true, default_value = "auto", value_name = "PORT")]
    port: String,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// What it is and can do
    Info,
    /// How things stand, and what was counted since it was switched on
    Status,
    Run(run::Args),
    /// End the run after the current step
    Stop,
    /// End the run at once
    Abort,
    Bench(bench::Args),
}

type TriggerBox = Device<Box<dyn Link>>;

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let rig = Rig::load(rig)?;
    let link: Box<dyn Link> = if args.port == "sim" {
        Box::new(VirtualController::alone(&rig))
    } else {
        link::open(&args.port)?
    };
    let mut device = Device::connect(link, link::nonce(), Patience::default())?;
    let status = match &args.action {
        Action::Info => return info(&device, output),
        Action::Run(args) => return run::run(args, &rig, &mut device, output),
        Action::Bench(args) => return bench::run(args, &mut device, output),
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

fn info(device: &TriggerBox, output: &Output) -> Done {
    let info = device.info();
    let (major, minor, patch) = info.firmware;
    let tick_ns = 1e9 / f64::from(info.clock_hz);
    let longest_s = info.longest_period.0 as f64 / f64::from(info.clock_hz);
    let value = json!({
        "port": device.link().peer(),
        "protocol": PROTOCOL_VERSION,
        "firmware": format!("{major}.{minor}.{patch}"),
        "clock_hz": info.clock_hz,
        "tick_ns": tick_ns,
        "max_steps": info.max_steps,
        "max_words": info.max_words,
        "shortest_pulse_ticks": info.shortest_free,
        "shortest_pulse_with_sync_ticks": info.shortest_sync,
        "longest_period_s": longest_s,
    });
    let shortest = |ticks: u32| format!("{ticks} ticks, {} ns", f64::from(ticks) * tick_ns);
    output.print(&value, || {
        table(&[
            ("port", device.link().peer().to_owned()),
            (
                "firmware",
                format!("{major}.{minor}.{patch}, protocol {PROTOCOL_VERSION}"),
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
        ])
    })
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
