//! Further lines and runs that repeat, as far as the session has a say.

use rcg_firmware::kept::Kept;
use rcg_firmware::session::EngineCommand;
use rcg_protocol::{
    Aux, AuxPolarity, AuxPulse, Event, Extent, Fault, Pace, PhotoPulse, Program, Pulse, Reply, Request,
    Start, State, Step, Ticks,
};

use crate::bench::{Bench, MS, PERIOD, STEP, table};

const A_LOW: AuxPolarity = AuxPolarity {
    a_active_low: true,
    b_active_low: false,
    photo_active_low: false,
    start_active_low: false,
};

/// Pulses of PHOTO that were told of, and the numbers of the first in each event.
fn told(bench: &Bench) -> (Vec<PhotoPulse>, Vec<u32>) {
    let (mut pulses, mut firsts) = (Vec::new(), Vec::new());
    for event in &bench.events {
        if let Event::Photo {
            first, pulses: some, ..
        } = event
        {
            pulses.extend(some.iter().copied());
            firsts.extend((!some.is_empty()).then_some(*first));
        }
    }
    (pulses, firsts)
}

fn count(bench: &mut Bench) -> u32 {
    match bench.ask(0, Request::Photo) {
        Ok(Reply::Photo(photo)) => photo.pulses,
        other => panic!("{other:?}"),
    }
}

fn stamping(bench: &mut Bench, steps: u32) {
    let aux = Aux {
        photo: true,
        ..Aux::default()
    };
    bench.ask(0, Request::Aux(aux)).unwrap();
    bench.load(table(1, steps), &[STEP]);
    bench.go(0);
}

#[test]
fn pulses_of_photo_are_told_in_order_and_what_has_no_room_is_seen_to_be_missing() {
    for (drained, active_at_start) in [(true, false), (true, true), (false, false)] {
        let mut bench = Bench::new();
        stamping(&mut bench, 1);
        if active_at_start {
            bench.session.photo(false, Ticks(3)); // light from before the run
        }
        let all = 300_u64;
        for k in 0..all {
            bench.session.photo(true, Ticks(100 * k + 7));
            bench.session.photo(false, Ticks(100 * k + 40));
            if drained {
                bench.actions();
            }
        }
        bench.session.photo(true, Ticks(100 * all));
        bench.session.drained(Ticks(PERIOD));
        bench.actions();
        let (pulses, firsts) = told(&bench);
        let mut expected: Vec<PhotoPulse> = (0..all)
            .map(|k| PhotoPulse {
                on: Ticks(100 * k + 7),
                width: Some(Ticks(33)),
            })
            .collect();
        expected.push(PhotoPulse {
            on: Ticks(100 * all),
            width: None,
        });
        assert_eq!(u64::from(count(&mut bench)), all + 1);
        if drained {
            assert_eq!(pulses, expected);
        } else {
            // Each event says where it belongs, and the answer how many there should be.
            let numbers = firsts.iter().flat_map(|&first| first..first + 8);
            let found: Vec<PhotoPulse> = numbers.map(|k| expected[k as usize]).collect();
            assert_eq!(pulses, found);
            assert!(!pulses.is_empty() && pulses.len() < expected.len());
        }
        let [.., Event::Photo { first, pulses, .. }, Event::Ended { .. }] = bench.events.as_slice() else {
            panic!(
                "expected the number of pulses and the end, found {:?}",
                bench.events.last()
            );
        };
        assert_eq!((u64::from(*first), pulses.len()), (all + 1, 0));
        // The next run counts anew.
        bench.ask(0, Request::Arm).unwrap();
        assert_eq!(count(&mut bench), 0);
    }
}

#[test]
fn of_a_table_of_very_short_steps_nothing_is_said_of_photo() {
    let mut bench = Bench::new();
    let aux = Aux {
        photo: true,
        ..Aux::default()
    };
    bench.ask(0, Request::Aux(aux)).unwrap();
    let step = Step {
        period: Ticks(200),
        ..Step::default()
    };
    bench.load(table(1, 100_000), &[step]);
    bench.go(0);
    assert!(bench.session.burst(Ticks(MS)).is_some());
    bench.session.fired(100_000, Ticks(20_000_000));
    bench.session.drained(Ticks(20_000_000));
    bench.actions();
    assert!(
        !bench
            .events
            .iter()
            .any(|event| matches!(event, Event::Photo { .. }))
    );
}

#[test]
fn a_pulse_of_photo_does_not_wait_for_seven_others() {
    let mut bench = Bench::new();
    stamping(&mut bench, 1000);
    bench.session.photo(true, Ticks(5));
    bench.session.photo(false, Ticks(50));
    bench.session.poll(Ticks(10 * MS));
    bench.actions();
    assert_eq!(told(&bench).0, []);
    bench.session.poll(Ticks(25 * MS));
    bench.actions();
    assert_eq!(told(&bench).0.len(), 1);
}

#[test]
fn what_further_lines_do_ends_with_the_session_and_where_they_rest_does_not() {
    let mut bench = Bench::new();
    bench.ask(0, Request::KeepAux(A_LOW)).unwrap();
    let kept = Kept {
        aux: A_LOW,
        ..Kept::default()
    };
    assert_eq!(bench.engine, [EngineCommand::Keep(kept)]);
    assert_eq!(bench.ask(0, Request::KeptAux), Ok(Reply::KeptAux(A_LOW)));
    // A host that says nothing of them finds them at rest, on their side.
    bench.load(table(1, 1), &[STEP]);
    assert_eq!(bench.session.sequencer().aux(), &Aux::resting(A_LOW));
    let aux = Aux {
        b: AuxPulse::InStep(Pulse::new(5, 10)),
        ..Aux::default()
    };
    bench.ask(0, Request::Aux(aux)).unwrap();
    assert_eq!(
        bench.session.sequencer().aux(),
        &Aux::resting(A_LOW),
        "not before the next schedule"
    );
    bench.load(table(1, 1), &[STEP]);
    assert_eq!(bench.session.sequencer().aux(), &aux);
    bench.id = bench.hello(1, 2).session;
    bench.seq = 1;
    bench.load(table(1, 1), &[STEP]);
    assert_eq!(bench.session.sequencer().aux(), &Aux::resting(A_LOW));
}

#[test]
fn a_pulse_beyond_its_step_is_refused_by_its_number() {
    let mut bench = Bench::new();
    for (pulse, refused) in [
        (AuxPulse::InStep(Pulse::new(0, PERIOD)), None),
        (AuxPulse::InStep(Pulse::new(1, PERIOD)), Some(true)),
        (AuxPulse::InStep(Pulse::new(u64::MAX, u64::MAX)), Some(true)),
        (AuxPulse::InStep(Pulse::new(1, 50)), Some(false)),
        (
            AuxPulse::WithCam {
                after: Ticks(PERIOD - 500),
                width: Ticks::ZERO,
            },
            None,
        ),
        (
            AuxPulse::WithCam {
                after: Ticks(PERIOD - 499),
                width: Ticks::ZERO,
            },
            Some(true),
        ),
        (
            AuxPulse::WithCam {
                after: Ticks(u64::MAX),
                width: Ticks(1),
            },
            Some(true),
        ),
    ] {
        bench
            .ask(
                0,
                Request::Aux(Aux {
                    a: pulse,
                    ..Aux::default()
                }),
            )
            .unwrap();
        bench.ask(0, Request::Load(table(1, 1))).unwrap();
        let steps = [STEP].into_iter().collect();
        let answer = bench.ask(
            0,
            Request::Append {
                first: 0,
                steps,
                last: true,
            },
        );
        let expected = refused.map(|outside| {
            if outside {
                Fault::PulseOutsidePeriod { step: 0 }
            } else {
                Fault::EdgesTooClose { step: 0, shortest: 3 }
            }
        });
        assert_eq!(answer.err(), expected, "{pulse:?}");
    }
}

/// Plays what is armed to its end.
fn play(bench: &mut Bench) {
    while bench.session.next_step(|_| ()).is_some() {}
    bench.session.begun(Ticks::ZERO);
    bench.session.fired(1, Ticks(PERIOD));
    bench.session.drained(Ticks(PERIOD));
    bench.actions();
}

#[test]
fn a_run_repeats_as_often_as_was_said_and_no_further_once_it_is_stopped() {
    let start = EngineCommand::Go(Start::OnStartLine);
    let program = Program {
        start: Start::OnStartLine,
        ..table(1, 1)
    };
    for (runs, expected) in [(1, 1), (2, 2), (3, 3), (0, 10)] {
        let mut bench = Bench::new();
        bench.ask(0, Request::Repeat { runs }).unwrap();
        bench.load(program, &[STEP]);
        bench.ask(0, Request::Arm).unwrap();
        bench.ask(0, Request::Start).unwrap();
        for run in 1..=10_u32 {
            if bench.status().state != State::Running {
                break;
            }
            assert_eq!(
                (bench.engine.as_slice(), bench.status().run),
                ([EngineCommand::Prime, start].as_slice(), run)
            );
            bench.engine.clear();
            play(&mut bench);
            assert!(
                matches!(bench.events.last(), Some(Event::Ended { run: ended, state: State::Done, .. }) if *ended == run)
            );
            // It is armed at once and starts at the poll: till then the engine fills its blocks.
            let goes_on = runs == 0 || run < runs;
            let armed: &[EngineCommand] = if goes_on { &[EngineCommand::Prime] } else { &[] };
            assert_eq!(bench.engine, armed);
            bench.session.poll(Ticks(MS));
            bench.actions();
        }
        assert_eq!(bench.status().run, expected + u32::from(runs == 0));
        let state = if runs == 0 { State::Running } else { State::Done };
        assert_eq!(bench.status().state, state);
    }
    // A stop, and an abort between two of them, end the series; the next that is armed is another one.
    for abort in [false, true] {
        let mut bench = Bench::new();
        bench.ask(0, Request::Repeat { runs: 0 }).unwrap();
        bench.load(program, &[STEP]);
        bench.ask(0, Request::Arm).unwrap();
        bench.ask(0, Request::Start).unwrap();
        if abort {
            play(&mut bench);
            bench.ask(0, Request::Abort).unwrap();
        } else {
            bench.ask(0, Request::Stop).unwrap();
            bench.session.drained(Ticks::ZERO);
        }
        bench.actions();
        bench.engine.clear();
        bench.session.poll(Ticks(MS));
        bench.actions();
        assert_eq!(bench.engine, []);
        let state = if abort { State::Aborted } else { State::Stopped };
        assert_eq!(bench.status().state, state);
    }
}

#[test]
fn start_and_steps_that_wait_for_sync_do_not_go_together() {
    let mut bench = Bench::new();
    let program = Program {
        start: Start::OnStartLine,
        pace: Pace::EachOnSync,
        ..Program::new(Extent::Stream)
    };
    assert_eq!(bench.ask(0, Request::Load(program)), Err(Fault::StartPaced));
}
