//! Law: whatever is at the other end, `connect` ends in time with an error that says what is wrong.

use std::time::Duration;

use rcg::capture::device::{Device, DeviceError};
use rcg::capture::link::Link;
use rcg_protocol::{Aux, AuxPolarity, Event, PROTOCOL_VERSION, Polarity, SCHEMA_HASH, SPOKEN, State};
use rcg_tests::books::{PATIENCE, in_time, steps, table};
use rcg_tests::older::Older;
use rcg_tests::strangers::{Echo, Noise, OtherVersion, Silent};
use rcg_tests::{Controller, Faults, MockLink, Peer};

/// Connects to `peer` and returns the error, and the time that it took.
fn refused<P: Peer + std::fmt::Debug>(peer: P, seed: u64) -> (DeviceError, Duration) {
    let link = MockLink::new(peer, Faults::NONE, Faults::NONE, seed);
    let watch = link.another(Faults::NONE, Faults::NONE, seed);
    let error = Device::connect(link, 1, PATIENCE).expect_err("no controller is there");
    (error, watch.now())
}

fn assert_timeout((error, took): (DeviceError, Duration), found: &str) {
    let most = PATIENCE.timeout * PATIENCE.attempts;
    match &error {
        DeviceError::Timeout {
            request: "hello",
            attempts: 8,
            waited_s,
            ..
        } => {
            assert!((waited_s - most.as_secs_f64()).abs() < 0.001);
        }
        other => panic!("{other}"),
    }
    let sentence = error.to_string();
    assert!(
        sentence.starts_with(&format!("port mock: expected an RCG trigger box, found {found}")),
        "{sentence}"
    );
    assert!(sentence.ends_with(" after 8 attempts in 0.4 s"), "{sentence}");
    assert!(took <= most, "took {took:?}");
}

#[test]
fn a_silent_peer_is_a_timeout() {
    assert_timeout(refused(Silent, 0), "nothing that answers");
}

#[test]
fn noise_is_a_timeout() {
    for seed in 0..50 {
        assert_timeout(refused(Noise::new(seed), seed), "something else: ");
    }
}

#[test]
fn an_echo_is_a_timeout() {
    assert_timeout(refused(Echo::default(), 0), "something else: ");
}

#[test]
fn another_protocol_version_or_schema_is_named_and_asked_nothing_else() {
    for (version, schema) in [
        (PROTOCOL_VERSION + 1, SCHEMA_HASH),
        (1, SCHEMA_HASH),
        (PROTOCOL_VERSION, !SCHEMA_HASH),
        (PROTOCOL_VERSION + 1, 1),
        (u16::MAX, 0),
    ] {
        let link = MockLink::new(OtherVersion::new(version, schema), Faults::NONE, Faults::NONE, 0);
        let watch = link.another(Faults::NONE, Faults::NONE, 0);
        let error = Device::connect(link, 1, PATIENCE).expect_err("it is of another version");
        match &error {
            DeviceError::OtherVersion {
                version: v,
                schema: s,
                ..
            } => assert_eq!((*v, *s), (version, schema)),
            other => panic!("{other}"),
        }
        let text = error.to_string();
        assert!(
            text.contains(&format!("version {version} (schema {schema:016x})")),
            "{text}"
        );
        assert_eq!(watch.peer_mut(|peer| peer.misunderstood), 0);
    }
    // The same peer with our version and schema gets past that: the test tells one from the other.
    let (error, _) = refused(OtherVersion::new(PROTOCOL_VERSION, SCHEMA_HASH), 0);
    assert!(
        matches!(
            error,
            DeviceError::Timeout {
                request: "describe",
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn another_version_over_any_line_is_named_or_times_out() {
    let mut named = 0;
    for seed in 0..200 {
        let link = MockLink::new(
            OtherVersion::new(PROTOCOL_VERSION + 1, 4),
            Faults::any(seed),
            Faults::any(!seed),
            seed,
        );
        match Device::connect(link, 1, PATIENCE) {
            Err(DeviceError::OtherVersion {
                version, schema: 4, ..
            }) if version == PROTOCOL_VERSION + 1 => named += 1,
            Err(DeviceError::Timeout { request: "hello", .. }) => {}
            other => panic!("seed {seed}: {other:?}"),
        }
    }
    assert!(named > 150);
}

#[test]
fn a_controller_that_falls_silent_is_a_timeout_for_every_request() {
    let link = MockLink::new(Controller::new(&[]), Faults::NONE, Faults::NONE, 0);
    let mut client = Device::connect(link, 1, PATIENCE).unwrap();
    let deaf = Faults {
        lose_chunk: 1.0,
        ..Faults::NONE
    };
    for (down, up) in [(deaf, Faults::NONE), (Faults::NONE, deaf)] {
        client.link().set_faults(down, up);
        let expect = |name: &str, error: DeviceError| match error {
            DeviceError::Timeout { request, .. } => assert_eq!(request, name),
            other => panic!("{other}"),
        };
        expect("ping", in_time(&mut client, 1, |c| c.ping(1)).unwrap_err());
        expect("status", in_time(&mut client, 1, Device::status).unwrap_err());
        expect("arm", in_time(&mut client, 1, Device::arm).unwrap_err());
        expect("start", in_time(&mut client, 1, Device::start).unwrap_err());
        expect("stop", in_time(&mut client, 1, Device::stop).unwrap_err());
        expect("abort", in_time(&mut client, 1, Device::abort).unwrap_err());
        expect("clear", in_time(&mut client, 1, Device::clear).unwrap_err());
        expect(
            "hello",
            in_time(&mut client, 1, |c| c.open_session(9)).unwrap_err(),
        );
        let began = client.link().now();
        assert_eq!(client.next_event(Duration::from_millis(70)).unwrap(), None);
        assert_eq!(
            client.link().now().saturating_sub(began),
            Duration::from_millis(70)
        );
    }
    client.link().set_faults(Faults::NONE, Faults::NONE);
    client.open_session(10).unwrap();
}

/// It is spoken to in what it knows, and asked nothing else: what it lacks is told in a sentence.
#[test]
fn a_controller_of_a_version_before_does_all_that_it_can() {
    for (version, schema) in SPOKEN.into_iter().take(4) {
        assert_ne!(schema, SCHEMA_HASH);
        of_version(version);
    }
}

fn of_version(version: u16) {
    let link = MockLink::new(Older::new(version), Faults::NONE, Faults::NONE, 3);
    let watch = link.another(Faults::NONE, Faults::NONE, 3);
    let mut client = Device::connect(link, 1, PATIENCE).unwrap();
    assert_eq!(client.protocol(), version);
    assert_eq!(client.unit().unwrap().is_some(), version > 1);
    if version < 3 {
        let polarity = Polarity::default();
        for error in [
            client.watch().unwrap_err(),
            client.inputs().unwrap_err(),
            client.boot().unwrap_err(),
            client.keep(polarity).unwrap_err(),
            client.kept().unwrap_err(),
        ] {
            let found = format!("protocol version 3 or later), found version {version}: ");
            assert!(error.to_string().contains(&found), "{error}");
        }
    }
    if version < 4 {
        for error in [
            client.aux(&Aux::default()).unwrap_err(),
            client.keep_aux(AuxPolarity::default()).unwrap_err(),
            client.kept_aux().unwrap_err(),
            client.photo().unwrap_err(),
            client.repeat(2).unwrap_err(),
        ] {
            let found = format!("protocol version 4 or later), found version {version}: ");
            assert!(error.to_string().contains(&found), "{error}");
        }
    }
    for error in [client.stored().unwrap_err(), client.forget().unwrap_err()] {
        let found = format!("protocol version 5 or later), found version {version}: ");
        assert!(error.to_string().contains(&found), "{error}");
    }
    client.load(&table(10, 3), &steps(10, 0)).unwrap();
    client.arm().unwrap();
    client.start().unwrap();
    let mut records = 0;
    while let Some(event) = client.next_event(Duration::from_millis(500)).unwrap() {
        if let Event::Records { records: some, .. } = event {
            records += some.len();
        }
    }
    let status = client.status().unwrap();
    assert_eq!((status.state, status.steps_done, records), (State::Done, 30, 30));
    assert_eq!(watch.peer_mut(|peer| peer.misunderstood), 0);
    // One of this version says more.
    let link = MockLink::new(Controller::new(&[]), Faults::NONE, Faults::NONE, 3);
    let mut client = Device::connect(link, 1, PATIENCE).unwrap();
    assert_eq!(client.protocol(), PROTOCOL_VERSION);
    assert!(client.unit().unwrap().is_some());
}
