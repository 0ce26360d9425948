//! Holds what was measured against what is there.

use std::fmt;
use std::path::Path;

use rcg::brdf::Brdf;
use rcg::brdf::sample::Sample;
use rcg::store::provenance::Provenance;

/// Samples count up to this polar angle, degrees: nearer to the horizon lobes are narrower than these coarse pixels.
const JUDGED_DEG: f64 = 80.0;

/// How far samples are from the truth in units of their standard uncertainties.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Scores {
    /// Samples that were compared.
    pub(crate) count: usize,
    /// Share of them within two standard uncertainties.
    pub(crate) within_2: f64,
    /// The largest.
    pub(crate) worst: f64,
    /// Median of |f − truth|/truth.
    pub(crate) median_error: f64,
}

impl fmt::Display for Scores {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} samples, {:.1} % within 2σ, worst {:.1} σ, median error {:.2} %",
            self.count,
            100.0 * self.within_2,
            self.worst,
            100.0 * self.median_error
        )
    }
}

/// The samples of the file at `path` whose provenance is one of `kinds`, against `sample`.
pub(crate) fn scores(path: &Path, sample: &dyn Sample, kinds: &[Provenance]) -> Scores {
    let brdf = Brdf::open(path).expect("what was measured can be read");
    let least = JUDGED_DEG.to_radians().cos();
    let (cells, channels) = (brdf.disk().len(), brdf.channels());
    let (mut within, mut worst, mut errors) = (0, 0.0_f64, Vec::new());
    for chunk in 0..brdf.chunks() {
        let Some(rows) = brdf.chunk(chunk).expect("a chunk can be read") else {
            continue;
        };
        for (place, index) in brdf.chunk_range(chunk).enumerate() {
            let wi = brdf.grid().direction(index);
            if wi.z < least || brdf.incident_reason(index).is_some() {
                continue;
            }
            for cell in 0..cells {
                let at = place * cells + cell;
                let wo = brdf.disk().direction(cell).filter(|wo| wo.z >= least);
                let is_wanted = kinds.iter().any(|kind| kind.code() == rows.provenance[at]);
                let Some(wo) = wo.filter(|_| is_wanted) else {
                    continue;
                };
                let truth = sample.f(wi, wo);
                for (channel, truth) in truth.into_iter().enumerate().take(channels) {
                    let f = f64::from(rows.f[at * channels + channel]);
                    let sigma = rows.sigma[at * channels + channel].to_f64();
                    let error = (f - truth).abs();
                    // f32 and f16 keep seven and three digits.
                    let score = error / (sigma * 1.001 + 1e-6 * truth);
                    assert!(
                        score.is_finite(),
                        "{}: f {f}, σ {sigma}, truth {}",
                        path.display(),
                        truth
                    );
                    within += usize::from(score <= 2.0);
                    worst = worst.max(score);
                    errors.push(error / truth.max(1e-9));
                }
            }
        }
    }
    let count = errors.len();
    errors.sort_unstable_by(f64::total_cmp);
    Scores {
        count,
        within_2: within as f64 / count.max(1) as f64,
        worst,
        median_error: errors.get(count / 2).copied().unwrap_or(0.0),
    }
}
