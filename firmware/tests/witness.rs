//! Laws of the witness: every strobe belongs to the right trigger, and what is missing is said so.

use proptest::collection::vec;
use proptest::prelude::*;
use rcg_firmware::witness::{MAX_PENDING, Sighting, Witness};
use rcg_protocol::{StepFlags, StepId, StepRecord, Strobe, Ticks};

/// A witness with triggers at 100, 200, 300 …
fn witness(triggers: u64) -> Witness {
    let mut witness = Witness::new();
    for step in 0..triggers {
        assert_eq!(
            witness.announce(StepId(step), Ticks(100 * (step + 1)), true),
            None
        );
    }
    witness
}

/// What the session does with an edge of STROBE.
fn on(witness: &mut Witness, at: u64, records: &mut Vec<StepRecord>) -> Sighting {
    while let Some(record) = witness.settled(Ticks(at)) {
        records.push(record);
    }
    witness.strobe_on(Ticks(at))
}

fn finish(witness: &mut Witness, at: u64, records: &mut Vec<StepRecord>) {
    while let Some(record) = witness.settled(Ticks(at)) {
        records.push(record);
    }
    while let Some(record) = witness.last(Ticks(at)) {
        records.push(record);
    }
}

const fn seen(delay: u64, width: u64) -> Strobe {
    Strobe {
        delay: Ticks(delay),
        width: Ticks(width),
    }
}

fn record(step: u64, strobe: impl Into<Option<Strobe>>, flags: StepFlags) -> StepRecord {
    StepRecord {
        step: StepId(step),
        trigger: Ticks(100 * (step + 1)),
        strobe: strobe.into(),
        flags,
    }
}

const CLEAN: StepFlags = StepFlags(0);

#[test]
fn a_missed_trigger_is_flagged_and_its_neighbours_are_not() {
    let (mut w, mut records) = (witness(3), Vec::new());
    assert_eq!(on(&mut w, 105, &mut records), Sighting::Expected);
    w.strobe_off(Ticks(125));
    assert_eq!(on(&mut w, 307, &mut records), Sighting::Expected);
    w.strobe_off(Ticks(350));
    finish(&mut w, 400, &mut records);
    assert_eq!(
        records,
        [
            record(0, seen(5, 20), CLEAN),
            record(1, None, StepFlags::MISSED),
            record(2, seen(7, 43), CLEAN)
        ]
    );
}

#[test]
fn a_strobe_at_the_very_tick_of_its_trigger_belongs_to_it() {
    let (mut w, mut records) = (witness(2), Vec::new());
    assert_eq!(on(&mut w, 200, &mut records), Sighting::Expected);
    w.strobe_off(Ticks(220));
    finish(&mut w, 300, &mut records);
    assert_eq!(
        records,
        [record(0, None, StepFlags::MISSED), record(1, seen(0, 20), CLEAN)]
    );
}

#[test]
fn a_strobe_before_the_first_trigger_is_spurious_and_changes_nothing() {
    let (mut w, mut records) = (witness(1), Vec::new());
    assert_eq!(on(&mut w, 50, &mut records), Sighting::Spurious);
    w.strobe_off(Ticks(60));
    assert_eq!(on(&mut w, 110, &mut records), Sighting::Expected);
    w.strobe_off(Ticks(130));
    finish(&mut w, 200, &mut records);
    assert_eq!(records, [record(0, seen(10, 20), CLEAN)]);
}

#[test]
fn the_end_of_a_spurious_strobe_is_not_the_end_of_the_next_exposure() {
    let (mut w, mut records) = (witness(1), Vec::new());
    // It is on when the trigger comes; only its own edges count.
    assert_eq!(on(&mut w, 50, &mut records), Sighting::Spurious);
    w.strobe_off(Ticks(101));
    finish(&mut w, 200, &mut records);
    assert_eq!(records, [record(0, None, StepFlags::MISSED)]);
}

#[test]
fn a_second_strobe_of_one_trigger_is_spurious_and_flags_the_step() {
    let (mut w, mut records) = (witness(2), Vec::new());
    assert_eq!(on(&mut w, 110, &mut records), Sighting::Expected);
    w.strobe_off(Ticks(120));
    assert_eq!(on(&mut w, 150, &mut records), Sighting::Spurious);
    w.strobe_off(Ticks(180));
    assert_eq!(on(&mut w, 210, &mut records), Sighting::Expected);
    w.strobe_off(Ticks(230));
    finish(&mut w, 300, &mut records);
    assert_eq!(
        records,
        [
            record(0, seen(10, 10), StepFlags::DOUBLE),
            record(1, seen(10, 20), CLEAN)
        ]
    );
}

#[test]
fn an_exposure_that_outlasts_its_step_is_an_overrun_and_does_not_end_the_next() {
    let (mut w, mut records) = (witness(3), Vec::new());
    assert_eq!(on(&mut w, 110, &mut records), Sighting::Expected);
    // Its end comes after the next trigger, which the camera then misses.
    while let Some(record) = w.settled(Ticks(250)) {
        records.push(record);
    }
    w.strobe_off(Ticks(250));
    assert_eq!(on(&mut w, 310, &mut records), Sighting::Expected);
    w.strobe_off(Ticks(320));
    finish(&mut w, 400, &mut records);
    assert_eq!(
        records,
        [
            record(0, seen(10, 0), StepFlags::OVERRUN),
            record(1, None, StepFlags::MISSED),
            record(2, seen(10, 10), CLEAN)
        ]
    );
}

#[test]
fn an_exposure_that_is_on_when_the_run_ends_is_an_overrun() {
    let (mut w, mut records) = (witness(1), Vec::new());
    assert_eq!(on(&mut w, 110, &mut records), Sighting::Expected);
    finish(&mut w, 130, &mut records);
    assert_eq!(records, [record(0, seen(10, 0), StepFlags::OVERRUN)]);
}

#[test]
fn where_the_end_of_an_exposure_was_not_seen_none_is_made_up() {
    let (mut w, mut records) = (witness(2), Vec::new());
    assert_eq!(on(&mut w, 110, &mut records), Sighting::Expected);
    // Its end is not seen, so the next one is that of the second exposure.
    assert_eq!(on(&mut w, 150, &mut records), Sighting::Spurious);
    w.strobe_off(Ticks(180));
    assert_eq!(on(&mut w, 210, &mut records), Sighting::Expected);
    w.strobe_off(Ticks(230));
    finish(&mut w, 300, &mut records);
    let flags = StepFlags::DOUBLE.with(StepFlags::OVERRUN);
    assert_eq!(
        records,
        [record(0, seen(10, 0), flags), record(1, seen(10, 20), CLEAN)]
    );
}

#[test]
fn a_step_without_a_cam_pulse_expects_no_strobe() {
    let (mut w, mut records) = (Witness::new(), Vec::new());
    assert_eq!(w.announce(StepId(0), Ticks(100), false), None);
    assert_eq!(w.announce(StepId(1), Ticks(200), true), None);
    assert_eq!(on(&mut w, 110, &mut records), Sighting::Spurious);
    w.strobe_off(Ticks(120));
    finish(&mut w, 300, &mut records);
    assert_eq!(
        records,
        [
            record(0, None, StepFlags::NO_TRIGGER),
            record(1, None, StepFlags::MISSED)
        ]
    );
}

#[test]
fn a_trigger_that_was_announced_and_never_reached_has_no_record() {
    let (mut w, mut records) = (witness(5), Vec::new());
    finish(&mut w, 299, &mut records);
    assert_eq!(
        records,
        [
            record(0, None, StepFlags::MISSED),
            record(1, None, StepFlags::MISSED)
        ]
    );
    assert_eq!(w.last(Ticks(1000)), None);
}

#[test]
fn a_trigger_is_settled_when_the_next_one_comes_and_not_before() {
    let mut w = witness(2);
    assert_eq!(w.settled(Ticks(199)), None);
    assert_eq!(w.settled(Ticks(200)), Some(record(0, None, StepFlags::MISSED)));
    assert_eq!(w.settled(Ticks(10_000)), None);
}

#[test]
fn a_crowded_witness_gives_up_the_oldest_trigger_and_loses_none() {
    let mut w = witness(MAX_PENDING as u64);
    let next = MAX_PENDING as u64;
    let crowded = w.announce(StepId(next), Ticks(100 * (next + 1)), true);
    assert_eq!(crowded, Some(record(0, None, StepFlags::MISSED)));
    let mut records = Vec::new();
    finish(&mut w, u64::MAX, &mut records);
    let ids: Vec<u64> = records.iter().map(|record| record.step.0).collect();
    assert_eq!(ids, (1..=next).collect::<Vec<_>>());
}

#[test]
fn nothing_of_a_run_is_left_when_it_was_cleared() {
    let (mut w, mut records) = (witness(3), Vec::new());
    let _ = on(&mut w, 50, &mut records);
    w.clear();
    assert_eq!(w.announce(StepId(0), Ticks(100), true), None);
    assert_eq!(on(&mut w, 110, &mut records), Sighting::Expected);
    w.strobe_off(Ticks(120));
    finish(&mut w, 200, &mut records);
    assert_eq!(records, [record(0, seen(10, 10), CLEAN)]);
}

/// What the camera does at one step.
#[derive(Clone, Copy, Debug)]
struct Shot {
    /// Ticks from this trigger to the next; the strobe fits in.
    period: u64,
    /// The step has a CAM pulse.
    fires: bool,
    /// The camera exposes.
    exposes: bool,
    delay: u64,
    width: u64,
    /// A second strobe follows.
    again: bool,
}

fn shot() -> impl Strategy<Value = Shot> {
    (
        100..1000_u64,
        prop::bool::weighted(0.9),
        prop::bool::weighted(0.8),
        0..20_u64,
        1..20_u64,
        prop::bool::weighted(0.1),
    )
        .prop_map(|(period, fires, exposes, delay, width, again)| Shot {
            period,
            fires,
            exposes,
            delay,
            width,
            again,
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn exactly_what_the_camera_did_is_recorded(shots in vec(shot(), 1..600), ahead in 1..MAX_PENDING) {
        let mut triggers = vec![1000];
        for shot in &shots {
            triggers.push(triggers[triggers.len() - 1] + shot.period);
        }
        let mut w = Witness::new();
        let (mut records, mut expected, mut spurious, mut announced) = (Vec::new(), Vec::new(), 0, 0);
        for (step, shot) in shots.iter().enumerate() {
            let at = triggers[step];
            // What came before is settled first; then the engine looks some steps ahead.
            while let Some(record) = w.settled(Ticks(at)) {
                records.push(record);
            }
            while announced < shots.len() && announced < step + ahead {
                let id = StepId(announced as u64);
                prop_assert_eq!(w.announce(id, Ticks(triggers[announced]), shots[announced].fires), None);
                announced += 1;
            }
            let mut strobe = |delay: u64| {
                let sighting = on(&mut w, at + delay, &mut records);
                w.strobe_off(Ticks(at + delay + shot.width));
                spurious += usize::from(sighting == Sighting::Spurious);
            };
            let mut flags = StepFlags(0);
            if shot.exposes {
                strobe(shot.delay);
                if shot.again {
                    strobe(shot.delay + shot.width + 3);
                    flags = if shot.fires { StepFlags::DOUBLE } else { flags };
                }
            }
            flags = match (shot.fires, shot.exposes) {
                (false, _) => StepFlags::NO_TRIGGER,
                (true, false) => StepFlags::MISSED,
                (true, true) => flags,
            };
            expected.push(StepRecord {
                step: StepId(step as u64),
                trigger: Ticks(at),
                strobe: (shot.fires && shot.exposes)
                    .then_some(Strobe { delay: Ticks(shot.delay), width: Ticks(shot.width) }),
                flags,
            });
        }
        finish(&mut w, triggers[shots.len()], &mut records);
        prop_assert_eq!(records, expected);
        let unexplained: usize = shots
            .iter()
            .filter(|shot| shot.exposes)
            .map(|shot| usize::from(!shot.fires) + usize::from(shot.again))
            .sum();
        prop_assert_eq!(spurious, unexplained);
    }
}
