//! The firmware's own logic as a peer, with a journal of what it really did.
//!
//! # Design
//! Between the firmware's session and the line stands what the board has there: a decoder, and a pulse
//! engine that fetches a few steps ahead and plays their words. This engine plays free-running steps and has
//! a camera whose STROBE follows CAM. The journal is written from what comes out of the session (commands
//! to the engine, steps to play), not from what it counts.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use rcg_firmware::pulse::{Played, Reader, StepWords};
use rcg_firmware::sequencer::Fetched;
use rcg_firmware::session::{Action, EngineCommand, Session};
use rcg_protocol::{
    Decoder, Level, Line, MAX_FRAME, RunId, State, StepFlags, StepId, StepRecord, Strobe, Ticks, ToDevice,
    encode,
};

use crate::world::Peer;

/// One tick of the controller's clock, 125 MHz.
pub const TICK_NS: u64 = 8;
/// From the leading edge of CAM to that of STROBE.
pub const STROBE_DELAY: Ticks = Ticks(100);
/// How long STROBE lasts. Steps of these tests are longer than both.
pub const STROBE_WIDTH: Ticks = Ticks(200);
/// Steps that the engine fetches ahead.
const AHEAD: usize = 4;
/// The board looks at its time-outs this often.
const POLL_NS: u64 = 5_000_000;

/// What the hardware does next; in this order where it is at one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Happening {
    StrobeOff,
    StrobeOn,
    StepEnds,
}

/// What the controller really did.
#[derive(Clone, Debug, Default)]
pub struct Journal {
    /// Requests that the session executed, in order.
    pub executed: Vec<ToDevice>,
    /// How often the engine was primed.
    pub primed: u32,
    /// How often the engine was fired.
    pub fired: u32,
    /// How often the engine was halted.
    pub halted: u32,
    /// The words of every step that was played whole.
    pub played: Vec<(RunId, StepId, StepWords)>,
    /// What the camera did at every step that was begun, as it must be reported.
    pub truth: BTreeMap<(RunId, StepId), StepRecord>,
}

/// A controller.
#[derive(Debug)]
pub struct Controller {
    session: Box<Session>,
    decoder: Decoder,
    journal: Journal,
    missed: BTreeSet<u64>,
    queue: VecDeque<(Fetched, StepWords)>,
    reader: Option<Reader>,
    /// When the run began.
    began: Option<Ticks>,
    playing: Option<(Fetched, StepWords)>,
    done: u64,
    happenings: BTreeSet<(Ticks, Happening)>,
    next_poll_ns: u64,
}

impl Controller {
    /// A controller that was just switched on, whose camera misses the steps `missed` of every run.
    #[must_use]
    pub fn new(missed: &[u64]) -> Self {
        Self {
            session: Box::new(Session::new(1_000_000_000 / TICK_NS as u32, 1000)),
            decoder: Decoder::new(),
            journal: Journal::default(),
            missed: missed.iter().copied().collect(),
            queue: VecDeque::new(),
            reader: None,
            began: None,
            playing: None,
            done: 0,
            happenings: BTreeSet::new(),
            next_poll_ns: POLL_NS,
        }
    }

    /// Its session, to look at.
    #[must_use]
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// What it really did.
    #[must_use]
    pub const fn journal(&self) -> &Journal {
        &self.journal
    }

    fn command_engine(&mut self, now: Ticks) {
        while let Some(command) = self.session.engine_action() {
            match command {
                EngineCommand::Prime => {
                    self.journal.primed += 1;
                    self.forget();
                    let format = self.session.sequencer().format().expect("a program is loaded");
                    self.reader = Some(Reader::new(format, Ticks::ZERO));
                    self.fetch();
                }
                EngineCommand::Go(_) => {
                    self.journal.fired += 1;
                    self.began = Some(now);
                    self.session.begun(now);
                    self.begin_step(Ticks::ZERO);
                }
                EngineCommand::Halt => {
                    self.journal.halted += 1;
                    let at = self.began.map_or(Ticks::ZERO, |began| now.saturating_sub(began));
                    self.forget();
                    self.session.halted(at);
                }
                EngineCommand::Watch | EngineCommand::Keep(_) => {}
            }
        }
    }

    fn forget(&mut self) {
        self.queue.clear();
        self.happenings.clear();
        self.playing = None;
        self.began = None;
        self.done = 0;
    }

    fn fetch(&mut self) {
        let mut words = StepWords::new();
        while self.queue.len() < AHEAD
            && let Some(fetched) = self.session.next_step(|piece| {
                words
                    .extend_from_slice(piece)
                    .expect("a step has room for its words");
            })
        {
            self.queue.push_back((fetched, std::mem::take(&mut words)));
        }
    }

    fn begin_step(&mut self, at: Ticks) {
        let Some((fetched, words)) = self.queue.pop_front() else {
            self.session.drained(at);
            return;
        };
        let mut trigger = None;
        let reader = self.reader.as_mut().expect("the engine was primed");
        for &word in &words {
            let played = reader.play(
                word,
                |_| None,
                |edge| {
                    if (edge.line, edge.level) == (Line::Cam, Level::Active) {
                        trigger = Some(edge.at);
                    }
                },
            );
            assert_eq!(played, Played::Through, "these steps run free");
        }
        self.happenings.insert((reader.now(), Happening::StepEnds));
        let mut record = StepRecord {
            step: fetched.step,
            trigger: trigger.unwrap_or(at),
            strobe: None,
            flags: if trigger.is_some() {
                StepFlags::MISSED
            } else {
                StepFlags::NO_TRIGGER
            },
        };
        if let Some(trigger) = trigger
            && !self.missed.contains(&fetched.step.0)
        {
            let on = trigger + STROBE_DELAY;
            self.happenings.insert((on, Happening::StrobeOn));
            self.happenings.insert((on + STROBE_WIDTH, Happening::StrobeOff));
            record.strobe = Some(Strobe {
                delay: STROBE_DELAY,
                width: STROBE_WIDTH,
            });
            record.flags = StepFlags::default();
        }
        let run = self.session.sequencer().run();
        self.journal.truth.insert((run, fetched.step), record);
        self.playing = Some((fetched, words));
    }

    fn happen(&mut self, at: Ticks, happening: Happening) {
        match happening {
            Happening::StrobeOff => self.session.strobe(false, at),
            Happening::StrobeOn => self.session.strobe(true, at),
            Happening::StepEnds => {
                self.done += 1;
                if let Some((fetched, words)) = self.playing.take() {
                    let run = self.session.sequencer().run();
                    self.journal.played.push((run, fetched.step, words));
                }
                self.session.fired(self.done, at);
                self.fetch();
                self.begin_step(at);
            }
        }
    }

    fn next_happening_ns(&self) -> Option<u64> {
        let (at, _) = self.happenings.first()?;
        Some((self.began? + *at).0 * TICK_NS)
    }
}

impl Peer for Controller {
    fn byte(&mut self, now_ns: u64, byte: u8) {
        let now = Ticks(now_ns / TICK_NS);
        match self.decoder.push::<ToDevice>(byte) {
            None => {}
            Some(Err(_)) => self.session.corrupt_frame(),
            Some(Ok(message)) => {
                let executed = self.session.counters().executed;
                self.session.request(now, &message);
                if self.session.counters().executed != executed {
                    self.journal.executed.push(message);
                }
            }
        }
        self.command_engine(now);
    }

    fn tick(&mut self, now_ns: u64) {
        while let Some(at_ns) = self.next_happening_ns()
            && at_ns <= now_ns
            && let Some((at, happening)) = self.happenings.pop_first()
        {
            self.happen(at, happening);
        }
        if self.next_poll_ns <= now_ns {
            self.session.poll(Ticks(now_ns / TICK_NS));
            self.next_poll_ns = now_ns + POLL_NS;
        }
        self.command_engine(Ticks(now_ns / TICK_NS));
        let live = matches!(self.session.sequencer().state(), State::Armed | State::Running);
        assert!(
            live || self.happenings.is_empty() || self.playing.is_none(),
            "the engine runs by itself"
        );
    }

    fn next_tick_ns(&self) -> Option<u64> {
        Some(
            self.next_happening_ns()
                .map_or(self.next_poll_ns, |at| at.min(self.next_poll_ns)),
        )
    }

    fn say(&mut self) -> Option<Vec<u8>> {
        match self.session.action()? {
            Action::Engine(engine) => unreachable!("{engine:?} was taken at once"),
            Action::Send(message) => {
                let mut buffer = [0; MAX_FRAME];
                let frame = encode(&message, &mut buffer).expect("MAX_FRAME holds every message");
                Some(frame.to_vec())
            }
        }
    }
}
