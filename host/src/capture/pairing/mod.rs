//! Which frame belongs to which trigger.
//!
//! # Design
//! A frame belongs to a trigger because its time-stamp falls on the strobe of that trigger, never because
//! it arrived next. Controller and camera have clocks of their own: the first frame whose number points at a
//! known strobe gives the offset, the following ones correct it, so that slow drift does no harm. The
//! frame's number must tell the same story; where it does not, the frame is disputed and not used. What is
//! missing, late, doubled or unexplained is a value; the caller measures again.
//!
//! Where strobes come at equal distances, times alone do not tell a run from the same run moved by one, and numbers do only as far as the
//! camera really began to count with the run. So the frames of a run count together or not at all: where one contradicts, or is left over and
//! nothing explains it (`is_explained`), or where all would stand on other strobes just as well (`may_be_moved`), all are disputed.

use std::collections::BTreeSet;

use rcg_protocol::{StepFlags, StepRecord, Strobe};

use crate::capture::camera::Frame;

mod sure;

use sure::{Unknown, is_explained, may_be_moved};

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
/// are as the controller sent them; `tick_s` is the length of a tick and `steps` their number.
#[must_use]
pub fn pair(
    steps: usize,
    records: &[StepRecord],
    spurious_on: &[u64],
    frames: &[Frame],
    tick_s: f64,
) -> Pairing {
    let (outcomes, exposures) = strobes(steps, records, tick_s);
    let spurious_on: BTreeSet<u64> = spurious_on.iter().copied().collect();
    let spurious_s: Vec<f64> = spurious_on.iter().map(|&on| on as f64 * tick_s).collect();
    let mut pairing = Pairing {
        outcomes,
        orphans: Vec::new(),
        duplicates: 0,
    };
    // Frames may overtake each other on their way.
    let mut in_time: Vec<usize> = (0..frames.len()).collect();
    in_time.sort_by(|&one, &other| frames[one].timestamp_s.total_cmp(&frames[other].timestamp_s));
    let first = first_offset(&pairing.outcomes, &exposures, &spurious_s, (frames, &in_time));
    let Some(mut offset_s) = first else {
        pairing.orphans = (0..frames.len()).collect();
        return pairing;
    };
    // Half of the smallest distance between strobes separates them; a quarter leaves room for doubt.
    let tolerance_s = apart_s(&exposures) / 4.0;
    let mut numbers = Numbers::new(&pairing.outcomes, spurious_s.clone());
    let mut last: Option<&Frame> = None;
    let mut contradicts = false;
    // Of the frames that no strobe explains, when they began on the controller's clock.
    let mut left_s = Vec::new();
    for index in in_time {
        let frame = &frames[index];
        match last {
            Some(last)
                if last.id == frame.id && last.timestamp_s.to_bits() == frame.timestamp_s.to_bits() =>
            {
                pairing.duplicates += 1;
                continue;
            }
            Some(last) => contradicts |= frame.id <= last.id,
            None => {}
        }
        last = Some(frame);
        let on_s = frame.timestamp_s - offset_s;
        let near = nearest(&exposures, on_s).filter(|(_, near)| (on_s - near.on_s).abs() <= tolerance_s);
        let Some((ordinal, exposure)) = near else {
            pairing.orphans.push(index);
            left_s.push(on_s);
            continue;
        };
        offset_s += (on_s - exposure.on_s) / 8.0; // follows drift, ignores jitter
        let numbered = numbers.agree(frame.id, ordinal, exposure);
        contradicts |= !numbered;
        let outcome = &mut pairing.outcomes[exposure.step];
        *outcome = match *outcome {
            Outcome::DroppedFrame if numbered => Outcome::Paired(index),
            _ => Outcome::Disputed,
        };
    }
    pairing.orphans.sort_unstable();
    let unknown = Unknown::of(&pairing.outcomes, &exposures);
    if contradicts
        || !is_explained(&left_s, &spurious_s, &exposures, &unknown, tolerance_s)
        || may_be_moved(&pairing.outcomes, &exposures, &unknown, tolerance_s)
    {
        for outcome in &mut pairing.outcomes {
            if matches!(outcome, Outcome::Paired(_)) {
                *outcome = Outcome::Disputed;
            }
        }
    }
    pairing
}

/// The smallest distance between two strobes, s; without end where there is one.
fn apart_s(exposures: &[Exposure]) -> f64 {
    let pairs = exposures.windows(2);
    pairs
        .map(|pair| pair[1].on_s - pair[0].on_s)
        .fold(f64::INFINITY, f64::min)
}

/// What the records say of each of the `steps`, before any frame is looked at, and the strobes that they tell of, in order. A record that
/// came twice counts once.
fn strobes(steps: usize, records: &[StepRecord], tick_s: f64) -> (Vec<Outcome>, Vec<Exposure>) {
    let mut outcomes = vec![Outcome::NoRecord; steps];
    let mut exposures = Vec::with_capacity(records.len());
    for record in records {
        let place = outcomes.get_mut(record.step.0 as usize);
        let Some(outcome) = place.filter(|outcome| **outcome == Outcome::NoRecord) else {
            continue;
        };
        *outcome = match record.strobe {
            None => Outcome::MissedTrigger,
            Some(Strobe { delay, .. }) => {
                exposures.push(Exposure {
                    step: record.step.0 as usize,
                    on_s: (record.trigger + delay).0 as f64 * tick_s,
                });
                let unclean = StepFlags::DOUBLE.0 | StepFlags::OVERRUN.0;
                if record.flags.0 & unclean == 0 {
                    Outcome::DroppedFrame
                } else {
                    Outcome::Disputed
                }
            }
        };
    }
    exposures.sort_by_key(|exposure| exposure.step);
    let apart_s = apart_s(&exposures);
    let mut delays: Vec<u64> = records
        .iter()
        .filter_map(|record| Some(record.strobe?.delay.0))
        .collect();
    delays.sort_unstable();
    if delays.len() >= 3 {
        // What begins at another time behind its trigger than the others is of none: the camera ignored that and exposed by itself.
        let median = delays[delays.len() / 2];
        for record in records {
            let place = outcomes.get_mut(record.step.0 as usize);
            if let Some((outcome, strobe)) = place.zip(record.strobe)
                && strobe.delay.0.abs_diff(median) as f64 * tick_s > apart_s / 4.0
            {
                *outcome = Outcome::Disputed;
            }
        }
    }
    (outcomes, exposures)
}

/// The numbers that frames must have: they count strobes, those that are not known too.
struct Numbers {
    /// Of each step, how many before it have no record.
    unknown_before: Vec<u64>,
    spurious_s: Vec<f64>,
    /// By how much the last frame that agreed was ahead of the strobes that are known, and how many were unknown before it.
    ahead: u64,
    unknown: u64,
}

impl Numbers {
    fn new(outcomes: &[Outcome], spurious_s: Vec<f64>) -> Self {
        let mut unknown = 0;
        let unknown_before = outcomes.iter().map(|outcome| {
            let before = unknown;
            unknown += u64::from(*outcome == Outcome::NoRecord);
            before
        });
        Self {
            unknown_before: unknown_before.collect(),
            spurious_s,
            ahead: 0,
            unknown: 0,
        }
    }

    /// Whether a frame of number `id` may be that of the `exposure` of this `ordinal` among those that are known: between it and the last
    /// one that was, each step without a record has a strobe or none.
    fn agree(&mut self, id: u64, ordinal: usize, exposure: &Exposure) -> bool {
        let spurious = self.spurious_s.iter().filter(|&&on_s| on_s < exposure.on_s);
        let unknown = self.unknown_before[exposure.step];
        let Some(ahead) = id.checked_sub((ordinal + spurious.count()) as u64) else {
            return false;
        };
        let may_be = self.ahead..=self.ahead + unknown.saturating_sub(self.unknown);
        if may_be.contains(&ahead) {
            (self.ahead, self.unknown) = (ahead, unknown);
            return true;
        }
        false
    }
}

/// Camera clock minus controller clock, from the first frame whose number points at a strobe that is known:
/// all steps before it must have their records.
fn first_offset(
    outcomes: &[Outcome],
    exposures: &[Exposure],
    spurious_s: &[f64],
    (frames, in_time): (&[Frame], &[usize]),
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
    in_time.iter().find_map(|&index| {
        let frame = &frames[index];
        Some(frame.timestamp_s - all.get(frame.id as usize)?)
    })
}

fn nearest(exposures: &[Exposure], on_s: f64) -> Option<(usize, &Exposure)> {
    let after = exposures.partition_point(|exposure| exposure.on_s < on_s);
    let candidates = after.saturating_sub(1)..(after + 1).min(exposures.len());
    candidates
        .map(|ordinal| (ordinal, &exposures[ordinal]))
        .min_by(|a, b| (a.1.on_s - on_s).abs().total_cmp(&(b.1.on_s - on_s).abs()))
}

#[cfg(test)]
mod tests;
