//! Ports without a trigger box, or with one that answers wrongly.

use std::io::{Read as _, Write as _};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use rcg_protocol::{
    Decoder, Identity, Info, MAX_FRAME, PROTOCOL_VERSION, Reply, Request, Response, SCHEMA_HASH, SPOKEN,
    SessionId, Status, Ticks, ToDevice, ToHost, encode,
};
use serialport::{SerialPort as _, TTYPort};

use crate::command::{quick, refuses, run, text};

/// Runs `test` with the name of a port at whose other end `answer` answers what it is asked.
fn with_peer(answer: impl Fn(&Request) -> Option<Reply> + Sync, test: impl FnOnce(&str)) {
    // The port is held open here too, so that the peer outlives the command's runs.
    let (mut peer, port) = TTYPort::pair().expect("the system has pseudo terminals");
    peer.set_timeout(Duration::from_millis(20))
        .expect("a time-out can be set");
    let name = port.name().expect("the port has a name");
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            let mut decoder = Decoder::new();
            let mut bytes = [0; 256];
            while !over.load(Ordering::Relaxed) {
                // Nothing came within the time-out, or nobody has the port open.
                let count = peer.read(&mut bytes).unwrap_or(0);
                for &byte in &bytes[..count] {
                    let Some(Ok(asked)) = decoder.push::<ToDevice>(byte) else {
                        continue;
                    };
                    let Some(reply) = answer(&asked.request) else {
                        continue;
                    };
                    let response = ToHost::Response(Response {
                        session: asked.session,
                        seq: asked.seq,
                        result: Ok(reply),
                    });
                    let mut frame = [0; MAX_FRAME];
                    let frame = encode(&response, &mut frame).expect("MAX_FRAME holds every message");
                    peer.write_all(frame).expect("the port takes an answer");
                }
            }
        });
        // The peer ends with the test, however that ends.
        let _over = Over(&over);
        test(&name);
    });
}

struct Over<'a>(&'a AtomicBool);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

fn identity(request: &Request, protocol: u16, schema: u64) -> Option<Reply> {
    match *request {
        Request::Hello { nonce } => Some(Reply::Identity(Identity {
            protocol,
            schema,
            nonce,
            session: SessionId(1),
        })),
        _ => None,
    }
}

#[test]
fn a_port_that_does_not_exist_is_refused_with_those_that_do() {
    for port in ["/dev/ttyNONE99", "COM99"] {
        let ports = serialport::available_ports().unwrap_or_default();
        let there = if ports.is_empty() {
            "no serial ports"
        } else {
            &ports[0].port_name
        };
        let parts = [port, "expected a serial port", "found none of that name", there];
        refuses(&["controller", "info", "--port", port], "", 2, &parts);
    }
}

#[test]
fn a_file_that_is_no_port_fails() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let name = file.path().to_str().unwrap();
    refuses(
        &["controller", "info", "--port", name],
        "",
        1,
        &[name, "cannot be opened"],
    );
}

#[test]
fn a_port_that_another_program_holds_is_not_called_absent() {
    let (_peer, mut port) = TTYPort::pair().expect("the system has pseudo terminals");
    port.set_exclusive(true).expect("a port can be held");
    let name = port.name().expect("the port has a name");
    refuses(
        &["controller", "info", "--port", &name],
        "",
        1,
        &[
            &name,
            "expected a free port, found that another program has it open",
        ],
    );
}

#[test]
fn the_only_trigger_box_is_looked_for_unless_a_port_is_named() {
    // Whoever runs this may have one; what is said without one is tested beside the choice.
    for arguments in [
        &["controller", "info"][..],
        &["controller", "info", "--port", "auto"],
    ] {
        let outcome = run(arguments, "");
        if outcome.code != Some(0) {
            outcome.complains(2, &["port auto: expected one trigger box on USB", "found"]);
        }
    }
}

#[test]
fn a_port_that_says_something_else_is_told_from_a_silent_one() {
    let (mut peer, port) = TTYPort::pair().expect("the system has pseudo terminals");
    let name = port.name().expect("the port has a name");
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            while !over.load(Ordering::Relaxed) {
                // Nobody may be listening.
                peer.write_all(b"$GPGGA,no,trigger,box\r\n").ok();
                thread::sleep(Duration::from_millis(20));
            }
        });
        let _over = Over(&over);
        let outcome = run(&["controller", "info", "--port", &name], "");
        outcome.complains(1, &[&name, "expected an RCG trigger box, found something else"]);
    });
}

#[test]
fn a_trigger_box_of_another_version_is_named_with_both_versions() {
    with_peer(
        |request| identity(request, PROTOCOL_VERSION + 1, 0x0123_4567_89ab_cdef),
        |port| {
            let ours = format!("expected protocol version {PROTOCOL_VERSION}");
            let theirs = format!("found version {}", PROTOCOL_VERSION + 1);
            let parts = [port, &ours, &theirs, "0123456789abcdef", "flash"];
            for action in ["info", "status", "abort"] {
                refuses(&["controller", action, "--port", port], "", 1, &parts);
            }
        },
    );
}

#[test]
fn an_older_trigger_box_is_told_what_it_lacks() {
    let older = |request: &Request| match request {
        Request::Hello { .. } => identity(request, SPOKEN[0].0, SPOKEN[0].1),
        Request::Describe => idle_box(request),
        _ => None, // it would not understand that
    };
    with_peer(older, |port| {
        let outcome = run(&["controller", "info", "--port", port], "");
        let lines = outcome.done();
        for part in ["older", "protocol 1", "flash this program's firmware"] {
            assert!(lines.contains(part), "{lines}");
        }
        let value = run(&["controller", "info", "--port", port, "--json"], "").object();
        assert!(value["serial"].is_null() && value["protocol"] == 1, "{value}");
        for action in ["probe", "selftest"] {
            let parts = [port, "protocol version 3 or later", "found version 1", "flash"];
            refuses(&["controller", action, "--port", port], "", 1, &parts);
        }
    });
}

#[test]
fn a_trigger_box_of_another_schema_is_named_too() {
    with_peer(
        |request| identity(request, PROTOCOL_VERSION, !SCHEMA_HASH),
        |port| {
            let (ours, theirs) = (format!("{SCHEMA_HASH:016x}"), format!("{:016x}", !SCHEMA_HASH));
            let parts = [port, "expected", &ours, "found", &theirs];
            refuses(&["controller", "info", "--port", port], "", 1, &parts);
        },
    );
}

#[test]
fn a_silent_port_fails_within_its_patience() {
    with_peer(
        |_| None,
        |port| {
            let parts = [
                port,
                "expected an RCG trigger box",
                "found nothing that answers after 10 attempts",
            ];
            refuses(&["controller", "info", "--port", port], "", 1, &parts);
        },
    );
}

#[test]
fn an_answer_of_another_kind_fails() {
    with_peer(
        |_| Some(Reply::Pong(7)),
        |port| {
            let parts = [port, "answer to `hello`", "another kind: pong"];
            refuses(&["controller", "info", "--port", port], "", 1, &parts);
        },
    );
}

#[test]
fn a_trigger_box_measures_with_its_wires_only() {
    let scratch = tempfile::tempdir().unwrap();
    let planned = scratch.path().join("planned");
    let plan = [
        "plan",
        "--step",
        "45",
        "--image-size",
        "8",
        "--exposure-ms",
        "9",
        "--out",
    ];
    run(&[&plan[..], &[text(&planned)]].concat(), "").done();
    let refused = |more: &[&str], parts: &[&str]| {
        let mut arguments = quick(&scratch.path().join("m"));
        arguments.extend(more.iter().map(|&argument| argument.to_owned()));
        refuses(&arguments, "", 2, parts);
        refuses(&[&["capture", text(&planned)], more].concat(), "", 2, parts);
    };
    for port in ["/dev/ttyACM0", "auto"] {
        let why = "name the drivers of a real camera and projector in the rig file";
        refused(
            &["--port", port],
            &["--port", port, "expected --wires HOST:PORT", why],
        );
    }
    for with_sim in [
        &["--wires", "localhost:1"][..],
        &["--wires", "localhost:1", "--port", "sim"],
    ] {
        refused(
            with_sim,
            &[
                "--wires localhost:1",
                "expected the --port",
                "found the simulated one",
            ],
        );
    }
    assert!(!scratch.path().join("m").exists(), "nothing was begun");
}

/// A trigger box with nothing to do.
fn idle_box(request: &Request) -> Option<Reply> {
    Some(match request {
        Request::Describe => Reply::Info(Info {
            firmware: (0, 1, 0),
            clock_hz: 125_000_000,
            max_steps: 1,
            max_words: 1,
            shortest_free: 3,
            shortest_sync: 5,
            longest_period: Ticks(1),
        }),
        Request::Abort | Request::Status => Reply::Status(Status::default()),
        _ => return identity(request, PROTOCOL_VERSION, SCHEMA_HASH),
    })
}

#[test]
fn wires_without_a_bridge_are_named() {
    with_peer(idle_box, |port| {
        let scratch = tempfile::tempdir().unwrap();
        let free = std::net::TcpListener::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap();
        for (wires, code, part) in [
            (free.to_string(), 1, "expected a bridge that listens, found none"),
            ("nowhere".to_owned(), 2, "expected HOST:PORT of a bridge"),
        ] {
            let mut arguments = quick(&scratch.path().join(&wires));
            arguments.extend(["--port", port, "--wires", &wires].map(str::to_owned));
            refuses(&arguments, "", code, &[&wires, part]);
        }
    });
}
