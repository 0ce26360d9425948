//! `rcg controller bench`

use std::time::{Duration, Instant};

use rcg::capture::device::Feed;
use rcg::capture::link::Link as _;
use rcg_protocol::{Extent, Program, Pulse, Step, Ticks};
use serde_json::json;

use super::TriggerBox;
use crate::Done;
use crate::output::{Output, table};

/// Round trips per second, and how fast steps can be streamed; forgets the loaded schedule.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// How many round trips
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    count: u32,
}

/// A stream that is loaded and never fired.
const PROGRAM: Program = Program::new(Extent::Stream);

/// 20,000 steps a second, as long on the wire as those that would be fired.
const STEP: Step = Step {
    proj: Pulse::new(0, 625),
    cam: Pulse::new(1000, 2500),
    period: Ticks(6250),
};

pub(super) fn run(args: &Args, device: &mut TriggerBox, output: &Output) -> Done {
    let count = args.count;
    let began = Instant::now();
    let mut slowest = Duration::ZERO;
    for number in 0..count {
        let sent = Instant::now();
        device.ping(number)?;
        slowest = slowest.max(sent.elapsed());
    }
    let elapsed_s = began.elapsed().as_secs_f64();
    let (per_s, mean_us) = (f64::from(count) / elapsed_s, elapsed_s * 1e6 / f64::from(count));

    // As many as the store holds, none of which is played.
    let room = device.begin(&PROGRAM)?;
    let began = Instant::now();
    let mut feed = Feed::new(std::iter::repeat(STEP), room);
    feed.fill(device)?;
    let steps_per_s = feed.confirmed() as f64 / began.elapsed().as_secs_f64();
    device.clear()?;

    let value = json!({
        "port": device.link().peer(), "round_trips": count, "per_s": per_s,
        "mean_us": mean_us, "slowest_us": slowest.as_secs_f64() * 1e6,
        "streamed_steps": feed.confirmed(), "streamed_steps_per_s": steps_per_s,
    });
    output.print(&value, || {
        let slowest_us = slowest.as_secs_f64() * 1e6;
        table(&[
            ("round trips", format!("{per_s:.0} per second, of {count}")),
            ("  each", format!("{mean_us:.1} µs, at most {slowest_us:.1} µs")),
            (
                "streaming",
                format!("{steps_per_s:.0} steps per second, of {}", feed.confirmed()),
            ),
        ])
    })
}
