//! The literal bytes of the messages that version 3 added; those of the versions before are the same in it.
//!
//! If a test in this file fails, the wire has changed: do not change the test. Raise
//! `PROTOCOL_VERSION` and add a file for the new version beside this one.

use std::fmt::Write as _;

use rcg_protocol::{
    Command, Decoder, Fault, Input, Inputs, MAX_FRAME, Polarity, Reply, Request, Response, SPOKEN, Seq,
    SessionId, State, Ticks, ToDevice, ToHost, encode,
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

/// Active low: CAM and STROBE.
const POLARITY: Polarity = Polarity {
    proj_active_low: false,
    cam_active_low: true,
    sync_active_low: false,
    strobe_active_low: true,
};

#[test]
fn version_and_schema() {
    assert_eq!(SPOKEN[2], (3, 0x35dc_ce3f_25d4_e40d));
}

#[test]
fn requests() {
    for (name, request, expected) in [
        ("Request::Watch", Request::Watch, "09b424070d9702e0bd00"),
        ("Request::Inputs", Request::Inputs, "09b424070e2d53e92400"),
        ("Request::Boot", Request::Boot, "09b424070fbb63ee5300"),
        (
            "Request::Keep",
            Request::Keep(POLARITY),
            "05b42407100201060120e74c0700",
        ),
        ("Request::Kept", Request::Kept, "09b4240711d85ee1a900"),
    ] {
        let message = ToDevice {
            session: SessionId(0x1234),
            seq: Seq(7),
            request,
        };
        check(name, &message, expected);
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
fn answers() {
    let inputs = Inputs {
        at: Ticks(1_000_000),
        since: Ticks(300),
        sync: Input {
            high: true,
            pulled_up: false,
            edges: Some(70_000),
            last: [Some(Ticks(900_000)), Some(Ticks(900_125))],
        },
        strobe: Input {
            high: false,
            pulled_up: true,
            edges: None,
            last: [None, None],
        },
    };
    check(
        "Reply::Inputs",
        &answer(Ok(Reply::Inputs(inputs))),
        "0104b424070807c0843dac02010d01f0a20401a0f736019df836020101010576414e7700",
    );
    check(
        "Reply::Kept",
        &answer(Ok(Reply::Kept(POLARITY))),
        "0104b42407020802010601a5ba2c0800",
    );
    for (name, command, expected) in [
        ("Watch", Command::Watch, "010cb424070101060384d428e900"),
        ("Boot", Command::Boot, "010cb4240701010703c5e533f000"),
        ("Keep", Command::Keep, "010cb42407010108030af9ab7700"),
    ] {
        let state = State::Running;
        check(name, &answer(Err(Fault::Refused { command, state })), expected);
    }
}
