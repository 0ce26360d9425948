//! Distributions over many decades in constant memory.
//!
//! # Design
//! A quantile is stated only where the numbers carry it: at least one of them has to lie beyond it, so a median takes two,
//! 90 % take ten and 99 % take a hundred. What the histogram cannot resolve is said, not made up: a quantile beyond its
//! range is *above* it, and the bound of a bin is the upper one where it says what a share lies below.

use std::sync::LazyLock;

use serde::{Serialize, Serializer};

/// One quantile; in JSON a number where it is one, else null.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Quantile {
    /// Too few numbers to have one.
    #[default]
    None,
    /// It is this.
    At(f64),
    /// It is above this, and nobody knows by how much.
    Above(f64),
}

impl Quantile {
    /// The number, if it is one.
    #[must_use]
    pub const fn value(self) -> Option<f64> {
        match self {
            Self::At(value) => Some(value),
            Self::None | Self::Above(_) => None,
        }
    }
}

impl Serialize for Quantile {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.value().serialize(serializer)
    }
}

/// Quantiles of a distribution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Quantiles {
    /// 50 %, right to 0.6 % of itself.
    pub median: Quantile,
    /// 90 % of the numbers are no more than this.
    pub p90: Quantile,
    /// 99 % of the numbers are no more than this.
    pub p99: Quantile,
    /// How many numbers there are.
    pub samples: u64,
}

const BINS_PER_DECADE: f64 = 200.0;
const SMALLEST: f64 = 1e-9;
const LARGEST: f64 = 1e3;
const BINS: usize = 2400;

/// Bits of a double-precision number behind those that say where its bin is looked for: 2⁸ places an octave, fewer than bins are wide.
const PLACE: u32 = 52 - 8;
static SCALE: LazyLock<Scale> = LazyLock::new(Scale::new);

/// Where bins begin. A logarithm for each of a thousand million numbers is most of what judging them takes.
struct Scale {
    /// The place of [`SMALLEST`].
    first: u64,
    /// Of each place the bin of its smallest number; there is at most one more.
    bins: Vec<u16>,
    /// Where bins begin, and the last one ends.
    begin: Vec<f64>,
}

impl Scale {
    fn new() -> Self {
        let begin: Vec<f64> = (0..=BINS)
            .map(|bin| SMALLEST * 10_f64.powf(bin as f64 / BINS_PER_DECADE))
            .collect();
        let [first, last] = [SMALLEST, LARGEST].map(|value: f64| value.to_bits() >> PLACE);
        let bin = |place: u64| {
            let smallest = f64::from_bits(place << PLACE);
            (begin.partition_point(|begin| *begin <= smallest).max(1) - 1).min(BINS - 1) as u16
        };
        Self {
            first,
            bins: (first..=last).map(bin).collect(),
            begin,
        }
    }

    /// The bin of a number from [`SMALLEST`] to below [`LARGEST`].
    fn bin(&self, value: f64) -> usize {
        let bin = usize::from(self.bins[((value.to_bits() >> PLACE) - self.first) as usize]);
        (bin + usize::from(value >= self.begin[bin + 1])).min(BINS - 1)
    }
}

/// Histogram of numbers from 0 on a log scale from 1e-9 to 1e3, with those below and above counted beside it.
#[derive(Clone, Debug)]
pub(in crate::judge) struct LogHistogram {
    bins: Vec<u64>,
    zeros: u64,
    count: u64,
}

impl LogHistogram {
    pub(in crate::judge) fn new() -> Self {
        Self {
            bins: vec![0; BINS],
            zeros: 0,
            count: 0,
        }
    }

    /// Counts `value`, 0 or more; infinity is beyond the range. What is not a number takes no part.
    pub(in crate::judge) fn add(&mut self, value: f64) {
        if value.is_nan() {
            return;
        }
        self.count += 1;
        if value <= 0.0 {
            self.zeros += 1;
        } else if value < LARGEST {
            self.bins[SCALE.bin(value.max(SMALLEST))] += 1;
        }
    }

    pub(super) fn merge(mut self, other: &Self) -> Self {
        for (a, b) in self.bins.iter_mut().zip(&other.bins) {
            *a += b;
        }
        self.zeros += other.zeros;
        self.count += other.count;
        self
    }

    /// Numbers in it.
    pub(in crate::judge) const fn count(&self) -> u64 {
        self.count
    }

    /// Whether there are numbers, all of them 0.
    pub(super) const fn is_all_zeros(&self) -> bool {
        self.count > 0 && self.zeros == self.count
    }

    /// The quantile `q`, at the place `within` its bin: 0.5 is the middle, 1 the upper bound.
    fn quantile(&self, q: f64, within: f64) -> Quantile {
        // A hair for 0.1 that is not 1/10.
        if self.count as f64 * (1.0 - q) < 1.0 - 1e-9 {
            return Quantile::None;
        }
        let wanted = (q * self.count as f64) as u64;
        let mut sum = self.zeros;
        if sum > wanted {
            return Quantile::At(0.0);
        }
        for (bin, count) in self.bins.iter().enumerate() {
            sum += count;
            if sum > wanted {
                return Quantile::At(SMALLEST * 10_f64.powf((bin as f64 + within) / BINS_PER_DECADE));
            }
        }
        Quantile::Above(LARGEST)
    }

    pub(in crate::judge) fn median(&self) -> Quantile {
        self.quantile(0.5, 0.5)
    }

    pub(super) fn quantiles(&self) -> Quantiles {
        Quantiles {
            median: self.median(),
            p90: self.quantile(0.9, 1.0),
            p99: self.quantile(0.99, 1.0),
            samples: self.count,
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    fn of(values: &[f64]) -> Quantiles {
        let mut histogram = LogHistogram::new();
        for value in values {
            histogram.add(*value);
        }
        histogram.quantiles()
    }

    #[test]
    fn quantiles_are_those_of_the_sorted_numbers() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
        for count in [100, 101, 999, 5000] {
            let mut values: Vec<f64> = (0..count)
                .map(|_| 10_f64.powf(rng.random_range(-8.5..2.9)))
                .collect();
            let found = of(&values);
            values.sort_by(f64::total_cmp);
            let at = |q: f64| values[(q * f64::from(count)) as usize];
            let median = found.median.value().unwrap();
            assert!((median / at(0.5) - 1.0).abs() < 0.007, "{found:?}");
            for (bound, q) in [(found.p90, 0.9), (found.p99, 0.99)] {
                let ratio = bound.value().unwrap() / at(q);
                assert!((1.0 - 1e-9..1.013).contains(&ratio), "{found:?} {q}");
            }
        }
    }

    #[test]
    fn numbers_are_in_the_bins_of_their_logarithms() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
        let drawn = (0..200_000).map(|_| 10_f64.powf(rng.random_range(-9.0..3.0)));
        for value in drawn.chain([SMALLEST, LARGEST.next_down()]) {
            let place = (value / SMALLEST).log10() * BINS_PER_DECADE;
            let found = SCALE.bin(value) as f64;
            assert!(
                found <= place + 1e-6 && place < found + 1.0 + 1e-6,
                "{value}: {found} {place}"
            );
        }
    }

    #[test]
    fn what_the_numbers_do_not_carry_is_not_stated() {
        assert_eq!(of(&[]), Quantiles::default());
        assert_eq!(of(&[f64::NAN]), Quantiles::default());
        for (count, stated) in [
            (1, [false; 3]),
            (2, [true, false, false]),
            (9, [true, false, false]),
            (10, [true, true, false]),
            (99, [true, true, false]),
            (100, [true; 3]),
        ] {
            let found = of(&vec![0.01; count]);
            let quantiles = [found.median, found.p90, found.p99];
            assert_eq!(quantiles.map(|q| q.value().is_some()), stated, "{count}");
        }
        // Nothing is wrong by nothing, and what is beyond the scale is above it.
        assert_eq!(of(&[0.0; 100]).p99, Quantile::At(0.0));
        assert_eq!(of(&[1e300; 100]).median, Quantile::Above(LARGEST));
        assert_eq!(of(&[f64::INFINITY; 2]).median, Quantile::Above(LARGEST));
        let json = serde_json::to_string(&of(&[1e9, 1e9])).unwrap();
        assert_eq!(json, r#"{"median":null,"p90":null,"p99":null,"samples":2}"#);
    }
}
