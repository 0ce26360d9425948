//! What the surroundings of a pixel say of it: less noise where an image is smooth.
//!
//! # Design
//! A sample's f changes little from pixel to pixel but at lobes, and where it changes, it mostly does so in a straight line. So pairs of pixels
//! that lie opposite each other around a pixel predict it: their mean is right for everything linear, whatever is missing at the rim. Of all
//! pairs within a square the mean P has the variance v/(2n) where the pixel itself has v, and what P is wrong by, e², the pixels of the same
//! square tell together, none of which takes part in its own prediction: the mean of (g − P)² is v·(1 + 1/(2n)) + e². Own number and prediction are
//! fused by their precisions (Gauss),
//!
//! ĝ = a·g + (1 − a)·P,  a = (v/(2n) + e²)/(v + v/(2n) + e²)
//!
//! and of squares of several sizes, and of none, the one counts that leaves the least uncertainty. At a lobe e² grows at once, and the
//! pixel keeps its own number.
//!
//! # Tradeoffs
//! How well N pixels tell e² is known to √(2/N) of v (χ² with N degrees of freedom), and what they miss they miss in many pixels alike. Half of
//! that is stated as the prediction's uncertainty ([`UNSEEN`]), and less of it counts in the weights ([`DOUBTED`]): on simulated lobes from 3° to 25° wide
//! with 300 to 10,000 electrons at their peak, k = 2 intervals hold 97 to 99.9 % then, and 10⁻⁵ of the values are beyond 6 σ. With none of it, 74 % and more
//! beyond 6 σ. The variance is that at the prediction: a pixel that is dark by chance would count for more than others. What neighbours have in
//! common (stray light, lamp, rows) no average makes smaller: it stays what it was. The noise of fused pixels is shared by neighbours, and is
//! taken as fully shared where pixels become cells.

use glam::Vec4;

use crate::instrument::calibration::stray::sqrt;
use crate::instrument::optics::{Unmeasurable, View};

/// Largest square: so many pixels to each side. Beyond that an image of 96 pixels is straight nowhere.
const FARTHEST: usize = 4;
/// Share of √(2/N) that is stated for what N pixels do not tell of a prediction's error.
const UNSEEN: f32 = 0.5;
/// Share of it that counts in the weights.
const DOUBTED: f32 = 0.15;

/// The pixels of a camera that may tell of each other.
#[derive(Debug)]
pub(crate) struct Surroundings {
    width: usize,
    height: usize,
    /// Whether a pixel sees nothing but the sample.
    is_whole: Vec<bool>,
}

/// An image whose pixels know of their surroundings.
pub(super) struct Fused {
    /// Of each pixel, the channels in the lanes; NaN where it saturated.
    pub(super) signal: Vec<Vec4>,
    /// Its standard deviation by noise and response.
    pub(super) sigma: Vec<Vec4>,
}

/// Sums over squares of pixels.
#[derive(Default)]
struct Sums {
    along: Vec<Vec4>,
    squares: Vec<Vec4>,
}

impl Surroundings {
    /// Of the pixels of `camera`, without those for which `cut` has a reason.
    pub(crate) fn new(camera: &View, cut: &[Option<Unmeasurable>]) -> Self {
        let (width, height) = camera.size_px();
        Self {
            width,
            height,
            is_whole: cut.iter().map(Option::is_none).collect(),
        }
    }

    /// The `signal` of all pixels, of which one has the variance `variance_of` at a signal, fused with what its surroundings say.
    pub(super) fn fuse(&self, signal: &[Vec4], variance_of: impl Fn(usize, Vec4) -> Vec4) -> Fused {
        let known: Vec<Vec4> = signal
            .iter()
            .zip(&self.is_whole)
            .map(|(signal, is_whole)| {
                let whole = if *is_whole { Vec4::ONE } else { Vec4::ZERO };
                Vec4::select(signal.is_nan_mask(), Vec4::ZERO, whole)
            })
            .collect();
        let own: Vec<Vec4> = signal
            .iter()
            .zip(&known)
            .map(|(signal, known)| Vec4::select(known.cmpgt(Vec4::ZERO), *signal, Vec4::ZERO))
            .collect();
        let mut best = signal.to_vec();
        let mut variance: Vec<Vec4> = signal
            .iter()
            .enumerate()
            .map(|(pixel, signal)| variance_of(pixel, *signal))
            .collect();
        let (mut pairs, mut sums) = (
            vec![[Vec4::ZERO; 2]; signal.len()],
            [Sums::default(), Sums::default()],
        );
        let mut missed = vec![Vec4::ZERO; signal.len()];
        let mut told = vec![Vec4::ZERO; signal.len()];
        let mut own_variances = vec![Vec4::ZERO; signal.len()];
        for reach in 1..=FARTHEST {
            self.add_ring(reach, &own, &known, &mut pairs);
            for (pixel, [sum, count]) in pairs.iter().enumerate() {
                let predicted = *sum / *count;
                own_variances[pixel] = variance_of(pixel, predicted);
                let expected = own_variances[pixel] * (Vec4::ONE + (*count * 2.0).recip());
                let is_told =
                    count.cmpgt(Vec4::ZERO) & known[pixel].cmpgt(Vec4::ZERO) & expected.cmpgt(Vec4::ZERO);
                let off = own[pixel] - predicted;
                missed[pixel] = Vec4::select(is_told, off * off / expected, Vec4::ZERO);
                told[pixel] = Vec4::select(is_told, Vec4::ONE, Vec4::ZERO);
            }
            sums[0].over_squares(&missed, self.width, reach);
            sums[1].over_squares(&told, self.width, reach);
            for (pixel, [sum, count]) in pairs.iter().enumerate() {
                let predicted = *sum / *count;
                let (missed, numbers) = (sums[0].squares[pixel], sums[1].squares[pixel]);
                let own_variance = own_variances[pixel];
                // All in units of the own variance.
                let unseen = sqrt(Vec4::splat(2.0) / numbers);
                let spread = (*count * 2.0).recip() + (missed / numbers - Vec4::ONE).max(Vec4::ZERO);
                let doubted = spread + unseen * DOUBTED;
                let share = doubted / (doubted + Vec4::ONE);
                let rest = Vec4::ONE - share;
                let left = (share * share + rest * rest * (spread + unseen * UNSEEN)) * own_variance;
                let is_told = told[pixel].cmpgt(Vec4::ZERO);
                if reach == 1 {
                    variance[pixel] = Vec4::select(is_told, own_variance, variance[pixel]);
                }
                let is_better = is_told & left.cmplt(variance[pixel]);
                best[pixel] = Vec4::select(is_better, share * own[pixel] + rest * predicted, best[pixel]);
                variance[pixel] = Vec4::select(is_better, left, variance[pixel]);
            }
        }
        Fused {
            signal: best,
            sigma: variance.into_iter().map(sqrt).collect(),
        }
    }

    /// Adds the pairs whose pixels are `reach` away, along the farther of both axes, to `pairs`: sum of their means, and number, of each pixel.
    fn add_ring(&self, reach: usize, own: &[Vec4], known: &[Vec4], pairs: &mut [[Vec4; 2]]) {
        let far = reach.cast_signed();
        let all = (0..=reach).flat_map(|down| (-far..=far).map(move |right| (down, right)));
        let ring = all.filter(|(down, right)| {
            (*down).max(right.unsigned_abs()) == reach && (*down > 0 || *right > 0) // each pair once
        });
        for (down, right) in ring {
            let aside = right.unsigned_abs();
            let step = (down * self.width).wrapping_add_signed(right);
            for y in down..self.height.saturating_sub(down) {
                for x in aside..self.width.saturating_sub(aside) {
                    let pixel = y * self.width + x;
                    let (before, behind) = (pixel - step, pixel + step);
                    let both = known[before] * known[behind];
                    pairs[pixel][0] += both * (own[before] + own[behind]) * 0.5;
                    pairs[pixel][1] += both;
                }
            }
        }
    }
}

impl Sums {
    /// Sums `values` of an image so wide over squares that reach so far from each pixel.
    fn over_squares(&mut self, values: &[Vec4], width: usize, reach: usize) {
        let height = values.len() / width;
        self.along.clear();
        self.along.resize(values.len(), Vec4::ZERO);
        self.squares.clear();
        self.squares.resize(values.len(), Vec4::ZERO);
        for (sums, row) in self.along.chunks_exact_mut(width).zip(values.chunks_exact(width)) {
            for (x, sum) in sums.iter_mut().enumerate() {
                let around = &row[x.saturating_sub(reach)..(x + reach + 1).min(width)];
                *sum = around.iter().copied().sum();
            }
        }
        for y in 0..height {
            let sums = &mut self.squares[y * width..][..width];
            for other in y.saturating_sub(reach)..(y + reach + 1).min(height) {
                let row = &self.along[other * width..][..width];
                for (sum, one) in sums.iter_mut().zip(row) {
                    *sum += *one;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_distr::StandardNormal;
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    const SIDE: usize = 64;
    /// Of reading out, electrons².
    const READ2: f32 = 6.0;

    fn all_whole() -> Surroundings {
        Surroundings {
            width: SIDE,
            height: SIDE,
            is_whole: vec![true; SIDE * SIDE],
        }
    }

    /// Electrons of a pixel and what noise makes of them, and their fused value and its standard deviation.
    struct Seen {
        truth: f32,
        own: f32,
        fused: f32,
        sigma: f32,
    }

    /// An image of so many electrons(x, y), x and y from −1 to 1, seen with noise by a camera without colours, and fused.
    fn seen(surroundings: &Surroundings, electrons: impl Fn(f32, f32) -> f32, seed: u64) -> Vec<Seen> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let at = |index: usize| (2 * index + 1) as f32 / SIDE as f32 - 1.0;
        let truth: Vec<f32> = (0..SIDE * SIDE)
            .map(|pixel| electrons(at(pixel % SIDE), at(pixel / SIDE)))
            .collect();
        let noisy: Vec<Vec4> = truth
            .iter()
            .map(|truth| Vec4::X * (truth + (truth + READ2).sqrt() * rng.sample::<f32, _>(StandardNormal)))
            .collect();
        let fused = surroundings.fuse(&noisy, |_, signal| {
            (signal.max(Vec4::ZERO) + Vec4::splat(READ2)) * Vec4::X
        });
        (0..truth.len())
            .map(|pixel| Seen {
                truth: truth[pixel],
                own: noisy[pixel].x,
                fused: fused.signal[pixel].x,
                sigma: fused.sigma[pixel].x,
            })
            .collect()
    }

    /// RMS error before over that behind, the share within k = 2, and the largest error in σ.
    fn judged(seen: &[Seen]) -> [f32; 3] {
        let off = |value: f32, one: &Seen| (value - one.truth).powi(2);
        let [own, fused]: [f32; 2] = [
            seen.iter().map(|one| off(one.own, one)).sum(),
            seen.iter().map(|one| off(one.fused, one)).sum(),
        ];
        let pulls = seen.iter().map(|one| (one.fused - one.truth).abs() / one.sigma);
        let within = pulls.clone().filter(|pull| *pull < 2.0).count() as f32;
        [
            (own / fused).sqrt(),
            within / seen.len() as f32,
            pulls.fold(0.0, f32::max),
        ]
    }

    #[test]
    fn what_is_smooth_loses_its_noise_and_a_lobe_nothing_but_that() {
        for (seed, peak) in [(1, 100.0), (2, 1e3), (3, 1e4)] {
            // A slope, as throughput and shading have.
            let even = seen(&all_whole(), |x, y| peak * (0.7 + 0.2 * x - 0.1 * y), seed);
            let [less, within, farthest] = judged(&even);
            assert!(
                less > 4.5 && within > 0.97 && farthest < 5.0,
                "{peak}: {less} {within} {farthest}"
            );
            // What is stated is no more than a half too large for what noise leaves, and no smaller.
            let stated: f32 = even
                .iter()
                .map(|one| one.sigma / (one.truth + READ2).sqrt())
                .sum();
            let stated = stated / even.len() as f32;
            assert!((1.0 / less..0.4).contains(&stated), "{peak}: {stated}");
            for width in [0.04, 0.1, 0.25] {
                let lobe = |x: f32, y: f32| {
                    let off2 = ((x - 0.2).powi(2) + (y + 0.1).powi(2)) / (width * width);
                    peak * (0.05 + (1.0 + off2).powi(-2))
                };
                let [less, within, farthest] = judged(&seen(&all_whole(), lobe, 10 * seed));
                assert!(
                    less > 1.5 && within > 0.95 && farthest < 6.5,
                    "{peak} {width}: {less} {within} {farthest}"
                );
            }
        }
    }

    #[test]
    fn what_sees_beside_the_sample_or_is_saturated_says_nothing() {
        let mut surroundings = all_whole();
        let hole = 20 * SIDE + 30;
        surroundings.is_whole[hole] = false;
        let mut image = vec![Vec4::splat(100.0); SIDE * SIDE];
        image[hole] = Vec4::splat(1e6);
        let saturated = 40 * SIDE + 10;
        image[saturated] = Vec4::new(100.0, f32::NAN, 100.0, 100.0);
        let fused = surroundings.fuse(&image, |_, signal| signal.max(Vec4::ONE));
        for (pixel, signal) in fused.signal.iter().enumerate() {
            match pixel {
                _ if pixel == hole => assert!(signal.x > 1e5),
                _ if pixel == saturated => {
                    assert!((signal.x - 100.0).abs() < 1e-3 && signal.y.is_nan(), "{signal}");
                }
                _ => assert!(
                    (*signal - Vec4::splat(100.0)).abs().max_element() < 1e-3,
                    "{pixel}: {signal}"
                ),
            }
        }
        // The rim has fewer neighbours, and knows less.
        assert!(fused.sigma[SIDE / 2].x > 1.2 * fused.sigma[SIDE / 2 * (SIDE + 1)].x);
        assert!((fused.sigma[0].x - 10.0).abs() < 1e-3, "a corner has no pair");
    }
}
