//! Triggers that the camera ignores, and exposures that nobody asked for.

use rand::seq::index::sample;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::emulator::StrobeModel;
use rcg_hil::figures::Limit;
use rcg_hil::trace;
use rcg_protocol::{Line, State, StepFlags, Ticks};

use crate::runs::{fire, follow_pinging, load, take_edges};
use crate::steps::{in_part, plain, table};

crate::trials!("strobes":
    missed_triggers_are_named [Inputs],
    spurious_strobes_are_named [Inputs],
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
