//! Triggers that the camera ignores, and exposures that nobody asked for.

use rand::seq::index::sample;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg::capture::selftest::{Finding, Rest, Settings, selftest};
use rcg::capture::steps::{Output, Span};
use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::emulator::{StrobeModel, VsyncModel};
use rcg_hil::figures::Limit;
use rcg_hil::trace;
use rcg_protocol::{Fault, Line, Polarity, State, StepFlags, Ticks};

use crate::runs::{Heard, Result, fire, follow_pinging, load, take_edges};
use crate::steps::{in_part, plain, table};

crate::trials!("strobes":
    missed_triggers_are_named [Inputs],
    spurious_strobes_are_named [Inputs],
    noise_displaces_no_record [Inputs],
    fast_noise_is_named [Inputs],
    wires_are_tried [Inputs],
);

/// 1 % of the steps.
fn odd_steps() -> usize {
    steps() as usize / 100
}

fn steps() -> u64 {
    in_part(10_000)
}

/// Rate at which a UART carries all records.
const RATE_HZ: u32 = 4_000;

fn missed_triggers_are_named(bench: &mut Bench) -> Outcome {
    let period = u64::from(bench.device.info().clock_hz / RATE_HZ);
    let step = plain(period);
    load(bench, &table(&[step], steps()), &[step])?;
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
    let mut ignored: Vec<u64> = sample(&mut rng, steps() as usize, odd_steps())
        .iter()
        .map(|k| k as u64)
        .collect();
    ignored.sort_unstable();
    bench.pico().lock().emulator.strobe(&StrobeModel {
        delay: period / 100,
        ignore: ignored.clone(),
        ..StrobeModel::default()
    })?;
    let run = fire(bench)?;
    let heard = follow_pinging(bench, run)?;
    heard.expect(State::Done, None, steps())?;

    let named = heard.flagged(StepFlags::MISSED);
    let right = named
        .iter()
        .filter(|step| ignored.binary_search(step).is_ok())
        .count();
    bench.figure(
        "triggers ignored by the camera",
        ignored.len(),
        "steps",
        Limit::Reported,
    )?;
    bench.figure(
        "of them named",
        right,
        "steps",
        Limit::Exactly(odd_steps() as f64),
    )?;
    bench.figure("invented", named.len() - right, "steps", Limit::Exactly(0.0))?;
    bench.figure(
        "spurious strobes invented",
        heard.spurious.len(),
        "strobes",
        Limit::Exactly(0.0),
    )?;
    let paired = heard
        .records
        .iter()
        .filter(|r| r.strobe.is_some() && r.flags == StepFlags::default());
    bench.figure(
        "others paired",
        paired.count(),
        "strobes",
        Limit::Exactly((steps() as usize - odd_steps()) as f64),
    )
}

/// Additional exposures in the pause behind that of the step: the step is named, and the time.
fn spurious_strobes_are_named(bench: &mut Bench) -> Outcome {
    let period = u64::from(bench.device.info().clock_hz / RATE_HZ);
    let step = plain(period); // CAM rests from 0.7 of the step on
    load(bench, &table(&[step], steps()), &[step])?;
    let run = bench.device.arm()?;
    take_edges(bench);
    bench.device.start()?;
    // The run has begun; its first edge says when, so the rest can be planned.
    let first = loop {
        if let Some(&first) = trace::rises(&bench.pico().lock().take_edges(), Line::Proj).first() {
            break first;
        }
        bench.pico().lock().run(1_000)?;
    };
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(2);
    let mut odd: Vec<u64> = sample(&mut rng, steps() as usize - 200, odd_steps())
        .iter()
        .map(|k| k as u64 + 100)
        .collect();
    odd.sort_unstable();
    let extra: Vec<u64> = odd
        .iter()
        .map(|k| first + k * period + rng.random_range(period * 3 / 4..period * 9 / 10))
        .collect();
    bench.pico().lock().emulator.strobe(&StrobeModel {
        width: period / 20,
        extra: extra.clone(),
        ..StrobeModel::default()
    })?;
    let heard = follow_pinging(bench, run)?;
    heard.expect(State::Done, None, steps())?;

    let named = heard.flagged(StepFlags::DOUBLE);
    bench.figure("spurious strobes made", extra.len(), "strobes", Limit::Reported)?;
    let right = named
        .iter()
        .filter(|step| odd.binary_search(step).is_ok())
        .count();
    bench.figure(
        "of them named by step",
        right,
        "steps",
        Limit::Exactly(odd_steps() as f64),
    )?;
    bench.figure("invented", named.len() - right, "steps", Limit::Exactly(0.0))?;
    let timed = heard.spurious.iter().zip(&extra).filter(|(on, at)| {
        let late = first + on.0;
        (**at..=**at + 1).contains(&late)
    });
    bench.figure(
        "told with their time",
        timed.count(),
        "events",
        Limit::Exactly(odd_steps() as f64),
    )?;
    bench.figure(
        "events of them",
        heard.spurious.len(),
        "events",
        Limit::Exactly(odd_steps() as f64),
    )?;
    let counted = bench.device.status()?.counters.spurious_strobes;
    bench.figure("counted", counted, "strobes", Limit::Exactly(odd_steps() as f64))?;
    let missed = heard
        .flagged(StepFlags::MISSED)
        .into_iter()
        .filter(|&step| step >= 100);
    bench.figure("misses invented", missed.count(), "steps", Limit::Exactly(0.0))?;
    let wrong = heard
        .records
        .iter()
        .find(|r| r.trigger != Ticks(r.step.0 * period) + step.cam.at);
    wrong.map_or(Ok(()), |record| {
        Err(format!("a wrong trigger time: {record:?}").into())
    })
}

/// Steps of a millisecond, and noise on STROBE: `pulses` in each step from 0.75 of it on.
fn noisy(bench: &mut Bench, pulses: u64) -> Result<Heard> {
    const STEPS: u64 = 200;
    let period = u64::from(bench.device.info().clock_hz / 1_000);
    let step = plain(period);
    load(bench, &table(&[step], STEPS), &[step])?;
    let run = fire(bench)?;
    let now = bench.pico().lock().cycle();
    let noise =
        |step: u64| (0..pulses).map(move |k| now + step * period + period * 3 / 4 + k * period / 5 / pulses);
    bench.pico().lock().emulator.strobe(&StrobeModel {
        delay: period / 100,
        width: 200,
        extra: (2..STEPS - 2).flat_map(noise).collect(),
        ..StrobeModel::default()
    })?;
    follow_pinging(bench, run)
}

fn noise_displaces_no_record(bench: &mut Bench) -> Outcome {
    let before = bench.device.status()?.counters;
    let heard = noisy(bench, 40)?;
    heard.expect(State::Done, None, 200)?;
    let after = bench.device.status()?.counters;
    bench.figure("records", heard.records.len(), "records", Limit::Exactly(200.0))?;
    let noise = after.spurious_strobes - before.spurious_strobes;
    bench.figure(
        "spurious strobes counted",
        noise,
        "strobes",
        // Some fall into the exposure, and are none by themselves.
        Limit::AtLeast(38.0 * 196.0),
    )?;
    bench.figure(
        "of them told one by one",
        heard.spurious.len(),
        "events",
        Limit::AtMost(120.0),
    )
}

fn fast_noise_is_named(bench: &mut Bench) -> Outcome {
    let heard = noisy(bench, 150)?;
    let fault = heard.ending()?.fault;
    if fault == Some(Fault::InputTooFast { line: Line::Strobe }) {
        return Ok(());
    }
    Err(format!("expected STROBE to be too fast, found {fault:?}").into())
}

/// SYNC is open, held high, and has the vsync of a projector that runs freely; STROBE answers CAM, later and for as long.
fn wires_are_tried(bench: &mut Bench) -> Outcome {
    const LATE: u64 = 1_001;
    let settings = Settings {
        polarity: Polarity::default(),
        width: Span::Ticks(25_000),
        period: Span::Ticks(125_000),
        count: 2,
    };
    bench.pico().lock().emulator.strobe(&StrobeModel {
        delay: LATE,
        ..StrobeModel::default()
    })?;
    let held = Finding::Silent {
        line: Line::Sync,
        rest: Rest::High,
        output: Line::Proj,
    };
    let (mut named, mut exact) = (0_usize, 0);
    for expected in [Some(Finding::Open(Line::Sync)), Some(held), None] {
        let now = bench.pico().lock().cycle();
        match expected {
            Some(Finding::Open(_)) => {}
            Some(_) => bench.pico().lock().emulator.drive(Line::Sync, true, now + 1)?,
            None => bench.pico().lock().emulator.vsync(&VsyncModel {
                first: now + 1_000,
                period: 50_000,
                width: 5_000,
                ..VsyncModel::default()
            })?,
        }
        let tested = selftest(&mut bench.device, &settings)?;
        if tested.findings != Vec::from_iter(expected) {
            let found: Vec<String> = tested.findings.iter().map(ToString::to_string).collect();
            return Err(format!("expected {expected:?}, found {}", found.join("; ")).into());
        }
        named += 1;
        let timed = tested.inputs[1].of(Output::Cam).iter();
        exact += timed
            .filter(|answer| {
                answer.delay_and_width.is_some_and(|(delay, width)| {
                    (LATE..=LATE + 1).contains(&delay.0) && width.0.abs_diff(answer.pulse.0) <= 1
                })
            })
            .count();
    }
    bench.figure("wirings named", named, "wirings", Limit::Exactly(3.0))?;
    bench.figure(
        "delays and widths within a tick",
        exact,
        "of 6",
        Limit::Exactly(6.0),
    )?;

    // Every edge of the vsync is counted, in a watch as long as any.
    bench.device.watch()?;
    let before = bench.device.inputs()?;
    bench.silence(std::time::Duration::from_millis(40))?;
    let after = bench.device.inputs()?;
    let edges = after.sync.edges.unwrap_or(0) - before.sync.edges.unwrap_or(0);
    let expected = 2.0 * (after.at - before.at).0 as f64 / 50_000.0;
    bench.figure(
        "edges of SYNC missed or invented",
        (f64::from(edges) - expected).abs(),
        "edges",
        Limit::AtMost(2.0),
    )
}
