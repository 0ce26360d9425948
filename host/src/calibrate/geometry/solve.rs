//! The fit: Levenberg–Marquardt with weights that forgive outliers.
//!
//! # Design
//! Of a match the residual is the angle, in two components, between the direction of the projector position and the
//! mirrored direction of the camera position; of an edge position the angle by which its ray passes the nearest edge of
//! hole, rim or wire. Both traces go forward only. Residuals count in units of their own scale (1.4826 times the median of
//! their magnitudes), found anew in each round, with Cauchy's weights 1/(1 + (r/2)²) from the round before.
//! The covariance is that of the last round, scaled with its χ² per degree of freedom if that is above 1.

use glam::{DVec2, DVec3};
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned};
use rayon::prelude::*;

use super::parameters::Parameter;
use super::sightings::Sightings;
use crate::instrument::optics::View;
use crate::instrument::rig::Rig;
use crate::virtual_rig::FlatMirror;

/// Rounds of weights.
const ROUNDS: usize = 6;
/// Difference for a derivative, in tolerances.
const STEP: f64 = 1e-5;
/// An edge position that passes every edge by more than this belongs to none of them (to the sample's, for one).
const EDGE_RAD: f64 = 0.06;
/// Least scale of residuals: rounding.
const LEAST_RAD: f64 = 1e-7;

/// What a match or an edge says of a rig, radians; edges have one component. `None`: nothing.
pub(super) type Residual = Option<DVec2>;

/// The problem: rig, unknowns and sightings.
pub(super) struct Problem<'a> {
    nominal: &'a Rig,
    parameters: &'a [Parameter],
    mirrors: &'a [FlatMirror],
    seen: &'a Sightings,
    unknowns: DVector<f64>,
    /// √weight over scale of each match and each edge, radians⁻¹.
    weights: Vec<f64>,
}

/// The solution.
pub(super) struct Solution {
    pub(super) rig: Rig,
    /// Covariance of the parameters in the units of the rig file.
    pub(super) covariance: DMatrix<f64>,
    /// Residual of each match, then of each edge.
    pub(super) residuals: Vec<Residual>,
    /// Scales of matches and of edges, radians.
    pub(super) scales_rad: [f64; 2],
}

/// `nominal` with the parameters moved by `unknowns` tolerances.
pub(super) fn moved(nominal: &Rig, parameters: &[Parameter], unknowns: &DVector<f64>) -> Rig {
    let mut rig = nominal.clone();
    for (parameter, by) in parameters.iter().zip(unknowns.iter()) {
        *parameter.of(&mut rig) += parameter.tolerance * by;
    }
    rig
}

/// Residuals of all matches, then of all edges.
fn residuals_of(rig: &Rig, mirrors: &[FlatMirror], seen: &Sightings) -> Vec<Residual> {
    let (camera, projector) = (View::camera(rig), View::projector(rig));
    let of_match = |found: &super::sightings::Match| -> Residual {
        let out = camera.sight(found.camera_px.x, found.camera_px.y)?;
        let lit = projector.sight(found.projector_px.x, found.projector_px.y)?;
        let (e1, e2) = lit.any_orthonormal_pair();
        let missed: DVec3 = mirrors[found.view].mirrored(out) - lit;
        Some(DVec2::new(missed.dot(e1), missed.dot(e2)))
    };
    let of_edge = |at: &DVec2| -> Residual {
        let distances = camera.edge_distances_rad(at.x, at.y);
        let nearest = distances
            .into_iter()
            .flatten()
            .min_by(|a, b| a.abs().total_cmp(&b.abs()))?;
        (nearest.abs() < EDGE_RAD).then_some(DVec2::new(nearest, 0.0))
    };
    let matches = seen.matches.iter().map(of_match);
    matches.chain(seen.edges_px.iter().map(of_edge)).collect()
}

impl Problem<'_> {
    fn residuals_at(&self, unknowns: &DVector<f64>) -> Vec<Residual> {
        let rig = moved(self.nominal, self.parameters, unknowns);
        residuals_of(&rig, self.mirrors, self.seen)
    }

    /// Rows: two of each match, one of each edge, then the unknowns themselves.
    fn rows(&self, residuals: &[Residual], unknowns: &DVector<f64>) -> DVector<f64> {
        let matches = self.seen.matches.len();
        let rows = 2 * matches + self.seen.edges_px.len() + unknowns.len();
        let mut out = DVector::zeros(rows);
        for (at, (residual, weight)) in residuals.iter().zip(&self.weights).enumerate() {
            let residual = residual.unwrap_or(DVec2::ZERO) * *weight;
            if at < matches {
                out[2 * at] = residual.x;
                out[2 * at + 1] = residual.y;
            } else {
                out[matches + at] = residual.x;
            }
        }
        out.rows_mut(rows - unknowns.len(), unknowns.len())
            .copy_from(unknowns);
        out
    }

    /// Finds scales and weights from the residuals as they are; returns the scales.
    fn weigh(&mut self) -> [f64; 2] {
        let residuals = self.residuals_at(&self.unknowns);
        let (matches, edges) = residuals.split_at(self.seen.matches.len());
        let scales = [scale(matches), scale(edges)];
        let weight = |residual: &Residual, scale: f64| {
            residual.map_or(0.0, |residual| {
                (1.0 + (residual.length() / (2.0 * scale)).powi(2)).sqrt().recip() / scale
            })
        };
        self.weights = matches
            .iter()
            .map(|residual| weight(residual, scales[0]))
            .chain(edges.iter().map(|residual| weight(residual, scales[1])))
            .collect();
        scales
    }
}

/// 1.4826 × median of the magnitudes.
fn scale(residuals: &[Residual]) -> f64 {
    let mut sizes: Vec<f64> = residuals.iter().flatten().map(|r| r.length()).collect();
    if sizes.is_empty() {
        return 1.0;
    }
    let middle = sizes.len() / 2;
    (1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1).max(LEAST_RAD)
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ParameterStorage = Owned<f64, Dyn>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;

    fn set_params(&mut self, unknowns: &DVector<f64>) {
        self.unknowns.copy_from(unknowns);
    }

    fn params(&self) -> DVector<f64> {
        self.unknowns.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        Some(self.rows(&self.residuals_at(&self.unknowns), &self.unknowns))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let columns: Vec<DVector<f64>> = (0..self.unknowns.len())
            .into_par_iter()
            .map(|at| {
                let side = |by: f64| {
                    let mut unknowns = self.unknowns.clone();
                    unknowns[at] += by;
                    self.rows(&self.residuals_at(&unknowns), &unknowns)
                };
                (side(STEP) - side(-STEP)) / (2.0 * STEP)
            })
            .collect();
        Some(DMatrix::from_columns(&columns))
    }
}

/// The rig that explains best what was seen with the mirrors `mirrors`, beginning at `nominal`; `None` if the fit does not
/// converge.
pub(super) fn solve(
    nominal: &Rig,
    parameters: &[Parameter],
    mirrors: &[FlatMirror],
    seen: &Sightings,
) -> Option<Solution> {
    let mut problem = Problem {
        nominal,
        parameters,
        mirrors,
        seen,
        unknowns: DVector::zeros(parameters.len()),
        weights: Vec::new(),
    };
    let mut scales_rad = problem.weigh();
    for _ in 0..ROUNDS {
        let (solved, report) = LevenbergMarquardt::new().minimize(problem);
        problem = solved;
        if !report.termination.was_successful() {
            tracing::debug!(?report, "no convergence");
            return None;
        }
        scales_rad = problem.weigh();
    }
    let rows = problem.residuals()?;
    let jacobian = problem.jacobian()?;
    let taking_part = problem.weights.iter().filter(|weight| **weight > 0.0).count();
    let degrees = (2 * taking_part).saturating_sub(parameters.len()).max(1);
    let excess = (rows.norm_squared() / degrees as f64).max(1.0);
    let tolerance = DMatrix::from_diagonal(&DVector::from_iterator(
        parameters.len(),
        parameters.iter().map(|parameter| parameter.tolerance),
    ));
    let inverse = jacobian.tr_mul(&jacobian).cholesky()?.inverse() * excess;
    Some(Solution {
        rig: moved(nominal, parameters, &problem.unknowns),
        covariance: &tolerance * inverse * &tolerance,
        residuals: problem.residuals_at(&problem.unknowns),
        scales_rad,
    })
}
