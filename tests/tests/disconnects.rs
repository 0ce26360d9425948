//! Law: a link that ends in mid-frame is a named error, and a client that comes back goes on.

use std::time::Duration;

use rcg::capture::device::{Device, DeviceError};
use rcg::capture::link::{Link, LinkError};
use rcg_protocol::{Fault, Micros, Program, State};
use rcg_tests::books::{Client, PATIENCE, check, check_played, steps, table};
use rcg_tests::{Controller, Faults, MockLink};

fn connected() -> Client {
    let link = MockLink::new(Controller::new(&[]), Faults::NONE, Faults::NONE, 0);
    Device::connect(link, 1, PATIENCE).unwrap()
}

fn assert_gone<T: std::fmt::Debug>(result: Result<T, DeviceError>) {
    match result {
        Err(DeviceError::Link(LinkError::Disconnected { peer })) => assert_eq!(peer, "mock"),
        other => panic!("the link was cut: {other:?}"),
    }
}

#[test]
fn a_client_that_comes_back_in_mid_frame_goes_on() {
    let (program, steps) = (table(30, 1), steps(30, 0));
    for (upwards, cuts) in [(false, 0..600), (true, 0..60)] {
        for cut in cuts {
            let mut client = connected();
            let faults = Faults {
                cut_after: Some(cut),
                ..Faults::NONE
            };
            let (down, up) = if upwards {
                (Faults::NONE, faults)
            } else {
                (faults, Faults::NONE)
            };
            client.link().set_faults(down, up);
            let result = client.load(&program, &steps);
            if result.is_ok() {
                continue; // the whole schedule is shorter than this
            }
            assert_gone(result);
            assert_gone(client.ping(1));
            assert_gone(client.next_event(Duration::from_secs(1)));
            client.link().idle(Duration::from_millis(100));

            client.link().reconnect();
            let back = client.link().now();
            client.open_session(2).unwrap();
            let took = client.link().now().saturating_sub(back);
            assert!(
                took < PATIENCE.timeout,
                "cut after {cut} bytes: the first attempt failed"
            );
            client.load(&program, &steps).unwrap();
            client.arm().unwrap();
            client.start().unwrap();
            client.link().idle(Duration::from_millis(100));
            assert_eq!(client.status().unwrap().state, State::Done);
            check_played(client.link(), 1, &program, &steps);
            check(client.link());
        }
    }
}

#[test]
fn a_run_goes_on_without_its_host_unless_the_dead_man_says_otherwise() {
    let steps = steps(100, 0);
    for dead_man in [Micros(0), Micros(40_000)] {
        let mut client = connected();
        let program = Program {
            dead_man,
            ..table(100, 1)
        };
        client.load(&program, &steps).unwrap();
        client.arm().unwrap();
        client.start().unwrap();
        client.link().cut();
        assert_gone(client.status());
        client.link().idle(Duration::from_secs(1));
        client.link().reconnect();
        client.open_session(2).unwrap();
        let status = client.status().unwrap();
        let halted = client.link().peer_mut(|peer| peer.journal().halted);
        if dead_man == Micros(0) {
            assert_eq!((status.state, status.steps_done, halted), (State::Done, 100, 0));
            check_played(client.link(), 1, &program, &steps);
        } else {
            assert_eq!(
                (status.state, status.fault),
                (State::Fault, Some(Fault::HostLost))
            );
            assert_eq!(halted, 1);
            // Steps last a millisecond; this engine looks at the time every five, and the session counts 1.5 for it.
            assert!(
                (37..=45).contains(&status.steps_done),
                "{} steps",
                status.steps_done
            );
        }
    }
}

#[test]
fn cuts_at_random_over_bad_lines_end_in_a_session_that_works() {
    for seed in 0..200 {
        let cut = |seed: u64| Faults {
            cut_after: Some(seed * 7 % 1500),
            ..Faults::any(seed)
        };
        let link = MockLink::new(Controller::new(&[]), cut(seed), cut(!seed / 8), seed);
        // `connect` takes the link with it when it fails; a second end stands for opening the port again.
        let spare = link.another(Faults::NONE, Faults::NONE, seed);
        let first = Device::connect(link, 1, PATIENCE).and_then(|mut client| {
            client.load(&table(30, 1), &steps(30, seed))?;
            client.arm()?;
            client.start()?;
            for number in 0..100 {
                client.ping(number)?;
            }
            Ok(())
        });
        match first {
            Ok(()) | Err(DeviceError::Timeout { .. } | DeviceError::Link(LinkError::Disconnected { .. })) => {
            }
            Err(other) => panic!("seed {seed}: {other}"),
        }
        // What is under way arrives, then the port is opened again.
        spare.idle(Duration::from_millis(500));
        let mut client = Device::connect(spare, 2, PATIENCE).unwrap();
        client.abort().unwrap();
        client.load(&table(30, 1), &steps(30, seed)).unwrap();
        let run = client.arm().unwrap();
        client.start().unwrap();
        client.link().idle(Duration::from_millis(100));
        assert_eq!(client.status().unwrap().state, State::Done);
        check_played(client.link(), run, &table(30, 1), &steps(30, seed));
    }
}
