//! Repeatability: two captures of one sample.

use serde::Serialize;

use super::Quantile;
use super::histogram::LogHistogram;
use crate::brdf::{Brdf, BrdfError, evidence};
use crate::hemisphere::judged::is_judged;
use crate::store::provenance::Provenance;

/// How well two captures of one sample agree, for θ ≤ 80° both ways.
#[derive(Clone, Debug, Serialize)]
pub struct Repeatability {
    /// Samples, of all channels, that were measured in both and whose mean is above 0.
    pub samples: u64,
    /// Share of all pairs of directions with θ ≤ 80° (and channels) that those are; `None` if there are none.
    pub share: Option<f64>,
    /// Median of |a − b| / (√2 · 0.6745 · mean): the relative standard deviation of a single capture.
    pub relative_standard_deviation: Quantile,
    /// Root mean square of (a − b) over the standard uncertainty of the difference: 1 or less if the uncertainties hold,
    /// less where they hold what both captures have in common. `None` if no sample has an uncertainty.
    pub normalised_difference: Option<f64>,
    /// What cannot be stated, in sentences.
    pub warnings: Vec<String>,
}

/// Compares two captures of one sample with the same directions. Values that were filled in have no part.
///
/// # Errors
/// [`BrdfError`] if the directions differ, both hold the same capture, or a file cannot be read.
pub fn repeatability(a: &Brdf, b: &Brdf) -> Result<Repeatability, BrdfError> {
    let size = |brdf: &Brdf| (brdf.grid().len(), brdf.disk().size(), brdf.channels());
    let differs = |field, expected: String, found: String| BrdfError::Content {
        path: b.path().display().to_string(),
        field,
        expected: format!("{expected} as in {}", a.path().display()),
        found,
    };
    let (expected, found) = (size(a), size(b));
    for (field, expected, found) in [
        ("incident directions", expected.0, found.0),
        ("outgoing grid", expected.1, found.1),
        ("channels", expected.2, found.2),
    ] {
        if expected != found {
            return Err(differs(field, expected.to_string(), found.to_string()));
        }
    }
    if let Some(index) = (0..a.grid().len())
        .find(|&index| a.grid().direction(index).distance(b.grid().direction(index)) > 1e-9)
    {
        let angles = |brdf: &Brdf| {
            let (theta_deg, phi_deg) = brdf.grid().angles_deg(index);
            format!("({theta_deg}°, {phi_deg}°)")
        };
        return Err(differs(
            "incident directions",
            angles(a),
            format!("{} at number {index}", angles(b)),
        ));
    }
    evidence::check_apart(a, b)?;
    let (cells, channels) = (a.disk().len(), a.channels());
    let judged: Vec<bool> = (0..cells)
        .map(|cell| a.disk().direction(cell).is_some_and(is_judged))
        .collect();
    let (mut differences, mut squares, mut uncertain) = (LogHistogram::new(), 0.0, 0_u64);
    for chunk in 0..a.chunks() {
        let (Some(one), Some(other)) = (a.chunk(chunk)?, b.chunk(chunk)?) else {
            continue;
        };
        let is_seen = |code: u8| Provenance::from_code(code).is_some_and(Provenance::is_seen);
        for (sample, codes) in one.provenance.iter().zip(&other.provenance).enumerate() {
            let index = a.chunk_range(chunk).start + sample / cells;
            let counts = judged[sample % cells] && is_judged(a.grid().direction(index));
            if !counts || !is_seen(*codes.0) || !is_seen(*codes.1) {
                continue;
            }
            for at in sample * channels..(sample + 1) * channels {
                let (x, y) = (f64::from(one.f[at]), f64::from(other.f[at]));
                let mean = f64::midpoint(x, y);
                if mean > 0.0 {
                    differences.add((x - y).abs() / mean);
                }
                let sigma = one.sigma[at].to_f64().hypot(other.sigma[at].to_f64());
                if sigma > 0.0 {
                    squares += ((x - y) / sigma).powi(2);
                    uncertain += 1;
                }
            }
        }
    }
    let directions = (0..a.grid().len()).filter(|&index| is_judged(a.grid().direction(index)));
    let pairs = directions.count() * judged.iter().filter(|judged| **judged).count() * channels;
    let samples = differences.count();
    let mut warnings = Vec::new();
    if samples < 2 {
        warnings.push(format!(
            "repeatability: none, {samples} samples with θ ≤ 80° both ways were measured in both files with a mean above 0"
        ));
    }
    // Half of a normal distribution lies within 0.6745 standard deviations.
    Ok(Repeatability {
        samples,
        share: (pairs > 0).then(|| samples as f64 / pairs as f64),
        relative_standard_deviation: differences.median().times((2_f64.sqrt() * 0.6745).recip()),
        normalised_difference: (uncertain > 0).then(|| (squares / uncertain as f64).sqrt()),
        warnings,
    })
}
