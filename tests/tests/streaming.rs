//! Law: a stream that ended as done was played step by step as it was given, over whatever line.

use std::time::Duration;

use rcg::capture::device::{Device, DeviceError, Feed};
use rcg::capture::link::Link as _;
use rcg_protocol::{Event, Extent, Fault, Program, State};
use rcg_tests::books::{Client, PATIENCE, check, check_played, steps};
use rcg_tests::{Controller, Faults, MockLink};

/// More than the controller holds at a time.
const LONG: usize = 6000;

fn client(down: Faults, up: Faults, seed: u64) -> Result<Client, DeviceError> {
    Device::connect(MockLink::new(Controller::new(&[]), down, up, seed), 1, PATIENCE)
}

#[test]
fn a_stream_longer_than_the_store_is_played_whole() {
    let mut client = client(Faults::NONE, Faults::NONE, 0).unwrap();
    let (program, steps) = (Program::new(Extent::Stream), steps(LONG, 1));
    let mut records = 0;
    let ending = client
        .stream(&program, steps.iter().copied(), |event| {
            if let Some(Event::Records { records: batch, .. }) = event {
                records += batch.len();
            }
            Ok::<(), DeviceError>(())
        })
        .unwrap();
    assert_eq!((ending.state, ending.steps_done), (State::Done, LONG as u64));
    assert_eq!(records, LONG);
    check_played(client.link(), 1, &program, &steps);
    check(client.link());
    let counters = client.status().unwrap().counters;
    assert_eq!(
        (counters.stale, counters.repeated),
        (0, 0),
        "nothing was sent in vain"
    );
}

#[test]
fn a_bad_line_costs_time_and_no_step() {
    let (mut played, mut sent_again) = (0, 0);
    for seed in 0..60 {
        let faults = |n: u64| Faults {
            lose_byte: 0.0005,
            flip_bit: 0.0005,
            lose_chunk: 0.01,
            duplicate: 0.02,
            delay: 0.05,
            reorder: 0.02,
            garbage: 0.01,
            longest_delay_ns: 20_000_000 * (n % 4),
            longest_chunk: 64,
            cut_after: None,
        };
        let Ok(mut client) = client(faults(seed), faults(seed / 4), seed) else {
            continue;
        };
        let (program, steps) = (Program::new(Extent::Stream), steps(600, seed));
        match client.stream(&program, steps.iter().copied(), |_| Ok::<(), DeviceError>(())) {
            Ok(ending) if ending.state == State::Done => {
                assert_eq!(ending.steps_done, 600, "seed {seed}");
                check_played(client.link(), 1, &program, &steps);
                played += 1;
            }
            Ok(ending) => {
                let dry = matches!(ending.fault, Some(Fault::Underrun { .. }));
                assert!(dry, "seed {seed}: {ending:?}");
            }
            Err(DeviceError::Timeout { .. }) => {}
            Err(other) => panic!("seed {seed}: {other}"),
        }
        let batches = client.link().sent().iter().filter(|sent| is_append(sent)).count();
        sent_again += batches.saturating_sub(600 / 8);
        check(client.link());
    }
    assert!(played > 50, "{played} of 60 were played");
    assert!(
        sent_again > 500,
        "{sent_again} batches were sent again: the lines are too good"
    );
}

fn is_append(message: &rcg_protocol::ToDevice) -> bool {
    matches!(message.request, rcg_protocol::Request::Append { .. })
}

#[test]
fn a_bad_step_is_named_and_the_run_ends() {
    for bad in [3, 5000] {
        let mut client = client(Faults::NONE, Faults::NONE, 0).unwrap();
        let mut steps = steps(LONG, 1);
        steps[bad].cam.at.0 = 1;
        let error = client
            .stream(&Program::new(Extent::Stream), steps.into_iter(), |_| {
                Ok::<(), DeviceError>(())
            })
            .unwrap_err();
        match error.fault() {
            Some(Fault::EdgesTooClose { step, .. }) => assert_eq!(step, bad as u64),
            _ => panic!("{error}"),
        }
        let state = client.status().unwrap().state;
        assert!(!matches!(state, State::Running | State::Armed), "{state}");
    }
}

#[test]
fn a_slow_answer_does_not_slow_the_stream() {
    // Every chunk takes up to 4 ms, in both directions: a batch at a time would wait for each.
    let slow = Faults {
        delay: 1.0,
        longest_delay_ns: 4_000_000,
        ..Faults::NONE
    };
    let steps = steps(2000, 1);
    let mut one_by_one = client(slow, slow, 1).unwrap();
    one_by_one.begin(&Program::new(Extent::Stream)).unwrap();
    let began = one_by_one.link().now();
    for (batch, chunk) in steps.chunks(8).enumerate() {
        one_by_one.append(8 * batch as u64, chunk, false).unwrap();
    }
    let waited = one_by_one.link().now().saturating_sub(began);

    let mut fed = client(slow, slow, 1).unwrap();
    fed.begin(&Program::new(Extent::Stream)).unwrap();
    let began = fed.link().now();
    let mut feed = Feed::new(steps.into_iter(), 4096);
    feed.fill(&mut fed).unwrap();
    let took = fed.link().now().saturating_sub(began);
    assert_eq!(feed.confirmed(), 2000);
    assert!(took < waited / 2, "{took:?} against {waited:?}");
    assert!(took > Duration::ZERO);
}
