//! How runs end that do not end by themselves.

use rcg_firmware::session::{EngineCommand, Session};
use rcg_protocol::{Event, Fault, Line, Micros, Program, Reply, Request, State, StepId, Ticks};

use crate::bench::{Bench, CLOCK_HZ, PERIOD, STEP, table};

#[test]
fn abort_halts_the_engine_and_tells_how_far_the_run_came() {
    for started in [false, true] {
        let mut bench = Bench::new();
        bench.load(table(4, 1), &[STEP; 4]);
        bench.ask(0, Request::Arm).unwrap();
        if started {
            bench.ask(0, Request::Start).unwrap();
            bench.session.begun(Ticks(1000));
            while bench.session.next_step(|_| ()).is_some() {}
            bench.session.fired(2, Ticks(2 * PERIOD));
        }
        bench.engine.clear();
        bench.actions();
        bench.events.clear();
        let now = 1000 + 2 * PERIOD + 300;
        bench.halts_at = if started { now - 1000 } else { 0 };
        let Ok(Reply::Status(status)) = bench.ask(now, Request::Abort) else {
            panic!("no status")
        };
        let done = if started { 2 } else { 0 };
        assert_eq!((status.state, status.steps_done), (State::Aborted, done));
        assert_eq!(bench.engine, [EngineCommand::Halt]);
        let at = Ticks(bench.halts_at);
        let ended = Event::Ended {
            run: 1,
            state: State::Aborted,
            fault: None,
            steps_done: done,
            at,
        };
        assert_eq!(bench.events.last(), Some(&ended));
        // The step that was cut short had fired its trigger, so it has a record; the one after it has none.
        let ids: Vec<u64> = bench.records().iter().map(|record| record.step.0).collect();
        assert_eq!(ids, if started { vec![0, 1, 2] } else { vec![] });
        // Nothing is left to abort.
        bench.ask(now, Request::Abort).unwrap();
        assert_eq!(bench.engine, [EngineCommand::Halt]);
    }
}

#[test]
fn a_host_that_falls_silent_during_a_run_loses_it() {
    let dead_man = Micros(1000);
    let limit = dead_man.to_ticks(CLOCK_HZ).0;
    for (armed, started) in [(false, false), (true, false), (true, true)] {
        let mut bench = Bench::new();
        bench.load(
            Program {
                dead_man,
                ..table(4, 1)
            },
            &[STEP; 4],
        );
        if armed {
            bench.ask(500, Request::Arm).unwrap();
        }
        if started {
            bench.ask(500, Request::Start).unwrap();
            bench.session.begun(Ticks(600));
        }
        bench.ask(500, Request::Ping(0)).unwrap();
        bench.engine.clear();
        bench.events.clear();
        bench.session.poll(Ticks(500 + limit - limit / 8));
        bench.actions();
        assert!(bench.engine.is_empty() && bench.events.is_empty(), "too early");
        // A poll before the time is over: the next one may come after it.
        bench.session.poll(Ticks(501 + limit - limit / 8));
        bench.actions();
        if armed {
            assert_eq!(bench.engine, [EngineCommand::Halt]);
            assert_eq!(
                (bench.status().state, bench.status().fault),
                (State::Fault, Some(Fault::HostLost))
            );
            assert!(matches!(
                bench.events.as_slice(),
                [Event::Ended {
                    state: State::Fault,
                    fault: Some(Fault::HostLost),
                    ..
                }]
            ));
        } else {
            assert!(bench.engine.is_empty());
            assert_eq!(bench.status().state, State::Loaded);
        }
        bench.session.poll(Ticks(u64::MAX / 2));
        bench.actions();
        assert!(bench.engine.len() <= 1, "a run ends once");
    }
}

#[test]
fn any_frame_keeps_the_run_alive_and_zero_means_for_ever() {
    let dead_man = Micros(1000);
    let mut bench = Bench::new();
    bench.load(
        Program {
            dead_man,
            ..table(4, 1)
        },
        &[STEP; 4],
    );
    bench.go(0);
    for now in (0..50).map(|n| n * 100_000) {
        bench.ask(now, Request::Ping(0)).unwrap();
        bench.session.poll(Ticks(now + 90_000));
    }
    assert_eq!(bench.status().state, State::Running);

    let mut bench = Bench::new();
    bench.load(table(4, 1), &[STEP; 4]);
    bench.go(0);
    bench.session.poll(Ticks(u64::MAX / 2));
    assert_eq!(bench.status().state, State::Running);
}

#[test]
fn what_ends_a_run_is_named() {
    for (lose, fault) in [
        (
            Session::sync_missing as fn(&mut Session),
            Fault::SyncTimeout { step: StepId(2) },
        ),
        (Session::engine_failed, Fault::Engine),
        (
            |session| session.input_too_fast(Line::Strobe),
            Fault::InputTooFast { line: Line::Strobe },
        ),
        (
            |session| session.sync_unclear(StepId(2)),
            Fault::SyncUnclear { step: StepId(2) },
        ),
    ] {
        let mut bench = Bench::new();
        bench.load(table(4, 1), &[STEP; 4]);
        bench.go(0);
        bench.session.fired(2, Ticks(2 * PERIOD));
        bench.engine.clear();
        bench.halts_at = 3 * PERIOD;
        lose(&mut bench.session);
        bench.actions();
        assert_eq!(bench.engine, [EngineCommand::Halt]);
        let ended = Event::Ended {
            run: 1,
            state: State::Fault,
            fault: Some(fault),
            steps_done: 2,
            at: Ticks(3 * PERIOD),
        };
        assert_eq!(bench.events.last(), Some(&ended));
        // Once only, and not without a run.
        lose(&mut bench.session);
        bench.actions();
        assert_eq!((bench.engine.len(), bench.events.last()), (1, Some(&ended)));
    }
}
