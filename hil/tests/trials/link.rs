//! A bad link during a run: no edge moves, nothing is done twice, and the counters add up.

use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg::capture::link::Link as _;
use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::figures::Limit;
use rcg_protocol::{Counters, RunId, State, Status};

use crate::runs::{
    Heard, check_cpu, check_edges, fire, follow, follow_pinging, listen, load, stats, take_edges, wire_strobe,
};
use crate::steps::{plain, table};

crate::trials!("link":
    flood_during_a_run [],
    reconnect_in_mid_frame [],
    a_host_that_sleeps [Cable],
    flood_of_pings [Emulator],
);

/// Requests of an earlier run whose frames come again: each would be fatal if it were carried out.
struct Old {
    frames: Vec<Vec<u8>>,
}

/// Counts what the device should have counted.
#[derive(Debug, Default, PartialEq, Eq)]
struct Sent {
    corrupt: u32,
    repeated: u32,
    stale: u32,
}

/// Loads, fires, stops, aborts and clears once, so that there are frames of all these.
fn rehearse(bench: &mut Bench) -> Result<Old, libtest_mimic::Failed> {
    let step = plain(u64::from(bench.device.info().clock_hz / 1_000));
    let from = bench.device.link().sent().len();
    load(bench, &table(&[step], 3), &[step])?;
    bench.device.arm()?;
    bench.device.start()?;
    bench.device.stop()?;
    bench.silence(Duration::from_millis(20))?;
    bench.device.abort()?;
    bench.device.clear()?;
    while bench.device.next_event(Duration::from_millis(5))?.is_some() {}
    let frames = bench.device.link().sent()[from..].to_vec();
    Ok(Old { frames })
}

/// Sends what is no request, or is one again.
fn mischief(bench: &mut Bench, rng: &mut Xoshiro256PlusPlus, old: &Old, sent: &mut Sent) -> Outcome {
    let frame = &old.frames[rng.random_range(0..old.frames.len())];
    let body = frame.len() - 1;
    match rng.random_range(0..5) {
        0 => {
            // One byte is another one; but no zero, which would make two frames of it.
            let mut frame = frame.clone();
            let at = rng.random_range(0..body);
            frame[at] = loop {
                let byte = rng.random_range(1..=255);
                if byte != frame[at] {
                    break byte;
                }
            };
            sent.corrupt += 1;
            bench.device.link_mut().send(&frame)?;
        }
        1 => {
            let mut frame = frame[..rng.random_range(1..body)].to_vec();
            frame.push(0);
            sent.corrupt += 1;
            bench.device.link_mut().send(&frame)?;
        }
        2 => {
            let mut noise: Vec<u8> = (0..rng.random_range(1..600))
                .map(|_| rng.random_range(1..=255))
                .collect();
            noise.push(0);
            sent.corrupt += 1;
            bench.device.link_mut().send(&noise)?;
        }
        3 => {
            // The last request of all, which was answered.
            let last = bench.device.link().sent().last().cloned().unwrap_or_default();
            sent.repeated += 1;
            bench.device.link_mut().send(&last)?;
        }
        _ => {
            sent.stale += 1;
            bench.device.link_mut().send(&frame.clone())?;
        }
    }
    Ok(())
}

fn flood_during_a_run(bench: &mut Bench) -> Outcome {
    const STEPS: u64 = 3_000;
    let old = rehearse(bench)?;
    let step = plain(u64::from(bench.device.info().clock_hz / 1_500));
    let program = table(&[step], STEPS);
    load(bench, &program, &[step])?;
    let before = bench.device.status()?.counters;
    let sent_before = bench.device.link().sent().len();
    let run = fire(bench)?;
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(6);
    let (mut sent, mut heard, mut asked) = (Sent::default(), Heard::default(), 2_u32);
    let mut made = 0_u32;
    while heard.ending.is_none() {
        // The request before a repeated one must have been answered, and its answer be the last.
        bench.device.ping(asked)?;
        asked += 1;
        mischief(bench, &mut rng, &old, &mut sent)?;
        made += 1;
        listen(bench, run, &mut heard)?;
    }
    let status = bench.device.status()?;
    asked += 1;
    heard.expect(State::Done, None, STEPS)?;
    check_edges(bench, &program, vec![step; STEPS as usize], &take_edges(bench))?;
    bench.figure(
        "bad, repeated and old frames",
        made,
        "frames",
        Limit::AtLeast(500.0),
    )?;

    // Had the client asked anything again, it would count as repeated.
    let frames = bench.device.link().sent().len() - sent_before;
    bench.figure(
        "frames sent",
        frames,
        "frames",
        Limit::Exactly(f64::from(asked + made)),
    )?;
    check_counters(bench, &status, run, before, asked, &sent)
}

fn check_counters(
    bench: &Bench,
    status: &Status,
    run: RunId,
    before: Counters,
    executed: u32,
    sent: &Sent,
) -> Outcome {
    let now = status.counters;
    let exactly = |count: u32| Limit::Exactly(f64::from(count));
    bench.figure(
        "corrupt frames counted",
        now.corrupt - before.corrupt,
        "frames",
        exactly(sent.corrupt),
    )?;
    bench.figure(
        "repeated requests counted",
        now.repeated - before.repeated,
        "frames",
        exactly(sent.repeated),
    )?;
    bench.figure(
        "stale requests counted",
        now.stale - before.stale,
        "frames",
        exactly(sent.stale),
    )?;
    bench.figure(
        "requests executed",
        now.executed - before.executed,
        "frames",
        exactly(executed),
    )?;
    let sum = now.executed + now.repeated + now.stale;
    bench.figure(
        "frames = executed + repeated + stale",
        now.frames,
        "frames",
        exactly(sum),
    )?;
    if status.run != run {
        return Err(format!("another run was armed meanwhile: {status:?}").into());
    }
    Ok(())
}

/// The host dies in mid-frame and another comes, again and again; what the dead ones said is not acted on.
fn reconnect_in_mid_frame(bench: &mut Bench) -> Outcome {
    const STEPS: u64 = 1_000;
    const RECONNECTS: u32 = 25;
    let old = rehearse(bench)?;
    let step = plain(u64::from(bench.device.info().clock_hz / 1_500));
    let program = table(&[step], STEPS);
    load(bench, &program, &[step])?;
    let before = bench.device.status()?.counters;
    let run = fire(bench)?;
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
    let (mut sent, mut heard, mut executed) = (Sent::default(), Heard::default(), 2);
    for k in 0..RECONNECTS {
        let frame = &old.frames[rng.random_range(0..old.frames.len())];
        let half = frame[..rng.random_range(1..frame.len() - 1)].to_vec();
        bench.device.link_mut().send(&half)?;
        sent.corrupt += 1;
        bench.silence(Duration::from_millis(2))?;
        bench.device.open_session(bench_nonce(k))?;
        executed += 2; // hello and describe
        bench.device.link_mut().send(&frame.clone())?;
        sent.stale += 1;
        bench.silence(Duration::from_millis(5))?;
        listen(bench, run, &mut heard)?;
    }
    while heard.ending.is_none() {
        bench.silence(Duration::from_millis(20))?;
        listen(bench, run, &mut heard)?;
    }
    let status = bench.device.status()?;
    executed += 1;
    heard.expect(State::Done, None, STEPS)?;
    check_edges(bench, &program, vec![step; STEPS as usize], &take_edges(bench))?;
    bench.figure("reconnects in mid-frame", RECONNECTS, "sessions", Limit::Reported)?;
    check_counters(bench, &status, run, before, executed, &sent)
}

/// A nonce that no other session of this trial has.
const fn bench_nonce(k: u32) -> u32 {
    0x5eed_0000 + k
}

/// A host that does not read for a while, shorter and longer than the box has patience: what it missed is counted.
fn a_host_that_sleeps(bench: &mut Bench) -> Outcome {
    const STEPS: u64 = 4_000;
    let step = plain(u64::from(bench.device.info().clock_hz / 4_000));
    load(bench, &table(&[step], STEPS), &[step])?;
    wire_strobe(bench)?;
    let before = bench.device.status()?.counters.records_lost;
    let run = fire(bench)?;
    for pause_ms in [100, 600] {
        bench.silence(Duration::from_millis(20))?;
        bench.pico().lock().emulator.fetch(false)?;
        bench.silence(Duration::from_millis(pause_ms))?;
        bench.pico().lock().emulator.fetch(true)?;
    }
    let heard = follow_pinging(bench, run)?;
    heard.expect(State::Done, None, STEPS)?;
    let lost = u64::from(bench.device.status()?.counters.records_lost - before);
    bench.figure("records lost", lost, "records", Limit::AtLeast(1.0))?;
    let uncounted = STEPS as f64 - (heard.records.len() as u64 + lost) as f64;
    bench.figure("of them uncounted", uncounted, "records", Limit::Exactly(0.0))
}

/// Pings without a gap on the line, during a run: no byte of them is lost.
fn flood_of_pings(bench: &mut Bench) -> Outcome {
    const PINGS: u32 = 1_000;
    let step = plain(u64::from(bench.device.info().clock_hz / 2_000));
    load(bench, &table(&[step], 400), &[step])?;
    wire_strobe(bench)?;
    let before = stats(bench)?;
    let asked = bench.device.status()?.counters;
    let run = fire(bench)?;
    let ping = bench.device.link().sent().last().cloned().unwrap_or_default();
    {
        // The same request again and again: each is answered, and nothing is done twice.
        let mut pico = bench.pico().lock();
        for _ in 0..PINGS {
            pico.emulator.send(&ping)?;
        }
    }
    bench.silence(Duration::from_millis(250))?;
    follow(bench, run, Duration::from_secs(1))?.expect(State::Done, None, 400)?;
    check_cpu(bench, before)?;
    let counters = bench.device.status()?.counters;
    bench.figure(
        "frames corrupt",
        counters.corrupt - asked.corrupt,
        "frames",
        Limit::Exactly(0.0),
    )?;
    bench.figure(
        "requests of the flood that came",
        counters.repeated - asked.repeated,
        "requests",
        Limit::Exactly(f64::from(PINGS)),
    )
}
