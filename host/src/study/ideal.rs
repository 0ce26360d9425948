//! What an ideal instrument captures of a known sample, and what can be looked up in it.
//!
//! # Design
//! No hole, no noise, no blur: f of the sample itself for every direction of the incident grid and the centre of
//! every cell of the outgoing disk. Look-ups interpolate linearly in all four angles, as those in a measured table
//! do. The table is never made: at 0.5° and 256 × 256 cells it would take 100 GB. Queries are sorted by incident
//! direction instead, and only the cells that they touch are evaluated.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::brdf::reflectance::Reflectance;
use crate::brdf::reflectance::{Missing, Value};
use crate::brdf::sample::Sample;
use crate::hemisphere::disk::Disk;
use crate::hemisphere::incident::IncidentSet;
use crate::store::StoreError;

/// Neighbours in the incident grid.
const TERMS: usize = 4;

/// The captures.
#[derive(Clone, Debug)]
pub struct IdealCaptures<'a> {
    sample: &'a dyn Sample,
    set: IncidentSet,
    disk: Disk,
    /// Centres of the cells; `None` beyond the horizon.
    cells: Vec<Option<DVec3>>,
}

impl<'a> IdealCaptures<'a> {
    /// Captures of `sample` from the directions of `set`, each resolved as `disk`.
    #[must_use]
    pub fn new(sample: &'a dyn Sample, set: IncidentSet, disk: Disk) -> Self {
        let cells = (0..disk.len()).map(|index| disk.direction(index)).collect();
        Self {
            sample,
            set,
            disk,
            cells,
        }
    }

    /// Cells around `wo` that the table has, with weights that sum to 1.
    fn around(&self, wo: DVec3) -> [(usize, f64); 4] {
        let mut cells = self
            .disk
            .neighbours(wo)
            .expect("invariant: wo is above the horizon");
        let held = |cells: &[(usize, f64); 4]| -> f64 {
            cells
                .iter()
                .filter(|cell| self.cells[cell.0].is_some())
                .map(|cell| cell.1)
                .sum()
        };
        let mut weight = held(&cells);
        if weight < 1e-9 {
            // At the horizon the centres of all four may lie beyond it: the next cell inwards stands in.
            let outwards: DVec2 = wo.truncate().normalize();
            let inwards = 2.0 / self.disk.size() as f64;
            let sin = 1.0 - inwards.min(0.5);
            cells = self
                .disk
                .neighbours((outwards * sin).extend((1.0 - sin * sin).sqrt()))
                .expect("invariant: above the horizon");
            weight = held(&cells);
        }
        cells.map(|(cell, w)| {
            (
                cell,
                if self.cells[cell].is_some() {
                    w / weight
                } else {
                    0.0
                },
            )
        })
    }
}

impl IdealCaptures<'_> {
    /// f for `pairs`, on one thread.
    fn look_all_up(&self, pairs: &[(DVec3, DVec3)]) -> Vec<Value> {
        let is_above = |&(wi, wo): &(DVec3, DVec3)| Missing::at_horizon(wi, wo).is_none();
        let neighbours: Vec<_> = pairs.iter().map(|pair| self.set.neighbours(pair.0)).collect();
        let around: Vec<_> = pairs
            .iter()
            .map(|pair| {
                if is_above(pair) {
                    self.around(pair.1)
                } else {
                    [(0, 0.0); 4]
                }
            })
            .collect();
        // A term is a query and one of its neighbours; a counting sort puts those of a row side by side.
        let rows = || {
            let above = neighbours
                .iter()
                .zip(pairs)
                .enumerate()
                .filter(|(_, (_, pair))| is_above(pair));
            above.flat_map(|(query, (rows, _))| {
                let terms = rows.iter().enumerate().filter(|(_, row)| row.1 > 0.0);
                terms.map(move |(k, row)| (row.0, TERMS * query + k))
            })
        };
        let mut ends = vec![0_usize; self.set.len() + 1];
        rows().for_each(|(row, _)| ends[row + 1] += 1);
        for row in 0..self.set.len() {
            ends[row + 1] += ends[row];
        }
        let mut next = ends.clone();
        let mut terms = vec![0; ends[self.set.len()]];
        rows().for_each(|(row, term)| {
            terms[next[row]] = term;
            next[row] += 1;
        });

        let mut sums = vec![[0.0_f64; 3]; pairs.len()];
        for (row, range) in ends
            .windows(2)
            .enumerate()
            .filter(|(_, range)| range[0] < range[1])
        {
            let terms = &terms[range[0]..range[1]];
            let lit = self.sample.incident(self.set.direction(row));
            // Where more is asked than the capture has cells, each is evaluated once.
            let is_dense = 4 * terms.len() > self.disk.len();
            let mut seen = vec![None; if is_dense { self.disk.len() } else { 0 }];
            for term in terms {
                let (query, share) = (term / TERMS, neighbours[term / TERMS][term % TERMS].1);
                for (cell, weight) in around[query] {
                    let Some(wo) = self.cells[cell].filter(|_| weight > 0.0) else {
                        continue;
                    };
                    let f = match seen.get_mut(cell) {
                        Some(seen) => *seen.get_or_insert_with(|| lit.f(wo)),
                        None => lit.f(wo),
                    };
                    sums[query] = std::array::from_fn(|c| sums[query][c] + share * weight * f[c]);
                }
            }
        }
        let conclude = |(&(wi, wo), sum): (&(DVec3, DVec3), [f64; 3])| {
            let missing = Missing::at_horizon(wi, wo);
            missing.map_or_else(|| Ok(sum.map(|f| f as f32)), Err)
        };
        pairs.iter().zip(sums).map(conclude).collect()
    }
}

impl Reflectance for IdealCaptures<'_> {
    fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
        // Few large parts: each prepares the incident directions that it meets by itself.
        let part = pairs.len().div_ceil(2 * rayon::current_num_threads()).max(1);
        let parts: Vec<Vec<Value>> = pairs
            .par_chunks(part)
            .map(|part| self.look_all_up(part))
            .collect();
        Ok(parts.concat())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::sample::parse;
    use crate::hemisphere::direction::from_degrees;
    use crate::hemisphere::incident::Grid;

    fn theta_phi(step_deg: f64) -> IncidentSet {
        Grid::ThetaPhi { step_deg }.build().unwrap()
    }

    fn pairs() -> Vec<(DVec3, DVec3)> {
        let mut pairs = Vec::new();
        for k in 0..400 {
            let angle = f64::from(k);
            let wi = from_degrees((angle * 7.3) % 89.9, angle * 31.0);
            pairs.push((wi, from_degrees((angle * 5.1) % 80.0, angle * 77.0)));
        }
        pairs
    }

    #[test]
    fn a_look_up_is_the_bilinear_mean_of_the_samples_around() {
        let brass = parse("ward:brass").unwrap();
        let (set, disk) = (theta_phi(10.0), Disk::new(48));
        let pairs = pairs();
        let found = IdealCaptures::new(brass.as_ref(), set.clone(), disk)
            .values(&pairs)
            .unwrap();
        for (&(wi, wo), value) in pairs.iter().zip(found) {
            let mut expected = 0.0;
            for (row, a) in set.neighbours(wi) {
                for (cell, b) in disk.neighbours(wo).unwrap() {
                    expected += a * b * brass.f(set.direction(row), disk.direction(cell).unwrap())[0];
                }
            }
            let found = f64::from(value.unwrap()[0]);
            assert!(
                (found / expected - 1.0).abs() < 1e-5,
                "{wi} {wo}: {found} {expected}"
            );
        }
    }

    #[test]
    fn at_its_own_directions_the_table_is_the_sample() {
        let velvet = parse("velvet").unwrap();
        let (set, disk) = (theta_phi(15.0), Disk::new(32));
        let cells = (0..disk.len()).filter_map(|cell| disk.direction(cell));
        let pairs: Vec<_> = cells
            .zip((0..set.len()).cycle())
            .map(|(wo, row)| (set.direction(row), wo))
            .collect();
        let found = IdealCaptures::new(velvet.as_ref(), set.clone(), disk)
            .values(&pairs)
            .unwrap();
        for ((wi, wo), value) in pairs.into_iter().zip(found) {
            let (found, expected) = (f64::from(value.unwrap()[0]), velvet.f(wi, wo)[0]);
            assert!(
                (found / expected - 1.0).abs() < 1e-4,
                "{wi} {wo}: {found} {expected}"
            );
        }
    }

    #[test]
    fn up_to_the_horizon_there_is_a_value() {
        let white = parse("lambert:1").unwrap();
        for size in [8, 9, 32, 33, 96] {
            let captures = IdealCaptures::new(white.as_ref(), theta_phi(30.0), Disk::new(size));
            let at = |phi: u32| {
                (
                    from_degrees(89.99, f64::from(phi)),
                    from_degrees(89.999, f64::from(phi) * 0.5),
                )
            };
            let pairs: Vec<_> = (0..720).map(at).collect();
            for (value, pair) in captures.values(&pairs).unwrap().into_iter().zip(pairs) {
                let f = f64::from(value.unwrap()[0]) * std::f64::consts::PI;
                assert!((f - 1.0).abs() < 1e-5, "{size} {pair:?}: {f}");
            }
        }
    }
}
