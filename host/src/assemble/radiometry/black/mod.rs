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
//! Behind a lit pattern a black one shows a share s of that, too, which least squares tell along: y = o + c·b + s·Y, Y being
//! by how much the pattern before was brighter than that before the first one (`lag`). It is the same in all of an exposure time, and taken out of their means.
//!
//! Frames that differ by what watches the lamp alone tell how bright it was, whatever the offset and the sample are.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};

use super::Radiometry;
use super::lag::{self, Lag};
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
    fn add(&mut self, frame: impl ExactSizeIterator<Item = f32>) {
        self.sum.resize(frame.len(), 0.0);
        self.count += 1;
        for (sum, dn) in self.sum.iter_mut().zip(frame) {
            *sum += f64::from(dn);
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
    /// How much of the pattern before is usually left, and what they tell of it: Σ s/σ² and Σ 1/σ².
    usual_lag: f64,
    told: [f64; 2],
    black: Means,
    unwatched: Means,
    /// The first of them.
    first: Vec<Seen>,
    /// By how much the lamp was brighter in each than in the first, and the variance of that, relative; of each band that is lit by itself.
    lamp: Vec<Vec<[f64; 2]>>,
}

/// Mean of frames, and of what the patterns before them showed.
#[derive(Default)]
struct Means {
    shown: Mean,
    /// Of those that had one.
    before: Mean,
}

impl Means {
    /// Adds a frame; what `saturated` before it was as bright as that, or brighter.
    fn add(&mut self, frame: &[Seen], has_before: bool, saturated: f32) {
        self.shown.add(frame.iter().map(|seen| seen.dn));
        if has_before {
            let before = |seen: &Seen| {
                if seen.before.is_nan() {
                    saturated
                } else {
                    seen.before
                }
            };
            self.before.add(frame.iter().map(before));
        }
    }

    /// What frames show of their own patterns, and what those before them did, if anything of that is left; before the first pattern
    /// `nothing` was shown.
    fn get(&self, lag: Lag, nothing: &[f32]) -> (Vec<f32>, Vec<f32>) {
        let shown = self.shown.get();
        if lag.is_none() {
            return (shown, Vec::new());
        }
        let count = self.shown.count as f64;
        let alone = count - self.before.count as f64;
        let own = |(value, dn): (usize, &f32)| {
            let nothing = nothing.get(value).copied().unwrap_or(*dn);
            let before = self.before.sum.get(value).copied().unwrap_or(0.0) + alone * f64::from(nothing);
            let before = (before / count) as f32;
            (lag.clear(*dn, before), before)
        };
        shown.iter().enumerate().map(own).unzip()
    }
}

/// A number of a black frame, linear, and what the pattern before showed, NaN where it saturated; the same if nothing was before.
#[derive(Clone, Copy)]
struct Seen {
    dn: f32,
    before: f32,
    /// Variance of that by noise.
    before_variance: f32,
}

/// What the black frames of a measurement say.
pub(in super::super) struct Black {
    /// Of each exposure time.
    pub(in super::super) radiometry: Vec<Radiometry>,
    pub(in super::super) drift: Drift,
    /// Variance by which the lamp differs from one frame to another, relative; `None` if they do not tell.
    pub(in super::super) lamp_variance: Option<f64>,
}

/// Black frames of one exposure time that tell how much the lamp changes.
const ENOUGH: f64 = 8.0;

/// The black frames of a measurement.
pub(in super::super) struct BlackFrames {
    numbers: Numbers,
    rows: usize,
    /// Bands of an image that are lit one after the other: the lamp is another in each, the camera's offset is not.
    bands: usize,
    /// Variance of the lamp's light from one black frame to another, relative; `None` if nobody knows it.
    lamp_variance: Option<f64>,
    of_each: Vec<OfTime>,
    /// Of each pattern: Σ o/σ² and Σ 1/σ² over its exposures; o beside the first pattern.
    offsets: BTreeMap<usize, [f64; 2]>,
}

impl BlackFrames {
    /// For exposures of these seconds of each pattern, of the camera of `rig`, with what is usually left in them of the pattern before;
    /// `camera` and `lamp` are what calibration found, if it did. Without them nothing is said of drifts.
    pub(in super::super) fn new(
        rig: &Rig,
        (camera, lamp): (Option<&CameraFound>, Option<&LampFound>),
        exposures: &[(f64, f64)],
    ) -> Self {
        let of = |(exposure_s, usual_lag): &(f64, f64)| OfTime {
            exposure_s: *exposure_s,
            usual_lag: if lamp.is_some() { *usual_lag } else { 0.0 },
            told: [0.0; 2],
            black: Means::default(),
            unwatched: Means::default(),
            first: Vec::new(),
            lamp: vec![Vec::new(); rig.shown_bands()],
        };
        Self {
            numbers: Numbers::new(rig, camera),
            rows: rig.frame_format().height_px,
            bands: rig.shown_bands(),
            lamp_variance: lamp.map(|lamp| 2.0 * lamp.prior_variance()),
            of_each: exposures.iter().map(of).collect(),
            offsets: BTreeMap::new(),
        }
    }

    /// Adds the black ones of the exposures of `segment`, the first of which has this number; each has so many `values`.
    pub(in super::super) fn add(&mut self, first: usize, segment: &Segment, values: usize) {
        let brackets = self.of_each.len();
        let times: Vec<f32> = self.of_each.iter().map(|of| of.exposure_s as f32).collect();
        let camera = (&self.numbers, self.rows);
        let saturated = self.numbers.linear(self.numbers.saturation);
        let frames = segment.frames.chunks_exact(values);
        for (place, (record, frame)) in segment.records.iter().zip(frames).enumerate() {
            let is = |exposure: Exposure| record.incident == exposure.code();
            let is_of = |one: &&mut OfTime| one.exposure_s.total_cmp(&record.exposure_s).is_eq();
            let Some(of) = self.of_each.iter_mut().find(is_of) else {
                continue;
            };
            if !is(Exposure::Black) && !is(Exposure::Unwatched) {
                continue;
            }
            let before = if of.usual_lag > 0.0 {
                lag::before_one(segment, place, (brackets, values))
            } else {
                None
            };
            let has_before = before.is_some();
            let frame = seen(
                &self.numbers,
                frame,
                before.map(|frames| (frames, times.as_slice())),
                place % brackets,
            );
            if is(Exposure::Unwatched) {
                of.unwatched.add(&frame, has_before, saturated);
                continue;
            }
            of.black.add(&frame, has_before, saturated);
            let Some(lamp_variance) = self.lamp_variance else {
                continue;
            };
            if of.usual_lag > 0.0 && !has_before {
                continue; // what watches the lamp was dark before, which looks like another offset
            }
            let [sum, weight] = self.offsets.entry((first + place) / brackets).or_default();
            if of.first.is_empty() {
                of.first = frame;
                continue;
            }
            let variances = [lamp_variance, of.usual_lag.powi(2)];
            for band in 0..self.bands {
                let of_band = (band, self.bands);
                let Some(beside) = beside(&frame, &of.first, of_band, camera, variances) else {
                    continue;
                };
                *sum += beside.offset / beside.variance;
                *weight += beside.variance.recip();
                of.lamp[band].push(beside.lamp);
                for (told, one) in of.told.iter_mut().zip(beside.lag) {
                    *told += one;
                }
            }
        }
    }

    /// What they say of each exposure time, and of the whole measurement by `plan` on `rig`.
    ///
    /// # Errors
    /// A sentence if there are none of an exposure time.
    pub(in super::super) fn finish(self, rig: &Rig, plan: &Plan) -> Result<Black, String> {
        Ok(Black {
            drift: self.drift(rig, plan),
            // Where they all come first nobody knows what the lamp did then.
            lamp_variance: self.scatter().filter(|_| !plan.black_first),
            radiometry: self.radiometry()?,
        })
    }

    /// Variance by which the lamp differs from one black frame to another, relative: what frames among them differ by, too. `None` of
    /// too few, or if they do not tell.
    fn scatter(&self) -> Option<f64> {
        let of = |lamp: &Vec<[f64; 2]>| -> Option<f64> {
            let count = lamp.len() as f64 + 1.0;
            if count < ENOUGH {
                return None;
            }
            // The first one is beside itself.
            let sum = |of: &dyn Fn(&[f64; 2]) -> f64| lamp.iter().map(of).sum::<f64>();
            let (mean, noise) = (sum(&|one| one[0]) / count, sum(&|one| one[1]) / count);
            let squares = sum(&|one| (one[0] - mean).powi(2)) + mean * mean;
            let found = squares / (count - 1.0) - noise;
            (found > noise).then_some(found)
        };
        let all = self.of_each.iter().flat_map(|one| &one.lamp);
        let each: Vec<f64> = all.filter_map(of).collect();
        (!each.is_empty()).then(|| each.iter().sum::<f64>() / each.len() as f64)
    }

    /// What they say of each exposure time.
    pub(super) fn radiometry(self) -> Result<Vec<Radiometry>, String> {
        let numbers = &self.numbers;
        let of = |of: OfTime| {
            let [black, unwatched] = [&of.black, &of.unwatched].map(|means| means.shown.count);
            if black == 0 {
                return Err(format!(
                    "expected black exposures of {} ms, found none",
                    of.exposure_s * 1e3
                ));
            }
            let means = 1.0 + 1.0 / black as f32;
            let lag = Lag::of(of.usual_lag, of.told);
            tracing::debug!(exposure_s = of.exposure_s, ?lag, "of the pattern before");
            let (dark, before) = of.black.get(lag, &of.unwatched.shown.get());
            Ok(Radiometry {
                exposure_s: of.exposure_s,
                dark,
                before,
                unwatched: of.unwatched.get(lag, &[]).0,
                counts: [black, unwatched],
                lag,
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
        let steps_dn = rig.camera.binned.common_e(0.0) / rig.gain_e_per_dn();
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

/// A black `frame`, and what the frames of the pattern before it, of those times, show of what is left in this `exposure`.
fn seen(numbers: &Numbers, frame: &[u16], before: Option<(&[u16], &[f32])>, exposure: usize) -> Vec<Seen> {
    let (mut light, mut exposure_s) = (Vec::new(), 0.0);
    if let Some((frames, times_s)) = before {
        exposure_s = times_s[exposure];
        lag::light(numbers, frames, times_s, exposure, &mut light);
    }
    let of = |(value, dn): (usize, &u16)| {
        let dn = numbers.linear(*dn);
        let nothing = Seen {
            dn,
            before: dn,
            before_variance: 0.0,
        };
        light.get(value).map_or(nothing, |light| Seen {
            dn,
            before: numbers.level + light.dn * exposure_s,
            before_variance: light.variance * exposure_s * exposure_s,
        })
    };
    frame.iter().enumerate().map(of).collect()
}

/// What a black frame says beside another one.
struct Beside {
    /// By how much its offset is higher, and the variance of that.
    offset: f64,
    variance: f64,
    /// By how much the lamp is brighter, relative, and the variance of that.
    lamp: [f64; 2],
    /// Of the share that is left of the pattern before, s/σ² and 1/σ².
    lag: [f64; 2],
}

/// What a band (number, of how many) of the black `frame` says beside the `first`; both have so many rows, the lamp is brighter with this
/// relative variance, and the share of the pattern before has that one; what saturated says nothing. `None` if all did.
fn beside(
    frame: &[Seen],
    first: &[Seen],
    (band, bands): (usize, usize),
    (numbers, rows): (&Numbers, usize),
    [lamp_variance, lag_variance]: [f64; 2],
) -> Option<Beside> {
    let full = numbers.linear(numbers.trusted);
    let usual = lag_variance.max(f64::MIN_POSITIVE).recip();
    let mut normal = DMat3::from_diagonal(DVec3::new(0.0, lamp_variance.recip(), usual));
    let (mut right, mut by_noise) = (DVec3::ZERO, 0.0);
    for (seen, before) in frame
        .iter()
        .zip(first)
        .skip(band)
        .step_by(bands)
        .filter(|(seen, before)| seen.dn.max(before.dn) < full && (seen.before - before.before).is_finite())
    {
        let light = f64::from(before.dn - numbers.level);
        // What the frame itself shows has the same noise as what is to be explained.
        let before_it = f64::from(seen.before - before.before);
        let variance = 2.0 * f64::from(numbers.noise_variance(light as f32));
        let row = DVec3::new(1.0, light, before_it);
        let weighted = row / variance;
        by_noise += f64::from(seen.before_variance + before.before_variance) / variance;
        normal += DMat3::from_cols(weighted * row.x, weighted * row.y, weighted * row.z);
        right += weighted * f64::from(seen.dn - before.dn);
    }
    // In units in which none of them is large.
    let unit =
        DVec3::new(normal.x_axis.x, normal.y_axis.y, normal.z_axis.z).map(|square| square.sqrt().recip());
    let scaled = DMat3::from_diagonal(unit) * normal * DMat3::from_diagonal(unit);
    if !unit.is_finite() || scaled.determinant() <= 0.0 {
        return None;
    }
    let inverse = DMat3::from_diagonal(unit) * scaled.inverse() * DMat3::from_diagonal(unit);
    let found = inverse * right;
    let weight = inverse.z_axis.z.recip();
    // Noise of the pattern before tells nothing of its share, and scatters what it seems to be.
    let all = (weight - usual).max(0.0);
    let told = (all - by_noise).max(0.0);
    let share = told / all.max(f64::MIN_POSITIVE);
    Some(Beside {
        offset: found.x,
        variance: inverse.x_axis.x + 2.0 * f64::from(numbers.row_variance) / rows as f64,
        lamp: [found.y, inverse.y_axis.y],
        lag: [share * found.z * weight, share * told],
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
    let mut frames = BlackFrames::new(rig, (camera, None), &[(exposure_s, 0.0)]);
    frames.add(0, black, values);
    frames.radiometry().map(|mut of_each| of_each.remove(0))
}

#[cfg(test)]
mod tests;
