//! 32,400 steps at 9,523 Hz while the link is busy: every edge on its tick, every strobe paired.

use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::dut::LinkKind;
use rcg_hil::figures::Limit;
use rcg_protocol::{State, Step};

use crate::runs::{check_edges, check_pairing, fire, follow_pinging, load, take_edges, wire_strobe};
use crate::steps::{STEPS, bracket, in_part, period, plain, random, table};

crate::trials!("timing":
    plain_32400 [CamStrobe],
    brackets [CamStrobe],
    random_steps [CamStrobe],
    paired_at_4_khz [CamStrobe],
    table_at_20_khz [CamStrobe FastLink],
);

fn plain_32400(bench: &mut Bench) -> Outcome {
    let step = plain(period(bench.device.info().clock_hz));
    play(bench, &[step], STEPS, 100)
}

fn brackets(bench: &mut Bench) -> Outcome {
    let steps = bracket(period(bench.device.info().clock_hz));
    play(bench, &steps, in_part(STEPS / 3), in_part(100))
}

fn random_steps(bench: &mut Bench) -> Outcome {
    // As many different ones as the table has words for, five each.
    let steps = random(3_240, period(bench.device.info().clock_hz), 20);
    play(bench, &steps, in_part(STEPS / 3_240), in_part(100))
}

/// What a UART carries without losing a record.
fn paired_at_4_khz(bench: &mut Bench) -> Outcome {
    let step = plain(u64::from(bench.device.info().clock_hz / 4_000));
    play(bench, &[step], 4_000, 100)
}

/// The rate of a fast camera: over USB every record comes, and the CPU waits for flash never.
fn table_at_20_khz(bench: &mut Bench) -> Outcome {
    let step = plain(u64::from(bench.device.info().clock_hz / 20_000));
    play(bench, &[step], 4_000, 10)?;
    let lost = bench.device.status()?.counters.records_lost;
    bench.figure("records lost", lost, "records", Limit::Exactly(0.0))
}

/// Plays `steps` `cycles` times while the host pings as fast as it is answered, `least_pings` times or more.
fn play(bench: &mut Bench, steps: &[Step], cycles: u64, least_pings: u64) -> Outcome {
    let program = table(steps, cycles);
    let total = steps.len() as u64 * cycles;
    let all = || std::iter::repeat_n(steps, cycles as usize).flatten().copied();
    load(bench, &program, steps)?;
    wire_strobe(bench)?;
    let lost_before = bench.device.status()?.counters.records_lost;
    let before = crate::runs::stats(bench)?;
    let run = fire(bench)?;
    let heard = follow_pinging(bench, run)?;
    heard.expect(State::Done, None, total)?;
    crate::runs::check_cpu(bench, before)?;
    bench.figure("steps", total, "steps", Limit::Reported)?;
    check_edges(bench, &program, all(), &take_edges(bench))?;
    bench.figure(
        "pings answered meanwhile",
        heard.pings,
        "pings",
        Limit::AtLeast(least_pings as f64),
    )?;
    let lost = bench.device.status()?.counters.records_lost - lost_before;
    let accounted = heard.records.len() as u64 + u64::from(lost);
    bench.figure(
        "records received or counted as lost",
        accounted,
        "records",
        Limit::Exactly(total as f64),
    )?;
    if lost > 0 && bench.link() == LinkKind::Uart {
        // 92 kB/s do not carry the 130 kB/s of 9,523 records.
        return bench.figure(
            "records lost to the UART's speed",
            lost,
            "records",
            Limit::Reported,
        );
    }
    check_pairing(bench, all(), &heard.records)
}
