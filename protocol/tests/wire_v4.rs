//! The literal bytes of the messages that version 4 added; those of the versions before are the same in it.
//!
//! If a test in this file fails, the wire has changed: do not change the test. Raise
//! `PROTOCOL_VERSION` and add a file for the new version beside this one.

use std::fmt::Write as _;

use rcg_protocol::{
    Aux, AuxPolarity, AuxPulse, Decoder, Event, Extent, Fault, Input, Line, MAX_FRAME, Photo, PhotoPulse,
    Program, Pulse, Reply, Request, Response, SPOKEN, Seq, SessionId, Start, Ticks, ToDevice, ToHost, encode,
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

/// Active low: AUX-B and START.
const POLARITY: AuxPolarity = AuxPolarity {
    a_active_low: false,
    b_active_low: true,
    photo_active_low: false,
    start_active_low: true,
};

#[test]
fn version_and_schema() {
    assert_eq!(SPOKEN[3], (4, 0x642b_c5ea_88d0_b9a3));
}

#[test]
fn requests() {
    let aux = Aux {
        polarity: POLARITY,
        a: AuxPulse::InStep(Pulse::new(300, 70_000)),
        b: AuxPulse::WithCam {
            after: Ticks(5),
            width: Ticks(128),
        },
        photo: true,
    };
    let program = Program {
        start: Start::OnStartLine,
        ..Program::new(Extent::Table { steps: 1, cycles: 2 })
    };
    for (name, request, expected) in [
        (
            "Request::Aux",
            Request::Aux(aux),
            "05b42407120201110101ac02f0a20402058001015dc403a700",
        ),
        (
            "Request::Aux at rest",
            Request::Aux(Aux::resting(POLARITY)),
            "05b42407120201020101010518f07ceb00",
        ),
        (
            "Request::KeepAux",
            Request::KeepAux(POLARITY),
            "05b424071302010601f09dec4000",
        ),
        ("Request::KeptAux", Request::KeptAux, "09b424071457aa8bd900"),
        ("Request::Photo", Request::Photo, "09b4240715c19a8cae00"),
        (
            "Request::Repeat",
            Request::Repeat { runs: 300 },
            "0bb4240716ac02b60c186d00",
        ),
        (
            "Request::Load on START",
            Request::Load(program),
            "05b42407040401020201010101010105cfb923f600",
        ),
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
fn answers_and_events() {
    let photo = Photo {
        input: Input {
            high: true,
            pulled_up: false,
            edges: Some(70_000),
            last: [None, Some(Ticks(900_125))],
        },
        pulses: 300,
    };
    let pulse = |on, width| PhotoPulse { on: Ticks(on), width };
    let pulses = [pulse(1_000, Some(Ticks(44))), pulse(900_000, None)];
    let event = Event::Photo {
        run: 3,
        first: 130,
        pulses: pulses.into_iter().collect(),
    };
    for (name, message, expected) in [
        (
            "Reply::KeptAux",
            answer(Ok(Reply::KeptAux(POLARITY))),
            "0104b4240702090201060115934c3500",
        ),
        (
            "Reply::Photo",
            answer(Ok(Reply::Photo(photo))),
            "0104b42407030a010501f0a20408019df836ac02f003455100",
        ),
        (
            "Fault::StartPaced",
            answer(Err(Fault::StartPaced)),
            "0107b424070110be03367a00",
        ),
        (
            "Fault::InputTooFast of PHOTO",
            answer(Err(Fault::InputTooFast { line: Line::Photo })),
            "010bb42407010f06adec98da00",
        ),
        (
            "Fault::InputTooFast of START",
            answer(Err(Fault::InputTooFast { line: Line::Start })),
            "010bb42407010f073bdc9fad00",
        ),
        (
            "Event::Photo",
            ToHost::Event(event),
            "0e010503820102e807012ca0f736056bcabfe600",
        ),
    ] {
        check(name, &message, expected);
    }
}
