//! The merge of captures of one sample at several tilts.
//!
//! # Design
//! Of each further capture a scale (lamp, exposure) and a small turn (the tilt was not quite what its rig says) are found
//! against the first one, in pairs of directions that both have measured: the logarithm of the ratio is ln scale plus the
//! slope of ln f over a turn of both directions, linear least squares in four unknowns, solved again with the turn found
//! until it stands. The turn has a prior of [`TURN_DEG`] about zero: a Lambertian sample cannot show it. Residuals beyond
//! three times the usual take no part. Light comes from directions of the first capture's grid: mostly the other has them too,
//! and nothing has to be interpolated over steps of many degrees.
//!
//! What the captures state as common to all their values bounds the scale: two samples are not made one by it, nor a wrong standard right.
//!
//! Errors of one incident direction are alike. So the uncertainties are those of a jackknife that leaves out a
//! [`GROUPS`]th of the incident directions at a time (Efron, *The Jackknife, the Bootstrap and Other Resampling Plans*, 1982).
//!
//! Then every sample is the mean of what the captures say (`mean`).

use std::collections::BTreeSet;
use std::path::Path;

use glam::{DQuat, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Serialize;
use serde_json::json;

use super::mean::merged_chunk;
use super::union::Union;
use super::{FillError, facts, finish, writer_like};
use crate::assemble::like::measured_with;
use crate::base::linear_fit::least_squares;
use crate::base::progress::Progress;
use crate::brdf::{Brdf, COMMON_UNCERTAINTY, DIRECTION_UNCERTAINTY, FIELD_UNCERTAINTY, UNCALIBRATED};
use crate::hemisphere::direction::from_angles;
use crate::instrument::optics::Unmeasurable;
use crate::store::StoreError;

/// Standard deviation of a turn about each axis before anything is seen, degrees.
const TURN_DEG: f64 = 0.5;
/// Pairs of directions at which captures are compared.
const PAIRS: usize = 20_000;
/// Fewest that both must have.
const FEWEST: usize = 200;
/// Turn over which slopes are differenced, degrees.
const STEP_DEG: f64 = 0.5;
/// Relative uncertainty that every sample has beside its own: interpolation.
const LEAST: f64 = 5e-3;
/// Rounds of turning and solving.
const ROUNDS: usize = 4;
/// Turns below this many times their uncertainty are not applied.
const CLEAR: f64 = 3.0;
/// Groups of incident directions of the jackknife.
const GROUPS: usize = 16;
/// Standard uncertainties that a scale may be off by.
const MOST: f64 = 3.5;
/// Relative standard uncertainty that all values of a capture share of which nobody calibrated that.
const UNCALIBRATED_SCALE: f64 = 0.015;

/// How a further capture stands to the first.
#[derive(Clone, Debug, Serialize)]
pub struct Alignment {
    /// The file.
    pub path: String,
    /// What its f is to be multiplied with.
    pub scale: f64,
    /// Standard uncertainty (k = 1) of it.
    pub scale_uncertainty: f64,
    /// Turn about the sample's x, y and z that its directions need, degrees.
    pub turn_deg: [f64; 3],
    /// Standard uncertainty (k = 1) of each.
    pub turn_uncertainty_deg: [f64; 3],
    /// Pairs of directions that both have.
    pub overlap: usize,
    #[serde(skip)]
    pub(super) turn: DQuat,
}

/// Merges `others` into `base`, at `path`.
pub(super) fn merge(
    base: &Brdf,
    others: &[Brdf],
    path: &Path,
    is_any_scale: bool,
    progress: &dyn Progress,
) -> Result<Vec<Alignment>, FillError> {
    let aligned = |other: &Brdf| {
        let alignment = align(base, other)?;
        if !is_any_scale {
            check_scale(base, other, &alignment)?;
        }
        Ok(alignment)
    };
    let alignments = others
        .iter()
        .map(aligned)
        .collect::<Result<Vec<_>, FillError>>()?;
    let all: Vec<&Brdf> = std::iter::once(base).chain(others).collect();
    let union = Union::of(&all).map_err(|error| FillError::Brdf(base.content(&error)))?;
    // Where one capture reaches, all do; a direction that a capture does not have has no reason there.
    let incident: Vec<Option<Unmeasurable>> = (0..union.set.len())
        .map(|index| {
            let held = all.iter().zip(&union.rows);
            let reasons = held.filter_map(|(brdf, rows)| Some(brdf.incident_reason(rows[index]?)));
            reasons.min_by_key(Option::is_some).flatten()
        })
        .collect();
    let outgoing: Vec<Option<Unmeasurable>> = (0..base.disk().len())
        .map(|cell| {
            let reasons = all.iter().map(|brdf| brdf.outgoing_reason(cell));
            reasons.min_by_key(Option::is_some).flatten()
        })
        .collect();
    let names: Vec<String> = others
        .iter()
        .map(|other| other.path().display().to_string())
        .collect();
    let mut facts = facts("merged", &names, None);
    let uncalibrated: BTreeSet<String> = all
        .iter()
        .filter_map(|brdf| brdf.uncalibrated())
        .flatten()
        .collect();
    facts.insert(UNCALIBRATED.to_owned(), json!(uncalibrated));
    facts.extend(measured_with(&all));
    // The others take their scale and their turn from the first.
    for name in [COMMON_UNCERTAINTY, FIELD_UNCERTAINTY, DIRECTION_UNCERTAINTY] {
        if let Some(stated) = base.attributes().get(name) {
            facts.insert(name.to_owned(), stated.clone());
        }
    }
    let writer = writer_like(base, &union.set, path, &incident, &outgoing, facts)?;
    let length = base.chunk_range(0).len();
    let chunks = union.set.len().div_ceil(length);
    // Nothing goes where the merged file says that there can be nothing.
    let is_open = |index: usize, cell: usize| incident[index].is_none() && outgoing[cell].is_none();
    progress.begin("merge", chunks, "chunks");
    for chunk in 0..chunks {
        let range = chunk * length..((chunk + 1) * length).min(union.set.len());
        if let Some(rows) = merged_chunk(&all, &union, &alignments, range, &is_open)? {
            writer.write_chunk(chunk, &rows)?;
        }
        progress.reach(chunk + 1);
    }
    progress.end();
    finish(writer)?;
    Ok(alignments)
}

/// f and σ at a pair of directions, as [`Brdf::with_sigma`] has them.
type Found = Option<[[f32; 3]; 2]>;
/// One equation of least squares: coefficients of ln scale and of the turn about each axis, right side, weight.
type Equation = (Vec<f64>, f64, f64);
/// An equation, and the group of its incident direction.
type Row = (Equation, usize);

/// What `brdf` has at `pairs` of directions that are turned by `turn`.
fn turned(brdf: &Brdf, pairs: &[(DVec3, DVec3)], turn: DQuat) -> Result<Vec<Found>, StoreError> {
    brdf.with_sigma(
        &pairs
            .iter()
            .map(|(wi, wo)| (turn * *wi, turn * *wo))
            .collect::<Vec<_>>(),
    )
}

/// ln f and its variance, if there is an f above 0.
fn log(values: Found) -> Option<(f64, f64)> {
    let [f, sigma] = values?;
    let mean = |of: [f32; 3]| f64::from(of.iter().sum::<f32>()) / 3.0;
    let f = mean(f);
    (f > 0.0).then(|| (f.ln(), (mean(sigma) / f).powi(2)))
}

/// Slope of ln f over a turn of both directions, per radian: [axis][pair].
fn slopes(brdf: &Brdf, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Vec<Option<f64>>>, StoreError> {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let step_rad = STEP_DEG.to_radians();
    let mut slopes = Vec::with_capacity(3);
    for axis in axes {
        let (up, down) = (
            turned(brdf, pairs, DQuat::from_axis_angle(axis, step_rad))?,
            turned(brdf, pairs, DQuat::from_axis_angle(axis, -step_rad))?,
        );
        let slope = |(up, down): (&Found, &Found)| Some((log(*up)?.0 - log(*down)?.0) / (2.0 * step_rad));
        slopes.push(up.iter().zip(&down).map(slope).collect::<Vec<Option<f64>>>());
    }
    Ok(slopes)
}

/// The equations of the pairs that both captures have: of the first there is `there`, of the other `here` with its `slopes`.
fn overlapping(there: &[Found], here: &[Found], slopes: &[Vec<Option<f64>>], groups: &[usize]) -> Vec<Row> {
    (0..there.len())
        .filter_map(|at| {
            let ((a, va), (b, vb)) = (log(there[at])?, log(here[at])?);
            let slopes = [slopes[0][at]?, slopes[1][at]?, slopes[2][at]?];
            // ln base = ln scale + ln other(turned further).
            let row = vec![1.0, slopes[0], slopes[1], slopes[2]];
            let weight = (va + vb + LEAST * LEAST).recip();
            Some(((row, a - b, weight), groups[at]))
        })
        .collect()
}

/// Pairs of directions at which others are compared with `base`, and the groups of their incident directions.
fn drawn_pairs(base: &Brdf) -> (Vec<(DVec3, DVec3)>, Vec<usize>) {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(0);
    let least = 75_f64.to_radians().cos();
    let lit: Vec<usize> = (0..base.grid().len())
        .filter(|&index| base.incident_reason(index).is_none() && base.grid().direction(index).z >= least)
        .collect();
    let (mut pairs, mut groups) = (Vec::new(), Vec::new());
    for _ in 0..if lit.is_empty() { 0 } else { PAIRS } {
        let place = rng.random_range(0..lit.len());
        let z: f64 = rng.random_range(least..1.0);
        let wo = from_angles(z.acos(), rng.random_range(0.0..std::f64::consts::TAU));
        pairs.push((base.grid().direction(lit[place]), wo));
        groups.push(place % GROUPS);
    }
    (pairs, groups)
}

/// Refuses an `alignment` of `other` against `base` whose scale is not within what both state.
fn check_scale(base: &Brdf, other: &Brdf, alignment: &Alignment) -> Result<(), FillError> {
    let stated = |brdf: &Brdf| brdf.common_uncertainty().unwrap_or(UNCALIBRATED_SCALE);
    let relative = alignment.scale_uncertainty / alignment.scale;
    let allowed = MOST * stated(base).hypot(stated(other)).hypot(relative);
    if alignment.scale.ln().abs() <= allowed {
        return Ok(());
    }
    Err(FillError::Scale {
        path: other.path().display().to_string(),
        first: base.path().display().to_string(),
        scale: alignment.scale,
        uncertainty: alignment.scale_uncertainty,
        allowed_percent: 100.0 * allowed,
    })
}

/// Scale and turn of `other` against `base`.
fn align(base: &Brdf, other: &Brdf) -> Result<Alignment, FillError> {
    let (pairs, groups) = drawn_pairs(base);
    let there = base.with_sigma(&pairs)?;
    let slopes = slopes(other, &pairs)?;
    let no_overlap = |found: usize| FillError::NoOverlap {
        path: other.path().display().to_string(),
        first: base.path().display().to_string(),
        expected: FEWEST,
        found,
    };
    let prior = TURN_DEG.to_radians().powi(-2);
    let mut turn = DQuat::IDENTITY;
    let (mut found, mut uncertainty, mut overlap) = ([0.0; 4], [0.0; 4], 0);
    let mut usual = f64::INFINITY;
    for round in 1..=ROUNDS {
        let here = turned(other, &pairs, turn)?;
        let rows = overlapping(&there, &here, &slopes, &groups);
        overlap = rows.len();
        if overlap < FEWEST {
            return Err(no_overlap(overlap));
        }
        let so_far = turn.to_scaled_axis();
        let kept: Vec<Row> = rows
            .iter()
            .filter(|((_, target, weight), _)| (target - found[0]).abs() * weight.sqrt() <= 3.0 * usual)
            .cloned()
            .collect();
        let solve = |left_out: Option<usize>| {
            let priors = (0..3).map(|axis| {
                let mut row = vec![0.0; 4];
                row[axis + 1] = 1.0;
                (row, -so_far[axis], prior)
            });
            let some = kept.iter().filter(|(_, group)| Some(*group) != left_out);
            least_squares(4, some.map(|(equation, _)| equation.clone()).chain(priors))
        };
        let (solved, covariance) = solve(None).ok_or_else(|| no_overlap(overlap))?;
        let residual = |((row, target, weight), _): &Row| {
            let model: f64 = row.iter().zip(solved.iter()).map(|(a, b)| a * b).sum();
            (target - model).abs() * weight.sqrt()
        };
        let mut sizes: Vec<f64> = rows.iter().map(residual).collect();
        let middle = sizes.len() / 2;
        usual = 1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
        turn = DQuat::from_scaled_axis(DVec3::new(solved[1], solved[2], solved[3])) * turn;
        let total = turn.to_scaled_axis();
        found = [solved[0], total.x, total.y, total.z];
        if round < ROUNDS {
            continue;
        }
        let without: Vec<_> = (0..GROUPS)
            .filter_map(|group| Some(solve(Some(group))?.0))
            .collect();
        // Residuals say how good the weights are, the groups how much of it they share.
        uncertainty = std::array::from_fn(|at| {
            let squares: f64 = without.iter().map(|one| (one[at] - solved[at]).powi(2)).sum();
            let jackknife = (squares * (GROUPS - 1) as f64 / GROUPS as f64).sqrt();
            jackknife.max(covariance[(at, at)].sqrt() * usual.max(1.0))
        });
    }
    let is_clear = (1..4).any(|at| found[at].abs() > CLEAR * uncertainty[at]);
    let degrees = |of: [f64; 4]| [of[1], of[2], of[3]].map(f64::to_degrees);
    Ok(Alignment {
        path: other.path().display().to_string(),
        scale: found[0].exp(),
        scale_uncertainty: found[0].exp() * uncertainty[0],
        turn_deg: degrees(found),
        turn_uncertainty_deg: degrees(uncertainty),
        overlap,
        turn: if is_clear { turn } else { DQuat::IDENTITY },
    })
}
