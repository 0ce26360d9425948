//! A controller and a host without a link in between.

use rcg_firmware::session::{Action, EngineCommand, Session};
use rcg_protocol::{
    Event, Extent, Fault, Identity, Program, Pulse, Reply, Request, Response, Seq, SessionId, Status, Step,
    StepRecord, Ticks, ToDevice, ToHost,
};

/// One tick is 8 ns.
pub(crate) const CLOCK_HZ: u32 = 125_000_000;
pub(crate) const MS: u64 = 125_000;
pub(crate) const PERIOD: u64 = MS;

pub(crate) const STEP: Step = Step {
    proj: Pulse::new(0, 100),
    cam: Pulse::new(200, 300),
    period: Ticks(PERIOD),
};

/// A controller and a host that talk without a link in between.
pub(crate) struct Bench {
    pub(crate) session: Session,
    pub(crate) id: SessionId,
    pub(crate) seq: u32,
    pub(crate) engine: Vec<EngineCommand>,
    pub(crate) events: Vec<Event>,
    /// When the engine finds that it has halted, from the start of the run.
    pub(crate) halts_at: u64,
}

impl Bench {
    /// With a session open.
    pub(crate) fn new() -> Self {
        let mut bench = Self {
            session: Session::new(CLOCK_HZ, 77),
            id: SessionId(0),
            seq: 0,
            engine: Vec::new(),
            events: Vec::new(),
            halts_at: 0,
        };
        bench.id = bench.hello(1, 1).session;
        bench
    }

    /// Sends exactly this and returns the answers, sorting the rest into `engine` and `events`.
    pub(crate) fn send(&mut self, now: u64, session: SessionId, seq: u32, request: Request) -> Vec<Response> {
        let message = ToDevice {
            session,
            seq: Seq(seq),
            request,
        };
        self.session.request(Ticks(now), &message);
        self.actions()
    }

    pub(crate) fn actions(&mut self) -> Vec<Response> {
        let mut responses = Vec::new();
        while let Some(action) = self.session.action() {
            match action {
                Action::Engine(engine) => {
                    self.engine.push(engine);
                    if engine == EngineCommand::Halt {
                        self.session.halted(Ticks(self.halts_at));
                    }
                }
                Action::Send(ToHost::Event(event)) => self.events.push(event),
                Action::Send(ToHost::Response(response)) => responses.push(response),
            }
        }
        responses
    }

    pub(crate) fn hello(&mut self, seq: u32, nonce: u32) -> Identity {
        let answers = self.send(0, SessionId(12345), seq, Request::Hello { nonce });
        match answers.as_slice() {
            [
                Response {
                    session: SessionId(0),
                    seq: Seq(answered),
                    result: Ok(Reply::Identity(identity)),
                },
            ] if *answered == seq => *identity,
            other => panic!("hello was answered with {other:?}"),
        }
    }

    /// A new request of the open session.
    pub(crate) fn ask(&mut self, now: u64, request: Request) -> Result<Reply, Fault> {
        self.seq += 1;
        let (id, seq) = (self.id, self.seq);
        let mut answers = self.send(now, id, seq, request);
        assert_eq!(answers.len(), 1);
        let answer = answers.remove(0);
        assert_eq!((answer.session, answer.seq), (id, Seq(seq)));
        answer.result
    }

    pub(crate) fn load(&mut self, program: Program, steps: &[Step]) {
        self.ask(0, Request::Load(program)).unwrap();
        for (batch, chunk) in steps.chunks(8).enumerate() {
            let first = batch as u64 * 8;
            let last = first as usize + chunk.len() == steps.len();
            let steps = chunk.iter().copied().collect();
            self.ask(0, Request::Append { first, steps, last }).unwrap();
        }
    }

    /// Arms and starts; the run begins at `now`.
    pub(crate) fn go(&mut self, now: u64) {
        self.ask(now, Request::Arm).unwrap();
        self.ask(now, Request::Start).unwrap();
        self.session.begun(Ticks(now));
        self.actions();
        self.events.clear();
    }

    pub(crate) fn status(&self) -> Status {
        self.session.status(Ticks::ZERO)
    }

    pub(crate) fn records(&self) -> Vec<StepRecord> {
        let of = |event: &Event| match event {
            Event::Records { records, .. } => records.to_vec(),
            _ => Vec::new(),
        };
        self.events.iter().flat_map(of).collect()
    }

    pub(crate) fn check_books(&self) {
        let c = self.session.counters();
        assert_eq!(c.frames, c.executed + c.repeated + c.stale);
    }
}

pub(crate) fn table(steps: u32, cycles: u32) -> Program {
    Program::new(Extent::Table { steps, cycles })
}
