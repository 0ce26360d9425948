//! The answer to one query, gathered image by image.
//!
//! # Design
//! A query needs at most eight images: four around its incident direction, and four around its outgoing one, which are
//! read with the directions exchanged. They may come in any order, from memory or chunk by chunk from a file.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::Blend;
use super::blend::{BACK, BRANCHES};
use super::captures::{Captures, Cells, ImageOf};
use super::rule::{DIRECT, readings};
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
}

impl Lookup {
    /// The query for the pair (`wi`, `wo`), both above the horizon, of captures from `set`.
    fn new(set: &IncidentSet, blend: &Blend, wi: DVec3, wo: DVec3) -> Self {
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
        }
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
                for rule in reading.rules.clone().filter(|&rule| shares[rule] > 0.0) {
                    let share = weight * shares[rule];
                    self.value += share * reading.factor(rule) as f32 * read.value;
                    self.weight += share * read.weight;
                }
            }
        }
    }

    /// f in sr⁻¹ if at least half of what direct interpolation needs was measured.
    pub(crate) fn value(&self) -> Option<[f32; 3]> {
        (self.found >= 0.5 && self.weight > 1e-6).then(|| (self.value / self.weight).to_array())
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
    let mut lookups: Vec<Lookup> = pairs
        .par_iter()
        .map(|&(wi, wo)| Lookup::new(captures.set(), blend, wi, wo))
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
