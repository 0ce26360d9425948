//! Regions of pairs of directions, and how two results agree in each.

use serde::Serialize;

use super::pairs::Pair;
use crate::judge::region::{ENOUGH, NEIGHBOURS, REGIONS, Region};

/// Coverage factor of the uncertainties in E_n.
const K: f64 = 2.0;

/// How two results agree in one channel of a region.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Agreement {
    /// Samples.
    pub samples: u64,
    /// By how much the second is brighter, relative; `None` of too few samples.
    pub relative_bias: Option<f64>,
    /// Its standard uncertainty (k = 1).
    pub standard_uncertainty: Option<f64>,
    /// |bias| over its expanded uncertainty (k = 2).
    pub e_n: Option<f64>,
    /// Standard deviation of one difference beside the bias, over the root mean square of f.
    pub relative_scatter: Option<f64>,
}

/// How they agree in a region.
#[derive(Clone, Debug, Serialize)]
pub struct RegionAgreement {
    /// Which.
    #[serde(flatten)]
    pub region: Region,
    /// By channel.
    pub channels: Vec<Agreement>,
}

/// Sums over the samples of one channel of a region, see the module.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    samples: u64,
    /// Σ w, and Σ w·d/m.
    weights: f64,
    bias: f64,
    /// Σ w²·n²/m² of noise n, and Σ w·s/m of the rest s.
    noise: f64,
    rest: f64,
    /// Σ d·m/u², Σ m²/u², Σ d²/u².
    normalised: [f64; 3],
    /// Σ d·m, Σ m², Σ d².
    plain: [f64; 3],
}

impl Sums {
    /// Adds a difference `d` of the mean `m`, with its standard uncertainty by noise and its `variance` all in all.
    fn add(&mut self, (m, d): (f64, f64), noise: f64, variance: f64) {
        let rest = (variance - noise * noise).max(0.0).sqrt();
        // w/m, which is as good where m is 0.
        let per_m = m.powi(3) / variance.powi(2);
        self.samples += 1;
        self.weights += per_m * m;
        self.bias += per_m * d;
        self.noise += (per_m * noise).powi(2);
        self.rest += per_m.abs() * rest;
        for (sum, one) in self.normalised.iter_mut().zip([d * m, m * m, d * d]) {
            *sum += one / variance;
        }
        for (sum, one) in self.plain.iter_mut().zip([d * m, m * m, d * d]) {
            *sum += one;
        }
    }

    fn merge(&mut self, other: &Self) {
        self.samples += other.samples;
        self.weights += other.weights;
        self.bias += other.bias;
        self.noise += other.noise;
        self.rest += other.rest;
        let own = self.normalised.iter_mut().chain(&mut self.plain);
        for (sum, one) in own.zip(other.normalised.iter().chain(&other.plain)) {
            *sum += one;
        }
    }

    fn bias(&self) -> Option<f64> {
        (self.samples >= ENOUGH && self.weights > 0.0).then(|| self.bias / self.weights)
    }

    /// Σ (d − δ·m)² of such `sums`, δ being the `bias`.
    fn beside([dm, mm, dd]: [f64; 3], bias: f64) -> f64 {
        (dd - 2.0 * bias * dm + bias * bias * mm).max(0.0)
    }

    fn agreement(&self) -> Agreement {
        let bias = self.bias();
        let uncertainty = bias.map(|_| (NEIGHBOURS * self.noise).sqrt().hypot(self.rest) / self.weights);
        let squares = self.plain[1];
        Agreement {
            samples: self.samples,
            relative_bias: bias,
            standard_uncertainty: uncertainty,
            e_n: bias
                .zip(uncertainty)
                .filter(|(_, uncertainty)| *uncertainty > 0.0)
                .map(|(bias, uncertainty)| bias.abs() / (K * uncertainty)),
            relative_scatter: bias
                .filter(|_| squares > 0.0)
                .map(|bias| (Self::beside(self.plain, bias) / squares).sqrt()),
        }
    }
}

/// The sums of all regions, [incident band, outgoing band, sector, channel].
pub(super) struct Regions {
    channels: usize,
    sums: Vec<Sums>,
}

impl Regions {
    pub(super) fn new(channels: usize) -> Self {
        Self {
            channels,
            sums: vec![Sums::default(); REGIONS * channels],
        }
    }

    /// Adds a pair; with `shares_standard` what is wrong with the standard is the same in both.
    pub(super) fn add(&mut self, pair: &Pair, shares_standard: bool) {
        let (wi, wo) = pair.directions;
        let region = Region::number_of(wi, wo);
        let (one, other) = (&pair.a, &pair.b);
        for channel in 0..self.channels {
            let variances = [one, other].map(|side| side.sigma[channel].powi(2));
            let noise = (one.noise * variances[0] + other.noise * variances[1]).sqrt();
            let standards = (one.standard * variances[0] * other.standard * variances[1]).sqrt();
            let common = if shares_standard { 2.0 * standards } else { 0.0 };
            let variance = variances[0] + variances[1] - common + pair.by_azimuth[channel].powi(2);
            let (a, b) = (one.f[channel], other.f[channel]);
            if variance > 0.0 && (a + b + variance).is_finite() {
                let sums = &mut self.sums[region * self.channels + channel];
                sums.add((0.5 * (a + b), b - a), noise, variance);
            }
        }
    }

    /// All regions that have enough samples.
    pub(super) fn all(&self) -> Vec<RegionAgreement> {
        let regions = self.sums.chunks_exact(self.channels).enumerate();
        regions
            .filter(|(_, sums)| sums.iter().any(|sums| sums.samples >= ENOUGH))
            .map(|(region, sums)| RegionAgreement {
                region: Region::numbered(region),
                channels: sums.iter().map(Sums::agreement).collect(),
            })
            .collect()
    }

    /// By channel, over all regions.
    pub(super) fn overall(&self) -> Vec<Agreement> {
        let mut all = vec![Sums::default(); self.channels];
        for sums in self.sums.chunks_exact(self.channels) {
            for (all, sums) in all.iter_mut().zip(sums) {
                all.merge(sums);
            }
        }
        all.iter().map(Sums::agreement).collect()
    }

    /// Root mean square of d/u, the bias of each region taken away.
    pub(super) fn normalised_scatter(&self) -> Option<f64> {
        let judged = self.sums.iter().filter_map(|sums| Some((sums, sums.bias()?)));
        let (squares, samples) = judged.fold((0.0, 0), |(squares, samples), (sums, bias)| {
            (
                squares + Sums::beside(sums.normalised, bias),
                samples + sums.samples,
            )
        });
        (samples > 0).then(|| (squares / samples as f64).sqrt())
    }
}
