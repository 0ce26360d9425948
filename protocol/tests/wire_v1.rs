//! The literal bytes of every message of version 1.
//!
//! If a test in this file fails, the wire has changed: do not change the test. Raise
//! `PROTOCOL_VERSION` and add a file for the new version beside this one.

use std::fmt::Write as _;

use rcg_protocol::{
    Command, Counters, Decoder, Event, Extent, Fault, Identity, Info, MAX_FRAME, Micros, Pace, Polarity,
    Program, Pulse, Reply, Request, Response, SPOKEN, Seq, SessionId, Start, State, Status, Step, StepFlags,
    StepId, StepRecord, Strobe, Ticks, ToDevice, ToHost, encode,
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
    assert_eq!(SPOKEN[0], (1, 0x82fe_7021_e662_6436));
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
        (
            "Request::Hello",
            Request::Hello { nonce: 0xdead_beef },
            "04b424070aeffdb6f50d8ea23b4300",
        ),
        ("Request::Describe", Request::Describe, "09b4240701bc4e56b400"),
        ("Request::Ping", Request::Ping(42), "0ab42407022a71dcf7e000"),
        ("Request::Status", Request::Status, "09b4240703902f585a00"),
        (
            "Request::Load",
            Request::Load(program),
            "05b4240704070190fd0101010201010bd0860380897a1b56c1c700",
        ),
        (
            "Request::Load",
            Request::Load(stream),
            "06b42407040101010201010bd0860380897a739a5e3700",
        ),
        (
            "Request::Append",
            Request::Append {
                first: 8,
                steps: [step, Step::default()].into_iter().collect(),
                last: true,
            },
            "07b4240705080209e209e807904ec566010101010601d9ce2c5200",
        ),
        ("Request::Arm", Request::Arm, "09b42407061fdb322a00"),
        ("Request::Start", Request::Start, "09b424070789eb355d00"),
        ("Request::Stop", Request::Stop, "09b424070818f68acd00"),
        ("Request::Abort", Request::Abort, "09b42407098ec68dba00"),
        ("Request::Clear", Request::Clear, "09b424070a3497842300"),
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
        (
            "Reply::Identity",
            Reply::Identity(identity),
            "0104b42407011101ef9bafcdf8acd1910163051914a1b400",
        ),
        (
            "Reply::Info",
            Reply::Info(info),
            "0104b424070201020115c0b2cd3b8020808001030580acc7f037b18b032900",
        ),
        ("Reply::Pong", Reply::Pong(42), "0104b4240707022a34942c5c00"),
        (
            "Reply::Status",
            Reply::Status(status),
            "0104b4240706030303ac021280a094a58d1d010203040506075b06642b00",
        ),
        (
            "Reply::Room",
            Reply::Room { steps: 4096 },
            "0104b4240708048020b53fe19800",
        ),
        (
            "Reply::Armed",
            Reply::Armed { run: 3 },
            "0104b424070705039f9adf5100",
        ),
    ] {
        check(name, &answer(Ok(message)), expected);
    }
}

#[test]
fn faults() {
    let refused = |command, state| Fault::Refused { command, state };
    for (name, message, expected) in [
        (
            "Fault::StaleSession",
            Fault::StaleSession,
            "0105b424070105da10816700",
        ),
        (
            "Load, Running",
            refused(Command::Load, State::Running),
            "0106b4240701010603027372bf00",
        ),
        (
            "Append, Idle",
            refused(Command::Append, State::Idle),
            "0107b4240701010105f913603f00",
        ),
        (
            "Arm, Idle",
            refused(Command::Arm, State::Idle),
            "0107b42407010102053a404d1400",
        ),
        (
            "Start, Loaded",
            refused(Command::Start, State::Loaded),
            "010cb4240701010301ed41517a00",
        ),
        (
            "Stop, Done",
            refused(Command::Stop, State::Done),
            "010cb4240701010404a5237a4500",
        ),
        (
            "Clear, Armed",
            refused(Command::Clear, State::Armed),
            "010cb4240701010502d1b702b500",
        ),
        (
            "Load, Aborted",
            refused(Command::Load, State::Aborted),
            "0106b42407010106068d8718cf00",
        ),
        (
            "Load, Stopped",
            refused(Command::Load, State::Stopped),
            "0106b424070101060537d6115600",
        ),
        (
            "Fault::EmptySchedule",
            Fault::EmptySchedule,
            "010ab424070102f6718f8900",
        ),
        (
            "Fault::TooManySteps",
            Fault::TooManySteps { limit: 4096 },
            "010cb4240701038020554e122500",
        ),
        (
            "Fault::TooManyWords",
            Fault::TooManyWords { limit: 16_384 },
            "010db4240701048080017eecf18d00",
        ),
        (
            "Fault::StepsOutOfOrder",
            Fault::StepsOutOfOrder {
                expected: 8,
                found: 16,
            },
            "010cb424070105081008101cf400",
        ),
        (
            "Fault::StreamFull",
            Fault::StreamFull { free: 3 },
            "010bb424070106036ba3307b00",
        ),
        (
            "Fault::EdgesTooClose",
            Fault::EdgesTooClose {
                step: 300,
                shortest: 3,
            },
            "010db424070107ac0203f167a84900",
        ),
        (
            "Fault::PulseOutsidePeriod",
            Fault::PulseOutsidePeriod { step: 1 },
            "010bb42407010801c9efbd0b00",
        ),
        (
            "Fault::PeriodTooLong",
            Fault::PeriodTooLong { step: 2 },
            "010bb42407010902328faf8b00",
        ),
        (
            "Fault::Underrun",
            Fault::Underrun { step: StepId(1000) },
            "010cb42407010ae8071e21ed2200",
        ),
        (
            "Fault::SyncTimeout",
            Fault::SyncTimeout { step: StepId(0) },
            "0106b42407010b059c8c975700",
        ),
        ("Fault::HostLost", Fault::HostLost, "010ab42407010cf15c376e00"),
        ("Fault::Engine", Fault::Engine, "010ab42407010d676c301900"),
        (
            "Load, Fault",
            refused(Command::Load, State::Fault),
            "0106b42407010106071bb71fb800",
        ),
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
            "02010a03c0b2cd3b452a730300",
        ),
        (
            "Event::Records",
            Event::Records {
                run: 3,
                records: [record, missed].into_iter().collect(),
            },
            "1001010302ab0297c3ef0101f104904e07ac02dca9f001060183ef8b5600",
        ),
        (
            "Event::SpuriousStrobe",
            Event::SpuriousStrobe {
                run: 3,
                on: Ticks(77),
            },
            "090102034df9023cb900",
        ),
        (
            "Event::Room",
            Event::Room { run: 3, steps: 128 },
            "0a0103038001c76735a700",
        ),
        (
            "Event::Ended",
            Event::Ended {
                run: 3,
                state: State::Fault,
                fault: Some(Fault::HostLost),
                steps_done: 32_400,
                at: Ticks(425_250_000),
            },
            "1301040307010c90fd01d099e3ca01ef21209e00",
        ),
    ] {
        check(name, &ToHost::Event(message), expected);
    }
}
