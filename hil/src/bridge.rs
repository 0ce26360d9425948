//! An emulated Pico as a neighbour would see it: a serial port, and the wires of its pins.
//!
//! # Design
//! The host's command finds the Pico at a pseudo terminal. What is at the other end of its lines, the virtual rig,
//! comes over TCP; [`rcg::virtual_rig::Wires`] describes what is said. Emulated time stands still until the rig has
//! answered an edge, so the rig's answer is never late, and otherwise keeps to real time: it is never faster, as the
//! host's signs of life come in real time.
//!
//! Where a projector cannot be triggered ([`Photodiode`]), SYNC is what its photodiode sees, once a display frame of emulated time, and
//! the rig is told of each new picture as if PROJ had asked for it.

use std::fs::File;
use std::io::{self, BufRead as _, BufReader, ErrorKind, Read as _, Write as _};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use rcg_protocol::Line;
use serialport::{SerialPort as _, TTYPort};

use crate::dut::EmulatedPico;
use crate::emulator::{EmulatorError, Until, VsyncModel, Why};
use crate::pico::Pico;

/// Bytes and edges are passed on at least this often.
const SLICE: Duration = Duration::from_micros(500);

/// Emulated time that is further behind than this is not made up for.
const FORGIVEN: Duration = Duration::from_millis(5);

/// Why there is no bridge, or no longer.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// The emulator.
    #[error(transparent)]
    Emulator(#[from] EmulatorError),
    /// The pseudo terminal.
    #[error("pseudo terminal: {0}")]
    Terminal(serialport::Error),
    /// Bytes of the terminal or of the wires.
    #[error("{what}: {source}")]
    Io {
        /// What is at fault.
        what: &'static str,
        /// What the system says.
        source: io::Error,
    },
    /// The rig does not speak as it should.
    #[error("wires: expected `drive`, `vsync` or `ok`, found `{0}`")]
    Rig(String),
    /// The CPU has stopped for good.
    #[error("the emulated CPU has stopped for good")]
    Halted,
    /// The photodiode.
    #[error(transparent)]
    Photodiode(Box<dyn std::error::Error + Send + Sync>),
}

/// What a photodiode saw in a display frame.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Whether there was light.
    pub lit: bool,
    /// Whether the projector shows another picture from now on, which was loaded.
    pub is_new: bool,
}

/// A photodiode before a projector that cannot be triggered, wired to SYNC.
pub trait Photodiode: Send {
    /// Length of a display frame.
    fn frame(&self) -> Duration;

    /// A display frame begins.
    ///
    /// # Errors
    /// Why there is none.
    fn look(&mut self) -> Result<Seen, Box<dyn std::error::Error + Send + Sync>>;
}

fn failed(what: &'static str) -> impl Fn(io::Error) -> BridgeError {
    move |source| BridgeError::Io { what, source }
}

/// A running Pico with its port and wires. It is switched off when this is dropped.
#[derive(Debug)]
pub struct Bridge {
    port: String,
    wires: SocketAddr,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<Vec<u8>, BridgeError>>>,
}

impl Bridge {
    /// Boots `dut`; its wires end at TCP port `wires` of this machine, 0 for any.
    ///
    /// # Errors
    /// [`BridgeError`].
    pub fn start(dut: &EmulatedPico, wires: u16) -> Result<Self, BridgeError> {
        Self::start_before(dut, wires, None)
    }

    /// As [`start`](Self::start), with a photodiode at SYNC in place of the rig's vsync, if there is one.
    ///
    /// # Errors
    /// [`BridgeError`].
    pub fn start_before(
        dut: &EmulatedPico,
        wires: u16,
        photodiode: Option<Box<dyn Photodiode>>,
    ) -> Result<Self, BridgeError> {
        let (mut master, slave) = TTYPort::pair().map_err(BridgeError::Terminal)?;
        master
            .set_timeout(Duration::ZERO)
            .map_err(BridgeError::Terminal)?;
        let port = slave.name().unwrap_or_default();
        // While the path is open somewhere, programs may come and go.
        let held = File::open(&port).map_err(failed("pseudo terminal"))?;
        drop(slave);
        let listener =
            TcpListener::bind((Ipv4Addr::LOCALHOST, wires)).map_err(failed("TCP port of the wires"))?;
        listener.set_nonblocking(true).map_err(failed("wires"))?;
        let wires = listener.local_addr().map_err(failed("wires"))?;
        let mut bench = Bench {
            pico: Pico::boot(dut)?,
            master,
            _held: held,
            listener,
            rig: None,
            sync: photodiode.map(|photodiode| SyncLine {
                photodiode,
                next: 0,
                lit: false,
            }),
            epoch: (Instant::now(), Duration::ZERO),
        };
        bench.keep_time();
        let over = Arc::new(AtomicBool::new(false));
        let thread = thread::spawn({
            let over = Arc::clone(&over);
            move || {
                while !over.load(Ordering::Relaxed) {
                    bench.turn()?;
                }
                Ok(bench.pico.rtt().to_vec())
            }
        });
        Ok(Self {
            port,
            wires,
            over,
            thread: Some(thread),
        })
    }

    /// Path of the serial port.
    #[must_use]
    pub fn port(&self) -> &str {
        &self.port
    }

    /// Where the virtual rig can connect.
    #[must_use]
    pub const fn wires(&self) -> SocketAddr {
        self.wires
    }

    /// Whether the Pico is still running.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Switches off. Returns the log, as it came over RTT.
    ///
    /// # Errors
    /// [`BridgeError`] that had ended it before.
    pub fn stop(mut self) -> Result<Vec<u8>, BridgeError> {
        self.over.store(true, Ordering::Relaxed);
        let thread = self.thread.take().expect("it is taken here only");
        thread.join().expect("the bridge does not panic")
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
    }
}

struct Bench {
    pico: Pico,
    master: TTYPort,
    _held: File,
    listener: TcpListener,
    rig: Option<Rig>,
    sync: Option<SyncLine>,
    /// A real and an emulated time that are the same.
    epoch: (Instant, Duration),
}

/// SYNC, where a photodiode drives it.
struct SyncLine {
    photodiode: Box<dyn Photodiode>,
    /// The cycle in which the next display frame begins.
    next: u64,
    lit: bool,
}

impl Bench {
    /// Passes on what there is, and lets a slice of time pass.
    fn turn(&mut self) -> Result<(), BridgeError> {
        if let Ok((stream, _)) = self.listener.accept() {
            self.rig = Rig::greet(stream, &mut self.pico, self.sync.is_none())?;
        }
        let mut bytes = [0; 512];
        match self.master.read(&mut bytes) {
            Ok(count) => {
                self.pico.emulator.send(&bytes[..count])?;
            }
            // Nothing there; or, as some systems say, nobody.
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock) => {}
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(failed("pseudo terminal")(error)),
        }
        let until = if self.rig.is_some() {
            Until::Edge
        } else {
            Until::Cycles
        };
        let slice = self.pico.cycles(SLICE);
        let slice = self.sync.as_ref().map_or(slice, |sync| {
            sync.next.saturating_sub(self.pico.cycle()).clamp(1, slice)
        });
        if self.pico.advance(slice, until)? == Why::Halt {
            return Err(BridgeError::Halted);
        }
        self.tell_edges()?;
        self.look()?;
        let answer: Vec<u8> = self.pico.take_received().collect();
        self.master
            .write_all(&answer)
            .map_err(failed("pseudo terminal"))?;
        self.keep_time();
        Ok(())
    }

    /// Tells the rig of the edges of the outputs, and drives the inputs as it says.
    fn tell_edges(&mut self) -> Result<(), BridgeError> {
        for edge in self.pico.take_edges() {
            let name = match edge.line {
                Line::Proj => "proj",
                Line::Cam => "cam",
                _ => continue,
            };
            self.tell(edge.at, name, edge.high)?;
        }
        Ok(())
    }

    /// Tells the rig of an edge, and drives the inputs as it says.
    fn tell(&mut self, at: u64, name: &str, high: bool) -> Result<(), BridgeError> {
        let Some(rig) = &mut self.rig else { return Ok(()) };
        let line = format!("edge {at} {name} {}\n", u8::from(high));
        match rig.ask(&line).map_err(failed("wires"))? {
            Some(said) => obey(&said, &mut self.pico, self.sync.is_none())?,
            None => self.rig = None,
        }
        Ok(())
    }

    /// Lets the photodiode look when a display frame begins.
    fn look(&mut self) -> Result<(), BridgeError> {
        let at = self.pico.cycle();
        let Some(sync) = self.sync.as_mut().filter(|sync| sync.next <= at) else {
            return Ok(());
        };
        let frame = self.pico.cycles(sync.photodiode.frame());
        sync.next = if sync.next == 0 { at } else { sync.next } + frame;
        let Seen { lit, is_new } = sync.photodiode.look().map_err(BridgeError::Photodiode)?;
        if std::mem::replace(&mut sync.lit, lit) != lit {
            self.pico.emulator.drive(Line::Sync, lit, at)?;
        }
        if is_new {
            self.tell(at, "proj", true)?;
            self.tell(at, "proj", false)?;
        }
        Ok(())
    }

    /// Waits for real time where emulated time is ahead of it.
    fn keep_time(&mut self) {
        let emulated = self.pico.now();
        let (real, then) = self.epoch;
        let ahead = emulated.saturating_sub(then).saturating_sub(real.elapsed());
        thread::sleep(ahead);
        if real.elapsed() > emulated.saturating_sub(then) + FORGIVEN {
            self.epoch = (Instant::now(), emulated);
        }
    }
}

/// The virtual rig at the other end of the wires.
struct Rig(BufReader<TcpStream>);

impl Rig {
    /// Tells a rig that has come the clock; `None` if it has gone again. It may drive SYNC or not.
    fn greet(stream: TcpStream, pico: &mut Pico, has_sync: bool) -> Result<Option<Self>, BridgeError> {
        stream.set_nonblocking(false).map_err(failed("wires"))?;
        stream.set_nodelay(true).map_err(failed("wires"))?;
        let mut rig = Self(BufReader::new(stream));
        let clock = format!("clock {}\n", pico.clock_hz());
        let Some(said) = rig.ask(&clock).map_err(failed("wires"))? else {
            return Ok(None);
        };
        obey(&said, pico, has_sync)?;
        Ok(Some(rig))
    }

    /// What the rig says to `line`, up to its `ok`; `None` if it has gone.
    fn ask(&mut self, line: &str) -> io::Result<Option<Vec<String>>> {
        if self.0.get_mut().write_all(line.as_bytes()).is_err() {
            return Ok(None);
        }
        let mut said = Vec::new();
        loop {
            let mut line = String::new();
            match self.0.read_line(&mut line) {
                Ok(0) => return Ok(None),
                Err(error) if error.kind() == ErrorKind::ConnectionReset => return Ok(None),
                Err(error) => return Err(error),
                Ok(_) if line.trim_end() == "ok" => return Ok(Some(said)),
                Ok(_) => said.push(line.trim_end().to_owned()),
            }
        }
    }
}

/// Drives the Pico's inputs, SYNC only if the rig has it.
fn obey(said: &[String], pico: &mut Pico, has_sync: bool) -> Result<(), BridgeError> {
    for line in said {
        let unknown = || BridgeError::Rig(line.clone());
        let words: Vec<&str> = line.split(' ').collect();
        let number = |word: &str| word.parse::<u64>().map_err(|_| unknown());
        match *words.as_slice() {
            ["drive", tick, name, level] => {
                let line = match name {
                    "sync" => Line::Sync,
                    "strobe" => Line::Strobe,
                    _ => return Err(unknown()),
                };
                let high = match level {
                    "0" => false,
                    "1" => true,
                    _ => return Err(unknown()),
                };
                pico.emulator.drive(line, high, number(tick)?)?;
            }
            ["vsync", ..] if !has_sync => {}
            ["vsync", first, period, width] => {
                let (first, period) = (number(first)?, number(period)?.max(1));
                let past = pico.cycle().saturating_sub(first).div_ceil(period);
                pico.emulator.vsync(&VsyncModel {
                    first: first + past * period,
                    period,
                    width: number(width)?,
                    ..VsyncModel::default()
                })?;
            }
            _ => return Err(unknown()),
        }
    }
    Ok(())
}
