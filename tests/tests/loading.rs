//! Law: a schedule is loaded exactly, or not, by name.

use std::time::Duration;

use rcg::capture::device::{Device, DeviceError};
use rcg_protocol::{Command, Extent, Fault, Program, Pulse, State, Ticks};
use rcg_tests::books::{PATIENCE, check, check_played, in_time, steps, table};
use rcg_tests::{Controller, Faults, MockLink};

const STEPS: usize = 100;
/// The program, and 13 batches of 8 steps.
const REQUESTS: u32 = 14;

#[test]
fn a_hundred_steps_over_any_line_are_loaded_exactly_or_given_up_by_name() {
    let (mut loaded, mut given_up) = (0, 0);
    for seed in 0..300 {
        let link = MockLink::new(Controller::new(&[]), Faults::NONE, Faults::NONE, seed);
        let mut client = Device::connect(link, 1, PATIENCE).unwrap();
        // Something else was loaded before.
        client.load(&table(30, 1), &steps(30, 77)).unwrap();
        client
            .link()
            .set_faults(Faults::any(5 * seed), Faults::any(5 * seed + 1));
        let extent = if seed % 2 == 0 {
            Extent::Stream
        } else {
            table(STEPS, 2).extent
        };
        let (program, steps) = (Program::new(extent), steps(STEPS, seed));
        let result = in_time(&mut client, REQUESTS, |client| client.load(&program, &steps));
        match result {
            Ok(()) => {
                loaded += 1;
                client.link().set_faults(Faults::NONE, Faults::NONE);
                // What is still under way must not change the schedule either.
                client.link().idle(Duration::from_secs(1));
                let run = client.arm().unwrap();
                client.start().unwrap();
                client.link().idle(Duration::from_secs(1));
                assert_eq!(client.status().unwrap().state, State::Done);
                check_played(client.link(), run, &program, &steps);
            }
            Err(DeviceError::Timeout { request, .. }) => {
                given_up += 1;
                assert!(matches!(request, "load" | "append"));
                // A table of which a part is missing cannot be fired.
                client.link().reconnect();
                client.open_session(2).unwrap();
                let state = client.status().unwrap().state;
                if state == State::Idle {
                    let refused = Fault::Refused {
                        command: Command::Arm,
                        state,
                    };
                    assert_eq!(client.arm().unwrap_err().fault(), Some(refused));
                }
                // And another attempt is no worse off.
                client.load(&program, &steps).unwrap();
            }
            Err(other) => panic!("seed {seed}: {other}"),
        }
        check(client.link());
    }
    println!("{loaded} loaded, {given_up} given up");
    assert!(loaded > 150 && given_up > 10);
}

#[test]
fn a_bad_step_is_named_over_any_line() {
    let mut named = 0;
    for seed in 0..100 {
        let link = MockLink::new(Controller::new(&[]), Faults::NONE, Faults::NONE, seed);
        let mut client = Device::connect(link, 1, PATIENCE).unwrap();
        client.link().set_faults(Faults::any(seed), Faults::any(!seed));
        let bad = seed as usize % STEPS;
        let mut steps = steps(STEPS, seed);
        steps[bad].cam = Pulse::new(0, 1);
        match in_time(&mut client, REQUESTS, |client| {
            client.load(&table(STEPS, 1), &steps)
        }) {
            Err(DeviceError::Refused {
                fault,
                request: "append",
                ..
            }) => {
                assert_eq!(
                    fault,
                    Fault::EdgesTooClose {
                        step: bad as u64,
                        shortest: 3
                    }
                );
                named += 1;
            }
            Err(DeviceError::Timeout { .. }) => {}
            other => panic!("seed {seed}: {other:?}"),
        }
    }
    assert!(named > 50);
}

#[test]
fn what_can_never_fit_is_refused_before_it_is_sent() {
    let link = MockLink::new(Controller::new(&[]), Faults::NONE, Faults::NONE, 0);
    let mut client = Device::connect(link, 1, PATIENCE).unwrap();
    let limit = client.info().max_steps;
    let sent = client.link().sent().len();
    let many = vec![steps(1, 0)[0]; limit as usize + 1];
    let error = client.load(&table(many.len(), 1), &many).unwrap_err();
    assert!(
        matches!(error, DeviceError::TooLong { limit: l, found, .. } if l == limit && found == many.len())
    );
    let error = client.append(0, &many[..9], false).unwrap_err();
    assert!(
        matches!(
            error,
            DeviceError::TooLong {
                limit: 8,
                found: 9,
                ..
            }
        ),
        "{error}"
    );
    assert_eq!(client.link().sent().len(), sent);
}

#[test]
fn a_stream_is_fed_while_it_plays_over_any_line_of_a_stream() {
    let (mut whole, mut dry, mut given_up) = (0, 0, 0);
    for seed in 0..60 {
        let link = MockLink::new(Controller::new(&[]), Faults::NONE, Faults::NONE, seed);
        let mut client = Device::connect(link, 1, PATIENCE).unwrap();
        client
            .link()
            .set_faults(Faults::of_a_stream(seed), Faults::of_a_stream(!seed));
        let program = Program::new(Extent::Stream);
        let mut steps = steps(800, seed);
        for step in &mut steps {
            step.period += Ticks(125_000);
        }
        let result = (|| {
            client.begin(&program)?;
            for (batch, chunk) in steps.chunks(8).enumerate() {
                client.append(batch as u64 * 8, chunk, batch == 99)?;
                if batch == 20 {
                    client.arm()?;
                    client.start()?;
                }
            }
            Ok(())
        })();
        client.link().reconnect();
        client.link().idle(Duration::from_secs(2));
        client.open_session(2).unwrap();
        let status = client.status().unwrap();
        match (result, status.fault) {
            (Ok(()), None) => {
                assert_eq!((status.state, status.steps_done), (State::Done, 800));
                check_played(client.link(), 1, &program, &steps);
                whole += 1;
            }
            // Too slow: the run has ended between steps, all that was played was right, and it says where.
            (
                Err(DeviceError::Refused {
                    fault:
                        Fault::Refused {
                            state: State::Fault, ..
                        },
                    ..
                }),
                Some(fault),
            ) => {
                let Fault::Underrun { step } = fault else {
                    panic!("seed {seed}: {fault}")
                };
                assert_eq!(status.steps_done, step.0);
                check_played(client.link(), 1, &program, &steps[..step.0 as usize]);
                dry += 1;
            }
            (Err(DeviceError::Timeout { .. }), _) => given_up += 1,
            other => panic!("seed {seed}: {other:?}"),
        }
        check(client.link());
    }
    println!("{whole} whole, {dry} ran dry, {given_up} given up");
    assert!(whole > 20 && dry > 0);
}
