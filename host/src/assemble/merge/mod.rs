//! Exposures of different length of one pattern, merged into one image.
//!
//! # Design
//! Exposure k of time t_k gives a pixel's rate as x_k = (g_k − dark_k)/t_k with the variance var(g_k)/t_k², where var(g)
//! is that of the photon-transfer curve (see [`assemble`](super)). The merged rate is the mean with the weights
//!
//! w_k = t_k²/var(g_k),  of variance 1/Σw_k
//!
//! which has the smallest variance of all unbiased ones (Granados and others, *Optimal HDR reconstruction with linear
//! digital cameras*, 2010). The variance must not come from the sample's own noisy number: a number that is low by chance
//! would get more weight, and dark values would come out too low. So it is taken at the signal that is expected from a
//! first mean, whose weights know the noise without light only and are therefore the same for every outcome.
//!
//! Left out are *saturated* samples, and *dark* ones: those with less than a twentieth ([`DARK_SHARE`]) of the weight of
//! the pixel's best. They would lower the standard uncertainty by less than 2.5 % each, but bring in the error of their
//! dark level, which counts for a short exposure as many times more as it is shorter. Where light makes the noise the
//! weight is proportional to t, and a neighbour up to 20 times shorter takes part; where reading out makes it, it goes
//! with t², and one less than 4.5 times shorter does.
//!
//! # Tradeoffs
//! Whether a sample saturates depends on its own noise: within one standard deviation of saturation, merged values are
//! low by up to 0.4 standard deviations.

use glam::Vec4;

use super::radiometry::{Offset, Radiometry};
use crate::instrument::calibration::stray::{Levels, sqrt};
use crate::plan::brackets::MOST_EXPOSURES;

/// Samples with less than this share of the weight of the best are left out.
const DARK_SHARE: f32 = 1.0 / 20.0;

/// What merging needs of one exposure time.
struct Bracket {
    /// Exposure time relative to that of the first.
    time: f32,
    /// Variance by reading out and rounding, in DN².
    dark_variance: f32,
    /// Variance of what a row has in common, in DN².
    row_variance: f32,
}

/// How the exposures of one pattern become an image.
pub(super) struct Merge<'a> {
    exposures: &'a [Radiometry],
    brackets: Vec<Bracket>,
}

/// The merged image: per pixel, channels in the lanes.
#[derive(Default)]
pub(super) struct Merged {
    /// Rate in DN per exposure time of the first; NaN where all exposures saturated.
    pub(super) signal: Vec<Vec4>,
    /// Its variance by noise that is its own.
    pub(super) variance: Vec<Vec4>,
    /// Standard deviation of what its row has in common.
    pub(super) of_row: Vec<Vec4>,
    /// Whether more than one exposure took part, in any channel.
    pub(super) several: Vec<bool>,
    /// Which exposure counts most, of each channel.
    pub(super) heaviest: Vec<[u8; 4]>,
}

/// The numbers `of` an exposure and a lane that stand for each lane of a pixel: those of its `heaviest` exposures.
pub(super) fn by_lane(heaviest: [u8; 4], of: impl Fn(usize, usize) -> f32) -> Vec4 {
    Vec4::from_array(std::array::from_fn(|lane| of(usize::from(heaviest[lane]), lane)))
}

impl<'a> Merge<'a> {
    /// For exposures with these numbers, at most [`MOST_EXPOSURES`], the shortest first.
    pub(super) fn new(exposures: &'a [Radiometry]) -> Self {
        let first_s = exposures[0].exposure_s;
        let brackets = exposures
            .iter()
            .map(|one| Bracket {
                time: (one.exposure_s / first_s) as f32,
                dark_variance: one.dark_variance,
                row_variance: one.row_variance,
            })
            .collect();
        Self { exposures, brackets }
    }

    /// Merges linear `frames`, NaN where they are saturated, one behind the other in the order of the exposures; the lamp had these `levels` in them, and the camera this
    /// `offset` beside the black frames.
    pub(super) fn frames<const CHANNELS: usize>(
        &self,
        frames: &[f32],
        levels: &[Levels],
        offset: Offset,
        out: &mut Merged,
    ) {
        let samples = self.exposures[0].dark.len();
        let pixels = samples / CHANNELS;
        out.signal.clear();
        out.variance.clear();
        out.of_row.clear();
        out.several.clear();
        out.heaviest.clear();
        let mut numbers = [Number::default(); MOST_EXPOSURES];
        for pixel in 0..pixels {
            let at = pixel * CHANNELS;
            for (k, number) in numbers[..self.brackets.len()].iter_mut().enumerate() {
                let radiometry = &self.exposures[k];
                let shown = lanes::<CHANNELS, f32>(&frames[k * samples + at..]);
                let is_saturated = shown.is_nan_mask();
                let linear = Vec4::select(is_saturated, Vec4::ZERO, shown);
                let dark = lanes::<CHANNELS, f32>(&radiometry.dark[at..]);
                *number = Number {
                    signal: levels[k].steady(
                        linear - dark - offset.dn,
                        radiometry.black_light::<CHANNELS>(pixel),
                    ),
                    usable: Vec4::select(is_saturated, Vec4::ZERO, Vec4::ONE),
                    dark_variance: radiometry.dark_shot_variance(dark) + self.brackets[k].dark_variance,
                };
            }
            let found = self.pixel::<CHANNELS>(&numbers[..self.brackets.len()]);
            out.signal.push(found.signal);
            out.variance.push(found.variance);
            out.of_row.push(found.of_row);
            out.heaviest.push(found.heaviest);
            out.several
                .push(found.used.to_array()[..CHANNELS].iter().any(|&used| used > 1.0));
        }
    }

    /// From the numbers of each exposure.
    fn pixel<const CHANNELS: usize>(&self, numbers: &[Number]) -> Pixel {
        let shot_per_dn = self.exposures[0].numbers.shot_per_dn;
        let (mut sum, mut weights) = (Vec4::ZERO, Vec4::ZERO);
        for (bracket, number) in self.brackets.iter().zip(numbers) {
            let weight = number.usable * (bracket.time / number.dark_variance);
            sum += weight * number.signal;
            weights += weight * bracket.time;
        }
        // 0/0 where everything saturated.
        let expected = (sum / weights).max(Vec4::ZERO);
        let mut weight = [Vec4::ZERO; MOST_EXPOSURES];
        let mut best = Vec4::ZERO;
        for ((bracket, number), weight) in self.brackets.iter().zip(numbers).zip(&mut weight) {
            let variance = expected * (bracket.time * shot_per_dn) + number.dark_variance;
            *weight = number.usable * (bracket.time * bracket.time) / variance;
            best = best.max(*weight);
        }
        let (mut sum, mut weights, mut used) = (Vec4::ZERO, Vec4::ZERO, Vec4::ZERO);
        let mut of_row = Vec4::ZERO;
        for ((bracket, number), &weight) in self.brackets.iter().zip(numbers).zip(&weight) {
            let takes_part = Vec4::select(weight.cmpge(best * DARK_SHARE), Vec4::ONE, Vec4::ZERO);
            sum += takes_part * weight * number.signal / bracket.time;
            weights += takes_part * weight;
            used += takes_part;
            // Exposures have rows of their own.
            let part = takes_part * weight / bracket.time;
            of_row += part * part * bracket.row_variance;
        }
        let heaviest = |lane: usize| {
            let of = |exposure: &usize| weight[*exposure][lane];
            (0..numbers.len())
                .max_by(|a, b| of(a).total_cmp(&of(b)))
                .map_or(0, |exposure| exposure as u8)
        };
        Pixel {
            heaviest: std::array::from_fn(heaviest),
            signal: sum / weights,
            variance: 1.0 / weights,
            of_row: sqrt(of_row) / weights,
            used,
        }
    }
}

/// One pixel of the merged image, channels in the lanes.
struct Pixel {
    /// Rate.
    signal: Vec4,
    /// Its variance.
    variance: Vec4,
    /// Standard deviation of what its row has in common.
    of_row: Vec4,
    /// How many exposures made it, and which of them counts most.
    used: Vec4,
    heaviest: [u8; 4],
}

/// One pixel of one exposure, channels in the lanes.
#[derive(Clone, Copy, Default)]
struct Number {
    /// Dark-corrected, in DN.
    signal: Vec4,
    /// 1 if it can be used, else 0.
    usable: Vec4,
    /// Its variance without light of the pattern, in DN².
    dark_variance: Vec4,
}

/// The channels of the first pixel of `values` in the lanes, zeros behind them.
pub(super) fn lanes<const CHANNELS: usize, T: Copy + Into<f32>>(values: &[T]) -> Vec4 {
    let mut lanes = [0.0; 4];
    for (lane, &value) in lanes.iter_mut().zip(&values[..CHANNELS]) {
        *lane = value.into();
    }
    Vec4::from_array(lanes)
}

#[cfg(test)]
mod tests;
