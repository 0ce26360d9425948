//! The answer to one query, gathered image by image.
//!
//! # Design
//! A query needs at most eight images: four around its incident direction, and four around its outgoing one, which are
//! read with the directions exchanged. They may come in any order, from memory or chunk by chunk from a file.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::blend::{BACK, BRANCHES};
use super::captures::{Captures, Cells, ImageOf};
use super::rule::{DIRECT, readings};
use super::{Blend, BranchErrors};
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
    value: Vec3,
    weight: f32,
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
    /// Sum of weight × value² over all readings.
    squares: Vec3,
    /// Sum of weight × what linear interpolation between cells may be off by.
    bends: Vec3,
}

impl Lookup {
    /// The query for the pair (`wi`, `wo`), both above the horizon, of captures from `set`; `is_apart` keeps what the readings say one by
    /// one.
    fn new(set: &IncidentSet, blend: &Blend, (wi, wo): (DVec3, DVec3), is_apart: bool) -> Self {
        let shares = blend.shares(wi, wo);
        let mut rows = [0; PARTS];
        let mut weights = [0.0; PARTS];
        let mut put = |first: usize, w: DVec3| {
            for (place, (row, weight)) in (first..).zip(set.neighbours(w)) {
                (rows[place], weights[place]) = (row as u32, weight as f32);
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
            value: Vec3::ZERO,
            weight: 0.0,
            found: 0.0,
            saturated: 0.0,
            weakest: 0,
            apart: is_apart.then(Box::default),
        }
    }

    /// The query for the pair (`wi`, `wo`), both above the horizon, answered from images that are all in memory; `set` has the incident
    /// directions twice, the second time one by one.
    pub(crate) fn of(
        (set, directions): (&IncidentSet, &[DVec3]),
        cells: &Cells,
        blend: &Blend,
        pair: (DVec3, DVec3),
        image: ImageOf,
    ) -> Self {
        let mut lookup = Self::new(set, blend, pair, false);
        lookup.gather(cells, directions, &(0..directions.len()), image);
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
    fn gather(
        &mut self,
        cells: &Cells,
        directions: &[DVec3],
        group: &std::ops::Range<usize>,
        image: ImageOf,
    ) {
        for part in 0..PARTS {
            let (row, weight) = (self.rows[part] as usize, self.weights[part]);
            if weight == 0.0 || !group.contains(&row) {
                continue;
            }
            let Some(image) = image(row) else { continue };
            let back = part >= FORTH;
            let pair = if back {
                (self.wo, self.wi)
            } else {
                (self.wi, self.wo)
            };
            let shares = if back {
                &self.shares[BACK..]
            } else {
                &self.shares[..BACK]
            };
            // Direct reading forth says whether anything was measured here, even if its share is nothing.
            let wanted = |rule: usize| shares[rule] > 0.0 || (rule == DIRECT && !back);
            for reading in readings(pair, directions[row], wanted) {
                let read = cells.read(image, reading.wo);
                if reading.rules.start == DIRECT && !back {
                    self.found += weight * read.weight;
                    self.saturated += weight * read.saturated;
                }
                let first = if back { BACK } else { 0 };
                let bend = self.apart.is_some().then(|| cells.bend(image, reading.wo));
                for rule in reading.rules.clone().filter(|&rule| shares[rule] > 0.0) {
                    let share = weight * shares[rule];
                    let factor = reading.factor(rule) as f32;
                    self.value += share * factor * read.value;
                    self.weight += share * read.weight;
                    self.weakest = self.weakest.max(read.weakest);
                    if let Some(apart) = self.apart.as_mut().filter(|_| read.weight > 0.0) {
                        let (value, bend) = (factor * read.value, factor * bend.unwrap_or_default());
                        let branch = &mut apart.branches[first + rule];
                        branch.0 += weight * value;
                        branch.1 += weight * read.weight;
                        apart.squares += share * value * value / read.weight;
                        apart.bends += share * read.weight * bend;
                    }
                }
            }
        }
    }

    /// f in sr⁻¹ if at least half of what direct interpolation needs was measured.
    pub(crate) fn value(&self) -> Option<[f32; 3]> {
        (self.found >= 0.5 && self.weight > 1e-6).then(|| (self.value / self.weight).to_array())
    }

    /// Standard uncertainty (k = 1) of the value in sr⁻¹ by interpolation, if it was looked up with that: what the branches are wrong by
    /// where images were left out (`errors`), as far as the pair lies from the images and no more than the images differ here; by how much
    /// the branches differ; what the images bend between their cells; and by as much of the value as is missing around it. Without `errors` it is the standard deviation of the images.
    pub(crate) fn interpolation_error(&self, errors: Option<&BranchErrors>) -> Option<[f32; 3]> {
        let (apart, value) = (self.apart.as_ref()?, Vec3::from(self.value()?));
        let bend = apart.bends / self.weight;
        let spread = (apart.squares / self.weight - value * value).max(Vec3::ZERO);
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

    /// How far the incident direction lies from the images around it, where 1 is half way between two: the error of linear interpolation,
    /// t(1 − t), over its largest.
    fn distance(&self) -> f32 {
        let squares: f32 = self.weights[..FORTH].iter().map(|weight| weight * weight).sum();
        (2.0 * (1.0 - squares)).clamp(0.0, 1.0)
    }
}

/// Incident directions of all images, which would else be computed for every look-up.
pub(super) fn directions(captures: &impl Captures) -> Vec<DVec3> {
    let set = captures.set();
    (0..set.len()).map(|row| set.direction(row)).collect()
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
    let directions = directions(captures);
    captures.scan(&wanted, &mut |group, image| {
        lookups
            .par_iter_mut()
            .for_each(|lookup| lookup.gather(captures.cells(), &directions, &group, image));
    })?;
    Ok(lookups)
}
