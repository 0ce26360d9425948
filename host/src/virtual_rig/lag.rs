//! What is left of the pattern before when a new one counts as settled.
//!
//! # Design
//! Cells of liquid crystal approach their new state more and more slowly: data sheets state the time from 10 to 90 % of a change, after
//! which the rest fades about exponentially (Yang and Wu, *Fundamentals of Liquid Crystal Devices*, 2nd ed. 2014, ch. 5), the slower
//! modes last. A rig says after which time it takes a pattern for settled; how much is left then is the flaw, and how fast that fades
//! follows: the time constant is such that this much is left. A fifth of it fades three times as slowly.

use std::ops::RangeInclusive;

use rand::SeedableRng as _;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};

use super::flaws::log_uniform;
use crate::instrument::rig::Panel;

/// Shares of a change that are left: usually 0.5 %, which five time constants leave; 2 % where a rig hurries.
pub const LAGS: RangeInclusive<f64> = 2e-3..=2e-2;
/// Share of what is left that fades so many times as slowly.
const SLOW: (f64, f64) = (0.2, 3.0);
/// What tells the chance of lag from that of the rest of the rig: the letters of `lag`.
const STREAM: u64 = 0x006c_6167;

/// The lag of a projector.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lag {
    /// Share of a change of light that is left when a new pattern counts as settled; none of mirrors.
    pub share: f64,
}

impl Lag {
    /// By chance. Its chance is its own, so that it changes no other flaw that follows from the `seed`.
    pub(super) fn drawn(seed: u64, panel: Panel) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed ^ STREAM);
        match panel {
            Panel::LiquidCrystal => Self {
                share: log_uniform(LAGS, &mut rng),
            },
            Panel::Mirrors => Self::default(),
        }
    }

    /// For how many seconds of those from `from_s` to `to_s`, counted from when a pattern counts as settled, which takes `settle_s`, the
    /// one before is left, all in all.
    pub(super) fn left_s(self, settle_s: f64, from_s: f64, to_s: f64) -> f64 {
        if self.share <= 0.0 || settle_s <= 0.0 {
            return 0.0;
        }
        let constant_s = settle_s / -self.share.ln();
        let fading = |constant_s: f64| {
            let left = |at_s: f64| (-at_s / constant_s).exp();
            constant_s * (left(from_s) - left(to_s))
        };
        let (slow, times) = SLOW;
        self.share * ((1.0 - slow) * fading(constant_s) + slow * fading(times * constant_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn less_and_less_is_left_and_nothing_with_mirrors() {
        let lag = Lag::drawn(7, Panel::LiquidCrystal);
        assert!(LAGS.contains(&lag.share), "{lag:?}");
        // Of the first instants as much as is said.
        let first = lag.left_s(4e-3, 0.0, 1e-9) / 1e-9;
        assert!((first / lag.share - 1.0).abs() < 1e-3, "{first}");
        let [early, late] = [0.0, 2e-3].map(|at_s| lag.left_s(4e-3, at_s, at_s + 1e-3));
        assert!(0.0 < late && late < early && early < lag.share * 1e-3);
        // In parts or as a whole.
        let whole = lag.left_s(4e-3, 0.0, 2e-3);
        assert!((early + lag.left_s(4e-3, 1e-3, 2e-3) - whole).abs() < 1e-15);
        assert!(Lag::drawn(7, Panel::Mirrors).left_s(4e-3, 0.0, 1.0).abs() < 1e-15);
    }
}
