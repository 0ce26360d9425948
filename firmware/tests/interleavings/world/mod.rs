//! A box, its host and the line between them, in a state from which different things can happen next; and the laws that hold in each.

/// Ends with what `$said` says, unless it `$holds`.
macro_rules! law {
    ($holds:expr, $($said:tt)+) => {
        if !$holds {
            return Err(format!($($said)+));
        }
    };
}

mod laws;

use std::collections::hash_map::DefaultHasher;
use std::fmt::{self, Debug, Write};
use std::hash::Hasher;

use rcg_firmware::control::{obey, request, turn};
use rcg_firmware::session::Session;
use rcg_protocol::{Event, Program, Request, Seq, SessionId, State, Ticks, ToDevice, ToHost};

use crate::engine::{Camera, Engine, HALF, STEP};

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
    /// The run that the host was told to be stopping, and the steps that it had begun by then.
    stopping: Option<(u32, usize)>,
    last_record: Option<(u32, u64)>,
    /// The run that the host armed last, and the last one that did not end as it should.
    armed: Option<u32>,
    series_over: Option<u32>,
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
            stopping: None,
            last_record: None,
            armed: None,
            series_over: None,
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
        // With more there may be no place for an answer, which is then given when it is asked for again.
        self.lossy = waiting > 12;
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
}
