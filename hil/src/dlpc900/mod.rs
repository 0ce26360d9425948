//! An emulated DLPC900 with its mirrors, at the level of HID reports, for tests of what drives one.
//!
//! # Design
//! Written from the programmer's guide (DLPU018J), and apart from the host's driver: reports become commands (`stream`), commands a
//! state (`state`), uploads images (`pixels`). It refuses what the real unit refuses or is known to hang at: a look-up table while
//! a sequence runs, data without their announcement, more than 504 bytes at a time, images in another order than from the last to the
//! first, a mode without a stop before and after it, a start without the table made effective after the upload. [`Dlpc900::after`] says
//! which pattern the mirrors show after so many triggers, as it was uploaded.
//!
//! # Tradeoffs
//! No time passes: which triggers come too early, the table's exposures say ([`Dlpc900::period_us`]).

mod pixels;
mod state;
mod stream;
#[cfg(test)]
mod tests;

use std::io;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::Context as _;
use rcg::capture::dlpc900::reports::Reports;
use rcg::instrument::rig::Rig;
use rcg::plan::pattern::BitPattern;

use state::State;
use stream::Stream;

/// Length of a report.
const REPORT: usize = 64;
/// How often a connection is looked for.
const LOOK: Duration = Duration::from_millis(2);

/// What a unit is, and what is wrong with it on purpose.
#[derive(Clone, Debug)]
pub struct Nature {
    /// Code of the mirrors: 1 DLP6500, 2 DLP9000, 3 DLP670S, 4 DLP500YX, 5 DLP5500.
    pub mirrors: u8,
    /// Version of the firmware.
    pub firmware: (u8, u8, u16),
    /// Whether frames come by its video port.
    pub has_source: bool,
    /// For so many commands it does not answer at first.
    pub silent: usize,
    /// How often it still has to reach video mode until its hardware status has no fault; never beyond 100.
    pub aborted: usize,
    /// The command of this number, from 1 on, is answered late: before the one after it.
    pub late: usize,
    /// Refuses this command, with this error.
    pub refuses: Option<(u16, u8)>,
}

impl Default for Nature {
    fn default() -> Self {
        Self {
            mirrors: 1,
            firmware: (6, 0, 1),
            has_source: false,
            silent: 0,
            aborted: 0,
            late: 0,
            refuses: None,
        }
    }
}

impl Nature {
    /// Mirrors (columns, rows), and whether two controllers share them.
    const fn size_px(&self) -> ((usize, usize), bool) {
        match self.mirrors {
            2 => ((2560, 1600), true),
            3 => ((2716, 1600), true),
            4 => ((2048, 1200), true),
            5 => ((1024, 768), false),
            _ => ((1920, 1080), false),
        }
    }
}

/// What is shown from one trigger to the next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shown {
    /// The pattern, with its level and primary.
    pub pattern: BitPattern,
    /// Whether it waits for a trigger.
    pub waits: bool,
    /// Whether it stays until the next trigger.
    pub holds: bool,
    /// How long it is exposed, µs.
    pub exposure_us: u32,
    /// From its trigger until it comes, µs.
    pub delay_us: u16,
}

/// What a sequence shows, in the order of its triggers.
pub type Sequence = Vec<Shown>;
/// Hears of a sequence that starts, before the unit answers.
pub type OnStart = Box<dyn FnMut(Sequence) + Send>;

/// An emulated unit. Copies are the same one.
#[derive(Clone)]
pub struct Dlpc900(Arc<Mutex<Inner>>);

struct Inner {
    stream: Stream,
    state: State,
    on_start: Option<OnStart>,
    /// Answers that nobody has taken yet.
    answers: Vec<[u8; REPORT]>,
    /// An answer that comes late.
    late: Vec<[u8; REPORT]>,
    commands: usize,
}

impl Dlpc900 {
    /// One that was switched on just now.
    #[must_use]
    pub fn new(nature: Nature) -> Self {
        Self(Arc::new(Mutex::new(Inner {
            stream: Stream::default(),
            state: State::new(nature),
            on_start: None,
            answers: Vec::new(),
            late: Vec::new(),
            commands: 0,
        })))
    }

    /// One whose mirrors are as many as the projector of `rig` has pixels.
    ///
    /// # Errors
    /// Where no unit has so many.
    pub fn like(rig: &Rig) -> anyhow::Result<Self> {
        let lens = &rig.projector.lens;
        let size_px = (lens.width_px as usize, lens.height_px as usize);
        let mut natures = (1..=5).map(|mirrors| Nature {
            mirrors,
            ..Nature::default()
        });
        let nature = natures.find(|nature| nature.size_px().0 == size_px);
        let nature = nature.with_context(|| format!("no mirrors of {}×{}", size_px.0, size_px.1))?;
        Ok(Self::new(nature))
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets `on_start` hear of each sequence that starts.
    pub fn on_start(&self, on_start: OnStart) {
        self.lock().on_start = Some(on_start);
    }

    /// What it was told that no unit would do as it was meant, in its order.
    #[must_use]
    pub fn complaints(&self) -> Vec<String> {
        let inner = self.lock();
        let mut complaints = inner.stream.complaints.clone();
        complaints.extend(inner.state.complaints.iter().cloned());
        complaints
    }

    /// What the running sequence shows from one trigger to the next; `None` if none runs.
    #[must_use]
    pub fn sequence(&self) -> Option<Sequence> {
        self.lock().state.sequence()
    }

    /// What the mirrors show after so many triggers since the start of the sequence; `None` for black, before the first.
    ///
    /// # Panics
    /// If no sequence runs.
    #[must_use]
    pub fn after(&self, triggers: usize) -> Option<BitPattern> {
        let sequence = self.sequence().expect("a sequence runs");
        let last = triggers.checked_sub(1)?;
        Some(sequence[last % sequence.len()].pattern.clone())
    }

    /// How many patterns the running sequence has; `None` if none runs.
    #[must_use]
    pub fn running(&self) -> Option<usize> {
        self.lock().state.running()
    }

    /// How far triggers of the running sequence have to be apart, µs.
    #[must_use]
    pub fn period_us(&self) -> u32 {
        self.lock().state.period_us()
    }

    /// The numbers of the commands that it heard.
    #[must_use]
    pub fn heard(&self) -> Vec<u16> {
        self.lock().state.heard.clone()
    }

    /// Takes one report in.
    fn hear(&self, report: &[u8; REPORT]) {
        let mut inner = self.lock();
        let inner = &mut *inner;
        let Some(command) = inner.stream.take(report) else {
            return;
        };
        inner.commands += 1;
        let answer = inner.state.answer(&command);
        if inner.state.has_just_started()
            && let Some(on_start) = &mut inner.on_start
            && let Some(sequence) = inner.state.sequence()
        {
            on_start(sequence);
        }
        let Some(answer) = answer else { return };
        let mut bytes = vec![command.flags & 0xC0, command.sequence];
        if answer.is_err() {
            bytes[0] |= 0x20;
        }
        let data = answer.unwrap_or_default();
        bytes.extend((data.len() as u16).to_le_bytes());
        bytes.extend(data);
        if !command.wants_answer() {
            return;
        }
        let reports = bytes.chunks(REPORT).map(|part| {
            let mut report = [0; REPORT];
            report[..part.len()].copy_from_slice(part);
            report
        });
        if inner.commands == inner.state.late() {
            inner.late.extend(reports);
        } else {
            let late = std::mem::take(&mut inner.late);
            inner.answers.extend(late.into_iter().chain(reports));
        }
    }

    fn tell(&self) -> Option<[u8; REPORT]> {
        let mut inner = self.lock();
        if inner.answers.is_empty() {
            None
        } else {
            Some(inner.answers.remove(0))
        }
    }

    /// The unit as the host's driver has it, without a wire.
    #[must_use]
    pub fn reports(&self) -> Box<dyn Reports> {
        Box::new(Wire(self.clone()))
    }

    /// The unit at a port of this machine, until what is returned is dropped.
    ///
    /// # Errors
    /// Of the system.
    pub fn serve(&self) -> io::Result<Served> {
        let listener = TcpListener::bind("127.0.0.1:0")?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let over = Arc::new(AtomicBool::new(false));
        let (unit, ending) = (self.clone(), Arc::clone(&over));
        let worker = thread::spawn(move || {
            while !ending.load(Ordering::Relaxed) {
                match listener.accept() {
                    // Whoever goes leaves it to the next.
                    Ok((stream, _)) => unit.at(stream, &ending).unwrap_or(()),
                    Err(_) => thread::sleep(LOOK),
                }
            }
        });
        Ok(Served {
            address,
            over,
            worker: Some(worker),
        })
    }

    fn at(&self, stream: TcpStream, over: &AtomicBool) -> io::Result<()> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(Duration::from_millis(20)))?;
        self.converse(stream, over)
    }

    /// Hears and answers over `stream` until that ends or it is `over`.
    ///
    /// # Errors
    /// Of the system.
    pub fn converse(&self, mut stream: impl io::Read + io::Write, over: &AtomicBool) -> io::Result<()> {
        let mut begun = Vec::new();
        while !over.load(Ordering::Relaxed) {
            let mut bytes = [0; REPORT * 8];
            match stream.read(&mut bytes) {
                Ok(0) => break,
                Ok(read) => begun.extend_from_slice(&bytes[..read]),
                Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {
                }
                Err(error) => return Err(error),
            }
            while begun.len() >= REPORT {
                let rest = begun.split_off(REPORT);
                let report = std::mem::replace(&mut begun, rest);
                self.hear(&report.try_into().expect("invariant: it is a report long"));
                while let Some(answer) = self.tell() {
                    stream.write_all(&answer)?;
                }
            }
        }
        Ok(())
    }
}

/// The unit without a wire.
struct Wire(Dlpc900);

impl Reports for Wire {
    fn send(&mut self, report: &[u8; REPORT]) -> Result<(), String> {
        self.0.hear(report);
        Ok(())
    }

    fn take(&mut self, _: Duration) -> Result<Option<[u8; REPORT]>, String> {
        Ok(self.0.tell())
    }
}

/// A unit at a port.
pub struct Served {
    address: SocketAddr,
    over: Arc<AtomicBool>,
    worker: Option<JoinHandle<()>>,
}

impl Served {
    /// As `device` of `[projector.dlpc900]` names it.
    #[must_use]
    pub fn device(&self) -> String {
        format!("tcp:{}", self.address)
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(worker) = self.worker.take() {
            worker.join().ok();
        }
    }
}
