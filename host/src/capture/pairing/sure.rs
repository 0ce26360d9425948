//! Whether a run can have been another than its frames say.

use super::{Exposure, Outcome};

/// Steps without a record: before the first strobe that is known, behind the last one, and in each gap between two.
pub(super) struct Unknown {
    before: usize,
    behind: usize,
    /// Behind each strobe but the last.
    between: Vec<usize>,
}

impl Unknown {
    pub(super) fn of(outcomes: &[Outcome], exposures: &[Exposure]) -> Self {
        let count = |steps: std::ops::Range<usize>| {
            let steps = outcomes.get(steps).unwrap_or_default();
            steps
                .iter()
                .filter(|outcome| **outcome == Outcome::NoRecord)
                .count()
        };
        let first = exposures.first().map_or(0, |first| first.step);
        let last = exposures.last().map_or(0, |last| last.step + 1);
        let gaps = exposures.windows(2);
        Self {
            before: count(0..first),
            behind: count(last..outcomes.len()),
            between: gaps.map(|pair| count(pair[0].step..pair[1].step)).collect(),
        }
    }
}

/// Whether each of the frames that are left over, which began at `left_s`, is that of a spurious strobe, or of one of the steps without a
/// record that may have been then.
pub(super) fn is_explained(
    left_s: &[f64],
    spurious_s: &[f64],
    exposures: &[Exposure],
    unknown: &Unknown,
    tolerance_s: f64,
) -> bool {
    let (mut before, mut behind, mut between) = (unknown.before, unknown.behind, unknown.between.clone());
    left_s.iter().all(|&on_s| {
        if spurious_s
            .iter()
            .any(|spurious_s| (spurious_s - on_s).abs() <= tolerance_s)
        {
            return true;
        }
        let after = exposures.partition_point(|exposure| exposure.on_s < on_s);
        let room = match after {
            0 => &mut before,
            after if after == exposures.len() => &mut behind,
            after => &mut between[after - 1],
        };
        let has_room = *room > 0;
        *room = room.saturating_sub(1);
        has_room
    })
}

/// Whether all frames that are paired would fit as well on the strobes that are so many before or behind theirs; a step without a record at
/// either end may have been one.
pub(super) fn may_be_moved(
    outcomes: &[Outcome],
    exposures: &[Exposure],
    unknown: &Unknown,
    tolerance_s: f64,
) -> bool {
    let is_paired = |exposure: &Exposure| matches!(outcomes[exposure.step], Outcome::Paired(_));
    let paired: Vec<usize> = (0..exposures.len())
        .filter(|&ordinal| is_paired(&exposures[ordinal]))
        .collect();
    let (Some(&first), Some(&last)) = (paired.first(), paired.last()) else {
        return false;
    };
    let fits = |by: isize| {
        let mut moved_s = None;
        paired.iter().all(|&ordinal| {
            let other = ordinal
                .checked_add_signed(by)
                .and_then(|other| exposures.get(other));
            let Some(other) = other else { return true };
            let apart_s = other.on_s - exposures[ordinal].on_s;
            (apart_s - *moved_s.get_or_insert(apart_s)).abs() <= tolerance_s
        })
    };
    let earlier = first + unknown.before;
    let later = exposures.len() - 1 - last + unknown.behind;
    (1..=earlier as isize).any(|by| fits(-by)) || (1..=later as isize).any(fits)
}
