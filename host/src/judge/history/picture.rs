//! A control chart as a picture and as a table.

use std::fmt::Write as _;

use super::{ACTION, History, Over, Point, WARNING};
use crate::base::text::quoted;
use crate::judge::chart::{Axis, Chart, Curve};

/// Expanded uncertainties so many times as far as the lines of action are told in place of drawn: what all measurements have in
/// common would hide how they differ.
const FAR: f64 = 5.0;

impl History {
    /// A chart of each channel.
    #[must_use]
    pub fn charts(&self, title: &str) -> Vec<Chart> {
        let channels = 0..self.lines.len();
        channels.map(|channel| self.chart(title, channel)).collect()
    }

    /// Value of each measurement with its expanded uncertainty (k = 2), and the lines, percent beside 1, of a `channel`.
    fn chart(&self, title: &str, channel: usize) -> Chart {
        let lines = &self.lines[channel];
        let last = self.points.last().map_or(0.0, |point| point.days);
        let flat = |label: &str, of: [f64; 2]| Curve {
            band: Vec::new(),
            label: label.to_owned(),
            // One curve of two lines, with a gap between.
            points: of
                .into_iter()
                .flat_map(|value| {
                    [
                        (0.0, Some(percent(value))),
                        (last, Some(percent(value))),
                        (last, None),
                    ]
                })
                .collect(),
        };
        let mut curves = vec![
            self.of_points("value", |point| vec![Some(point.values[channel])]),
            self.uncertainties(channel),
            flat(
                "action (3 s)",
                [-ACTION, ACTION].map(|deviations| lines.at(deviations)),
            ),
            flat("mean", [lines.mean; 2]),
            flat(
                "warning (2 s)",
                [-WARNING, WARNING].map(|deviations| lines.at(deviations)),
            ),
        ];
        if let Some(drift) = lines.drift {
            let ends = [0.0, last].map(|days| (days, Some(100.0 * (drift.start + drift.per_day * days))));
            curves.push(Curve {
                band: Vec::new(),
                label: "drift".to_owned(),
                points: ends.to_vec(),
            });
        }
        let values: Vec<f64> = curves
            .iter()
            .flat_map(|curve| curve.points.iter().filter_map(|point| point.1))
            .collect();
        let over = match self.over {
            Over::Mean => "the mean",
            Over::First => "the first",
        };
        let first = self.points.first().map_or("", |point| point.began.as_str());
        let colour = self.colour(channel);
        let comma = if colour.is_empty() { "" } else { ", " };
        Chart {
            title: title.to_owned(),
            x: Axis::covering(
                &format!("days since {first}"),
                self.points.iter().map(|point| point.days),
            ),
            y: Axis::covering(&format!("f over that of {over}, less 1 (%)"), values.into_iter()),
            legend: format!("check standard{comma}{colour}"),
            marks: true,
            curves,
        }
    }

    /// The values `of` each point, percent beside 1; `None` is a gap.
    fn of_points(&self, label: &str, of: impl Fn(&Point) -> Vec<Option<f64>>) -> Curve {
        let at = |point: &Point| {
            let days = point.days;
            let percents = of(point).into_iter().map(|value| value.map(percent));
            percents.map(move |value| (days, value)).collect::<Vec<_>>()
        };
        Curve {
            band: Vec::new(),
            label: label.to_owned(),
            points: self.points.iter().flat_map(at).collect(),
        }
    }

    /// The expanded uncertainties of a `channel` as bars, or the largest in words where they are out of all proportion.
    fn uncertainties(&self, channel: usize) -> Curve {
        let lines = &self.lines[channel];
        let halves = self
            .points
            .iter()
            .map(|point| point.expanded_uncertainties[channel]);
        let largest = halves.fold(0.0, f64::max);
        if largest > FAR * (lines.at(ACTION) - lines.mean) {
            return self.of_points(&format!("U to {:.2} %", 100.0 * largest), |_| Vec::new());
        }
        self.of_points("± U (k = 2)", |point| {
            let (value, half) = (point.values[channel], point.expanded_uncertainties[channel]);
            vec![Some(value - half), Some(value + half), None]
        })
    }

    /// The table: a row per measurement and channel.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut table = "measurement,began,days,channel,band,value,expanded_uncertainty,mean,warning_low,warning_high,action_low,\
                         action_high,drift_line,deviations,signals\n"
            .to_owned();
        for (number, point) in self.points.iter().enumerate() {
            for (channel, lines) in self.lines.iter().enumerate() {
                let signals = self
                    .signals
                    .iter()
                    .filter(|one| one.number == number && one.channel == channel);
                let words: Vec<&str> = signals.map(|signal| signal.rule.words()).collect();
                let drift = lines
                    .drift
                    .map(|drift| format!("{:.6}", 1.0 + drift.start + drift.per_day * point.days));
                writeln!(
                    table,
                    "{},{},{:.6},{channel},{},{:.6},{:.6},{:.6},{:.6},{:.6},{:.6},{:.6},{},{:.3},{}",
                    quoted(&point.name),
                    point.began,
                    point.days,
                    quoted(self.colour(channel)),
                    point.values[channel],
                    point.expanded_uncertainties[channel],
                    lines.mean,
                    lines.at(-WARNING),
                    lines.at(WARNING),
                    lines.at(-ACTION),
                    lines.at(ACTION),
                    drift.unwrap_or_default(),
                    (point.values[channel] - lines.mean) / lines.standard_deviation,
                    words.join("; ")
                )
                .expect("strings take everything");
            }
        }
        table
    }
}

/// How far a value is from 1, percent.
fn percent(value: f64) -> f64 {
    100.0 * (value - 1.0)
}
