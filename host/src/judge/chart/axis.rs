//! An axis: its ticks, and where values lie along it.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

/// How values are spread along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Equal differences are equally long.
    Linear,
    /// Equal ratios are equally long.
    Logarithmic,
}

/// An axis from its first tick to its last.
#[derive(Clone, Debug)]
pub struct Axis {
    /// What it shows, with the unit.
    pub label: String,
    /// Where it has ticks, rising; at least two.
    pub ticks: Vec<f64>,
    /// How values are spread.
    pub scale: Scale,
}

impl Axis {
    /// A linear axis with about six round ticks that covers all finite `values`.
    #[must_use]
    pub fn covering(label: &str, values: impl Iterator<Item = f64>) -> Self {
        let range =
            values
                .filter(|value| value.is_finite())
                .fold(None, |range: Option<(f64, f64)>, value| {
                    range.map_or(Some((value, value)), |(low, high)| {
                        Some((low.min(value), high.max(value)))
                    })
                });
        let (low, high) = range.unwrap_or((0.0, 1.0));
        let span = if high > low { high - low } else { 1.0 };
        let decade = 10_f64.powf((span / 6.0).log10().floor());
        let steps = [1.0, 2.0, 2.5, 5.0, 10.0].map(|factor| factor * decade);
        let step = steps
            .into_iter()
            .find(|step| span / step <= 6.0)
            .unwrap_or(decade * 10.0);
        let first = (low / step).floor();
        let last = (high / step).ceil().max(first + 1.0);
        let count = (last - first) as usize;
        Self {
            label: label.to_owned(),
            ticks: (0..=count).map(|k| (first + k as f64) * step).collect(),
            scale: Scale::Linear,
        }
    }

    /// A logarithmic axis of whole decades that covers all finite `values` above 0 but those that lie more than `most` decades below the
    /// largest.
    #[must_use]
    pub fn decades(label: &str, values: impl Iterator<Item = f64> + Clone, most: i32) -> Self {
        let exponents = values
            .filter(|value| value.is_finite() && *value > 0.0)
            .map(f64::log10);
        let high = exponents.clone().fold(f64::NEG_INFINITY, f64::max);
        let low = exponents.fold(f64::INFINITY, f64::min);
        let (low, high) = if high.is_finite() {
            (low, high)
        } else {
            (-1.0, 0.0)
        };
        let last = (high.ceil() as i32).max(low.floor() as i32 + 1);
        let first = (low.floor() as i32).max(last - most);
        Self {
            label: label.to_owned(),
            ticks: (first..=last).map(|exponent| 10_f64.powi(exponent)).collect(),
            scale: Scale::Logarithmic,
        }
    }

    /// `value`, or the end of the axis beyond which it lies.
    pub(super) fn inside(&self, value: f64) -> f64 {
        value.clamp(self.ticks[0], self.ticks[self.ticks.len() - 1])
    }

    /// The number at a tick.
    pub(crate) fn tick(&self, tick: f64) -> String {
        self.format_ext(&tick)
    }

    /// Where `value` lies, 0 to 1 from the first tick to the last; less or more beyond them.
    pub(crate) fn share(&self, value: f64) -> f64 {
        let (first, last) = (self.ticks[0], self.ticks[self.ticks.len() - 1]);
        if self.scale == Scale::Logarithmic && value <= 0.0 {
            return f64::NEG_INFINITY;
        }
        (self.place(value) - self.place(first)) / (self.place(last) - self.place(first))
    }

    fn place(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => value,
            Scale::Logarithmic => value.ln(),
        }
    }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (first, last): (i32, i32)) -> i32 {
        let Range { start, end } = self.range();
        let share = (self.place(*value) - self.place(start)) / (self.place(end) - self.place(start));
        first + (share * f64::from(last - first)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        // The heavy lines; there are no light ones.
        if hint.weight().allow_light_points() {
            Vec::new()
        } else {
            self.ticks.clone()
        }
    }

    fn range(&self) -> Range<f64> {
        self.ticks[0]..self.ticks[self.ticks.len() - 1]
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, tick: &f64) -> String {
        // Nine digits are more than any chart shows and fewer than rounding spoils.
        let rounded: f64 = format!("{tick:.9}").parse().unwrap_or(*tick);
        format!("{}", if rounded == 0.0 { 0.0 } else { rounded })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decades_cover_what_can_be_shown() {
        let ticks = |values: &[f64]| Axis::decades("y", values.iter().copied(), 4).ticks;
        let about = |found: Vec<f64>, expected: &[f64]| {
            assert_eq!(found.len(), expected.len(), "{found:?}");
            for (found, expected) in found.iter().zip(expected) {
                assert!((found / expected - 1.0).abs() < 1e-12, "{found}");
            }
        };
        about(ticks(&[0.03, 2.0, -1.0, 0.0, f64::NAN]), &[0.01, 0.1, 1.0, 10.0]);
        about(ticks(&[1e-9, 2.0]), &[1e-3, 0.01, 0.1, 1.0, 10.0]);
        about(ticks(&[]), &[0.1, 1.0]);
        about(ticks(&[1.0]), &[1.0, 10.0]);
    }

    #[test]
    fn ticks_are_round_and_cover_the_values() {
        for (high, last, count) in [(0.7, 0.8, 5), (3.31, 4.0, 5), (56.0, 60.0, 7), (1e-3, 1e-3, 6)] {
            let axis = Axis::covering("y", [0.0, high, f64::NAN].into_iter());
            assert!((axis.ticks.last().unwrap() / last - 1.0).abs() < 1e-9, "{axis:?}");
            assert_eq!(axis.ticks.len(), count, "{axis:?}");
        }
        assert_eq!(
            Axis::covering("y", [0.0, 0.7].into_iter()).format_ext(&0.600_000_000_000_1),
            "0.6"
        );
    }
}
