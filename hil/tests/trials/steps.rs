//! Schedules that the trials play.

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg_protocol::{Extent, Program, Pulse, Step, Ticks};

/// Steps of the paper's measurement of one material.
pub(crate) const STEPS: u64 = 32_400;

/// `whole` where the long tests are wanted (`./test.sh full`), else a fifth of it.
pub(crate) fn in_part(whole: u64) -> u64 {
    match std::env::var_os("RCG_FULL") {
        Some(_) => whole,
        None => whole / 5,
    }
}

/// Ticks of one step at 9,523 Hz, the rate of 1-bit patterns of a DLPC900 (105 µs), on a clock of `hz`.
pub(crate) fn period(hz: u32) -> u64 {
    u64::from(hz / 9_523)
}

/// A table of `steps` steps, played `cycles` times, at once and free running.
pub(crate) fn table(steps: &[Step], cycles: u64) -> Program {
    Program {
        extent: Extent::Table {
            steps: steps.len() as u32,
            cycles: cycles as u32,
        },
        ..stream()
    }
}

/// A stream that starts at once and runs freely.
pub(crate) fn stream() -> Program {
    Program::new(Extent::Stream)
}

/// PROJ for a tenth of the step, then CAM for half of it.
pub(crate) fn plain(period: u64) -> Step {
    Step {
        proj: Pulse::new(0, period / 10),
        cam: Pulse::new(period / 5, period / 2),
        period: Ticks(period),
    }
}

/// The same pattern exposed three times, each time four times as long.
pub(crate) fn bracket(period: u64) -> [Step; 3] {
    [period / 32, period / 8, period / 2].map(|exposure| Step {
        cam: Pulse::new(period / 5, exposure),
        ..plain(period)
    })
}

/// Both outputs high for the whole of the step but its last `low` ticks: whatever cuts it is seen.
pub(crate) fn solid(period: u64, low: u64) -> Step {
    Step {
        proj: Pulse::new(0, period - low),
        cam: Pulse::new(0, period - low),
        period: Ticks(period),
    }
}

/// `count` steps of `mean` ticks on average, drawn from `seed`: pulses that overlap, touch the border or are not there
/// at all, with borders at the same tick or at least 3 ticks apart. CAM pulses and the gaps between them are 24 ticks or
/// more, so that a STROBE line that follows them can be told apart.
pub(crate) fn random(count: usize, mean: u64, seed: u64) -> Vec<Step> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut steps = Vec::with_capacity(count);
    while steps.len() < count {
        let period = rng.random_range(mean / 8..mean * 2 - mean / 8);
        let mut draw = |present: f64, shortest: u64, margin: u64| {
            if !rng.random_bool(present) {
                return Pulse::NONE;
            }
            let width = rng.random_range(shortest..period / 2);
            Pulse::new(rng.random_range(margin..=period - width - margin), width)
        };
        let step = Step {
            proj: draw(0.9, 3, 0),
            cam: draw(0.9, 24, 12),
            period: Ticks(period),
        };
        if apart(&step) {
            steps.push(step);
        }
    }
    steps
}

/// Whether no two borders of the step are closer than 3 ticks without being the same.
fn apart(step: &Step) -> bool {
    let mut borders = vec![0, step.period.0];
    for pulse in [step.proj, step.cam] {
        if !pulse.is_none() {
            borders.extend([pulse.at.0, (pulse.at + pulse.width).0]);
        }
    }
    borders.sort_unstable();
    borders
        .windows(2)
        .all(|pair| pair[0] == pair[1] || pair[1] - pair[0] >= 3)
}
