//! What exposures show of their own pattern.

use glam::Vec4;

use super::Radiometry;
use super::lag::{Light, light};
use crate::assemble::merge::{by_lane, lanes};
use crate::instrument::calibration::stray::{ByBand, Removal, Told};

/// What the exposures of a pattern show of it alone, [exposure, pixel, channel].
#[derive(Default)]
pub(in super::super) struct Shown {
    /// Numbers as a linear camera would give them; NaN where they saturated.
    pub(super) linear: Vec<f32>,
    /// How uncertain they are by the pattern before; nothing if none is left of it.
    left: Vec<f32>,
    /// What the pattern before showed in the first exposure time.
    before: Vec<Light>,
}

impl Shown {
    /// Of the `frames` of exposures as in `radiometry`, each after the frames of the pattern `before` it, if that is known.
    pub(super) fn learn(&mut self, frames: &[u16], before: &[Option<&[u16]>], radiometry: &[Radiometry]) {
        let numbers = &radiometry[0].numbers;
        self.linear.clear();
        self.linear
            .extend(frames.iter().map(|dn| numbers.unsaturated(*dn)));
        self.left.clear();
        if radiometry.iter().all(|one| one.lag.is_none()) {
            return;
        }
        self.left.resize(frames.len(), 0.0);
        let times: Vec<f32> = radiometry
            .iter()
            .map(|one| (one.exposure_s / radiometry[0].exposure_s) as f32)
            .collect();
        let values = radiometry[0].dark.len();
        let each = self
            .linear
            .chunks_exact_mut(values)
            .zip(self.left.chunks_exact_mut(values));
        for (exposure, ((linear, left), one)) in each.zip(radiometry).enumerate() {
            if one.lag.is_none() {
                continue;
            }
            let frames = before.get(exposure).copied().flatten();
            if let Some(frames) = frames {
                light(numbers, frames, &times, exposure, &mut self.before);
            }
            let nothing = if one.unwatched.is_empty() {
                &one.dark
            } else {
                &one.unwatched
            };
            // What saturated was as bright as that, or brighter.
            let saturated = if one.lag.most() * numbers.range() > one.dark_variance.sqrt() {
                f32::NAN
            } else {
                numbers.level + numbers.range()
            };
            for (value, (dn, left)) in linear.iter_mut().zip(left).enumerate() {
                // Before the first pattern nothing is shown, not even what watches the lamp.
                let before = match frames {
                    Some(_) if self.before[value].dn.is_nan() => saturated,
                    Some(_) => numbers.level + self.before[value].dn * times[exposure],
                    None => nothing[value],
                };
                *dn = one.lag.clear(*dn, before);
                // A wrong share is wrong in the black frames too.
                let of_dark = one.dark[value] - one.before[value];
                *left = one.lag.doubt(*dn - before - of_dark);
            }
        }
    }

    /// How uncertain `pixel` is by the pattern before in this `exposure`, the channels in the lanes, of so many `values` each.
    pub(super) fn left<const CHANNELS: usize>(&self, exposure: usize, pixel: usize, values: usize) -> Vec4 {
        if self.left.is_empty() {
            return Vec4::ZERO;
        }
        lanes::<CHANNELS, f32>(&self.left[exposure * values + pixel * CHANNELS..])
    }

    /// The same of what was merged, as in the first exposure, of which these exposures count most and have such `shares` of their light in
    /// the first.
    pub(super) fn left_of_merged<const CHANNELS: usize>(
        &self,
        heaviest: [u8; 4],
        pixel: usize,
        shares: &[f32],
    ) -> Vec4 {
        let values = self.left.len() / shares.len();
        by_lane(heaviest, |exposure, lane| {
            let at = exposure * values + pixel * CHANNELS + lane;
            let left = self.left.get(at).filter(|_| lane < CHANNELS);
            left.map_or(0.0, |left| left * shares[exposure])
        })
    }

    /// What the uncertainty by the pattern before would tell of the lamp in this `exposure`, which is as in `one`; nothing if nothing is left
    /// of it.
    pub(super) fn lamp_by_left<const CHANNELS: usize>(
        &self,
        exposure: usize,
        removal: &Removal,
        one: &Radiometry,
    ) -> ByBand<Option<Told>> {
        if self.left.is_empty() {
            return Default::default();
        }
        removal.told(
            |pixel| self.left::<CHANNELS>(exposure, pixel, one.dark.len()),
            |pixel| one.black_light::<CHANNELS>(pixel),
            |_| Vec4::ZERO,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::lag::Lag;
    use super::super::of_black;
    use super::*;
    use crate::instrument::rig::Rig;
    use crate::store::{ExposureRecord, Segment};

    #[test]
    fn each_channel_is_as_uncertain_as_in_the_exposure_that_counts_most() {
        let rig = Rig::load("rcg-1-16bit").unwrap();
        let radiometry = [1e-3, 4e-3].map(|exposure_s| {
            let record = ExposureRecord {
                incident: -1,
                exposure_s,
                ..ExposureRecord::default()
            };
            let black = Segment {
                frames: vec![300; 3],
                records: vec![record],
                ..Segment::default()
            };
            let mut one = of_black(&rig, None, &black, exposure_s, 3).unwrap();
            (one.lag, one.before) = (Lag::of(0.01, [0.0; 2]), one.dark.clone());
            one
        });
        let mut shown = Shown::default();
        let full = u16::MAX;
        let left = |shown: &mut Shown, frames: [u16; 6]| {
            let before = [1300; 6];
            shown.learn(&frames, &[Some(&before), Some(&before)], &radiometry);
            shown
                .left_of_merged::<3>([1, u8::from(frames[4] != full), 1, 0], 0, &[1.0, 0.25])
                .to_array()
        };
        let whole = left(&mut shown, [10_300, 10_300, 10_300, 40_300, 40_300, 40_300]);
        let saturated = left(&mut shown, [10_300, 10_300, 10_300, 40_300, full, 40_300]);
        for (whole, saturated) in whole.into_iter().zip(saturated).take(3) {
            assert!(
                (60.0..120.0).contains(&saturated) && (saturated / whole - 1.0).abs() < 0.2,
                "{whole} {saturated}"
            );
        }
    }
}
