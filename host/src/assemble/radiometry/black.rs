//! Black frames: what a measurement shows where nothing is lit, what watches the lamp, and how the camera's offset drifts.
//!
//! # Design
//! They stand among the lit ones and are read once, segment by segment. A frame with the lamp watched shows
//!
//! y = o + c·b
//!
//! more than the first one of its exposure time, b being the light of that: the offset is o off, in all pixels alike, and the
//! lamp c brighter. Least squares with the weights of noise tell both; o is the same for all exposures of a pattern. In between it
//! is interpolated linearly, beyond which offsets wander with the square of the time from one black pattern to the next.
//!
//! Frames that differ by what watches the lamp alone tell how bright it was, whatever the offset and the sample are.

use std::collections::BTreeMap;

use super::Radiometry;
use super::numbers::Numbers;
use crate::instrument::calibration::stray::{WANDER_S, offset_dn};
use crate::instrument::calibration::{CameraFound, LampFound};
use crate::instrument::rig::Rig;
use crate::plan::{Exposure, Plan};
use crate::store::Segment;

/// By how much the camera's offset is another than in the mean of the black frames, digital numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in super::super) struct Offset {
    pub(in super::super) dn: f32,
    /// Standard uncertainty (k = 1).
    pub(in super::super) uncertainty: f32,
}

/// The camera's offset over a measurement.
pub(in super::super) struct Drift {
    /// At black patterns: number of the pattern, offset and its variance, ascending. Nothing where they tell nothing of the others.
    at: Vec<(usize, f32, f32)>,
    /// Exposures of a pattern.
    brackets: usize,
    /// Variance of what it wanders in between.
    between: f32,
}

impl Drift {
    /// In the exposure of this number, from the start of the measurement.
    pub(in super::super) fn of(&self, exposure: usize) -> Offset {
        let pattern = exposure / self.brackets;
        let after = self.at.partition_point(|at| at.0 < pattern);
        let (Some(after), Some(before)) = (
            self.at.get(after).or(self.at.last()),
            self.at.get(after.saturating_sub(1)),
        ) else {
            return Offset {
                dn: 0.0,
                uncertainty: self.between.sqrt(),
            };
        };
        let span = after.0.saturating_sub(before.0).max(1) as f32;
        let share = (pattern.saturating_sub(before.0) as f32 / span).min(1.0);
        // When between two it changed nobody knows: there may be a pause.
        let step = after.1 - before.1;
        let noise = before.2 * (1.0 - share).powi(2) + after.2 * share.powi(2);
        Offset {
            dn: before.1 + step * share,
            uncertainty: (noise + step * step / 12.0 + self.between).sqrt(),
        }
    }
}

/// Mean of frames.
#[derive(Default)]
struct Mean {
    sum: Vec<f64>,
    count: usize,
}

impl Mean {
    fn add(&mut self, frame: &[f32]) {
        self.sum.resize(frame.len(), 0.0);
        self.count += 1;
        for (sum, dn) in self.sum.iter_mut().zip(frame) {
            *sum += f64::from(*dn);
        }
    }

    fn get(&self) -> Vec<f32> {
        let count = self.count as f64;
        self.sum.iter().map(|sum| (sum / count) as f32).collect()
    }
}

/// Black frames of one exposure time.
struct OfTime {
    exposure_s: f64,
    black: Mean,
    unwatched: Mean,
    /// The first of them, linear.
    first: Vec<f32>,
}

/// The black frames of a measurement.
pub(in super::super) struct BlackFrames {
    numbers: Numbers,
    rows: usize,
    /// Variance of the lamp's light from one black frame to another, relative; `None` if nobody knows it.
    lamp_variance: Option<f64>,
    of_each: Vec<OfTime>,
    /// Of each pattern: Σ o/σ² and Σ 1/σ² over its exposures; o beside the first pattern.
    offsets: BTreeMap<usize, [f64; 2]>,
}

impl BlackFrames {
    /// For exposures of `exposures_s` seconds of each pattern, of the camera of `rig`; `camera` and `lamp` are what calibration found,
    /// if it did. Without them nothing is said of drifts.
    pub(in super::super) fn new(
        rig: &Rig,
        (camera, lamp): (Option<&CameraFound>, Option<&LampFound>),
        exposures_s: &[f64],
    ) -> Self {
        let of = |exposure_s: &f64| OfTime {
            exposure_s: *exposure_s,
            black: Mean::default(),
            unwatched: Mean::default(),
            first: Vec::new(),
        };
        Self {
            numbers: Numbers::new(rig, camera),
            rows: rig.frame_format().height_px,
            lamp_variance: lamp.map(|lamp| 2.0 * lamp.prior_variance()),
            of_each: exposures_s.iter().map(of).collect(),
            offsets: BTreeMap::new(),
        }
    }

    /// Adds the black ones of the exposures of `segment`, the first of which has this number; each has so many `values`.
    pub(in super::super) fn add(&mut self, first: usize, segment: &Segment, values: usize) {
        let brackets = self.of_each.len();
        let frames = segment.records.iter().zip(segment.frames.chunks_exact(values));
        for (exposure, (record, frame)) in (first..).zip(frames) {
            let is = |exposure: Exposure| record.incident == exposure.code();
            let is_of = |one: &&mut OfTime| one.exposure_s.total_cmp(&record.exposure_s).is_eq();
            let Some(of) = self.of_each.iter_mut().find(is_of) else {
                continue;
            };
            let linear = || -> Vec<f32> { frame.iter().map(|dn| self.numbers.linear(*dn)).collect() };
            if is(Exposure::Unwatched) {
                of.unwatched.add(&linear());
            } else if is(Exposure::Black) {
                let linear = linear();
                of.black.add(&linear);
                let Some(lamp_variance) = self.lamp_variance else {
                    continue;
                };
                let [sum, weight] = self.offsets.entry(exposure / brackets).or_default();
                if of.first.is_empty() {
                    of.first = linear;
                    continue;
                }
                let camera = (&self.numbers, self.rows);
                if let Some((offset, variance)) = beside(&linear, &of.first, camera, lamp_variance) {
                    *sum += offset / variance;
                    *weight += variance.recip();
                }
            }
        }
    }

    /// What they say of each exposure time, and of the whole measurement by `plan` on `rig`.
    ///
    /// # Errors
    /// A sentence if there are none of an exposure time.
    pub(in super::super) fn finish(self, rig: &Rig, plan: &Plan) -> Result<(Vec<Radiometry>, Drift), String> {
        let drift = self.drift(rig, plan);
        Ok((self.radiometry()?, drift))
    }

    /// What they say of each exposure time.
    pub(super) fn radiometry(self) -> Result<Vec<Radiometry>, String> {
        let numbers = &self.numbers;
        let of = |of: OfTime| {
            if of.black.count == 0 {
                return Err(format!(
                    "expected black exposures of {} ms, found none",
                    of.exposure_s * 1e3
                ));
            }
            let means = 1.0 + 1.0 / of.black.count as f32;
            Ok(Radiometry {
                exposure_s: of.exposure_s,
                dark: of.black.get(),
                unwatched: of.unwatched.get(),
                counts: [of.black.count, of.unwatched.count],
                means,
                dark_variance: numbers.read_variance * means,
                row_variance: numbers.row_variance * means,
                numbers: numbers.clone(),
            })
        };
        self.of_each.into_iter().map(of).collect()
    }

    /// The offset over the whole measurement.
    fn drift(&self, rig: &Rig, plan: &Plan) -> Drift {
        let wander_dn = self.lamp_variance.map_or(0.0, |_| offset_dn(rig));
        let time = plan.between_black_s() / WANDER_S;
        if plan.black_first {
            return Drift {
                at: Vec::new(),
                brackets: plan.brackets(),
                between: (wander_dn * (time / 3.0_f64.sqrt()).min(1.0)).powi(2) as f32,
            };
        }
        let each = |[sum, weight]: &[f64; 2]| if *weight > 0.0 { sum / weight } else { 0.0 };
        let count = self.offsets.len().max(1) as f64;
        let mean = self.offsets.values().map(each).sum::<f64>() / count;
        // The first one, beside which the others are, is as noisy as they; steps of the converter that noise leaves all share.
        let weight = self.offsets.values().map(|sums| sums[1]).sum::<f64>() / count;
        let steps_dn = rig.camera.binned.common_e() / rig.gain_e_per_dn();
        let variance = weight.max(f64::MIN_POSITIVE).recip() + steps_dn.powi(2);
        let trust = wander_dn.powi(2) / (wander_dn.powi(2) + variance);
        let node = |(pattern, sums): (&usize, &[f64; 2])| {
            let offset = trust * (each(sums) - mean);
            (*pattern, offset as f32, (trust * variance) as f32)
        };
        Drift {
            at: self.offsets.iter().map(node).collect(),
            brackets: plan.brackets(),
            between: (wander_dn * (time * time).min(1.0)).powi(2) as f32,
        }
    }
}

/// By how much the offset of the black `frame` is higher than that of the `first`, and the variance of that; both have so many rows,
/// and the lamp is brighter with this relative variance. `None` if all is saturated.
fn beside(
    frame: &[f32],
    first: &[f32],
    (numbers, rows): (&Numbers, usize),
    lamp_variance: f64,
) -> Option<(f64, f64)> {
    let full = numbers.linear(numbers.trusted);
    let [mut w, mut wb, mut wbb, mut wy, mut wby] = [0.0, 0.0, lamp_variance.recip(), 0.0, 0.0];
    for (dn, before) in frame
        .iter()
        .zip(first)
        .filter(|(dn, before)| dn.max(**before) < full)
    {
        let (light, more) = (f64::from(before - numbers.level), f64::from(dn - before));
        let noise = f64::from(numbers.read_variance) + light.max(0.0) * f64::from(numbers.shot_per_dn);
        let weight = (2.0 * noise).recip();
        w += weight;
        wb += weight * light;
        wbb += weight * light * light;
        wy += weight * more;
        wby += weight * light * more;
    }
    let determinant = w * wbb - wb * wb;
    (determinant > 0.0).then(|| {
        (
            (wbb * wy - wb * wby) / determinant,
            wbb / determinant + 2.0 * f64::from(numbers.row_variance) / rows as f64,
        )
    })
}

/// What `black` frames of `values` numbers each say of their exposure time.
#[cfg(test)]
pub(in super::super) fn of_black(
    rig: &Rig,
    camera: Option<&CameraFound>,
    black: &Segment,
    exposure_s: f64,
    values: usize,
) -> Result<Radiometry, String> {
    let mut frames = BlackFrames::new(rig, (camera, None), &[exposure_s]);
    frames.add(0, black, values);
    frames.radiometry().map(|mut of_each| of_each.remove(0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::ExposureRecord;

    /// A measurement of `count` patterns with a black one at each of `black`, whose offset and lamp are as `of` says of the pattern.
    fn drift(black: &[usize], of: impl Fn(usize) -> [f64; 2]) -> Drift {
        let mut rig = Rig::load("rcg-3").unwrap().with_image_size(64).unwrap();
        rig.camera.dark_dn = 1000.0;
        let values = 4096;
        let lamp = LampFound {
            flicker: 0.005,
            monitor: None,
        };
        let mut frames = BlackFrames::new(&rig, (None, Some(&lamp)), &[0.01]);
        for pattern in black {
            let [offset, lamp] = of(*pattern);
            let light = |at: usize| 10.0 + 2000.0 * (at as f64 / values as f64).powi(2);
            let dn = |at: usize| (1000.0 + offset + lamp * light(at)).round() as u16;
            let segment = Segment {
                frames: (0..values).map(dn).collect(),
                records: vec![ExposureRecord {
                    incident: -1,
                    exposure_s: 0.01,
                    ..ExposureRecord::default()
                }],
                ..Segment::default()
            };
            frames.add(*pattern, &segment, values);
        }
        let request = crate::plan::Request::default();
        let plan = Plan::new(request, &rig, 0.01).unwrap();
        frames.finish(&rig, &plan).unwrap().1
    }

    #[test]
    fn the_offset_is_found_between_black_patterns_whatever_the_lamp_does() {
        let true_dn = |pattern: usize| 3.0 + 0.02 * pattern as f64;
        let lamp = |pattern: usize| 1.0 + 0.01 * (pattern as f64).sin();
        let found = drift(&[0, 40, 80, 120], |pattern| [true_dn(pattern), lamp(pattern)]);
        for pattern in [0, 13, 40, 77, 80, 119, 120, 150] {
            let offset = found.of(pattern);
            // Beside the mean of the black ones, which are in the middle at 60; as after the last one.
            let expected = true_dn(pattern.min(120)) - true_dn(60);
            let error = f64::from(offset.dn) - expected;
            assert!(error.abs() < 0.1, "{pattern}: {offset:?} for {expected}");
            assert!(
                error.abs() < 3.0 * f64::from(offset.uncertainty),
                "{pattern}: {offset:?}"
            );
        }
    }

    #[test]
    fn a_jump_somewhere_between_two_black_patterns_is_uncertain_by_as_much() {
        let found = drift(&[0, 40, 80, 120], |pattern| {
            [if pattern > 40 { 12.0 } else { 0.0 }, 1.0]
        });
        let [still, within] = [20, 60].map(|pattern| found.of(pattern).uncertainty);
        assert!(
            (within - still - 12.0 / 12.0_f32.sqrt()).abs() < 1.0,
            "{still} {within}"
        );
    }
}
