//! The further lines: AUX-A and AUX-B pulse with each step, PHOTO is stamped, START begins a run.

use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg::capture::selftest::{Finding, Settings, selftest_photo};
use rcg::capture::steps::{Output, Span};
use rcg_firmware::pulse::SYNC_LATENCY;
use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::emulator::VsyncModel;
use rcg_hil::figures::Limit;
use rcg_hil::trace::{self, Edge};
use rcg_protocol::{
    Aux, AuxPolarity, AuxPulse, Event, Fault, Line, Micros, Pace, Polarity, Program, Pulse, RunId, Start,
    State, Step, Ticks,
};

use crate::runs::{Result, check_cpu, fire, follow, load, stats, take_edges, wire_strobe};
use crate::steps::table;

crate::trials!("lines":
    pulses_of_further_outputs [Edges],
    they_rest_when_a_run_breaks_off [Edges],
    photo_is_stamped [Inputs],
    start_begins_each_run [Inputs],
    further_outputs_follow_sync [Edges Inputs],
    a_jumper_to_photo_is_tried [Edges Inputs],
);

/// Longer than any run here.
const PATIENCE: Duration = Duration::from_secs(20);

/// A pulse between two ticks of a grid within `period`, so that edges coincide often and are never too close.
fn drawn(rng: &mut Xoshiro256PlusPlus, period: u64) -> Pulse {
    let cell = period / 8;
    let (a, b) = (rng.random_range(0..=8_u64), rng.random_range(0..=8_u64));
    Pulse::new(a.min(b) * cell, a.abs_diff(b) * cell)
}

fn drawn_aux(rng: &mut Xoshiro256PlusPlus, period: u64) -> AuxPulse {
    match rng.random_range(0..4) {
        0 => AuxPulse::WithCam {
            after: Ticks::ZERO,
            width: Ticks::ZERO,
        },
        _ => AuxPulse::InStep(drawn(rng, period)),
    }
}

/// Tables of any pulses of all four outputs, of either polarity: every edge on its tick.
fn pulses_of_further_outputs(bench: &mut Bench) -> Outcome {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
    let us = u64::from(bench.device.info().clock_hz / 1_000_000);
    let (mut edges, mut jitter) = (0, 0);
    let before = stats(bench)?;
    for _ in 0..20 {
        let period = [8 * 6, 200 * us, 600 * us][rng.random_range(0..3)] / 8 * 8;
        let steps: Vec<Step> = (0..rng.random_range(1..=5))
            .map(|_| Step {
                proj: drawn(&mut rng, period),
                cam: drawn(&mut rng, period),
                period: Ticks(period),
            })
            .collect();
        let polarity = AuxPolarity {
            a_active_low: rng.random(),
            b_active_low: rng.random(),
            ..AuxPolarity::default()
        };
        let aux = Aux {
            polarity,
            a: drawn_aux(&mut rng, period),
            b: drawn_aux(&mut rng, period),
            photo: false,
        };
        bench.device.aux(&aux)?;
        let program = table(&steps, 4);
        load(bench, &program, &steps)?;
        let run = fire(bench)?;
        follow(bench, run, PATIENCE)?.expect(State::Done, None, 4 * steps.len() as u64)?;
        let found = take_edges(bench);
        let played = trace::free_run(0, steps.iter().copied().cycle().take(4 * steps.len()));
        let comparison = trace::compare(&at_first(&program, &aux, played, &found), &found)?;
        edges += comparison.edges;
        jitter = jitter.max(comparison.jitter);
    }
    check_cpu(bench, before)?;
    taking_in_the_longest(bench)?;
    bench.figure("edges of four outputs", edges, "edges", Limit::AtLeast(500.0))?;
    bench.figure("jitter", jitter, "ticks", Limit::Exactly(0.0))
}

/// Steps of as many words as they can have, as many as a message holds: interrupts wait for them less long than the UART can, which
/// is 350 µs.
fn taking_in_the_longest(bench: &mut Bench) -> Outcome {
    let longest = Step {
        proj: Pulse::new(0, 1_000),
        cam: Pulse::new(2_000, 1_000),
        period: Ticks(34 << 26),
    };
    bench.device.aux(&Aux {
        a: AuxPulse::InStep(Pulse::new(1 << 26, 1_000)),
        b: AuxPulse::InStep(Pulse::new(3 << 26, 1_000)),
        ..Aux::default()
    })?;
    load(bench, &table(&[longest; 8], 1), &[longest; 8])?;
    let Some(after) = stats(bench)? else { return Ok(()) };
    let masked_us = after.longest_masked as f64 * 1e6 / f64::from(after.clock_hz);
    bench.figure(
        "interrupts masked for eight of the longest steps",
        masked_us,
        "µs",
        Limit::AtMost(300.0),
    )?;
    bench.figure(
        "bytes that the UART lost with these",
        after.uart_overruns,
        "bytes",
        Limit::Exactly(0.0),
    )
}

/// What is expected, from the first edge of `found` on.
fn at_first(
    program: &Program,
    aux: &Aux,
    steps: impl Iterator<Item = (u64, Step)>,
    found: &[Edge],
) -> Vec<Edge> {
    let mut expected = trace::schedule_with(program.polarity, aux, steps);
    let first = trace::outputs(found).first().map_or(0, |edge| edge.at);
    let shift = first - expected.first().map_or(first, |edge| edge.at);
    for edge in &mut expected {
        edge.at += shift;
    }
    expected
}

/// A dead-man time and aborts at any phase: all outputs rest in one tick.
fn they_rest_when_a_run_breaks_off(bench: &mut Bench) -> Outcome {
    let period = u64::from(bench.device.info().clock_hz / 1_000);
    let whole = Pulse::new(0, period - 3);
    let step = Step {
        proj: whole,
        cam: whole,
        period: Ticks(period),
    };
    let aux = Aux {
        a: AuxPulse::InStep(whole),
        b: AuxPulse::WithCam {
            after: Ticks::ZERO,
            width: Ticks::ZERO,
        },
        ..Aux::default()
    };
    bench.device.aux(&aux)?;
    let program = Program {
        dead_man: Micros(20_000),
        ..table(&[step], 100_000)
    };
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(8);
    let mut apart = 0;
    for abort in [true, true, true, false] {
        load(bench, &program, &[step])?;
        let run = fire(bench)?;
        bench.silence(Duration::from_micros(rng.random_range(3_000..9_000)))?;
        let fault = (!abort).then_some(Fault::HostLost);
        if abort {
            bench.device.abort()?;
        } else {
            bench.silence(Duration::from_millis(40))?;
        }
        let ending = follow(bench, run, PATIENCE)?.ending()?;
        let levels = bench.pico().lock().emulator.outputs()?;
        if levels != [false; 4] || ending.fault != fault {
            return Err(
                format!("expected all outputs low and {fault:?}, found {levels:?} and {ending:?}").into(),
            );
        }
        let edges = trace::outputs(&take_edges(bench));
        let last = edges.last().ok_or("the run has no edges")?.at;
        let together = edges.iter().rev().take(4).map(|edge| last - edge.at);
        apart = apart.max(together.max().unwrap_or(0));
    }
    bench.figure("outputs rest apart by", apart, "ticks", Limit::AtMost(40.0))
}

/// Steps of wide words, each on a SYNC edge of its own: every edge of all four outputs counts from it.
fn further_outputs_follow_sync(bench: &mut Bench) -> Outcome {
    const STEPS: u64 = 500;
    let period = u64::from(bench.device.info().clock_hz / 1_440);
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(10);
    let (mut edges, mut jitter) = (0, 0);
    let before = stats(bench)?;
    for _ in 0..3 {
        let step = Step {
            proj: Pulse::new(0, 1_000),
            cam: Pulse::new(period / 8, period / 8),
            period: Ticks(period / 2),
        };
        let aux = Aux {
            a: drawn_aux(&mut rng, period / 16 * 8),
            b: AuxPulse::WithCam {
                after: Ticks(rng.random_range(5..1_000)),
                width: Ticks::ZERO,
            },
            ..Aux::default()
        };
        bench.device.aux(&aux)?;
        let program = Program {
            pace: Pace::EachOnSync,
            start: Start::OnSync,
            sync_timeout: Micros(500_000),
            ..table(&[step], STEPS)
        };
        // No edge of the run before may begin this one.
        let mut vsync = VsyncModel {
            first: bench.pico().lock().cycle() + (1 << 40),
            period,
            width: period / 10,
            jitter: period / 8,
            seed: 5,
            ..VsyncModel::default()
        };
        bench.pico().lock().emulator.vsync(&vsync)?;
        load(bench, &program, &[step])?;
        let run = fire(bench)?;
        vsync.first = bench.pico().lock().cycle() + period;
        bench.pico().lock().emulator.vsync(&vsync)?;
        follow(bench, run, PATIENCE)?.expect(State::Done, None, STEPS)?;
        let found = take_edges(bench);
        let syncs = trace::rises(&found, Line::Sync).into_iter().take(STEPS as usize);
        let starts = syncs.map(|sync| (sync + SYNC_LATENCY, step));
        let expected = trace::schedule_with(program.polarity, &aux, starts);
        let comparison = trace::compare(&expected, &found)?;
        edges += comparison.edges;
        jitter = jitter.max(comparison.jitter);
    }
    check_cpu(bench, before)?;
    let least = Limit::AtLeast(3.0 * 6.0 * STEPS as f64);
    bench.figure("edges of four outputs on SYNC", edges, "edges", least)?;
    bench.figure("jitter on SYNC", jitter, "ticks", Limit::Exactly(0.0))
}

/// What `rcg controller selftest --photo` does, without a jumper, with one, and with one from the other output.
fn a_jumper_to_photo_is_tried(bench: &mut Bench) -> Outcome {
    let settings = Settings {
        polarity: Polarity::default(),
        width: Span::Ticks(25_000),
        period: Span::Ticks(125_000),
        count: 2,
    };
    let mut named = 0_u32;
    for (jumper, expected) in [
        (None, Finding::Open(Line::Photo)),
        (
            Some(Line::AuxB),
            Finding::Wrong {
                line: Line::Photo,
                answers: Line::AuxB,
                output: Line::AuxA,
            },
        ),
    ] {
        if let Some(from) = jumper {
            bench.pico().lock().emulator.jumper(from, Line::Photo)?;
        }
        let tested = selftest_photo(&mut bench.device, &settings, AuxPolarity::default(), Output::AuxA)?;
        if tested.findings != [expected] {
            let found: Vec<String> = tested.findings.iter().map(ToString::to_string).collect();
            return Err(format!("expected {expected}, found {}", found.join("; ")).into());
        }
        named += 1;
    }
    let tested = selftest_photo(&mut bench.device, &settings, AuxPolarity::default(), Output::AuxB)?;
    if let Some(finding) = tested.findings.first() {
        return Err(format!("expected a jumper that is right, found {finding}").into());
    }
    let answers = tested.seen.of(Output::AuxB).iter();
    let exact = answers.filter(|answer| {
        answer
            .delay_and_width
            .is_some_and(|(delay, width)| delay.0 <= 2 && width.0.abs_diff(answer.pulse.0) <= 1)
    });
    bench.figure("wirings of PHOTO named", named, "wirings", Limit::Exactly(2.0))?;
    bench.figure(
        "pulses at PHOTO within a tick",
        exact.count(),
        "of 2",
        Limit::Exactly(2.0),
    )
}

/// What came of a run, and its pulses of PHOTO.
#[derive(Default)]
struct Lit {
    pulses: Vec<(Ticks, Option<Ticks>)>,
    lost: u32,
    began: Vec<(RunId, Ticks)>,
    ended: Vec<(RunId, State)>,
}

/// Listens until `runs` have ended.
fn listen(bench: &mut Bench, runs: usize) -> Result<Lit> {
    let mut lit = Lit::default();
    let mut next = 0;
    while lit.ended.len() < runs {
        match bench.device.next_event(Duration::from_millis(200))? {
            Some(Event::Photo { first, pulses, .. }) => {
                lit.lost += first - next;
                next = first + pulses.len() as u32;
                lit.pulses
                    .extend(pulses.iter().map(|pulse| (pulse.on, pulse.width)));
            }
            Some(Event::Started { run, at }) => lit.began.push((run, at)),
            Some(Event::Ended { run, state, .. }) => lit.ended.push((run, state)),
            Some(_) => {}
            None => {
                bench.device.ping(1)?;
            }
        }
    }
    let told = bench.device.photo()?.pulses;
    lit.lost += told - next.min(told);
    Ok(lit)
}

/// A photodiode at 2 kHz beside STROBE: every pulse is told, on its tick.
fn photo_is_stamped(bench: &mut Bench) -> Outcome {
    let clock = u64::from(bench.device.info().clock_hz);
    let step = Step {
        proj: Pulse::new(0, 1_000),
        cam: Pulse::new(2_000, 20_000),
        period: Ticks(clock / 2_000),
    };
    wire_strobe(bench)?;
    bench.device.aux(&Aux {
        a: AuxPulse::InStep(step.proj),
        photo: true,
        ..Aux::default()
    })?;
    let count = 200;
    load(bench, &table(&[step], count), &[step])?;
    bench.device.arm()?;
    take_edges(bench);
    let before = stats(bench)?;
    bench.device.start()?;
    let first = loop {
        if let Some(&first) = trace::rises(&bench.pico().lock().take_edges(), Line::Proj).first() {
            break first;
        }
        bench.pico().lock().run(200)?;
    };
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(9);
    let pulses: Vec<(u64, u64)> = (1..count - 1)
        .map(|k| {
            (
                k * step.period.0 + rng.random_range(0..20_000),
                rng.random_range(4..30_000),
            )
        })
        .collect();
    for (on, width) in &pulses {
        let mut pico = bench.pico().lock();
        pico.emulator.drive(Line::Photo, true, first + on)?;
        pico.emulator.drive(Line::Photo, false, first + on + width)?;
    }
    let lit = listen(bench, 1)?;
    check_cpu(bench, before)?;
    let late = |found: u64, meant: u64| found.wrapping_sub(meant);
    let (mut right, mut worst) = (0_usize, 0);
    for (&(on, width), &(found, length)) in pulses.iter().zip(&lit.pulses) {
        let off = length.map_or(0, |length| found.0 + length.0);
        let each = late(found.0, on).max(late(off, on + width));
        worst = worst.max(each);
        right += usize::from(each <= 1);
    }
    bench.figure(
        "pulses told, beside STROBE",
        lit.pulses.len(),
        "pulses",
        Limit::Exactly(pulses.len() as f64),
    )?;
    bench.figure("pulses lost", lit.lost, "pulses", Limit::Exactly(0.0))?;
    bench.figure("stamps late by", worst, "ticks", Limit::AtMost(1.0))?;
    bench.figure(
        "of them on their tick",
        right,
        "pulses",
        Limit::Exactly(pulses.len() as f64),
    )
}

/// A run that begins on START and has steps that wait for SYNC is refused.
fn refuses_paced(bench: &mut Bench, program: &Program, step: Step) -> Outcome {
    let paced = Program {
        pace: Pace::EachOnSync,
        ..*program
    };
    let refused = bench.device.load(&paced, &[step]).err();
    let refused = refused.map_or_else(String::new, |error| error.to_string());
    if refused.contains("START") {
        Ok(())
    } else {
        Err(format!("expected a refusal of paced steps, found `{refused}`").into())
    }
}

/// A run that repeats on each edge of START: the first output follows each as it follows SYNC; what rings begins nothing.
fn start_begins_each_run(bench: &mut Bench) -> Outcome {
    let ms = u64::from(bench.device.info().clock_hz / 1_000);
    let step = Step {
        proj: Pulse::new(0, 1_000),
        cam: Pulse::new(2_000, 20_000),
        period: Ticks(ms / 2),
    };
    let program = Program {
        start: Start::OnStartLine,
        sync_timeout: Micros(2_000),
        ..table(&[step], 4)
    };
    refuses_paced(bench, &program, step)?;
    bench.device.repeat(5)?;
    load(bench, &program, &[step])?;
    bench.device.arm()?;
    take_edges(bench);
    bench.device.start()?;
    let now = bench.pico().lock().cycle();
    let mut starts = Vec::new();
    for k in 0..5 {
        let at = now + 10 * ms + k * 8 * ms;
        let mut pico = bench.pico().lock();
        // One that comes while a run goes on begins nothing, nor does one of SYNC.
        let one_more = at + ms;
        for (line, high, at) in [
            (Line::Start, true, at),
            (Line::Start, false, at + 300),
            (Line::Start, true, at + 304),
            (Line::Start, false, at + 308),
            (Line::Start, true, one_more),
            (Line::Start, false, one_more + 500),
            (Line::Sync, true, at + 5 * ms),
            (Line::Sync, false, at + 6 * ms),
        ] {
            pico.emulator.drive(line, high, at)?;
        }
        starts.push(at);
    }
    let lit = listen(bench, 5)?;
    let edges = take_edges(bench);
    let rises = trace::rises(&edges, Line::Proj);
    let firsts: Vec<u64> = rises.iter().copied().step_by(4).collect();
    let latency: Vec<u64> = firsts
        .iter()
        .zip(&starts)
        .map(|(first, start)| first.wrapping_sub(*start))
        .collect();
    let span = (latency.iter().min(), latency.iter().max());
    if rises.len() != 20 || lit.ended.iter().any(|(_, state)| *state != State::Done) || lit.began.len() != 5 {
        return Err(format!(
            "expected 5 runs of 4 steps, found {} steps and {:?}",
            rises.len(),
            lit.ended
        )
        .into());
    }
    bench.figure(
        "runs, each begun by START",
        lit.began.len(),
        "runs",
        Limit::Exactly(5.0),
    )?;
    let (Some(least), Some(most)) = span else {
        return Err("there were no runs".into());
    };
    bench.figure("START to PROJ, most", *most, "ticks", Limit::AtMost(4.0))?;
    bench.figure("its spread", most - least, "ticks", Limit::Exactly(0.0))?;
    // None is left.
    bench.silence(Duration::from_millis(20))?;
    let state = bench.device.status()?.state;
    if state == State::Done {
        Ok(())
    } else {
        Err(format!("expected the end of the series, found {state}").into())
    }
}
