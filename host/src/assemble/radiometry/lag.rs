//! What exposures still show of the pattern before.
//!
//! # Design
//! An exposure of a share s of the pattern before and 1 − s of its own shows F = (1 − s)·X + s·Y, so that
//!
//! X = F + s/(1 − s)·(F − Y)
//!
//! Y is what the pattern before showed, for as long. Shares are those of each exposure time of a pattern, whatever the law by which
//! light fades; black patterns behind lit ones tell them (`black`), beside what is usual of panels.

use crate::assemble::radiometry::numbers::Numbers;
use crate::instrument::rig::{Panel, Rig};
use crate::plan::schedule::Timing;
use crate::store::{ExposureRecord, Segment};

/// Share of a change of light that is left when a pattern counts as settled, as good as a standard deviation: rigs that hurry have
/// twice as much.
const USUAL: f64 = 0.01;
/// By how much slower the last of it fades than the first.
const SLOWER: f64 = 2.0;
/// Shares below are none.
const NONE: f64 = 1e-7;
/// The least uncertainty of a share, relative: light need not come as it goes.
const LEAST: f32 = 0.2;

/// Share of the pattern before in exposures of one time, and its standard uncertainty (k = 1).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in super::super) struct Lag {
    share: f32,
    uncertainty: f32,
}

impl Lag {
    /// What is known of a share that is usually as large as `usual`, by an estimate from elsewhere: Σ estimate/variance and
    /// Σ 1/variance.
    pub(super) fn of(usual: f64, [sum, weight]: [f64; 2]) -> Self {
        if usual <= 0.0 {
            return Self::default();
        }
        let weight = weight + usual.powi(-2);
        let share = (sum / weight).max(0.0) as f32;
        Self {
            share,
            uncertainty: (weight.sqrt().recip() as f32).hypot(LEAST * share),
        }
    }

    /// Whether nothing can be left.
    #[inline]
    pub(super) const fn is_none(self) -> bool {
        self.uncertainty <= 0.0
    }

    /// As much as may be left.
    pub(super) const fn most(self) -> f32 {
        self.share + self.uncertainty
    }

    /// What a number would be without the pattern before, which showed `before`.
    #[inline]
    pub(super) fn clear(self, dn: f32, before: f32) -> f32 {
        dn + self.share / (1.0 - self.share) * (dn - before)
    }

    /// How uncertain numbers are that differ by so `much` from those of the pattern before.
    #[inline]
    pub(super) const fn doubt(self, much: f32) -> f32 {
        self.uncertainty * much.abs()
    }
}

/// How much of the pattern before is usually in each of the exposures of a pattern of `timings` on `rig`, as good as a standard
/// deviation; 0 where nothing can be.
pub(in super::super) fn usual(rig: &Rig, timings: &[Timing]) -> Vec<f64> {
    let settle_s = rig.projector.settle_s;
    let constant_s = SLOWER * settle_s / -USUAL.ln();
    let mut step_s = 0.0;
    let of = |timing: &Timing| {
        let from_s = step_s + timing.cam_at_s + rig.camera.exposure_delay_s - settle_s;
        step_s += timing.period_s;
        let left = |at_s: f64| (-at_s.max(0.0) / constant_s).exp();
        let fading_s = constant_s * (left(from_s) - left(from_s + timing.cam_width_s));
        USUAL * fading_s / timing.cam_width_s
    };
    let shares = timings.iter().map(of);
    let is_any = rig.projector.panel == Panel::LiquidCrystal && settle_s > 0.0;
    let some = |share: f64| if is_any && share > NONE { share } else { 0.0 };
    shares.map(some).collect()
}

/// For each exposure of the pattern whose first one has this `place` in `segment`, what [`before_one`] says.
pub(in super::super) fn before(
    segment: &Segment,
    place: usize,
    (brackets, values): (usize, usize),
) -> Vec<Option<&[u16]>> {
    let exposures = place..place + brackets;
    exposures
        .map(|exposure| before_one(segment, exposure, (brackets, values)))
        .collect()
}

/// The frames, of so many `values` each, of the pattern that was shown before the exposure at this `place` in `segment`, of so many
/// exposures a pattern; `None` if nothing was.
pub(super) fn before_one(
    segment: &Segment,
    place: usize,
    (brackets, values): (usize, usize),
) -> Option<&[u16]> {
    let pattern = shown_before(&segment.records, brackets, place)?;
    Some(&segment.frames[pattern * brackets * values..][..brackets * values])
}

/// Number in a segment of the pattern that was shown before the exposure at this `place`. What failed was taken again by itself, in
/// the same order.
fn shown_before(records: &[ExposureRecord], brackets: usize, place: usize) -> Option<usize> {
    let attempts = records[place].attempts;
    let was_shown = |pattern: &usize| {
        let exposures = &records[pattern * brackets..][..brackets];
        exposures.iter().any(|record| record.attempts >= attempts)
    };
    (0..place / brackets).rev().find(was_shown)
}

/// What a pattern shows in a time of 1, as a linear camera would give it above the dark level, and the variance of that by noise; NaN where
/// it saturated.
#[derive(Clone, Copy, Debug)]
pub(super) struct Light {
    pub(super) dn: f32,
    pub(super) variance: f32,
}

/// What the `frames` of a pattern, of these relative times, show of what is left in its `exposure`: by the frame of that, so that the
/// lamp is the same in all of the image, as far as it is linear, else by the longest that is, else by the shortest, if that is not saturated.
/// What is left is little, whatever the camera bends.
pub(super) fn light(
    numbers: &Numbers,
    frames: &[u16],
    times: &[f32],
    exposure: usize,
    light: &mut Vec<Light>,
) {
    let values = frames.len() / times.len();
    light.clear();
    light.extend((0..values).map(|value| {
        let linear = std::iter::once(exposure)
            .chain((0..times.len()).rev())
            .map(|exposure| (frames[exposure * values + value], times[exposure]))
            .find(|(dn, _)| *dn < numbers.trusted);
        let shortest = (frames[value], times[0]);
        let of = linear.or(Some(shortest).filter(|(dn, _)| *dn < numbers.saturation));
        of.map_or(
            Light {
                dn: f32::NAN,
                variance: f32::NAN,
            },
            |(dn, time)| {
                let dn = numbers.linear(dn) - numbers.level;
                Light {
                    dn: dn / time,
                    variance: numbers.noise_variance(dn) / (time * time),
                }
            },
        )
    }));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::schedule::PATIENCE;

    #[test]
    fn what_is_left_of_the_pattern_before_is_taken_away_and_the_own_made_whole() {
        let lag = Lag::of(0.01, [0.02 / 1e-8, 1e8]);
        let (own, before) = (100.0, 3000.0);
        let clear = lag.clear(0.98 * own + 0.02 * before, before);
        let doubt = lag.doubt(clear - before);
        assert!((clear - own).abs() < 0.01, "{clear}");
        // A fifth of what was taken away.
        assert!(
            (doubt / (0.2 * 0.02 * (before - own)) - 1.0).abs() < 0.01,
            "{doubt}"
        );
        // Where nothing tells it, it is as uncertain as it usually is large.
        let unknown = Lag::of(0.01, [0.0; 2]);
        assert_eq!(unknown.clear(own, before).to_bits(), own.to_bits());
        assert!((unknown.doubt(own - before) - 29.0).abs() < 1e-3);
        assert!(Lag::of(0.0, [5.0, 100.0]).is_none());
    }

    #[test]
    fn the_first_exposure_of_a_pattern_shows_the_most_and_mirrors_none() {
        let mut rig = Rig::load("rcg-3").unwrap();
        let timings = Timing::series(&rig, &[1e-3, 4e-3, 12e-3]).unwrap();
        let shares = usual(&rig, &timings);
        assert!(
            shares[0] > 30.0 * shares[1] && shares[1] >= shares[2],
            "{shares:?}"
        );
        assert!(shares[0] < USUAL && shares[0] > USUAL / 3.0);
        // Who waits longer sees less.
        let [hasty, patient] =
            [Timing::new, Timing::patient].map(|of| usual(&rig, &[of(&rig, 1e-3).unwrap()])[0]);
        assert!(
            (patient / hasty / USUAL.powf((PATIENCE - 1.0) / SLOWER) - 1.0).abs() < 1e-6,
            "{hasty} {patient}"
        );
        rig.projector.panel = Panel::Mirrors;
        assert_eq!(usual(&rig, &timings), [0.0; 3]);
    }

    #[test]
    fn before_what_was_taken_again_stands_what_was_taken_again() {
        // Of four patterns of two exposures the second one of pattern 1 and both of pattern 3 were taken again.
        let attempts = [1, 1, 1, 2, 1, 1, 2, 3];
        let records: Vec<ExposureRecord> = attempts
            .iter()
            .map(|attempts| ExposureRecord {
                attempts: *attempts,
                ..ExposureRecord::default()
            })
            .collect();
        let found: Vec<Option<usize>> = (0..8).map(|place| shown_before(&records, 2, place)).collect();
        assert_eq!(
            found,
            [None, None, Some(0), None, Some(1), Some(1), Some(1), None]
        );
        let segment = Segment {
            frames: (0..8).collect(),
            records,
            ..Segment::default()
        };
        assert_eq!(before(&segment, 6, (2, 1)), [Some([2, 3].as_slice()), None]);
    }
}
