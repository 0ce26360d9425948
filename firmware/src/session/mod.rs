//! Requests in, responses, events and engine commands out.
//!
//! # Design
//! Sans-IO: the caller decodes frames and passes messages and hardware events with their time; it then
//! takes [`Action`]s until there is none left. Every request is executed at most once: a request of the
//! same number is answered again from memory, an older one is dropped, one of a former session is answered
//! with [`Fault::StaleSession`]. Hence `frames = executed + repeated + stale` at all times.
//!
//! # Tradeoffs
//! When the link is slower than the telemetry, step records are dropped and counted rather than delaying a
//! response; the host measures again what it has no record of.

mod reports;

use heapless::Deque;
use rcg_protocol::{
    Counters, Event, Extent, Fault, Identity, Info, PROTOCOL_VERSION, Pace, Reply, Request, SCHEMA_HASH, Seq,
    SessionId, Start, State, Status, StepFlags, Ticks, ToDevice, ToHost,
};

use crate::burst::{Burst, SLACK_US, STEP_COST_US};
use crate::outbox::Outbox;
use crate::pulse::{FREE_OVERHEAD, LONGEST_PERIOD, PACED_OVERHEAD, SYNC_LATENCY};
use crate::sequencer::{Fetched, Sequencer};
use crate::store::{MAX_STEPS, MAX_WORDS};
use crate::vsync::{Regularity, VsyncWatch};
use crate::witness::{Sighting, Witness};

/// Step records wait at most this part of a second for their batch to fill: 20 ms.
const FLUSHES_PER_SECOND: u32 = 50;
/// From one poll to the next, and until the outputs have followed.
const LATENESS_US: u32 = 1_500;
/// A stream reports room again when this many steps were played.
const ROOM_EVERY: u64 = 64;

/// What the caller has to do.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant)] // taken and consumed at once, on the stack
pub enum Action {
    /// Send this to the host.
    Send(ToHost),
    /// Command the pulse engine.
    Engine(EngineCommand),
}

/// Commands to the pulse engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EngineCommand {
    /// Set the PIO up for the loaded program and fill its first blocks with [`Session::next_step`].
    Prime,
    /// Fire, at once or at the first SYNC edge.
    Go(Start),
    /// Bring both outputs to rest now and forget what was fetched; then report what is left to report, how many
    /// steps were [fired](Session::fired), and [`Session::halted`].
    Halt,
}

/// One controller's end of the conversation.
#[derive(Debug)]
pub struct Session {
    clock_hz: u32,
    id: SessionId,
    nonce: Option<u32>,
    last: Option<(Seq, Result<Reply, Fault>)>,
    vsync: VsyncWatch,
    counters: Counters,
    batch_since: Ticks,
    last_heard: Ticks,
    /// How long the host may be silent in this run; zero for ever.
    dead_man: Ticks,
    engine: Option<EngineCommand>,
    /// The engine was told to halt and has not said yet how far it got.
    halting: bool,
    /// Whether steps have records.
    witnessed: bool,
    /// The abort that is answered then, and when it came.
    unanswered: Option<(Seq, Ticks)>,
    /// Paced steps whose SYNC edge has not come: their trigger counts from it.
    awaiting_sync: Deque<Fetched, 4>,
    witness: Witness,
    outbox: Outbox,
    sequencer: Sequencer,
}

impl Session {
    /// A controller with a clock of `clock_hz`. `seed` should differ from boot to boot: sessions count from it.
    #[must_use]
    pub const fn new(clock_hz: u32, seed: u32) -> Self {
        Self {
            clock_hz,
            id: SessionId(seed),
            nonce: None,
            last: None,
            sequencer: Sequencer::new().with_step_cost(micros(STEP_COST_US, clock_hz)),
            witness: Witness::new(),
            vsync: VsyncWatch::new(),
            awaiting_sync: Deque::new(),
            counters: Counters {
                frames: 0,
                corrupt: 0,
                repeated: 0,
                stale: 0,
                executed: 0,
                records_lost: 0,
                spurious_strobes: 0,
            },
            batch_since: Ticks::ZERO,
            last_heard: Ticks::ZERO,
            dead_man: Ticks::ZERO,
            outbox: Outbox::new(),
            engine: None,
            halting: false,
            witnessed: true,
            unanswered: None,
        }
    }

    /// The sequencer, to look at.
    #[must_use]
    pub const fn sequencer(&self) -> &Sequencer {
        &self.sequencer
    }

    /// What was counted since boot.
    #[must_use]
    pub const fn counters(&self) -> &Counters {
        &self.counters
    }

    /// The next thing to do. Engine commands come before messages.
    pub fn action(&mut self) -> Option<Action> {
        if let Some(engine) = self.engine.take() {
            return Some(Action::Engine(engine));
        }
        let message = self.outbox.front().cloned()?;
        self.outbox.discard();
        Some(Action::Send(message))
    }

    /// The next engine command only, for a caller that is short of time.
    pub fn engine_action(&mut self) -> Option<EngineCommand> {
        self.engine.take()
    }

    /// The next message only, where it lies; [`message_sent`](Self::message_sent) takes it away.
    #[must_use]
    pub fn message(&self) -> Option<&ToHost> {
        self.outbox.front()
    }

    /// The next message was sent.
    pub fn message_sent(&mut self) {
        self.outbox.discard();
    }

    /// A frame came that could not be decoded.
    pub fn corrupt_frame(&mut self) {
        self.counters.corrupt += 1;
    }

    /// A request came.
    pub fn request(&mut self, now: Ticks, message: &ToDevice) {
        self.counters.frames += 1;
        let &ToDevice {
            session,
            seq,
            ref request,
        } = message;
        if let &Request::Hello { nonce } = request {
            self.last_heard = now;
            self.hello(seq, nonce);
            return;
        }
        // A former host that still talks does not keep the run of the present one alive.
        if session != self.id || self.nonce.is_none() {
            self.counters.stale += 1;
            self.respond(session, seq, Err(Fault::StaleSession));
            return;
        }
        self.last_heard = now;
        match self.last {
            Some((last, result)) if last == seq => {
                self.counters.repeated += 1;
                // The status is what it is now; anything else is what it was then.
                let result = match result {
                    Ok(Reply::Status(_)) => Ok(Reply::Status(self.status(now))),
                    other => other,
                };
                self.respond(session, seq, result);
            }
            Some((last, _)) if seq < last => self.counters.stale += 1,
            _ => {
                self.counters.executed += 1;
                let result = self.execute(now, request);
                self.last = Some((seq, result));
                if self.halting {
                    self.unanswered = Some((seq, now));
                } else {
                    self.respond(session, seq, result);
                }
            }
        }
    }

    fn hello(&mut self, seq: Seq, nonce: u32) {
        if self.nonce == Some(nonce) {
            self.counters.repeated += 1;
        } else {
            self.counters.executed += 1;
            self.id = SessionId(self.id.0.wrapping_add(1));
            self.nonce = Some(nonce);
            self.last = None;
        }
        let identity = Identity {
            protocol: PROTOCOL_VERSION,
            schema: SCHEMA_HASH,
            nonce,
            session: self.id,
        };
        self.respond(SessionId(0), seq, Ok(Reply::Identity(identity)));
    }

    fn execute(&mut self, now: Ticks, request: &Request) -> Result<Reply, Fault> {
        match request {
            Request::Hello { .. } | Request::Status => {}
            Request::Ping(number) => return Ok(Reply::Pong(*number)),
            Request::Describe => return Ok(Reply::Info(self.info())),
            Request::Load(program) => {
                self.sequencer.load(*program)?;
                return Ok(Reply::Room {
                    steps: self.sequencer.room(),
                });
            }
            Request::Append { first, steps, last } => {
                self.sequencer.append(*first, steps, *last)?;
                return Ok(Reply::Room {
                    steps: self.sequencer.room(),
                });
            }
            Request::Arm => {
                let run = self.sequencer.arm()?;
                let program = self.sequencer.program();
                self.dead_man = program.map_or(Ticks::ZERO, |p| p.dead_man.to_ticks(self.clock_hz));
                self.witness.clear();
                self.awaiting_sync.clear();
                self.vsync = VsyncWatch::new();
                self.witnessed = true;
                self.outbox.batch().clear();
                self.engine = Some(EngineCommand::Prime);
                return Ok(Reply::Armed { run });
            }
            Request::Start => {
                self.sequencer.start()?;
                let start = self.sequencer.program().map_or(Start::AtOnce, |p| p.start);
                self.engine = Some(EngineCommand::Go(start));
            }
            Request::Stop => self.sequencer.stop()?,
            Request::Abort => {
                if self.sequencer.abort() {
                    self.halt();
                }
            }
            Request::Clear => self.sequencer.clear()?,
        }
        Ok(Reply::Status(self.status(now)))
    }

    fn info(&self) -> Info {
        Info {
            firmware: crate::VERSION,
            clock_hz: self.clock_hz,
            max_steps: MAX_STEPS as u32,
            max_words: MAX_WORDS as u32,
            shortest_free: FREE_OVERHEAD,
            shortest_sync: PACED_OVERHEAD,
            longest_period: LONGEST_PERIOD,
        }
    }

    /// How things stand.
    #[must_use]
    pub fn status(&self, now: Ticks) -> Status {
        Status {
            state: self.sequencer.state(),
            run: self.sequencer.run(),
            steps_done: self.sequencer.steps_done(),
            fault: self.sequencer.fault(),
            now,
            counters: self.counters,
        }
    }

    /// The loaded table as a burst, if its steps are too short and too many to be told one by one.
    /// Then no step has a record, which is counted, and none is left to [`next_step`](Self::next_step). To be
    /// asked for when the engine is primed.
    pub fn burst(&mut self, slice_for: Ticks) -> Option<Burst> {
        let slack = micros(SLACK_US, self.clock_hz);
        let burst = self.sequencer.burst(slack, slice_for);
        self.witnessed = burst.is_none();
        burst
    }

    /// The next step for the engine, its words handed to `take` in one piece or two; `None` if it shall let what it
    /// has run out.
    pub fn next_step(&mut self, take: impl FnMut(&[u32])) -> Option<Fetched> {
        if self.awaiting_sync.is_full() {
            return None; // a paced engine fetches a step or two ahead, never this many
        }
        let fetched = self.sequencer.next_step(take)?;
        let paced = self
            .sequencer
            .program()
            .is_some_and(|p| p.pace == Pace::EachOnSync);
        if paced {
            self.awaiting_sync.push_back(fetched).ok();
        } else {
            self.announce(&fetched, fetched.begins);
        }
        Some(fetched)
    }

    fn announce(&mut self, fetched: &Fetched, begins: Ticks) {
        let at = fetched.trigger.map_or(begins, |offset| begins + offset);
        if let Some(record) = self.witness.announce(fetched.step, at, fetched.trigger.is_some()) {
            self.record(record, at);
        }
    }

    /// The first step began at `at` on the controller's clock. All later times of the run count from it.
    pub fn begun(&mut self, at: Ticks) {
        self.sequencer.begun(at);
        self.send_event(Event::Started {
            run: self.sequencer.run(),
            at,
        });
    }

    /// A SYNC edge of a paced run came at `edge` from its start, and may have begun the next step.
    pub fn sync(&mut self, edge: Ticks, begins_step: bool) {
        if begins_step && let Some(fetched) = self.awaiting_sync.pop_front() {
            self.announce(&fetched, edge + Ticks(SYNC_LATENCY));
        }
        match self.vsync.edge(edge) {
            Regularity::Regular => {}
            Regularity::AfterMissing => self.witness.flag_newest(StepFlags::SYNC_MISSED),
            Regularity::Extra => self.witness.flag_newest(StepFlags::SYNC_EXTRA),
        }
    }

    /// The engine has fired `steps` steps of this run whole, at `now` from the start of the run.
    pub fn fired(&mut self, steps: u64, now: Ticks) {
        let before = self.sequencer.steps_done();
        self.sequencer.fired(steps);
        self.settle(now);
        let streaming = self
            .sequencer
            .program()
            .is_some_and(|p| p.extent == Extent::Stream);
        if streaming && before / ROOM_EVERY != steps / ROOM_EVERY {
            self.send_event(Event::Room {
                run: self.sequencer.run(),
                steps: self.sequencer.room(),
            });
        }
    }

    /// STROBE became active (or went to rest) at `at`, from the start of the run.
    pub fn strobe(&mut self, active: bool, at: Ticks) {
        if active {
            self.settle(at);
            if self.witness.strobe_on(at) == Sighting::Spurious {
                self.counters.spurious_strobes += 1;
                self.send_event(Event::SpuriousStrobe {
                    run: self.sequencer.run(),
                    on: at,
                });
            }
        } else {
            self.witness.strobe_off(at);
        }
    }

    /// The engine has nothing more to play, and all edges up to `at` (from the start of the run) were reported. If
    /// that is too soon the host was late.
    pub fn drained(&mut self, at: Ticks) {
        if self.sequencer.state() == State::Running {
            self.sequencer.drained();
            self.ended(at);
        }
    }

    /// No SYNC edge came in time for the next step.
    pub fn sync_missing(&mut self) {
        let step = rcg_protocol::StepId(self.sequencer.steps_done());
        if self.sequencer.fail(Fault::SyncTimeout { step }) {
            self.halt();
        }
    }

    /// The engine lost its timing.
    pub fn engine_failed(&mut self) {
        if self.sequencer.fail(Fault::Engine) {
            self.halt();
        }
    }

    fn halt(&mut self) {
        self.engine = Some(EngineCommand::Halt);
        self.halting = true;
    }

    /// The engine has halted at `at` from the start of the run, and everything up to then was reported.
    pub fn halted(&mut self, at: Ticks) {
        if !core::mem::take(&mut self.halting) {
            return;
        }
        self.ended(at);
        if let Some((seq, now)) = self.unanswered.take() {
            let result = Ok(Reply::Status(self.status(now)));
            self.respond(self.id, seq, result);
        }
    }

    /// To be called every millisecond: the dead-man time-out, and batches that have waited too long.
    pub fn poll(&mut self, now: Ticks) {
        let dead_man = self.dead_man;
        let silent = now.saturating_sub(self.last_heard);
        // The outputs have to be low within the time that was set, and the next poll would be too late.
        let early = micros(LATENESS_US, self.clock_hz).min(Ticks(dead_man.0 / 8));
        if dead_man > Ticks::ZERO && silent + early > dead_man && self.sequencer.fail(Fault::HostLost) {
            self.halt();
        }
        let flush_after = Ticks(u64::from(self.clock_hz / FLUSHES_PER_SECOND));
        if let Some(started) = self.sequencer.started() {
            let in_run = now.saturating_sub(started);
            if !self.outbox.batch().is_empty() && in_run.saturating_sub(self.batch_since) > flush_after {
                self.flush();
            }
        }
    }
}

/// `us` microseconds of a clock of `clock_hz`, a multiple of 1 MHz.
const fn micros(us: u32, clock_hz: u32) -> Ticks {
    Ticks(us as u64 * (clock_hz / 1_000_000) as u64)
}
