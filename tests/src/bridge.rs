//! A trigger box at a pseudo terminal, with a bridge at its wires: what the virtual rig meets outside of its process.
//!
//! # Design
//! The firmware's session and the reference reading of its words, in a thread. Its time is virtual: it stands still
//! until the rig has answered an edge, and passes quickly otherwise. Its dead-man switch is not polled, because the
//! host's signs of life come in real time.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufRead as _, BufReader, ErrorKind, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use rcg_firmware::pulse::{Edge, Played, Reader, SYNC_LATENCY, StepWords};
use rcg_firmware::session::{Action, EngineCommand, Session};
use rcg_protocol::{Decoder, Level, Line, MAX_FRAME, Start, Ticks, ToDevice, encode};
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
            rig: None,
            session: Session::new(CLOCK_HZ, 77),
            decoder: Decoder::new(),
            now,
            late,
            primed: None,
            run: None,
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
    rig: Option<Rig>,
    session: Session,
    decoder: Decoder,
    now: Ticks,
    late: Ticks,
    primed: Option<Reader>,
    run: Option<Run>,
}

/// Times of the reader count from the start.
struct Run {
    reader: Reader,
    started: Ticks,
    steps: u64,
    strobes: VecDeque<(Ticks, bool)>,
}

impl Bench {
    fn turn(&mut self) {
        if let Ok((stream, _)) = self.listener.accept() {
            self.rig = Rig::greet(stream);
        }
        if self.run.is_none() || self.master.bytes_to_read().is_ok_and(|count| count > 0) {
            self.hear();
        }
        if self.run.is_some() {
            self.play();
        } else {
            self.now += Ticks(u64::from(CLOCK_HZ) / 1000);
        }
        self.act();
    }

    fn hear(&mut self) {
        let mut bytes = [0; 512];
        // Nothing came in time.
        let count = self.master.read(&mut bytes).unwrap_or(0);
        for &byte in &bytes[..count] {
            match self.decoder.push::<ToDevice>(byte) {
                Some(Ok(message)) => self.session.request(self.now, &message),
                Some(Err(_)) => self.session.corrupt_frame(),
                None => {}
            }
            self.act();
        }
    }

    fn act(&mut self) {
        while let Some(action) = self.session.action() {
            match action {
                Action::Send(message) => {
                    let mut buffer = [0; MAX_FRAME];
                    let frame = encode(&message, &mut buffer).expect("MAX_FRAME holds every message");
                    self.say(frame);
                }
                Action::Engine(EngineCommand::Prime) => {
                    let format = self.session.sequencer().format().expect("a program is loaded");
                    self.primed = Some(Reader::new(format, Ticks::ZERO));
                }
                Action::Engine(EngineCommand::Go(start)) => {
                    let Some(reader) = self.primed.take() else {
                        continue;
                    };
                    if start == Start::OnSync {
                        let edge = next_sync(self.rig.as_ref(), self.now).expect("a rig is there");
                        self.now = edge + Ticks(SYNC_LATENCY);
                    }
                    self.run = Some(Run {
                        reader,
                        started: self.now,
                        steps: 0,
                        strobes: VecDeque::new(),
                    });
                    self.session.begun(self.now);
                }
                Action::Engine(EngineCommand::Halt) => {
                    self.primed = None;
                    let mut at = Ticks::ZERO;
                    if let Some(mut run) = self.run.take() {
                        at = self.now.saturating_sub(run.started).max(run.reader.now());
                        let (rig, started) = (&mut self.rig, run.started);
                        run.reader.halt(at, |edge| {
                            tell(rig, edge, started);
                        });
                    }
                    self.session.halted(at);
                }
            }
        }
    }

    /// Waits for a client that reads slowly; what none reads is lost.
    fn say(&mut self, mut frame: &[u8]) {
        let patience = Instant::now() + Duration::from_secs(1);
        while !frame.is_empty() && Instant::now() < patience {
            match self.master.write(frame) {
                Ok(count) => frame = &frame[count..],
                Err(error) if error.kind() == ErrorKind::TimedOut => {}
                Err(error) => panic!("the port fails: {error}"),
            }
        }
    }

    fn play(&mut self) {
        let Some(mut run) = self.run.take() else { return };
        let (rig, started) = (&mut self.rig, run.started);
        let mut words = StepWords::new();
        let push = |piece: &[u32]| {
            words
                .extend_from_slice(piece)
                .expect("a step has room for its words");
        };
        if self.session.next_step(push).is_none() {
            let end = run.reader.now();
            let mut strobes = Vec::new();
            run.reader
                .halt(end, |edge| strobes.extend(tell(rig, edge, started)));
            run.strobes.extend(strobes);
            self.report_strobes(&mut run, Ticks(u64::MAX));
            self.session.drained(self.now - run.started);
            return;
        }
        let mut synced = None;
        for &word in &words {
            let vsync = rig.as_ref().and_then(|rig| rig.vsync);
            let next = |from: Ticks| {
                synced = after(vsync, started + from).map(|edge| edge - started);
                synced
            };
            let strobes = &mut run.strobes;
            let played = run
                .reader
                .play(word, next, |edge| strobes.extend(tell(rig, edge, started)));
            assert_eq!(played, Played::Through, "a rig is there");
        }
        if let Some(edge) = synced {
            self.session.sync(edge, true);
        }
        self.now = run.started + run.reader.now();
        run.steps += 1;
        let now = self.now;
        self.report_strobes(&mut run, now);
        self.session.fired(run.steps, run.reader.now());
        self.run = Some(run);
    }

    fn report_strobes(&mut self, run: &mut Run, until: Ticks) {
        while let Some((at, active)) = run.strobes.pop_front_if(|strobe| strobe.0 <= until) {
            self.now = self.now.max(at);
            self.session.strobe(active, at - run.started + self.late);
        }
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

/// Tells the rig of an edge; returns the edge of STROBE that it answers with.
fn tell(rig: &mut Option<Rig>, edge: Edge, started: Ticks) -> Option<(Ticks, bool)> {
    let line = if edge.line == Line::Proj { "proj" } else { "cam" };
    let level = u8::from(edge.level == Level::Active);
    let at = started + edge.at;
    let said = rig.as_mut()?.ask(&format!("edge {} {line} {level}\n", at.0));
    if said.is_none() {
        *rig = None;
    }
    let said = said?;
    let words: Vec<&str> = said.first()?.split(' ').collect();
    let ["drive", tick, "strobe", level] = words[..] else {
        panic!("the rig says {said:?}");
    };
    Some((Ticks(tick.parse().expect("a number")), level == "1"))
}

fn next_sync(rig: Option<&Rig>, from: Ticks) -> Option<Ticks> {
    after(rig.and_then(|rig| rig.vsync), from)
}

fn after(vsync: Option<(u64, u64)>, from: Ticks) -> Option<Ticks> {
    let (first, period) = vsync?;
    let periods = from.0.saturating_sub(first).div_ceil(period);
    Some(Ticks(first + periods * period))
}
