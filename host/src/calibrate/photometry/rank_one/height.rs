//! How high the standard stands: where to begin with what part of it is seen.
//!
//! # Design
//! Pixels look along ω_o at a place of the sample, and light from ω_i comes to another, that lie h·(tanθ_o − tanθ_i) apart (as
//! vectors) where the sample stands by h beside the height at which both should meet. Some millimetres take all light from pairs
//! that graze, and no fit finds out of that by itself. So heights are tried: of each, light and throughput are fitted to the pairs
//! that should be wholly lit, by a few terms, and what all pairs show over that, dark ones too, is compared with their shares. What
//! is far off counts as far, and no farther.
//!
//! A standard that is tilted tells the offset along another normal. Patches at h and at −h differ in the second order only: which of both
//! it is, is less certain than how far. Where a fit that begins on one side leaves much, the others that could be are tried too.

use std::iter;

use glam::DVec3;
use nalgebra::DVector;
use rayon::prelude::*;

use super::{Seen, dot};
use crate::base::linear_fit::least_squares;
use crate::instrument::calibration::{SeenPart, terms};
use crate::instrument::optics::SampleFrame;

/// Heights that are tried, metres: up to this, in such steps, and then around those of least cost. Where the height is right within some
/// 0.2 mm the cost falls to a tenth of what it is beside it, and a plateau lies where all should be lit.
const HIGHEST_M: f64 = 9e-3;
const STEP_M: f64 = 3e-4;
const FINE_M: f64 = 7.5e-5;
/// Heights that are told apart, at most.
const MINIMA: usize = 4;
/// Least part of a normal across the others that tells anything.
const NEW: f64 = 0.3;
/// Pairs that take part, about, and the least of them that are wholly lit.
const PAIRS: usize = 5000;
const LEAST_PAIRS: usize = 300;
/// Terms of either field: up to the fourth degree.
const TERMS: usize = 14;
/// Share that counts as whole.
const WHOLE: f64 = 0.97;
/// Rounds of weights, and what is this far from the fields counts little in them.
const ROUNDS: usize = 3;
const FAR: f64 = 0.05;
/// Differences of shares count up to this.
const MOST: f64 = 0.25;

/// A pair, or one too dark for a logarithm.
struct Spotted {
    pixel: usize,
    place: usize,
    /// Of both fields, and 1.
    row: Vec<f64>,
    /// ln q; `None` if it is dark.
    log: Option<f64>,
}

/// The axes along which the place of the standard shows, mirror frame, orthonormal, each with the stand that tells it: the normal of the
/// first, and of each other what its normal has across those before, if that is much.
fn known_axes(seen: &[Seen]) -> Vec<(usize, DVec3)> {
    let mut known: Vec<(usize, DVec3)> = Vec::new();
    for (stand, seen) in seen.iter().enumerate() {
        let new = across(&known, normal(seen));
        // Stands that are alike say the same.
        if new.length() > NEW {
            known.push((stand, new.normalize()));
        }
    }
    known
}

/// The axes, mirror frame, orthonormal, along which nothing that was `seen` tells where the standard is: where it moves along them what
/// is seen of it stays the same, but for its own edge.
pub(in super::super) fn unknown_axes(seen: &[Seen]) -> Vec<DVec3> {
    let known = known_axes(seen);
    let mut all = known.clone();
    while all.len() < 3 {
        let rest = DVec3::AXES.map(|axis| across(&all, axis));
        let longest = rest.into_iter().max_by(|a, b| a.length().total_cmp(&b.length()));
        all.push((0, longest.expect("invariant: there are axes").normalize()));
    }
    all[known.len()..].iter().map(|(_, axis)| *axis).collect()
}

/// What `w` has across all of the `axes`.
fn across(axes: &[(usize, DVec3)], w: DVec3) -> DVec3 {
    axes.iter()
        .fold(w, |left, (_, axis)| left - left.dot(*axis) * *axis)
}

/// The normal of the standard, mirror frame.
pub(super) fn normal(seen: &Seen) -> DVec3 {
    SampleFrame::of(&seen.rig.sample).to_mirror(DVec3::Z)
}

/// `part` with the height of the standard, at each stand of `seen` that tells one: as it explains best what is lit, and after that with
/// one of the heights as it does only better than what is a little higher or lower.
pub(in super::super) fn with_heights(seen: &[Seen], part: SeenPart) -> impl Iterator<Item = SeenPart> {
    // Along what no stand before knows of, so far that it is so high along the normal.
    let of = |(stand, axis): (usize, DVec3)| (&seen[stand], axis / axis.dot(normal(&seen[stand])));
    let known: Vec<(&Seen, DVec3)> = known_axes(seen).into_iter().map(of).collect();
    let at_best = |part: SeenPart, heights_m: &[f64], step: DVec3| match heights_m.first() {
        Some(height_m) => part.displaced(step * *height_m),
        None => part,
    };
    let mut best = part;
    let mut others = Vec::new();
    for (at, (seen, step)) in known.iter().enumerate() {
        let heights_m = seen.heights_m(&best, *step);
        let next = at_best(best.clone(), &heights_m, *step);
        let other = |height_m: &f64| (at + 1, best.displaced(*step * *height_m));
        others.extend(heights_m.iter().skip(1).map(other));
        best = next;
    }
    iter::once(best).chain(others.into_iter().map(move |(next, part)| {
        known[next..].iter().fold(part, |part, (seen, step)| {
            let heights_m = seen.heights_m(&part, *step);
            at_best(part, &heights_m, *step)
        })
    }))
}

impl Seen<'_> {
    /// The heights in metres that explain which pairs are lit better than those beside them, best first, [`MINIMA`] at most; a height of 1
    /// moves the sample by `step`.
    fn heights_m(&self, part: &SeenPart, step: DVec3) -> Vec<f64> {
        let spotted = self.spotted();
        let costs = |heights: Vec<f64>| -> Vec<(f64, f64)> {
            let cost = |height_m: f64| self.cost(&part.displaced(step * height_m), &spotted);
            heights
                .into_par_iter()
                .map(|height_m| (cost(height_m).unwrap_or(f64::INFINITY), height_m))
                .collect()
        };
        let around = |middle_m: f64, reach_m: f64, step_m: f64| -> Vec<f64> {
            let steps = (reach_m / step_m).round() as i32;
            (-steps..=steps)
                .map(|step| f64::from(step).mul_add(step_m, middle_m))
                .collect()
        };
        let by_cost = |a: &(f64, f64), b: &(f64, f64)| a.0.total_cmp(&b.0);
        let coarse = costs(around(0.0, HIGHEST_M, STEP_M));
        let is_least = |at: usize| {
            let beside = [at.checked_sub(1), Some(at + 1)];
            let mut beside = beside.into_iter().flatten().filter_map(|at| coarse.get(at));
            coarse[at].0.is_finite() && beside.all(|beside| coarse[at].0 <= beside.0)
        };
        let mut minima: Vec<(f64, f64)> = (0..coarse.len())
            .filter(|at| is_least(*at))
            .map(|at| coarse[at])
            .collect();
        minima.sort_by(by_cost);
        minima.truncate(MINIMA);
        let fine = minima.iter().filter_map(|(_, at_m)| {
            let fine = costs(around(*at_m, STEP_M, FINE_M));
            fine.into_iter().min_by(by_cost)
        });
        let mut fine: Vec<(f64, f64)> = fine.collect();
        fine.sort_by(by_cost);
        fine.into_iter().map(|(_, height_m)| height_m).collect()
    }

    /// Pairs of the first channel, and those that are dark, thinned.
    fn spotted(&self) -> Vec<Spotted> {
        let place_of: std::collections::HashMap<usize, [f64; 2]> =
            self.pixels.iter().map(|(index, at, _)| (*index, *at)).collect();
        let bright = self.pairs.iter().filter(|pair| pair.channel == 0);
        let bright = bright.map(|pair| (pair.pixel as usize, pair.place as usize, Some(pair.log)));
        let dark = self
            .dark
            .iter()
            .map(|(pixel, place)| (*pixel as usize, *place as usize, None));
        let all: Vec<_> = bright.chain(dark).collect();
        let every = (all.len() / PAIRS).max(1);
        let spotted = all.into_iter().step_by(every).filter_map(|(pixel, place, log)| {
            let [x, y] = *place_of.get(&pixel)?;
            let ([u, v], _) = self.lit[place]?;
            let mut row = vec![1.0; 1 + 2 * TERMS];
            row[1..=TERMS].copy_from_slice(&terms(x, y)[..TERMS]);
            row[TERMS + 1..].copy_from_slice(&terms(u, v)[..TERMS]);
            Some(Spotted {
                pixel,
                place,
                row,
                log,
            })
        });
        spotted.collect()
    }

    /// How badly `part` explains what is `spotted`; `None` if too few pairs should be wholly lit.
    fn cost(&self, part: &SeenPart, spotted: &[Spotted]) -> Option<f64> {
        let patches = self.patches_of(part);
        let shares: Vec<f64> = spotted
            .iter()
            .map(|one| patches.share(one.place, one.pixel))
            .collect();
        let whole: Vec<(&Spotted, f64)> = spotted
            .iter()
            .zip(&shares)
            .filter(|(_, share)| **share > WHOLE)
            .filter_map(|(one, _)| Some((one, one.log?)))
            .collect();
        if whole.len() < LEAST_PAIRS {
            return None;
        }
        let mut fields = DVector::zeros(1 + 2 * TERMS);
        for round in 0..ROUNDS {
            let rows = whole.iter().map(|(one, log)| {
                let left = log - dot(&one.row, &fields);
                let weight = if round == 0 {
                    1.0
                } else {
                    (1.0 + (left / FAR).powi(2)).recip()
                };
                (one.row.clone(), *log, weight)
            });
            let held = (1..=2 * TERMS).map(|term| {
                let mut row = vec![0.0; 1 + 2 * TERMS];
                row[term] = 1.0;
                (row, 0.0, 1.0)
            });
            fields = least_squares(1 + 2 * TERMS, rows.chain(held))?.0;
        }
        let costs = spotted.iter().zip(&shares).map(|(one, share)| {
            let shown = one
                .log
                .map_or(0.0, |log| (log - dot(&one.row, &fields)).min(1.0).exp());
            (shown - share).clamp(-MOST, MOST).powi(2)
        });
        Some(costs.sum())
    }
}
