//! Distributions over many decades in constant memory.

use serde::Serialize;

/// Quantiles of a distribution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Quantiles {
    /// 50 %.
    pub median: f64,
    /// 90 %.
    pub p90: f64,
    /// 99 %.
    pub p99: f64,
}

const BINS_PER_DECADE: f64 = 200.0;
const SMALLEST: f64 = 1e-9;
const BINS: usize = 2400;

/// Histogram of positive numbers on a log scale from 1e-9 to 1e3.
#[derive(Clone)]
pub(super) struct LogHistogram {
    bins: Vec<u64>,
    count: u64,
}

impl LogHistogram {
    pub(super) fn new() -> Self {
        Self {
            bins: vec![0; BINS],
            count: 0,
        }
    }

    pub(super) fn add(&mut self, value: f64) {
        let bin = ((value.max(SMALLEST) / SMALLEST).log10() * BINS_PER_DECADE) as usize;
        self.bins[bin.min(BINS - 1)] += 1;
        self.count += 1;
    }

    pub(super) fn merge(mut self, other: &Self) -> Self {
        for (a, b) in self.bins.iter_mut().zip(&other.bins) {
            *a += b;
        }
        self.count += other.count;
        self
    }

    /// Numbers in it.
    pub(super) const fn count(&self) -> u64 {
        self.count
    }

    pub(super) fn quantile(&self, q: f64) -> f64 {
        let wanted = (q * self.count as f64) as u64;
        let mut sum = 0;
        for (bin, count) in self.bins.iter().enumerate() {
            sum += count;
            if sum > wanted {
                return SMALLEST * 10_f64.powf((bin as f64 + 0.5) / BINS_PER_DECADE);
            }
        }
        0.0
    }

    pub(super) fn quantiles(&self) -> Quantiles {
        Quantiles {
            median: self.quantile(0.5),
            p90: self.quantile(0.9),
            p99: self.quantile(0.99),
        }
    }
}
