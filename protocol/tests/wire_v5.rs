//! The literal bytes of the messages that version 5 added; those of the versions before are the same in it.
//!
//! If a test in this file fails, the wire has changed: do not change the test. Raise
//! `PROTOCOL_VERSION` and add a file for the new version beside this one.

use std::fmt::Write as _;

use rcg_protocol::{
    Command, Decoder, FIRST_PAGE, Fault, MAX_FRAME, PAGE_BYTES, PAGES, PROTOCOL_VERSION, Reply, Request,
    Response, SCHEMA_HASH, SPOKEN, Seq, SessionId, Start, State, Stored, ToDevice, ToHost, checksum, encode,
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

const STORED: Stored = Stored {
    clock_hz: 125_000_000,
    steps: 300,
    start: Start::OnStartLine,
    runs: 0,
    length: 70_000,
    sum: 0xcbf4_3926,
};

#[test]
fn version_and_schema() {
    assert_eq!((PROTOCOL_VERSION, SCHEMA_HASH), (5, 0xd973_79d9_b85f_9317));
    assert_eq!(SPOKEN[4], (5, SCHEMA_HASH));
}

#[test]
fn requests() {
    let page = |page, bytes: &[u8]| Request::Store {
        page,
        bytes: bytes.iter().copied().collect(),
    };
    for (name, request, expected) in [
        (
            "Request::Store",
            page(16, &[1, 0, 255]),
            "08b424071710030106ffe8585c0b00",
        ),
        (
            "Request::Store of nothing",
            page(0, &[]),
            "05b4240717010548f4668000",
        ),
        ("Request::Stored", Request::Stored, "09b42407187ce63dd000"),
    ] {
        let message = ToDevice {
            session: SessionId(0x1234),
            seq: Seq(7),
            request,
        };
        check(name, &message, expected);
    }
}

#[test]
fn answers() {
    let refused = Fault::Refused {
        command: Command::Store,
        state: State::Running,
    };
    for (name, result, expected) in [
        (
            "Reply::Stored",
            Ok(Reply::Stored(Some(STORED))),
            "0104b424070a0b01c0b2cd3bac02020df0a204a6f2d0df0c4ac0195700",
        ),
        (
            "Reply::Stored of nothing",
            Ok(Reply::Stored(None)),
            "0104b42407020b05abe6555600",
        ),
        ("Command::Store", Err(refused), "010cb42407010109034bc8b06e00"),
    ] {
        let message = ToHost::Response(Response {
            session: SessionId(0x1234),
            seq: Seq(7),
            result,
        });
        check(name, &message, expected);
    }
}

/// What is kept is on the wire and in memory alike.
#[test]
fn what_is_kept() {
    check("Stored", &STORED, "08c0b2cd3bac02020df0a204a6f2d0df0ccb9a22e500");
    assert_eq!((FIRST_PAGE, PAGES, PAGE_BYTES), (16, 512, 256));
    assert_eq!(checksum(b"123456789"), STORED.sum);
}

#[test]
fn a_whole_page_fits_into_a_frame() {
    let message = ToDevice {
        session: SessionId(u32::MAX),
        seq: Seq(u32::MAX),
        request: Request::Store {
            page: u16::MAX,
            bytes: [0xa5; PAGE_BYTES].into_iter().collect(),
        },
    };
    let mut buffer = [0; MAX_FRAME];
    assert!(encode(&message, &mut buffer).is_ok());
}
