//! Law: what telemetry says is true and in order, and what it does not say is noticed.

use std::collections::BTreeSet;
use std::time::Duration;

use rcg::capture::device::Device;
use rcg_protocol::{Event, State, Status, StepFlags, StepRecord};
use rcg_tests::books::{Client, PATIENCE, check, steps, table};
use rcg_tests::{Controller, Faults, MockLink};

const STEPS: usize = 50;
const CYCLES: u32 = 4;
const TOTAL: u64 = STEPS as u64 * CYCLES as u64;
/// The camera misses these.
const MISSED: [u64; 5] = [0, 7, 8, 100, TOTAL - 1];

fn connected(seed: u64) -> Client {
    let link = MockLink::new(Controller::new(&MISSED), Faults::NONE, Faults::NONE, seed);
    Device::connect(link, 1, PATIENCE).unwrap()
}

/// Loads on a good line, runs on `up`, and asks how it ended on a good line again.
fn run(client: &mut Client, up: Faults, period: u64) -> (Vec<Event>, Status) {
    let mut steps = steps(STEPS, 0);
    for step in &mut steps {
        step.period.0 = period;
    }
    client.load(&table(STEPS, CYCLES), &steps).unwrap();
    client.arm().unwrap();
    client.link().set_faults(Faults::NONE, up);
    // The answer may be lost like anything else; the run begins all the same.
    let _ = client.start();
    let mut events = Vec::new();
    for _ in 0..10_000 {
        match client.next_event(Duration::from_millis(500)).unwrap() {
            Some(event) => events.push(event),
            None => break,
        }
    }
    client.link().set_faults(Faults::NONE, Faults::NONE);
    let status = client.status().unwrap();
    assert_eq!((status.state, status.steps_done), (State::Done, TOTAL));
    while let Some(event) = client.next_event(Duration::from_millis(1)).unwrap() {
        events.push(event);
    }
    (events, status)
}

fn records(events: &[Event]) -> Vec<StepRecord> {
    let of = |event: &Event| match event {
        Event::Records { records, .. } => records.to_vec(),
        _ => Vec::new(),
    };
    events.iter().flat_map(of).collect()
}

/// The steps that no record tells of: what a host sees as gaps in the numbers.
fn gaps(records: &[StepRecord]) -> Vec<u64> {
    let told: BTreeSet<u64> = records.iter().map(|record| record.step.0).collect();
    (0..TOTAL).filter(|step| !told.contains(step)).collect()
}

fn assert_true(client: &Client, records: &[StepRecord]) {
    client.link().peer_mut(|peer| {
        let run = peer.session().sequencer().run();
        for record in records {
            assert_eq!(Some(record), peer.journal().truth.get(&(run, record.step)));
        }
    });
}

#[test]
fn a_good_line_tells_all_in_order() {
    for longest_chunk in [1, 4096] {
        let mut client = connected(0);
        let faults = Faults {
            longest_chunk,
            ..Faults::NONE
        };
        let (events, status) = run(&mut client, faults, 125_000);
        let records = records(&events);
        assert_eq!(
            records.iter().map(|record| record.step.0).collect::<Vec<_>>(),
            (0..TOTAL).collect::<Vec<_>>()
        );
        assert_true(&client, &records);
        let missed: Vec<u64> = records
            .iter()
            .filter(|record| record.flags.contains(StepFlags::MISSED))
            .map(|record| record.step.0)
            .collect();
        assert_eq!(missed, MISSED);
        assert!(matches!(events.first(), Some(Event::Started { run: 1, .. })));
        assert!(matches!(
            events.last(),
            Some(Event::Ended {
                run: 1,
                state: State::Done,
                steps_done: TOTAL,
                ..
            })
        ));
        assert_eq!(
            (status.counters.records_lost, status.counters.spurious_strobes),
            (0, 0)
        );
        assert_eq!(client.corrupt_frames(), 0);
    }
}

#[test]
fn on_a_bad_line_what_comes_is_true_and_in_order_and_what_does_not_is_a_gap() {
    let (mut with_gaps, mut told, mut corrupt) = (0, 0, 0);
    for seed in 0..200 {
        let mut client = connected(seed);
        let (events, status) = run(&mut client, Faults::of_a_stream(seed), 125_000);
        let records = records(&events);
        assert!(
            records.windows(2).all(|pair| pair[0].step < pair[1].step),
            "seed {seed}"
        );
        assert_true(&client, &records);
        let gaps = gaps(&records);
        assert_eq!(
            records.len() + gaps.len(),
            status.steps_done as usize,
            "seed {seed}"
        );
        with_gaps += u32::from(!gaps.is_empty());
        told += records.len();
        corrupt += client.corrupt_frames();
        check(client.link());
    }
    println!("{with_gaps} runs with gaps, {told} records, {corrupt} corrupt frames");
    assert!(with_gaps > 50 && with_gaps < 200 && told > 10_000 && corrupt > 1000);
}

#[test]
fn even_on_a_line_that_shuffles_what_comes_is_true() {
    for seed in 0..100 {
        let mut client = connected(seed);
        let (events, _) = run(
            &mut client,
            Faults {
                reorder: 0.1,
                duplicate: 0.1,
                ..Faults::any(seed)
            },
            125_000,
        );
        assert_true(&client, &records(&events));
    }
}

#[test]
fn a_line_that_is_too_slow_loses_records_by_number_only() {
    let mut client = connected(0);
    // 31,250 steps a second are more than the line can tell.
    let (events, status) = run(&mut client, Faults::NONE, 4_000);
    let records = records(&events);
    assert_true(&client, &records);
    assert!(records.windows(2).all(|pair| pair[0].step < pair[1].step));
    let lost = gaps(&records).len();
    assert!(lost > 0, "the line kept up");
    assert_eq!(lost, status.counters.records_lost as usize);
    assert!(matches!(events.last(), Some(Event::Ended { .. })));
}

#[test]
fn events_of_a_run_before_are_told_apart_by_its_number() {
    let mut client = connected(0);
    for number in 1..=3 {
        let (events, _) = run(&mut client, Faults::NONE, 125_000);
        assert!(events.iter().all(|event| match event {
            Event::Started { run, .. }
            | Event::Records { run, .. }
            | Event::SpuriousStrobe { run, .. }
            | Event::Room { run, .. }
            | Event::Ended { run, .. }
            | Event::Photo { run, .. } => *run == number,
        }));
        assert_eq!(records(&events).len() as u64, TOTAL);
    }
}
