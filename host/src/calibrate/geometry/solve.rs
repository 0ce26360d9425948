//! The fit: Levenberg–Marquardt with weights that forgive outliers.
//!
//! # Design
//! Of a match the residual is the angle, in two components, between the direction of the projector position and the
//! mirrored direction of the camera position; of an edge position the angle by which its ray passes the nearest edge of
//! hole, rim or wire. Both traces go forward only. Residuals count in units of their own scale (1.4826 times the median of
//! their magnitudes), found anew in each round, with Cauchy's weights 1/(1 + (r/2)²) from the round before.
//! Unknowns are those of the rig, then two of each tilt of the flat mirror ([`super::mounts`]), all in units of their
//! tolerances, and each is itself an observation.
//! The covariance is that of the last round: what the matches and edges tell, less by their χ² per degree of freedom if that is
//! above 1 and by what neighbours share, with what is stated of the unknowns. What the mirror's shape adds ([`super::shape`]) stands
//! apart: directions are those of the mirror as it is.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned};
use rayon::prelude::*;

use super::leftover::Leftover;
use super::mounts::Mount;
use super::parameters::Parameter;
use super::shape::{STEP_RAD, Shape, shapes};
use super::sightings::{Match, Sightings};
use crate::instrument::optics::{Figure, View, reflect};
use crate::instrument::rig::Rig;

/// Rounds of weights, at most.
const ROUNDS: usize = 6;
/// Weights have settled when their scales change by less than this, relative.
const SETTLED: f64 = 1e-3;
/// Matches of each view with which a fit begins: most of the way goes as well with them, and without edges, of which another may be the
/// nearest after each step.
const BEGUN: usize = 700;
/// Difference for a derivative, in tolerances: directions change by 10⁻⁶ rad, and the derivative along it by 10⁻⁵ of itself.
const STEP: f64 = 1e-5;
/// A round has converged when the sum of squares changes by less than this, relative, or the unknowns by less than that. Of ten thousand rows
/// that is a thirtieth of a standard uncertainty; what the views hardly tell, and no direction needs, would come no nearer but in many
/// steps along a valley that is bent.
const CONVERGED: f64 = 1e-7;
const UNKNOWNS_CONVERGED: f64 = 1e-7;
/// The first step of a search, in tolerances or in what the unknowns are already, at most.
const FIRST_STEP: f64 = 10.0;
/// An edge position that passes every edge by more than this belongs to none of them (to the sample's, for one).
const EDGE_RAD: f64 = 0.06;
/// Least scale of residuals: rounding.
const LEAST_RAD: f64 = 1e-7;

/// What a match or an edge says of a rig, radians; edges have one component. `None`: nothing.
pub(super) type Residual = Option<DVec2>;

/// What is fitted to what.
#[derive(Clone, Copy)]
pub(super) struct Task<'a> {
    pub(super) nominal: &'a Rig,
    pub(super) parameters: &'a [Parameter],
    pub(super) mounts: &'a [Mount],
    /// Standard uncertainty of the tilts as stated, either way, degrees.
    pub(super) tilt_deg: f64,
    pub(super) seen: &'a Sightings,
}

/// The problem: a task and where the fit stands.
struct Problem<'a> {
    task: Task<'a>,
    unknowns: DVector<f64>,
    /// √weight over scale of each match and each edge, radians⁻¹.
    weights: Vec<f64>,
}

/// The solution.
pub(super) struct Solution {
    pub(super) rig: Rig,
    /// Changes of the rig's unknowns, in tolerances.
    pub(super) changes: Vec<f64>,
    /// Leans of the flat mirror, two of each mount, in units of the stated uncertainty.
    pub(super) leans: Vec<f64>,
    /// What matches and edges tell of the unknowns, in units of their tolerances: the inverse of a covariance.
    information: DMatrix<f64>,
    /// Residual of each match, then of each edge.
    pub(super) residuals: Vec<Residual>,
    /// Scales of matches and of edges, radians.
    pub(super) scales_rad: [f64; 2],
    pub(super) left: Leftover,
    /// What the mirror's shape makes of the unknowns.
    pub(super) shape: Shape,
}

impl Solution {
    /// Covariance of the unknowns in units of their tolerances, where what is stated of tilts has so many times its variance.
    /// `None` if it has none.
    pub(super) fn covariance(&self, tilts: f64) -> Option<DMatrix<f64>> {
        covariance(&self.information, self.changes.len(), tilts)
    }
}

/// Covariance of unknowns of which is known this `information`, and what is stated of them: of the first ones, which are of the rig, their
/// tolerances, of the others, which are of tilts, so many times their variance. `None` if it has none.
fn covariance(information: &DMatrix<f64>, of_rig: usize, tilts: f64) -> Option<DMatrix<f64>> {
    let mut information = information.clone();
    for at in 0..information.nrows() {
        information[(at, at)] += if at < of_rig { 1.0 } else { tilts.recip() };
    }
    Some(information.cholesky()?.inverse())
}

/// `nominal` with the parameters moved by `unknowns` tolerances.
pub(super) fn moved(nominal: &Rig, parameters: &[Parameter], unknowns: &DVector<f64>) -> Rig {
    let mut rig = nominal.clone();
    for (parameter, by) in parameters.iter().zip(unknowns.iter()) {
        *parameter.of(&mut rig) += parameter.tolerance * by;
    }
    rig
}

/// What is seen of a rig.
#[derive(Clone)]
struct Looks {
    /// The directions that the camera and the projector position of each match see, unit, sample frame.
    camera: Vec<Option<DVec3>>,
    projector: Vec<Option<DVec3>>,
    /// Residual of each edge.
    edges: Vec<Residual>,
}

impl Task<'_> {
    fn rig(&self, unknowns: &DVector<f64>) -> Rig {
        moved(self.nominal, self.parameters, unknowns)
    }

    fn look(&self, rig: &Rig) -> Looks {
        let (camera, edges) = self.camera(rig);
        Looks {
            camera,
            projector: self.projector(rig),
            edges,
        }
    }

    /// What is seen of `rig` if its mirror has this `figure`, but for edges, which it does not move.
    fn look_with(&self, rig: &Rig, figure: &Arc<dyn Figure>, looks: &Looks) -> Looks {
        let [camera, projector] =
            [View::camera(rig), View::projector(rig)].map(|view| view.with_figure(Some(figure.clone())));
        Looks {
            camera: self.sights(&camera, |found| found.camera_px),
            projector: self.sights(&projector, |found| found.projector_px),
            edges: looks.edges.clone(),
        }
    }

    /// What is seen of `rig` where another one has these `looks`: much differs in one device alone.
    fn look_beside(&self, rig: &Rig, (other, looks): (&Rig, &Looks)) -> Looks {
        let mut with_others = rig.clone();
        with_others.projector.clone_from(&other.projector);
        if with_others == *other {
            return Looks {
                projector: self.projector(rig),
                ..looks.clone()
            };
        }
        let mut with_others = rig.clone();
        with_others.camera.clone_from(&other.camera);
        if with_others == *other {
            let (camera, edges) = self.camera(rig);
            return Looks {
                camera,
                projector: looks.projector.clone(),
                edges,
            };
        }
        self.look(rig)
    }

    /// What the camera of `rig` sees at each match, and the residual of each edge.
    fn camera(&self, rig: &Rig) -> (Vec<Option<DVec3>>, Vec<Residual>) {
        let camera = View::camera(rig);
        let of_edge = |at: &DVec2| -> Residual {
            let distances = camera.edge_distances_rad(at.x, at.y);
            let nearest = distances
                .into_iter()
                .flatten()
                .min_by(|a, b| a.abs().total_cmp(&b.abs()))?;
            (nearest.abs() < EDGE_RAD).then_some(DVec2::new(nearest, 0.0))
        };
        (
            self.sights(&camera, |found| found.camera_px),
            self.seen.edges_px.iter().map(of_edge).collect(),
        )
    }

    /// What the projector of `rig` sees at each match.
    fn projector(&self, rig: &Rig) -> Vec<Option<DVec3>> {
        self.sights(&View::projector(rig), |found| found.projector_px)
    }

    /// What a device with this `view` sees at its position `of` each match.
    fn sights(&self, view: &View, of: fn(&Match) -> DVec2) -> Vec<Option<DVec3>> {
        let positions = self.seen.matches.iter().map(of);
        positions.map(|at| view.sight(at.x, at.y)).collect()
    }

    /// Residuals of all matches, then of all edges, of what `looks` like this, with mirrors that lean by `leans` of the stated
    /// uncertainties.
    fn missed(&self, looks: &Looks, leans: &[f64]) -> Vec<Residual> {
        let unit_rad = self.tilt_deg.to_radians();
        let of = |(mount, leans): (&Mount, &[f64])| mount.leaning([leans[0] * unit_rad, leans[1] * unit_rad]);
        let normals: Vec<DVec3> = self.mounts.iter().zip(leans.chunks_exact(2)).map(of).collect();
        let sights = looks.camera.iter().zip(&looks.projector);
        let missed = |(found, (out, lit)): (&Match, (&Option<DVec3>, &Option<DVec3>))| -> Residual {
            let (out, lit) = ((*out)?, (*lit)?);
            let (e1, e2) = lit.any_orthonormal_pair();
            let missed = -reflect(out, normals[found.view]) - lit;
            Some(DVec2::new(missed.dot(e1), missed.dot(e2)))
        };
        let matches = self.seen.matches.iter().zip(sights).map(missed);
        matches.chain(looks.edges.iter().copied()).collect()
    }

    /// Residuals of all matches, then of all edges.
    fn residuals(&self, unknowns: &DVector<f64>) -> Vec<Residual> {
        self.missed(&self.look(&self.rig(unknowns)), self.leans(unknowns))
    }

    /// The leans among the `unknowns`.
    fn leans<'a>(&self, unknowns: &'a DVector<f64>) -> &'a [f64] {
        &unknowns.as_slice()[self.parameters.len()..]
    }
}

impl<'a> Problem<'a> {
    /// At these unknowns, without weights.
    const fn at(task: Task<'a>, unknowns: DVector<f64>) -> Self {
        Self {
            task,
            unknowns,
            weights: Vec::new(),
        }
    }
}

impl Problem<'_> {
    /// With the unknowns and the weights that belong together, and the scales of matches and edges; `None` if there is no convergence.
    fn settled(mut self) -> Option<(Self, [f64; 2])> {
        let mut scales_rad = self.weigh();
        for _ in 0..ROUNDS {
            self = self.minimized()?;
            let before = std::mem::replace(&mut scales_rad, self.weigh());
            let changes = before
                .iter()
                .zip(scales_rad)
                .map(|(before, now)| (now / before - 1.0).abs());
            if changes.fold(0.0, f64::max) < SETTLED {
                break;
            }
        }
        Some((self, scales_rad))
    }

    /// With the unknowns at which these weights have their least sum of squares; `None` if there is no convergence.
    fn minimized(self) -> Option<Self> {
        // Tolerances are the scales: with those of the derivatives a search would begin with steps of a hundredth of what it needs.
        let (solved, report) = LevenbergMarquardt::new()
            .with_ftol(CONVERGED)
            .with_xtol(UNKNOWNS_CONVERGED)
            .with_scale_diag(false)
            .with_stepbound(FIRST_STEP)
            .minimize(self);
        let is_done = report.termination.was_successful();
        if !is_done {
            tracing::debug!(?report, "no convergence");
        }
        is_done.then_some(solved)
    }

    /// What each shape of the mirror makes of the rows of matches and edges, [row, shape], per radian of its RMS slope.
    fn of_shapes(&self) -> DMatrix<f64> {
        let rig = self.task.rig(&self.unknowns);
        let looks = self.task.look(&rig);
        let leans = self.task.leans(&self.unknowns);
        let count = self.unknowns.len();
        let here = self.rows(&self.task.missed(&looks, leans), &self.unknowns);
        let column = |figure: Arc<dyn Figure>| {
            let turned = self.task.look_with(&rig, &figure, &looks);
            // A slope turns what is seen by twice as much.
            let angles = looks.camera.iter().zip(&turned.camera);
            let angles: Vec<f64> = angles
                .filter_map(|(flat, turned)| Some((flat.as_ref()? - turned.as_ref()?).length_squared()))
                .collect();
            let slope_rad = (angles.iter().sum::<f64>() / angles.len().max(1) as f64).sqrt() / 2.0;
            let rows = self.rows(&self.task.missed(&turned, leans), &self.unknowns) - &here;
            rows.rows(0, rows.len() - count) / slope_rad.max(1e-3 * STEP_RAD)
        };
        let shapes = shapes(self.task.nominal.mirror.a_m);
        let columns: Vec<DVector<f64>> = shapes.into_par_iter().map(column).collect();
        DMatrix::from_columns(&columns)
    }

    /// Rows: two of each match, one of each edge, then the unknowns themselves.
    fn rows(&self, residuals: &[Residual], unknowns: &DVector<f64>) -> DVector<f64> {
        let matches = self.task.seen.matches.len();
        let rows = 2 * matches + self.task.seen.edges_px.len() + unknowns.len();
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
        let residuals = self.task.residuals(&self.unknowns);
        let (matches, edges) = residuals.split_at(self.task.seen.matches.len());
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
        Some(self.rows(&self.task.residuals(&self.unknowns), &self.unknowns))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let rig = self.task.rig(&self.unknowns);
        let looks = self.task.look(&rig);
        let here = self.task.missed(&looks, self.task.leans(&self.unknowns));
        let here = self.rows(&here, &self.unknowns);
        let column = |at: usize| {
            let mut unknowns = self.unknowns.clone();
            unknowns[at] += STEP;
            // How the mirrors stand changes nothing of what is seen.
            let beside = (at < self.task.parameters.len())
                .then(|| self.task.look_beside(&self.task.rig(&unknowns), (&rig, &looks)));
            let residuals = self
                .task
                .missed(beside.as_ref().unwrap_or(&looks), self.task.leans(&unknowns));
            (self.rows(&residuals, &unknowns) - &here) / STEP
        };
        let columns: Vec<DVector<f64>> = (0..self.unknowns.len()).into_par_iter().map(column).collect();
        Some(DMatrix::from_columns(&columns))
    }
}

/// How well a rough fit explains the matches.
#[derive(Clone, Debug)]
pub(super) struct Sketch {
    pub(super) rig: Rig,
    /// Median angle of the residuals, radians.
    pub(super) missed_rad: f64,
    /// Sum of squares of what the fit changes, in tolerances.
    pub(super) changes: f64,
}

/// Fits with weights that are found twice; `None` if that does not converge.
fn roughly(task: Task) -> Option<Problem> {
    let mut problem = Problem::at(
        task,
        DVector::zeros(task.parameters.len() + 2 * task.mounts.len()),
    );
    for _ in 0..2 {
        problem.weigh();
        problem = problem.minimized()?;
    }
    Some(problem)
}

/// Fits roughly; `None` if that does not converge.
pub(super) fn sketch(task: Task) -> Option<Sketch> {
    let problem = roughly(task)?;
    Some(Sketch {
        rig: task.rig(&problem.unknowns),
        missed_rad: scale(&task.residuals(&problem.unknowns)) / 1.4826,
        changes: problem.unknowns.norm_squared(),
    })
}

/// The rig, and the leans of the mirrors, that explain best what was seen, beginning at the nominal ones; `None` if the fit does
/// not converge.
pub(super) fn solve(task: Task) -> Option<Solution> {
    let unknowns = task.parameters.len() + 2 * task.mounts.len();
    let few = task.seen.thinned(BEGUN);
    let begun = roughly(Task { seen: &few, ..task });
    let begun = begun.map_or_else(|| DVector::zeros(unknowns), |begun| begun.unknowns);
    let (mut problem, scales_rad) = Problem::at(task, begun).settled()?;
    let seen = problem.residuals()?;
    // Without what is stated of the unknowns.
    let seen = seen.rows(0, seen.len() - unknowns);
    let taking_part = problem.weights.iter().filter(|weight| **weight > 0.0).count();
    let degrees = (2 * taking_part).saturating_sub(unknowns).max(1);
    let excess = (seen.norm_squared() / degrees as f64).max(1.0);
    let lens = &task.nominal.camera.lens;
    let left = Leftover::of(
        task.seen,
        &task.residuals(&problem.unknowns),
        scales_rad[0],
        unknowns,
        [lens.width_px, lens.height_px],
    );
    // What is stated of the unknowns counts against what is seen as it is worth.
    let worth = (excess * left.design_effect).sqrt().recip();
    problem.weights.iter_mut().for_each(|weight| *weight *= worth);
    let problem = problem.minimized()?;
    let jacobian = problem.jacobian()?;
    let jacobian = jacobian.rows(0, jacobian.nrows() - unknowns).into_owned();
    let information = jacobian.tr_mul(&jacobian);
    let shape = Shape::of(
        &problem.of_shapes(),
        &jacobian,
        &covariance(&information, task.parameters.len(), 1.0)?,
        &problem.weights[..task.seen.matches.len()],
        left.seen_rad2,
    );
    Some(Solution {
        rig: task.rig(&problem.unknowns),
        changes: problem.unknowns.as_slice()[..task.parameters.len()].to_vec(),
        leans: task.leans(&problem.unknowns).to_vec(),
        information,
        residuals: task.residuals(&problem.unknowns),
        scales_rad,
        left,
        shape,
    })
}
