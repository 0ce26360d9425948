//! The literal bytes of the messages that version 2 added; those of version 1 are the same in it.
//!
//! If a test in this file fails, the wire has changed: do not change the test. Raise
//! `PROTOCOL_VERSION` and add a file for the new version beside this one.

use std::fmt::Write as _;

use rcg_protocol::{
    Chip, Decoder, Fault, Line, MAX_FRAME, Reply, Request, Reset, Response, SPOKEN, Seq, SessionId, StepId,
    Ticks, ToDevice, ToHost, Unit, encode,
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

fn answer(result: Result<Reply, Fault>) -> ToHost {
    ToHost::Response(Response {
        session: SessionId(0x1234),
        seq: Seq(7),
        result,
    })
}

#[test]
fn version_and_schema() {
    assert_eq!(SPOKEN[1], (2, 0xd033_3967_ff23_5268));
}

#[test]
fn who_it_is() {
    let identify = ToDevice {
        session: SessionId(0x1234),
        seq: Seq(7),
        request: Request::Identify,
    };
    check("Request::Identify", &identify, "09b424070ba2a7835400");
    let filter = ToDevice {
        request: Request::Filter { strobe: Ticks(250) },
        ..identify
    };
    check("Request::Filter", &filter, "0bb424070cfa017881410900");
    for (name, chip, reset, expected) in [
        (
            "RP2040, power-up",
            Chip::Rp2040,
            Reset::PowerOn,
            "0104b424071206afd6c0bbc19ae9b0e601cdd78e09010105c1a9938400",
        ),
        (
            "RP2350, hang",
            Chip::Rp2350,
            Reset::Hang,
            "0104b424071706afd6c0bbc19ae9b0e601cdd78e0901020194cab9d800",
        ),
        (
            "simulated, panic",
            Chip::Simulated,
            Reset::Panic,
            "0104b424071106afd6c0bbc19ae9b0e601cdd78e09010602acf9867300",
        ),
        (
            "RP2040, hard fault",
            Chip::Rp2040,
            Reset::HardFault,
            "0104b424071706afd6c0bbc19ae9b0e601cdd78e090101037bf89a1d00",
        ),
        (
            "RP2040, USB",
            Chip::Rp2040,
            Reset::UsbStuck,
            "0104b424071706afd6c0bbc19ae9b0e601cdd78e09010104d86dfe8300",
        ),
    ] {
        let unit = Unit {
            serial: 0xe661_a4d4_1770_2b2f,
            commit: 0x0123_abcd,
            modified: true,
            chip,
            reset,
        };
        check(name, &answer(Ok(Reply::Unit(unit))), expected);
    }
}

#[test]
fn faults() {
    for (name, fault, expected) in [
        (
            "Fault::SyncUnclear",
            Fault::SyncUnclear { step: StepId(300) },
            "010cb42407010eac024cf79bc100",
        ),
        (
            "SYNC",
            Fault::InputTooFast { line: Line::Sync },
            "010bb42407010f02b428f5dd00",
        ),
        (
            "STROBE",
            Fault::InputTooFast { line: Line::Strobe },
            "010bb42407010f032218f2aa00",
        ),
    ] {
        check(name, &answer(Err(fault)), expected);
    }
}
