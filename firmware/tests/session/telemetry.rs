//! Records of the steps: in order, in batches, and counted if lost.

use rcg_firmware::pulse::SYNC_LATENCY;
use rcg_protocol::{
    Event, Extent, Pace, Program, RECORDS_PER_EVENT, Reply, Request, State, StepFlags, StepId, StepRecord,
    Strobe, Ticks, ToHost,
};

use crate::bench::{Bench, MS, PERIOD, STEP, table};

/// Plays `steps` steps as a free-running engine with a perfect camera does, `at_once` steps fetched ahead.
fn fire(bench: &mut Bench, steps: u64, drain: bool) {
    let mut fetched = 0;
    for step in 0..steps {
        while fetched < step + 4 && bench.session.next_step(|_| ()).is_some() {
            fetched += 1;
        }
        let begins = step * PERIOD;
        bench.session.strobe(true, Ticks(begins + 250));
        bench.session.strobe(false, Ticks(begins + 550));
        bench.session.fired(step + 1, Ticks(begins + PERIOD));
        if drain {
            bench.actions();
        }
    }
}

fn perfect(step: u64) -> StepRecord {
    StepRecord {
        step: StepId(step),
        trigger: Ticks(step * PERIOD + 200),
        strobe: Some(Strobe {
            delay: Ticks(50),
            width: Ticks(300),
        }),
        flags: StepFlags(0),
    }
}

#[test]
fn every_step_has_its_record_in_order_if_the_link_keeps_up() {
    for steps in [1_u32, 7, 8, 9, 100, 1000] {
        let mut bench = Bench::new();
        bench.load(table(1, steps), &[STEP]);
        bench.go(0);
        fire(&mut bench, u64::from(steps), true);
        bench.session.drained(Ticks(u64::from(steps) * PERIOD));
        bench.actions();
        let expected: Vec<StepRecord> = (0..u64::from(steps)).map(perfect).collect();
        assert_eq!(bench.records(), expected);
        assert!(matches!(
            bench.events.last(),
            Some(Event::Ended {
                state: State::Done,
                ..
            })
        ));
        assert_eq!(bench.status().counters.records_lost, 0);
    }
}

#[test]
fn a_link_that_does_not_keep_up_loses_records_by_number_and_no_response() {
    let mut bench = Bench::new();
    let steps = 1000;
    bench.load(table(1, steps), &[STEP]);
    bench.go(0);
    fire(&mut bench, u64::from(steps), false);
    // The outbox is full of telemetry; a question is answered all the same, and the end is told.
    let full = bench.ask(u64::from(steps) * PERIOD, Request::Ping(5));
    assert_eq!(full, Ok(Reply::Pong(5)));
    bench.session.drained(Ticks(u64::from(steps) * PERIOD));
    bench.actions();
    let records = bench.records();
    assert!(records.windows(2).all(|pair| pair[0].step < pair[1].step));
    assert!(records.iter().all(|record| *record == perfect(record.step.0)));
    let lost = bench.status().counters.records_lost;
    assert!(lost > 0);
    assert_eq!(records.len() as u32 + lost, steps);
    assert!(matches!(
        bench.events.last(),
        Some(Event::Ended {
            state: State::Done,
            ..
        })
    ));
}

#[test]
fn full_batches_go_at_once_and_others_after_a_while() {
    let mut bench = Bench::new();
    bench.load(table(1, 1000), &[STEP]);
    bench.go(7 * MS);
    // Step n is settled by the trigger of step n + 1.
    fire(&mut bench, 4, true);
    bench.session.strobe(true, Ticks(4 * PERIOD + 250));
    bench.actions();
    assert!(bench.records().is_empty(), "the batch is not full");
    bench.session.poll(Ticks(7 * MS + PERIOD + 20 * MS));
    bench.actions();
    assert!(bench.records().is_empty(), "the batch has not waited long");
    bench.session.poll(Ticks(7 * MS + PERIOD + 21 * MS));
    bench.actions();
    assert_eq!(bench.records(), (0..4).map(perfect).collect::<Vec<_>>());

    let mut bench = Bench::new();
    bench.load(table(1, 1000), &[STEP]);
    bench.go(0);
    fire(&mut bench, RECORDS_PER_EVENT as u64, true);
    assert!(bench.records().is_empty());
    bench
        .session
        .strobe(true, Ticks(RECORDS_PER_EVENT as u64 * PERIOD + 250));
    bench.actions();
    assert_eq!(bench.records().len(), RECORDS_PER_EVENT);
}

#[test]
fn spurious_strobes_are_told_and_counted() {
    let mut bench = Bench::new();
    bench.load(table(1, 1000), &[STEP]);
    bench.go(0);
    let _ = bench.session.next_step(|_| ());
    for at in [250, 1000, 2000] {
        bench.session.strobe(true, Ticks(at));
        bench.session.strobe(false, Ticks(at + 10));
    }
    bench.actions();
    let spurious = |on| Event::SpuriousStrobe {
        run: 1,
        on: Ticks(on),
    };
    assert_eq!(bench.events, [spurious(1000), spurious(2000)]);
    assert_eq!(bench.status().counters.spurious_strobes, 2);
}

/// A camera whose line rings when its exposure begins and ends.
#[test]
fn glitches_of_strobe_are_left_out_when_that_is_wanted() {
    for (shortest, double) in [(0, true), (20, false)] {
        let mut bench = Bench::new();
        bench.load(table(1, 20), &[STEP]);
        bench
            .ask(
                0,
                Request::Filter {
                    strobe: Ticks(shortest),
                },
            )
            .unwrap();
        bench.go(0);
        while bench.session.next_step(|_| ()).is_some() {}
        for step in 0..20 {
            let begins = step * PERIOD;
            for (active, at) in [
                (true, 250),
                (false, 255),
                (true, 259),
                (false, 550),
                (true, 553),
                (false, 561),
            ] {
                bench.session.strobe(active, Ticks(begins + at));
                bench.session.fired(step, Ticks(begins + at + 2));
            }
            bench.session.fired(step + 1, Ticks(begins + PERIOD));
            bench.actions();
        }
        bench.session.drained(Ticks(20 * PERIOD));
        bench.actions();
        let records = bench.records();
        assert_eq!(records.len(), 20);
        for record in records {
            assert_eq!(record.flags.contains(StepFlags::DOUBLE), double);
            let Strobe { delay, width } = record.strobe.unwrap();
            assert!(double || (delay, width) == (Ticks(59), Ticks(302)), "{record:?}");
        }
    }
}

/// A hundred thousand strobes a second that nobody triggered: all are counted, some are told, and no record is lost to them.
#[test]
fn noise_displaces_no_record() {
    let mut bench = Bench::new();
    let steps = 400;
    bench.load(table(1, steps), &[STEP]);
    bench.go(0);
    for step in 0..u64::from(steps) {
        while bench.session.next_step(|_| ()).is_some() && bench.session.sequencer().room() > 0 {}
        for noise in 0..100 {
            bench.session.strobe(true, Ticks(step * PERIOD + noise * 1250));
            bench
                .session
                .strobe(false, Ticks(step * PERIOD + noise * 1250 + 100));
        }
        bench.session.fired(step + 1, Ticks((step + 1) * PERIOD));
        // The link takes a few messages in each millisecond.
        for _ in 0..2 {
            if let Some(ToHost::Event(event)) = bench.session.message() {
                bench.events.push(event.clone());
                bench.session.message_sent();
            }
        }
    }
    bench.session.drained(Ticks(u64::from(steps) * PERIOD));
    bench.actions();
    assert_eq!(bench.records().len(), steps as usize);
    let told = bench
        .events
        .iter()
        .filter(|event| matches!(event, Event::SpuriousStrobe { .. }));
    let told = told.count();
    assert!((100..=16 + 200 + 1).contains(&told), "{told}");
    assert!(bench.status().counters.spurious_strobes > 39_000);
}

#[test]
fn triggers_of_paced_steps_count_from_their_sync_edge() {
    let mut bench = Bench::new();
    let paced = Program {
        pace: Pace::EachOnSync,
        ..table(1, 3)
    };
    bench.load(paced, &[STEP]);
    bench.go(0);
    while bench.session.next_step(|_| ()).is_some() {}
    let syncs = [1_000, 400_000, 999_999];
    for (done, sync) in (1..).zip(syncs) {
        bench.session.sync(Ticks(sync), true);
        bench.session.strobe(true, Ticks(sync + SYNC_LATENCY + 207));
        bench.session.strobe(false, Ticks(sync + SYNC_LATENCY + 500));
        bench.session.fired(done, Ticks(sync + SYNC_LATENCY + PERIOD));
    }
    bench.session.drained(Ticks(2_000_000));
    bench.actions();
    let records = bench.records();
    assert_eq!(records.len(), 3);
    for (record, sync) in records.iter().zip(syncs) {
        assert_eq!(record.trigger, Ticks(sync + SYNC_LATENCY + 200));
        let strobe = Strobe {
            delay: Ticks(7),
            width: Ticks(293),
        };
        assert_eq!((record.strobe, record.flags), (Some(strobe), StepFlags(0)));
    }
}

#[test]
fn a_stream_tells_when_it_has_room_again() {
    let mut bench = Bench::new();
    bench.load(Program::new(Extent::Stream), &[STEP; 160]);
    bench.go(0);
    let room = bench.session.sequencer().room();
    fire(&mut bench, 140, true);
    let rooms: Vec<u32> = bench
        .events
        .iter()
        .filter_map(|event| match event {
            Event::Room { steps, .. } => Some(*steps),
            _ => None,
        })
        .collect();
    assert_eq!(rooms.len(), 2, "at 64 and at 128 steps");
    assert!(rooms[0] >= room + 64 && rooms[1] == rooms[0] + 64);
}
