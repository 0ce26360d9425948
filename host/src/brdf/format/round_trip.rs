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
    /// Pairs that the source has and the file has not.
    pub lost: usize,
}

/// Pairs of directions at which a file is compared with its source.
pub(super) struct Trial {
    /// Those that count.
    pub(super) pairs: Vec<(DVec3, DVec3)>,
    /// Luminance of f there, sr⁻¹.
    values: Vec<f64>,
}

impl Trial {
    /// Of what is exported.
    pub(super) fn of(exporting: &Exporting) -> Result<Self, ExportError> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(17);
        let mut draw = || drawn(&mut rng, LAST_DEG);
        let pairs: Vec<(DVec3, DVec3)> = (0..PAIRS).map(|_| (draw(), draw())).collect();
        let values = exporting.peek(&pairs)?;
        let known: Vec<f64> = values.iter().flatten().map(|f| super::luminance(*f)).collect();
        let faint = FAINT * median(known).unwrap_or(0.0);
        let counts = |(pair, value): ((DVec3, DVec3), Option<[f32; 3]>)| {
            let value = value.map(super::luminance)?;
            (value > 0.0 && value >= faint).then_some((pair, value))
        };
        let (pairs, values) = pairs.into_iter().zip(values).filter_map(counts).unzip();
        Ok(Self { pairs, values })
    }

    /// Of what was `read` at the pairs: luminance of f, sr⁻¹.
    pub(super) fn against(&self, read: impl IntoIterator<Item = f64>) -> RoundTrip {
        let (mut differences, mut lost) = (Vec::new(), 0);
        for (read, value) in read.into_iter().zip(&self.values) {
            if read.is_finite() {
                differences.push((read / value - 1.0).abs());
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
            lost,
        }
    }
}

/// Of the file that was read back as `file`.
pub(super) fn of(exporting: &Exporting, file: &dyn Sample) -> Result<RoundTrip, ExportError> {
    let trial = Trial::of(exporting)?;
    let luminance = |(wi, wo): &(DVec3, DVec3)| super::luminance(file.f(*wi, *wo).map(|f| f as f32));
    Ok(trial.against(trial.pairs.iter().map(luminance)))
}
