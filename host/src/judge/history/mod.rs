//! Control chart of a check standard: the same sample, measured again and again over weeks.
//!
//! # Design
//! Each measurement's value is the ratio of its f to that of all together, or of the first, over the directions that all have and know
//! well, channel by channel (`judge/repeats/departures`). In the order of time it is an individuals chart (ISO 7870-2): the
//! standard deviation is the median of the ranges between successive values over 0.954, which neither one value that is off, of six and
//! more, nor a slow drift spoils, and no less than the noise that values state. The mean line is the mean of the values within the action lines about the
//! median. Lines at 2 and 3 standard deviations warn and call for action.
//!
//! Signals are the rules of Western Electric's *Statistical Quality Control Handbook* (1956): one value beyond 3, two of three beyond 2 on
//! one side, eight in a row on one side.

mod picture;
#[cfg(test)]
mod tests;

use serde::Serialize;

use crate::base::blame::Blame;
use crate::base::median::median;
use crate::brdf::BrdfError;
use crate::judge::repeats::{
    Departure, Drift, Member, Repeat, check_alike, days_of, departures, drift_of, members,
};

/// Median of the range of two normal values, in standard deviations.
const MEDIAN_RANGE: f64 = 0.954;
/// Standard deviations to the lines that warn and call for action.
pub const WARNING: f64 = 2.0;
/// See [`WARNING`].
pub const ACTION: f64 = 3.0;
/// Coverage factor of the uncertainties of values.
const K: f64 = 2.0;
/// Values in a row on one side of the mean that are no chance.
const IN_A_ROW: usize = 8;
/// Values below which lines say little.
const FEW: usize = 8;

/// Why there is no chart.
#[derive(Debug, thiserror::Error)]
pub enum HistoryError {
    /// A file, or what differs between two.
    #[error(transparent)]
    Brdf(#[from] BrdfError),
    /// A measurement that does not say when it was made.
    #[error("{name}: session.json: expected a measurement with the time at which it began, found none")]
    Undated {
        /// As it was named.
        name: String,
    },
    /// Measurements without common directions.
    #[error(
        "{name}: f: expected at least 30 pairs of directions with θ ≤ 80° that all measurements have, found fewer"
    )]
    Nothing {
        /// The first.
        name: String,
    },
}

impl Blame for HistoryError {
    fn is_input(&self) -> bool {
        match self {
            Self::Brdf(error) => error.is_input(),
            Self::Undated { .. } | Self::Nothing { .. } => true,
        }
    }
}

/// What values are over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Over {
    /// The mean of all.
    Mean,
    /// The first in time.
    First,
}

/// One measurement.
#[derive(Clone, Debug, Serialize)]
pub struct Point {
    /// As it was named.
    pub name: String,
    /// When it began.
    pub began: String,
    /// Days since the first.
    pub days: f64,
    /// By channel, f over that of all, or of the first.
    pub values: Vec<f64>,
    /// Expanded uncertainty (k = 2) of each, without what all have in common.
    pub expanded_uncertainties: Vec<f64>,
}

/// The lines of one channel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Lines {
    /// The mean line.
    pub mean: f64,
    /// Standard deviation of one value.
    pub standard_deviation: f64,
    /// Standard uncertainty (k = 1) by noise that values state, the median.
    pub noise: f64,
    /// The change over time; `None` if all are of one time.
    pub drift: Option<Drift>,
}

impl Lines {
    /// The line so many standard deviations from the mean.
    #[must_use]
    pub fn at(&self, deviations: f64) -> f64 {
        self.mean + deviations * self.standard_deviation
    }
}

/// A rule that a value breaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rule {
    /// One value beyond an action line.
    BeyondAction,
    /// Two of three successive values beyond a warning line, on one side.
    TwoOfThreeBeyondWarning,
    /// Eight successive values on one side of the mean.
    EightOnOneSide,
}

impl Rule {
    /// In words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::BeyondAction => "beyond an action line (3 standard deviations)",
            Self::TwoOfThreeBeyondWarning => {
                "the second of three beyond a warning line (2 standard deviations)"
            }
            Self::EightOnOneSide => "the eighth in a row on one side of the mean",
        }
    }
}

/// A value that breaks a rule.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Signal {
    /// The measurement.
    pub name: String,
    /// Its place in the order of time, from 0.
    pub number: usize,
    /// Channel, from 0.
    pub channel: usize,
    /// The rule.
    pub rule: Rule,
    /// Standard deviations from the mean.
    pub deviations: f64,
}

/// A control chart.
#[derive(Clone, Debug, Serialize)]
pub struct History {
    /// What values are over.
    pub over: Over,
    /// What the channels are called, see [`crate::brdf::Brdf::channel_labels`].
    pub channels: Vec<String>,
    /// The measurements in the order of time.
    pub points: Vec<Point>,
    /// The lines of each channel.
    pub lines: Vec<Lines>,
    /// Values that break rules.
    pub signals: Vec<Signal>,
    /// What is to be known of it, in sentences.
    pub warnings: Vec<String>,
}

impl History {
    /// Of at least two measurements of one sample, in any order.
    ///
    /// # Errors
    /// [`HistoryError`].
    pub fn of(mut repeats: Vec<Repeat>, over: Over) -> Result<Self, HistoryError> {
        if let Some(undated) = repeats.iter().find(|repeat| repeat.began.is_none()) {
            return Err(HistoryError::Undated {
                name: undated.name.clone(),
            });
        }
        // All are written alike, in UTC; of one time they stay in the order given.
        repeats.sort_by_key(|repeat| repeat.began.as_deref().and_then(crate::base::date::unix_s));
        check_alike(&repeats)?;
        let departures = departures(&repeats)?;
        let reference = (over == Over::First).then_some(0);
        let members = members(&repeats, &departures, reference);
        Self::of_members(&members, over, repeats[0].brdf.channel_labels()).ok_or_else(|| {
            HistoryError::Nothing {
                name: repeats[0].name.clone(),
            }
        })
    }

    /// Of members in the order of time, whose `channels` are called so; `None` if one has no value or no date.
    fn of_members(members: &[Member], over: Over, channels: Vec<String>) -> Option<Self> {
        let days = days_of(members)?;
        let points: Vec<Point> = members
            .iter()
            .zip(days)
            .map(|(member, days)| {
                let each: Vec<Departure> = member.departures.iter().copied().collect::<Option<_>>()?;
                Some(Point {
                    name: member.name.clone(),
                    began: member.began.clone()?,
                    days,
                    values: each.iter().map(|one| 1.0 + one.relative).collect(),
                    expanded_uncertainties: each.iter().map(|one| K * one.standard_uncertainty).collect(),
                })
            })
            .collect::<Option<_>>()?;
        let drift = drift_of(members);
        let lines: Vec<Lines> = (0..points.first()?.values.len())
            .map(|channel| {
                let values: Vec<f64> = points.iter().map(|point| point.values[channel]).collect();
                let noise = members
                    .iter()
                    .filter_map(|member| Some(member.departures[channel]?.noise));
                let noise = median(noise.collect()).unwrap_or(0.0);
                lines(&values, noise, drift.get(channel).copied())
            })
            .collect();
        let mut found = Self {
            over,
            channels,
            signals: signals(&points, &lines),
            points,
            lines,
            warnings: Vec::new(),
        };
        found.warnings = found.warnings();
        Some(found)
    }

    /// Whether a value breaks a rule.
    #[must_use]
    pub const fn is_out_of_control(&self) -> bool {
        !self.signals.is_empty()
    }

    /// What a channel is called; one that is alone may have no name.
    #[must_use]
    pub fn colour(&self, channel: usize) -> &str {
        &self.channels[channel]
    }

    fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.is_out_of_control() {
            let mut names: Vec<&str> = self.signals.iter().map(|signal| signal.name.as_str()).collect();
            names.dedup();
            warnings.push(format!("control: out of control at {}", names.join(", ")));
        }
        if self.points.len() < FEW {
            warnings.push(format!(
                "control: {} measurements say little of how much one differs from the next; {FEW} and more do",
                self.points.len()
            ));
        }
        let drifts = self.lines.iter().filter_map(|lines| lines.drift?.is_significant);
        if drifts.into_iter().any(|is_significant| is_significant) {
            warnings.push("drift: values go with time".to_owned());
        }
        warnings
    }
}

/// The lines of `values` in the order of time, each with this standard uncertainty by noise.
fn lines(values: &[f64], noise: f64, drift: Option<Drift>) -> Lines {
    let ranges = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let by_ranges = median(ranges.collect()).unwrap_or(0.0) / MEDIAN_RANGE;
    let standard_deviation = by_ranges.max(noise);
    let middle = median(values.to_vec()).unwrap_or(1.0);
    let within: Vec<f64> = values
        .iter()
        .copied()
        .filter(|value| (value - middle).abs() <= ACTION * standard_deviation)
        .collect();
    Lines {
        mean: within.iter().sum::<f64>() / within.len() as f64,
        standard_deviation,
        noise,
        drift,
    }
}

/// The values that break rules, by channel in the order of time.
fn signals(points: &[Point], lines: &[Lines]) -> Vec<Signal> {
    let mut found = Vec::new();
    for (number, point) in points.iter().enumerate() {
        for (channel, lines) in lines.iter().enumerate() {
            let deviations: Vec<f64> = points[..=number]
                .iter()
                .map(|point| {
                    let beside = point.values[channel] - lines.mean;
                    // Of no deviation at all nothing is beyond.
                    if beside == 0.0 {
                        0.0
                    } else {
                        beside / lines.standard_deviation
                    }
                })
                .collect();
            for rule in broken(&deviations) {
                found.push(Signal {
                    name: point.name.clone(),
                    number,
                    channel,
                    rule,
                    deviations: deviations[number],
                });
            }
        }
    }
    found
}

/// The rules that the last of these values, in standard deviations from the mean, breaks.
fn broken(deviations: &[f64]) -> Vec<Rule> {
    let Some(last) = deviations.last().copied() else {
        return Vec::new();
    };
    let side = |value: f64| value * last.signum();
    let recent = |count: usize| &deviations[deviations.len().saturating_sub(count)..];
    let is_beyond = |value: &&f64| side(**value) > WARNING;
    let mut rules = Vec::new();
    if last.abs() > ACTION {
        rules.push(Rule::BeyondAction);
    }
    if last.abs() > WARNING && recent(3).iter().filter(is_beyond).count() >= 2 {
        rules.push(Rule::TwoOfThreeBeyondWarning);
    }
    if deviations.len() >= IN_A_ROW && recent(IN_A_ROW).iter().all(|value| side(*value) > 0.0) {
        rules.push(Rule::EightOnOneSide);
    }
    rules
}
