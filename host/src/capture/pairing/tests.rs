//! What becomes of runs in which something went wrong.

use rcg_protocol::{StepId, Ticks};

use super::Outcome::{MissedTrigger, NoRecord, Paired};
use super::*;

const TICK_S: f64 = 8e-9;
const PERIOD: u64 = 13_125;

fn record(step: u64, exposed: bool) -> StepRecord {
    let strobe = exposed.then_some(Strobe {
        delay: Ticks(600),
        width: Ticks(10_000),
    });
    let flags = if exposed {
        StepFlags::default()
    } else {
        StepFlags::MISSED
    };
    StepRecord {
        step: StepId(step),
        trigger: Ticks(step * PERIOD + 1000),
        strobe,
        flags,
    }
}

/// A camera whose clock is 7 s ahead and runs fast by 50 ppm.
fn frame(id: u64, step: u64) -> Frame {
    let on_s = (step * PERIOD + 1600) as f64 * TICK_S;
    Frame {
        id,
        timestamp_s: 7.0 + on_s * 1.000_05,
        dn: Vec::new(),
    }
}

#[test]
fn an_undisturbed_run_pairs_in_order() {
    let records: Vec<_> = (0..32_400).map(|step| record(step, true)).collect();
    let frames: Vec<_> = (0..32_400).map(|step| frame(step, step)).collect();
    let pairing = pair(32_400, &records, &[], &frames, TICK_S);
    assert!((0..32_400).all(|step| pairing.outcomes[step] == Paired(step)));
    assert_eq!((pairing.orphans.len(), pairing.duplicates), (0, 0));
}

#[test]
fn a_missed_trigger_shifts_nothing() {
    // The camera swallows trigger 2 and numbers on as if nothing had happened.
    let records: Vec<_> = (0..6).map(|step| record(step, step != 2)).collect();
    let frames: Vec<_> = [0, 1, 3, 4, 5]
        .iter()
        .zip(0..)
        .map(|(&step, id)| frame(id, step))
        .collect();
    let pairing = pair(6, &records, &[], &frames, TICK_S);
    assert_eq!(
        pairing.outcomes,
        [
            Paired(0),
            Paired(1),
            MissedTrigger,
            Paired(2),
            Paired(3),
            Paired(4)
        ]
    );
}

#[test]
fn a_dropped_frame_shifts_nothing_and_without_the_first_or_the_last_nothing_is_sure() {
    let records: Vec<_> = (0..5).map(|step| record(step, true)).collect();
    for lost in 0..5 {
        let frames: Vec<_> = (0..5)
            .filter(|&step| step != lost)
            .map(|step| frame(step, step))
            .collect();
        let pairing = pair(5, &records, &[], &frames, TICK_S);
        for step in 0..5 {
            let expected = match step.cmp(&(lost as usize)) {
                std::cmp::Ordering::Equal => Outcome::DroppedFrame,
                _ if matches!(lost, 0 | 4) => Outcome::Disputed,
                std::cmp::Ordering::Less => Paired(step),
                std::cmp::Ordering::Greater => Paired(step - 1),
            };
            assert_eq!(pairing.outcomes[step], expected, "frame {lost} lost, step {step}");
        }
    }
}

#[test]
fn doubles_orphans_and_spurious_exposures_are_counted_and_harmless() {
    let records: Vec<_> = (0..4).map(|step| record(step, true)).collect();
    let spurious = 2 * PERIOD - 3000; // between steps 1 and 2: exposure number 2
    let mut stray = frame(2, 0);
    stray.timestamp_s = 7.0 + spurious as f64 * TICK_S;
    let frames = [
        frame(0, 0),
        frame(1, 1),
        frame(1, 1),
        stray,
        frame(3, 2),
        frame(4, 3),
    ];
    let pairing = pair(4, &records, &[spurious], &frames, TICK_S);
    assert_eq!(pairing.outcomes, [Paired(0), Paired(1), Paired(4), Paired(5)]);
    assert_eq!((pairing.orphans, pairing.duplicates), (vec![3], 1));
}

#[test]
fn a_camera_that_counts_from_elsewhere_moves_no_frame() {
    let records: Vec<_> = (0..6).map(|step| record(step, true)).collect();
    for (base, lost) in [(1, None), (2, None), (1, Some(5)), (2, Some(4)), (1, Some(0))] {
        let frames: Vec<_> = (0..6)
            .filter(|step| Some(*step) != lost)
            .map(|step| frame(step + base, step))
            .collect();
        let pairing = pair(6, &records, &[], &frames, TICK_S);
        let wrong = (0..6).find(|&step| matches!(pairing.outcomes[step], Paired(_)));
        assert_eq!(wrong, None, "from {base} on, without {lost:?}: {pairing:?}");
    }
}

/// Of a run that may be another's no frame counts.
fn assert_none_paired(pairing: &Pairing) {
    let is_paired = |outcome: &Outcome| matches!(outcome, Paired(_));
    assert!(!pairing.outcomes.iter().any(is_paired), "{pairing:?}");
}

#[test]
fn an_exposure_before_the_first_that_nobody_was_told_of_moves_no_frame() {
    // As long before the first as steps are apart, but for a tenth.
    let records: Vec<_> = (0..6).map(|step| record(step, true)).collect();
    let mut stray = frame(0, 0);
    stray.timestamp_s -= 1.1 * PERIOD as f64 * TICK_S;
    let frames: Vec<_> = std::iter::once(stray)
        .chain((0..6).map(|step| frame(step + 1, step)))
        .collect();
    let pairing = pair(6, &records, &[], &frames, TICK_S);
    assert_none_paired(&pairing);
}

#[test]
fn a_jump_of_the_clock_at_a_lost_record_moves_no_frame() {
    let records: Vec<_> = [0, 1, 2, 4, 5, 6, 7].map(|step| record(step, true)).to_vec();
    let frames: Vec<_> = (0..8)
        .map(|step| frame(step, if step < 3 { step } else { step + 1 }))
        .collect();
    let pairing = pair(8, &records, &[], &frames, TICK_S);
    assert_none_paired(&pairing);
}

#[test]
fn brackets_of_different_length_hold_a_run_in_its_place() {
    // Long and short steps in turn: moved by one, the frames of such a run would not fit; moved by two they would.
    let on = |step: u64| step / 2 * 3 * PERIOD + step % 2 * PERIOD;
    let records: Vec<_> = (0..6)
        .map(|step| StepRecord {
            trigger: Ticks(on(step) + 1000),
            ..record(step, true)
        })
        .collect();
    let frames = |lost: &[u64]| -> Vec<Frame> {
        (0..6)
            .filter(|step| !lost.contains(step))
            .map(|step| Frame {
                timestamp_s: 7.0 + (on(step) + 1600) as f64 * TICK_S,
                ..frame(step, step)
            })
            .collect()
    };
    let paired = |lost: &[u64]| {
        let outcomes = pair(6, &records, &[], &frames(lost), TICK_S).outcomes;
        outcomes
            .iter()
            .filter(|outcome| matches!(outcome, Paired(_)))
            .count()
    };
    assert_eq!(
        [paired(&[5]), paired(&[0]), paired(&[4, 5]), paired(&[0, 1])],
        [5, 5, 0, 0]
    );
}

#[test]
fn number_against_time_stamp_is_disputed() {
    let records: Vec<_> = (0..4).map(|step| record(step, true)).collect();
    let frames = [frame(0, 0), frame(1, 1), frame(3, 2), frame(4, 3)];
    let pairing = pair(4, &records, &[], &frames, TICK_S);
    assert_eq!(pairing.outcomes[2..], [Outcome::Disputed, Outcome::Disputed]);
}

#[test]
fn a_lost_record_leaves_its_step_open_and_its_frame_an_orphan() {
    let records: Vec<_> = [0, 1, 3].map(|step| record(step, true)).to_vec();
    let frames: Vec<_> = (0..4).map(|step| frame(step, step)).collect();
    let pairing = pair(4, &records, &[], &frames, TICK_S);
    assert_eq!(pairing.outcomes, [Paired(0), Paired(1), NoRecord, Paired(3)]);
    assert_eq!(pairing.orphans, [2]);
}

#[test]
fn frames_that_overtake_each_other_are_where_they_belong() {
    let records: Vec<_> = (0..5).map(|step| record(step, true)).collect();
    let frames: Vec<_> = [0, 2, 1, 4, 3].map(|step| frame(step, step)).to_vec();
    let pairing = pair(5, &records, &[], &frames, TICK_S);
    assert_eq!(
        pairing.outcomes,
        [Paired(0), Paired(2), Paired(1), Paired(4), Paired(3)]
    );
}

#[test]
fn a_record_that_comes_twice_counts_once() {
    let records: Vec<_> = [0, 1, 1, 2, 2, 3].map(|step| record(step, true)).to_vec();
    let frames: Vec<_> = (0..4).map(|step| frame(step, step)).collect();
    let pairing = pair(4, &records, &[], &frames, TICK_S);
    assert!(
        (0..4).all(|step| pairing.outcomes[step] == Paired(step)),
        "{pairing:?}"
    );
}

#[test]
fn what_exposes_by_itself_behind_an_ignored_trigger_is_not_its_exposure() {
    let records: Vec<_> = (0..6)
        .map(|step| {
            let late = u64::from(step == 3) * PERIOD / 2;
            StepRecord {
                strobe: record(step, true).strobe.map(|strobe| Strobe {
                    delay: strobe.delay + Ticks(late),
                    ..strobe
                }),
                ..record(step, true)
            }
        })
        .collect();
    let frames: Vec<_> = (0..6)
        .map(|step| {
            let late_s = if step == 3 {
                PERIOD as f64 * 0.5 * TICK_S
            } else {
                0.0
            };
            let frame = frame(step, step);
            Frame {
                timestamp_s: frame.timestamp_s + late_s,
                ..frame
            }
        })
        .collect();
    let pairing = pair(6, &records, &[], &frames, TICK_S);
    assert!(!matches!(pairing.outcomes[3], Paired(_)), "{pairing:?}");
}
