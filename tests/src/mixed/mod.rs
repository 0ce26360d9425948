//! A whole instrument on which everything goes wrong at once: link, trigger box, camera, host.
//!
//! # Design
//! The firmware's own library runs in virtual time behind a mocked line; at its pins stand a projector and a camera that take part in no
//! optics: a frame says which pattern it saw and for how long, so that whoever gets it can tell at once whether it is the one that was
//! asked for. What goes wrong is drawn from a seed, each kind absent half of the time, so that each also occurs by itself.
//!
//! - [`table`]: what stands at the pins, and its faults
//! - `peer`: the box behind the line, which may be switched off and on

mod peer;
pub mod table;

use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg::capture::device::Device;
use rcg::capture::link::Link;
use rcg::capture::wiring::Wiring;
use rcg::capture::{CaptureError, Instrument, Tally};
use rcg::plan::schedule::Timing;

use crate::books::PATIENCE;
use crate::line::Faults as LineFaults;
use crate::world::MockLink;
use peer::Box as TriggerBox;
use table::{Faults, Seen, Table};

/// Patterns of one segment at most.
const MOST_PATTERNS: usize = 60;
/// A run that ends early is begun again so often, as `--resume` does.
const RESUMED: usize = 6;

/// What came of a segment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Exposures that were fired, those that were taken again too.
    pub simulated: u64,
    /// Frames that were handed on as those of an exposure.
    pub handed_on: u64,
    /// Of these, frames of another pattern or another exposure time.
    pub wrong: u64,
    /// Segments that were captured whole.
    pub whole: u64,
    /// Segments that were given up, by name, after they had been begun again as often as a user would.
    pub given_up: u64,
    /// Errors that ended a run, by name.
    pub errors: u64,
    /// Times that outputs were not at rest once a run had ended by an error and the dead-man time was over.
    pub restless: u64,
}

impl Outcome {
    /// Both together.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self {
            simulated: self.simulated + other.simulated,
            handed_on: self.handed_on + other.handed_on,
            wrong: self.wrong + other.wrong,
            whole: self.whole + other.whole,
            given_up: self.given_up + other.given_up,
            errors: self.errors + other.errors,
            restless: self.restless + other.restless,
        }
    }
}

/// The faults of a line, as many as a run survives now and then.
fn line_faults(rng: &mut Xoshiro256PlusPlus) -> LineFaults {
    let drawn = LineFaults::any(rng.random());
    // Of every thousand frames some are lost; far more, and no run would ever end.
    let rarely = |chance: f64| 0.02 * chance;
    LineFaults {
        lose_byte: rarely(drawn.lose_byte),
        flip_bit: rarely(drawn.flip_bit),
        lose_chunk: rarely(drawn.lose_chunk),
        duplicate: rarely(drawn.duplicate),
        delay: 0.2 * drawn.delay,
        reorder: rarely(drawn.reorder),
        garbage: rarely(drawn.garbage),
        cut_after: rng.random_bool(0.05).then(|| rng.random_range(2_000..40_000)),
        ..drawn
    }
}

/// Exposures of one pattern: of one to three lengths.
fn timings(rng: &mut Xoshiro256PlusPlus) -> Vec<Timing> {
    let shortest_s = rng.random_range(100e-6..900e-6);
    (0..rng.random_range(1..=3))
        .map(|bracket: u32| {
            let exposure_s = shortest_s * f64::from(1 + bracket);
            Timing {
                proj_width_s: if bracket == 0 { 5e-6 } else { 0.0 },
                cam_at_s: if bracket == 0 { 300e-6 } else { 0.0 },
                cam_width_s: exposure_s,
                period_s: if bracket == 0 { 300e-6 } else { 0.0 } + exposure_s + 200e-6,
            }
        })
        .collect()
}

/// Captures one segment, beginning again where a run ended by an error, with faults drawn from `seed`.
///
/// # Panics
/// If a session cannot be opened over a good line.
#[must_use]
pub fn segment(seed: u64) -> Outcome {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let timings = timings(&mut rng);
    let patterns = rng.random_range(1..=MOST_PATTERNS);
    let table = Table::new(Faults::any(rng.random()), rng.random());
    let boxed = TriggerBox::new(
        table.clone(),
        seed as u32,
        rng.random_bool(0.05).then(|| rng.random_range(20..400)),
    );
    let line = MockLink::new(boxed, LineFaults::NONE, LineFaults::NONE, seed);
    let control = line.another(LineFaults::NONE, LineFaults::NONE, !seed);
    let link: Box<dyn Link> = Box::new(line.another(LineFaults::NONE, LineFaults::NONE, seed ^ 1));
    let device = Device::connect(link, 1, PATIENCE).expect("the line is good");
    let mut instrument = Instrument {
        device,
        camera: Box::new(table.camera()),
        projector: Box::new(table.projector()),
        watching: Vec::new(),
        wiring: Wiring::default(),
        bands: 1,
    };
    let stalls = rng.random_bool(0.1);
    let mut outcome = Outcome::default();
    for again in 0..RESUMED {
        let faults = [line_faults(&mut rng), line_faults(&mut rng)];
        let link: Box<dyn Link> = Box::new(control.another(faults[0], faults[1], rng.random()));
        *instrument.device.link_mut() = link;
        let begun = instrument.device.open_session(again as u32 + 2);
        let taken = begun.map_err(CaptureError::from).and_then(|()| {
            let stall_at = if stalls {
                rng.random_range(0..patterns)
            } else {
                usize::MAX
            };
            let mut stalled = false;
            instrument.take(
                patterns,
                &timings,
                |pattern, image| image.light(&[table::pixel_of(pattern)]),
                &mut Tally::default(),
                |done| {
                    if done >= stall_at && !stalled {
                        stalled = true;
                        control.idle(Duration::from_secs(2));
                    }
                },
            )
        });
        match taken {
            Ok(captured) => {
                for (number, one) in captured.iter().enumerate() {
                    let (pattern, bracket) = (number / timings.len(), number % timings.len());
                    let expected = Seen::new(pattern, &timings[bracket]);
                    outcome.wrong += u64::from(Seen::of(&one.dn) != expected);
                }
                outcome.handed_on += captured.len() as u64;
                outcome.whole += 1;
                break;
            }
            Err(error) => {
                outcome.errors += 1;
                let told = error.to_string();
                assert!(!told.is_empty() && !told.contains('\n'), "{told}");
                control.idle(Duration::from_secs(5));
                outcome.restless += u64::from(!table.is_at_rest());
                outcome.given_up += u64::from(again + 1 == RESUMED);
            }
        }
    }
    outcome.simulated = table.exposures();
    outcome
}

/// Captures segments with faults drawn from `seed` on until `exposures` were simulated.
#[must_use]
pub fn segments(mut seed: u64, exposures: u64) -> Outcome {
    let mut all = Outcome::default();
    while all.simulated < exposures {
        all = all.and(segment(seed));
        seed = seed.wrapping_add(1);
    }
    all
}
