//! The merge of captures of one sample at several tilts.
//!
//! # Design
//! Of each further capture a scale (lamp, exposure) and a small turn (the tilt was not quite what its rig says) are found
//! against the first one, in pairs of directions that both have measured: the logarithm of the ratio is ln scale plus the
//! slope of ln f over a turn of both directions, linear least squares in four unknowns, solved again with the turn found
//! until it stands. The turn has a prior of [`TURN_DEG`] about zero: a Lambertian sample cannot show it. Residuals beyond
//! three times the usual take no part.
//!
//! Then every sample is the mean of what the captures say, weighted by inverse variance; a turn is applied by looking up
//! the turned pair. Noise averages out; the standard, the fields and blur do not, because all captures share them. The files
//! have one number for both, so [`COMMON`] of each variance is taken to be shared: with weights w = 1/σ² the variance is
//! (1 − common)/Σw + common·(Σwσ/Σw)².

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

use glam::{DQuat, DVec3};
use half::f16;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Serialize;
use serde_json::json;

use super::union::Union;
use super::{FillError, facts, finish, writer_like};
use crate::base::linear_fit::least_squares;
use crate::base::progress::Progress;
use crate::brdf::{Brdf, COMMON_UNCERTAINTY, DIRECTION_UNCERTAINTY, UNCALIBRATED};
use crate::hemisphere::direction::from_angles;
use crate::instrument::optics::Unmeasurable;
use crate::store::provenance::Provenance;
use crate::store::{BrdfRows, LEAST_SIGMA, StoreError, USELESS_SIGMA};

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
/// Share of the variance of a sample that captures have in common.
const COMMON: f64 = 0.5;
/// Rounds of turning and solving.
const ROUNDS: usize = 4;
/// Turns below this many times their uncertainty are not applied.
const CLEAR: f64 = 2.0;

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
    turn: DQuat,
}

/// Merges `others` into `base`, at `path`.
pub(super) fn merge(
    base: &Brdf,
    others: &[Brdf],
    path: &Path,
    progress: &dyn Progress,
) -> Result<Vec<Alignment>, FillError> {
    let alignments = others
        .iter()
        .map(|other| align(base, other))
        .collect::<Result<Vec<_>, _>>()?;
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
    let mut facts = facts("merged", &names, &[]);
    let uncalibrated: BTreeSet<String> = all
        .iter()
        .filter_map(|brdf| brdf.uncalibrated())
        .flatten()
        .collect();
    facts.insert(UNCALIBRATED.to_owned(), json!(uncalibrated));
    // The others take their scale and their turn from the first.
    for name in [COMMON_UNCERTAINTY, DIRECTION_UNCERTAINTY] {
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

/// Scale and turn of `other` against `base`.
fn align(base: &Brdf, other: &Brdf) -> Result<Alignment, FillError> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(0);
    let mut draw = || {
        let z: f64 = rng.random_range(75_f64.to_radians().cos()..1.0);
        from_angles(z.acos(), rng.random_range(0.0..std::f64::consts::TAU))
    };
    let pairs: Vec<(DVec3, DVec3)> = (0..PAIRS).map(|_| (draw(), draw())).collect();
    let there = base.with_sigma(&pairs)?;
    let turned = |turn: DQuat| -> Result<Vec<Option<[[f32; 3]; 2]>>, StoreError> {
        other.with_sigma(
            &pairs
                .iter()
                .map(|(wi, wo)| (turn * *wi, turn * *wo))
                .collect::<Vec<_>>(),
        )
    };
    let log = |values: &Option<[[f32; 3]; 2]>| -> Option<(f64, f64)> {
        let [f, sigma] = (*values)?;
        let mean = |of: [f32; 3]| f64::from(of.iter().sum::<f32>()) / 3.0;
        let f = mean(f);
        (f > 0.0).then(|| (f.ln(), (mean(sigma) / f).powi(2)))
    };
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let step_rad = STEP_DEG.to_radians();
    let mut slopes = Vec::with_capacity(3);
    for axis in axes {
        let (up, down) = (
            turned(DQuat::from_axis_angle(axis, step_rad))?,
            turned(DQuat::from_axis_angle(axis, -step_rad))?,
        );
        let slope =
            |(up, down): (&Option<_>, &Option<_>)| Some((log(up)?.0 - log(down)?.0) / (2.0 * step_rad));
        slopes.push(up.iter().zip(&down).map(slope).collect::<Vec<Option<f64>>>());
    }
    let prior = TURN_DEG.to_radians().powi(-2);
    let mut turn = DQuat::IDENTITY;
    let (mut found, mut uncertainty, mut overlap) = ([0.0; 4], [0.0; 4], 0);
    let mut usual = f64::INFINITY;
    for _ in 0..ROUNDS {
        let here = turned(turn)?;
        let rows: Vec<(Vec<f64>, f64, f64)> = (0..pairs.len())
            .filter_map(|at| {
                let ((a, va), (b, vb)) = (log(&there[at])?, log(&here[at])?);
                let slopes = [slopes[0][at]?, slopes[1][at]?, slopes[2][at]?];
                // ln base = ln scale + ln other(turned further).
                let row = vec![1.0, slopes[0], slopes[1], slopes[2]];
                let weight = (va + vb + LEAST * LEAST).recip();
                Some((row, a - b, weight))
            })
            .collect();
        overlap = rows.len();
        if overlap < FEWEST {
            return Err(FillError::NoOverlap {
                path: other.path().display().to_string(),
                first: base.path().display().to_string(),
                expected: FEWEST,
                found: overlap,
            });
        }
        let so_far = turn.to_scaled_axis();
        let priors = (0..3).map(|axis| {
            let mut row = vec![0.0; 4];
            row[axis + 1] = 1.0;
            (row, -so_far[axis], prior)
        });
        let kept = rows
            .iter()
            .filter(|(_, target, weight)| (target - found[0]).abs() * weight.sqrt() <= 3.0 * usual)
            .cloned();
        let (solved, covariance) =
            least_squares(4, kept.chain(priors)).ok_or_else(|| FillError::NoOverlap {
                path: other.path().display().to_string(),
                first: base.path().display().to_string(),
                expected: FEWEST,
                found: overlap,
            })?;
        let residual = |(row, target, weight): &(Vec<f64>, f64, f64)| {
            let model: f64 = row.iter().zip(solved.iter()).map(|(a, b)| a * b).sum();
            (target - model).abs() * weight.sqrt()
        };
        let mut sizes: Vec<f64> = rows.iter().map(residual).collect();
        let middle = sizes.len() / 2;
        usual = 1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
        turn = DQuat::from_scaled_axis(DVec3::new(solved[1], solved[2], solved[3])) * turn;
        let total = turn.to_scaled_axis();
        found = [solved[0], total.x, total.y, total.z];
        // Residuals say how good the weights are.
        uncertainty = std::array::from_fn(|at| covariance[(at, at)].sqrt() * usual.max(1.0));
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

/// The incident directions `range` of all captures together; nothing if none has anything.
fn merged_chunk(
    captures: &[&Brdf],
    union: &Union,
    alignments: &[Alignment],
    range: Range<usize>,
    is_open: &dyn Fn(usize, usize) -> bool,
) -> Result<Option<BrdfRows>, FillError> {
    let base = captures[0];
    let (cells, channels) = (base.disk().len(), base.channels());
    let samples = range.len() * cells;
    let mut sums = vec![0.0_f64; samples * channels];
    let mut weights = vec![0.0_f64; samples * channels];
    // Σ w·σ.
    let mut roots = vec![0.0_f64; samples * channels];
    let mut provenance = vec![Provenance::Missing.code(); samples];
    let mut add = |sample: usize, f: &[f32], sigma: &[f32], scale: f64, code: u8| {
        if !is_open(range.start + sample / cells, sample % cells) {
            return;
        }
        for channel in 0..channels {
            let weight = (f64::from(sigma[channel]) * scale)
                .max(LEAST_SIGMA.into())
                .powi(-2);
            sums[sample * channels + channel] += weight * scale * f64::from(f[channel]);
            weights[sample * channels + channel] += weight;
            roots[sample * channels + channel] += weight.sqrt();
        }
        // With another capture in it, it is merged.
        provenance[sample] = if provenance[sample] == Provenance::Missing.code() {
            code
        } else {
            Provenance::Merged.code()
        };
    };
    let mut add_rows = |capture: usize, scale: f64| -> Result<(), StoreError> {
        let brdf = captures[capture];
        // The rows of a chunk mostly come from one of the capture.
        let mut held: Option<(usize, Option<BrdfRows>)> = None;
        for (place, row) in union.rows[capture][range.clone()].iter().enumerate() {
            let Some(row) = row.filter(|row| brdf.incident_reason(*row).is_none()) else {
                continue;
            };
            let length = brdf.chunk_range(0).len();
            if held.as_ref().is_none_or(|held| held.0 != row / length) {
                held = Some((row / length, brdf.chunk(row / length)?));
            }
            let Some((_, Some(rows))) = &held else { continue };
            for cell in 0..cells {
                let there = row % length * cells + cell;
                let code = rows.provenance[there];
                // What was filled in is made from what takes part already, or will be made anew.
                if !Provenance::from_code(code).is_some_and(Provenance::is_seen) {
                    continue;
                }
                let at = there * channels..(there + 1) * channels;
                let mut sigma = [0.0; 3];
                for (sigma, half) in sigma.iter_mut().zip(&rows.sigma[at.clone()]) {
                    *sigma = half.to_f32();
                }
                let code = if capture == 0 {
                    code
                } else {
                    Provenance::Merged.code()
                };
                add(place * cells + cell, &rows.f[at], &sigma, scale, code);
            }
        }
        Ok(())
    };
    add_rows(0, 1.0)?;
    for (capture, alignment) in (1..).zip(alignments) {
        if alignment.turn == DQuat::IDENTITY {
            add_rows(capture, alignment.scale)?;
        }
    }
    for (capture, alignment) in (1..).zip(alignments) {
        if alignment.turn == DQuat::IDENTITY {
            continue;
        }
        let has = |sample: &usize| union.rows[capture][range.start + sample / cells].is_some();
        let places: Vec<(usize, (DVec3, DVec3))> = (0..samples)
            .filter(has)
            .filter_map(|sample| {
                let wi = union.set.direction(range.start + sample / cells);
                let wo = base.disk().direction(sample % cells)?;
                Some((sample, (alignment.turn * wi, alignment.turn * wo)))
            })
            .collect();
        let pairs: Vec<(DVec3, DVec3)> = places.iter().map(|place| place.1).collect();
        for ((sample, _), found) in places.iter().zip(captures[capture].with_sigma(&pairs)?) {
            if let Some([f, sigma]) = found {
                add(*sample, &f, &sigma, alignment.scale, Provenance::Merged.code());
            }
        }
    }
    if provenance.iter().all(|code| *code == Provenance::Missing.code()) {
        return Ok(None);
    }
    // 0/0 is NaN, which is what stands where no capture has anything.
    let value = |sum: &f64, weight: &f64| (sum / weight) as f32;
    let mut rows = BrdfRows {
        f: sums
            .iter()
            .zip(&weights)
            .map(|(sum, weight)| value(sum, weight))
            .collect(),
        sigma: weights
            .iter()
            .zip(&roots)
            .map(|(weight, root)| {
                let variance = (1.0 - COMMON) / weight + COMMON * (root / weight).powi(2);
                f16::from_f64(variance.sqrt().min(USELESS_SIGMA.into()).max(LEAST_SIGMA.into()))
            })
            .collect(),
        provenance,
    };
    rows.seal();
    Ok(Some(rows))
}
