//! The emulator's process: one JSON object per request, one per answer.
//!
//! # Design
//! The emulator owns no clock: virtual time moves only in [`Emulator::run`]. `hil/emulator/README.md` has the table
//! of requests; what each answer means is said there.

use std::io::{self, BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::thread;

use rcg_protocol::Line;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::dut::LinkKind;
use crate::places;
use crate::trace::Edge;

/// Why the emulator did not do what it was asked.
#[derive(Debug, thiserror::Error)]
pub enum EmulatorError {
    /// Its process failed.
    #[error("the emulator's process: {0}")]
    Process(#[from] io::Error),
    /// It has ended.
    #[error("the emulator has ended; its standard error says why")]
    Ended,
    /// It refused a request.
    #[error("the emulator refused {request}: {reason}")]
    Refused {
        /// The request.
        request: String,
        /// Why.
        reason: String,
    },
    /// It answered something else.
    #[error("the emulator's answer to {request} is not as agreed: {reason}")]
    BadAnswer {
        /// The request.
        request: String,
        /// What is wrong.
        reason: String,
    },
}

/// What ends a run before its cycles are over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Until {
    /// Nothing but a reset or a halt of the chip.
    Cycles,
    /// The end of a frame reached the host.
    Frame,
    /// An output line changed.
    Edge,
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Why {
    /// Its cycles were over.
    Cycles,
    /// The end of a frame reached the host.
    Frame,
    /// An output line changed.
    Edge,
    /// The chip was reset.
    Reset,
    /// The CPU has stopped for good.
    Halt,
}

/// What came of a run.
#[derive(Clone, Debug)]
pub struct Ran {
    /// Cycles since power-up.
    pub cycle: u64,
    /// Why it ended.
    pub why: Why,
    /// Bytes that reached the host.
    pub received: Vec<u8>,
    /// Edges of all lines, in the order of time.
    pub edges: Vec<Edge>,
    /// Bytes of RTT channel 0.
    pub rtt: Vec<u8>,
}

/// Totals of the emulator.
#[derive(Clone, Debug, Deserialize)]
pub struct Stats {
    /// Cycles in which the CPU executed.
    pub busy: u64,
    /// Rate of the cycles.
    pub clock_hz: u32,
    /// Bytes that the UART lost because nobody fetched them.
    pub uart_overruns: u64,
    /// What the CPU read of flash, code and data, by instructions.
    pub flash_reads: u64,
    /// Cycles in one piece in which interrupts were masked, at most, since this was last asked.
    pub longest_masked: u64,
}

/// A camera's STROBE output: what follows on each rising edge of CAM.
#[derive(Clone, Debug, Default)]
pub struct StrobeModel {
    /// Cycles from the edge of CAM to that of STROBE.
    pub delay: u64,
    /// Cycles that it stays high; 0 as long as CAM.
    pub width: u64,
    /// Triggers, counted from this request, that the camera ignores.
    pub ignore: Vec<u64>,
    /// Cycles at which it exposes by itself.
    pub extra: Vec<u64>,
}

/// A projector's vsync on SYNC.
#[derive(Clone, Debug, Default)]
pub struct VsyncModel {
    /// Cycle of the first pulse.
    pub first: u64,
    /// Cycles from one to the next.
    pub period: u64,
    /// Cycles that it stays high.
    pub width: u64,
    /// Each pulse is up to so many cycles early or late, drawn from `seed`.
    pub jitter: u64,
    /// Seed of the jitter.
    pub seed: u64,
    /// Pulses, from 0, that do not come.
    pub missing: Vec<u64>,
    /// Pulses after which a second one comes a quarter of a period later.
    pub double: Vec<u64>,
}

/// A running emulator; dropping it ends its process.
#[derive(Debug)]
pub struct Emulator {
    child: Child,
    requests: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
    line: String,
}

impl Emulator {
    /// Powers up a Pico with the firmware in the ELF file `image`, its host at `link`. What comes from flash takes its time.
    ///
    /// # Errors
    /// [`EmulatorError::Process`].
    pub fn start(image: &Path, link: LinkKind) -> Result<Self, EmulatorError> {
        let link = match link {
            LinkKind::Uart => "uart",
            LinkKind::Usb => "usb",
        };
        let mut child = Command::new("node")
            .arg(places::emulator())
            .arg("--image")
            .arg(image)
            .args(["--link", link, "--flash-cache"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            // Node makes a pipe that it inherits non-blocking for all who write into it.
            .stderr(Stdio::piped())
            .spawn()?;
        let mut complaints = child.stderr.take().expect("it was piped");
        thread::spawn(move || io::copy(&mut complaints, &mut io::stderr()));
        let requests = child.stdin.take();
        let answers = BufReader::new(child.stdout.take().expect("it was piped"));
        Ok(Self {
            child,
            requests,
            answers,
            line: String::new(),
        })
    }

    /// Lets `cycles` cycles pass, or fewer.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn run(&mut self, cycles: u64, until: Until) -> Result<Ran, EmulatorError> {
        #[derive(Deserialize)]
        struct Answer {
            cycle: u64,
            why: Why,
            received: String,
            edges: Vec<u64>,
            rtt: String,
        }
        let until: &[&str] = match until {
            Until::Cycles => &[],
            Until::Frame => &["frame"],
            Until::Edge => &["edge"],
        };
        let request = json!({"op": "run", "cycles": cycles, "until": until});
        let answer: Answer = self.ask(&request)?;
        let bad = |reason: &str| EmulatorError::BadAnswer {
            request: request.to_string(),
            reason: reason.to_owned(),
        };
        let edge = |edge: &[u64]| match *edge {
            [at, gpio, level] => line(gpio).map(|line| Edge {
                at,
                line,
                high: level != 0,
            }),
            _ => None,
        };
        let edges: Option<Vec<Edge>> = answer.edges.chunks(3).map(edge).collect();
        Ok(Ran {
            cycle: answer.cycle,
            why: answer.why,
            received: bytes(&answer.received).ok_or_else(|| bad("`received` is not hexadecimal"))?,
            edges: edges.ok_or_else(|| bad("`edges` are not cycle, GPIO, level"))?,
            rtt: bytes(&answer.rtt).ok_or_else(|| bad("`rtt` is not hexadecimal"))?,
        })
    }

    /// Sends `bytes` to the device from now on; returns the cycle at which the last one arrives, if that is known.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn send(&mut self, bytes: &[u8]) -> Result<Option<u64>, EmulatorError> {
        #[derive(Deserialize)]
        struct Answer {
            arrives: Option<u64>,
        }
        let answer: Answer = self.ask(&json!({"op": "send", "bytes": hex(bytes)}))?;
        Ok(answer.arrives)
    }

    /// Drives an input line at the cycle `at`.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn drive(&mut self, line: Line, high: bool, at: u64) -> Result<(), EmulatorError> {
        let request = json!({"op": "drive", "gpio": gpio(line), "level": u8::from(high), "at": at});
        self.tell(&request)
    }

    /// Puts a camera on CAM and STROBE.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn strobe(&mut self, model: &StrobeModel) -> Result<(), EmulatorError> {
        let StrobeModel {
            delay,
            width,
            ignore,
            extra,
        } = model;
        self.tell(&json!({"op": "strobe", "delay": delay, "width": width, "ignore": ignore, "extra": extra}))
    }

    /// Puts a projector's vsync on SYNC.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn vsync(&mut self, model: &VsyncModel) -> Result<(), EmulatorError> {
        let VsyncModel {
            first,
            period,
            width,
            jitter,
            seed,
            missing,
            double,
        } = model;
        self.tell(&json!({
            "op": "vsync", "first": first, "period": period, "width": width, "jitter": jitter, "seed": seed,
            "missing": missing, "double": double,
        }))
    }

    /// Writes to memory.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn write(&mut self, address: u32, bytes: &[u8]) -> Result<(), EmulatorError> {
        self.tell(&json!({"op": "write", "address": address, "bytes": hex(bytes)}))
    }

    /// Lets the CPU go on at `address`, with `r0` in its first register and with interrupts masked or not.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn jump(&mut self, address: u32, r0: u32, masked: bool) -> Result<(), EmulatorError> {
        let request = json!({"op": "jump", "address": address, "r0": r0, "primask": u8::from(masked)});
        self.tell(&request)
    }

    /// Plugs the USB cable in, or pulls it.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn plug(&mut self, inserted: bool) -> Result<(), EmulatorError> {
        self.tell(&json!({"op": "plug", "in": inserted}))
    }

    /// Lets the USB host ask for what the device has to send, or not.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn fetch(&mut self, on: bool) -> Result<(), EmulatorError> {
        self.tell(&json!({"op": "fetch", "on": on}))
    }

    /// Lets the USB host go to sleep, or wakes it.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn doze(&mut self, on: bool) -> Result<(), EmulatorError> {
        self.tell(&json!({"op": "doze", "on": on}))
    }

    /// A wire from `from`, an output, to `to`, an input, which has its level a cycle later.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn jumper(&mut self, from: Line, to: Line) -> Result<(), EmulatorError> {
        self.tell(&json!({"op": "jumper", "from": gpio(from), "to": gpio(to)}))
    }

    /// Lets the USB controller hang until the chip is reset.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn wedge(&mut self) -> Result<(), EmulatorError> {
        self.tell(&json!({"op": "wedge"}))
    }

    /// Levels of PROJ, CAM, AUX-A and AUX-B on the wire.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn outputs(&mut self) -> Result<[bool; 4], EmulatorError> {
        let request = json!({"op": "levels"});
        let answer: Value = self.ask(&request)?;
        let level = |line| {
            let level = answer.pointer(&format!("/gpio/{}/level", gpio(line)));
            level.and_then(Value::as_u64).map(|level| level != 0)
        };
        match OUTPUTS.map(level) {
            [Some(proj), Some(cam), Some(a), Some(b)] => Ok([proj, cam, a, b]),
            _ => Err(EmulatorError::BadAnswer {
                request: request.to_string(),
                reason: "no levels of the outputs".to_owned(),
            }),
        }
    }

    /// Totals.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn stats(&mut self) -> Result<Stats, EmulatorError> {
        self.ask(&json!({"op": "stats"}))
    }

    fn tell(&mut self, request: &Value) -> Result<(), EmulatorError> {
        self.ask::<Value>(request).map(|_| ())
    }

    fn ask<A: for<'a> Deserialize<'a>>(&mut self, request: &Value) -> Result<A, EmulatorError> {
        let requests = self.requests.as_mut().expect("it is open until the drop");
        writeln!(requests, "{request}")?;
        self.line.clear();
        if self.answers.read_line(&mut self.line)? == 0 {
            return Err(EmulatorError::Ended);
        }
        if let Ok(Refusal { error }) = serde_json::from_str(&self.line) {
            return Err(EmulatorError::Refused {
                request: request.to_string(),
                reason: error,
            });
        }
        serde_json::from_str(&self.line).map_err(|error| EmulatorError::BadAnswer {
            request: request.to_string(),
            reason: error.to_string(),
        })
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        drop(self.requests.take()); // the end of its input ends it
        self.child.wait().ok();
    }
}

#[derive(Deserialize)]
struct Refusal {
    error: String,
}

/// What the box drives.
const OUTPUTS: [Line; 4] = [Line::Proj, Line::Cam, Line::AuxA, Line::AuxB];

const fn gpio(line: Line) -> u8 {
    match line {
        Line::Proj => 2,
        Line::Cam => 3,
        Line::Sync => 4,
        Line::Strobe => 5,
        Line::AuxA => 6,
        Line::AuxB => 7,
        Line::Photo => 8,
        Line::Start => 9,
    }
}

const fn line(gpio: u64) -> Option<Line> {
    match gpio {
        2 => Some(Line::Proj),
        3 => Some(Line::Cam),
        4 => Some(Line::Sync),
        5 => Some(Line::Strobe),
        6 => Some(Line::AuxA),
        7 => Some(Line::AuxB),
        8 => Some(Line::Photo),
        9 => Some(Line::Start),
        _ => None,
    }
}

fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::new(), |mut hex, byte| {
        write!(hex, "{byte:02x}").expect("a string takes everything");
        hex
    })
}

fn bytes(hex: &str) -> Option<Vec<u8>> {
    if !hex.len().is_multiple_of(2) {
        return None;
    }
    let digits = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
    hex.as_bytes().chunks(2).map(digits).collect()
}
