//! A scripted bridge at the other end of the wires.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;

use super::*;
use crate::capture::camera::{Camera as _, CameraError};
use crate::capture::projector::Projector as _;
use crate::instrument::rig::Rig;
use crate::plan::Faults;
use crate::virtual_rig::scene::Scene;
use crate::virtual_rig::{Behaviour, Held, Noise, Truth, VirtualCamera, VirtualProjector, VirtualRig};

fn rig() -> Rig {
    Rig::load("rcg-1-16bit").unwrap().with_image_size(16).unwrap()
}

fn wired(address: &str) -> Result<(VirtualCamera, VirtualProjector), WiresError> {
    let behaviour = Behaviour {
        noise: Noise::Off,
        seed: 1,
        faults: Faults::default(),
        lamp_h: 0.0,
    };
    let sample = Arc::from(crate::brdf::sample::parse("lambert:0.5").unwrap());
    let truth = Truth::of(&rig());
    let scene = Arc::new(Scene::new(&truth, Held::Sample(sample)));
    VirtualRig::wired(scene, &truth, behaviour, Wires::connect(address)?)
}

/// Lets `bridge` serve one connection, while `test` has its address.
fn with_bridge(bridge: impl FnOnce(Bridge) + Send, test: impl FnOnce(&str)) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    thread::scope(|scope| {
        scope.spawn(|| bridge(Bridge(BufReader::new(listener.accept().unwrap().0))));
        test(&address);
    });
}

struct Bridge(BufReader<TcpStream>);

impl Bridge {
    fn tell(&mut self, line: &str) {
        writeln!(self.0.get_mut(), "{line}").unwrap();
    }

    /// The lines up to `ok`, without it.
    fn ask(&mut self, line: &str) -> Vec<String> {
        self.tell(line);
        let mut answer = Vec::new();
        loop {
            let mut line = String::new();
            assert!(
                self.0.read_line(&mut line).unwrap() > 0,
                "the rig went away after {answer:?}"
            );
            match line.as_str() {
                "ok\n" => return answer,
                _ => answer.push(line.trim_end().to_owned()),
            }
        }
    }
}

#[test]
fn edges_expose_and_the_strobe_answers() {
    let bridge = |mut bridge: Bridge| {
        // The clock is the bridge's own.
        let period = (rig().projector.min_period_s * 1e8).round();
        assert_eq!(
            bridge.ask("clock 100000000"),
            [format!("vsync {period} {period} 5000")]
        );
        assert!(bridge.ask("edge 1000 proj 1").is_empty());
        assert!(bridge.ask("edge 1500 proj 0").is_empty());
        // The camera's delay of 5 µs.
        assert_eq!(bridge.ask("edge 4000000 cam 1"), ["drive 4000500 strobe 1"]);
        assert_eq!(bridge.ask("edge 5000000 cam 0"), ["drive 5000500 strobe 0"]);
    };
    with_bridge(bridge, |address| {
        let (mut camera, mut projector) = wired(address).unwrap();
        let (width_px, height_px) = projector.size_px();
        projector
            .load(&crate::plan::pattern::BitPattern::black(width_px, height_px))
            .unwrap();
        camera.arm().unwrap();
        let frame = loop {
            match camera.next_frame(Duration::ZERO) {
                Ok(None) => thread::yield_now(),
                Ok(Some(frame)) => break frame,
                Err(error) => panic!("{error}"),
            }
        };
        assert_eq!(frame.id, 0);
        // Its clock begins with the first trigger, whenever that comes.
        assert!(
            (frame.timestamp_s - 1_000.0).abs() < 1e-9,
            "{}",
            frame.timestamp_s
        );
    });
}

fn failure(camera: &mut VirtualCamera) -> String {
    loop {
        match camera.next_frame(Duration::ZERO) {
            Ok(None) => thread::yield_now(),
            Err(CameraError::Failed { reason, .. }) => return reason,
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn a_bridge_that_goes_or_talks_nonsense_is_named_with_what_it_said() {
    for (lines, parts) in [
        (&[][..], ["the connection has ended", ""]),
        (
            &["edge 5 strobe 1"][..],
            ["expected `edge TICK proj|cam 0|1`", "found `edge 5 strobe 1`"],
        ),
        (&["edge 5 proj 1 "][..], ["expected", "found `edge 5 proj 1 `"]),
        (
            &["edge 7 proj 1", "edge 6 proj 0"][..],
            ["ticks that never decrease", "found `edge 6 proj 0`"],
        ),
        (&["ok"][..], ["expected", "found `ok`"]),
    ] {
        let bridge = |mut bridge: Bridge| {
            bridge.ask("clock 125000000");
            for line in lines {
                bridge.tell(line);
            }
            if !lines.is_empty() {
                // Until the rig gives up.
                std::io::copy(&mut bridge.0, &mut std::io::sink()).ok();
            }
        };
        with_bridge(bridge, |address| {
            let (mut camera, _projector) = wired(address).unwrap();
            camera.arm().unwrap();
            let reason = failure(&mut camera);
            assert!(reason.starts_with(&format!("wires {address}: ")), "{reason}");
            assert!(
                parts.iter().all(|part| reason.contains(part)),
                "{lines:?}: {reason}"
            );
        });
    }
}

#[test]
fn no_bridge_and_no_clock_are_told_apart() {
    let error = |address: &str| wired(address).err().expect("no rig").to_string();
    assert!(error("nowhere").contains("expected HOST:PORT"));
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    assert!(error(&free.to_string()).contains("expected a bridge that listens, found none"));
    for hello in ["clock 0", "clock", "clock -5", "220 mail.example ready"] {
        with_bridge(
            |mut bridge| bridge.tell(hello),
            |address| {
                let sentence = error(address);
                assert!(
                    sentence.contains("expected `clock HZ`") && sentence.contains(hello),
                    "{sentence}"
                );
            },
        );
    }
}
