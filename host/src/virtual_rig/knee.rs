//! The bend of the virtual camera's response near its full well.
//!
//! # Design
//! EMVA 1288 (release 4.0) states linearity from 5 to 95 % of the saturation capacity and leaves what comes above it; in data
//! sheets the response bends from about nine tenths of the full well on. Here what is shown of a signal falls off with the square of
//! how far it is above where the bend begins. It is another law than the nonlinearity over the whole range.

use std::ops::RangeInclusive;

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};

use super::flaws::log_uniform;

/// Shares that are missing at the full well: usually 1 % (EMVA 1288 data sheets of sensors with a global shutter), 3 % of those that
/// are driven hard.
pub const KNEES: RangeInclusive<f64> = 3e-3..=3e-2;
/// Where the bend begins, as a share of the full well.
const STARTS: RangeInclusive<f64> = 0.89..=0.93;
/// What tells the chance of a bend from that of the rest of the rig: the letters of `knee`.
const STREAM: u64 = 0x6b6e_6565;

/// The bend.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Knee {
    /// From which share of the full well on the response bends.
    pub start: f64,
    /// Share of the signal that is not shown at the full well.
    pub loss: f64,
}

impl Knee {
    /// A bend by chance. Its chance is its own, so that it changes no other flaw that follows from the `seed`.
    pub(super) fn drawn(seed: u64) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed ^ STREAM);
        Self {
            start: rng.random_range(STARTS),
            loss: log_uniform(KNEES, &mut rng),
        }
    }

    /// Share of a signal that is shown which fills this share of the full well.
    pub(super) fn shown(&self, fill: f64) -> f64 {
        if self.loss <= 0.0 || fill <= self.start {
            return 1.0;
        }
        let above = ((fill - self.start) / (1.0 - self.start)).min(1.0);
        1.0 - self.loss * above * above
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_response_bends_above_its_start_and_lacks_at_the_full_well_what_is_said() {
        for seed in 0..20 {
            let knee = Knee::drawn(seed);
            assert!(
                KNEES.contains(&knee.loss) && STARTS.contains(&knee.start),
                "{knee:?}"
            );
            assert!(
                (knee.shown(0.88) - 1.0).abs() < 1e-15 && (knee.shown(1.0) + knee.loss - 1.0).abs() < 1e-15
            );
            // More light shows as more.
            let rises = |fill: f64| (fill + 0.01) * knee.shown(fill + 0.01) > fill * knee.shown(fill);
            assert!(
                (85..105).all(|percent| rises(f64::from(percent) / 100.0)),
                "{knee:?}"
            );
        }
        assert!((Knee::default().shown(0.99) - 1.0).abs() < 1e-15);
    }
}
