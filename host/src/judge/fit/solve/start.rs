//! Where searches begin.

use levenberg_marquardt::LeastSquaresProblem as _;
use nalgebra::{DVector, Matrix2, Vector2};

use super::super::model::{Model, WHITE};
use super::super::observations::Observations;
use super::super::shape::{SHAPE, Shape};
use super::{Problem, Range, physical};

/// Roughness from which fits start, and how many azimuths of half a turn.
const STARTS: [f64; 5] = [0.03, 0.07, 0.15, 0.35, 0.8];
const AZIMUTHS: usize = 8;
/// So many samples are enough to choose among them.
const TRIED: usize = 20_000;
/// Unknowns to begin at: the best of a grid of shapes, with the others by linear least squares, within `range`.
pub(in super::super) fn start(model: Model, seen: &Observations, range: Range) -> DVector<f64> {
    let seen = &seen.every(seen.all.len().div_ceil(TRIED));
    let channels = seen.channels;
    let mut problem = Problem::new(model, seen, seen, range);
    // The variances of the values as they are: only the start depends on them.
    problem.weights = (0..seen.all.len() * channels)
        .map(|at| {
            let observation = &seen.all[at / channels];
            observation
                .variance_at(observation.f[at % channels])
                .sqrt()
                .recip()
        })
        .collect();
    let (mut least, mut best) = (f64::INFINITY, problem.unknowns.clone());
    for shape in starts() {
        for (unknown, value) in problem.unknowns.iter_mut().zip(shape.unknowns()) {
            *unknown = value;
        }
        problem.parts = problem.parts_at(shape, seen);
        for channel in 0..channels {
            let [rho_d, strength] = match (range, linear(&problem, channel)) {
                (Range::Free, found) => found,
                (Range::Physical, [rho_d, strength]) => physical(rho_d, strength),
            };
            problem.unknowns[SHAPE + 2 * channel] = rho_d;
            problem.unknowns[SHAPE + 1 + 2 * channel] = strength;
        }
        let chi_squared = problem.residuals().map_or(f64::INFINITY, |r| r.norm_squared());
        if chi_squared < least {
            (least, best) = (chi_squared, problem.unknowns.clone());
        }
    }
    best
}

/// Shapes from which a fit may start.
fn starts() -> impl Iterator<Item = Shape> {
    let pairs = STARTS
        .into_iter()
        .enumerate()
        .flat_map(|(at, wide)| STARTS[..=at].iter().map(move |narrow| [*narrow, wide]));
    pairs.flat_map(|alpha| {
        // A lobe that is as wide both ways has no azimuth.
        let azimuths = if alpha[0] < alpha[1] { AZIMUTHS } else { 1 };
        (0..azimuths).map(move |turn| Shape {
            alpha,
            azimuth_rad: std::f64::consts::PI * turn as f64 / AZIMUTHS as f64,
        })
    })
}

/// ρd and strength of one channel at the roughness of `problem`.
fn linear(problem: &Problem<'_>, channel: usize) -> [f64; 2] {
    let channels = problem.seen.channels;
    let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
    for (sample, (seen, parts)) in problem.seen.all.iter().zip(&problem.parts).enumerate() {
        let weight = problem.weights[sample * channels + channel].powi(2);
        let row = Vector2::new(WHITE, parts[1]);
        normal += weight * row * row.transpose();
        right += weight * (seen.f[channel] - parts[0]) * row;
    }
    normal
        .try_inverse()
        .map_or([0.0; 2], |inverse| (inverse * right).into())
}

/// Where a search from `from` ends in few of the samples: most of the way goes as well with them. Where it leaves the range of lobes, or finds
/// no end, all of them have to say so, and it is `from`.
pub(super) fn near(
    model: Model,
    seen: &Observations,
    sharp: &Observations,
    from: &DVector<f64>,
    range: Range,
) -> DVector<f64> {
    if seen.all.len() <= 2 * TRIED {
        return from.clone();
    }
    let stride = seen.all.len().div_ceil(TRIED);
    let (few, sharp) = (seen.every(stride), sharp.every(stride));
    let (rough, is_found) = Problem::new(model, &few, &sharp, range).started(from).minimized();
    if is_found && rough.is_in_range() {
        rough.unknowns
    } else {
        from.clone()
    }
}
