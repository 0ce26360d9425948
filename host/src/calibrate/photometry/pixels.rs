//! The camera's pixels: how they and its rows differ.
//!
//! # Design
//! Terms and splits are those of EMVA 1288 (release 4.0). What repeats is told from noise without a model of noise: frames
//! are split in two halves, whose mean shows pattern and noise, and whose difference noise alone. Medians tell how large
//! both are, so that a few pixels where a ghost's edge is left do not count.
//!
//! *Response.* The mean of all frames of the standard, lit and black, is an evenly lit image: most of its light is that of the
//! black projector pixels together. Less darkness it is smooth but for what pixels differ by in response; so the logarithm is
//! compared with those around it by a mask to which nothing up to the third power of the place is anything (Immerkær, *Fast
//! noise variance estimation*, 1996). What the channels of a pixel have in common is of the light (a ghost has edges) and left
//! out. What is the sensor's own pixel follows from how many are behind one, and how much of those two neighbours share.
//!
//! *Rows.* In the dark the means of rows scatter from frame to frame; what the noise of their pixels does not explain is row
//! noise. What all rows of a frame have in common is none.
//!
//! *Dark signal.* Of each pixel a line over the exposure times: its level is the offset, its slope dark current and what black
//! projector pixels send into the camera, which is smooth; so offsets are compared by the same mask. A pixel is hot whose slope
//! stands out from those around it by more than others scatter.
//!
//! # Tradeoffs
//! A camera of one channel cannot tell what is of the light: edges of stray light count as response then.
//!
//! A hot pixel is seen as far as its dark current is not lost among all those behind a pixel of the image: there are more of
//! them. What they add is in the black frames, and so is the noise of it.

use super::camera::{Times, moments};
use crate::base::median::median;
use crate::instrument::rig::Rig;

/// Fewest numbers that are compared with those around them.
const FEWEST: usize = 30;
/// What a pixel and those around it are weighted by, along an axis: the second difference.
const MASK: [f64; 3] = [1.0, -2.0, 1.0];
/// The slope of a hot pixel is above that of those around it by so many standard deviations of what others are.
const STANDS_OUT: f64 = 6.0;
/// Of a normal distribution, the standard deviation over the median of the amounts.
const OF_MEDIAN: f64 = 1.4826;

/// How an image is laid out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) channels: usize,
    /// Whether the channels are one pixel of the sensor, read out once for each.
    pub(super) in_turn: bool,
    /// Pixels of the sensor behind one of the image, along an axis; they count by area.
    pub(super) along: f64,
}

impl Layout {
    pub(super) fn of(rig: &Rig) -> Self {
        let format = rig.frame_format();
        Self {
            width: format.width_px,
            height: format.height_px,
            channels: format.channels,
            in_turn: rig.shows_bands(),
            along: rig.camera.binned.pixels.sqrt(),
        }
    }

    /// Two `halves` of an image behind [`MASK`], at all pixels where both are known with all around.
    fn masked(&self, halves: &dyn Fn(usize) -> Option<[f64; 2]>) -> Vec<[f64; 2]> {
        let masked = |pixel: usize| {
            let mut sums = [0.0; 2];
            for (row, weight_y) in MASK.iter().enumerate() {
                for (column, weight_x) in MASK.iter().enumerate() {
                    let values = halves(pixel + row * self.width + column - self.width - 1)?;
                    for (sum, value) in sums.iter_mut().zip(values) {
                        *sum += weight_x * weight_y * value;
                    }
                }
            }
            Some(sums)
        };
        let rows = 1..self.height.saturating_sub(1);
        let inner = rows.flat_map(|y| (1..self.width.saturating_sub(1)).map(move |x| y * self.width + x));
        inner.filter_map(masked).collect()
    }

    /// Variance over the sensor's pixels of what two halves show in common, which are `masked`.
    fn common(&self, masked: &[[f64; 2]]) -> f64 {
        let deviation = |of: &dyn Fn(f64, f64) -> f64| {
            let amounts = masked.iter().map(|[one, other]| of(*one, *other).abs());
            OF_MEDIAN * median(amounts.collect()).unwrap_or(0.0)
        };
        let both = deviation(&f64::midpoint);
        let noise = deviation(&|one, other| f64::midpoint(one, -other));
        (both * both - noise * noise).max(0.0) / self.unit()
    }

    /// Variance behind [`MASK`] where each of the sensor's pixels has one of 1.
    fn unit(&self) -> f64 {
        // Sums over the sensor's pixels of a pixel's share with itself, and with that of the next, mean over the image.
        let shared = (1..self.width).map(|border| {
            let cut = (border as f64 * self.along).fract();
            // What rounding leaves is nothing.
            if (1e-6..1.0 - 1e-6).contains(&cut) {
                cut * (1.0 - cut)
            } else {
                0.0
            }
        });
        let shared = shared.sum::<f64>() / (self.width as f64 - 1.0).max(1.0);
        let (own, next) = (
            (self.along - 2.0 * shared) / self.along.powi(2),
            shared / self.along.powi(2),
        );
        (6.0 * own - 8.0 * next).powi(2)
    }
}

/// What dark frames show.
pub(super) struct DarkPattern {
    /// Variance of a row's common part from frame to frame, DN².
    pub(super) row_dn2: f64,
    /// Variance over the pixels of their level without light at an exposure time of zero, DN².
    pub(super) offset_dn2: f64,
    /// Share of the numbers of a frame with a hot pixel.
    pub(super) hot: f64,
}

impl DarkPattern {
    /// Of the dark frames of the `series`.
    pub(super) fn of(series: &[Times], layout: &Layout) -> Self {
        let row = layout.width * layout.channels;
        let bands = if layout.in_turn { layout.channels } else { 1 };
        let rows = series
            .iter()
            .flat_map(|times| (0..bands).map(|band| row_variance(&times.dark, row, (band, bands))));
        let (one, other) = (lines(series, 0), lines(series, 1));
        let slopes = one
            .iter()
            .zip(&other)
            .map(|(one, other)| f64::midpoint(one.1, other.1));
        let off = beside_those_around(&slopes.collect::<Vec<_>>(), row, layout.channels);
        let usual = OF_MEDIAN * median(off.iter().map(|off| off.abs()).collect()).unwrap_or(0.0);
        let is_hot: Vec<bool> = off.iter().map(|off| *off > STANDS_OUT * usual).collect();
        let mut levels = Vec::new();
        for channel in 0..layout.channels {
            levels.extend(layout.masked(&|pixel| {
                let at = pixel * layout.channels + channel;
                (!is_hot[at]).then(|| [one[at].0, other[at].0])
            }));
        }
        Self {
            row_dn2: rows.sum::<f64>().max(0.0) / (series.len() * bands) as f64,
            offset_dn2: layout.common(&levels) / layout.along.powi(2),
            hot: is_hot.iter().filter(|is_hot| **is_hot).count() as f64 / is_hot.len() as f64,
        }
    }
}

/// Each of the `values` of an image less the median of those of its channel around it; see [`DarkPattern::of`].
fn beside_those_around(values: &[f64], row: usize, channels: usize) -> Vec<f64> {
    let beside = |at: usize| {
        let (y, x) = (at / row, at % row);
        let columns = x.saturating_sub(channels)..=(x + channels).min(row - 1);
        let around = (y.saturating_sub(1)..=y + 1).flat_map(|y| {
            let columns = columns.clone().filter(|other| other % channels == x % channels);
            columns.map(move |x| y * row + x)
        });
        let around = around.filter(|other| *other != at);
        let around = around.filter_map(|other| values.get(other).copied()).collect();
        values[at] - median(around).unwrap_or(values[at])
    };
    (0..values.len()).map(beside).collect()
}

/// Variance of what the numbers of a row and a band (number, of how many that are read out by themselves) have in common, from frame to
/// frame, by an analysis of variance.
fn row_variance(frames: &[&[u16]], row: usize, (band, bands): (usize, usize)) -> f64 {
    let (mean, _) = moments(frames);
    let (count, rows) = (frames.len() as f64, (mean.len() / row) as f64);
    let each = (row / bands) as f64;
    let (mut between, mut within) = (0.0, 0.0);
    for frame in frames {
        let off = |at: usize| f64::from(frame[at]) - mean[at];
        let means: Vec<f64> = (0..mean.len())
            .step_by(row)
            .map(|first| (first + band..first + row).step_by(bands).map(off).sum::<f64>() / each)
            .collect();
        let all = means.iter().sum::<f64>() / rows;
        between += means.iter().map(|mean| (mean - all).powi(2)).sum::<f64>();
        within += (band..mean.len())
            .step_by(bands)
            .map(|at| (off(at) - means[at / row]).powi(2))
            .sum::<f64>();
    }
    let free = count - 1.0;
    between / (free * (rows - 1.0).max(1.0)) - within / (free * rows * (each - 1.0).max(1.0)) / each
}

/// Level and slope over the exposure time of each number of the dark frames, of every second frame from `first` on.
fn lines(series: &[Times], first: usize) -> Vec<(f64, f64)> {
    let means: Vec<Vec<f64>> = series
        .iter()
        .map(|times| moments(&every_second(&times.dark, first)).0)
        .collect();
    let count = series.len() as f64;
    let middle_s = series.iter().map(|times| times.exposure_s).sum::<f64>() / count;
    let spread_s2: f64 = series
        .iter()
        .map(|times| (times.exposure_s - middle_s).powi(2))
        .sum();
    (0..means[0].len())
        .map(|at| {
            let mean = means.iter().map(|of| of[at]).sum::<f64>() / count;
            let slope = series
                .iter()
                .zip(&means)
                .map(|(times, of)| (times.exposure_s - middle_s) * of[at]);
            let slope = slope.sum::<f64>() / spread_s2;
            (mean - slope * middle_s, slope)
        })
        .collect()
}

/// Every second of the `frames` from `first` on.
pub(super) fn every_second<'a>(frames: &[&'a [u16]], first: usize) -> Vec<&'a [u16]> {
    frames.iter().skip(first).step_by(2).copied().collect()
}

/// What is a channel's own of the `responses` of all channels, [channel][half], which are independent of each other.
fn own(responses: &[[f64; 2]], channel: usize) -> [f64; 2] {
    let count = responses.len() as f64;
    if responses.len() < 2 {
        return responses[channel];
    }
    // Less their mean it has a variance of 1 − 1/count.
    let scale = (count / (count - 1.0)).sqrt();
    [0, 1].map(|half| {
        let mean = responses.iter().map(|of| of[half]).sum::<f64>() / count;
        scale * (responses[channel][half] - mean)
    })
}

/// The standard at one stand.
pub(super) struct Lit {
    /// Whether each pixel sees nothing else.
    pub(super) is_whole: Vec<bool>,
    /// Its light by two halves of the frames, linear.
    pub(super) halves: [Vec<f64>; 2],
}

/// Standard deviation of the response over the sensor's pixels, relative, from the standard at all stands; `None` if too few
/// pixels show it.
pub(super) fn response(stands: &[Lit], layout: &Layout) -> Option<f64> {
    let mut masked = Vec::new();
    for Lit { is_whole, halves } in stands {
        let logs = |pixel: usize| {
            let at = pixel * layout.channels;
            let log = |channel: usize| [0, 1].map(|half: usize| halves[half][at + channel].ln());
            let logs: Vec<[f64; 2]> = (0..layout.channels).map(log).collect();
            let is_known = is_whole[pixel] && logs.iter().flatten().all(|log| log.is_finite());
            is_known.then_some(logs)
        };
        for channel in 0..layout.channels {
            masked.extend(layout.masked(&|pixel| {
                let logs = logs(pixel)?;
                // Bands in turn are the same pixel of the sensor, and differ by nothing of its own.
                Some(if layout.in_turn {
                    logs[channel]
                } else {
                    own(&logs, channel)
                })
            }));
        }
    }
    (masked.len() >= FEWEST).then(|| layout.common(&masked).sqrt())
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_distr::StandardNormal;
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    #[test]
    fn dark_frames_show_rows_offsets_and_hot_pixels_whatever_the_noise() {
        let (width, height, count) = (40, 60, 16);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(4);
        let mut normal = || -> f64 { rng.sample(StandardNormal) };
        let offsets: Vec<f64> = (0..width * height).map(|_| 3.0 * normal()).collect();
        let times_s = [0.001, 0.002, 0.004, 0.008];
        let frames: Vec<Vec<u16>> = times_s
            .iter()
            .flat_map(|time_s| (0..count).map(move |_| *time_s))
            .map(|time_s| {
                // A frame as a whole is off too, which is no row noise.
                let all = 1000.0 + 5.0 * normal();
                let rows: Vec<f64> = (0..height).map(|_| all + 2.0 * normal()).collect();
                (0..width * height)
                    .map(|at| {
                        let hot = if at % 100 == 7 { 1e4 } else { 0.0 };
                        // Light that is not even.
                        let slope = hot + 100.0 * (at / width) as f64;
                        (rows[at / width] + offsets[at] + 8.0 * normal() + slope * time_s).round() as u16
                    })
                    .collect()
            })
            .collect();
        let layout = Layout {
            width,
            height,
            channels: 1,
            in_turn: false,
            along: 1.0,
        };
        let series: Vec<Times> = times_s
            .iter()
            .zip(frames.chunks_exact(count))
            .map(|(exposure_s, dark)| Times {
                lamp: vec![1.0],
                exposure_s: *exposure_s,
                lit: Vec::new(),
                black: Vec::new(),
                dark: dark.iter().map(Vec::as_slice).collect(),
            })
            .collect();
        let found = DarkPattern::of(&series, &layout);
        let (row, offset) = (found.row_dn2.sqrt(), found.offset_dn2.sqrt());
        assert!((row / 2.0 - 1.0).abs() < 0.05, "{row}");
        assert!((offset / 3.0 - 1.0).abs() < 0.1, "{offset}");
        assert!((found.hot / 0.01 - 1.0).abs() < 0.1, "{}", found.hot);
    }

    #[test]
    fn neighbours_that_share_pixels_of_the_sensor_differ_by_less() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(9);
        for (size, native) in [(40_usize, 120_usize), (40, 50), (40, 64)] {
            let along = native as f64 / size as f64;
            let layout = Layout {
                width: size,
                height: size,
                channels: 1,
                in_turn: false,
                along,
            };
            let (mut squares, mut count) = (0.0, 0);
            for _ in 0..60 {
                // One row and column of weights do for both axes: the sum over the sensor is separable.
                let drawn: Vec<f64> = (0..native * native).map(|_| rng.sample(StandardNormal)).collect();
                let share = |of: usize, at: usize| {
                    let (low, high) = (of as f64 * along, (of + 1) as f64 * along);
                    ((at as f64 + 1.0).min(high) - (at as f64).max(low)).max(0.0) / along
                };
                let mean = |x: usize, y: usize| {
                    let over = |of: usize| {
                        (of as f64 * along) as usize..(((of + 1) as f64 * along).ceil() as usize).min(native)
                    };
                    over(y)
                        .map(|v| {
                            share(y, v) * over(x).map(|u| share(x, u) * drawn[v * native + u]).sum::<f64>()
                        })
                        .sum::<f64>()
                };
                let means: Vec<f64> = (0..size * size).map(|at| mean(at % size, at / size)).collect();
                for [one, _] in layout.masked(&|pixel| Some([means[pixel]; 2])) {
                    (squares, count) = (squares + one * one, count + 1);
                }
            }
            let (found, said) = (squares / f64::from(count), layout.unit());
            assert!((found / said - 1.0).abs() < 0.03, "{native}: {found} {said}");
        }
    }
}
