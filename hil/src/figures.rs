//! The figures that trials find, their limits, and the table of them.

use std::fmt::{self, Write as _};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::{fs, io};

use serde::Serialize;

/// What a figure has to be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Limit {
    /// Exactly this.
    Exactly(f64),
    /// This or less.
    AtMost(f64),
    /// This or more.
    AtLeast(f64),
    /// Anything: it is only reported.
    Reported,
}

impl Limit {
    fn holds(self, value: f64) -> bool {
        #[allow(clippy::float_cmp)] // counts and ticks, which f64 holds exactly
        match self {
            Self::Exactly(limit) => value == limit,
            Self::AtMost(limit) => value <= limit,
            Self::AtLeast(limit) => value >= limit,
            Self::Reported => true,
        }
    }
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exactly(limit) => write!(f, "= {}", number(*limit)),
            Self::AtMost(limit) => write!(f, "≤ {}", number(*limit)),
            Self::AtLeast(limit) => write!(f, "≥ {}", number(*limit)),
            Self::Reported => Ok(()),
        }
    }
}

/// One figure.
#[derive(Clone, Debug, Serialize)]
pub struct Figure {
    /// The trial that found it: `device::topic::what`.
    pub trial: String,
    /// What it is.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Unit of value and limit.
    pub unit: &'static str,
    /// What it has to be.
    pub limit: Limit,
    /// Whether it is.
    pub holds: bool,
}

/// A figure that is beyond its limit.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{name}: expected {limit} {unit}, found {}", number(*.value))]
pub struct BeyondLimit {
    name: String,
    value: f64,
    unit: &'static str,
    limit: Limit,
}

/// The figures of all trials.
#[derive(Debug, Default)]
pub struct Figures(Mutex<Vec<Figure>>);

impl Figures {
    /// Takes a figure down.
    ///
    /// # Errors
    /// [`BeyondLimit`]; it is taken down all the same.
    pub fn record(
        &self,
        trial: &str,
        name: &str,
        value: f64,
        unit: &'static str,
        limit: Limit,
    ) -> Result<(), BeyondLimit> {
        let holds = limit.holds(value);
        let figure = Figure {
            trial: trial.to_owned(),
            name: name.to_owned(),
            value,
            unit,
            limit,
            holds,
        };
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(figure);
        if holds {
            Ok(())
        } else {
            Err(BeyondLimit {
                name: name.to_owned(),
                value,
                unit,
                limit,
            })
        }
    }

    fn sorted(&self) -> Vec<Figure> {
        let mut figures = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        figures.sort_by(|a, b| a.trial.cmp(&b.trial)); // stable: in a trial as they were found
        figures
    }

    /// The table for people: one line a figure below the name of its trial, those beyond their limits marked.
    #[must_use]
    pub fn table(&self) -> String {
        let figures = self.sorted();
        let width = |of: &dyn Fn(&Figure) -> usize| figures.iter().map(of).max().unwrap_or(0);
        let name_width = width(&|f| f.name.chars().count());
        let value_width = width(&|f| number(f.value).chars().count());
        let mut table = String::new();
        let mut last = "";
        for figure in &figures {
            if figure.trial != last {
                writeln!(table, "{}", figure.trial).expect("a string takes everything");
                last = &figure.trial;
            }
            let value = number(figure.value);
            let limit = figure.limit.to_string();
            let mark = if figure.holds {
                ""
            } else {
                "  <-- beyond its limit"
            };
            writeln!(
                table,
                "    {:name_width$}  {value:>value_width$} {:8} {limit}{mark}",
                figure.name, figure.unit
            )
            .expect("a string takes everything");
        }
        table
    }

    /// Writes them as JSON, for programs.
    ///
    /// # Errors
    /// What the system says.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        let json = serde_json::to_string_pretty(&self.sorted()).expect("figures are plain values");
        fs::write(path, json + "\n")
    }
}

/// A number with thousands marked, and up to three decimals.
fn number(value: f64) -> String {
    let text = format!("{value:.3}");
    let (whole, fraction) = text.split_once('.').unwrap_or((&text, ""));
    let fraction = fraction.trim_end_matches('0');
    let (sign, digits) = whole
        .strip_prefix('-')
        .map_or(("", whole), |digits| ("-", digits));
    let mut number = sign.to_owned();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            number.push(',');
        }
        number.push(digit);
    }
    if !fraction.is_empty() {
        number.push('.');
        number.push_str(fraction);
    }
    number
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_for_people() {
        assert_eq!(number(32_400.0), "32,400");
        assert_eq!(number(0.125), "0.125");
        assert_eq!(number(-1_234_567.5), "-1,234,567.5");
        assert_eq!(number(100.0), "100");
    }

    #[test]
    fn a_figure_beyond_its_limit_is_an_error_and_is_marked() {
        let figures = Figures::default();
        figures
            .record("a", "jitter", 0.0, "ticks", Limit::Exactly(0.0))
            .unwrap();
        let error = figures
            .record("b", "jitter", 1.0, "ticks", Limit::Exactly(0.0))
            .unwrap_err();
        assert_eq!(error.to_string(), "jitter: expected = 0 ticks, found 1");
        let table = figures.table();
        assert_eq!(table.matches("beyond").count(), 1);
        let trials: Vec<&str> = table.lines().filter(|line| !line.starts_with(' ')).collect();
        assert_eq!(trials, ["a", "b"]);
        assert!(table.lines().last().unwrap().contains("beyond"), "{table}");
        assert!(!Limit::AtMost(3.0).holds(3.5) && Limit::AtLeast(3.0).holds(3.0));
    }
}
