//! The answer to one query, gathered image by image.
//!
//! # Design
//! A query needs at most eight images: four around its incident direction, and four around its outgoing one, which are
//! read with the directions exchanged. They may come in any order, from memory or chunk by chunk from a file.

use glam::{DVec3, Vec3, Vec4};
use rayon::prelude::*;

use super::blend::{BACK, BRANCHES};
use super::captures::{Captures, Cells, Readable};
use super::lanes::Side;
use super::rule::{Captured, Query};
use super::{Blend, BranchErrors, ENOUGH};
use crate::hemisphere::incident::IncidentSet;
use crate::store::StoreError;

/// Images of one query.
const PARTS: usize = 8;
/// Those around the incident direction come first.
const FORTH: usize = 4;

/// One query.
#[derive(Clone, Debug)]
pub(crate) struct Lookup {
    wi: DVec3,
    wo: DVec3,
    rows: [u32; PARTS],
    weights: [f32; PARTS],
    shares: [f32; BRANCHES],
    /// Value × weight and weight of what was read forth, and of what was read back.
    sums: [Vec4; 2],
    /// Weight of what direct reading found: without it nothing was measured there.
    pub(crate) found: f32,
    /// Weight of what direct reading found saturated.
    pub(crate) saturated: f32,
    /// Largest code of provenance of the cells that took part.
    pub(crate) weakest: u8,
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
    /// Takes what the `images` of a side say, whose branches begin at `first`.
    fn take<R: Readable>(&mut self, side: &Side<'_>, first: usize, cells: &Cells, images: &[Option<R>; 4]) {
        let query = Query::new(side.pair, |rule| side.shares[rule] > 0.0);
        for ((image, captured), weight) in images.iter().zip(side.captured).zip(side.weights) {
            let Some(image) = image else { continue };
            query.readings(captured, |reading| {
                let read = image.read(cells, reading.wo);
                if read.weight <= 0.0 {
                    return;
                }
                let bend = cells.bend(*image, reading.wo);
                for rule in reading.rules.clone().filter(|&rule| side.shares[rule] > 0.0) {
                    let share = weight * side.shares[rule];
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
    /// The query for the pair (`wi`, `wo`), both above the horizon, of captures from `set`; `is_apart` keeps what the readings say one by
    /// one.
    fn new(set: &IncidentSet, blend: &Blend, (wi, wo): (DVec3, DVec3), is_apart: bool) -> Self {
        let shares = blend.shares(wi, wo);
        let mut rows = [0; PARTS];
        let mut weights = [0.0; PARTS];
        let mut put = |first: usize, w: DVec3| {
            // A file hands its images out in this order: however many at a time, sums are the same.
            let mut neighbours = set.neighbours(w);
            neighbours.sort_by_key(|neighbour| neighbour.0);
            for (place, (row, weight)) in neighbours.iter().enumerate() {
                (rows[first + place], weights[first + place]) = (*row as u32, *weight as f32);
            }
        };
        put(0, wi);
        if shares[BACK..].iter().any(|share| *share > 0.0) {
            put(FORTH, wo);
        }
        Self {
            wi,
            wo,
            rows,
            weights,
            shares,
            sums: [Vec4::ZERO; 2],
            found: 0.0,
            saturated: 0.0,
            weakest: 0,
            apart: is_apart.then(Box::default),
        }
    }

    /// The query for the pair (`wi`, `wo`), both above the horizon, answered from images that are all in memory; `captured` has the
    /// incident directions of `set`.
    #[inline]
    pub(crate) fn of<R: Readable>(
        (set, captured): (&IncidentSet, &[Captured]),
        cells: &Cells,
        blend: &Blend,
        pair: (DVec3, DVec3),
        image: impl Fn(usize) -> Option<R>,
    ) -> Self {
        let mut lookup = Self::new(set, blend, pair, false);
        lookup.gather_side(false, cells, captured, &image);
        lookup.gather_side(true, cells, captured, &image);
        lookup
    }

    /// The images that it needs.
    fn rows(&self) -> impl Iterator<Item = usize> + '_ {
        self.rows
            .iter()
            .zip(self.weights)
            .filter(|(_, weight)| *weight > 0.0)
            .map(|(row, _)| *row as usize)
    }

    /// Takes what the images of the rows `group` say.
    fn gather<R: Readable>(
        &mut self,
        cells: &Cells,
        captured: &[Captured],
        group: &std::ops::Range<usize>,
        image: impl Fn(usize) -> Option<R>,
    ) {
        let image = |row: usize| group.contains(&row).then(|| image(row)).flatten();
        self.gather_side(false, cells, captured, image);
        self.gather_side(true, cells, captured, image);
    }

    /// Takes what the images of one side say.
    #[inline]
    fn gather_side<R: Readable>(
        &mut self,
        is_back: bool,
        cells: &Cells,
        captured: &[Captured],
        image: impl Fn(usize) -> Option<R>,
    ) {
        let (begin, first) = if is_back { (FORTH, BACK) } else { (0, 0) };
        let (rows, weights) = (&self.rows[begin..], &self.weights[begin..]);
        let [a, b, c, d] = [rows[0], rows[1], rows[2], rows[3]].map(|row| row as usize);
        let weights = [weights[0], weights[1], weights[2], weights[3]];
        let of = |row: usize, weight: f32| if weight > 0.0 { image(row) } else { None };
        let images = [
            of(a, weights[0]),
            of(b, weights[1]),
            of(c, weights[2]),
            of(d, weights[3]),
        ];
        if images.iter().all(Option::is_none) {
            return;
        }
        let (forth, back) = self
            .shares
            .split_first_chunk()
            .expect("invariant: both have as many");
        let shares = if is_back { back.first_chunk() } else { Some(forth) };
        let side = Side {
            pair: if is_back {
                (self.wo, self.wi)
            } else {
                (self.wi, self.wo)
            },
            captured: [&captured[a], &captured[b], &captured[c], &captured[d]],
            weights,
            shares: shares.expect("invariant: both have as many"),
            is_back,
        };
        let said = side.read(cells, &images);
        if let Some(apart) = &mut self.apart {
            apart.take(&side, first, cells, &images);
        }
        for sum in said.sums {
            self.sums[usize::from(is_back)] += sum;
        }
        for (found, saturated) in said.found.into_iter().zip(said.saturated) {
            self.found += found;
            self.saturated += saturated;
        }
        self.weakest = self.weakest.max(said.weakest);
    }

    /// Value × weight, and weight of all that was read.
    fn sum(&self) -> (Vec3, f32) {
        let sum = self.sums[0] + self.sums[1];
        (sum.truncate(), sum.w)
    }

    /// f in sr⁻¹ if at least half of what direct interpolation needs was measured.
    pub(crate) fn value(&self) -> Option<[f32; 3]> {
        let (value, weight) = self.sum();
        (self.found >= ENOUGH && weight > 1e-6).then(|| (value / weight).to_array())
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
                for (share, (branch, weight)) in self.shares.iter().zip(apart.branches) {
                    if *share > 0.0 && weight > 1e-6 {
                        let off = branch / weight - value;
                        apart_by += *share * weight * off * off;
                        sum += *share * weight;
                    }
                }
                let shares = std::array::from_fn(|branch| {
                    let far = if branch < BACK { self.distance() } else { 1.0 };
                    [self.shares[branch], far]
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
        let beside = (1.0 - self.found).clamp(0.0, 1.0) * value.abs();
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
        let squares: f32 = self.weights[..FORTH].iter().map(|weight| weight * weight).sum();
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
    find(captures, blend, pairs, false)
}

/// As [`look_up`], with what tells [`Lookup::interpolation_error`]; takes 300 bytes more for each pair.
///
/// # Errors
/// [`StoreError`].
pub(crate) fn look_up_apart(
    captures: &impl Captures,
    blend: &Blend,
    pairs: &[(DVec3, DVec3)],
) -> Result<Vec<Lookup>, StoreError> {
    find(captures, blend, pairs, true)
}

fn find(
    captures: &impl Captures,
    blend: &Blend,
    pairs: &[(DVec3, DVec3)],
    is_apart: bool,
) -> Result<Vec<Lookup>, StoreError> {
    let mut lookups: Vec<Lookup> = pairs
        .par_iter()
        .map(|&pair| Lookup::new(captures.set(), blend, pair, is_apart))
        .collect();
    let mut wanted = vec![false; captures.set().len()];
    for row in lookups.iter().flat_map(Lookup::rows) {
        wanted[row] = true;
    }
    let captured = captured(captures);
    captures.scan(&wanted, &mut |group, image| {
        lookups
            .par_iter_mut()
            .for_each(|lookup| lookup.gather(captures.cells(), &captured, &group, image));
    })?;
    Ok(lookups)
}
