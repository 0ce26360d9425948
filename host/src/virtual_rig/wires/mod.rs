//! The virtual rig at the wires of a trigger box elsewhere: its edges come, STROBE and SYNC go, as lines over TCP.
//!
//! # Design
//! A *bridge* listens; it has the trigger box behind it (the real firmware in an emulator, or any other). The rig
//! connects, and both send lines of ASCII that end with LF. Numbers are decimal; a tick is one cycle of the trigger
//! box's clock, counted by the bridge from any moment; level 1 is a pad that is high.
//!
//! | line | from | meaning |
//! |---|---|---|
//! | `clock HZ` | bridge, first line of each connection | ticks per second |
//! | `edge TICK proj LEVEL`, `edge TICK cam LEVEL` | bridge | an output took this level; ticks never decrease |
//! | `vsync FIRST PERIOD WIDTH` | rig, before its first `ok` | until the connection ends, SYNC is high from each tick FIRST + n·PERIOD on for WIDTH ticks; those that are past are left out |
//! | `drive TICK strobe LEVEL` | rig, before the `ok` of an edge | STROBE takes this level then, at the edge's tick or later |
//! | `ok` | rig | the answer to `clock` or `edge` is complete |
//!
//! The box's time stands still from each edge to its `ok`, so nothing depends on how fast either side is; and as the
//! edges of a run have been answered before the box tells of its end, its exposures are complete by then. A rig may
//! connect, go and connect again; while there is none, nobody answers and time goes on.
//!
//! # Tradeoffs
//! All lines are active high, as in [`Timing::program`](crate::plan::schedule::Timing::program), the default of the plan: the
//! rig sees pads, and has no other way to know what is active.
//!
//! The host counts its time-outs, and its signs of life for the dead-man switch, in real time: the box's time may run
//! slower than that, but during a run not much faster.

use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::net::{Shutdown, TcpStream, ToSocketAddrs as _};
use std::thread::JoinHandle;
use std::time::Duration;

use rcg_firmware::virtual_time::StrobeEdge;
use rcg_protocol::{Level, Line, Ticks};

use super::SharedStage;

/// A bridge that has not said its clock by then never will.
const GREETING: Duration = Duration::from_secs(10);
/// Length of the vsync pulse in seconds, unless the projector's period is shorter than twice that.
const VSYNC_S: f64 = 50e-6;

/// Longer than any line of the protocol.
const LONGEST_LINE: u64 = 256;
/// What a bridge may say after its clock.
const EDGE: &str = "`edge TICK proj|cam 0|1` with ticks that never decrease";

/// Why the wires do not work.
#[derive(Debug, thiserror::Error)]
pub enum WiresError {
    /// That is no address.
    #[error(
        "wires {address}: expected HOST:PORT of a bridge, found an address that cannot be used: {source}"
    )]
    Address {
        /// What was given.
        address: String,
        /// What the system says.
        source: io::Error,
    },
    /// Nothing listens there.
    #[error("wires {address}: expected a bridge that listens, found none: {source}")]
    NoBridge {
        /// The address.
        address: String,
        /// What the system says.
        source: io::Error,
    },
    /// The bridge says something else than it should.
    #[error("wires {address}: expected {expected}, found `{found}`")]
    Protocol {
        /// The bridge.
        address: String,
        /// What should have come.
        expected: &'static str,
        /// What came.
        found: String,
    },
    /// The bridge has closed the connection.
    #[error("wires {address}: the connection has ended")]
    Ended {
        /// The bridge.
        address: String,
    },
    /// The connection failed.
    #[error("wires {address}: {source}")]
    Io {
        /// The bridge.
        address: String,
        /// What the system says.
        source: io::Error,
    },
}

/// A connection to a bridge that has told its clock.
#[derive(Debug)]
pub struct Wires {
    address: String,
    stream: BufReader<TcpStream>,
    clock_hz: u32,
}

impl Wires {
    /// Connects to the bridge at `address` (`HOST:PORT`).
    ///
    /// # Errors
    /// [`WiresError`].
    pub fn connect(address: &str) -> Result<Self, WiresError> {
        let name = || address.to_owned();
        let bad = |source| WiresError::Address {
            address: name(),
            source,
        };
        let mut error = io::ErrorKind::AddrNotAvailable.into();
        let mut stream = None;
        for candidate in address.to_socket_addrs().map_err(bad)? {
            match TcpStream::connect_timeout(&candidate, GREETING) {
                Ok(found) => {
                    stream = Some(found);
                    break;
                }
                Err(refused) => error = refused,
            }
        }
        let stream = stream.ok_or_else(|| WiresError::NoBridge {
            address: name(),
            source: error,
        })?;
        let io = |source| WiresError::Io {
            address: name(),
            source,
        };
        stream.set_nodelay(true).map_err(io)?;
        stream.set_read_timeout(Some(GREETING)).map_err(io)?;
        let mut wires = Self {
            address: name(),
            stream: BufReader::new(stream),
            clock_hz: 0,
        };
        let line = wires.line()?;
        wires.clock_hz = line
            .strip_prefix("clock ")
            .and_then(|hz| hz.parse().ok())
            .filter(|&hz| hz > 0)
            .ok_or_else(|| wires.protocol("`clock HZ` with a whole number above 0", &line))?;
        wires.stream.get_ref().set_read_timeout(None).map_err(io)?;
        Ok(wires)
    }

    /// Ticks per second.
    #[must_use]
    pub const fn clock_hz(&self) -> u32 {
        self.clock_hz
    }

    /// Lets the edges that come drive `stage`, in a thread of their own.
    pub(super) fn attach(mut self, stage: SharedStage) -> Result<Attached, WiresError> {
        let period = stage.lock().sync_period();
        let width = ((VSYNC_S * f64::from(self.clock_hz)) as u64).clamp(1, (period.0 / 2).max(1));
        self.send(&format!("vsync {} {} {width}\nok\n", period.0, period.0))?;
        let stream = self.stream.get_ref().try_clone().map_err(|e| self.io(e))?;
        let worker = std::thread::spawn(move || self.serve(&stage));
        Ok(Attached {
            stream,
            worker: Some(worker),
            failure: None,
        })
    }

    /// Answers edges until that fails.
    fn serve(mut self, stage: &SharedStage) -> WiresError {
        let mut latest = Ticks::ZERO;
        loop {
            let answered = self.line().and_then(|line| {
                let (at, output, level) = edge(&line)
                    .filter(|edge| edge.0 >= latest)
                    .ok_or_else(|| self.protocol(EDGE, &line))?;
                latest = at;
                let strobe = stage.lock().edge(output, level, at);
                let drive = strobe
                    .map(|StrobeEdge { at, active }| format!("drive {} strobe {}\n", at.0, u8::from(active)));
                self.send(&(drive.unwrap_or_default() + "ok\n"))
            });
            if let Err(error) = answered {
                return error;
            }
        }
    }

    /// The next line, without its end.
    fn line(&mut self) -> Result<String, WiresError> {
        let mut line = Vec::new();
        let count = self
            .stream
            .by_ref()
            .take(LONGEST_LINE)
            .read_until(b'\n', &mut line)
            .map_err(|e| self.io(e))?;
        if count == 0 {
            return Err(WiresError::Ended {
                address: self.address.clone(),
            });
        }
        let text = String::from_utf8_lossy(&line);
        match text.strip_suffix('\n') {
            Some(line) => Ok(line.to_owned()),
            None => Err(self.protocol("a line that ends", &text)),
        }
    }

    /// Sends whole lines at once, so that they travel together.
    fn send(&mut self, lines: &str) -> Result<(), WiresError> {
        let sent = self.stream.get_mut().write_all(lines.as_bytes());
        sent.map_err(|e| self.io(e))
    }

    fn protocol(&self, expected: &'static str, found: &str) -> WiresError {
        WiresError::Protocol {
            address: self.address.clone(),
            expected,
            found: found.escape_debug().to_string(),
        }
    }

    fn io(&self, source: io::Error) -> WiresError {
        use io::ErrorKind::{BrokenPipe, ConnectionReset};
        let address = self.address.clone();
        match source.kind() {
            ConnectionReset | BrokenPipe => WiresError::Ended { address },
            _ => WiresError::Io { address, source },
        }
    }
}

/// Takes `edge TICK proj|cam 0|1` apart.
fn edge(line: &str) -> Option<(Ticks, Line, Level)> {
    let mut words = line.strip_prefix("edge ")?.split(' ');
    let at = Ticks(words.next()?.parse().ok()?);
    let output = match words.next()? {
        "proj" => Line::Proj,
        "cam" => Line::Cam,
        _ => return None,
    };
    let level = match words.next()? {
        "0" => Level::Inactive,
        "1" => Level::Active,
        _ => return None,
    };
    words.next().is_none().then_some((at, output, level))
}

/// Wires that drive a stage, until this is dropped.
#[derive(Debug)]
pub(super) struct Attached {
    stream: TcpStream,
    worker: Option<JoinHandle<WiresError>>,
    failure: Option<WiresError>,
}

impl Attached {
    /// Why the wires do not work any more, if they do not.
    pub(super) fn failure(&mut self) -> Option<&WiresError> {
        if let Some(worker) = self.worker.take_if(|worker| worker.is_finished()) {
            self.failure = Some(worker.join().expect("the worker does not panic"));
        }
        self.failure.as_ref()
    }
}

impl Drop for Attached {
    fn drop(&mut self) {
        // The worker's read ends with this. If the peer was faster, it has ended already.
        self.stream.shutdown(Shutdown::Both).ok();
        if let Some(worker) = self.worker.take() {
            worker.join().ok();
        }
    }
}

#[cfg(test)]
mod tests;
