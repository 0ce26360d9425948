//! What is taken in, what is fired, and where a run ends.

use proptest::collection::vec;
use proptest::prelude::*;
use rcg_firmware::pulse::WordFormat;
use rcg_firmware::sequencer::Sequencer;
use rcg_firmware::store::{MAX_STEPS, MAX_WORDS};
use rcg_protocol::State::{Armed, Done, Idle, Loaded, Stopped};
use rcg_protocol::{Extent, Fault, Pace, Polarity, Program, Pulse, State, Step, StepId, Ticks};

use crate::{go, load_stream, load_table, play, step, steps, table};

/// A step whose second and third edge are too close.
const BAD: Step = Step {
    proj: Pulse::new(0, 10),
    cam: Pulse::new(11, 30),
    period: Ticks(1000),
};

#[test]
fn an_empty_or_too_long_table_is_refused_and_the_old_schedule_stays() {
    let mut s = Sequencer::new();
    load_table(&mut s);
    let limit = MAX_STEPS as u32;
    for (steps, cycles, fault) in [
        (0, 1, Fault::EmptySchedule),
        (1, 0, Fault::EmptySchedule),
        (limit + 1, 1, Fault::TooManySteps { limit }),
    ] {
        assert_eq!(s.load(table(steps, cycles)), Err(fault));
        assert_eq!((s.state(), s.program()), (Loaded, Some(&table(2, 3))));
    }
    go(&mut s);
    assert_eq!(play(&mut s).len(), 6);
}

#[test]
fn a_table_takes_its_own_number_of_steps_in_their_order() {
    let mut s = Sequencer::new();
    s.load(table(4, 1)).unwrap();
    assert_eq!(s.room(), 4);
    s.append(0, &steps(0, 2), false).unwrap();
    assert_eq!(s.room(), 2);
    for found in [0, 1, 3, u64::MAX] {
        let fault = Fault::StepsOutOfOrder { expected: 2, found };
        assert_eq!(s.append(found, &steps(2, 1), false), Err(fault));
    }
    assert_eq!(
        s.append(2, &steps(2, 3), false),
        Err(Fault::TooManySteps { limit: 4 })
    );
    assert_eq!((s.state(), s.room()), (Idle, 2));
    s.append(2, &steps(2, 2), false).unwrap();
    assert_eq!(s.state(), Loaded);
}

#[test]
fn a_table_of_long_steps_runs_out_of_words_by_name() {
    // Nine words a step, so that the words end before the steps do.
    let long = Step {
        period: Ticks(9 << 30),
        ..Step::default()
    };
    let words = WordFormat::new(Pace::FreeRunning, Polarity::default())
        .encode(&long, 0)
        .unwrap()
        .len();
    let fit = MAX_WORDS / words;
    assert!(fit < MAX_STEPS);
    let mut s = Sequencer::new();
    s.load(table(MAX_STEPS as u32, 1)).unwrap();
    for index in 0..fit as u64 {
        s.append(index, &[long], false).unwrap();
    }
    let limit = MAX_WORDS as u32;
    assert_eq!(
        s.append(fit as u64, &[long], false),
        Err(Fault::TooManyWords { limit })
    );
}

proptest! {
    #[test]
    fn a_table_fires_its_steps_times_its_cycles_again_and_again(count in 1..40_u64, cycles in 1..20_u32) {
        let mut s = Sequencer::new();
        s.load(table(count as u32, cycles)).unwrap();
        for (batch, chunk) in steps(0, count).chunks(8).enumerate() {
            s.append(batch as u64 * 8, chunk, false).unwrap();
        }
        let format = s.format().unwrap();
        let mut expected = Vec::new();
        let mut begins = 0;
        for number in 0..count * u64::from(cycles) {
            let step = step(number % count);
            let words = format.encode(&step, 0).unwrap().to_vec();
            expected.push((StepId(number), words, begins));
            begins += step.period.0;
        }
        for run in 0..3 {
            prop_assert_eq!(s.arm(), Ok(2 * run + 1));
            prop_assert_eq!((s.steps_done(), s.started(), s.fault()), (0, None, None));
            s.start().unwrap();
            prop_assert_eq!(&play(&mut s), &expected);
            prop_assert_eq!(s.drained(), Done);
            prop_assert_eq!(s.steps_done(), expected.len() as u64);
            // Cut short in mid-table, the next run begins at the beginning all the same.
            s.arm().unwrap();
            s.start().unwrap();
            for _ in 0..=run {
                s.next_step(|_| ());
            }
            prop_assert!(s.abort());
        }
    }

    #[test]
    fn any_commands_in_any_order_keep_the_books(commands in vec((0..8_usize, 0..4_u64), 0..200)) {
        let mut s = Sequencer::new();
        let mut appended = 0;
        let mut armed = 0;
        for (command, count) in commands {
            let (state, room) = (s.state(), s.room());
            let refused = match command {
                0 => s.load(table(5, 2)).map(|()| appended = 0),
                1 => s.load(Program::new(Extent::Stream)).map(|()| appended = 0),
                2 => s.append(appended, &steps(appended, count), count == 3).map(|()| appended += count),
                3 => s.arm().map(|_| armed += 1),
                4 => s.start(),
                5 => s.stop(),
                6 => s.clear().map(|()| appended = 0),
                _ => {
                    if s.next_step(|_| ()).is_none() {
                        s.drained();
                    }
                    Ok(())
                }
            };
            if refused.is_err() {
                prop_assert_eq!((s.state(), s.room()), (state, room));
            }
            prop_assert_eq!(s.run(), armed);
        }
    }
}

#[test]
fn a_stream_frees_what_it_has_played() {
    let mut s = Sequencer::new();
    s.load(Program::new(Extent::Stream)).unwrap();
    let room = s.room();
    s.append(0, &steps(0, 8), false).unwrap();
    assert_eq!(s.room(), room - 8);
    go(&mut s);
    let total = 3 * MAX_STEPS as u64;
    let mut played = 0;
    for first in (8..total).step_by(8) {
        for _ in 0..8 {
            let fetched = s.next_step(|_| ()).unwrap();
            assert_eq!(fetched.step, StepId(played));
            assert_eq!(fetched.trigger, Some(Ticks(20)));
            played += 1;
        }
        assert_eq!(s.room(), room);
        let last = first + 8 >= total;
        s.append(first, &steps(first, 8), last).unwrap();
    }
    played += play(&mut s).len() as u64;
    s.fired(played);
    assert_eq!((played, s.drained(), s.room()), (total, Done, room));
}

#[test]
fn a_full_stream_takes_nothing_and_says_how_much_fits() {
    let mut s = Sequencer::new();
    s.load(Program::new(Extent::Stream)).unwrap();
    let mut first = 0;
    while s.room() >= 8 {
        s.append(first, &steps(first, 8), false).unwrap();
        first += 8;
    }
    go(&mut s);
    for free in 0..8 {
        assert_eq!(s.room(), free);
        let full = s.append(first, &steps(first, 8), false);
        assert_eq!(full, Err(Fault::StreamFull { free }));
        assert_eq!(s.room(), free);
        assert!(s.next_step(|_| ()).is_some());
    }
    s.append(first, &steps(first, 8), false).unwrap();
    let rest = play(&mut s);
    assert_eq!(rest.last().unwrap().0, StepId(first + 7));
    assert_eq!(rest.len() as u64, first);
}

#[test]
fn a_bad_step_leaves_nothing_of_its_batch_behind() {
    for extent in [Extent::Table { steps: 6, cycles: 1 }, Extent::Stream] {
        let mut s = Sequencer::new();
        s.load(Program::new(extent)).unwrap();
        s.append(0, &steps(0, 2), false).unwrap();
        let before = (s.state(), s.room());
        let fault = Fault::EdgesTooClose { step: 4, shortest: 3 };
        assert_eq!(
            s.append(2, &[step(90), step(91), BAD, step(92)], true),
            Err(fault)
        );
        assert_eq!((s.state(), s.room()), before);
        s.append(2, &steps(2, 4), true).unwrap();
        let format = s.format().unwrap();
        go(&mut s);
        let played: Vec<Vec<u32>> = play(&mut s).into_iter().map(|(_, words, _)| words).collect();
        let wanted: Vec<Vec<u32>> = steps(0, 6)
            .iter()
            .map(|step| format.encode(step, 0).unwrap().to_vec())
            .collect();
        assert_eq!(played, wanted);
        assert_eq!(s.drained(), Done);
    }
}

#[test]
fn stop_ends_between_two_steps() {
    let mut s = Sequencer::new();
    load_table(&mut s);
    go(&mut s);
    assert!(s.next_step(|_| ()).is_some());
    assert!(s.next_step(|_| ()).is_some());
    s.fired(1);
    s.stop().unwrap();
    assert!(s.next_step(|_| ()).is_none(), "no step is begun after a stop");
    s.fired(2);
    assert_eq!(s.drained(), Stopped);
    assert_eq!((s.steps_done(), s.fault()), (2, None));
}

#[test]
fn a_stop_during_the_last_step_finds_the_run_done() {
    let mut s = Sequencer::new();
    load_table(&mut s);
    go(&mut s);
    play(&mut s);
    s.stop().unwrap();
    assert_eq!(s.drained(), Done);
}

#[test]
fn a_stream_that_runs_dry_names_the_first_step_that_was_not_fired() {
    let mut s = Sequencer::new();
    load_stream(&mut s, false);
    go(&mut s);
    s.append(2, &steps(2, 3), false).unwrap();
    assert_eq!(play(&mut s).len(), 5);
    assert_eq!(s.drained(), State::Fault);
    assert_eq!(s.fault(), Some(Fault::Underrun { step: StepId(5) }));
    assert_eq!(s.steps_done(), 5);
}

#[test]
fn a_new_run_forgets_the_fault_of_the_last() {
    let mut s = Sequencer::new();
    load_table(&mut s);
    go(&mut s);
    assert!(s.fail(Fault::SyncTimeout { step: StepId(0) }));
    assert_eq!(s.arm(), Ok(2));
    assert_eq!((s.state(), s.fault()), (Armed, None));
}
