//! How much each branch counts.

use glam::DVec3;

use super::leave_one_out::shown;
use super::region::{Between, REGIONS, WIDER, around, region, wider};
use super::rule::{DIRECT, HALF_VECTOR, RULES};
use super::{Interpolation, Regions};
use crate::base::eight::{Eight, LANES, Vectors};

/// Rules, forth and back: what is read at the images around the incident direction, and, with the directions exchanged,
/// at those around the outgoing one.
pub const BRANCHES: usize = 2 * RULES.len();
/// Index of the first branch that reads back.
pub(super) const BACK: usize = RULES.len();

/// Samples that a region must have to be believed.
const ENOUGH: f64 = 24.0;
/// BranchErrors count with this power: 2 would be right for errors that know nothing of each other, and a large one chooses.
/// In between the better branch rules, and the blend stays smooth.
const POWER: f32 = 4.0;
/// Branches below this share of the best one are left out, and all count by what they have beyond it: none comes or goes with a step. What
/// is left out would hardly change the mean, and reading it costs as much as reading the best.
const LEAST_SHARE: f32 = 0.15;
/// An image that is left out is predicted over twice the distance of a look-up, at which the error of linear
/// interpolation is up to four times as large, while a branch that reads back is judged at its own distance.
const LEFT_OUT: f64 = 0.5;
/// BranchErrors below this are alike: relative to white.
const LEAST_ERROR: f64 = 1e-5;

/// Sums of squared errors of every branch by region.
#[derive(Clone, Debug)]
pub(super) struct Tally {
    squares: Vec<[f64; BRANCHES]>,
    counts: Vec<f64>,
}

impl Tally {
    pub(super) fn new() -> Self {
        Self {
            squares: vec![[0.0; BRANCHES]; REGIONS + WIDER],
            counts: vec![0.0; REGIONS + WIDER],
        }
    }

    /// Adds the errors of one sample.
    pub(super) fn add(&mut self, wi: DVec3, wo: DVec3, errors: &[f64; BRANCHES]) {
        let region = region(wi, wo);
        for at in std::iter::once(region).chain(wider(region).map(|group| REGIONS + group)) {
            self.counts[at] += 1.0;
            for (sum, error) in self.squares[at].iter_mut().zip(errors) {
                *sum += error * error;
            }
        }
    }

    /// The errors; `None` if there were no samples.
    pub(super) fn errors(&self) -> Option<BranchErrors> {
        let all = REGIONS + WIDER - 1;
        if self.counts[all] == 0.0 {
            return None;
        }
        let of = |region: usize| -> [f64; BRANCHES] {
            let groups = wider(region).map(|group| REGIONS + group);
            let known = std::iter::once(region)
                .chain(groups)
                .find(|&at| self.counts[at] >= ENOUGH)
                .unwrap_or(all);
            std::array::from_fn(|branch| {
                let rms = (self.squares[known][branch] / self.counts[known]).sqrt();
                rms * if branch < BACK { LEFT_OUT } else { 1.0 } + LEAST_ERROR
            })
        };
        Some(BranchErrors((0..REGIONS).flat_map(of).collect()))
    }
}

/// Expected error of every branch in every region, [region, branch], relative to white.
#[derive(Clone, Debug, PartialEq)]
pub struct BranchErrors(Vec<f64>);

impl BranchErrors {
    /// The numbers, row-major.
    #[must_use]
    pub fn as_slice(&self) -> &[f64] {
        &self.0
    }

    /// Standard uncertainty of f in sr⁻¹ if the pair (`wi`, `wo`) is read back directly, where f is about `f`.
    pub(crate) fn of_exchange(&self, wi: DVec3, wo: DVec3, f: f64) -> f64 {
        let regions: Regions = around(wi, wo);
        let relative: f64 = regions
            .into_iter()
            .map(|(region, weight)| f64::from(weight) * self.0[region * BRANCHES + BACK + DIRECT])
            .sum();
        relative / shown(wi, f)
    }

    /// Standard uncertainty of f in sr⁻¹ of the mean of the branches at the pair (`wi`, `wo`), where f is about `f`; `shares` has how much
    /// each counts, and what of its error.
    pub(super) fn of_blend(&self, wi: DVec3, wo: DVec3, f: f64, shares: &[[f32; 2]; BRANCHES]) -> f64 {
        let (mut variance, mut sum) = (0.0, 0.0);
        for (region, weight) in around(wi, wo) {
            let errors = &self.0[region * BRANCHES..][..BRANCHES];
            for (error, [share, part]) in errors.iter().zip(shares) {
                let share = f64::from(weight * share);
                variance += share * (f64::from(*part) * error).powi(2);
                sum += share;
            }
        }
        (variance / f64::max(sum, 1e-12)).sqrt() / shown(wi, f)
    }

    /// From such numbers; `None` unless there are [`REGIONS`] × [`BRANCHES`] positive ones.
    #[must_use]
    pub fn from_values(values: Vec<f64>) -> Option<Self> {
        let fits = values.len() == REGIONS * BRANCHES;
        (fits && values.iter().all(|e| e.is_finite() && *e > 0.0)).then_some(Self(values))
    }
}

/// How much each branch counts at a pair of directions.
#[derive(Clone, Debug)]
pub enum Blend {
    /// One rule everywhere, never back: its index among [`RULES`].
    One(usize),
    /// By expected errors: their logarithms, [region, branch].
    ByError(Vec<[f32; BRANCHES]>),
}

impl Blend {
    /// For `interpolation`, with the `errors` of the captures; without them blending is direct interpolation.
    #[must_use]
    pub fn new(interpolation: Interpolation, errors: Option<&BranchErrors>) -> Self {
        match (interpolation, errors) {
            (Interpolation::HalfVector, _) => Self::One(HALF_VECTOR),
            (Interpolation::Blended, Some(BranchErrors(errors))) => Self::ByError(
                errors
                    .chunks_exact(BRANCHES)
                    .map(|errors| std::array::from_fn(|branch| errors[branch].ln() as f32))
                    .collect(),
            ),
            _ => Self::One(DIRECT),
        }
    }

    /// Whether images are read back, too.
    pub(super) const fn reads_back(&self) -> bool {
        matches!(self, Self::ByError(_))
    }

    /// Share of each branch at eight pairs (`wi`, `wo`) above the horizon, not normalised; 0 for those that are left out.
    // Inlined whatever the compiler thinks of it: a function of its own would not be compiled for the processor that is there.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub(super) fn shares(&self, wi: &Vectors, wo: &Vectors) -> [[f32; BRANCHES]; LANES] {
        let mut shares = [[0.0; BRANCHES]; LANES];
        let logs = match self {
            Self::One(rule) => {
                for shares in &mut shares {
                    shares[*rule] = 1.0;
                }
                return shares;
            }
            Self::ByError(logs) => logs,
        };
        let between = Between::of(wi, wo);
        let least = Eight::splat(LEAST_SHARE);
        for (lane, shares) in shares.iter_mut().enumerate() {
            let mut sums = [Eight::splat(0.0); BRANCHES / LANES];
            for (region, weight) in between.regions(lane) {
                let (logs, _) = logs[region].as_chunks::<LANES>();
                for (sum, logs) in sums.iter_mut().zip(logs) {
                    *sum = *sum + Eight::splat(weight) * Eight::new(*logs);
                }
            }
            let best = sums[0].min(sums[1]).least();
            let worst = Eight::splat(best - LEAST_SHARE.ln() / POWER);
            for (shares, sum) in shares.as_chunks_mut::<LANES>().0.iter_mut().zip(sums) {
                let better = (Eight::splat(best) - sum) * Eight::splat(POWER * std::f32::consts::LOG2_E);
                *shares = worst
                    .where_less(
                        sum,
                        Eight::splat(0.0),
                        better.max(Eight::splat(-100.0)).exp2() - least,
                    )
                    .to_array();
            }
        }
        shares
    }

    /// As [`shares`](Self::shares), of one pair in double precision.
    #[cfg(test)]
    pub(super) fn shares_of_one(&self, wi: DVec3, wo: DVec3) -> [f32; BRANCHES] {
        let Self::ByError(logs) = self else {
            panic!("by error")
        };
        let mut sums = [0.0; BRANCHES];
        for (region, weight) in around(wi, wo) {
            for (sum, log) in sums.iter_mut().zip(logs[region]) {
                *sum += f64::from(weight) * f64::from(log);
            }
        }
        let best = sums.iter().copied().fold(f64::INFINITY, f64::min);
        let share = |sum: f64| (f64::from(POWER) * (best - sum)).exp() as f32;
        sums.map(|sum| (share(sum) - LEAST_SHARE).max(0.0))
    }
}
