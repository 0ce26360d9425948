//! The mean of what several captures say of the same sample.
//!
//! # Design
//! Every sample is the mean of what the captures say, weighted by inverse variance. What all values of a capture have in common
//! takes no part in that: a further capture has the scale of the first, and the variance with which that was found, so that what the
//! values of the first have in common all have. A turn is applied by looking up the turned pair. Of what is left of each variance
//! noise averages out; the fields and blur do not, because all captures share them. The files have one number for both, so
//! [`SHARED`] of it is taken to be shared: with weights w = 1/σ² the variance is (1 − shared)/Σw + shared·(Σwσ/Σw)².

use std::ops::Range;

use glam::{DQuat, DVec3};
use half::f16;

use super::FillError;
use super::merge::Alignment;
use super::union::Union;
use crate::brdf::{Brdf, own_variance};
use crate::store::provenance::Provenance;
use crate::store::{BrdfRows, LEAST_SIGMA, StoreError, USELESS_SIGMA};

/// Share of the variance that a sample has beside the common part which captures share.
const SHARED: f64 = 0.5;

/// How a capture is taken.
#[derive(Clone, Copy)]
struct Taken {
    /// What its f is multiplied with, and the standard uncertainty of that.
    scale: f64,
    uncertainty: f64,
    /// Relative standard uncertainty that all its values have in common.
    common: f64,
}

impl Taken {
    /// The capture `brdf`, scaled as `alignment` says, or as it is.
    fn of(brdf: &Brdf, alignment: Option<&Alignment>) -> Self {
        Self {
            scale: alignment.map_or(1.0, |of| of.scale),
            uncertainty: alignment.map_or(0.0, |of| of.scale_uncertainty),
            common: brdf.common_uncertainty().unwrap_or(0.0),
        }
    }

    /// Variance of a scaled value `f` ± `sigma` beside what all have in common.
    fn variance(self, f: f64, sigma: f64) -> f64 {
        own_variance(f, sigma, self.common) * self.scale.powi(2) + (f * self.uncertainty).powi(2)
    }
}

/// Sums over captures, with weights w = 1/σ², of each (incident direction, cell) of one chunk: [sample × channel].
struct Sums<'a> {
    cells: usize,
    channels: usize,
    /// Whether a sample may have a value.
    is_open: &'a dyn Fn(usize) -> bool,
    /// Relative standard uncertainty that all means have in common.
    common: f64,
    /// Σ w·f.
    values: Vec<f64>,
    /// Σ w.
    weights: Vec<f64>,
    /// Σ w·σ.
    roots: Vec<f64>,
    /// Of each sample.
    provenance: Vec<u8>,
}

impl<'a> Sums<'a> {
    /// Of nothing yet.
    fn new(rows: usize, base: &Brdf, is_open: &'a dyn Fn(usize) -> bool) -> Self {
        let (cells, channels) = (base.disk().len(), base.channels());
        let samples = rows * cells;
        Self {
            cells,
            channels,
            is_open,
            common: Taken::of(base, None).common,
            values: vec![0.0_f64; samples * channels],
            weights: vec![0.0_f64; samples * channels],
            roots: vec![0.0_f64; samples * channels],
            provenance: vec![Provenance::Missing.code(); samples],
        }
    }

    /// Adds what one capture says of `sample`: `f` and `sigma`, one per channel.
    fn add(&mut self, sample: usize, f: &[f32], sigma: &[f32], taken: Taken, code: u8) {
        if !(self.is_open)(sample) {
            return;
        }
        let channels = self.channels;
        for channel in 0..channels {
            let (f, sigma) = (f64::from(f[channel]), f64::from(sigma[channel]));
            let weight = taken
                .variance(f, sigma)
                .max(f64::from(LEAST_SIGMA).powi(2))
                .recip();
            self.values[sample * channels + channel] += weight * taken.scale * f;
            self.weights[sample * channels + channel] += weight;
            self.roots[sample * channels + channel] += weight.sqrt();
        }
        // With another capture in it, it is merged.
        self.provenance[sample] = if self.provenance[sample] == Provenance::Missing.code() {
            code
        } else {
            Provenance::Merged.code()
        };
    }

    /// Adds what `brdf` has as it stands, without a turn: `places` are its own rows of the chunk's incident directions.
    /// What is not of the `first` capture is merged.
    fn add_rows(
        &mut self,
        brdf: &Brdf,
        places: &[Option<usize>],
        is_first: bool,
        taken: Taken,
    ) -> Result<(), StoreError> {
        let (cells, channels) = (self.cells, self.channels);
        // The rows of a chunk mostly come from one of the capture.
        let mut held: Option<(usize, Option<BrdfRows>)> = None;
        for (place, row) in places.iter().enumerate() {
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
                let code = if is_first { code } else { Provenance::Merged.code() };
                self.add(place * cells + cell, &rows.f[at], &sigma, taken, code);
            }
        }
        Ok(())
    }

    /// Means and their σ; nothing if no capture has anything.
    fn means(self) -> Option<BrdfRows> {
        if self
            .provenance
            .iter()
            .all(|code| *code == Provenance::Missing.code())
        {
            return None;
        }
        // 0/0 is NaN, which is what stands where no capture has anything.
        let value = |sum: &f64, weight: &f64| (sum / weight) as f32;
        let mut rows = BrdfRows {
            f: self
                .values
                .iter()
                .zip(&self.weights)
                .map(|(sum, weight)| value(sum, weight))
                .collect(),
            sigma: self
                .weights
                .iter()
                .zip(&self.roots)
                .zip(&self.values)
                .map(|((weight, root), sum)| {
                    let own = (1.0 - SHARED) / weight + SHARED * (root / weight).powi(2);
                    let variance = own + (self.common * sum / weight).powi(2);
                    f16::from_f64(variance.sqrt().min(USELESS_SIGMA.into()).max(LEAST_SIGMA.into()))
                })
                .collect(),
            provenance: self.provenance,
        };
        rows.seal();
        Some(rows)
    }
}

/// The incident directions `range` of all captures together; nothing if none has anything.
pub(super) fn merged_chunk(
    captures: &[&Brdf],
    union: &Union,
    alignments: &[Alignment],
    range: Range<usize>,
    is_open: &dyn Fn(usize, usize) -> bool,
) -> Result<Option<BrdfRows>, FillError> {
    let base = captures[0];
    let cells = base.disk().len();
    let is_open = |sample: usize| is_open(range.start + sample / cells, sample % cells);
    let mut sums = Sums::new(range.len(), base, &is_open);
    let rows = |capture: usize| &union.rows[capture][range.clone()];
    sums.add_rows(base, rows(0), true, Taken::of(base, None))?;
    for (capture, alignment) in (1..).zip(alignments) {
        if alignment.turn == DQuat::IDENTITY {
            let taken = Taken::of(captures[capture], Some(alignment));
            sums.add_rows(captures[capture], rows(capture), false, taken)?;
        }
    }
    for (capture, alignment) in (1..).zip(alignments) {
        if alignment.turn == DQuat::IDENTITY {
            continue;
        }
        let taken = Taken::of(captures[capture], Some(alignment));
        let has = |sample: &usize| union.rows[capture][range.start + sample / cells].is_some();
        let places: Vec<(usize, (DVec3, DVec3))> = (0..range.len() * cells)
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
                sums.add(*sample, &f, &sigma, taken, Provenance::Merged.code());
            }
        }
    }
    Ok(sums.means())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_first_capture_has_in_common_no_mean_lessens() {
        let is_open = |_: usize| true;
        let mut sums = Sums {
            cells: 1,
            channels: 1,
            is_open: &is_open,
            common: 0.1,
            values: vec![0.0],
            weights: vec![0.0],
            roots: vec![0.0],
            provenance: vec![Provenance::Missing.code()],
        };
        let first = Taken {
            scale: 1.0,
            uncertainty: 0.0,
            common: 0.1,
        };
        let code = Provenance::Measured.code();
        sums.add(0, &[1.0], &[0.1_f32.hypot(0.02)], first, code);
        // Less uncertain of its own scale, which it does not keep.
        let second = Taken {
            scale: 1.25,
            uncertainty: 0.002,
            common: 0.05,
        };
        sums.add(0, &[0.8], &[0.04_f32.hypot(0.016)], second, code);
        let rows = sums.means().unwrap();
        assert!((rows.f[0] - 1.0).abs() < 1e-6, "{}", rows.f[0]);
        let own = (rows.sigma[0].to_f64().powi(2) - 0.01).sqrt();
        assert!((0.015..0.02).contains(&own), "{own}");
        assert_eq!(rows.provenance[0], Provenance::Merged.code());
    }
}
