//! Law: over whatever line, a command is executed at most once, and what the client is told is true.

use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg::capture::device::{Device, DeviceError};
use rcg_protocol::{Fault, State};
use rcg_tests::books::{Client, PATIENCE, check, check_played, in_time, steps, table};
use rcg_tests::{Controller, Faults, MockLink};

fn link(seed: u64, down: Faults, up: Faults) -> MockLink<Controller> {
    MockLink::new(Controller::new(&[]), down, up, seed)
}

/// Any command in any state; the controller may refuse it. What happened to it?
fn any_command(
    client: &mut Client,
    rng: &mut Xoshiro256PlusPlus,
    appended: &mut u64,
) -> Result<(), DeviceError> {
    match rng.random_range(0..10) {
        0 => client.ping(rng.random_range(0..100)),
        1 => client.status().map(|_| ()),
        2 => {
            let begun = client.begin(&table(16, 3));
            *appended = if begun.is_ok() { 0 } else { *appended };
            begun.map(|_| ())
        }
        3 | 4 => {
            let room = client.append(*appended, &steps(8, 0), false);
            *appended += if room.is_ok() { 8 } else { 0 };
            room.map(|_| ())
        }
        5 => client.arm().map(|_| ()),
        6 => client.start().map(|_| ()),
        7 => client.stop().map(|_| ()),
        8 => client.abort().map(|_| ()),
        _ => client.clear().map(|_| ()),
    }
}

#[test]
fn any_commands_over_any_line() {
    let (mut told, mut given_up) = (0, 0);
    let (mut repeated, mut stale, mut corrupt) = (0, 0, 0);
    for seed in 0..600 {
        let link = link(seed, Faults::any(2 * seed), Faults::any(2 * seed + 1));
        let Ok(mut client) = Device::connect(link, seed as u32, PATIENCE) else {
            given_up += 1;
            continue;
        };
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut appended = 0;
        for _ in 0..40 {
            let result = in_time(&mut client, 1, |client| {
                any_command(client, &mut rng, &mut appended)
            });
            let sent = client.link().sent();
            let asked = sent.last().expect("something was asked");
            let executed = client
                .link()
                .peer_mut(|peer| peer.journal().executed.iter().filter(|&m| m == asked).count());
            match result {
                Ok(()) => {
                    assert_eq!(executed, 1, "seed {seed}: {asked:?} was answered");
                    told += 1;
                }
                Err(DeviceError::Refused { fault, .. }) => {
                    assert_ne!(
                        fault,
                        Fault::StaleSession,
                        "seed {seed}: there is one session only"
                    );
                    assert_eq!(executed, 1, "seed {seed}: {asked:?} was refused");
                    told += 1;
                }
                Err(DeviceError::Timeout { .. }) => {
                    assert!(executed <= 1, "seed {seed}: {asked:?} was given up");
                    given_up += 1;
                }
                Err(other) => panic!("seed {seed}: {other}"),
            }
            if rng.random_bool(0.3) {
                client.link().idle(Duration::from_millis(rng.random_range(0..30)));
            }
        }
        check(client.link());
        let counters = client.link().peer_mut(|peer| *peer.session().counters());
        repeated += counters.repeated;
        stale += counters.stale;
        corrupt += counters.corrupt;
    }
    // The lines were bad enough to try everything, and good enough to get something done.
    println!("{told} answers, {given_up} given up; {repeated} repeated, {stale} stale, {corrupt} corrupt");
    assert!(told > 10_000 && given_up > 20);
    assert!(repeated > 500 && stale > 5 && corrupt > 1000);
}

#[test]
fn what_is_asked_in_the_right_order_is_never_refused() {
    let (mut whole, mut given_up) = (0, 0);
    for seed in 0..400 {
        let link = link(seed, Faults::any(3 * seed), Faults::any(3 * seed + 2));
        let (program, steps) = (table(20, 2), steps(20, seed));
        let mut client = None;
        let result = (|| {
            let client = client.insert(Device::connect(link, seed as u32, PATIENCE)?);
            for run in 1..=2 {
                client.load(&program, &steps)?;
                assert_eq!(client.arm()?, run);
                client.start()?;
                for _ in 0..100 {
                    if client.status()?.state != State::Running {
                        break;
                    }
                    client.link().idle(Duration::from_millis(5));
                }
                let status = client.status()?;
                assert_eq!(
                    (status.state, status.run, status.steps_done),
                    (State::Done, run, 40)
                );
                check_played(client.link(), run, &program, &steps);
            }
            Ok(())
        })();
        match result {
            Ok(()) => whole += 1,
            Err(DeviceError::Timeout { .. }) => given_up += 1,
            Err(other) => panic!("seed {seed}: {other}"),
        }
        if let Some(client) = client {
            check(client.link());
        }
    }
    println!("{whole} whole, {given_up} given up");
    assert!(whole > 200 && given_up > 5);
}

#[test]
fn a_good_line_repeats_nothing() {
    for longest_chunk in [1, 2, 3, 64] {
        let split = Faults {
            longest_chunk,
            ..Faults::NONE
        };
        let mut client = Device::connect(link(1, split, split), 5, PATIENCE).unwrap();
        client.load(&table(20, 1), &steps(20, 0)).unwrap();
        for number in 0..50 {
            client.ping(number).unwrap();
        }
        let counters = client.status().unwrap().counters;
        // Hello, describe, load, three batches, the pings, and this status.
        assert_eq!((counters.frames, counters.executed), (57, 57));
        assert_eq!((counters.corrupt, counters.repeated, counters.stale), (0, 0, 0));
        assert_eq!(client.corrupt_frames(), 0);
        check(client.link());
    }
}

#[test]
fn losses_only_make_fewer_frames_than_were_sent() {
    for seed in 0..100 {
        let lossy = Faults {
            lose_byte: 0.01,
            ..Faults::NONE
        };
        let Ok(mut client) = Device::connect(link(seed, lossy, lossy), 5, PATIENCE) else {
            continue;
        };
        for number in 0..50 {
            let _ = in_time(&mut client, 1, |client| client.ping(number));
        }
        let counters = client.link().peer_mut(|peer| *peer.session().counters());
        let sent = client.link().sent().len();
        assert!((counters.frames + counters.corrupt) as usize <= sent);
        assert!((counters.frames as usize) < sent, "seed {seed}: some were lost");
        check(client.link());
    }
}

#[test]
fn duplicates_are_answered_again_and_not_executed_again() {
    let twice = Faults {
        duplicate: 1.0,
        ..Faults::NONE
    };
    // A chunk is a frame or a part of one; a duplicated part spoils its frame, so many frames are sent.
    let mut client = Device::connect(link(3, Faults::NONE, Faults::NONE), 5, PATIENCE).unwrap();
    client.link().set_faults(
        Faults {
            longest_chunk: 4096,
            ..twice
        },
        Faults::NONE,
    );
    let mut repeated = 0;
    for number in 0..200 {
        match in_time(&mut client, 1, |client| client.ping(number)) {
            Ok(()) | Err(DeviceError::Timeout { .. }) => {}
            Err(other) => panic!("{other}"),
        }
        let counters = client.link().peer_mut(|peer| *peer.session().counters());
        repeated = counters.repeated;
    }
    assert!(repeated > 0);
    let arrived = client.link().down().duplicated as usize + client.link().sent().len();
    let counters = client.link().peer_mut(|peer| *peer.session().counters());
    assert!(counters.frames as usize <= arrived);
    check(client.link());
}
