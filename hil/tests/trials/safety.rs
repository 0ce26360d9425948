//! Whatever happens, both outputs come to rest, in time, and the host is told exactly how far the run got.

use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg::capture::device::DeviceError;
use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::figures::Limit;
use rcg_hil::image::Image;
use rcg_hil::trace::{self, Edge};
use rcg_protocol::{Aux, AuxPulse, Extent, Fault, Micros, Program, Pulse, Reset, State, Step, Ticks};

use crate::runs::{Result, check_edges, fire, follow, free_run_at_first_edge, load, take_edges};
use crate::steps::{plain, solid, table};

crate::trials!("safety":
    abort_brings_outputs_to_rest [Edges],
    stop_ends_between_steps [],
    steps_done_are_exact [],
    silence_ends_the_run [],
    waiting_is_no_silence [Edges],
    dead_man_is_in_time [Edges],
    pulled_cable [Cable],
    usb_that_hangs [Cable],
    a_host_that_suspends [Cable],
    panic [Memory],
    hard_fault [Memory],
    watchdog_bite [Memory],
    outputs_rest_at_boot [Edges],
);

/// Times that a run is cut, at any phase of a step.
const CUTS: u64 = 40;

/// Steps of 0.4 ms that are high but for their last 3 ticks, for a minute.
fn endless(bench: &Bench) -> (Program, Step) {
    let step = solid(u64::from(bench.device.info().clock_hz / 2_500), 3);
    (table(&[step], 150_000), step)
}

/// Microseconds that `ticks` are.
fn micros(bench: &Bench, ticks: u64) -> f64 {
    ticks as f64 * 1e6 / f64::from(bench.device.info().clock_hz)
}

/// Fails unless both outputs are low and stay low for a while.
fn ensure_low(bench: &mut Bench) -> Outcome {
    bench.silence(Duration::from_millis(20))?;
    let later = trace::outputs(&take_edges(bench));
    let levels = bench.pico().lock().emulator.outputs()?;
    if levels == [false; 4] && later.is_empty() {
        return Ok(());
    }
    Err(format!("expected both outputs low, found {levels:?} and the edges {later:?}").into())
}

/// Where `edges`, a free run of `step`, were cut, and the steps that were whole by then.
fn cut(program: &Program, step: Step, edges: &[Edge]) -> Result<(trace::Cut, u64)> {
    let span = edges.last().map_or(0, |last| last.at - edges[0].at);
    let steps = vec![step; (span / step.period.0) as usize + 2];
    let expected = free_run_at_first_edge(program, steps, edges);
    let cut = trace::cut(&expected, edges)?;
    let start = edges.first().ok_or("the run has no edges")?.at;
    Ok((cut, (cut.first - start) / step.period.0))
}

fn abort_brings_outputs_to_rest(bench: &mut Bench) -> Outcome {
    let (program, step) = endless(bench);
    load(bench, &program, &[step])?;
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
    let mut worst = 0;
    for _ in 0..CUTS {
        fire(bench)?;
        bench.silence(Duration::from_micros(rng.random_range(500..6_000)))?;
        let status = bench.device.abort()?;
        let arrived = bench.pico().lock().arrives();
        bench.silence(Duration::from_millis(3))?;
        let edges = trace::outputs(&take_edges(bench));
        let (cut, whole) = cut(&program, step, &edges)?;
        worst = worst.max(cut.last.saturating_sub(arrived));
        if (status.state, status.steps_done) != (State::Aborted, whole) {
            return Err(format!("expected to be aborted after {whole} steps, found {status:?}").into());
        }
        ensure_low(bench)?;
    }
    bench.figure(
        "aborts, each with its exact number of steps",
        CUTS,
        "aborts",
        Limit::Reported,
    )?;
    bench.figure(
        "last byte of abort to outputs low",
        micros(bench, worst),
        "µs",
        Limit::AtMost(1_000.0),
    )
}

fn stop_ends_between_steps(bench: &mut Bench) -> Outcome {
    let (program, step) = endless(bench);
    load(bench, &program, &[step])?;
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(4);
    let mut longest = 0;
    for _ in 0..CUTS {
        let run = fire(bench)?;
        bench.silence(Duration::from_micros(rng.random_range(500..6_000)))?;
        let done = bench.device.stop()?.steps_done;
        let ending = follow(bench, run, Duration::from_secs(1))?.ending()?;
        if ending.state != State::Stopped || ending.at != Some(Ticks(ending.steps_done * step.period.0)) {
            return Err(format!("expected to be stopped between steps, found {ending:?}").into());
        }
        longest = longest.max(ending.steps_done - done);
        if bench.emulated().is_some() {
            let edges = take_edges(bench);
            let steps = vec![step; ending.steps_done as usize];
            let expected = free_run_at_first_edge(&program, steps, &edges);
            if trace::compare(&expected, &edges)?.jitter > 0 {
                return Err("an edge before the stop is off its tick".into());
            }
        }
    }
    bench.figure(
        "stops, each with its exact number of steps",
        CUTS,
        "stops",
        Limit::Reported,
    )?;
    bench.figure(
        "steps of 0.4 ms played after a stop, at most",
        longest,
        "steps",
        Limit::AtMost(5.0),
    )
}

/// As the host sees it, on any device: what a run says that it did is what it did.
fn steps_done_are_exact(bench: &mut Bench) -> Outcome {
    let step = plain(u64::from(bench.device.info().clock_hz / 1_000));
    let program = table(&[step], 250);
    load(bench, &program, &[step])?;
    let run = fire(bench)?;
    let heard = follow(bench, run, Duration::from_secs(2))?;
    heard.expect(State::Done, None, 250)?;
    if bench.device.abort()?.steps_done != 250 {
        return Err("an abort after the end changed the number of steps".into());
    }
    bench.figure(
        "steps done",
        heard.ending()?.steps_done,
        "steps",
        Limit::Exactly(250.0),
    )?;
    check_edges(bench, &program, vec![step; 250], &take_edges(bench))
}

const DEAD_MAN: Duration = Duration::from_millis(50);

/// [`endless`] with a dead-man switch.
fn watched(bench: &Bench) -> (Program, Step) {
    let (program, step) = endless(bench);
    let dead_man = Micros(DEAD_MAN.as_micros() as u32);
    (Program { dead_man, ..program }, step)
}

/// Nothing more from the host: the run ends by itself. A host that talks keeps it alive.
fn silence_ends_the_run(bench: &mut Bench) -> Outcome {
    let (program, step) = watched(bench);
    load(bench, &program, &[step])?;
    fire(bench)?;
    for number in 0..10 {
        bench.silence(DEAD_MAN * 4 / 5)?;
        bench.device.ping(number)?;
    }
    let alive = bench.device.status()?;
    if alive.state != State::Running {
        return Err(format!("the run ended although the host was heard: {alive:?}").into());
    }
    bench.silence(DEAD_MAN * 2)?;
    let status = bench.device.status()?;
    if (status.state, status.fault) == (State::Fault, Some(Fault::HostLost)) {
        return Ok(());
    }
    Err(format!("expected the host to be lost, found {status:?}").into())
}

/// Steps that are many times as long as the dead-man time, with a host that does nothing but wait for their end.
fn waiting_is_no_silence(bench: &mut Bench) -> Outcome {
    let (program, _) = watched(bench);
    let second = u64::from(bench.device.info().clock_hz);
    let step = Step {
        proj: Pulse::new(0, 1_000),
        cam: Pulse::new(1_000, second * 2),
        period: Ticks(second * 5 / 2),
    };
    let program = Program {
        extent: Extent::Table { steps: 1, cycles: 2 },
        ..program
    };
    let ending = bench
        .device
        .play(&program, &[step], |_| Ok::<(), DeviceError>(()))?;
    if (ending.state, ending.fault, ending.steps_done) != (State::Done, None, 2) {
        return Err(format!("expected two steps, found {ending:?}").into());
    }
    check_edges(bench, &program, [step; 2], &take_edges(bench))
}

fn dead_man_is_in_time(bench: &mut Bench) -> Outcome {
    let (program, step) = watched(bench);
    load(bench, &program, &[step])?;
    let mut bounds = (u64::MAX, 0);
    for k in 0..10 {
        fire(bench)?;
        bench.silence(Duration::from_micros(370 * k))?;
        bench.device.ping(0)?;
        let heard = bench.pico().lock().arrives();
        bench.silence(DEAD_MAN * 2)?;
        let edges = trace::outputs(&take_edges(bench));
        let (cut, whole) = cut(&program, step, &edges)?;
        bounds = (bounds.0.min(cut.first - heard), bounds.1.max(cut.last - heard));
        let status = bench.device.status()?;
        if (status.fault, status.steps_done) != (Some(Fault::HostLost), whole) {
            return Err(format!("expected the host lost after {whole} steps, found {status:?}").into());
        }
        ensure_low(bench)?;
    }
    let set = DEAD_MAN.as_secs_f64() * 1e6;
    bench.figure(
        "last byte to outputs low, dead-man",
        micros(bench, bounds.1),
        "µs",
        Limit::AtMost(set),
    )?;
    // Nor is the run ended when the host was heard of a little less than that time ago.
    bench.figure(
        "the earliest",
        micros(bench, bounds.0),
        "µs",
        Limit::AtLeast(set * 0.9),
    )
}

/// The cable is pulled in mid-run and put back: the run has ended, the box answers.
fn pulled_cable(bench: &mut Bench) -> Outcome {
    let (program, step) = watched(bench);
    load(bench, &program, &[step])?;
    fire(bench)?;
    bench.silence(Duration::from_millis(5))?;
    let heard = bench.pico().lock().arrives();
    bench.pico().lock().emulator.plug(false)?;
    bench.silence(DEAD_MAN * 2)?;
    let edges = trace::outputs(&take_edges(bench));
    let (cut, whole) = cut(&program, step, &edges)?;
    ensure_low(bench)?;
    bench.pico().lock().emulator.plug(true)?;
    bench.silence(Duration::from_millis(200))?;
    bench.device.open_session(2)?;
    let status = bench.device.status()?;
    if (status.fault, status.steps_done) != (Some(Fault::HostLost), whole) {
        return Err(format!("expected the host lost after {whole} steps, found {status:?}").into());
    }
    let set = DEAD_MAN.as_secs_f64() * 1e6;
    bench.figure(
        "last byte to outputs low, cable pulled",
        micros(bench, cut.last - heard),
        "µs",
        Limit::AtMost(set),
    )
}

/// The USB controller hangs in mid-run, and nothing says so: outputs low in time, then the port comes back by itself.
fn usb_that_hangs(bench: &mut Bench) -> Outcome {
    let (program, step) = watched(bench);
    load(bench, &program, &[step])?;
    fire(bench)?;
    bench.silence(Duration::from_millis(5))?;
    let heard = bench.pico().lock().arrives();
    bench.pico().lock().emulator.wedge()?;
    let since = bench.pico().lock().cycle();
    bench.silence(DEAD_MAN * 2)?;
    let (cut, _) = cut(&program, step, &trace::outputs(&take_edges(bench)))?;
    let set = DEAD_MAN.as_secs_f64() * 1e6;
    bench.figure(
        "last byte to outputs low, USB hangs",
        micros(bench, cut.last - heard),
        "µs",
        Limit::AtMost(set),
    )?;
    ensure_low(bench)?;
    while bench.pico().lock().resets().is_empty() && micros(bench, bench.pico().lock().cycle() - since) < 2e6
    {
        bench.silence(Duration::from_millis(10))?;
    }
    // What was sent before is lost; a port that is open again is asked anew.
    bench.silence(Duration::from_millis(300))?;
    bench.device.open_session(2)?;
    let back = micros(bench, bench.pico().lock().cycle() - since) / 1e6;
    bench.figure("USB hangs to port back", back, "s", Limit::AtMost(2.0))?;
    ensure_low(bench)?;
    let reset = bench.device.unit()?.map(|unit| unit.reset);
    if reset == Some(Reset::UsbStuck) {
        return Ok(());
    }
    Err(format!("expected a reset for USB, found {reset:?}").into())
}

/// The host's computer goes to sleep: a run ends by the dead-man switch, and the box waits for it to wake, however long.
fn a_host_that_suspends(bench: &mut Bench) -> Outcome {
    let (program, _) = watched(bench);
    let step = plain(u64::from(bench.device.info().clock_hz / 1_000));
    load(bench, &program, &[step])?;
    fire(bench)?;
    bench.silence(Duration::from_millis(5))?;
    bench.pico().lock().emulator.doze(true)?;
    bench.silence(Duration::from_secs(3))?;
    bench.pico().lock().emulator.doze(false)?;
    bench.silence(Duration::from_millis(20))?;
    // The session is the same: nothing was lost but the run.
    let status = bench.device.status()?;
    let resets = bench.pico().lock().resets().len();
    bench.figure(
        "resets while the host sleeps",
        resets,
        "resets",
        Limit::Exactly(0.0),
    )?;
    if status.fault == Some(Fault::HostLost) {
        return Ok(());
    }
    Err(format!("expected the host lost, found {status:?}").into())
}

/// A long step with all outputs high, for the CPU to fail in.
fn hold_high(bench: &mut Bench) -> Outcome {
    let step = solid(u64::from(bench.device.info().clock_hz) * 3, 1_000);
    bench.device.aux(&Aux {
        a: AuxPulse::InStep(step.proj),
        b: AuxPulse::WithCam {
            after: Ticks::ZERO,
            width: Ticks::ZERO,
        },
        ..Aux::default()
    })?;
    load(bench, &table(&[step], 2), &[step])?;
    fire(bench)?;
    bench.silence(Duration::from_millis(5))?;
    if bench.pico().lock().emulator.outputs()? == [true; 4] {
        take_edges(bench);
        Ok(())
    } else {
        Err("the outputs are not high".into())
    }
}

/// RAM that the firmware does not use: the first scratch bank.
const SPARE_RAM: u32 = 0x2004_0000;

/// Sends the CPU elsewhere while both outputs are high. They have to fall within `limit_us` and stay low through the
/// reset that follows; then the box is idle and answers.
fn fails(bench: &mut Bench, address: u32, masked: bool, limit_us: f64) -> Outcome {
    hold_high(bench)?;
    let before = bench.device.status()?.run;
    let failed = {
        let mut pico = bench.pico().lock();
        pico.emulator.jump(address, SPARE_RAM, masked)?;
        pico.cycle()
    };
    bench.silence(Duration::from_millis(700))?;
    let edges = trace::outputs(&take_edges(bench));
    let falls: Vec<u64> = edges.iter().map(|edge| edge.at).collect();
    if edges.len() != 4 || edges.iter().any(|edge| edge.high) {
        return Err(format!("expected all outputs to fall once, found {edges:?}").into());
    }
    let resets = bench.pico().lock().resets().to_vec();
    bench.figure("resets", resets.len(), "resets", Limit::Exactly(1.0))?;
    let low = micros(bench, falls[3] - failed);
    bench.figure("failure to outputs low", low, "µs", Limit::AtMost(limit_us))?;
    bench.silence(Duration::from_millis(100))?;
    bench.device.open_session(2)?;
    let status = bench.device.status()?;
    if (status.state, status.run) != (State::Idle, 0) || before == 0 {
        return Err(format!("expected an idle box without a run, found {status:?}").into());
    }
    ensure_low(bench)
}

/// A panic, with the place in the source that a real one would name.
fn panic(bench: &mut Bench) -> Outcome {
    let image = image(bench)?;
    // It takes nothing but the address of a `core::panic::Location`: file name (address and length), line, column.
    let function = image.function("panic_const_async_fn_resumed");
    let address = function.ok_or("the image has no function that panics with a place only")?;
    let mut location = Vec::new();
    for word in [SPARE_RAM + 16, 8, 42, 7] {
        location.extend(word.to_le_bytes());
    }
    location.extend(b"trial.rs");
    bench.pico().lock().emulator.write(SPARE_RAM, &location)?;
    fails(bench, address | 1, false, 1_000.0)
}

/// A jump to where there is no memory.
fn hard_fault(bench: &mut Bench) -> Outcome {
    fails(bench, 0xf000_0001, false, 1_000.0)
}

/// An endless loop with interrupts masked: the watchdog, set to half a second, resets the chip.
fn watchdog_bite(bench: &mut Bench) -> Outcome {
    const BRANCH_TO_ITSELF: [u8; 2] = 0xe7fe_u16.to_le_bytes();
    bench.pico().lock().emulator.write(SPARE_RAM, &BRANCH_TO_ITSELF)?;
    fails(bench, SPARE_RAM | 1, true, 500_000.0)
}

fn image(bench: &Bench) -> Result<Image> {
    Ok(Image::read(&bench.image().ok_or("a board has no image")?)?)
}

/// From power-up on, until the first run, no output moves.
fn outputs_rest_at_boot(bench: &mut Bench) -> Outcome {
    bench.silence(Duration::from_millis(100))?;
    let edges = trace::outputs(&take_edges(bench));
    let levels = bench.pico().lock().emulator.outputs()?;
    if levels != [false; 4] {
        return Err(format!("expected all outputs low, found {levels:?}").into());
    }
    bench.figure(
        "edges from power-up on",
        edges.len(),
        "edges",
        Limit::Exactly(0.0),
    )
}
