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

mod engine;
mod photo;
mod reports;
mod series;
mod standalone;

use heapless::{Deque, Vec};
use rcg_protocol::{
    Aux, Chip, Command, Counters, Fault, Identity, Info, Input, Inputs, PROTOCOL_VERSION, Reply, Request,
    Reset, SCHEMA_HASH, Seq, SessionId, Start, State, Status, Stored, Ticks, ToDevice, ToHost, Unit,
};

use crate::burst::STEP_COST_US;
use crate::edges::Filter;
use crate::kept::{self, Kept};
use crate::outbox::Outbox;
use crate::pulse::{FREE_OVERHEAD, LONGEST_PERIOD, PACED_OVERHEAD};
use crate::sequencer::{Fetched, Sequencer};
use crate::store::{MAX_STEPS, MAX_WORDS};
use crate::vsync::VsyncWatch;
use crate::witness::Witness;
use photo::PhotoLog;
use reports::Ration;

/// Step records wait at most this part of a second for their batch to fill: 20 ms.
const FLUSHES_PER_SECOND: u32 = 50;
/// From one poll to the next, and until the outputs have followed.
const LATENESS_US: u32 = 1_500;
/// From the answer that the box leaves for its boot loader until it does: any link has sent it by then.
const FAREWELL_US: u32 = 50_000;
/// Requests that can wait for the end of a run: as many as there are answers at a time. One more is answered when it is
/// asked again.
const UNANSWERED: usize = crate::outbox::OUTBOX;
/// A stream reports room again when this many steps were played.
const ROOM_EVERY: u64 = 64;

/// A box that is none.
const SIMULATED: Unit = Unit {
    serial: 0,
    commit: 0,
    modified: false,
    chip: Chip::Simulated,
    reset: Reset::PowerOn,
};

/// Inputs that nobody has looked at.
const NOTHING_SEEN: Inputs = {
    Inputs {
        at: Ticks::ZERO,
        since: Ticks::ZERO,
        sync: UNSEEN,
        strobe: UNSEEN,
    }
};

/// An input that nobody has looked at.
const UNSEEN: Input = Input {
    high: false,
    pulled_up: false,
    edges: None,
    last: [None; 2],
};

/// All lines low at rest.
const LOW: Kept = kept::kept([0; 4]);

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
    /// Count edges of the inputs from now on.
    Watch,
    /// Keep these polarities over resets, and rest like that. The engine rests.
    Keep(Kept),
}

/// One controller's end of the conversation.
#[derive(Clone, Debug)]
pub struct Session {
    clock_hz: u32,
    unit: Unit,
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
    /// The engine was told to halt in this state and has not said yet how far it got: the run is not over.
    halting: Option<State>,
    /// Whether steps have records.
    witnessed: bool,
    /// Requests that are answered then with how things stand, and when they came.
    unanswered: Vec<(Seq, Ticks), UNANSWERED>,
    /// Paced steps whose SYNC edge has not come: their trigger counts from it.
    awaiting_sync: Deque<Fetched, 4>,
    witness: Witness,
    /// What of STROBE is shorter is a glitch, in the next run …
    shortest_strobe: Ticks,
    /// … and in this one.
    filter: Filter,
    spurious: Ration,
    /// As last [seen](Self::seen).
    inputs: Inputs,
    /// What is kept over resets.
    kept: Kept,
    /// What further lines do in the next schedule that is loaded.
    aux: Aux,
    photo: PhotoLog,
    /// As last [seen](Self::photo_seen).
    photo_input: Input,
    /// Runs of a series, from the next one on that the host arms; 0 for ever.
    runs: u32,
    /// Runs of this series that are still to come; `None` for ever.
    runs_left: Option<u32>,
    /// The next one is armed and starts at the next poll.
    starts_again: bool,
    /// What is kept to be run without a host.
    stored: Option<Stored>,
    /// A page is to be written.
    takes_page: bool,
    /// The boot loader was asked for at this time.
    leaves: Option<Ticks>,
    outbox: Outbox,
    sequencer: Sequencer,
}

impl Session {
    /// A controller with a clock of `clock_hz`. `seed` should differ from boot to boot: sessions count from it.
    #[must_use]
    pub const fn new(clock_hz: u32, seed: u32) -> Self {
        Self {
            clock_hz,
            unit: SIMULATED,
            id: SessionId(seed),
            nonce: None,
            last: None,
            sequencer: Sequencer::new().with_step_cost(micros(STEP_COST_US, clock_hz)),
            witness: Witness::new(),
            shortest_strobe: Ticks::ZERO,
            filter: Filter::new(Ticks::ZERO),
            spurious: Ration::FULL,
            inputs: NOTHING_SEEN,
            kept: LOW,
            aux: Aux::resting(LOW.aux),
            photo: PhotoLog::new(),
            photo_input: UNSEEN,
            runs: 1,
            runs_left: Some(0),
            starts_again: false,
            stored: None,
            takes_page: false,
            leaves: None,
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
            halting: None,
            witnessed: true,
            unanswered: Vec::new(),
        }
    }

    /// Is from now on this box, which keeps the polarity `kept`, with a clock of `clock_hz` and sessions that count from `seed`. To be called before anything is
    /// asked: a session is a good part of a small memory, and is made where it stays, before the clock is known.
    pub const fn boot(&mut self, unit: Unit, kept: Kept, clock_hz: u32, seed: u32) {
        self.unit = unit;
        self.kept = kept;
        self.aux = Aux::resting(kept.aux);
        self.clock_hz = clock_hz;
        self.id = SessionId(seed);
        self.sequencer.set_step_cost(micros(STEP_COST_US, clock_hz));
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

    /// What stands at the inputs: to be told before [`Request::Inputs`] is passed on.
    pub fn seen(&mut self, inputs: Inputs) {
        self.inputs = inputs;
    }

    /// Whether the box is to go to its boot loader at `now`: it was asked to, has said so, and no run goes on.
    #[must_use]
    pub fn leaves(&self, now: Ticks) -> bool {
        let farewell = micros(FAREWELL_US, self.clock_hz);
        let said = self
            .leaves
            .is_some_and(|asked| now.saturating_sub(asked) >= farewell);
        said && self.halting.is_none() && self.sequencer.check(Command::Boot).is_ok()
    }

    /// `records` step records were sent to nobody.
    pub fn records_lost(&mut self, records: u32) {
        self.counters.records_lost = self.counters.records_lost.saturating_add(records);
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
                self.answer(now, seq, result);
            }
            Some((last, _)) if seq < last => self.counters.stale += 1,
            _ => {
                self.counters.executed += 1;
                let result = self.execute(now, request);
                self.last = Some((seq, result));
                self.answer(now, seq, result);
            }
        }
    }

    /// Answers request `seq` of the present session; with how things stand, if that is what it is about, once the engine
    /// has said how far the run got.
    fn answer(&mut self, now: Ticks, seq: Seq, result: Result<Reply, Fault>) {
        if self.halting.is_none() || !matches!(result, Ok(Reply::Status(_))) {
            self.respond(self.id, seq, result);
        } else if self.unanswered.iter().all(|&(waiting, _)| waiting != seq) {
            self.unanswered.push((seq, now)).ok();
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
            self.unanswered.clear();
            self.shortest_strobe = Ticks::ZERO;
            self.aux = Aux::resting(self.kept.aux);
            self.runs = 1;
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
        if let (Some(state), Some(command)) = (self.halting, begins_anew(request)) {
            return Err(Fault::Refused { command, state });
        }
        match request {
            Request::Hello { .. } | Request::Status => {}
            Request::Ping(number) => return Ok(Reply::Pong(*number)),
            Request::Describe => return Ok(Reply::Info(self.info())),
            Request::Identify => return Ok(Reply::Unit(self.unit)),
            Request::Filter { strobe } => self.shortest_strobe = *strobe,
            Request::Inputs => return Ok(Reply::Inputs(self.inputs)),
            Request::Kept => return Ok(Reply::Kept(self.kept.lines)),
            Request::KeptAux => return Ok(Reply::KeptAux(self.kept.aux)),
            Request::Photo => return Ok(Reply::Photo(self.photo_now())),
            Request::Stored => return Ok(Reply::Stored(self.stored)),
            &Request::Store { page, .. } => self.take_page(page)?,
            Request::Aux(aux) => self.aux = *aux,
            Request::Repeat { runs } => self.runs = *runs,
            Request::Watch => {
                self.sequencer.check(Command::Watch)?;
                self.engine = Some(EngineCommand::Watch);
            }
            &Request::Keep(lines) => self.keep(Kept { lines, ..self.kept })?,
            &Request::KeepAux(aux) => {
                self.keep(Kept { aux, ..self.kept })?;
                self.aux.polarity = aux;
            }
            Request::Boot => {
                self.sequencer.check(Command::Boot)?;
                self.leaves = Some(now);
            }
            Request::Load(program) => {
                self.sequencer.load_with(*program, self.aux)?;
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
                let run = self.arm()?;
                self.runs_left = self.runs.checked_sub(1);
                return Ok(Reply::Armed { run });
            }
            Request::Start => self.start()?,
            Request::Stop => self.sequencer.stop()?,
            Request::Abort => {
                let state = self.sequencer.state();
                if self.sequencer.abort() {
                    self.halt(state);
                }
            }
            Request::Clear => self.sequencer.clear()?,
        }
        Ok(Reply::Status(self.status(now)))
    }

    /// Keeps this over resets, if it is another one than before.
    fn keep(&mut self, kept: Kept) -> Result<(), Fault> {
        self.sequencer.check(Command::Keep)?;
        if kept != self.kept {
            self.kept = kept;
            self.engine = Some(EngineCommand::Keep(kept));
        }
        Ok(())
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

    /// To be called every millisecond: the dead-man time-out, and batches that have waited too long.
    pub fn poll(&mut self, now: Ticks) {
        let dead_man = self.dead_man;
        let silent = now.saturating_sub(self.last_heard);
        // The outputs have to be low within the time that was set, and the next poll would be too late.
        let early = micros(LATENESS_US, self.clock_hz).min(Ticks(dead_man.0 / 8));
        if dead_man > Ticks::ZERO && silent + early > dead_man {
            self.fail(Fault::HostLost);
        }
        if self.starts_again && self.engine.is_none() {
            self.starts_again = false;
            self.start().ok(); // it may have been aborted meanwhile
        }
        let flush_after = Ticks(u64::from(self.clock_hz / FLUSHES_PER_SECOND));
        if let Some(started) = self.sequencer.started() {
            let in_run = now.saturating_sub(started);
            if !self.outbox.batch().is_empty() && in_run.saturating_sub(self.batch_since) > flush_after {
                self.flush();
            }
            if self.photo.has_waited(in_run, flush_after) {
                self.flush_photo();
            }
        }
    }
}

/// What a request commands that takes the schedule or the engine from the run before.
const fn begins_anew(request: &Request) -> Option<Command> {
    match request {
        Request::Load(_) => Some(Command::Load),
        Request::Arm => Some(Command::Arm),
        Request::Start => Some(Command::Start),
        Request::Stop => Some(Command::Stop),
        Request::Clear => Some(Command::Clear),
        Request::Watch => Some(Command::Watch),
        Request::Boot => Some(Command::Boot),
        Request::Keep(_) | Request::KeepAux(_) => Some(Command::Keep),
        Request::Store { .. } => Some(Command::Store),
        _ => None,
    }
}

/// `us` microseconds of a clock of `clock_hz`, a multiple of 1 MHz.
const fn micros(us: u32, clock_hz: u32) -> Ticks {
    Ticks(us as u64 * (clock_hz / 1_000_000) as u64)
}
