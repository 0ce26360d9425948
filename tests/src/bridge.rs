//! A trigger box at a pseudo terminal, with a bridge at its wires: what the virtual rig meets outside of its process.
//!
//! # Design
//! The box of the firmware's library, in a thread. Its time is virtual: it stands still
//! until the rig has answered an edge, and passes quickly otherwise. Its dead-man switch is not polled, because the
//! host's signs of life come in real time.

use std::fs::File;
use std::io::{BufRead as _, BufReader, ErrorKind, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use rcg_firmware::pulse::Edge;
use rcg_firmware::virtual_time::{Pins, StrobeEdge, VirtualBox};
use rcg_protocol::{Level, Line, Ticks};
use serialport::{SerialPort as _, TTYPort};

/// Ticks per second.
pub const CLOCK_HZ: u32 = 125_000_000;

/// The box, until it is dropped.
#[derive(Debug)]
pub struct Bridge {
    /// Name of its port.
    pub port: String,
    /// Where the bridge listens.
    pub wires: String,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Bridge {
    /// A box whose clock shows `now`, and that tells edges of STROBE `late` ticks late, as counters of a board may.
    ///
    /// # Panics
    /// If the system has no pseudo terminals or no local network.
    #[must_use]
    pub fn new(now: Ticks, late: Ticks) -> Self {
        let (mut master, slave) = TTYPort::pair().expect("the system has pseudo terminals");
        master
            .set_timeout(Duration::from_millis(1))
            .expect("a time-out can be set");
        let port = slave.name().expect("the port has a name");
        // While the path is open somewhere, clients may come and go.
        let held = File::open(&port).expect("the port can be opened");
        drop(slave);
        let listener = TcpListener::bind("127.0.0.1:0").expect("there is a local network");
        listener.set_nonblocking(true).expect("a listener need not block");
        let wires = listener.local_addr().expect("it is bound").to_string();
        let over = Arc::new(AtomicBool::new(false));
        let mut bench = Bench {
            master,
            _held: held,
            listener,
            controller: VirtualBox::new(AtWires { rig: None, late }, CLOCK_HZ, 77, now),
        };
        let thread = thread::spawn({
            let over = Arc::clone(&over);
            move || {
                while !over.load(Ordering::Relaxed) {
                    bench.turn();
                }
            }
        });
        Self {
            port,
            wires,
            over,
            thread: Some(thread),
        }
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let ended = thread.join();
            assert!(ended.is_ok() || thread::panicking(), "the bridge panicked");
        }
    }
}

struct Bench {
    master: TTYPort,
    _held: File,
    listener: TcpListener,
    controller: VirtualBox<AtWires>,
}

impl Bench {
    fn turn(&mut self) {
        if let Ok((stream, _)) = self.listener.accept() {
            self.controller.pins().rig = Rig::greet(stream);
        }
        let is_running = self.controller.is_running();
        if !is_running || self.master.bytes_to_read().is_ok_and(|count| count > 0) {
            let mut bytes = [0; 512];
            // Nothing came in time.
            let count = self.master.read(&mut bytes).unwrap_or(0);
            self.controller
                .hear(&bytes[..count], |frame| say(&mut self.master, frame));
        }
        self.controller.advance(Ticks(u64::MAX));
        self.controller.act(|frame| say(&mut self.master, frame));
    }
}

/// Waits for a client that reads slowly; what none reads is lost.
fn say(master: &mut TTYPort, mut frame: &[u8]) {
    let patience = Instant::now() + Duration::from_secs(1);
    while !frame.is_empty() && Instant::now() < patience {
        match master.write(frame) {
            Ok(count) => frame = &frame[count..],
            Err(error) if error.kind() == ErrorKind::TimedOut => {}
            Err(error) => panic!("the port fails: {error}"),
        }
    }
}

/// What the rig at the wires, if one is there, does at the pins.
struct AtWires {
    rig: Option<Rig>,
    late: Ticks,
}

impl Pins for AtWires {
    fn edge(&mut self, edge: Edge) -> Option<StrobeEdge> {
        let line = if edge.line == Line::Proj { "proj" } else { "cam" };
        let level = u8::from(edge.level == Level::Active);
        let said = self
            .rig
            .as_mut()?
            .ask(&format!("edge {} {line} {level}\n", edge.at.0));
        if said.is_none() {
            self.rig = None;
        }
        let said = said?;
        let words: Vec<&str> = said.first()?.split(' ').collect();
        let ["drive", tick, "strobe", level] = words[..] else {
            panic!("the rig says {said:?}");
        };
        Some(StrobeEdge {
            at: Ticks(tick.parse().expect("a number")) + self.late,
            active: level == "1",
        })
    }

    fn next_sync(&mut self, from: Ticks) -> Option<Ticks> {
        let (first, period) = self.rig.as_ref()?.vsync?;
        let periods = from.0.saturating_sub(first).div_ceil(period);
        Some(Ticks(first + periods * period))
    }
}

/// The rig at the other end of the wires.
struct Rig {
    stream: BufReader<TcpStream>,
    vsync: Option<(u64, u64)>,
}

impl Rig {
    fn greet(stream: TcpStream) -> Option<Self> {
        stream.set_nonblocking(false).expect("a stream may block");
        stream.set_nodelay(true).expect("lines are sent at once");
        let mut rig = Self {
            stream: BufReader::new(stream),
            vsync: None,
        };
        let said = rig.ask(&format!("clock {CLOCK_HZ}\n"))?;
        rig.vsync = said.iter().find_map(|line| {
            let mut numbers = line
                .strip_prefix("vsync ")?
                .split(' ')
                .map(|number| number.parse().expect("numbers"));
            Some((numbers.next()?, numbers.next()?))
        });
        Some(rig)
    }

    /// What the rig says up to its `ok`; `None` if it has gone.
    fn ask(&mut self, line: &str) -> Option<Vec<String>> {
        self.stream.get_mut().write_all(line.as_bytes()).ok()?;
        let mut said = Vec::new();
        loop {
            let mut line = String::new();
            if self.stream.read_line(&mut line).ok()? == 0 {
                return None;
            }
            match line.trim_end() {
                "ok" => return Some(said),
                other => said.push(other.to_owned()),
            }
        }
    }
}
