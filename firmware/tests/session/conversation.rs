//! Requests, retries, sessions and their books.

use proptest::collection::vec;
use proptest::prelude::*;
use rcg_firmware::kept::Kept;
use rcg_firmware::session::{EngineCommand, Session};
use rcg_protocol::{
    Command, Extent, Fault, Identity, Input, Inputs, PROTOCOL_VERSION, Polarity, Program, Reply, Request,
    Response, SCHEMA_HASH, Seq, SessionId, Start, State, Ticks, ToDevice,
};

use crate::bench::{Bench, CLOCK_HZ, PERIOD, STEP, table};

#[test]
fn a_hello_opens_a_session_and_its_retry_opens_nothing_new() {
    let mut bench = Bench::new();
    assert_eq!((bench.status().counters.executed, bench.id), (1, SessionId(78)));
    bench.ask(0, Request::Ping(1)).unwrap();
    let again = bench.hello(2, 1);
    assert_eq!(
        again,
        Identity {
            protocol: PROTOCOL_VERSION,
            schema: SCHEMA_HASH,
            nonce: 1,
            session: bench.id
        }
    );
    // The session goes on where it was.
    bench.ask(0, Request::Ping(2)).unwrap();
    let counters = bench.status().counters;
    assert_eq!((counters.executed, counters.repeated, counters.stale), (3, 1, 0));

    let other = bench.hello(3, 2);
    assert_ne!(other.session, bench.id);
    assert_eq!(bench.ask(0, Request::Ping(3)), Err(Fault::StaleSession));
    bench.id = other.session;
    bench.seq = 0; // numbers begin anew
    bench.ask(0, Request::Ping(4)).unwrap();
    bench.check_books();
}

#[test]
fn before_the_first_hello_nobody_is_served() {
    let mut session = Session::new(CLOCK_HZ, 77);
    for id in [0, 77, 78] {
        let message = ToDevice {
            session: SessionId(id),
            seq: Seq(1),
            request: Request::Abort,
        };
        session.request(Ticks(0), &message);
    }
    assert_eq!((session.counters().executed, session.counters().stale), (0, 3));
}

#[test]
fn the_same_number_twice_is_executed_once_and_answered_twice() {
    let mut bench = Bench::new();
    bench.ask(0, Request::Load(Program::new(Extent::Stream))).unwrap();
    let append = Request::Append {
        first: 0,
        steps: [STEP; 3].into_iter().collect(),
        last: true,
    };
    let room = bench.session.sequencer().room();
    let requests = [append, Request::Arm, Request::Start];
    for (seq, request) in (100..).zip(requests) {
        let first = bench.send(0, bench.id, seq, request.clone());
        let engine = bench.engine.len();
        let status = bench.status();
        for _ in 0..3 {
            let again = bench.send(0, bench.id, seq, request.clone());
            match (&first[0].result, &again[0].result) {
                (Ok(Reply::Status(a)), Ok(Reply::Status(b))) => assert_eq!(a.state, b.state),
                (a, b) => assert_eq!(a, b),
            }
        }
        assert_eq!(bench.engine.len(), engine, "a retry commands no engine");
        let after = bench.status();
        assert_eq!((after.state, after.run), (status.state, status.run));
        assert_eq!(after.counters.executed, status.counters.executed);
        assert_eq!(after.counters.repeated, status.counters.repeated + 3);
    }
    assert_eq!(bench.session.sequencer().room(), room - 3);
    assert_eq!(
        bench.engine,
        [EngineCommand::Prime, EngineCommand::Go(Start::AtOnce)]
    );
    bench.check_books();
}

#[test]
fn a_refusal_is_remembered_like_any_answer() {
    let mut bench = Bench::new();
    let refused = Fault::Refused {
        command: Command::Start,
        state: State::Idle,
    };
    assert_eq!(bench.ask(0, Request::Start), Err(refused));
    // Meanwhile nothing may make the retry succeed: it is not tried again.
    let again = bench.send(0, bench.id, bench.seq, Request::Start);
    assert_eq!(again[0].result, Err(refused));
    assert_eq!(bench.status().counters.repeated, 1);
}

#[test]
fn a_repeated_status_tells_how_things_stand_now() {
    let mut bench = Bench::new();
    bench.load(table(1, 1), &[STEP]);
    bench.ask(0, Request::Arm).unwrap();
    bench.ask(0, Request::Start).unwrap();
    bench.session.begun(Ticks(0));
    assert!(bench.session.next_step(|_| ()).is_some());
    bench.session.fired(1, Ticks(PERIOD));
    bench.session.drained(Ticks(PERIOD));
    bench.actions();
    let again = bench.send(2 * PERIOD, bench.id, bench.seq, Request::Start);
    let Ok(Reply::Status(status)) = again[0].result else {
        panic!("{again:?}")
    };
    assert_eq!((status.state, status.now), (State::Done, Ticks(2 * PERIOD)));
}

#[test]
fn an_older_number_is_dropped_without_an_answer() {
    let mut bench = Bench::new();
    bench.load(table(1, 1), &[STEP]);
    let late = bench.seq - 1;
    let answers = bench.send(0, bench.id, late, Request::Clear);
    assert!(answers.is_empty());
    assert_eq!(bench.status().state, State::Loaded);
    assert_eq!(bench.status().counters.stale, 1);
    bench.check_books();
}

#[test]
fn a_stale_session_is_told_so_and_changes_nothing() {
    let mut bench = Bench::new();
    bench.load(table(1, 1), &[STEP]);
    let old = bench.id;
    bench.id = bench.hello(1, 99).session;
    for (seq, request) in [(1, Request::Clear), (1000, Request::Arm), (1001, Request::Abort)] {
        let answers = bench.send(0, old, seq, request);
        assert_eq!(
            answers,
            [Response {
                session: old,
                seq: Seq(seq),
                result: Err(Fault::StaleSession)
            }]
        );
    }
    assert_eq!((bench.status().state, bench.engine.len()), (State::Loaded, 0));
    bench.check_books();
}

#[test]
fn corrupt_frames_are_counted_apart() {
    let mut bench = Bench::new();
    bench.session.corrupt_frame();
    assert_eq!(bench.status().counters.corrupt, 1);
    bench.check_books();
}

proptest! {
    #[test]
    fn frames_are_executed_repeated_or_stale(
        messages in vec((0..4_u32, 0..12_u32, 0..12_usize), 0..300),
    ) {
        let mut bench = Bench::new();
        let mut ids = vec![bench.id];
        let mut executed = Vec::new();
        for (now, (session, seq, kind)) in (0..).zip(messages) {
            // The session that is open, one that was, and one that never was.
            let id = ids.iter().rev().nth(session as usize).copied().unwrap_or(SessionId(5));
            let request = match kind {
                0 => Request::Hello { nonce: session },
                1 => Request::Load(table(2, 2)),
                2 => Request::Append { first: 0, steps: [STEP; 2].into_iter().collect(), last: false },
                3 => Request::Arm,
                4 => Request::Start,
                5 => Request::Stop,
                6 => Request::Abort,
                7 => Request::Clear,
                8 => Request::Status,
                9 => Request::Describe,
                n => Request::Ping(n as u32),
            };
            let before = bench.status().counters;
            let hello = matches!(request, Request::Hello { .. });
            let answers = bench.send(now, id, seq, request);
            let after = bench.status().counters;
            prop_assert_eq!(after.frames, before.frames + 1);
            bench.check_books();
            prop_assert!(answers.len() <= 1);
            if hello {
                let Ok(Reply::Identity(identity)) = answers[0].result else { panic!("no identity") };
                if identity.session != ids[ids.len() - 1] {
                    ids.push(identity.session);
                }
            } else if after.executed > before.executed {
                prop_assert_eq!(id, ids[ids.len() - 1], "another session was served");
                prop_assert!(!executed.contains(&(id, seq)), "executed twice");
                prop_assert!(executed.iter().all(|&(other, old)| other != id || old < seq), "out of order");
                executed.push((id, seq));
            }
        }
        // What the engine was told follows from the runs that were armed.
        let primes = bench.engine.iter().filter(|&&engine| engine == EngineCommand::Prime).count();
        prop_assert_eq!(primes, bench.status().run as usize);
    }
}

fn keep(lines: Polarity) -> EngineCommand {
    EngineCommand::Keep(Kept {
        lines,
        ..Kept::default()
    })
}

#[test]
fn what_touches_the_lines_or_leaves_waits_until_no_run_goes_on() {
    let low = Polarity {
        cam_active_low: true,
        ..Polarity::default()
    };
    let asked = [
        (Request::Watch, Command::Watch, Some(EngineCommand::Watch)),
        (Request::Boot, Command::Boot, None),
        (Request::Keep(low), Command::Keep, Some(keep(low))),
    ];
    let farewell = 2 * PERIOD * 50;
    for (request, command, engine) in asked {
        let mut bench = Bench::new();
        bench.load(table(1, 1), &[STEP]);
        bench.ask(0, Request::Arm).unwrap();
        let refused = |state| Err(Fault::Refused { command, state });
        assert_eq!(bench.ask(0, request.clone()), refused(State::Armed));
        bench.ask(0, Request::Start).unwrap();
        assert_eq!(bench.ask(0, request.clone()), refused(State::Running));
        bench.ask(0, Request::Abort).unwrap();
        bench.engine.clear();
        assert!(!bench.session.leaves(Ticks(farewell)), "nobody has asked for it");
        assert!(matches!(bench.ask(0, request), Ok(Reply::Status(_))));
        assert_eq!(bench.engine, Vec::from_iter(engine));
        let leaves = command == Command::Boot;
        assert_eq!(bench.session.leaves(Ticks(farewell)), leaves);
        assert!(!bench.session.leaves(Ticks(PERIOD)), "the answer is on its way");
        // A run that was armed since keeps the box.
        bench.ask(0, Request::Arm).unwrap();
        assert!(!bench.session.leaves(Ticks(farewell)));
        let kept = bench.ask(0, Request::Kept).unwrap();
        let expected = if command == Command::Keep {
            low
        } else {
            Polarity::default()
        };
        assert_eq!(kept, Reply::Kept(expected));
    }
    // What is kept already is not written again.
    let mut bench = Bench::new();
    for polarity in [Polarity::default(), low, low] {
        bench.ask(0, Request::Keep(polarity)).unwrap();
    }
    assert_eq!(bench.engine, [keep(low)]);
}

#[test]
fn inputs_are_told_as_they_were_seen() {
    let mut bench = Bench::new();
    let sync = Input {
        high: true,
        edges: Some(7),
        ..Input::default()
    };
    let inputs = Inputs {
        at: Ticks(9),
        sync,
        ..Inputs::default()
    };
    bench.session.seen(inputs);
    assert_eq!(bench.ask(0, Request::Inputs), Ok(Reply::Inputs(inputs)));
}
