//! How the brightness of repeats goes with time.

use std::fmt;

use serde::Serialize;

use crate::base::student::quantile_95;
use crate::base::text::duration;

/// Seconds of a day.
pub(crate) const DAY_S: f64 = 86_400.0;

/// A straight line through values over time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Drift {
    /// Relative change a day.
    pub per_day: f64,
    /// Its standard uncertainty (k = 1): by what values scatter about the line, and no less than by their noise.
    pub standard_uncertainty: f64,
    /// Whether it is more than chance makes of 19 of 20 series that do not drift; `None` of two values, which any line meets.
    pub is_significant: Option<bool>,
    /// Value of the line on the first day.
    #[serde(skip)]
    pub(crate) start: f64,
    /// From the first to the last value.
    #[serde(skip)]
    span_days: f64,
}

impl fmt::Display for Drift {
    /// A day, or over all the time that there was where that is less.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (times, over) = if self.span_days < 1.0 {
            let all = duration(self.span_days * DAY_S);
            (self.span_days, format!("over their {all}"))
        } else {
            (1.0, "a day".to_owned())
        };
        let verdict = match self.is_significant {
            Some(true) => "significant",
            Some(false) => "not significant",
            None => "two values tell no drift from chance",
        };
        let [drift, sigma] = [self.per_day, self.standard_uncertainty].map(|per_day| 100.0 * times * per_day);
        write!(f, "{drift:+.5} ± {sigma:.5} % {over} (k = 1), {verdict}")
    }
}

impl Drift {
    /// Of relative `values` at `days`, each with this standard uncertainty by `noise`; `None` if they are all of one time.
    pub(crate) fn of(days: &[f64], values: &[f64], noise: f64) -> Option<Self> {
        let count = days.len() as f64;
        let [middle, mean] = [days, values].map(|of| of.iter().sum::<f64>() / count);
        let spread: f64 = days.iter().map(|day| (day - middle).powi(2)).sum();
        if days.len() < 2 || spread <= 0.0 {
            return None;
        }
        let both = || days.iter().zip(values);
        let per_day = both()
            .map(|(day, value)| (day - middle) * (value - mean))
            .sum::<f64>()
            / spread;
        let beside: f64 = both()
            .map(|(day, value)| (value - mean - per_day * (day - middle)).powi(2))
            .sum();
        let freedom = days.len() - 2;
        let residual = if freedom > 0 { beside / freedom as f64 } else { 0.0 };
        let standard_uncertainty = (residual.max(noise * noise) / spread).sqrt();
        let first = days.iter().copied().fold(f64::INFINITY, f64::min);
        let last = days.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Some(Self {
            per_day,
            standard_uncertainty,
            is_significant: (freedom > 0)
                .then(|| per_day.abs() > quantile_95(freedom) * standard_uncertainty),
            start: mean + per_day * (first - middle),
            span_days: last - first,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found_and_chance_is_none() {
        let days = [0.0, 7.0, 14.0, 21.0];
        let rising = Drift::of(&days, &[0.0, 0.0071, 0.0139, 0.021], 1e-5).unwrap();
        assert!(
            (rising.per_day - 1e-3).abs() < 2e-5 && rising.is_significant == Some(true),
            "{rising:?}"
        );
        assert!(
            rising.to_string().ends_with(" % a day (k = 1), significant"),
            "{rising}"
        );
        let quick = Drift::of(&[0.0, 0.25], &[0.0, 0.01], 1e-4).unwrap();
        assert_eq!(
            quick.to_string(),
            "+1.00000 ± 0.01414 % over their 6.0 h (k = 1), two values tell no drift from chance"
        );
        let chance = Drift::of(&days, &[0.001, -0.002, 0.002, 0.0], 1e-5).unwrap();
        assert_eq!(chance.is_significant, Some(false));
        // Noise explains it.
        assert_eq!(
            Drift::of(&days, &[0.0, 0.0071, 0.0139, 0.021], 0.02)
                .unwrap()
                .is_significant,
            Some(false)
        );
        assert_eq!(
            Drift::of(&[0.0, 1.0], &[0.0, 1.0], 0.0).unwrap().is_significant,
            None
        );
        assert_eq!(Drift::of(&[3.0, 3.0], &[0.0, 1.0], 0.0), None);
    }
}
