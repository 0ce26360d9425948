//! Exposure brackets: several exposures of different length of each pattern, for high dynamic range.
//!
//! # Design
//! Neighbours are at most [`LARGEST_RATIO`] apart: where the longer one just saturates, the shorter one still gathers a quarter
//! of the full well, so that with 20,000 e⁻ no value between the ends is worse than 1.4 %. Wider steps are accepted
//! where they are asked for, up to [`largest_ratio`]: beyond, a signal could saturate the one and drown in the noise of
//! the other.

use std::fmt;
use std::str::FromStr;

use serde::de::{Error as _, Unexpected};
use serde::{Deserialize, Deserializer, Serialize};

use crate::instrument::rig::Rig;

/// Largest ratio of neighbouring exposure times that is proposed.
pub const LARGEST_RATIO: f64 = 4.0;
/// Most exposures of one pattern.
pub const MOST_EXPOSURES: usize = 8;
/// Where the longer of two neighbours saturates, the signal of the shorter must be so many times its noise without light.
const CLEAR: f64 = 10.0;

/// What brackets are written as.
const EXPECTED: &str = "`auto`, a number from 1 to 8, or 2 to 8 different exposure times in ms from 0.001 to 60000, with \
                        commas between them";

/// Which exposures of each pattern are taken.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(into = "String")]
pub enum Brackets {
    /// One.
    #[default]
    One,
    /// As many as a pilot capture proposes.
    Auto,
    /// So many, 2 to [`MOST_EXPOSURES`], between the shortest and the longest time that a pilot capture proposes.
    Number(usize),
    /// These exposure times in ms, ascending.
    TimesMs(Vec<f64>),
}

impl FromStr for Brackets {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("expected {EXPECTED}");
        if text == "auto" {
            return Ok(Self::Auto);
        }
        if !text.contains(',') {
            return match text.parse() {
                Ok(1) => Ok(Self::One),
                Ok(number @ 2..=MOST_EXPOSURES) => Ok(Self::Number(number)),
                _ => Err(wrong()),
            };
        }
        let mut times_ms = text
            .split(',')
            .map(|time| time.trim().parse::<f64>())
            .collect::<Result<Vec<_>, _>>()
            .map_err(|_| wrong())?;
        times_ms.sort_by(f64::total_cmp);
        let in_range = times_ms.iter().all(|ms| (1e-3..=6e4).contains(ms));
        let different = times_ms.windows(2).all(|pair| pair[0] < pair[1]);
        if in_range && different && times_ms.len() <= MOST_EXPOSURES {
            Ok(Self::TimesMs(times_ms))
        } else {
            Err(wrong())
        }
    }
}

impl fmt::Display for Brackets {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::One => f.write_str("1"),
            Self::Auto => f.write_str("auto"),
            Self::Number(number) => write!(f, "{number}"),
            Self::TimesMs(times_ms) => {
                let times: Vec<String> = times_ms.iter().map(f64::to_string).collect();
                f.write_str(&times.join(","))
            }
        }
    }
}

impl<'de> Deserialize<'de> for Brackets {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        text.parse()
            .map_err(|_| D::Error::invalid_value(Unexpected::Str(&text), &EXPECTED))
    }
}

impl From<Brackets> for String {
    fn from(brackets: Brackets) -> Self {
        brackets.to_string()
    }
}

impl Brackets {
    /// Whether it is one exposure of each pattern.
    #[must_use]
    pub fn is_one(&self) -> bool {
        *self == Self::One
    }

    /// The exposure times in s if they are given, ascending.
    #[must_use]
    pub fn times_s(&self) -> Option<Vec<f64>> {
        match self {
            Self::TimesMs(times_ms) => Some(times_ms.iter().map(|ms| ms * 1e-3).collect()),
            _ => None,
        }
    }
}

/// The largest ratio of neighbouring exposure times on `rig`: where the longer one saturates, the shorter one's signal
/// is still `CLEAR` times its noise without light.
#[must_use]
pub fn largest_ratio(rig: &Rig) -> f64 {
    rig.range_dn() / (CLEAR * dark_noise_dn(rig, 0.0))
}

/// Standard deviation of a pixel without light in an exposure of `exposure_s` seconds, in digital numbers: read noise,
/// rounding and the shot noise of the dark current.
#[must_use]
pub fn dark_noise_dn(rig: &Rig, exposure_s: f64) -> f64 {
    rig.dark_variance_e2(exposure_s).sqrt() / rig.gain_e_per_dn()
}

/// `count` times in s from `shortest_s` to `longest_s`, each the same multiple of the one before.
#[must_use]
pub fn geometric(shortest_s: f64, longest_s: f64, count: usize) -> Vec<f64> {
    let last = count.saturating_sub(1).max(1) as f64;
    (0..count)
        .map(|at| shortest_s * (longest_s / shortest_s).powf(at as f64 / last))
        .collect()
}

/// Times in s as milliseconds for people, without the unit.
#[must_use]
pub fn milliseconds(times_s: &[f64]) -> String {
    let times: Vec<String> = times_s.iter().map(|s| format!("{:.3}", s * 1e3)).collect();
    times.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instrument::rig::ROUNDING_DN2;

    #[test]
    fn what_is_written_is_read_again() {
        for (text, brackets) in [
            ("1", Brackets::One),
            ("auto", Brackets::Auto),
            ("4", Brackets::Number(4)),
            ("0.5,4,33.3", Brackets::TimesMs(vec![0.5, 4.0, 33.3])),
        ] {
            assert_eq!(text.parse(), Ok(brackets.clone()));
            assert_eq!(brackets.to_string(), text);
        }
        assert_eq!(
            "33, 4".parse(),
            Ok(Brackets::TimesMs(vec![4.0, 33.0])),
            "ascending"
        );
        for text in [
            "",
            "0",
            "9",
            "-1",
            "many",
            "4,",
            "4,4",
            "4,nan",
            "4,70000",
            "1,2,3,4,5,6,7,8,9",
        ] {
            let error = text.parse::<Brackets>().unwrap_err();
            assert!(error.starts_with("expected `auto`"), "{text}");
        }
    }

    #[test]
    fn at_the_largest_ratio_what_saturates_the_longer_is_ten_times_the_noise_of_the_shorter() {
        let mut rig = Rig::load("rcg-1-16bit").unwrap();
        (rig.camera.bits, rig.camera.dark_dn) = (12, 16.0);
        let full_dn = 4095.0 - 16.0;
        let noise_dn = ((3.0 * full_dn / 20_000.0_f64).powi(2) + ROUNDING_DN2).sqrt();
        assert!((full_dn / largest_ratio(&rig) / noise_dn - 10.0).abs() < 1e-9);
        assert!(largest_ratio(&rig) > LARGEST_RATIO);
    }

    #[test]
    fn the_times_between_are_equal_multiples() {
        let times = geometric(0.004, 1.024, 5);
        assert_eq!((times.len(), times[0]), (5, 0.004));
        for pair in times.windows(2) {
            assert!((pair[1] / pair[0] - 4.0).abs() < 1e-9);
        }
    }
}
