//! Law: whatever goes wrong, and however much of it at once, no frame is taken for one of another pattern.

use rayon::prelude::*;
use rcg_tests::mixed::{Outcome, segments};

/// Exposures in every run of the tests; more by `RCG_EXPOSURES`.
const EXPOSURES: u64 = 10_000;
/// Parts that are drawn side by side. In rayon's pool a run has no thread of its own for its frames, so that a seed is always the same run.
const PARTS: u64 = 8;

#[test]
fn no_frame_is_taken_for_one_of_another_pattern() {
    let wanted = std::env::var("RCG_EXPOSURES").ok();
    let wanted = wanted.map_or(EXPOSURES, |text| text.parse().expect("RCG_EXPOSURES is a number"));
    let parts = (0..PARTS).into_par_iter();
    let all = parts
        .map(|part| segments(part << 32, wanted.div_ceil(PARTS)))
        .reduce(Outcome::default, Outcome::and);
    println!("{all:?}");
    assert_eq!((all.wrong, all.restless), (0, 0), "{all:?}");
    // What gives up every time is never wrong.
    assert!(2 * all.given_up < all.whole && all.errors > 0, "{all:?}");
}
