//! The trigger box in virtual time, for tests and for what stands in for a board.
//!
//! # Design
//! Bytes go through the decoder and the session; its engine commands play the schedule's own words by their reference
//! reading, edge by edge, into what stands at the pins. Time moves only when it is told to, never beyond what it is told,
//! and word by word: a run proceeds exactly as fast as the host takes it in, nothing piles up, and a host that makes itself
//! heard while a long word lasts is heard in time.

extern crate alloc;

use alloc::collections::VecDeque;

use rcg_protocol::{
    Decoder, Fault, Input, Inputs, Line, MAX_FRAME, Pace, Polarity, Request, Start, Ticks, ToDevice, encode,
};

use crate::pulse::{Edge, Played, Reader, SYNC_LATENCY, StepWords, WordFormat};
use crate::session::{Action, EngineCommand, Session};
use crate::stored;
use crate::virtual_flash::VirtualFlash;

/// An edge of the STROBE line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StrobeEdge {
    /// On the box's clock.
    pub at: Ticks,
    /// The level after the edge.
    pub active: bool,
}

/// What stands at the pins of the box. Times are on the box's clock.
pub trait Pins {
    /// An output takes a level; times never decrease. Returns the edge of STROBE that this brings about, then or later.
    fn edge(&mut self, edge: Edge) -> Option<StrobeEdge>;

    /// The first edge of SYNC at `from` or later; `None` if none will come.
    fn next_sync(&mut self, from: Ticks) -> Option<Ticks>;

    /// The first edge of START at `from` or later; `None` if none will come.
    fn next_start(&mut self, from: Ticks) -> Option<Ticks> {
        let _ = from;
        None
    }

    /// What stands at `line`, an input, at `now`: its edges are counted from `since` on. `active_low` says what the box takes for
    /// rest, whither it pulls the line. `None` if the box shall tell what it knows by itself: nobody drives SYNC, and STROBE has the
    /// edges that came of those of the outputs.
    fn input(&mut self, line: Line, since: Ticks, now: Ticks, active_low: bool) -> Option<Input> {
        let _ = (line, since, now, active_low);
        None
    }
}

/// What was seen of an input.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    active: bool,
    edges: u32,
    last: [Option<Ticks>; 2],
}

impl Tally {
    fn add(&mut self, at: Ticks, active: bool) {
        self.active = active;
        self.edges = self.edges.saturating_add(1);
        self.last = [self.last[1], Some(at)];
    }

    /// As a box tells it that pulls the line up or not. What drives it is high while it is active, whatever the box takes for rest.
    fn input(self, active_low: bool) -> Input {
        Input {
            high: self.active,
            pulled_up: active_low,
            edges: Some(self.edges),
            last: self.last,
        }
    }
}

/// What the run is at.
#[derive(Debug)]
enum Phase {
    /// Its first step begins at [`Run::started`].
    Ahead,
    /// Its words play. The reader's time is when the next one begins.
    Playing,
    /// A word waits for the SYNC edge at this time from the start, which is still to be told.
    Synced(Ticks),
    /// SYNC does not come before the time-out, which is over at this time from the start.
    SyncLost(Ticks),
    /// SYNC never comes, and there is no time-out.
    Waiting,
    /// The last word is over; edges of STROBE may still come, until this time from the start.
    Draining(Ticks),
}

/// The run that is being played. Times of the reader count from its start.
#[derive(Debug)]
struct Run {
    reader: Reader,
    started: Ticks,
    phase: Phase,
    /// Words of the present step that are still to be played, the next one last.
    words: StepWords,
    /// Whether a step has begun that is not over.
    in_step: bool,
    steps: u64,
    strobes: VecDeque<StrobeEdge>,
    /// The SYNC edge that the session was told of last.
    last_sync: Option<Ticks>,
}

impl Run {
    /// When something is to be done next, on the box's clock.
    fn due(&self) -> Ticks {
        match self.phase {
            Phase::Ahead => self.started,
            Phase::Playing | Phase::Synced(_) => self.started + self.reader.now(),
            Phase::SyncLost(at) | Phase::Draining(at) => self.started + at,
            Phase::Waiting => Ticks(u64::MAX),
        }
    }

    /// Brings the outputs to rest at `at` from the start.
    fn halt(&mut self, at: Ticks, pins: &mut impl Pins) {
        let (started, strobes) = (self.started, &mut self.strobes);
        self.reader
            .halt(at, |edge| strobes.extend(pins.edge(since(started, edge))));
    }
}

/// `edge` of a run that began at `started`, on the box's clock.
fn since(started: Ticks, edge: Edge) -> Edge {
    Edge {
        at: started + edge.at,
        ..edge
    }
}

/// A trigger box with `P` at its pins.
#[derive(Debug)]
pub struct VirtualBox<P> {
    pins: P,
    clock_hz: u32,
    session: Session,
    decoder: Decoder,
    now: Ticks,
    primed: Option<Reader>,
    run: Option<Run>,
    /// What the box takes for active.
    polarity: Polarity,
    /// Since when edges of the inputs are counted, and those of STROBE.
    counts_since: Ticks,
    strobe: Tally,
    memory: VirtualFlash,
}

impl<P: Pins> VirtualBox<P> {
    /// A box whose clock of `clock_hz` shows `now`; sessions are told apart by `seed`.
    pub fn new(pins: P, clock_hz: u32, seed: u32, now: Ticks) -> Self {
        Self {
            pins,
            clock_hz,
            session: Session::new(clock_hz, seed),
            decoder: Decoder::new(),
            now,
            primed: None,
            run: None,
            polarity: Polarity::default(),
            counts_since: now,
            strobe: Tally::default(),
            memory: VirtualFlash::default(),
        }
    }

    /// The same, switched on with what is kept in `memory`; what it says is handed to `say`, a frame each.
    ///
    /// # Errors
    /// What is wrong with a schedule that is kept; it runs nothing then.
    pub fn switched_on(
        mut self,
        memory: VirtualFlash,
        mut say: impl FnMut(&[u8]),
    ) -> (Self, Result<(), Fault>) {
        self.memory = memory;
        let memory = self.memory.clone();
        let Some((stored, requests)) = stored::read(memory.bytes(), self.clock_hz) else {
            return (self, Ok(()));
        };
        self.session.set_stored(Some(stored));
        let made = stored::recall(requests, |request| {
            self.session.recall(self.now, request)?;
            self.act(&mut say);
            Ok(())
        });
        (self, made)
    }

    /// What is kept over power-downs.
    #[must_use]
    pub const fn memory(&self) -> &VirtualFlash {
        &self.memory
    }

    /// What stands at the inputs.
    fn inputs(&mut self) -> Inputs {
        let (since, now, polarity) = (self.counts_since, self.now, self.polarity);
        let mut input = |line, active_low, tally: Tally| {
            let seen = self.pins.input(line, since, now, active_low);
            seen.unwrap_or_else(|| tally.input(active_low))
        };
        Inputs {
            at: now,
            since,
            // Nobody drives it, as far as the box knows.
            sync: input(
                Line::Sync,
                polarity.sync_active_low,
                Tally {
                    active: polarity.sync_active_low,
                    ..Tally::default()
                },
            ),
            strobe: input(Line::Strobe, polarity.strobe_active_low, self.strobe),
        }
    }

    /// Counts edges of the inputs from now on.
    fn watch(&mut self) {
        self.counts_since = self.now;
        self.strobe = Tally {
            active: self.strobe.active,
            ..Tally::default()
        };
    }

    /// What its clock shows.
    pub const fn now(&self) -> Ticks {
        self.now
    }

    /// Whether a run is under way.
    pub const fn is_running(&self) -> bool {
        self.run.is_some()
    }

    /// What stands at its pins.
    pub const fn pins(&mut self) -> &mut P {
        &mut self.pins
    }

    /// Takes in what the host sends; answers are handed to `say`, a frame each.
    pub fn hear(&mut self, bytes: &[u8], mut say: impl FnMut(&[u8])) {
        for &byte in bytes {
            match self.decoder.push::<ToDevice>(byte) {
                Some(Ok(message)) => {
                    if message.request == Request::Inputs {
                        let inputs = self.inputs();
                        self.session.seen(inputs);
                    }
                    if message.request == Request::Photo {
                        let (since, now) = (self.counts_since, self.now);
                        let seen = self.pins.input(Line::Photo, since, now, false);
                        self.session.photo_seen(seen.unwrap_or_default());
                    }
                    self.session.request(self.now, &message);
                    if let &Request::Store { page, ref bytes } = &message.request
                        && self.session.takes_page()
                    {
                        self.memory.store(page, bytes);
                        let stored = stored::read(self.memory.bytes(), self.clock_hz).filter(|_| page == 0);
                        self.session.set_stored(stored.map(|(stored, _)| stored));
                    }
                }
                Some(Err(_)) => self.session.corrupt_frame(),
                None => {}
            }
            self.act(&mut say);
        }
    }

    /// Looks whether a time-out is over, such as that of a host that has fallen silent.
    pub fn poll(&mut self) {
        self.session.poll(self.now);
    }

    /// Does what the session wants done; messages are handed to `say`, a frame each.
    ///
    /// # Panics
    /// If a message is longer than the protocol allows.
    pub fn act(&mut self, mut say: impl FnMut(&[u8])) {
        while let Some(action) = self.session.action() {
            match action {
                Action::Send(message) => {
                    let mut buffer = [0; MAX_FRAME];
                    say(encode(&message, &mut buffer).expect("MAX_FRAME holds every message"));
                }
                Action::Engine(EngineCommand::Prime) => {
                    let format = self.session.sequencer().format();
                    let format =
                        format.unwrap_or_else(|| WordFormat::new(Pace::FreeRunning, Polarity::default()));
                    self.primed = Some(Reader::new(format, Ticks::ZERO));
                    let program = self.session.sequencer().program();
                    self.polarity = program.map_or(self.polarity, |program| program.polarity);
                }
                Action::Engine(EngineCommand::Go(start)) => self.go(start),
                Action::Engine(EngineCommand::Halt) => self.halt(),
                Action::Engine(EngineCommand::Watch) => self.watch(),
                Action::Engine(EngineCommand::Keep(kept)) => self.polarity = kept.lines,
            }
        }
    }

    fn go(&mut self, start: Start) {
        let Some(reader) = self.primed.take() else { return };
        self.watch();
        let (mut started, mut phase) = (self.now, Phase::Ahead);
        if start != Start::AtOnce {
            // An edge at this very tick is over before the engine waits for it.
            let from = self.now + Ticks(1);
            let edge = match start {
                Start::OnStartLine => self.pins.next_start(from),
                _ => self.pins.next_sync(from),
            };
            match self.awaited(Ticks::ZERO, edge.map(|edge| edge - self.now)) {
                Ok(awaited) => started = self.now + awaited + Ticks(SYNC_LATENCY),
                Err(lost) => phase = lost,
            }
        }
        self.run = Some(Run {
            reader,
            started,
            phase,
            words: StepWords::new(),
            in_step: false,
            steps: 0,
            strobes: VecDeque::new(),
            last_sync: None,
        });
    }

    /// The SYNC edge `sync` that is awaited since `from` (both from the start of the run), or what becomes of the run if
    /// the time-out is over before, or if none comes.
    fn awaited(&self, from: Ticks, sync: Option<Ticks>) -> Result<Ticks, Phase> {
        let program = self.session.sequencer().program();
        let program = program.filter(|program| program.start != Start::OnStartLine);
        let timeout = program.map_or(Ticks::ZERO, |program| {
            program.sync_timeout.to_ticks(self.clock_hz)
        });
        let in_time = sync.filter(|sync| timeout == Ticks::ZERO || *sync - from <= timeout);
        in_time.ok_or(if timeout > Ticks::ZERO {
            Phase::SyncLost(from + timeout)
        } else {
            Phase::Waiting
        })
    }

    fn halt(&mut self) {
        self.primed = None;
        let mut at = Ticks::ZERO;
        if let Some(mut run) = self.run.take() {
            at = self.now.saturating_sub(run.started);
            run.halt(at, &mut self.pins);
        }
        self.session.halted(at);
    }

    /// Lets time go on, to `deadline` at most: to what the run does next, which is done, or by a millisecond, after which
    /// a board would look for time-outs.
    pub fn advance(&mut self, deadline: Ticks) {
        let look = self.now + Ticks(u64::from(self.clock_hz) / 1000);
        let Some(mut run) = self.run.take() else {
            self.now = look.min(deadline);
            return;
        };
        let due = run.due();
        self.now = self.now.max(due.min(deadline).min(look));
        self.report_strobes(&mut run);
        if self.now < due || self.proceed(&mut run) {
            self.run = Some(run);
        }
    }

    /// Does what is due in `run`; returns whether it goes on.
    fn proceed(&mut self, run: &mut Run) -> bool {
        match run.phase {
            Phase::Ahead => {
                self.session.begun(run.started);
                run.phase = Phase::Playing;
            }
            Phase::Synced(edge) => {
                self.report_syncs(run, edge);
                run.phase = Phase::Playing;
            }
            Phase::SyncLost(_) => self.session.sync_missing(),
            Phase::Waiting => {}
            Phase::Draining(at) => {
                self.session.drained(at);
                return false;
            }
            Phase::Playing => self.play(run),
        }
        true
    }

    /// Plays the next word, of the next step if none of the present one is left.
    fn play(&mut self, run: &mut Run) {
        if run.words.is_empty() && !self.next_step(run) {
            // The engine rests after its last word, as if one more of resting levels followed.
            let end = run.reader.now();
            run.halt(end, &mut self.pins);
            let last = run.strobes.back().map_or(end, |edge| edge.at - run.started);
            run.phase = Phase::Draining(last.max(end));
            return;
        }
        let word = run.words.pop().expect("a step has words");
        let (from, started, strobes) = (run.reader.now(), run.started, &mut run.strobes);
        // Both ask what stands at the pins, one after the other.
        let pins = core::cell::RefCell::new(&mut self.pins);
        let mut waited = None;
        let next_sync = |from: Ticks| {
            let edge = pins.borrow_mut().next_sync(started + from);
            let edge = edge.map(|edge| edge - started);
            waited = Some(edge);
            edge
        };
        let emit = |edge: Edge| strobes.extend(pins.borrow_mut().edge(since(started, edge)));
        let played = run.reader.play(word, next_sync, emit);
        debug_assert!(
            played == Played::Through || waited == Some(None),
            "only SYNC holds a run up"
        );
        if let Some(edge) = waited {
            run.phase = self.awaited(from, edge).map_or_else(|lost| lost, Phase::Synced);
        }
    }

    /// Ends the present step of `run` and fetches the words of the next one; returns whether there is one.
    fn next_step(&mut self, run: &mut Run) -> bool {
        if core::mem::take(&mut run.in_step) {
            run.steps += 1;
            self.session.fired(run.steps, run.reader.now());
        }
        let words = &mut run.words;
        let push = |piece: &[u32]| {
            words
                .extend_from_slice(piece)
                .expect("a step has room for its words");
        };
        run.in_step = self.session.next_step(push).is_some();
        run.words.reverse();
        run.in_step
    }

    /// Tells the session of the SYNC edges up to `begins_step`, which began a step.
    fn report_syncs(&mut self, run: &mut Run, begins_step: Ticks) {
        while let Some(last) = run.last_sync {
            let next = self.pins.next_sync(run.started + last + Ticks(1));
            let Some(edge) = next
                .map(|edge| edge - run.started)
                .filter(|edge| *edge < begins_step)
            else {
                break;
            };
            self.session.sync(edge, false);
            run.last_sync = Some(edge);
        }
        self.session.sync(begins_step, true);
        run.last_sync = Some(begins_step);
    }

    /// Tells the session of the edges of STROBE that have come.
    fn report_strobes(&mut self, run: &mut Run) {
        while let Some(edge) = run.strobes.pop_front_if(|edge| edge.at <= self.now) {
            self.strobe.add(edge.at, edge.active);
            self.session
                .strobe(edge.active, edge.at.saturating_sub(run.started));
        }
    }
}
