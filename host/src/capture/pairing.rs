//! Which frame belongs to which trigger.
//!
//! # Design
//! A frame belongs to a trigger because its time-stamp falls on the strobe of that trigger, never because
//! it arrived next. Controller and camera have clocks of their own: the first frame whose number points at a
//! known strobe gives the offset, the following ones correct it, so that slow drift does no harm. The
//! frame's number must tell the same story; where it does not, the frame is disputed and not used. What is
//! missing, late, doubled or unexplained is a value; the caller measures again.

use rcg_protocol::{StepFlags, StepRecord, Strobe};

use crate::capture::camera::Frame;

/// What became of one step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The frame of this index belongs to it.
    Paired(usize),
    /// The camera did not expose although it was triggered.
    MissedTrigger,
    /// The camera exposed, but no frame came.
    DroppedFrame,
    /// The controller's record of the step did not arrive.
    NoRecord,
    /// Number and time-stamp of the frame contradict each other, or the strobe was not clean.
    Disputed,
    /// The step did not begin when its picture appeared, as far as the display says.
    Unsteady,
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Paired(_) => "a frame",
            Self::MissedTrigger => "the camera missed its trigger",
            Self::DroppedFrame => "the frame was lost on its way",
            Self::NoRecord => "the trigger box's record did not arrive",
            Self::Disputed => "frame and strobe contradict each other",
            Self::Unsteady => {
                "SYNC and the display contradict each other: display frames were shown again or left out"
            }
        })
    }
}

/// All steps of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pairing {
    /// One outcome per step.
    pub outcomes: Vec<Outcome>,
    /// Indices of the frames that no strobe explains.
    pub orphans: Vec<usize>,
    /// Frames that came a second time.
    pub duplicates: usize,
}

/// A strobe on the controller's clock.
struct Exposure {
    step: usize,
    on_s: f64,
}

/// Pairs the `frames` of a run with its steps. `records` and `spurious_on` (strobes that no trigger explains)
/// are as the controller sent them, in order; `tick_s` is the length of a tick and `steps` their number.
#[must_use]
pub fn pair(
    steps: usize,
    records: &[StepRecord],
    spurious_on: &[u64],
    frames: &[Frame],
    tick_s: f64,
) -> Pairing {
    let mut outcomes = vec![Outcome::NoRecord; steps];
    let mut exposures = Vec::with_capacity(records.len());
    for record in records {
        let Some(outcome) = outcomes.get_mut(record.step.0 as usize) else {
            continue;
        };
        *outcome = match record.strobe {
            None => Outcome::MissedTrigger,
            Some(Strobe { delay, .. }) => {
                exposures.push(Exposure {
                    step: record.step.0 as usize,
                    on_s: (record.trigger + delay).0 as f64 * tick_s,
                });
                let clean = StepFlags::DOUBLE.0 | StepFlags::OVERRUN.0;
                if record.flags.0 & clean == 0 {
                    Outcome::DroppedFrame
                } else {
                    Outcome::Disputed
                }
            }
        };
    }
    let spurious_s: Vec<f64> = spurious_on.iter().map(|&on| on as f64 * tick_s).collect();

    let mut pairing = Pairing {
        outcomes,
        orphans: Vec::new(),
        duplicates: 0,
    };
    let Some(mut offset_s) = first_offset(&pairing.outcomes, &exposures, &spurious_s, frames) else {
        pairing.orphans = (0..frames.len()).collect();
        return pairing;
    };
    // Half of the smallest distance between strobes separates them; a quarter leaves room for doubt.
    let apart_s = exposures
        .windows(2)
        .map(|pair| pair[1].on_s - pair[0].on_s)
        .fold(f64::INFINITY, f64::min);
    let tolerance_s = if apart_s.is_finite() {
        apart_s / 4.0
    } else {
        f64::INFINITY
    };
    let complete = pairing
        .outcomes
        .iter()
        .all(|outcome| *outcome != Outcome::NoRecord);

    let mut last_id = None;
    for (index, frame) in frames.iter().enumerate() {
        if last_id.is_some_and(|last| frame.id <= last) {
            pairing.duplicates += 1;
            continue;
        }
        last_id = Some(frame.id);
        let on_s = frame.timestamp_s - offset_s;
        let Some((ordinal, exposure)) = nearest(&exposures, on_s) else {
            pairing.orphans.push(index);
            continue;
        };
        let error_s = on_s - exposure.on_s;
        if error_s.abs() > tolerance_s {
            pairing.orphans.push(index);
            continue;
        }
        offset_s += error_s / 8.0; // follows drift, ignores jitter
        let before = spurious_s
            .iter()
            .filter(|&&spurious| spurious < exposure.on_s)
            .count();
        let numbered = !complete || frame.id == (ordinal + before) as u64;
        let outcome = &mut pairing.outcomes[exposure.step];
        *outcome = match *outcome {
            Outcome::DroppedFrame if numbered => Outcome::Paired(index),
            _ => Outcome::Disputed,
        };
    }
    pairing
}

/// Camera clock minus controller clock, from the first frame whose number points at a strobe that is known:
/// all steps before it must have their records.
fn first_offset(
    outcomes: &[Outcome],
    exposures: &[Exposure],
    spurious_s: &[f64],
    frames: &[Frame],
) -> Option<f64> {
    let known = outcomes
        .iter()
        .position(|o| *o == Outcome::NoRecord)
        .unwrap_or(outcomes.len());
    let mut all: Vec<f64> = exposures
        .iter()
        .filter(|e| e.step < known)
        .map(|e| e.on_s)
        .collect();
    let end = all.last().copied()?;
    all.extend(spurious_s.iter().filter(|&&on_s| on_s < end));
    all.sort_by(f64::total_cmp);
    frames
        .iter()
        .find_map(|frame| all.get(frame.id as usize).map(|on_s| frame.timestamp_s - on_s))
}

fn nearest(exposures: &[Exposure], on_s: f64) -> Option<(usize, &Exposure)> {
    let after = exposures.partition_point(|exposure| exposure.on_s < on_s);
    let candidates = after.saturating_sub(1)..(after + 1).min(exposures.len());
    candidates
        .map(|ordinal| (ordinal, &exposures[ordinal]))
        .min_by(|a, b| (a.1.on_s - on_s).abs().total_cmp(&(b.1.on_s - on_s).abs()))
}

#[cfg(test)]
mod tests {
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
    fn a_dropped_frame_shifts_nothing_even_if_it_is_the_first() {
        let records: Vec<_> = (0..5).map(|step| record(step, true)).collect();
        for lost in 0..5 {
            let frames: Vec<_> = (0..5)
                .filter(|&step| step != lost)
                .map(|step| frame(step, step))
                .collect();
            let pairing = pair(5, &records, &[], &frames, TICK_S);
            for step in 0..5 {
                let expected = match step.cmp(&(lost as usize)) {
                    std::cmp::Ordering::Less => Paired(step),
                    std::cmp::Ordering::Equal => Outcome::DroppedFrame,
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
}
