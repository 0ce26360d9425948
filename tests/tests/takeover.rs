//! Law: a controller serves one session, the last that was opened, and tells the others.

use rcg::capture::device::Device;
use rcg_protocol::{Fault, State};
use rcg_tests::books::{PATIENCE, check_shared, steps, table};
use rcg_tests::{Controller, Faults, MockLink};

#[test]
fn a_second_client_takes_over_and_the_first_is_told() {
    let link = MockLink::new(Controller::new(&[]), Faults::NONE, Faults::NONE, 0);
    let other = link.another(Faults::NONE, Faults::NONE, 1);
    let mut first = Device::connect(link, 1, PATIENCE).unwrap();
    first.load(&table(20, 1), &steps(20, 0)).unwrap();
    let mut second = Device::connect(other, 2, PATIENCE).unwrap();
    let executed = second.status().unwrap().counters.executed;
    let stale = Some(Fault::StaleSession);
    assert_eq!(first.ping(1).unwrap_err().fault(), stale);
    assert_eq!(first.status().unwrap_err().fault(), stale);
    assert_eq!(
        first.load(&table(20, 1), &steps(20, 0)).unwrap_err().fault(),
        stale
    );
    assert_eq!(first.clear().unwrap_err().fault(), stale);
    assert_eq!(first.abort().unwrap_err().fault(), stale);
    // Nothing of that was done: the schedule is still there, for the second to fire.
    let status = second.status().unwrap();
    assert_eq!(
        (status.state, status.counters.executed),
        (State::Loaded, executed + 1)
    );
    assert_eq!(status.counters.stale, 5);
    assert_eq!(second.arm().unwrap(), 1);

    // And back.
    first.open_session(3).unwrap();
    assert_eq!(first.abort().unwrap().state, State::Aborted);
    assert_eq!(second.ping(1).unwrap_err().fault(), stale);
    check_shared(&[first.link(), second.link()]);
}

#[test]
fn clients_that_take_over_from_each_other_on_bad_lines_are_never_mistaken_for_each_other() {
    let (mut stale, mut served) = (0, 0);
    for seed in 0..200 {
        let link = MockLink::new(Controller::new(&[]), Faults::any(seed), Faults::any(!seed), seed);
        let other = link.another(Faults::any(seed + 1000), Faults::any(!seed - 1000), seed + 1);
        let Ok(mut first) = Device::connect(link, 1, PATIENCE) else {
            continue;
        };
        let Ok(mut second) = Device::connect(other, 2, PATIENCE) else {
            continue;
        };
        for round in 0..10 {
            for (client, mine) in [(&mut first, 0), (&mut second, 1)] {
                // Each wants its own number back and may only ever be given that.
                match client.ping(2 * round + mine) {
                    Ok(()) => served += 1,
                    Err(error) if error.fault() == Some(Fault::StaleSession) => {
                        stale += 1;
                        let opened = client.open_session(100 + 2 * round + mine);
                        served += u32::from(opened.and_then(|()| client.ping(mine)).is_ok());
                    }
                    Err(rcg::capture::device::DeviceError::Timeout { .. }) => {}
                    Err(other) => panic!("seed {seed}: {other}"),
                }
            }
        }
        check_shared(&[first.link(), second.link()]);
    }
    println!("{served} served, {stale} stale");
    assert!(served > 500 && stale > 500);
}
