//! Law: whatever is asked while a run is brought to its end is answered, once, and with what it asks for.

use proptest::prelude::*;
use rcg_firmware::control::{PulseEngine, turn};
use rcg_firmware::kept::Kept;
use rcg_firmware::session::Session;
use rcg_protocol::{
    Command, Event, Extent, Fault, Input, Inputs, Program, Reply, Request, Seq, Start, State, Status, Ticks,
    ToDevice, ToHost,
};

use crate::bench::{Bench, PERIOD, STEP};

/// Steps that the engine finds to have been fired when it halts.
const FIRED: u64 = 2;

/// An engine that loses its timing when it is told to, and takes some turns to halt.
#[derive(Default)]
struct Engine {
    loses: bool,
    turns_to_halt: u32,
    halting: Option<u32>,
    primed: u32,
}

impl PulseEngine for Engine {
    fn turn(&mut self, session: &mut Session) -> bool {
        if core::mem::take(&mut self.loses) {
            session.engine_failed();
            return false;
        }
        match &mut self.halting {
            None => false,
            Some(0) => {
                session.fired(FIRED, Ticks(FIRED * PERIOD));
                session.halted(Ticks(FIRED * PERIOD));
                self.halting = None;
                false
            }
            Some(left) => {
                *left -= 1;
                true
            }
        }
    }

    fn prime(&mut self, _: &mut Session) {
        assert_eq!(self.halting, None, "what is reported of the run before is lost");
        self.primed += 1;
    }

    fn go(&mut self, _: Start, session: &mut Session) {
        session.begun(Ticks(1000));
        while session.next_step(|_| ()).is_some() {}
    }

    fn halt(&mut self) {
        self.halting = Some(self.turns_to_halt);
    }

    fn watch(&mut self) {}

    fn keep(&mut self, _: Kept) {}

    fn store(&mut self, _: u16, _: &[u8]) {}

    fn stored(&mut self) -> Option<rcg_protocol::Stored> {
        None
    }

    fn photo(&mut self) -> Input {
        Input::default()
    }

    fn inputs(&mut self) -> Inputs {
        Inputs::default()
    }
}

fn append() -> Request {
    Request::Append {
        first: 8,
        steps: [STEP].into_iter().collect(),
        last: false,
    }
}

/// Whether `result` is what `request` asks for.
fn in_kind(request: &Request, result: Result<Reply, Fault>) -> bool {
    let refused = |expected| matches!(result, Err(Fault::Refused { command, .. }) if command == expected);
    let status = matches!(
        result,
        Ok(Reply::Status(Status {
            steps_done: FIRED,
            ..
        }))
    );
    match request {
        Request::Ping(number) => result == Ok(Reply::Pong(*number)),
        Request::Describe => matches!(result, Ok(Reply::Info(_))),
        Request::Append { .. } => refused(Command::Append),
        Request::Arm => refused(Command::Arm),
        Request::Load(_) => refused(Command::Load) || matches!(result, Ok(Reply::Room { .. })),
        Request::Start => refused(Command::Start),
        Request::Stop => refused(Command::Stop),
        Request::Clear => refused(Command::Clear) || status,
        _ => status,
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]
    #[test]
    fn every_request_is_answered_once_and_in_kind(
        asked in proptest::collection::vec((0..10_u32, 0..3_u32, any::<bool>()), 1..8),
        turns_to_halt in 0..5_u32,
    ) {
        let mut bench = Bench::new();
        bench.load(Program::new(Extent::Stream), &[STEP; 8]);
        // A stream that is not complete; `load` has marked these as its last.
        let session = &mut bench.session;
        let mut engine = Engine { turns_to_halt, ..Engine::default() };
        let mut seq = bench.seq;
        let mut ask = |session: &mut Session, request: &Request, twice: bool| {
            seq += 1;
            let message = ToDevice { session: bench.id, seq: Seq(seq), request: request.clone() };
            for _ in 0..=u32::from(twice) {
                session.request(Ticks(2000), &message);
            }
            Seq(seq)
        };
        let mut responses = Vec::new();
        let mut ended = 0;
        let mut take = |session: &mut Session, responses: &mut Vec<_>| {
            while let Some(message) = session.message() {
                match message {
                    ToHost::Response(response) => responses.push((response.seq, response.result)),
                    ToHost::Event(Event::Ended { .. }) => ended += 1,
                    ToHost::Event(_) => {}
                }
                session.message_sent();
            }
        };
        ask(session, &Request::Arm, false);
        while turn(&mut engine, session) {}
        ask(session, &Request::Start, false);
        while turn(&mut engine, session) {}
        take(session, &mut responses);
        responses.clear();

        engine.loses = true;
        turn(&mut engine, session);
        let mut open = Vec::new();
        for &(kind, turns, twice) in &asked {
            let request = match kind {
                0 | 1 => append(),
                2 | 3 => Request::Ping(kind + 5),
                4 => Request::Status,
                5 => Request::Abort,
                6 => Request::Stop,
                7 => Request::Describe,
                8 => Request::Start,
                _ => Request::Clear,
            };
            open.push((ask(session, &request, twice), request, u32::from(twice)));
            take(session, &mut responses);
            for _ in 0..turns {
                turn(&mut engine, session);
            }
        }
        // As the interrupt does: nothing may be left to do when it says so.
        while turn(&mut engine, session) {}
        take(session, &mut responses);
        for (seq, request, again) in open {
            let answers: Vec<_> = responses.iter().filter(|(of, _)| *of == seq).collect();
            prop_assert!((1..=1 + again).contains(&(answers.len() as u32)), "{request:?}: {answers:?}");
            prop_assert!(answers.iter().all(|(_, result)| in_kind(&request, *result)), "{request:?}: {answers:?}");
        }
        prop_assert_eq!(ended, 1);
        prop_assert!(session.sequencer().state() != State::Running);
    }
}

/// A new run is not begun while the one before it is not over, and then it is.
#[test]
fn what_begins_anew_waits_for_the_end() {
    let mut bench = Bench::new();
    bench.load(crate::bench::table(1, 4), &[STEP]);
    let mut engine = Engine {
        turns_to_halt: 3,
        ..Engine::default()
    };
    let send = |bench: &mut Bench, request: Request| {
        bench.seq += 1;
        let message = ToDevice {
            session: bench.id,
            seq: Seq(bench.seq),
            request,
        };
        bench.session.request(Ticks(2000), &message);
    };
    let ask = |bench: &mut Bench, engine: &mut Engine, request: Request, all: bool| {
        send(bench, request);
        while turn(engine, &mut bench.session) && all {}
    };
    ask(&mut bench, &mut engine, Request::Arm, true);
    ask(&mut bench, &mut engine, Request::Start, true);
    ask(&mut bench, &mut engine, Request::Abort, false);
    let load = Request::Load(crate::bench::table(3, 1));
    for request in [Request::Arm, load, Request::Clear] {
        send(&mut bench, request);
    }
    assert_eq!(
        bench.session.sequencer().store().appended(),
        1,
        "the schedule is still played"
    );
    while turn(&mut engine, &mut bench.session) {}
    assert_eq!(bench.session.sequencer().steps_done(), FIRED);
    ask(&mut bench, &mut engine, Request::Arm, true);
    assert_eq!(
        (engine.primed, bench.session.sequencer().state()),
        (2, State::Armed)
    );
}

/// Who goes on until nothing is left to do has seen the end of a run that failed on the way.
#[test]
fn no_halt_is_left_behind() {
    let mut bench = Bench::new();
    bench.load(crate::bench::table(1, 4), &[STEP]);
    bench.session.request(
        Ticks(2000),
        &ToDevice {
            session: bench.id,
            seq: Seq(bench.seq + 1),
            request: Request::Arm,
        },
    );
    let mut engine = Engine {
        loses: true,
        turns_to_halt: 3,
        ..Engine::default()
    };
    while turn(&mut engine, &mut bench.session) {}
    assert_eq!(
        (engine.halting, bench.session.sequencer().steps_done()),
        (None, FIRED)
    );
}
