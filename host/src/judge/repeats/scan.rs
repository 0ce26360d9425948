//! The same chunk of all repeats at a time.

use rayon::prelude::*;

use super::origins::{CLASSES, Parts};
use crate::brdf::Brdf;
use crate::hemisphere::direction::to_degrees;
use crate::store::provenance::Provenance;
use crate::store::{BrdfRows, StoreError};

/// Chunks that are in memory at a time, of each repeat.
const AT_ONCE: usize = 4;

/// What is made of a chunk, by its number and the rows of all repeats.
type OfChunk<'a, T> = dyn Fn(usize, &[Option<BrdfRows>]) -> Result<T, StoreError> + Sync + 'a;

/// What `of` makes of each chunk, which gets the rows of all repeats, is given to `take` in the order of the chunks.
pub(crate) fn scan<T: Send>(
    all: &[&Brdf],
    of: &OfChunk<'_, T>,
    take: &mut dyn FnMut(usize, T) -> Result<(), StoreError>,
) -> Result<(), StoreError> {
    let chunks: Vec<usize> = (0..all[0].chunks()).collect();
    for some in chunks.chunks(AT_ONCE) {
        let found: Vec<T> = some
            .par_iter()
            .map(|&chunk| {
                let rows = all.iter().map(|brdf| brdf.chunk(chunk));
                of(chunk, &rows.collect::<Result<Vec<_>, _>>()?)
            })
            .collect::<Result<_, StoreError>>()?;
        for (chunk, found) in some.iter().zip(found) {
            take(*chunk, found)?;
        }
    }
    Ok(())
}

/// What those repeats that measured it say of one channel of a pair of directions.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sample {
    /// The repeats, f in sr⁻¹ and its standard uncertainty.
    pub(crate) values: Vec<(usize, f64, f64)>,
    /// Mean of f.
    pub(crate) mean: f64,
    /// Mean of the variances σ².
    pub(crate) variance: f64,
}

impl Sample {
    /// Reads `channel` of the pair number `pair` in the chunk `rows`; whether anybody measured it.
    pub(crate) fn read(
        &mut self,
        rows: &[Option<BrdfRows>],
        pair: usize,
        channels: usize,
        channel: usize,
    ) -> bool {
        self.values.clear();
        let at = pair * channels + channel;
        for (number, rows) in rows.iter().enumerate() {
            let Some(rows) = rows else { continue };
            if Provenance::from_code(rows.provenance[pair]).is_some_and(Provenance::is_seen) {
                let (f, sigma) = (f64::from(rows.f[at]), rows.sigma[at].to_f64());
                self.values.push((number, f, sigma));
            }
        }
        let count = self.values.len() as f64;
        self.mean = self.values.iter().map(|value| value.1).sum::<f64>() / count;
        self.variance = self.values.iter().map(|value| value.2 * value.2).sum::<f64>() / count;
        !self.values.is_empty()
    }

    /// How many measured it.
    pub(crate) const fn count(&self) -> usize {
        self.values.len()
    }

    /// Variance of one repeat by how they scatter; of at least two.
    pub(crate) fn scatter(&self) -> f64 {
        let squares = self.values.iter().map(|value| (value.1 - self.mean).powi(2));
        squares.sum::<f64>() / (self.count() - 1) as f64
    }

    /// Each repeat's error of a class, by what its `parts` say of `place`.
    pub(crate) fn amounts<'a>(
        &'a self,
        parts: &'a [Parts],
        place: usize,
        class: usize,
    ) -> impl Iterator<Item = (usize, f64)> + Clone + 'a {
        let amount = move |&(number, _, sigma): &(usize, f64, f64)| {
            (number, sigma * parts[number].roots[place][class])
        };
        self.values.iter().map(amount)
    }

    /// Variance by which repeats are expected to scatter by a class, of which `groups` have their errors in common.
    pub(crate) fn expected(
        &self,
        (parts, place, class): (&[Parts], usize, usize),
        groups: &[usize],
        sums: &mut [f64],
    ) -> f64 {
        debug_assert!(class < CLASSES);
        let amounts = self.amounts(parts, place, class);
        let count = self.count() as f64;
        let own: f64 = amounts.clone().map(|(_, amount)| amount * amount).sum();
        ((own - super::origins::variance(groups, amounts, sums) / count) / (count - 1.0)).max(0.0)
    }
}

/// Polar angles of the incident directions and of the cells of `brdf`, degrees; `None` below the horizon.
pub(crate) fn angles_deg(brdf: &Brdf) -> (Vec<f64>, Vec<Option<f64>>) {
    let incident = (0..brdf.grid().len()).map(|index| to_degrees(brdf.grid().direction(index)).0);
    let cells = (0..brdf.disk().len()).map(|cell| Some(to_degrees(brdf.disk().direction(cell)?).0));
    (incident.collect(), cells.collect())
}
