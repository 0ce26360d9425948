//! Playing a schedule: what the host hears, and what the wires show.

use std::time::Duration;

use rcg::capture::follow::Ending;
use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::emulator::{Stats, StrobeModel};
use rcg_hil::figures::Limit;
use rcg_hil::trace::{self, Edge};
use rcg_protocol::{Event, Fault, Line, Program, RunId, State, Step, StepFlags, StepId, StepRecord, Ticks};

pub(crate) type Result<T> = std::result::Result<T, libtest_mimic::Failed>;

/// What the host heard of a run.
#[derive(Debug, Default)]
pub(crate) struct Heard {
    pub(crate) records: Vec<StepRecord>,
    pub(crate) spurious: Vec<Ticks>,
    pub(crate) ending: Option<Ending>,
    pub(crate) pings: u32,
}

impl Heard {
    fn take(&mut self, run: RunId, event: Event) {
        match event {
            Event::Records { run: of, records } if of == run => self.records.extend(records),
            Event::SpuriousStrobe { run: of, on } if of == run => self.spurious.push(on),
            Event::Ended {
                run: of,
                state,
                fault,
                steps_done,
                at,
            } if of == run => {
                self.ending = Some(Ending {
                    state,
                    fault,
                    steps_done,
                    at: Some(at),
                });
            }
            _ => {}
        }
    }

    /// The end of the run, which must have been heard of.
    pub(crate) fn ending(&self) -> Result<Ending> {
        self.ending
            .ok_or_else(|| "the end of the run was not heard of".into())
    }

    /// Fails unless the run ended as `state`, for the reason `fault`, after `steps` whole steps.
    pub(crate) fn expect(&self, state: State, fault: Option<Fault>, steps: u64) -> Outcome {
        let ending = self.ending()?;
        if (ending.state, ending.fault, ending.steps_done) == (state, fault, steps) {
            return Ok(());
        }
        Err(format!("expected {state} ({fault:?}) after {steps} steps, found {ending:?}").into())
    }

    /// Steps whose records carry all of `flags`.
    pub(crate) fn flagged(&self, flags: StepFlags) -> Vec<u64> {
        let flagged = self.records.iter().filter(|record| record.flags.contains(flags));
        flagged.map(|record| record.step.0).collect()
    }
}

/// Lets STROBE follow CAM as a wire between them would do; on a board that is a wire.
pub(crate) fn wire_strobe(bench: &Bench) -> Outcome {
    if let Some(pico) = bench.emulated() {
        pico.lock().emulator.strobe(&StrobeModel::default())?;
    }
    Ok(())
}

/// Primes and fires what is loaded; forgets the edges up to now.
pub(crate) fn fire(bench: &mut Bench) -> Result<RunId> {
    let run = bench.device.arm()?;
    take_edges(bench);
    bench.device.start()?;
    Ok(run)
}

/// The edges since the last look; none on a board.
pub(crate) fn take_edges(bench: &Bench) -> Vec<Edge> {
    bench
        .emulated()
        .map(|pico| pico.lock().take_edges())
        .unwrap_or_default()
}

/// Takes what was heard so far into `heard`, without waiting.
pub(crate) fn listen(bench: &mut Bench, run: RunId, heard: &mut Heard) -> Outcome {
    while let Some(event) = bench.device.next_event(Duration::ZERO)? {
        heard.take(run, event);
    }
    Ok(())
}

/// Follows `run` to its end while pinging as fast as answers come.
pub(crate) fn follow_pinging(bench: &mut Bench, run: RunId) -> Result<Heard> {
    let mut heard = Heard::default();
    while heard.ending.is_none() {
        bench.device.ping(heard.pings)?;
        heard.pings += 1;
        listen(bench, run, &mut heard)?;
        if heard.pings.is_multiple_of(256) {
            ensure_running(bench, heard.ending)?;
        }
    }
    Ok(heard)
}

/// Follows `run` to its end; the host only listens, for up to `longest`.
pub(crate) fn follow(bench: &mut Bench, run: RunId, longest: Duration) -> Result<Heard> {
    let mut heard = Heard::default();
    while heard.ending.is_none() {
        let Some(event) = bench.device.next_event(longest)? else {
            return Err(format!("nothing was heard of the run for {longest:?}").into());
        };
        heard.take(run, event);
    }
    Ok(heard)
}

/// Fails if the run is over although its end was not heard of.
fn ensure_running(bench: &mut Bench, ending: Option<Ending>) -> Outcome {
    let status = bench.device.status()?;
    let over = !matches!(status.state, State::Armed | State::Running);
    if over && ending.is_none() {
        let late = bench.device.next_event(Duration::from_millis(50))?;
        if late.is_none() {
            return Err(format!("the run is over ({status:?}) but no event said so").into());
        }
    }
    Ok(())
}

/// Totals of the emulator; none on a board. The longest time with interrupts masked counts from now on.
pub(crate) fn stats(bench: &Bench) -> Result<Option<Stats>> {
    let stats = bench.emulated().map(|pico| pico.lock().emulator.stats());
    Ok(stats.transpose()?)
}

/// The longest that interrupts may be masked: as long as the UART's FIFO takes to fill its second half.
const MASKED_US: f64 = 170.0;

/// Holds the CPU against its limits since `before`: it reads nothing of flash, masks no interrupts for long, and the UART loses
/// no byte.
pub(crate) fn check_cpu(bench: &Bench, before: Option<Stats>) -> Outcome {
    let (Some(before), Some(after)) = (before, stats(bench)?) else {
        return Ok(());
    };
    let masked_us = after.longest_masked as f64 * 1e6 / f64::from(after.clock_hz);
    let reads = after.flash_reads - before.flash_reads;
    let overruns = after.uart_overruns - before.uart_overruns;
    bench.figure("reads of flash", reads, "reads", Limit::Exactly(0.0))?;
    bench.figure("interrupts masked for", masked_us, "µs", Limit::AtMost(MASKED_US))?;
    bench.figure("bytes that the UART lost", overruns, "bytes", Limit::Exactly(0.0))
}

/// A table of `steps`, loaded.
pub(crate) fn load(bench: &mut Bench, program: &Program, steps: &[Step]) -> Outcome {
    bench.device.load(program, steps)?;
    Ok(())
}

/// Holds `edges` against a free run of `steps`. The first edge says when the run began; all others have to fit.
/// Prints the figures of it. On a board there is nothing to compare.
pub(crate) fn check_edges(
    bench: &Bench,
    program: &Program,
    steps: impl IntoIterator<Item = Step>,
    edges: &[Edge],
) -> Outcome {
    if bench.emulated().is_none() {
        return Ok(());
    }
    let expected = free_run_at_first_edge(program, steps, edges);
    let comparison = trace::compare(&expected, edges)?;
    bench.figure(
        "edges on their tick",
        comparison.edges,
        "edges",
        Limit::Exactly(expected.len() as f64),
    )?;
    bench.figure("jitter", comparison.jitter, "ticks", Limit::Exactly(0.0))
}

/// The edges of a free run of `steps` whose first edge is the first of `edges`.
pub(crate) fn free_run_at_first_edge(
    program: &Program,
    steps: impl IntoIterator<Item = Step>,
    edges: &[Edge],
) -> Vec<Edge> {
    let mut expected = trace::schedule(program.polarity, trace::free_run(0, steps));
    let found = trace::outputs(edges).first().map_or(0, |edge| edge.at);
    let shift = found.wrapping_sub(expected.first().map_or(0, |edge| edge.at));
    for edge in &mut expected {
        edge.at = edge.at.wrapping_add(shift);
    }
    expected
}

/// Holds records against the steps that were played, in order and without gaps: each step with a CAM pulse has one
/// strobe, as late and as long as a wire from CAM to STROBE makes it. Prints how many were paired.
///
/// A wire takes 0 ticks in the emulator and up to 3 on a board; time-stamps are up to one tick late.
pub(crate) fn check_pairing(
    bench: &Bench,
    steps: impl IntoIterator<Item = Step>,
    records: &[StepRecord],
) -> Outcome {
    let mut begins = Ticks::ZERO;
    let (mut paired, mut fired) = (0_u64, 0_u64);
    let mut delays = (u64::MAX, 0);
    let mut records = records.iter();
    for (index, step) in steps.into_iter().enumerate() {
        let record = records
            .next()
            .ok_or_else(|| format!("no record of step {index}"))?;
        let cam = !step.cam.is_none();
        let trigger = begins + step.cam.at;
        let right = match record.strobe {
            _ if record.step != StepId(index as u64) || record.trigger != trigger => false,
            Some(strobe) if cam && record.flags == StepFlags::default() => {
                delays = (delays.0.min(strobe.delay.0), delays.1.max(strobe.delay.0));
                paired += 1;
                strobe.delay <= Ticks(4) && strobe.width.0.abs_diff(step.cam.width.0) <= 1
            }
            None => !cam && record.flags == StepFlags::NO_TRIGGER,
            Some(_) => false,
        };
        if !right {
            return Err(format!("step {index}: {step:?} at {begins:?} has the record {record:?}").into());
        }
        fired += u64::from(cam);
        begins += step.period;
    }
    if let Some(record) = records.next() {
        return Err(format!("a record too many: {record:?}").into());
    }
    bench.figure("strobes paired", paired, "strobes", Limit::Exactly(fired as f64))?;
    let spread = delays.1.saturating_sub(delays.0);
    bench.figure("spread of strobe delays", spread, "ticks", Limit::AtMost(1.0))
}

/// Ticks from the rising edges of `from` to those of PROJ that follow them, the least and the most.
pub(crate) fn latencies(edges: &[Edge], from: Line) -> (u64, u64) {
    let mut last = None;
    let mut bounds = (u64::MAX, 0);
    for edge in edges.iter().filter(|edge| edge.high) {
        if edge.line == from {
            last = Some(edge.at);
        } else if edge.line == Line::Proj
            && let Some(last) = last
        {
            let latency = edge.at - last;
            bounds = (bounds.0.min(latency), bounds.1.max(latency));
        }
    }
    bounds
}
