//! The literal bytes of every message of version 1.
//!
//! If a test in this file fails, the wire has changed: do not change the test. Raise
//! `PROTOCOL_VERSION` and add a file for the new version beside this one.

use std::fmt::Write as _;

use rcg_protocol::{
    Command, Counters, Decoder, Event, Extent, Fault, Identity, Info, MAX_FRAME, Micros, PROTOCOL_VERSION,
    Pace, Polarity, Program, Pulse, Reply, Request, Response, SCHEMA_HASH, Seq, SessionId, Start, State,
    Status, Step, StepFlags, StepId, StepRecord, Strobe, Ticks, ToDevice, ToHost, encode,
};

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").expect("writing to a string");
        text
    })
}

fn check<T>(name: &str, message: &T, expected: &str)
where
    T: serde::Serialize + serde::de::DeserializeOwned + PartialEq + std::fmt::Debug,
{
    let mut buffer = [0; MAX_FRAME];
    let frame = encode(message, &mut buffer).expect("fits");
    assert_eq!(hex(frame), expected, "{name}");
    let mut decoder = Decoder::new();
    let decoded: Vec<T> = frame
        .iter()
        .filter_map(|&b| decoder.push(b))
        .map(|m| m.expect("valid"))
        .collect();
    assert_eq!(decoded.as_slice(), std::slice::from_ref(message), "{name}");
}

fn request(request: Request) -> ToDevice {
    ToDevice {
        session: SessionId(0x1234),
        seq: Seq(7),
        request,
    }
}

fn answer(result: Result<Reply, Fault>) -> ToHost {
    ToHost::Response(Response {
        session: SessionId(0x1234),
        seq: Seq(7),
        result,
    })
}

#[test]
fn version_and_schema() {
    assert_eq!(PROTOCOL_VERSION, 1);
    assert_eq!(SCHEMA_HASH, 0);
}

#[test]
fn requests() {
    let program = Program {
        extent: Extent::Table {
            steps: 1,
            cycles: 32_400,
        },
        start: Start::OnSync,
        pace: Pace::EachOnSync,
        polarity: Polarity {
            cam_active_low: true,
            ..Polarity::default()
        },
        sync_timeout: Micros(50_000),
        dead_man: Micros(2_000_000),
    };
    let stream = Program {
        extent: Extent::Stream,
        start: Start::AtOnce,
        pace: Pace::FreeRunning,
        ..program
    };
    let step = Step {
        proj: Pulse::new(0, 1250),
        cam: Pulse::new(1000, 10_000),
        period: Ticks(13_125),
    };
    for (name, message, expected) in [
        ("Request::Hello", Request::Hello { nonce: 0xdead_beef }, "?"),
        ("Request::Describe", Request::Describe, "?"),
        ("Request::Ping", Request::Ping(42), "?"),
        ("Request::Status", Request::Status, "?"),
        ("Request::Load", Request::Load(program), "?"),
        ("Request::Load", Request::Load(stream), "?"),
        (
            "Request::Append",
            Request::Append {
                first: 8,
                steps: [step, Step::default()].into_iter().collect(),
                last: true,
            },
            "?",
        ),
        ("Request::Arm", Request::Arm, "?"),
        ("Request::Start", Request::Start, "?"),
        ("Request::Stop", Request::Stop, "?"),
        ("Request::Abort", Request::Abort, "?"),
        ("Request::Clear", Request::Clear, "?"),
    ] {
        check(name, &request(message), expected);
    }
}

#[test]
fn replies() {
    let status = Status {
        state: State::Running,
        run: 3,
        steps_done: 300,
        fault: None,
        now: Ticks(1_000_000_000_000),
        counters: Counters {
            frames: 1,
            corrupt: 2,
            repeated: 3,
            stale: 4,
            executed: 5,
            records_lost: 6,
            spurious_strobes: 7,
        },
    };
    let info = Info {
        firmware: (0, 1, 0),
        clock_hz: 125_000_000,
        max_steps: 4096,
        max_words: 16_384,
        shortest_free: 3,
        shortest_sync: 5,
        longest_period: Ticks(15_000_000_000),
    };
    let identity = Identity {
        protocol: 1,
        schema: 0x0123_4567_89ab_cdef,
        nonce: 99,
        session: SessionId(5),
    };
    for (name, message, expected) in [
        ("Reply::Identity", Reply::Identity(identity), "?"),
        ("Reply::Info", Reply::Info(info), "?"),
        ("Reply::Pong", Reply::Pong(42), "?"),
        ("Reply::Status", Reply::Status(status), "?"),
        ("Reply::Room", Reply::Room { steps: 4096 }, "?"),
        ("Reply::Armed", Reply::Armed { run: 3 }, "?"),
    ] {
        check(name, &answer(Ok(message)), expected);
    }
}

#[test]
fn faults() {
    let refused = |command, state| Fault::Refused { command, state };
    for (name, message, expected) in [
        ("Fault::StaleSession", Fault::StaleSession, "?"),
        ("Load, Running", refused(Command::Load, State::Running), "?"),
        ("Append, Idle", refused(Command::Append, State::Idle), "?"),
        ("Arm, Idle", refused(Command::Arm, State::Idle), "?"),
        ("Start, Loaded", refused(Command::Start, State::Loaded), "?"),
        ("Stop, Done", refused(Command::Stop, State::Done), "?"),
        ("Clear, Armed", refused(Command::Clear, State::Armed), "?"),
        ("Load, Aborted", refused(Command::Load, State::Aborted), "?"),
        ("Load, Stopped", refused(Command::Load, State::Stopped), "?"),
        ("Fault::EmptySchedule", Fault::EmptySchedule, "?"),
        ("Fault::TooManySteps", Fault::TooManySteps { limit: 4096 }, "?"),
        ("Fault::TooManyWords", Fault::TooManyWords { limit: 16_384 }, "?"),
        (
            "Fault::StepsOutOfOrder",
            Fault::StepsOutOfOrder {
                expected: 8,
                found: 16,
            },
            "?",
        ),
        ("Fault::StreamFull", Fault::StreamFull { free: 3 }, "?"),
        (
            "Fault::EdgesTooClose",
            Fault::EdgesTooClose {
                step: 300,
                shortest: 3,
            },
            "?",
        ),
        (
            "Fault::PulseOutsidePeriod",
            Fault::PulseOutsidePeriod { step: 1 },
            "?",
        ),
        ("Fault::PeriodTooLong", Fault::PeriodTooLong { step: 2 }, "?"),
        ("Fault::Underrun", Fault::Underrun { step: StepId(1000) }, "?"),
        ("Fault::SyncTimeout", Fault::SyncTimeout { step: StepId(0) }, "?"),
        ("Fault::HostLost", Fault::HostLost, "?"),
        ("Fault::Engine", Fault::Engine, "?"),
        ("Load, Fault", refused(Command::Load, State::Fault), "?"),
    ] {
        check(name, &answer(Err(message)), expected);
    }
}

#[test]
fn events() {
    let record = StepRecord {
        step: StepId(299),
        trigger: Ticks(3_924_375),
        strobe: Some(Strobe {
            delay: Ticks(625),
            width: Ticks(10_000),
        }),
        flags: StepFlags(0),
    };
    let missed = StepRecord {
        step: StepId(300),
        trigger: Ticks(3_937_500),
        strobe: None,
        flags: StepFlags::MISSED,
    };
    for (name, message, expected) in [
        (
            "Event::Started",
            Event::Started {
                run: 3,
                at: Ticks(125_000_000),
            },
            "?",
        ),
        (
            "Event::Records",
            Event::Records {
                run: 3,
                records: [record, missed].into_iter().collect(),
            },
            "?",
        ),
        (
            "Event::SpuriousStrobe",
            Event::SpuriousStrobe {
                run: 3,
                on: Ticks(77),
            },
            "?",
        ),
        ("Event::Room", Event::Room { run: 3, steps: 128 }, "?"),
        (
            "Event::Ended",
            Event::Ended {
                run: 3,
                state: State::Fault,
                fault: Some(Fault::HostLost),
                steps_done: 32_400,
                at: Ticks(425_250_000),
            },
            "?",
        ),
    ] {
        check(name, &ToHost::Event(message), expected);
    }
}
