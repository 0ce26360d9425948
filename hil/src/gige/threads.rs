//! The camera's threads: control channel, broadcasts, free run.

use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::camera::{Idle, Shared, armed};
use super::gvcp;
use super::settings::TriggerSource;

/// How long a thread waits before it looks whether the camera is still on, and the client still there.
const TURN: Duration = Duration::from_millis(20);
/// How long the port of broadcasts is left to another camera until it is tried again.
const RETRY: Duration = Duration::from_millis(500);
/// Frames that are later than this are not made up for.
const FORGIVEN: Duration = Duration::from_millis(100);

/// Starts them.
pub(super) fn start(
    shared: &Arc<Shared>,
    socket: &Arc<UdpSocket>,
    threads: &mut Vec<JoinHandle<()>>,
) -> io::Result<()> {
    socket.set_read_timeout(Some(TURN))?;
    let mut spawn = |name: &str, work: Box<dyn FnOnce() + Send>| -> io::Result<()> {
        threads.push(thread::Builder::new().name(name.into()).spawn(work)?);
        Ok(())
    };
    let (all, own) = (Arc::clone(shared), Arc::clone(socket));
    spawn(
        "gige-control",
        Box::new(move || {
            while !all.ends() {
                serve(&all, &own, &own, |_| true);
                all.watch();
            }
        }),
    )?;
    let all = Arc::clone(shared);
    spawn("gige-free-run", Box::new(move || run_freely(&all)))?;
    if shared.settings.broadcast {
        let (all, own) = (Arc::clone(shared), Arc::clone(socket));
        spawn("gige-broadcast", Box::new(move || hear_broadcasts(&all, &own)))?;
    }
    Ok(())
}

/// Answers one datagram of `socket` that is `wanted` from `answers`, if one comes in time.
fn serve(shared: &Shared, socket: &UdpSocket, answers: &UdpSocket, wanted: fn(&[u8]) -> bool) {
    // Longer than any command: what is cut off is refused by its length.
    let mut datagram = [0; 1024];
    match socket.recv_from(&mut datagram) {
        Ok((length, SocketAddr::V4(from))) if wanted(&datagram[..length]) => {
            if let Some(answer) = shared.hear(from, &datagram[..length]) {
                // A client that is gone cannot be told.
                let _ = answers.send_to(&answer, from);
            }
        }
        Ok(_) => {}
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
        // Such as that an earlier answer found nobody.
        Err(_) => thread::sleep(Duration::from_millis(1)),
    }
}

fn hear_broadcasts(shared: &Shared, answers: &UdpSocket) {
    let mut tried = None;
    while !shared.ends() {
        if tried.is_some_and(|at: Instant| at.elapsed() < RETRY) {
            thread::sleep(TURN);
            continue;
        }
        tried = Some(Instant::now());
        let Ok(socket) = UdpSocket::bind((Ipv4Addr::BROADCAST, gvcp::PORT)) else {
            continue;
        };
        if socket.set_read_timeout(Some(TURN)).is_err() {
            continue;
        }
        while !shared.ends() {
            // Everything else is said to one camera.
            serve(shared, &socket, answers, |datagram| {
                datagram.get(2..4) == Some(&[0, 2])
            });
        }
    }
}

/// Sends test images at the camera's own pace while the frame trigger is off.
fn run_freely(shared: &Shared) {
    let mut next = Instant::now();
    while !shared.ends() {
        let control = shared.control();
        let config = control.config();
        if armed(&config, TriggerSource::Line1) != Err(Idle::FreeRunning) {
            // Whoever starts an acquisition, or opens its stream only then, is seen within a turn.
            let waited = shared.started.wait_timeout(control, TURN);
            drop(waited);
            next = Instant::now();
            continue;
        }
        drop(control);
        let now = Instant::now();
        if now < next {
            thread::sleep((next - now).min(TURN));
            continue;
        }
        if now - next > FORGIVEN {
            next = now;
        }
        // No faster than exposures follow each other.
        let exposure = Duration::from_secs_f64(config.exposure_us * 1e-6);
        let period = config
            .frame_rate_hz
            .map_or(exposure, |rate| exposure.max(Duration::from_secs_f64(1.0 / rate)));
        next += period;
        if !shared.expose_test_image(TriggerSource::Line1) {
            thread::sleep(TURN);
        }
    }
}
