//! The answer to one query, gathered image by image.
//!
//! # Design
//! A query needs at most eight images: four around its incident direction, and four around its outgoing one, which are
//! read with the directions exchanged. They may come in any order, from memory or chunk by chunk from a file.

use std::ops::Range;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::answering::Sums;
use super::blend::{BACK, BRANCHES};
use super::captures::{Captures, Cells, Image, ImageOf, Readable};
use super::lanes::{FOUR, Notes};
use super::packed::Strides;
use super::prepared::{Pairs, Prepared, filled, of_lane, side};
use super::rule::{Captured, Query};
use super::{Blend, BranchErrors};
use crate::base::eight::LANES;
use crate::hemisphere::incident::IncidentSet;
use crate::store::StoreError;

/// One query, whose images may come in any order.
#[derive(Clone, Debug)]
pub(crate) struct Lookup {
    wi: DVec3,
    wo: DVec3,
    /// Images of both sides, and how much each counts.
    rows: [[u32; FOUR]; 2],
    weights: [[f32; FOUR]; 2],
    shares: [[f32; BACK]; 2],
    /// What was read forth, and what was read back.
    sums: [Sums; 2],
    /// If that was asked for.
    apart: Option<Box<Apart>>,
}

/// What the readings say one by one, from which it shows how wrong their mean may be.
#[derive(Clone, Debug, Default)]
struct Apart {
    /// Value × weight and weight of each branch.
    branches: [(Vec3, f32); BRANCHES],
    /// Value × weight and weight of all readings: what is compared with them is their own mean, whose rounding is theirs.
    all: (Vec3, f32),
    /// Sum of weight × value² over all readings.
    squares: Vec3,
    /// Sum of weight × what linear interpolation between cells may be off by.
    bends: Vec3,
}

impl Apart {
    /// Takes what the `images` say that are read for the `pair` by the branches from `first` on, of which these are the `shares`; each
    /// comes with its incident direction and weight.
    fn take<'a, R: Readable + 'a>(
        &mut self,
        cells: &Cells,
        pair: (DVec3, DVec3),
        (first, shares): (usize, &[f32]),
        images: impl Iterator<Item = ((&'a Option<R>, &'a Captured), f32)>,
    ) {
        let query = Query::new(pair, |rule| shares[rule] > 0.0);
        for ((image, captured), weight) in images {
            let Some(image) = image else { continue };
            query.readings(captured, |reading| {
                let read = image.read(cells, reading.wo);
                if read.weight <= 0.0 {
                    return;
                }
                let bend = cells.bend(*image, reading.wo);
                for rule in reading.rules.clone().filter(|&rule| shares[rule] > 0.0) {
                    let share = weight * shares[rule];
                    let factor = reading.factor(rule) as f32;
                    let value = factor * read.value;
                    let branch = &mut self.branches[first + rule];
                    branch.0 += weight * value;
                    branch.1 += weight * read.weight;
                    self.all.0 += share * value;
                    self.all.1 += share * read.weight;
                    self.squares += share * value * value / read.weight;
                    self.bends += share * read.weight * factor * bend;
                }
            });
        }
    }
}

impl Lookup {
    /// The queries for eight pairs of captures from `set`; `is_apart` keeps what the readings say one by one.
    fn eight(set: &IncidentSet, blend: &Blend, pairs: &Pairs, is_apart: bool) -> [Self; LANES] {
        let prepared = Prepared::new(blend, pairs);
        let forth = prepared.neighbours(set, false);
        let back = blend.reads_back().then(|| prepared.neighbours(set, true));
        std::array::from_fn(|lane| {
            let shares = [false, true].map(|is_back| *prepared.side(lane, is_back));
            let (rows, weights) = of_lane(&forth, lane);
            let is_back = shares[1].iter().any(|share| *share > 0.0);
            let nothing = ([0; FOUR], [0.0; FOUR]);
            let back = back.as_ref().filter(|_| is_back);
            let (rows_back, weights_back) = back.map_or(nothing, |back| of_lane(back, lane));
            Self {
                wi: pairs[lane].0,
                wo: pairs[lane].1,
                rows: [rows, rows_back],
                weights: [weights, weights_back],
                shares,
                sums: [Sums::default(); 2],
                apart: is_apart.then(Box::default),
            }
        })
    }

    /// The queries for pairs (incident, outgoing) of captures from `set`, all above the horizon; `is_apart` keeps what tells
    /// [`interpolation_error`](Self::interpolation_error), 300 bytes more for each.
    pub(crate) fn all(
        set: &IncidentSet,
        blend: &Blend,
        pairs: &[(DVec3, DVec3)],
        is_apart: bool,
    ) -> Vec<Self> {
        let eight = |pairs: &[(DVec3, DVec3)]| {
            let eight = Self::eight(set, blend, &filled(pairs), is_apart);
            eight.into_iter().take(pairs.len())
        };
        pairs.par_chunks(LANES).flat_map_iter(eight).collect()
    }

    /// The same query of which nothing was answered and nothing is kept apart.
    pub(crate) fn plain(&self) -> Self {
        Self {
            sums: [Sums::default(); 2],
            apart: None,
            ..*self
        }
    }

    /// Which of so many `images` they need.
    pub(crate) fn wanted(lookups: &[Self], images: usize) -> Vec<bool> {
        let mut wanted = vec![false; images];
        for row in lookups.iter().flat_map(Self::rows) {
            wanted[row] = true;
        }
        wanted
    }

    /// Each takes what the images of the rows `group` say.
    pub(crate) fn gather_all(
        lookups: &mut [Self],
        cells: &Cells,
        captured: &[Captured],
        group: &Range<usize>,
        image: ImageOf<'_>,
    ) {
        lookups.par_iter_mut().for_each_init(
            || Notes::of(1),
            |notes, lookup| lookup.gather(cells, captured, group, image, notes),
        );
    }

    /// The images that it needs.
    fn rows(&self) -> impl Iterator<Item = usize> + '_ {
        let all = self.rows.as_flattened().iter().zip(self.weights.as_flattened());
        all.filter(|(_, weight)| **weight > 0.0)
            .map(|(row, _)| *row as usize)
    }

    /// Takes what the images of the rows `group` say.
    fn gather<'a>(
        &mut self,
        cells: &Cells,
        captured: &[Captured],
        group: &Range<usize>,
        image: impl Fn(usize) -> Option<Image<'a>>,
        notes: &mut Notes,
    ) {
        for is_back in [false, true] {
            let at = usize::from(is_back);
            let (rows, mut weights) = (self.rows[at], self.weights[at]);
            let mut images = [None; FOUR];
            for (found, (row, weight)) in images.iter_mut().zip(rows.into_iter().zip(&mut weights)) {
                if *weight > 0.0 && group.contains(&(row as usize)) {
                    *found = image(row as usize);
                }
                *weight = if found.is_some() { *weight } else { 0.0 };
            }
            if images.iter().all(Option::is_none) {
                continue;
            }
            let pair = if is_back {
                (self.wo, self.wi)
            } else {
                (self.wi, self.wo)
            };
            let shares = self.shares[at];
            let side = side(pair, captured, (rows, weights), &shares, is_back);
            notes.clear();
            side.note::<Image<'_>>(0, cells, Strides::rows(cells.disk.size()), notes);
            notes.read(cells, &[images]);
            self.sums[at].add(notes.said(0));
            if let Some(apart) = &mut self.apart {
                apart.take(
                    cells,
                    pair,
                    (BACK * at, &shares),
                    images.iter().zip(side.captured).zip(weights),
                );
            }
        }
    }

    /// Weight of what direct reading found saturated.
    pub(crate) fn saturated(&self) -> f32 {
        self.sums[0].saturated
    }

    /// Largest code of provenance of the cells that took part.
    pub(crate) fn weakest(&self) -> u8 {
        self.sums[0].weakest.max(self.sums[1].weakest)
    }

    /// f in sr⁻¹ if at least half of what direct interpolation needs was measured.
    pub(crate) fn value(&self) -> Option<[f32; 3]> {
        let [forth, back] = &self.sums;
        Sums::value(forth, back).ok()
    }

    /// Standard uncertainty (k = 1) of the value in sr⁻¹ by interpolation, if it was looked up with that: what the branches are wrong by
    /// where images were left out (`errors`), as far as the pair lies from the images and no more than the images differ here; by how much
    /// the branches differ; what the images bend between their cells; and by as much of the value as is missing around it. Without `errors` it is the standard deviation of the images.
    pub(crate) fn interpolation_error(&self, errors: Option<&BranchErrors>) -> Option<[f32; 3]> {
        self.value()?;
        let apart = self.apart.as_ref()?;
        let (sum, weight) = apart.all;
        let weight = weight.max(1e-6);
        let value = sum / weight;
        let bend = apart.bends / weight;
        let spread = (apart.squares / weight - value * value).max(Vec3::ZERO);
        let variance = match errors {
            None => spread,
            Some(errors) => {
                let (mut apart_by, mut sum) = (Vec3::ZERO, 0.0);
                for (share, (branch, weight)) in self.shares.as_flattened().iter().zip(apart.branches) {
                    if *share > 0.0 && weight > 1e-6 {
                        let off = branch / weight - value;
                        apart_by += *share * weight * off * off;
                        sum += *share * weight;
                    }
                }
                let shares = std::array::from_fn(|branch| {
                    let far = if branch < BACK { self.distance() } else { 1.0 };
                    [self.shares.as_flattened()[branch], far]
                });
                let left_out = value.to_array().map(|f| {
                    let sigma = errors.of_blend(self.wi, self.wo, f64::from(f), &shares) as f32;
                    sigma * sigma
                });
                // Regions are wide: where the images hardly differ, no mean of them is off by more than that.
                apart_by / f32::max(sum, 1e-6) + Vec3::from(left_out).min(spread)
            }
        };
        // What is missing lies on one side, and the mean of the others elsewhere: nobody knows how f goes on there.
        let beside = (1.0 - self.sums[0].found).clamp(0.0, 1.0) * value.abs();
        Some(
            (variance + bend * bend + beside * beside)
                .map(f32::sqrt)
                .to_array(),
        )
    }

    /// Mean of what the readings say one by one, in double precision, if it was looked up with that.
    #[cfg(test)]
    pub(super) fn mean_of_readings(&self) -> Option<[f32; 3]> {
        let (sum, weight) = self.apart.as_ref()?.all;
        Some((sum / weight).to_array())
    }

    /// How far the incident direction lies from the images around it, where 1 is half way between two: the error of linear interpolation,
    /// t(1 − t), over its largest.
    fn distance(&self) -> f32 {
        let squares: f32 = self.weights[0].iter().map(|weight| weight * weight).sum();
        (2.0 * (1.0 - squares)).clamp(0.0, 1.0)
    }
}

/// Incident directions of all images, which would else be computed for every look-up.
pub(crate) fn captured(captures: &impl Captures) -> Vec<Captured> {
    let set = captures.set();
    (0..set.len())
        .map(|row| Captured::new(set.direction(row)))
        .collect()
}

/// Looks the pairs (incident, outgoing) up, all above the horizon.
///
/// # Errors
/// [`StoreError`] if the captures cannot be read.
pub(crate) fn look_up(
    captures: &impl Captures,
    blend: &Blend,
    pairs: &[(DVec3, DVec3)],
) -> Result<Vec<Lookup>, StoreError> {
    answered(captures, Lookup::all(captures.set(), blend, pairs, false))
}

/// As [`look_up`], with what tells [`Lookup::interpolation_error`].
#[cfg(test)]
pub(super) fn look_up_apart(
    captures: &impl Captures,
    blend: &Blend,
    pairs: &[(DVec3, DVec3)],
) -> Result<Vec<Lookup>, StoreError> {
    answered(captures, Lookup::all(captures.set(), blend, pairs, true))
}

fn answered(captures: &impl Captures, mut lookups: Vec<Lookup>) -> Result<Vec<Lookup>, StoreError> {
    let wanted = Lookup::wanted(&lookups, captures.set().len());
    let captured = captured(captures);
    captures.scan(&wanted, &mut |group, image| {
        Lookup::gather_all(&mut lookups, captures.cells(), &captured, &group, image);
    })?;
    Ok(lookups)
}
