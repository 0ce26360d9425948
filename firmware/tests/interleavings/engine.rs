//! The pulse engine of a board, on hardware that stands still between the moments at which something can happen.
//!
//! # Design
//! What the board's engine decides it decides as `src/board/engine` does, with the library's own [`Progress`]; a block is one step, a
//! turn reports one edge. What PIO, camera and projector really did is written down beside it, and nobody but the laws reads that.

use std::collections::VecDeque;

use rcg_firmware::control::PulseEngine;
use rcg_firmware::kept::Kept;
use rcg_firmware::progress::Progress;
use rcg_firmware::pulse::{SYNC_LATENCY, SYNC_READY};
use rcg_firmware::session::Session;
use rcg_protocol::{Extent, Input, Inputs, Pace, Pulse, Start, Step, StepId, Stored, Ticks};

/// From one moment to the next: a millisecond, after which a poll is due.
pub(crate) const HALF: u64 = 125_000;

/// Of two moments. In the first half the camera is triggered.
pub(crate) const STEP: Step = Step {
    proj: Pulse::new(0, 100),
    cam: Pulse::new(TRIGGER, 300),
    period: Ticks(2 * HALF),
};

/// From the start of a step to CAM.
pub(crate) const TRIGGER: u64 = 200;

/// Blocks that the DMA holds.
const BLOCKS: u64 = 2;

/// What the camera does until the next moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Camera {
    /// It exposes where it is triggered.
    Obeys,
    /// It does not, where it should, or does where it should not.
    Errs,
    /// It exposes until the next step has begun.
    Lingers,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Resting,
    Primed,
    Started(u64),
    Halted { started: u64, after: u64, taken: u32 },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Seen {
    Strobe(bool),
    Sync { begins: bool },
}

/// What really happened in a run. Times count from its origin, as those of records do.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Truth {
    /// Steps of the schedule, unless it is a stream.
    pub(crate) total: Option<u64>,
    /// Starts of its steps.
    pub(crate) steps: Vec<u64>,
    /// Leading and trailing edges of STROBE.
    pub(crate) exposures: Vec<[u64; 2]>,
    /// When the outputs came to rest for good.
    pub(crate) rests: Option<u64>,
}

impl Truth {
    /// Triggers that the camera was given.
    pub(crate) fn triggers(&self) -> u64 {
        let until = self.rests.unwrap_or(u64::MAX);
        self.steps.iter().filter(|&&at| at + TRIGGER <= until).count() as u64
    }

    /// Steps that were not cut short.
    pub(crate) fn whole(&self) -> u64 {
        let until = self.rests.unwrap_or(u64::MAX);
        self.steps.iter().filter(|&&at| at + 2 * HALF <= until).count() as u64
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Engine {
    pub(crate) now: u64,
    phase: Phase,
    pace: Pace,
    start: Start,
    total: Option<u64>,
    sync_timeout: u64,
    /// From the start of the machines to the origin of the run's times.
    origin: Option<u64>,
    progress: Progress,
    starved: bool,
    /// Words up to the end of each step that the DMA was given.
    words: Vec<u32>,
    cut: bool,
    dry: bool,
    /// Steps whose SYNC edge was told of.
    known: usize,
    /// Starts of the steps that the PIO has begun, from the start of the machines.
    begun: Vec<u64>,
    seen: VecDeque<(Seen, u64)>,
    /// Of all runs that were armed.
    pub(crate) truths: Vec<Truth>,
    /// A law of the engine that was broken.
    pub(crate) wrong: Option<&'static str>,
}

impl Engine {
    pub(crate) fn new() -> Self {
        Self {
            now: 0,
            phase: Phase::Resting,
            pace: Pace::FreeRunning,
            start: Start::AtOnce,
            total: None,
            sync_timeout: 0,
            origin: None,
            progress: Progress::new(Pace::FreeRunning),
            starved: false,
            words: Vec::new(),
            cut: false,
            dry: false,
            known: 0,
            begun: Vec::new(),
            seen: VecDeque::new(),
            truths: Vec::new(),
            wrong: None,
        }
    }

    pub(crate) fn is_primed(&self) -> bool {
        self.phase == Phase::Primed
    }

    /// Whether the machines run: then the outputs may be active.
    pub(crate) fn is_started(&self) -> bool {
        matches!(self.phase, Phase::Started(_))
    }

    pub(crate) fn is_resting(&self) -> bool {
        self.phase == Phase::Resting
    }

    /// Whether a step is being played, up to its last tick.
    fn plays(&self) -> Option<u64> {
        let Phase::Started(started) = self.phase else {
            return None;
        };
        let begin = *self.begun.last()?;
        (self.now - started < begin + 2 * HALF).then_some(begin)
    }

    /// Whether a step waits for SYNC. The machine is not ready at the end of the step before.
    fn waits(&self) -> bool {
        let Phase::Started(started) = self.phase else {
            return false;
        };
        let first = self.begun.is_empty() && (self.start != Start::AtOnce || self.pace == Pace::EachOnSync);
        let ready = self.begun.last().map_or(0, |at| at + 2 * HALF + SYNC_READY);
        let more = self.begun.len() < self.words.len() && !self.dry;
        more && (first || self.pace == Pace::EachOnSync) && ready <= self.now - started
    }

    /// Whether it is the first half of a step that is played.
    pub(crate) fn triggers_next(&self) -> bool {
        let Phase::Started(started) = self.phase else {
            return false;
        };
        self.plays()
            .is_some_and(|begin| self.now - started < begin + HALF)
    }

    /// Lets time pass until the next moment.
    pub(crate) fn advance(&mut self, camera: Camera) {
        let Some(begin) = self.plays() else {
            self.now += HALF;
            return;
        };
        let Phase::Started(started) = self.phase else {
            return;
        };
        let first = self.triggers_next();
        let lingers = self
            .truth()
            .exposures
            .last()
            .is_some_and(|[_, off]| *off > begin + HALF);
        let pulse = match (first, camera) {
            (true, Camera::Obeys) => Some([TRIGGER + 20, TRIGGER + 320]),
            (true, Camera::Lingers) => Some([TRIGGER + 20, 2 * HALF + TRIGGER / 2]),
            (false, Camera::Errs) if !lingers => Some([HALF + 10, HALF + 20]),
            _ => None,
        };
        if let Some(pulse) = pulse {
            let [on, off] = pulse.map(|at| begin + at);
            self.seen
                .extend([(Seen::Strobe(true), on), (Seen::Strobe(false), off)]);
            self.truth().exposures.push([on, off]);
        }
        self.now = started + begin + if first { HALF } else { 2 * HALF };
        if !first {
            if self.begun.len() == self.words.len() {
                self.dry = true;
            } else if self.pace == Pace::FreeRunning {
                self.begin(begin + 2 * HALF);
            }
        }
    }

    /// An edge of SYNC comes.
    pub(crate) fn sync_edge(&mut self) {
        let Phase::Started(started) = self.phase else {
            return;
        };
        let (at, begins) = (self.now - started, self.waits());
        if begins {
            self.begin(at + SYNC_LATENCY);
        }
        if !self.cut {
            self.seen.push_back((Seen::Sync { begins }, at));
        }
    }

    fn begin(&mut self, at: u64) {
        self.begun.push(at);
        self.truth().steps.push(at);
    }

    /// As long as a run goes on its times count from the start of the machines.
    fn truth(&mut self) -> &mut Truth {
        self.truths.last_mut().expect("a run was armed")
    }

    /// The outputs rest, and will.
    fn freeze(&mut self) {
        let Phase::Started(started) = self.phase else {
            return;
        };
        let rests = self.now - started;
        let first = self.truth().steps.first().copied();
        let paced = self.pace == Pace::EachOnSync;
        let origin = first.map_or(0, |at| at - if paced { SYNC_LATENCY } else { 0 });
        let truth = self.truth();
        truth.steps.iter_mut().for_each(|at| *at -= origin);
        for edge in truth.exposures.as_flattened_mut() {
            *edge -= origin;
        }
        truth.rests = Some(rests.saturating_sub(origin));
    }

    fn stop(&mut self) {
        self.freeze();
        self.phase = Phase::Resting;
    }

    /// Words that the machine has taken.
    fn taken(&self) -> u32 {
        let begun = self.begun.len();
        begun.checked_sub(1).map_or(0, |last| self.words[last])
    }

    fn feed(&mut self, session: &mut Session) -> bool {
        let through = self.begun.len() as u64 - u64::from(self.plays().is_some());
        if self.cut || self.dry || self.words.len() as u64 - through >= BLOCKS {
            return false;
        }
        let Some(fetched) = session.next_step(|_| ()) else {
            // Nothing more to be had now.
            self.starved |= self.is_started();
            return false;
        };
        self.progress.push(fetched.words, fetched.period);
        let before = self.words.last().copied().unwrap_or(0);
        self.words.push(before + fetched.words as u32);
        true
    }

    /// Reports the next edge that has come by `elapsed`.
    fn report_edge(&mut self, session: &mut Session, started: u64, elapsed: u64) -> bool {
        let Some((seen, at)) = self.seen.pop_front_if(|(_, at)| *at <= elapsed) else {
            return false;
        };
        match (seen, self.origin) {
            (Seen::Sync { begins }, _) => self.report_sync(session, started, at, begins),
            (Seen::Strobe(active), Some(origin)) if at >= origin => {
                session.strobe(active, Ticks(at - origin));
            }
            (Seen::Strobe(_), _) => {}
        }
        true
    }

    fn report_sync(&mut self, session: &mut Session, started: u64, at: u64, begins: bool) {
        let paced = self.pace == Pace::EachOnSync;
        if begins && self.origin.is_none() {
            let origin = if paced { at } else { at + SYNC_LATENCY };
            self.origin = Some(origin);
            session.begun(Ticks(started + origin));
        }
        let (Some(origin), true) = (self.origin, paced) else {
            return;
        };
        if begins {
            self.known += 1;
            self.progress.sync(Ticks(at - origin));
        }
        session.sync(Ticks(at - origin), begins);
    }

    fn report_progress(&mut self, session: &mut Session, elapsed: u64) {
        let now = elapsed.saturating_sub(self.origin.unwrap_or(elapsed));
        if self.origin.is_some() {
            let fired = self.progress.fired(self.taken(), Ticks(now));
            session.fired(fired, Ticks(now));
        }
        let awaited = match self.origin {
            Some(_) => self
                .progress
                .awaits_sync_since(Ticks(now))
                .map(|since| now - since.0),
            None => Some(elapsed),
        };
        let cut_between = self.cut && self.plays().is_none();
        if self.pace == Pace::EachOnSync && self.begun.len() > self.known {
            session.sync_unclear(StepId(self.known as u64));
        } else if self.dry || cut_between {
            self.finish(session);
        } else if self.sync_timeout > 0 && awaited.is_some_and(|awaited| awaited > self.sync_timeout) {
            session.sync_missing();
        }
    }

    fn finish(&mut self, session: &mut Session) {
        let fired = self.progress.fired(self.taken(), Ticks(u64::MAX));
        let end = self.progress.ended();
        let complete = match self.total {
            Some(total) => fired == total,
            None => fired == self.progress.fetched() || self.starved,
        };
        if complete || session.sequencer().is_stopping() {
            self.stop();
            session.fired(fired, end);
            session.drained(end);
        } else {
            session.engine_failed();
        }
    }

    fn report_halt(&mut self, session: &mut Session, after: u64, taken: u32) {
        let now = after.saturating_sub(self.origin.unwrap_or(after));
        if self.origin.is_some() {
            let fired = self.progress.fired(taken, Ticks(now));
            session.fired(fired, Ticks(now));
        }
        self.stop();
        session.halted(Ticks(now));
    }
}

impl PulseEngine for Engine {
    fn turn(&mut self, session: &mut Session) -> bool {
        match self.phase {
            Phase::Resting => false,
            Phase::Primed => self.feed(session),
            Phase::Halted {
                started,
                after,
                taken,
            } => {
                let more = self.report_edge(session, started, after);
                if !more {
                    self.report_halt(session, after, taken);
                }
                more
            }
            Phase::Started(at) => {
                let elapsed = self.now - at;
                if session.sequencer().is_stopping() && !self.cut {
                    self.cut = true;
                    // A step that waits for SYNC is in the FIFO by now.
                    let waits = self.pace == Pace::EachOnSync || self.begun.is_empty();
                    self.words.truncate(self.begun.len() + usize::from(waits));
                }
                let paced = self.pace == Pace::EachOnSync;
                let more = (paced && self.report_edge(session, at, elapsed))
                    | self.feed(session)
                    | self.report_edge(session, at, elapsed);
                if !more {
                    self.report_progress(session, elapsed);
                }
                more
            }
        }
    }

    fn prime(&mut self, session: &mut Session) {
        if self.phase != Phase::Resting {
            self.wrong = Some("a run is primed while the one before is not told of");
        }
        let Some(&program) = session.sequencer().program() else {
            self.wrong = Some("a run is primed without a schedule");
            return;
        };
        *self = Self {
            now: self.now,
            phase: Phase::Primed,
            pace: program.pace,
            start: program.start,
            total: match program.extent {
                Extent::Table { steps, cycles } => Some(u64::from(steps) * u64::from(cycles)),
                Extent::Stream => None,
            },
            sync_timeout: program.sync_timeout.to_ticks(1000 * HALF as u32).0,
            progress: Progress::new(program.pace),
            truths: core::mem::take(&mut self.truths),
            wrong: self.wrong,
            ..Self::new()
        };
        self.truths.push(Truth {
            total: self.total,
            ..Truth::default()
        });
    }

    fn go(&mut self, start: Start, session: &mut Session) {
        if self.phase != Phase::Primed {
            self.wrong = Some("what is not primed is started");
            return;
        }
        self.phase = Phase::Started(self.now);
        if start == Start::AtOnce && self.pace == Pace::FreeRunning {
            self.origin = Some(0);
            session.begun(Ticks(self.now));
            if self.words.is_empty() {
                self.dry = true;
            } else {
                self.begin(0);
            }
        } else {
            self.dry = self.words.is_empty();
        }
    }

    fn halt(&mut self) {
        let (started, after, taken) = match self.phase {
            Phase::Started(started) => (started, self.now - started, self.taken()),
            _ => (0, 0, 0),
        };
        self.freeze();
        self.phase = Phase::Halted {
            started,
            after,
            taken,
        };
    }

    fn watch(&mut self) {
        if self.phase != Phase::Resting {
            self.wrong = Some("inputs are watched while a run goes on");
        }
    }

    fn keep(&mut self, _: Kept) {
        if self.phase != Phase::Resting {
            self.wrong = Some("a polarity is kept while a run goes on");
        }
    }

    fn store(&mut self, _: u16, _: &[u8]) {
        if self.phase != Phase::Resting {
            self.wrong = Some("a page is written while a run goes on");
        }
    }

    fn stored(&mut self) -> Option<Stored> {
        None
    }

    fn inputs(&mut self) -> Inputs {
        Inputs::default()
    }

    fn photo(&mut self) -> Input {
        Input::default()
    }
}
