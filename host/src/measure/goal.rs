//! When an adaptive measurement is done.

use serde::{Deserialize, Serialize};

/// Captures with light that a measurement without a budget takes at most.
const MOST_CAPTURES: usize = 4096;
/// The fewest that say anything.
const FEWEST_CAPTURES: usize = 16;

/// What is to be reached.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Goal {
    /// Predicted PSNR in dB at which to stop; `None` to use up the budget.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_db: Option<f64>,
    /// Captures with light at most.
    pub budget: usize,
}

/// A goal that makes no sense.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GoalError {
    /// The target.
    #[error("target: expected a PSNR from 1 to 200 dB such as 40dB, found `{0}`")]
    Target(String),
    /// The budget.
    #[error("budget: expected {FEWEST_CAPTURES} to {MOST_CAPTURES} captures, found {0}")]
    Budget(usize),
    /// Fewer captures than the coarse beginning takes.
    #[error(
        "budget: expected at least {start} captures for the directions of --grid that can be lit, from which the adaptive \
         ones are chosen, found {budget}"
    )]
    Start {
        /// Directions of the beginning.
        start: usize,
        /// What was asked for.
        budget: usize,
    },
    /// Neither.
    #[error("adaptive: expected a target in dB, a budget of captures, or both, found none")]
    None,
}

/// Why an adaptive measurement ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stop {
    /// The predicted PSNR is that of the target.
    Target,
    /// So many captures were allowed.
    Budget,
    /// Noise is most of the predicted error.
    Noise,
    /// The spots of light would overlap.
    Spot,
}

/// How an adaptive measurement went.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Adapted {
    /// Captures with light.
    pub captures: usize,
    /// Predicted PSNR in dB of f·cosθi in luminance at exposure 1, clipped to 1; `None` without an error.
    pub predicted_db: Option<f64>,
    /// The part of noise alone: no number of captures gets beyond; `None` without noise.
    pub noise_limit_db: Option<f64>,
    /// The goal.
    pub goal: Goal,
    /// Why it ended.
    pub stop: Stop,
    /// (captures, predicted PSNR in dB) after each batch.
    pub history: Vec<(usize, Option<f64>)>,
}

impl Goal {
    /// The goal of a target such as `40dB` or `40`, a budget, or both.
    ///
    /// # Errors
    /// [`GoalError`].
    pub fn new(target: Option<&str>, budget: Option<usize>) -> Result<Self, GoalError> {
        let target_db = target.map(parse_db).transpose()?;
        if target_db.is_none() && budget.is_none() {
            return Err(GoalError::None);
        }
        let budget = budget.unwrap_or(MOST_CAPTURES);
        if !(FEWEST_CAPTURES..=MOST_CAPTURES).contains(&budget) {
            return Err(GoalError::Budget(budget));
        }
        Ok(Self { target_db, budget })
    }
}

impl std::fmt::Display for Goal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(target_db) = self.target_db {
            write!(f, "{target_db} dB within ")?;
        }
        write!(f, "{} captures", self.budget)
    }
}

fn parse_db(text: &str) -> Result<f64, GoalError> {
    let number = text
        .strip_suffix("dB")
        .or_else(|| text.strip_suffix("db"))
        .unwrap_or(text);
    match number.trim().parse::<f64>() {
        Ok(db) if (1.0..=200.0).contains(&db) => Ok(db),
        _ => Err(GoalError::Target(text.to_owned())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_numbers_of_decibels_and_budgets_are_not_empty() {
        for text in ["40dB", "40", "40 dB", "40.0db"] {
            assert_eq!(
                Goal::new(Some(text), None).unwrap().target_db,
                Some(40.0),
                "{text}"
            );
        }
        for text in ["", "dB", "40 apples", "-3dB", "NaN", "inf dB", "40%"] {
            assert_eq!(
                Goal::new(Some(text), None),
                Err(GoalError::Target(text.to_owned()))
            );
        }
        assert_eq!(Goal::new(None, Some(0)), Err(GoalError::Budget(0)));
        assert_eq!(Goal::new(None, None), Err(GoalError::None));
        assert_eq!(Goal::new(None, Some(100)).unwrap().budget, 100);
    }
}
