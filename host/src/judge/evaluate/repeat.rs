//! Repeatability: two captures of one sample.

use serde::Serialize;

use crate::base::median::median;
use crate::brdf::{Brdf, BrdfError, evidence};
use crate::hemisphere::judged::is_judged;
use crate::store::provenance::Provenance;

/// Differences that are kept for their medians, about.
const KEPT: usize = 1_000_000;
/// Half of a normal distribution lies within so many standard deviations.
const HALF: f64 = 0.6745;
/// Standard uncertainties beyond which a bias is worth a sentence.
const CLEAR: f64 = 2.0;

/// How well two captures of one sample agree, for θ ≤ 80° both ways.
#[derive(Clone, Debug, Serialize)]
pub struct Repeatability {
    /// Samples, of all channels, that were measured in both and whose mean is above 0.
    pub samples: u64,
    /// Share of all pairs of directions with θ ≤ 80° (and channels) that those are; `None` if there are none.
    pub share: Option<f64>,
    /// Median of (b − a)/mean: by how much the second capture is brighter; `None` of fewer than two samples.
    pub relative_bias: Option<f64>,
    /// Standard uncertainty (k = 1) of that by what each capture states as common to its values; `None` if one states nothing. Where both
    /// have the standard in common it is less.
    pub relative_bias_uncertainty: Option<f64>,
    /// Relative standard deviation of a single capture beside the bias: median of |(b − a)/mean − bias| / (√2 · 0.6745).
    pub relative_standard_deviation: Option<f64>,
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
    check_directions(a, b)?;
    evidence::check_apart(a, b)?;
    let Differences {
        pairs,
        samples,
        relative,
        squares,
        uncertain,
    } = Differences::of(a, b)?;
    let bias = median(relative.clone()).filter(|_| samples > 1);
    let uncertainty = a
        .common_uncertainty()
        .zip(b.common_uncertainty())
        .map(|(a, b)| a.hypot(b));
    let mut warnings = Vec::new();
    if samples < 2 {
        warnings.push(format!(
            "repeatability: none, {samples} samples with θ ≤ 80° both ways were measured in both files with a mean above 0"
        ));
    }
    if let (Some(bias), Some(uncertainty)) = (bias, uncertainty)
        && bias.abs() > CLEAR * uncertainty
    {
        warnings.push(format!(
            "repeatability: the second capture is brighter by {:.2} %, where both together state {:.2} % (k = 1) as common to all \
             their values; was it the same sample, standard and lamp?",
            100.0 * bias,
            100.0 * uncertainty
        ));
    }
    let deviation = bias.and_then(|bias| {
        let beside = relative.iter().map(|difference| (difference - bias).abs());
        Some(median(beside.collect())? / (2_f64.sqrt() * HALF))
    });
    Ok(Repeatability {
        samples,
        share: (pairs > 0).then(|| samples as f64 / pairs as f64),
        relative_bias: bias,
        relative_bias_uncertainty: bias.and(uncertainty),
        relative_standard_deviation: deviation,
        normalised_difference: (uncertain > 0).then(|| (squares / uncertain as f64).sqrt()),
        warnings,
    })
}

/// Refuses captures whose directions are not the same.
pub(in crate::judge) fn check_directions(a: &Brdf, b: &Brdf) -> Result<(), BrdfError> {
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
    a.check_same_bands(b)?;
    if a.disk() != b.disk() {
        let [expected, found] = [a, b].map(|brdf| brdf.azimuth().to_string());
        return Err(differs("azimuth_deg", expected, found));
    }
    let other = (0..a.grid().len())
        .find(|&index| a.grid().direction(index).distance(b.grid().direction(index)) > 1e-9);
    other.map_or(Ok(()), |index| {
        let angles = |brdf: &Brdf| {
            let (theta_deg, phi_deg) = brdf.grid().angles_deg(index);
            format!("({theta_deg}°, {phi_deg}°)")
        };
        Err(differs(
            "incident directions",
            angles(a),
            format!("{} at number {index}", angles(b)),
        ))
    })
}

/// How two captures differ.
#[derive(Default)]
struct Differences {
    /// Values that there may be with θ ≤ 80° both ways, and those that both have measured, with a mean above 0.
    pairs: usize,
    samples: u64,
    /// Of some of those, (b − a)/mean.
    relative: Vec<f64>,
    /// Sum of the squares of differences over their standard uncertainties, and how many those are.
    squares: f64,
    uncertain: u64,
}

impl Differences {
    /// Of two captures with the same directions.
    fn of(a: &Brdf, b: &Brdf) -> Result<Self, BrdfError> {
        let (cells, channels) = (a.disk().len(), a.channels());
        let judged: Vec<bool> = (0..cells)
            .map(|cell| a.disk().direction(cell).is_some_and(is_judged))
            .collect();
        let directions = (0..a.grid().len()).filter(|&index| is_judged(a.grid().direction(index)));
        let mut all = Self {
            pairs: directions.count() * judged.iter().filter(|judged| **judged).count() * channels,
            ..Self::default()
        };
        // Odd, so that it does not stay in step with rows of an even number.
        let every = (all.pairs / KEPT) as u64 | 1;
        let is_seen = |code: u8| Provenance::from_code(code).is_some_and(Provenance::is_seen);
        for chunk in 0..a.chunks() {
            let (Some(one), Some(other)) = (a.chunk(chunk)?, b.chunk(chunk)?) else {
                continue;
            };
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
                        if all.samples.is_multiple_of(every) {
                            all.relative.push((y - x) / mean);
                        }
                        all.samples += 1;
                    }
                    let sigma = one.sigma[at].to_f64().hypot(other.sigma[at].to_f64());
                    if sigma > 0.0 {
                        all.squares += ((x - y) / sigma).powi(2);
                        all.uncertain += 1;
                    }
                }
            }
        }
        Ok(all)
    }
}
