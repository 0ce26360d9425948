//! Repeatability: two captures of one sample.

use serde::Serialize;

use super::histogram::LogHistogram;
use super::is_judged;
use crate::brdf::{Brdf, BrdfError};
use crate::provenance::Provenance;
use crate::text::by;

/// How well two captures of one sample agree, for θ ≤ 80° both ways.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Repeatability {
    /// Samples that both have.
    pub samples: u64,
    /// Median of |a − b| / (√2 · 0.6745 · mean): the relative standard deviation of a single capture.
    pub relative_standard_deviation: f64,
    /// Root mean square of (a − b) over the standard uncertainty of the difference: 1 or less if the uncertainties hold,
    /// less where they hold what both captures have in common.
    pub normalised_difference: f64,
}

/// Compares two captures of one sample with the same directions.
///
/// # Errors
/// [`BrdfError`] if the directions differ or a file cannot be read.
pub fn repeatability(a: &Brdf, b: &Brdf) -> Result<Repeatability, BrdfError> {
    let size = |brdf: &Brdf| [brdf.grid().len(), brdf.disk().size(), brdf.channels()];
    if size(a) != size(b) {
        return Err(BrdfError::Content {
            path: b.path().display().to_string(),
            field: "incident directions, outgoing grid, channels",
            expected: format!("{} as in {}", by(&size(a)), a.path().display()),
            found: by(&size(b)),
        });
    }
    let (cells, channels) = (a.disk().len(), a.channels());
    let judged: Vec<bool> = (0..cells)
        .map(|cell| a.disk().direction(cell).is_some_and(is_judged))
        .collect();
    let (mut differences, mut squares) = (LogHistogram::new(), 0.0);
    for chunk in 0..a.chunks() {
        let (Some(one), Some(other)) = (a.chunk(chunk)?, b.chunk(chunk)?) else {
            continue;
        };
        let missing = Provenance::Missing.code();
        for (sample, codes) in one.provenance.iter().zip(&other.provenance).enumerate() {
            let index = a.chunk_range(chunk).start + sample / cells;
            let counts = judged[sample % cells] && is_judged(a.grid().direction(index));
            if !counts || *codes.0 == missing || *codes.1 == missing {
                continue;
            }
            for at in sample * channels..(sample + 1) * channels {
                let (x, y) = (f64::from(one.f[at]), f64::from(other.f[at]));
                let sigma = one.sigma[at].to_f64().hypot(other.sigma[at].to_f64());
                differences.add((x - y).abs() / f64::midpoint(x, y).abs().max(1e-12));
                squares += ((x - y) / sigma.max(1e-12)).powi(2);
            }
        }
    }
    // Half of a normal distribution lies within 0.6745 standard deviations.
    let median = differences.quantiles().median;
    Ok(Repeatability {
        samples: differences.count(),
        relative_standard_deviation: median / (2_f64.sqrt() * 0.6745),
        normalised_difference: (squares / differences.count().max(1) as f64).sqrt(),
    })
}
