//! A box, its host and the line between them, in a state from which different things can happen next; and the laws that hold in each.

use std::collections::hash_map::DefaultHasher;
use std::fmt::{self, Debug, Write};
use std::hash::Hasher;

use rcg_firmware::control::{obey, request, turn};
use rcg_firmware::session::Session;
use rcg_protocol::{
    Command, Event, Fault, Program, Reply, Request, Response, Seq, SessionId, State, Status, StepFlags,
    StepRecord, Ticks, ToDevice, ToHost,
};

use crate::engine::{Camera, Engine, HALF, STEP, TRIGGER, Truth};

/// What can happen next.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Move {
    /// The host asks for something new.
    Ask(Request),
    /// The last request comes once more.
    Again,
    /// A request comes that was overtaken.
    Late(Request),
    /// A request of another session comes.
    Foreign(Request),
    /// A host opens a session.
    Hello,
    /// The DMA's interrupt: one small piece of work is done.
    Turn,
    /// The main loop comes round.
    Poll,
    /// The next moment is reached.
    Advance(Camera),
    /// An edge of SYNC.
    Sync,
    /// The engine finds its timing lost.
    Lose,
    /// The link takes a message.
    Take,
    /// All that waits for the link is sent to nobody.
    Drop,
}

impl Move {
    /// Whether it happens by itself.
    pub(crate) fn is_own(&self) -> bool {
        matches!(
            self,
            Self::Turn | Self::Poll | Self::Take | Self::Advance(Camera::Obeys)
        )
    }
}

/// How often what does not happen by itself may happen.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Budget {
    pub(crate) asks: u8,
    pub(crate) strangers: u8,
    pub(crate) camera: u8,
    pub(crate) syncs: u8,
    pub(crate) losses: u8,
    pub(crate) drops: u8,
}

/// A request that was sent, and how often; how often it was answered.
#[derive(Clone, Debug)]
struct Open {
    session: SessionId,
    seq: Seq,
    request: Request,
    sent: u8,
    answered: u8,
}

#[derive(Clone, Debug)]
pub(crate) struct World {
    pub(crate) session: Session,
    pub(crate) engine: Engine,
    pub(crate) budget: Budget,
    /// Whether messages wait for the link to take them; else it takes them at once.
    slow: bool,
    /// Whether messages may have been lost.
    lossy: bool,
    id: SessionId,
    last: Option<ToDevice>,
    seq: u32,
    open: Vec<Open>,
    /// Whether the main loop came round since the last moment.
    polled: bool,
    /// Runs that the host was told the end of.
    ended: Vec<u32>,
    /// Records that came or were said to be on the way to nobody, and the last of them.
    records: u64,
    last_record: Option<(u32, u64)>,
}

/// Ticks a second: as many as make a [`HALF`] a millisecond.
const CLOCK_HZ: u32 = 1000 * HALF as u32;

/// What is alike to the last field has the same one: it is made of all that `Debug` shows.
pub(crate) fn fingerprint(what: &impl Debug) -> u64 {
    struct Sum(DefaultHasher);

    impl Write for Sum {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            self.0.write(text.as_bytes());
            Ok(())
        }
    }

    let mut sum = Sum(DefaultHasher::new());
    write!(sum, "{what:?}").expect("nothing of it fails");
    sum.0.finish()
}

macro_rules! law {
    ($holds:expr, $($said:tt)+) => {
        if !$holds {
            return Err(format!($($said)+));
        }
    };
}

impl World {
    /// A box with a schedule of `steps` steps and a host that has loaded it after it said `first`.
    pub(crate) fn new(program: Program, steps: usize, last: bool, first: Option<Request>) -> Self {
        let mut world = Self {
            session: Session::new(CLOCK_HZ, 7),
            engine: Engine::new(),
            budget: Budget {
                asks: u8::MAX,
                ..Budget::default()
            },
            slow: false,
            lossy: false,
            id: SessionId(0),
            last: None,
            seq: 0,
            open: Vec::new(),
            polled: false,
            ended: Vec::new(),
            records: 0,
            last_record: None,
        };
        let append = Request::Append {
            first: 0,
            steps: vec![STEP; steps].into_iter().collect(),
            last,
        };
        let asked = first.into_iter().chain([Request::Load(program), append]);
        let moves = [Move::Hello].into_iter().chain(asked.map(Move::Ask));
        for step in moves.chain([Move::Poll]) {
            world.take(&step).expect("a schedule is loaded");
        }
        world
    }

    /// In a run that has just been started.
    pub(crate) fn started(mut self) -> Self {
        for step in [Move::Ask(Request::Arm), Move::Poll, Move::Ask(Request::Start)] {
            self.take(&step).expect("a schedule is played");
        }
        self
    }

    pub(crate) fn with(mut self, budget: Budget) -> Self {
        self.budget = budget;
        self
    }

    /// With a link that takes one message at a time, of which so many wait already.
    pub(crate) fn slow(mut self, waiting: u32) -> Self {
        self.slow = true;
        self.budget.asks = u8::MAX;
        for number in 0..waiting {
            self.take(&Move::Ask(Request::Ping(number))).expect("a ping");
        }
        self
    }

    /// Steps that were appended to the schedule.
    fn appended(&self) -> u64 {
        self.session.sequencer().store().appended()
    }

    fn state(&self) -> State {
        self.session.sequencer().state()
    }

    fn is_live(&self) -> bool {
        matches!(self.state(), State::Armed | State::Running) || !self.engine.is_resting()
    }

    /// What happens by itself.
    pub(crate) fn own_moves(&self) -> Vec<Move> {
        let mut moves = vec![Move::Turn, Move::Poll];
        if self.is_live() && self.polled {
            moves.push(Move::Advance(Camera::Obeys));
        }
        if self.slow && self.session.message().is_some() {
            moves.push(Move::Take);
        }
        moves
    }

    /// What else can happen, if `asks` are what a host may ask for.
    pub(crate) fn other_moves(&self, asks: &[Request]) -> Vec<Move> {
        let (budget, mut moves) = (self.budget, Vec::new());
        if budget.asks > 0 {
            moves.extend(asks.iter().map(|ask| match ask {
                Request::Append { steps, last, .. } => Move::Ask(Request::Append {
                    first: self.appended(),
                    steps: steps.clone(),
                    last: *last,
                }),
                ask => Move::Ask(ask.clone()),
            }));
        }
        if budget.strangers > 0 {
            moves.extend([Move::Again, Move::Hello]);
            for request in [Request::Arm, Request::Start, Request::Abort] {
                moves.extend([Move::Late(request.clone()), Move::Foreign(request)]);
            }
        }
        if budget.camera > 0 && self.is_live() && self.polled {
            moves.push(Move::Advance(Camera::Errs));
            if self.engine.triggers_next() {
                moves.push(Move::Advance(Camera::Lingers));
            }
        }
        if budget.syncs > 0 && self.engine.is_started() {
            moves.push(Move::Sync);
        }
        if budget.losses > 0 && self.engine.is_started() {
            moves.push(Move::Lose);
        }
        if budget.drops > 0 && self.session.message().is_some() {
            moves.push(Move::Drop);
        }
        moves
    }

    /// Lets `step` happen.
    ///
    /// # Errors
    /// The law that it broke.
    pub(crate) fn take(&mut self, step: &Move) -> Result<(), String> {
        match step {
            Move::Ask(asked) => {
                self.budget.asks -= 1;
                self.seq += 1;
                self.send(self.id, self.seq, asked.clone());
            }
            Move::Hello => {
                self.budget.strangers = self.budget.strangers.saturating_sub(1);
                self.seq += 1;
                let nonce = self.seq;
                self.send(SessionId(0), self.seq, Request::Hello { nonce });
                // Those of the session before are forgotten where they waited.
                self.open.retain(|open| open.session == SessionId(0));
            }
            Move::Again | Move::Late(_) | Move::Foreign(_) => self.take_stranger(step)?,
            Move::Turn => {
                turn(&mut self.engine, &mut self.session);
            }
            Move::Poll => self.poll()?,
            &Move::Advance(camera) => {
                self.budget.camera -= u8::from(camera != Camera::Obeys);
                self.engine.advance(camera);
                self.polled = false;
            }
            Move::Sync => {
                self.budget.syncs -= 1;
                self.engine.sync_edge();
            }
            Move::Lose => {
                self.budget.losses -= 1;
                self.session.engine_failed();
                obey(&mut self.engine, &mut self.session);
            }
            Move::Take => self.deliver()?,
            Move::Drop => {
                self.budget.drops -= 1;
                self.lossy = true;
                while let Some(message) = self.session.message() {
                    let records = match message {
                        ToHost::Event(Event::Records { records, .. }) => records.len() as u32,
                        _ => 0,
                    };
                    self.session.message_sent();
                    self.session.records_lost(records);
                }
            }
        }
        while !self.slow && self.session.message().is_some() {
            self.deliver()?;
        }
        self.check()
    }

    /// A frame that is not to be acted on: nothing but what is counted and answered may differ after it.
    fn take_stranger(&mut self, step: &Move) -> Result<(), String> {
        let before = (fingerprint(self.session.sequencer()), fingerprint(&self.engine));
        self.budget.strangers -= 1;
        match step {
            Move::Again => {
                let again = self.last.clone().expect("something was asked");
                self.send(again.session, again.seq.0, again.request);
            }
            Move::Late(asked) => {
                let message = ToDevice {
                    session: self.id,
                    seq: Seq(0),
                    request: asked.clone(),
                };
                self.pass(&message); // and it is not answered
            }
            Move::Foreign(asked) => self.send(SessionId(self.id.0 - 1), self.seq + 100, asked.clone()),
            _ => {}
        }
        let after = (fingerprint(self.session.sequencer()), fingerprint(&self.engine));
        law!(
            before == after,
            "a request was acted on that was none, or once more"
        );
        Ok(())
    }

    fn send(&mut self, session: SessionId, seq: u32, asked: Request) {
        let message = ToDevice {
            session,
            seq: Seq(seq),
            request: asked,
        };
        let same = |open: &&mut Open| (open.session, open.seq) == (session, message.seq);
        if let Some(open) = self.open.iter_mut().find(same) {
            open.sent += 1;
        } else {
            self.open.push(Open {
                session,
                seq: message.seq,
                request: message.request.clone(),
                sent: 1,
                answered: 0,
            });
        }
        self.pass(&message);
        if session == self.id || session == SessionId(0) {
            self.last = Some(message);
        }
    }

    fn pass(&mut self, message: &ToDevice) {
        let now = Ticks(self.engine.now);
        request(&mut self.engine, &mut self.session, now, message);
    }

    /// As the main loop does it: all work is done before the time-outs are looked at, and what comes of them too.
    fn poll(&mut self) -> Result<(), String> {
        self.work()?;
        self.session.poll(Ticks(self.engine.now));
        obey(&mut self.engine, &mut self.session);
        self.work()?;
        self.polled = true;
        Ok(())
    }

    fn work(&mut self) -> Result<(), String> {
        let done = (0..1000).any(|_| !turn(&mut self.engine, &mut self.session));
        law!(done, "there is always more to do");
        Ok(())
    }

    /// The host gets the next message.
    fn deliver(&mut self) -> Result<(), String> {
        let Some(message) = self.session.message().cloned() else {
            return Ok(());
        };
        self.session.message_sent();
        match message {
            ToHost::Response(response) => self.answered(&response),
            ToHost::Event(Event::Records { run, records }) => {
                records.iter().try_for_each(|record| self.recorded(run, record))
            }
            ToHost::Event(Event::Ended {
                run,
                state,
                fault,
                steps_done,
                ..
            }) => {
                law!(!self.ended.contains(&run), "run {run} ended twice");
                law!(
                    matches!(
                        state,
                        State::Done | State::Stopped | State::Aborted | State::Fault
                    ) && fault.is_some() == (state == State::Fault),
                    "run {run} ended as {state} with {fault:?}"
                );
                let whole = self.truth(run)?.whole();
                law!(steps_done == whole, "run {run}: {steps_done} steps for {whole}");
                self.ended.push(run);
                Ok(())
            }
            ToHost::Event(_) => Ok(()),
        }
    }

    fn truth(&self, run: u32) -> Result<&Truth, String> {
        let truth = self.engine.truths.get((run as usize).wrapping_sub(1));
        truth.ok_or(format!("run {run} was never armed"))
    }

    fn answered(&mut self, response: &Response) -> Result<(), String> {
        let same = |open: &&mut Open| (open.session, open.seq) == (response.session, response.seq);
        if let Ok(Reply::Identity(identity)) = response.result {
            self.id = identity.session;
        }
        let Some(open) = self.open.iter_mut().find(same) else {
            law!(response.session != self.id, "{:?} was never asked", response.seq);
            return Ok(()); // of a session that is over
        };
        open.answered += 1;
        if let Ok(Reply::Status(Status {
            state: State::Done | State::Stopped | State::Aborted | State::Fault,
            run,
            steps_done,
            ..
        })) = response.result
        {
            let whole = self.engine.truths[run as usize - 1].whole();
            law!(
                steps_done == whole,
                "{steps_done} steps were said to be done, of {whole}"
            );
        }
        law!(
            open.answered <= open.sent,
            "{:?} was answered {} times",
            open.request,
            open.answered
        );
        law!(
            in_kind(&open.request, response, self.id),
            "{:?} was answered with {:?}",
            open.request,
            response.result
        );
        if self.last.as_ref().is_none_or(|last| last.seq != response.seq) {
            let seq = response.seq;
            self.open
                .retain(|open| (open.session, open.seq) != (response.session, seq));
        }
        Ok(())
    }

    fn recorded(&mut self, run: u32, record: &StepRecord) -> Result<(), String> {
        self.records += 1;
        let id = (run, record.step.0);
        law!(
            self.last_record.is_none_or(|last| last < id),
            "{id:?} was told out of order"
        );
        self.last_record = Some(id);
        let truth = self.truth(run)?;
        let begin = truth.steps.get(record.step.0 as usize);
        let Some(&begin) = begin else {
            return Err(format!("{} was never played", record.step));
        };
        let trigger = begin + TRIGGER;
        law!(
            record.trigger.0 == trigger,
            "{record:?} of a trigger at {trigger}"
        );
        let until = truth.steps.get(record.step.0 as usize + 1).map(|at| at + TRIGGER);
        let until = until.or(truth.rests).unwrap_or(u64::MAX);
        let mut exposures = truth
            .exposures
            .iter()
            .filter(|[on, _]| (trigger..=until).contains(on));
        let seen = record.strobe.map(|strobe| trigger + strobe.delay.0);
        let expected = exposures.next().map(|&[on, _]| on);
        law!(
            seen == expected,
            "{record:?}: exposed at {expected:?}, not {seen:?}"
        );
        let flagged = [StepFlags::MISSED, StepFlags::DOUBLE].map(|flag| record.flags.contains(flag));
        law!(
            flagged == [expected.is_none(), exposures.next().is_some()],
            "{record:?}: flags"
        );
        Ok(())
    }

    /// What holds always.
    fn check(&self) -> Result<(), String> {
        if let Some(wrong) = self.engine.wrong {
            return Err(wrong.into());
        }
        let state = self.state();
        law!(
            !self.engine.is_started() || state == State::Running,
            "the outputs pulse while {state}"
        );
        law!(
            !self.engine.is_primed() || state == State::Armed,
            "the engine is primed while {state}"
        );
        let counted = self.session.counters();
        law!(
            counted.frames == counted.executed + counted.repeated + counted.stale,
            "frames are not those that were executed, repeated and stale"
        );
        Ok(())
    }

    /// What holds when nothing happens by itself any more.
    pub(crate) fn check_rest(&self) -> Result<(), String> {
        let sequencer = self.session.sequencer();
        law!(!self.is_live(), "a run never ends: {}", self.state());
        let triggers: u64 = self.engine.truths.iter().map(|truth| truth.triggers()).sum();
        let lost = u64::from(self.session.counters().records_lost);
        law!(
            triggers == self.records + lost,
            "{triggers} triggers, {} records, {lost} lost",
            self.records
        );
        if !self.lossy {
            let runs: Vec<u32> = (1..=sequencer.run()).collect();
            law!(self.ended == runs, "the ends of {:?} were told of", self.ended);
            for open in &self.open {
                law!(open.answered > 0, "{:?} was not answered", open.request);
            }
        }
        Ok(())
    }

    /// A host that lost an answer asks again, and is answered.
    pub(crate) fn check_retry(mut self) -> Result<(), String> {
        let Some(last) = self.last.clone() else {
            return Ok(());
        };
        self.budget.strangers = 1;
        self.take(&Move::Poll)?; // an end that is still to be told of
        let before = self.open.iter().find(|open| open.seq == last.seq);
        let before = before.map_or(0, |open| open.answered);
        self.take(&Move::Again)?;
        while self.slow && self.session.message().is_some() {
            self.take(&Move::Take)?;
        }
        let after = self.open.iter().find(|open| open.seq == last.seq);
        let after = after.map_or(0, |open| open.answered);
        law!(after == before + 1, "{:?} was not answered again", last.request);
        Ok(())
    }
}

/// Whether `response` is what `request` asks for.
fn in_kind(request: &Request, response: &Response, id: SessionId) -> bool {
    let result = &response.result;
    if response.session != id && response.session != SessionId(0) {
        return *result == Err(Fault::StaleSession);
    }
    let refused = |of: Command| matches!(result, Err(Fault::Refused { command, .. }) if *command == of);
    let status = matches!(result, Ok(Reply::Status(_)));
    match request {
        Request::Hello { nonce } => {
            matches!(result, Ok(Reply::Identity(identity)) if identity.nonce == *nonce)
        }
        Request::Ping(number) => *result == Ok(Reply::Pong(*number)),
        Request::Load(_) => matches!(result, Ok(Reply::Room { .. })) || refused(Command::Load),
        Request::Append { .. } => matches!(result, Ok(Reply::Room { .. })) || refused(Command::Append),
        Request::Arm => matches!(result, Ok(Reply::Armed { .. })) || refused(Command::Arm),
        Request::Start => status || refused(Command::Start),
        Request::Stop => status || refused(Command::Stop),
        Request::Clear => status || refused(Command::Clear),
        Request::Watch => status || refused(Command::Watch),
        Request::Keep(_) => status || refused(Command::Keep),
        Request::Abort => {
            matches!(result, Ok(Reply::Status(now)) if !matches!(now.state, State::Armed | State::Running))
        }
        _ => status,
    }
}
