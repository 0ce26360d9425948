//! How much brighter one standard is than another, each over its own reflectance.
//!
//! # Design
//! Pairs that both have are compared in their logarithms. The second standard lies at a height of its own, which takes light from
//! pairs at the edge of what is lit: pairs count by how certain their shares are, and the difference of heights is fitted along, known
//! beforehand as well as things are seated. What neighbours have in common a jackknife over groups of incident directions tells
//! (Efron, *The Jackknife, the Bootstrap and Other Resampling Plans*, 1982).

use std::collections::HashMap;

use super::height::normal;
use super::{Pair, Seen};
use crate::base::linear_fit::least_squares;
use crate::instrument::calibration::SeenPart;

/// Groups of incident directions of the jackknife.
const GROUPS: usize = 12;
/// An equation of ln ratio and the difference of heights, and the group of its incident direction.
type Row = ((Vec<f64>, f64, f64), usize);

impl Seen<'_> {
    /// Mean of q here over q there, of the pairs that both have, and its standard uncertainty.
    pub(in super::super) fn ratio_to(&self, other: &Self) -> Option<(f64, f64)> {
        let rows = self.compared_with(other);
        // Of the difference of heights, in what seating leaves of it.
        let prior = (vec![0.0, 1.0], 0.0, 1.0);
        let solve = |left_out: Option<usize>| {
            let some = rows.iter().filter(|(_, group)| Some(*group) != left_out);
            least_squares(2, some.map(|(row, _)| row.clone()).chain([prior.clone()]))
        };
        let (found, covariance) = solve(None).filter(|_| !rows.is_empty())?;
        let squares = (0..GROUPS)
            .filter_map(|group| Some((solve(Some(group))?.0[0] - found[0]).powi(2)))
            .sum::<f64>();
        let jackknife = (squares * (GROUPS - 1) as f64 / GROUPS as f64).sqrt();
        let lamp = [self, other].map(Seen::lamp_uncertainty);
        Some((
            found[0].exp(),
            covariance[(0, 0)]
                .sqrt()
                .max(jackknife)
                .hypot(lamp[0])
                .hypot(lamp[1]),
        ))
    }

    /// Relative standard uncertainty (k = 1) of all it shows by the lamp.
    fn lamp_uncertainty(&self) -> f64 {
        let some = self.pairs.iter().filter(|pair| self.takes_part(pair));
        let (sum, weights) = some.fold((0.0, 0.0), |(sum, weights), pair| {
            (sum + pair.weight() * pair.common, weights + pair.weight())
        });
        self.lamp[1].hypot(if weights > 0.0 { sum / weights } else { 0.0 })
    }

    fn compared_with(&self, other: &Self) -> Vec<Row> {
        let key = |pair: &Pair| (pair.place, pair.pixel, pair.channel);
        let known: HashMap<_, &Pair> = other.pairs.iter().map(|pair| (key(pair), pair)).collect();
        let up = normal(self).to_array();
        let compared = self
            .pairs
            .iter()
            .filter(|pair| self.takes_part(pair))
            .filter_map(|pair| {
                let there = known.get(&key(pair))?;
                let slope = |axis: usize| {
                    let left = SeenPart::LEFT[axis] / SeenPart::TOLERANCES[axis];
                    up[axis] * pair.area.slopes[axis] * left
                };
                let variance = pair.weight.recip() + there.weight.recip() + pair.area.variance;
                let row = vec![1.0, (0..3).map(slope).sum()];
                Some((
                    (row, pair.log - there.log, variance.recip()),
                    pair.place as usize % GROUPS,
                ))
            });
        compared.collect()
    }
}
