//! `rcg controller`

use std::time::{Duration, Instant};

use rcg::device::{Device, Patience};
use rcg::link::{self, Link};
use rcg::rig::Rig;
use rcg::schedule::Timing;
use rcg::virtual_rig::VirtualController;
use rcg_protocol::{Event, PROTOCOL_VERSION, State, Status, Step};
use serde_json::{Value, json};

use crate::Done;
use crate::failure::Failure;
use crate::output::Output;

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
    /// How things stand
    Status,
    /// Fire a schedule and wait for its end
    Run(RunArgs),
    /// End the run after the current step
    Stop,
    /// End the run at once
    Abort,
    /// Round trips per second
    Bench {
        /// How many
        #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
        count: u32,
    },
}

#[derive(Debug, clap::Args)]
struct RunArgs {
    /// Steps
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..))]
    steps: u32,
    /// Exposure time in milliseconds [default: the rig's]
    #[arg(long, value_name = "MS", allow_negative_numbers = true)]
    exposure_ms: Option<f64>,
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let rig = Rig::load(rig)?;
    let link: Box<dyn Link> = if args.port == "sim" {
        Box::new(VirtualController::alone(&rig))
    } else {
        link::open(&args.port)?
    };
    let mut device = Device::connect(link, link::nonce(), Patience::default())?;
    match &args.action {
        Action::Info => info(&device, output),
        Action::Status => {
            let status = device.status()?;
            print_status(&status, device.info().clock_hz, output)
        }
        Action::Run(run) => fire(run, &rig, &mut device, output),
        Action::Stop => {
            device.stop()?;
            let status = settle(&mut device)?;
            print_status(&status, device.info().clock_hz, output)
        }
        Action::Abort => {
            let status = device.abort()?;
            print_status(&status, device.info().clock_hz, output)
        }
        Action::Bench { count } => bench(*count, &mut device, output),
    }
}

fn info(device: &Device<Box<dyn Link>>, output: &Output) -> Done {
    let info = device.info();
    let (major, minor, patch) = info.firmware;
    let shortest_ns = f64::from(info.shortest_free) * 1e9 / f64::from(info.clock_hz);
    let longest_s = info.longest_period.0 as f64 / f64::from(info.clock_hz);
    let value = json!({
        "port": device.link().peer(),
        "protocol": PROTOCOL_VERSION,
        "firmware": format!("{major}.{minor}.{patch}"),
        "clock_hz": info.clock_hz,
        "tick_ns": 1e9 / f64::from(info.clock_hz),
        "max_steps": info.max_steps,
        "max_words": info.max_words,
        "shortest_pulse_ticks": info.shortest_free,
        "shortest_pulse_with_sync_ticks": info.shortest_sync,
        "longest_period_s": longest_s,
    });
    output.print(&value, || {
        format!(
            "port            {}\nfirmware        {major}.{minor}.{patch}, protocol {PROTOCOL_VERSION}\n\
             clock           {} Hz, {} ns a tick\nshortest pulse  {} ticks, {shortest_ns} ns\n\
             longest step    {longest_s} s\ntable           {} steps, {} words\n",
            device.link().peer(),
            info.clock_hz,
            1e9 / f64::from(info.clock_hz),
            info.shortest_free,
            info.max_steps,
            info.max_words
        )
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

fn print_status(status: &Status, clock_hz: u32, output: &Output) -> Done {
    output.print(&status_value(status, clock_hz), || {
        let fault = status.fault.map_or(String::new(), |fault| format!(" ({fault})"));
        let counters = &status.counters;
        format!(
            "state    {}{fault}\nrun      {}, {} steps done\nframes   {} executed, {} repeated, {} stale, {} corrupt\n\
             lost     {} records; {} spurious strobes\n",
            status.state,
            status.run,
            status.steps_done,
            counters.executed,
            counters.repeated,
            counters.stale,
            counters.corrupt,
            counters.records_lost,
            counters.spurious_strobes
        )
    })
}

/// Waits for the end of the run.
fn settle(device: &mut Device<Box<dyn Link>>) -> Result<Status, Failure> {
    loop {
        let status = device.status()?;
        if !matches!(status.state, State::Armed | State::Running) {
            return Ok(status);
        }
        device.next_event(Duration::from_millis(50))?;
    }
}

fn fire(args: &RunArgs, rig: &Rig, device: &mut Device<Box<dyn Link>>, output: &Output) -> Done {
    let exposure_s = args.exposure_ms.map_or(rig.camera.exposure_s, |ms| ms * 1e-3);
    let timing = Timing::new(rig, exposure_s).map_err(rcg::plan::PlanError::from)?;
    let info = device.info();
    let step: Step = timing.step(info.clock_hz);
    device.load(&Timing::program(args.steps), &[step])?;
    let run = device.arm()?;
    device.start()?;
    let (mut strobes, mut records) = (0_u64, 0_u64);
    let ending = device.follow(run, |event| -> Result<(), Failure> {
        if let Some(Event::Records { records: batch, .. }) = event {
            records += batch.len() as u64;
            strobes += batch.iter().filter(|record| record.strobe.is_some()).count() as u64;
        }
        Ok(())
    })?;
    let status = device.status()?;
    let duration_s = ending.at.map_or(0.0, |at| at.0 as f64 / f64::from(info.clock_hz));
    let mut value = status_value(&status, info.clock_hz);
    value["records"] = json!(records);
    value["strobes"] = json!(strobes);
    value["period_ticks"] = json!(step.period.0);
    value["duration_s"] = json!(duration_s);
    output.print(&value, || {
        let fault = status.fault.map_or(String::new(), |fault| format!(" ({fault})"));
        format!(
            "{}{fault} after {} steps of {} ticks, {:.6} s; {records} records, {strobes} strobes\n",
            status.state, status.steps_done, step.period.0, duration_s
        )
    })?;
    match status.fault {
        Some(fault) => Err(Failure::Failed(anyhow::anyhow!(
            "port {}: {fault}",
            device.link().peer()
        ))),
        None => Ok(()),
    }
}

fn bench(count: u32, device: &mut Device<Box<dyn Link>>, output: &Output) -> Done {
    let began = Instant::now();
    let mut slowest = Duration::ZERO;
    for number in 0..count {
        let sent = Instant::now();
        device.ping(number)?;
        slowest = slowest.max(sent.elapsed());
    }
    let elapsed_s = began.elapsed().as_secs_f64();
    let per_s = f64::from(count) / elapsed_s;
    let value = json!({
        "port": device.link().peer(), "round_trips": count, "per_s": per_s,
        "mean_us": elapsed_s * 1e6 / f64::from(count), "slowest_us": slowest.as_secs_f64() * 1e6,
    });
    output.print(&value, || {
        format!(
            "{count} round trips, {per_s:.0} per second, mean {:.1} µs, slowest {:.1} µs\n",
            elapsed_s * 1e6 / f64::from(count),
            slowest.as_secs_f64() * 1e6
        )
    })
}
