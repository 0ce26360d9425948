//! How far a file is from its source, as it is read back.

use glam::DVec3;
use rand::SeedableRng as _;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Serialize;

use super::{ExportError, Exporting};
use crate::base::median::median;
use crate::brdf::sample::Sample;
use crate::hemisphere::direction::drawn;

/// Pairs of directions that are tried.
const PAIRS: usize = 4_000;
/// Their largest polar angle, degrees.
const LAST_DEG: f64 = 75.0;
/// Pairs count where f is this share of its median, or more.
const FAINT: f64 = 0.01;

/// Differences of luminance between a file that was written and its source, at random pairs of directions with θ ≤ 75° both ways where f is at
/// least 1 % of its median.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RoundTrip {
    /// Pairs that both have and that count.
    pub pairs: usize,
    /// Median relative difference; `None` of no pair.
    pub median: Option<f64>,
    /// 99 % of the differences are below this.
    pub below_99: Option<f64>,
    /// The largest.
    pub largest: Option<f64>,
    /// Share of the differences that are within half of the standard uncertainty that the source states; `None` of one that states none.
    pub within_half_sigma: Option<f64>,
    /// Pairs that the source has and the file has not.
    pub lost: usize,
}

/// Pairs of directions at which a file is compared with its source.
pub(super) struct Trial {
    /// Those that count.
    pub(super) pairs: Vec<(DVec3, DVec3)>,
    /// Luminance of f there, sr⁻¹.
    values: Vec<f64>,
    /// The least relative standard uncertainty of its channels; NaN where nobody states one.
    uncertainties: Vec<f64>,
}

impl Trial {
    /// Of what is exported.
    pub(super) fn of(exporting: &Exporting) -> Result<Self, ExportError> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(17);
        let mut draw = || drawn(&mut rng, LAST_DEG);
        let pairs: Vec<(DVec3, DVec3)> = (0..PAIRS).map(|_| (draw(), draw())).collect();
        let entries = exporting.peek_entries(&pairs)?;
        let known = entries.iter().flatten();
        let known: Vec<f64> = known.map(|entry| super::luminance(entry.f)).collect();
        let faint = FAINT * median(known).unwrap_or(0.0);
        let mut trial = Self {
            pairs: Vec::new(),
            values: Vec::new(),
            uncertainties: Vec::new(),
        };
        for (pair, entry) in pairs.into_iter().zip(entries) {
            let Some(entry) = entry else { continue };
            let value = super::luminance(entry.f);
            if value > 0.0 && value >= faint {
                trial.pairs.push(pair);
                trial.values.push(value);
                let relative = entry.f.into_iter().zip(entry.sigma);
                let relative = relative.map(|(f, sigma)| f64::from(sigma / f));
                trial.uncertainties.push(
                    relative
                        .reduce(|a, b| if a.is_nan() { a } else { a.min(b) })
                        .unwrap_or(f64::NAN),
                );
            }
        }
        Ok(trial)
    }

    /// Of what was `read` at the pairs: luminance of f, sr⁻¹.
    pub(super) fn against(&self, read: impl IntoIterator<Item = f64>) -> RoundTrip {
        let (mut differences, mut lost, mut within) = (Vec::new(), 0, 0_usize);
        for ((read, value), uncertainty) in read.into_iter().zip(&self.values).zip(&self.uncertainties) {
            if read.is_finite() {
                let difference = (read / value - 1.0).abs();
                within += usize::from(difference <= 0.5 * uncertainty);
                differences.push(difference);
            } else {
                lost += 1;
            }
        }
        differences.sort_unstable_by(f64::total_cmp);
        let count = differences.len();
        let at = |share: f64| {
            differences
                .get(((count as f64 * share) as usize).min(count.saturating_sub(1)))
                .copied()
        };
        RoundTrip {
            pairs: count,
            median: at(0.5),
            below_99: at(0.99),
            largest: at(1.0),
            within_half_sigma: (count > 0 && self.uncertainties.iter().any(|of| !of.is_nan()))
                .then(|| within as f64 / count as f64),
            lost,
        }
    }
}

/// Of the file that was read back as `file`.
pub(super) fn of(exporting: &Exporting, file: &dyn Sample) -> Result<RoundTrip, ExportError> {
    let trial = exporting.trial()?;
    let luminance = |(wi, wo): &(DVec3, DVec3)| super::luminance(file.f(*wi, *wo).map(|f| f as f32));
    Ok(trial.against(trial.pairs.iter().map(luminance)))
}
