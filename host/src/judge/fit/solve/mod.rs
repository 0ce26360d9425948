//! The least-squares problem.
//!
//! # Design
//! Unknowns are the three of the lobe's [`Shape`] and per channel ρd and the strength of the lobe. f is linear in the latter two, so
//! their derivatives are exact and their start values follow from the shape by linear least squares; those of the shape
//! are the best of a coarse grid.
//!
//! First the unknowns are free, so that their estimates are not biased. Only if one of them leaves its physical range, ρd ≥ 0,
//! strength ≥ 0 and ρd + strength ≤ 1, by more than noise can explain, the fit is made again within them: what is beyond a
//! bound counts as at it.

mod start;

use std::collections::BTreeMap;

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt, TerminationReason};
use nalgebra::{DMatrix, DVector, Dyn, Owned};
use rayon::prelude::*;

use start::near;
pub(super) use start::start;

use super::FitError;
use super::model::{Model, WHITE, combine};
use super::observations::Observations;
use super::shape::{SHAPE, Shape};
use super::systematic;

/// Share of the blur of a single sample that is not known (k = 1). Linear interpolation adds w(1−w) pixels² to the 1/12 of
/// a pixel, where w, the place between two pixels, is any: 1/4 ± √(1/180), which is 30 %.
const PHASE: f64 = 0.3;
/// Difference in an unknown of the shape for its derivative.
const STEP: f64 = 1e-4;
/// A step ends the search that changes χ², or the unknowns, by no more than this share: far less than their uncertainty. A
/// material without a lobe has no minimum to speak of, and would be searched for long.
const CHI_SQUARED_STEP: f64 = 1e-9;
const UNKNOWNS_STEP: f64 = 1e-6;
/// A search has so many legs of so many evaluations for each unknown, and ends after one that left the range of roughness: it
/// does not come back.
const LEGS: usize = 10;
const PATIENCE: usize = 10;
/// Roughness beyond which there is no lobe, or one that no pixel resolves.
pub(super) const ALPHA: std::ops::RangeInclusive<f64> = 0.001..=1.5;

/// A solution.
pub(super) struct Solution {
    /// Those of the [`Shape`], then ρd and strength of each channel.
    pub(super) unknowns: DVector<f64>,
    /// Covariance of those as the residuals show it.
    pub(super) covariance: DMatrix<f64>,
    /// Sum of squared residuals over their standard uncertainties.
    pub(super) chi_squared: f64,
    /// Whether the minimum was reached.
    pub(super) is_converged: bool,
}

/// Whether ρd and strength may have any value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Range {
    /// Any.
    Free,
    /// What is beyond a bound counts as at it.
    Physical,
}

/// ρd and strength within their physical range.
pub(super) fn physical(rho_d: f64, strength: f64) -> [f64; 2] {
    let rho_d = rho_d.clamp(0.0, 1.0);
    [rho_d, strength.clamp(0.0, 1.0 - rho_d)]
}

struct Problem<'a> {
    model: Model,
    seen: &'a Observations,
    /// The same without blur.
    sharp: &'a Observations,
    /// 1/σ of each residual.
    weights: Vec<f64>,
    range: Range,
    unknowns: DVector<f64>,
    /// Of each sample, its parts at these unknowns.
    parts: Vec<[f64; 2]>,
}

fn shape(unknowns: &DVector<f64>) -> Shape {
    Shape::of_unknowns([unknowns[0], unknowns[1], unknowns[2]])
}

impl<'a> Problem<'a> {
    fn new(model: Model, seen: &'a Observations, sharp: &'a Observations, range: Range) -> Self {
        Self {
            model,
            seen,
            sharp,
            weights: Vec::new(),
            range,
            unknowns: DVector::zeros(SHAPE + 2 * seen.channels),
            parts: Vec::new(),
        }
    }
}

impl Problem<'_> {
    fn parts_at(&self, shape: Shape, seen: &Observations) -> Vec<[f64; 2]> {
        seen.all
            .par_iter()
            .map(|seen| self.model.parts(shape, seen))
            .collect()
    }

    /// f in sr⁻¹ of a sample in a channel at the unknowns, from its parts.
    fn f(&self, parts: [f64; 2], channel: usize) -> f64 {
        let [rho_d, strength] = self.linear(channel);
        combine(parts, rho_d, strength)
    }

    /// ρd and strength of a channel as they count.
    fn linear(&self, channel: usize) -> [f64; 2] {
        let (rho_d, strength) = (
            self.unknowns[SHAPE + 2 * channel],
            self.unknowns[SHAPE + 1 + 2 * channel],
        );
        match self.range {
            Range::Free => [rho_d, strength],
            Range::Physical => physical(rho_d, strength),
        }
    }

    /// Whether its lobe is one that pixels resolve.
    fn is_in_range(&self) -> bool {
        shape(&self.unknowns)
            .alpha
            .iter()
            .all(|alpha| ALPHA.contains(alpha))
    }

    /// At the unknowns `from`, with the weights that belong to them.
    fn started(mut self, from: &DVector<f64>) -> Self {
        self.set_params(from);
        self.weigh();
        self
    }

    /// Where a search from here ends, and whether that is a minimum.
    fn minimized(mut self) -> (Self, bool) {
        for _ in 0..LEGS {
            let (solved, report) = LevenbergMarquardt::new()
                .with_ftol(CHI_SQUARED_STEP)
                .with_xtol(UNKNOWNS_STEP)
                .with_patience(PATIENCE)
                .minimize(self);
            self = solved;
            if report.termination != TerminationReason::LostPatience {
                return (self, report.termination.was_successful());
            }
            if !self.is_in_range() {
                break;
            }
        }
        (self, false)
    }

    fn weigh(&mut self) {
        let channels = self.seen.channels;
        let sharp = self.parts_at(shape(&self.unknowns), self.sharp);
        self.weights = (0..self.seen.all.len() * channels)
            .map(|at| {
                let f = self.f(self.parts[at / channels], at % channels);
                let blur = f - self.f(sharp[at / channels], at % channels);
                let noise = self.seen.all[at / channels].variance_at(f);
                (noise + (PHASE * blur).powi(2)).sqrt().recip()
            })
            .collect();
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ParameterStorage = Owned<f64, Dyn>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;

    fn set_params(&mut self, unknowns: &DVector<f64>) {
        self.parts = self.parts_at(shape(unknowns), self.seen);
        self.unknowns.copy_from(unknowns);
    }

    fn params(&self) -> DVector<f64> {
        self.unknowns.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        let channels = self.seen.channels;
        Some(DVector::from_fn(self.weights.len(), |at, _| {
            let (sample, channel) = (at / channels, at % channels);
            (self.f(self.parts[sample], channel) - self.seen.all[sample].f[channel]) * self.weights[at]
        }))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let channels = self.seen.channels;
        let mut jacobian = DMatrix::zeros(self.weights.len(), SHAPE + 2 * channels);
        for axis in 0..SHAPE {
            let shifted = |by: f64| {
                let mut unknowns = self.unknowns.clone();
                unknowns[axis] += by;
                self.parts_at(shape(&unknowns), self.seen)
            };
            let (up, down) = (shifted(STEP), shifted(-STEP));
            for at in 0..self.weights.len() {
                let (sample, channel) = (at / channels, at % channels);
                let rise = self.f(up[sample], channel) - self.f(down[sample], channel);
                jacobian[(at, axis)] = rise / (2.0 * STEP) * self.weights[at];
            }
        }
        for at in 0..self.weights.len() {
            let (sample, channel) = (at / channels, at % channels);
            let [rho_d, strength] = self.linear(channel);
            let is_free = |unknown: usize, value: f64| (self.unknowns[unknown] - value).abs() < f64::EPSILON;
            let unknown = SHAPE + 2 * channel;
            if is_free(unknown, rho_d) {
                jacobian[(at, unknown)] = WHITE * self.weights[at];
            }
            if is_free(unknown + 1, strength) {
                jacobian[(at, unknown + 1)] = self.parts[sample][1] * self.weights[at];
            }
        }
        Some(jacobian)
    }
}

/// The best fit of `model` to `seen`, beginning at the unknowns `from`; `sharp` are the same samples without blur.
///
/// # Errors
/// As [`minimum`].
pub(super) fn solve(
    model: Model,
    seen: &Observations,
    sharp: &Observations,
    from: &DVector<f64>,
    range: Range,
) -> Result<Solution, FitError> {
    let Minimum {
        problem,
        is_converged,
        jacobian,
        bread,
    } = minimum(model, seen, sharp, from, range)?;
    let residuals = problem.residuals().expect("invariant: always there");
    let chi_squared = residuals.norm_squared();
    let mut covariance = covariance(seen, &jacobian, &residuals, &bread);
    let weights = DVector::from_column_slice(&problem.weights);
    let fitted = |seen: &Observations| {
        let parts = problem.parts_at(shape(&problem.unknowns), seen);
        DVector::from_fn(weights.len(), |at, _| {
            problem.f(parts[at / seen.channels], at % seen.channels)
        })
    };
    for error in systematic::errors(seen, fitted) {
        let weighed = error.component_mul(&weights);
        let shift = &bread * jacobian.tr_mul(&weighed);
        covariance.ger(1.0, &shift, &shift, 1.0);
    }
    Ok(Solution {
        unknowns: problem.unknowns,
        covariance,
        chi_squared,
        is_converged,
    })
}

/// Where a fit ends.
struct Minimum<'a> {
    problem: Problem<'a>,
    is_converged: bool,
    /// Derivatives of the weighted residuals, 0 for what sits at a bound.
    jacobian: DMatrix<f64>,
    /// Inverse of the normal matrix.
    bread: DMatrix<f64>,
}

/// The unknowns of [`solve`] alone, and whether the minimum was reached.
///
/// # Errors
/// As [`minimum`].
pub(super) fn unknowns(
    model: Model,
    seen: &Observations,
    sharp: &Observations,
    from: &DVector<f64>,
    range: Range,
) -> Result<(DVector<f64>, bool), FitError> {
    let found = minimum(model, seen, sharp, from, range)?;
    Ok((found.problem.unknowns, found.is_converged))
}

/// The minimum that [`solve`] is about.
///
/// # Errors
/// [`FitError::NoLobe`] if the samples do not determine the unknowns.
fn minimum<'a>(
    model: Model,
    seen: &'a Observations,
    sharp: &'a Observations,
    from: &DVector<f64>,
    range: Range,
) -> Result<Minimum<'a>, FitError> {
    let begin = near(model, seen, sharp, from, range);
    let mut problem = Problem::new(model, seen, sharp, range).started(&begin);
    let mut is_converged = true;
    // Once more with the weights that belong to the solution.
    for _ in 0..2 {
        (problem, is_converged) = problem.minimized();
        let is_bare =
            (0..seen.channels).all(|channel| range == Range::Physical && problem.linear(channel)[1] <= 0.0);
        if !problem.is_in_range() || is_bare {
            return Err(FitError::NoLobe {
                alpha: shape(&problem.unknowns).alpha,
            });
        }
        problem.weigh();
    }
    for channel in 0..seen.channels {
        let [rho_d, strength] = problem.linear(channel);
        problem.unknowns[SHAPE + 2 * channel] = rho_d;
        problem.unknowns[SHAPE + 1 + 2 * channel] = strength;
    }
    let mut jacobian = problem.jacobian().expect("invariant: always there");
    // What sits at a bound does not vary.
    let at_bound: Vec<usize> = match range {
        Range::Free => Vec::new(),
        Range::Physical => (SHAPE..problem.unknowns.len())
            .filter(|&at| {
                let [rho_d, strength] = problem.linear((at - SHAPE) / 2);
                let is_diffuse = (at - SHAPE).is_multiple_of(2);
                let value = if is_diffuse { rho_d } else { strength };
                value <= 0.0 || value >= 1.0 || (!is_diffuse && rho_d + strength >= 1.0)
            })
            .collect(),
    };
    for &at in &at_bound {
        jacobian.column_mut(at).fill(0.0);
    }
    let normal = jacobian.tr_mul(&jacobian);
    // Scaled, so that what is singular does not depend on units.
    let scale = normal
        .diagonal()
        .map(|square| if square > 0.0 { square.sqrt().recip() } else { 1.0 });
    let scaled = DMatrix::from_fn(normal.nrows(), normal.ncols(), |i, j| {
        if i == j && at_bound.contains(&i) {
            return 1.0;
        }
        normal[(i, j)] * scale[i] * scale[j]
    });
    let inverse = scaled.cholesky().ok_or(FitError::NoLobe {
        alpha: shape(&problem.unknowns).alpha,
    })?;
    let inverse = inverse.inverse();
    let bread = DMatrix::from_fn(normal.nrows(), normal.ncols(), |i, j| {
        inverse[(i, j)] * scale[i] * scale[j]
    });
    Ok(Minimum {
        problem,
        is_converged,
        jacobian,
        bread,
    })
}

/// Covariance of the unknowns as the residuals show it: those of one sample (its channels) count together, and so do those of
/// one incident direction and those of one cell of the disk, which share errors of light, throughput and resampling. Whatever
/// the variances are (White, Econometrica 48, 1980); clustered both ways (Cameron, Gelbach and Miller, J. Business & Economic
/// Statistics 29, 2011), but never below the one without clusters. `bread` is the inverse of the normal matrix.
fn covariance(
    seen: &Observations,
    jacobian: &DMatrix<f64>,
    residuals: &DVector<f64>,
    bread: &DMatrix<f64>,
) -> DMatrix<f64> {
    let unknowns = jacobian.ncols();
    let mut single = DMatrix::zeros(unknowns, unknowns);
    let mut sums: [BTreeMap<u32, DVector<f64>>; 2] = Default::default();
    for (sample, observation) in seen.all.iter().enumerate() {
        let rows = sample * seen.channels..(sample + 1) * seen.channels;
        let score = rows.fold(DVector::zeros(unknowns), |sum: DVector<f64>, at| {
            sum + jacobian.row(at).transpose() * residuals[at]
        });
        single.ger(1.0, &score, &score, 1.0);
        for (sums, shared) in sums.iter_mut().zip(observation.shared) {
            *sums.entry(shared).or_insert_with(|| DVector::zeros(unknowns)) += &score;
        }
    }
    let mut excess = &single * -2.0;
    for sums in &sums {
        // Few of them scatter less than many would.
        let count = sums.len() as f64;
        let share = count / (count - 1.0).max(1.0);
        for sum in sums.values() {
            excess.ger(share, sum, sum, 1.0);
        }
    }
    let single = bread * single * bread;
    let excess = bread * excess * bread;
    // In units in which the unknowns' variances are 1, so that none hides another.
    let unit = single
        .diagonal()
        .map(|square| if square > 0.0 { square.sqrt() } else { 1.0 });
    let scaled = DMatrix::from_fn(unknowns, unknowns, |i, j| excess[(i, j)] / (unit[i] * unit[j]));
    let mut eigen = scaled.symmetric_eigen();
    eigen.eigenvalues.apply(|value| *value = value.max(0.0));
    let raised = eigen.recompose();
    DMatrix::from_fn(unknowns, unknowns, |i, j| {
        single[(i, j)] + raised[(i, j)] * unit[i] * unit[j]
    })
}
