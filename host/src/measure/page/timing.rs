//! When exposures began after their triggers, as a histogram.

use crate::judge::chart::{Axis, Chart, Curve, svg};
use crate::store::{RawStore, StoreError};

/// Bars of the histogram.
const BARS: usize = 40;

/// From the trigger of each exposure to where its strobe says that it began, over all exposures of a measurement.
pub(super) struct Timing {
    /// Delays in ticks, ascending, each with how often it was seen.
    counts: std::collections::BTreeMap<u64, usize>,
    hz: f64,
    without: usize,
}

impl Timing {
    /// Of the `raw` frames of a measurement, whose controller counts `hz` ticks a second.
    ///
    /// # Errors
    /// [`StoreError`] if they cannot be read.
    pub(super) fn of(raw: &RawStore, hz: f64) -> Result<Self, StoreError> {
        let mut timing = Self {
            counts: std::collections::BTreeMap::new(),
            hz,
            without: 0,
        };
        for segment in 0..raw.segments() {
            for record in raw.read_records(segment)? {
                match record.strobe_on_tick.checked_sub(record.trigger_tick) {
                    // No time is the largest number.
                    Some(ticks) if record.strobe_on_tick != u64::MAX => {
                        *timing.counts.entry(ticks).or_default() += 1;
                    }
                    _ => timing.without += 1,
                }
            }
        }
        Ok(timing)
    }

    /// What it comes to, in words.
    pub(super) fn sentence(&self) -> String {
        let all: usize = self.counts.values().sum();
        let without = match self.without {
            0 => String::new(),
            without => format!("; {without} exposures have no strobe"),
        };
        let (Some(first), Some(last)) = (self.counts.keys().next(), self.counts.keys().last()) else {
            return format!("No strobe was seen{without}");
        };
        let mean = self
            .counts
            .iter()
            .map(|(ticks, count)| *ticks as f64 * *count as f64)
            .sum::<f64>()
            / all as f64;
        let squares = |(ticks, count): (&u64, &usize)| (*ticks as f64 - mean).powi(2) * *count as f64;
        let spread = (self.counts.iter().map(squares).sum::<f64>() / all as f64).sqrt();
        format!(
            "Exposures began {:.3} µs after their triggers (mean of {all}; {:.3} to {:.3} µs, standard deviation {:.3} µs; a tick is {:.1} \
             ns){without}",
            self.us(mean),
            self.us(*first as f64),
            self.us(*last as f64),
            self.us(spread),
            1e9 / self.hz
        )
    }

    fn us(&self, ticks: f64) -> f64 {
        1e6 * ticks / self.hz
    }

    /// The histogram, as SVG; nothing without strobes.
    pub(super) fn histogram(&self) -> Option<String> {
        let (first, last) = (*self.counts.keys().next()?, *self.counts.keys().last()?);
        // Whole ticks, so that no bar has more room than another, and an empty one at either end.
        let ticks = ((last - first) / BARS as u64 + 1).max(1);
        let bars = (last - first) / ticks + 1;
        let height = |bar: u64| {
            let from = first + bar * ticks;
            self.counts
                .range(from..from + ticks)
                .map(|(_, count)| *count as f64)
                .sum::<f64>()
        };
        let begin = |bar: f64| self.us(first as f64 + (bar - 0.5) * ticks as f64);
        let mut points = vec![(begin(-1.0), Some(0.0)), (begin(0.0), Some(0.0))];
        for bar in 0..bars {
            points.push((begin(bar as f64), Some(height(bar))));
            points.push((begin(bar as f64 + 1.0), Some(height(bar))));
        }
        points.extend([
            (begin(bars as f64), Some(0.0)),
            (begin(bars as f64 + 1.0), Some(0.0)),
        ]);
        let xs = points.iter().map(|point| point.0);
        let x = Axis::covering("start of the exposure after its trigger, µs", xs);
        let y = Axis::covering("exposures", points.iter().filter_map(|point| point.1));
        Some(svg(&[Chart {
            title: "Triggers against strobes".to_owned(),
            x,
            y,
            legend: String::new(),
            marks: false,
            curves: vec![Curve {
                band: Vec::new(),
                label: "all exposures".to_owned(),
                points,
            }],
        }]))
    }
}
