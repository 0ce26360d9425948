//! Schedules that are streamed while they play.

use std::time::Duration;

use rcg::capture::device::DeviceError;
use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::figures::Limit;
use rcg_protocol::{Event, Fault, Program, STEPS_PER_APPEND, State, Step, StepId};

use crate::runs::{Heard, Result, check_edges, fire, follow, free_run_at_first_edge, take_edges};
use crate::steps::{plain, random, solid, stream};

crate::trials!("stream":
    more_steps_than_a_table_holds [],
    sustained_20_khz [FastLink],
    a_host_that_stalls_ends_the_run [],
    stalls_at_any_step [Edges],
);

const PATIENCE: Duration = Duration::from_secs(2);

/// Streams `steps` as the host's command does.
fn play(bench: &mut Bench, program: &Program, steps: &[Step]) -> Result<Heard> {
    let mut heard = Heard::default();
    take_edges(bench);
    let ending = bench.device.stream(program, steps.iter().copied(), |event| {
        if let Some(Event::Records { records, .. }) = event {
            heard.records.extend(records.iter().copied());
        }
        Ok::<(), DeviceError>(())
    })?;
    heard.ending = Some(ending);
    Ok(heard)
}

/// 8,192 steps, twice what a table holds: the length of a stream is not limited.
fn more_steps_than_a_table_holds(bench: &mut Bench) -> Outcome {
    let steps = random(8_192, u64::from(bench.device.info().clock_hz / 4_000), 8);
    let heard = play(bench, &stream(), &steps)?;
    heard.expect(State::Done, None, steps.len() as u64)?;
    bench.figure("steps streamed", steps.len(), "steps", Limit::AtLeast(8_192.0))?;
    check_edges(bench, &stream(), steps, &take_edges(bench))
}

/// 20,000 steps a second, for a second, of which the controller can hold a fifth.
fn sustained_20_khz(bench: &mut Bench) -> Outcome {
    let period = u64::from(bench.device.info().clock_hz / 20_000);
    let steps = vec![plain(period); 20_000];
    let heard = play(bench, &stream(), &steps)?;
    heard.expect(State::Done, None, steps.len() as u64)?;
    check_edges(bench, &stream(), steps, &take_edges(bench))?;
    bench.figure(
        "sustained period of a stream",
        50_usize,
        "µs",
        Limit::AtMost(50.0),
    )
}

/// Appends `count` steps, fires, and falls silent, maybe in mid-frame.
fn stall(bench: &mut Bench, step: Step, count: u64, mid_frame: bool) -> Result<Heard> {
    bench.device.begin(&stream())?;
    let steps = vec![step; count as usize];
    for (batch, chunk) in steps.chunks(STEPS_PER_APPEND).enumerate() {
        bench
            .device
            .append((batch * STEPS_PER_APPEND) as u64, chunk, false)?;
    }
    let run = fire(bench)?;
    if mid_frame {
        let append = bench
            .device
            .link()
            .sent()
            .iter()
            .rev()
            .max_by_key(|frame| frame.len());
        let half = append
            .map(|frame| frame[..frame.len() / 2].to_vec())
            .unwrap_or_default();
        rcg::capture::link::Link::send(bench.device.link_mut(), &half)?;
    }
    let heard = follow(bench, run, PATIENCE)?;
    bench.silence(Duration::from_millis(5))?;
    Ok(heard)
}

fn a_host_that_stalls_ends_the_run(bench: &mut Bench) -> Outcome {
    let step = plain(u64::from(bench.device.info().clock_hz / 2_000));
    let heard = stall(bench, step, 500, false)?;
    let fault = Fault::Underrun { step: StepId(500) };
    heard.expect(State::Fault, Some(fault), 500)?;
    bench.figure(
        "whole steps before the underrun",
        heard.ending()?.steps_done,
        "steps",
        Limit::Exactly(500.0),
    )?;
    check_edges(bench, &stream(), vec![step; 500], &take_edges(bench))
}

/// Whichever step the stream runs dry at: it is named, and no pulse is cut or added.
fn stalls_at_any_step(bench: &mut Bench) -> Outcome {
    let per_us = u64::from(bench.device.info().clock_hz / 1_000_000);
    let mut stalls = 0_u64;
    for period in [per_us * 20, per_us * 137, per_us * 2_500] {
        for count in [1, 2, 3, 7, 8, 9, 24] {
            let step = solid(period, 3);
            let heard = stall(bench, step, count, stalls % 2 == 1)?;
            let fault = Fault::Underrun { step: StepId(count) };
            heard.expect(State::Fault, Some(fault), count)?;
            let edges = take_edges(bench);
            let expected = free_run_at_first_edge(&stream(), vec![step; count as usize], &edges);
            let jitter = rcg_hil::trace::compare(&expected, &edges)?.jitter;
            if jitter > 0 {
                return Err(format!("{count} steps of {period} ticks: jitter of {jitter} ticks").into());
            }
            stalls += 1;
        }
    }
    bench.figure(
        "stalls that ended between steps",
        stalls,
        "runs",
        Limit::Exactly(21.0),
    )
}
