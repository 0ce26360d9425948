//! The shortest and the longest that the pulse engine makes, and what it refuses.

use std::time::Duration;

use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::figures::Limit;
use rcg_hil::trace;
use rcg_protocol::{Fault, Line, Pulse, State, Step, Ticks};

use crate::runs::{check_cpu, check_edges, fire, follow, load, stats, take_edges};
use crate::steps::{in_part, solid, table};

crate::trials!("limits":
    shortest_pulse_and_resolution [Edges],
    too_close_is_refused [],
    shortest_period_of_a_table [Edges],
    long_steps_ending_with_a_pulse [Edges],
    longest_period [Edges],
    abort_of_a_long_burst [Edges],
);

/// How long a run may be silent.
const PATIENCE: Duration = Duration::from_secs(2);

/// Pulses of 3, 4, 5 … ticks that begin 3, 4, 5 … ticks into the step: each is as long as it should be.
fn shortest_pulse_and_resolution(bench: &mut Bench) -> Outcome {
    let info = bench.device.info();
    let width = |k: u64| 3 + k % 32;
    let step = |k: u64| {
        let proj = Pulse::new(0, width(k));
        let cam = Pulse::new(width(k), width(k / 32));
        Step {
            proj,
            cam,
            period: Ticks(2_000),
        }
    };
    let steps: Vec<Step> = (0..1024).map(step).collect();
    let program = table(&steps, 1);
    load(bench, &program, &steps)?;
    let run = fire(bench)?;
    follow(bench, run, PATIENCE)?.expect(State::Done, None, 1024)?;
    let edges = take_edges(bench);
    check_edges(bench, &program, steps, &edges)?;

    let mut widths: Vec<u64> = [Line::Proj, Line::Cam]
        .into_iter()
        .flat_map(|line| {
            let of_line: Vec<u64> = edges.iter().filter(|e| e.line == line).map(|e| e.at).collect();
            of_line
                .chunks(2)
                .map(|pulse| pulse[1] - pulse[0])
                .collect::<Vec<_>>()
        })
        .collect();
    widths.sort_unstable();
    widths.dedup();
    let resolution = widths
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .max()
        .unwrap_or(u64::MAX);
    let tick_ns = 1e9 / f64::from(info.clock_hz);
    bench.figure("shortest pulse", widths[0], "ticks", Limit::AtMost(3.0))?;
    bench.figure("resolution", resolution, "ticks", Limit::Exactly(1.0))?;
    bench.figure("one tick", tick_ns, "ns", Limit::AtMost(8.0))
}

/// Edges that the engine cannot make are refused by step, not made differently.
fn too_close_is_refused(bench: &mut Bench) -> Outcome {
    let shortest = bench.device.info().shortest_free;
    let good = Step {
        proj: Pulse::new(0, u64::from(shortest)),
        cam: Pulse::NONE,
        period: Ticks(1_000),
    };
    let bad = Step {
        proj: Pulse::new(0, u64::from(shortest) - 1),
        ..good
    };
    let steps = [good, good, bad];
    let refused = bench.device.load(&table(&steps, 1), &steps);
    let fault = refused.err().and_then(|error| error.fault());
    let expected = Fault::EdgesTooClose { step: 2, shortest };
    if fault != Some(expected) {
        return Err(format!("expected {expected:?}, found {fault:?}").into());
    }
    bench.figure(
        "shortest distance reported",
        shortest,
        "ticks",
        Limit::AtMost(3.0),
    )
}

/// Ever shorter steps from a table, each length for 0.1 s or a part of that, until one does not end well.
fn shortest_period_of_a_table(bench: &mut Bench) -> Outcome {
    let per_us = u64::from(bench.device.info().clock_hz / 1_000_000);
    let mut shortest = None;
    let mut failure = "none was tried".to_owned();
    for period in [
        per_us * 100,
        per_us * 20,
        per_us * 10,
        per_us * 5,
        per_us * 2,
        per_us,
    ] {
        let step = Step {
            proj: Pulse::new(0, period / 4),
            cam: Pulse::new(period / 2, period / 4),
            period: Ticks(period),
        };
        let count = in_part(per_us * 100_000) / period;
        let program = table(&[step], count);
        load(bench, &program, &[step])?;
        let run = fire(bench)?;
        let heard = follow(bench, run, PATIENCE)?;
        if let Err(failed) = heard.expect(State::Done, None, count) {
            failed.message().unwrap_or_default().clone_into(&mut failure);
            break;
        }
        let edges = take_edges(bench);
        let expected = crate::runs::free_run_at_first_edge(&program, vec![step; count as usize], &edges);
        if trace::compare(&expected, &edges)?.jitter > 0 {
            failure = format!("jitter at steps of {period} ticks");
            break;
        }
        shortest = Some(period);
    }
    let shortest_us = shortest.map_or(f64::INFINITY, |period| period as f64 / per_us as f64);
    bench
        .figure(
            "shortest sustained period, table",
            shortest_us,
            "µs",
            Limit::AtMost(1.0),
        )
        .map_err(|beyond| format!("{}; next: {failure}", beyond.message().unwrap_or_default()).into())
}

/// Steps of 10 ms, of two words each, the last one as short as can be: nothing is left to the engine to prefetch.
fn long_steps_ending_with_a_pulse(bench: &mut Bench) -> Outcome {
    let info = bench.device.info();
    let step = solid(u64::from(info.clock_hz / 100), u64::from(info.shortest_free));
    let program = table(&[step], 10);
    load(bench, &program, &[step])?;
    let run = fire(bench)?;
    follow(bench, run, PATIENCE)?.expect(State::Done, None, 10)?;
    check_edges(bench, &program, [step; 10], &take_edges(bench))
}

/// One step of a minute, or a part of that, exact to the tick.
fn longest_period(bench: &mut Bench) -> Outcome {
    let info = bench.device.info();
    let long_s = in_part(60);
    let long = u64::from(info.clock_hz) * long_s;
    let step = Step {
        proj: Pulse::new(0, long - 3),
        cam: Pulse::new(3, 1_000),
        period: Ticks(long),
    };
    let program = table(&[step], 2);
    load(bench, &program, &[step])?;
    let run = fire(bench)?;
    follow(bench, run, Duration::from_secs(121))?.expect(State::Done, None, 2)?;
    let edges = take_edges(bench);
    check_edges(bench, &program, [step; 2], &edges)?;
    let starts = trace::rises(&edges, Line::Proj);
    let period_s = (starts[1] - starts[0]) as f64 / f64::from(info.clock_hz);
    bench.figure(
        "longest period seen",
        period_s,
        "s",
        Limit::AtLeast(long_s as f64),
    )?;
    let longest_s = info.longest_period.0 as f64 / f64::from(info.clock_hz);
    bench.figure("longest period reported", longest_s, "s", Limit::AtLeast(60.0))
}

/// A burst of many different steps: to count how far it got takes a while, in which interrupts come all the same.
fn abort_of_a_long_burst(bench: &mut Bench) -> Outcome {
    let step = |k: u64| Step {
        proj: Pulse::new(0, 20),
        cam: Pulse::new(40, 60),
        period: Ticks(200 + k % 2),
    };
    let steps: Vec<Step> = (0..4_000).map(step).collect();
    let program = table(&steps, 1_000);
    load(bench, &program, &steps)?;
    let run = fire(bench)?;
    bench.silence(Duration::from_millis(10))?;
    let before = stats(bench)?;
    bench.device.abort()?;
    let ending = follow(bench, run, PATIENCE)?.ending()?;
    check_cpu(bench, before)?;
    let edges = trace::outputs(&take_edges(bench));
    let begun = trace::rises(&edges, Line::Proj).len() as u64;
    // The last one that began was cut, or was whole to the tick.
    let (first, last) = (edges[0].at, edges[edges.len() - 1].at);
    if !(begun - 1..=begun).contains(&ending.steps_done)
        || ending.at.is_none_or(|at| at.0.abs_diff(last - first) > 400)
    {
        return Err(format!("{begun} steps were begun, found {ending:?}").into());
    }
    bench.figure(
        "steps played, of 0.8 µs each",
        ending.steps_done,
        "steps",
        Limit::AtLeast(1_000.0),
    )
}
