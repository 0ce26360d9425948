//! Runs that follow the projector's vsync.

use std::time::Duration;

use rcg_firmware::pulse::SYNC_LATENCY;
use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::emulator::VsyncModel;
use rcg_hil::figures::Limit;
use rcg_hil::trace;
use rcg_protocol::{
    Fault, Line, Micros, Pace, Program, Pulse, Start, State, Step, StepFlags, StepId, StepRecord, Ticks,
};

use crate::runs::{Heard, Result, fire, follow, latencies, load, take_edges};
use crate::steps::table;

crate::trials!("sync":
    each_step_on_its_edge [Edges Inputs],
    first_step_on_an_edge [Edges Inputs],
    time_out_names_the_step [Edges Inputs],
    missing_vsync_is_flagged [Edges Inputs],
    double_vsync_is_flagged [Edges Inputs],
    an_edge_at_the_end_of_a_step [Edges Inputs],
    ringing_begins_nothing [Edges Inputs],
);

/// From SYNC to PROJ: what the firmware counts its times with. An instrument may take 6 ticks.
const LATENCY: Limit = Limit::Exactly(SYNC_LATENCY as f64);
const _: () = assert!(SYNC_LATENCY <= 6);

/// Vsync of 1,440 Hz, the rate of video pattern mode at 60 Hz.
fn vsync(bench: &Bench) -> VsyncModel {
    let period = u64::from(bench.device.info().clock_hz / 1_440);
    VsyncModel {
        first: bench.pico().lock().cycle() + 2 * period,
        period,
        width: period / 10,
        ..VsyncModel::default()
    }
}

/// A step for half a period of vsync; PROJ begins with it.
fn step(vsync: &VsyncModel) -> Step {
    Step {
        proj: Pulse::new(0, 1_000),
        cam: Pulse::new(2_000, vsync.period / 4),
        period: Ticks(vsync.period / 2),
    }
}

/// `count` steps, each on an edge of its own, with half a second of patience.
fn paced(step: Step, count: u64) -> Program {
    Program {
        pace: Pace::EachOnSync,
        start: Start::OnSync,
        sync_timeout: Micros(500_000),
        ..table(&[step], count)
    }
}

/// Plays `count` steps on the edges of `vsync`, which begins with the run.
fn play(bench: &mut Bench, count: u64, vsync: &VsyncModel) -> Result<Heard> {
    let step = step(vsync);
    load(bench, &paced(step, count), &[step])?;
    let run = fire(bench)?;
    let first = bench.pico().lock().cycle() + vsync.period;
    bench.pico().lock().emulator.vsync(&VsyncModel {
        first,
        ..vsync.clone()
    })?;
    follow(bench, run, Duration::from_secs(2))
}

fn each_step_on_its_edge(bench: &mut Bench) -> Outcome {
    const STEPS: u64 = 2_000;
    let vsync = vsync(bench);
    let vsync = VsyncModel {
        jitter: vsync.period / 8,
        seed: 5,
        ..vsync
    };
    play(bench, STEPS, &vsync)?.expect(State::Done, None, STEPS)?;
    let edges = take_edges(bench);
    let (least, most) = latencies(&edges, Line::Sync);
    bench.figure("SYNC edge to PROJ edge", most, "ticks", LATENCY)?;
    bench.figure(
        "spread of it over all steps",
        most - least,
        "ticks",
        Limit::Exactly(0.0),
    )?;

    // Everything else counts from that edge.
    let step = step(&vsync);
    let syncs = trace::rises(&edges, Line::Sync).into_iter().take(STEPS as usize);
    let starts = syncs.map(|sync| (sync + most, step));
    let expected = trace::schedule(rcg_protocol::Polarity::default(), starts);
    let comparison = trace::compare(&expected, &edges)?;
    bench.figure(
        "edges on their tick",
        comparison.edges,
        "edges",
        Limit::Exactly(4.0 * STEPS as f64),
    )?;
    bench.figure("jitter", comparison.jitter, "ticks", Limit::Exactly(0.0))
}

/// A free run that begins on an edge, many times, with the edge at any phase of everything.
fn first_step_on_an_edge(bench: &mut Bench) -> Outcome {
    const RUNS: u64 = 25;
    let vsync = vsync(bench);
    let step = step(&vsync);
    let program = Program {
        start: Start::OnSync,
        ..table(&[step], 3)
    };
    load(bench, &program, &[step])?;
    let (mut least, mut most, mut edges_seen) = (u64::MAX, 0, 0);
    for k in 0..RUNS {
        let run = fire(bench)?;
        let first = bench.pico().lock().cycle() + 50_000 + k * 123_457;
        let once = VsyncModel {
            first,
            period: u64::from(u32::MAX),
            width: 1_000,
            ..VsyncModel::default()
        };
        bench.pico().lock().emulator.vsync(&once)?;
        follow(bench, run, Duration::from_secs(2))?.expect(State::Done, None, 3)?;
        let edges = take_edges(bench);
        let sync = trace::rises(&edges, Line::Sync)[0];
        let proj = trace::rises(&edges, Line::Proj)[0];
        (least, most) = (least.min(proj - sync), most.max(proj - sync));
        let expected = trace::schedule(program.polarity, trace::free_run(proj, [step; 3]));
        let comparison = trace::compare(&expected, &edges)?;
        if comparison.jitter > 0 {
            return Err(format!("run {k}: jitter of {} ticks", comparison.jitter).into());
        }
        edges_seen += comparison.edges;
    }
    bench.figure("runs", RUNS, "runs", Limit::Reported)?;
    bench.figure(
        "edges on their tick",
        edges_seen,
        "edges",
        Limit::Exactly(12.0 * RUNS as f64),
    )?;
    bench.figure("SYNC edge to PROJ edge", most, "ticks", LATENCY)?;
    bench.figure(
        "spread of it over all runs",
        most - least,
        "ticks",
        Limit::Exactly(0.0),
    )
}

/// Vsync ceases after 40 pulses: step 40 is named, and both outputs rest.
fn time_out_names_the_step(bench: &mut Bench) -> Outcome {
    let vsync = vsync(bench);
    let vsync = VsyncModel {
        missing: (40..4_000).collect(),
        ..vsync
    };
    let heard = play(bench, 100, &vsync)?;
    let fault = Fault::SyncTimeout { step: StepId(40) };
    heard.expect(State::Fault, Some(fault), 40)?;
    bench.silence(Duration::from_millis(5))?;
    let edges = trace::outputs(&take_edges(bench));
    bench.figure(
        "edges before the time-out",
        edges.len(),
        "edges",
        Limit::Exactly(160.0),
    )?;
    if bench.pico().lock().emulator.outputs()? != [false; 4] {
        return Err("an output is high after the time-out".into());
    }
    Ok(())
}

fn missing_vsync_is_flagged(bench: &mut Bench) -> Outcome {
    // Two in a row are one gap: it is the step after it that waited.
    let missing = vec![10, 33, 34, 60];
    let vsync = VsyncModel {
        missing,
        ..vsync(bench)
    };
    let heard = play(bench, 100, &vsync)?;
    heard.expect(State::Done, None, 100)?;
    let flagged = heard.flagged(StepFlags::SYNC_MISSED);
    if flagged != [10, 32, 57] {
        return Err(format!("expected steps 10, 32 and 57 to be flagged, found {flagged:?}").into());
    }
    bench.figure(
        "gaps in vsync, each named by its step",
        flagged.len(),
        "steps",
        Limit::Exactly(3.0),
    )?;
    nothing_else(&heard, StepFlags::SYNC_MISSED)
}

fn double_vsync_is_flagged(bench: &mut Bench) -> Outcome {
    let vsync = VsyncModel {
        double: vec![10, 33, 34, 60],
        ..vsync(bench)
    };
    let heard = play(bench, 100, &vsync)?;
    heard.expect(State::Done, None, 100)?;
    let flagged = heard.flagged(StepFlags::SYNC_EXTRA);
    if flagged != [10, 33, 34, 60] {
        return Err(format!("expected steps 10, 33, 34 and 60 to be flagged, found {flagged:?}").into());
    }
    bench.figure(
        "double vsyncs, each named by its step",
        flagged.len(),
        "steps",
        Limit::Exactly(4.0),
    )?;
    nothing_else(&heard, StepFlags::SYNC_EXTRA)
}

/// Fails if a record has a flag of SYNC other than `expected`.
fn nothing_else(heard: &Heard, expected: StepFlags) -> Outcome {
    let other = StepFlags::SYNC_MISSED.with(StepFlags::SYNC_EXTRA).0 & !expected.0;
    match heard.records.iter().find(|record| record.flags.0 & other != 0) {
        Some(record) => Err(format!("a flag that nothing explains: {record:?}").into()),
        None => Ok(()),
    }
}

/// SYNC pulses of `width` at `rises`, each with what rings back at its end: pulses of `ring` ticks.
fn drive_sync(bench: &Bench, rises: &[u64], width: u64, rings: &[(u64, u64)]) -> Outcome {
    let mut pico = bench.pico().lock();
    for &rise in rises {
        pico.emulator.drive(Line::Sync, true, rise)?;
        let mut at = rise + width;
        pico.emulator.drive(Line::Sync, false, at)?;
        for &(gap, ring) in rings {
            pico.emulator.drive(Line::Sync, true, at + gap)?;
            pico.emulator.drive(Line::Sync, false, at + gap + ring)?;
            at += gap + ring;
        }
    }
    Ok(())
}

/// How many records of a run are not within a tick of their CAM edge. The first step says where the run began.
fn shifted(records: &[StepRecord], edges: &[trace::Edge]) -> usize {
    let cams = trace::rises(edges, Line::Cam);
    let (Some(first), Some(cam)) = (records.first(), cams.first()) else {
        return 0;
    };
    let begun = cam.wrapping_sub(first.trigger.0);
    let on_edge = |record: &&StepRecord| {
        let cam = cams.get(record.step.0 as usize);
        cam.is_some_and(|cam| cam.abs_diff(record.trigger.0.wrapping_add(begun)) <= 1)
    };
    records.len() - records.iter().filter(on_edge).count()
}

/// Loads so many steps of an eighth of a millisecond, each on an edge; returns how long one is, in ticks.
fn load_short_steps(bench: &mut Bench, steps: u64) -> Result<u64> {
    let period = u64::from(bench.device.info().clock_hz / 8_000);
    let step = Step {
        proj: Pulse::new(0, 500),
        cam: Pulse::new(700, 1_000),
        period: Ticks(period),
    };
    load(bench, &paced(step, steps), &[step])?;
    Ok(period)
}

/// Twelve steps, each on an edge, with one edge more `after` ticks after the end of the fifth step.
fn an_edge_at_the_end_of_a_step(bench: &mut Bench) -> Outcome {
    const STEPS: u64 = 12;
    let period = load_short_steps(bench, STEPS)?;
    let (mut runs, mut shifts, mut faults) = (0_u64, 0, 0_u64);
    // Where the machine looked again before it masked what rings back, and where it does now; in both phases of the counter.
    for after in (-8..=16).chain(32..=42).flat_map(|after| [after; 2]) {
        let run = fire(bench)?;
        let first = bench.pico().lock().cycle() + 5_000 + runs % 2;
        let mut rises: Vec<u64> = (0..STEPS).map(|k| first + 4 * period * k).collect();
        rises.push((rises[4] + SYNC_LATENCY + period).wrapping_add_signed(after));
        drive_sync(bench, &rises, 200, &[])?;
        let heard = follow(bench, run, Duration::from_secs(2))?;
        let ending = heard.ending()?;
        if ending.state != State::Done && !matches!(ending.fault, Some(Fault::SyncUnclear { .. })) {
            return Err(format!("an edge {after} ticks after a step's end: {ending:?}").into());
        }
        faults += u64::from(ending.state != State::Done);
        // The edges that are left over are through.
        bench.silence(Duration::from_millis(2))?;
        shifts += shifted(&heard.records, &take_edges(bench));
        runs += 1;
    }
    bench.figure("runs with an edge at a step's end", runs, "runs", Limit::Reported)?;
    bench.figure("of them given up", faults, "runs", Limit::Reported)?;
    bench.figure("silent shifts", shifts, "records", Limit::Exactly(0.0))
}

/// SYNC frames the exposure, so it ends after the step, and rings then: nothing begins with that.
fn ringing_begins_nothing(bench: &mut Bench) -> Outcome {
    const STEPS: u64 = 12;
    let period = load_short_steps(bench, STEPS)?;
    let (mut cams, mut shifts, mut runs, mut flagged) = (0, 0, 0, 0);
    for ring in 1..=8 {
        for gap in [1, 3] {
            let run = fire(bench)?;
            let first = bench.pico().lock().cycle() + 5_000;
            let rises: Vec<u64> = (0..STEPS).map(|k| first + 4 * period * k).collect();
            drive_sync(bench, &rises, period + 800, &[(gap, ring), (gap, ring)])?;
            let heard = follow(bench, run, Duration::from_secs(2))?;
            heard.expect(State::Done, None, STEPS)?;
            bench.silence(Duration::from_millis(2))?;
            let edges = take_edges(bench);
            cams += trace::rises(&edges, Line::Cam).len();
            shifts += shifted(&heard.records, &edges);
            flagged += heard.flagged(StepFlags::SYNC_EXTRA).len();
            runs += STEPS;
        }
    }
    bench.figure(
        "CAM pulses beyond the steps",
        cams as f64 - runs as f64,
        "pulses",
        Limit::Exactly(0.0),
    )?;
    bench.figure(
        "bounces taken for pulses of SYNC",
        flagged,
        "steps",
        Limit::Exactly(0.0),
    )?;
    bench.figure("silent shifts", shifts, "records", Limit::Exactly(0.0))
}
