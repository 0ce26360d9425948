//! The pilot capture that proposes exposure brackets.
//!
//! # Design
//! A few patterns and black ones, each exposed from the rig's default time down in steps of [`TEST_RATIO`], in one run. A
//! pixel's rate comes from its longest exposure that does not saturate. The shortest bracket is made for the brightest
//! pixel, the longest for the darkest; [`crate::plan::brackets::LARGEST_RATIO`] says how many are between them.
//!
//! The light of the black projector pixels fills the range and is noise, and no signal: no exposure is so long that it
//! alone saturates.

use std::fmt;

use super::{counting, judged, patterns};
use crate::base::median::median;
use crate::capture::directory::MeasurementError;
use crate::capture::{Captured, Instrument, Tally};
use crate::instrument::rig::Rig;
use crate::plan::brackets::{
    Brackets, LARGEST_RATIO, MOST_EXPOSURES, geometric, largest_ratio, milliseconds,
};
use crate::plan::light::Coding;
use crate::plan::schedule::Timing;
use crate::plan::{PlanError, Request};

/// Exposure times of the pilot capture, each [`TEST_RATIO`] times shorter than the one before.
const TESTS: i32 = 5;
/// Ratio of neighbouring exposure times of the pilot capture: five of them reach over 4096 : 1.
const TEST_RATIO: f64 = 8.0;
/// Black patterns of the pilot capture, whose mean counts.
const BLACK: usize = 4;
/// The brightest pixel shall come to this share of the range in the shortest exposure.
const BRIGHTEST: f64 = 0.8;
/// All but this share of the pixels shall reach [`SNR`] in the longest exposure.
const DARKEST: f64 = 0.01;
/// Signal over noise that is wanted of the darkest pixels: 14,400 electrons, what a small full well still holds.
const SNR: f64 = 120.0;
/// No exposure is longer than so many times the rig's default one.
const LONGEST: f64 = 32.0;
/// Closer than this the shortest and the longest exposure are one.
const APART: f64 = 2.0;

/// Exposure times, and what they were chosen for.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposal {
    /// Exposure times in s, ascending.
    pub exposures_s: Vec<f64>,
    /// Rate of the brightest pixel in e⁻/s.
    pub brightest_e_per_s: f64,
    /// Rate of what is no light of black pixels that all but 1 % of the pixels reach, in e⁻/s.
    pub darkest_e_per_s: f64,
    /// Rate by the light of black projector pixels in the middle of all pixels, in e⁻/s.
    pub black_e_per_s: f64,
    /// Signal over noise at that rate in the longest exposure.
    pub darkest_snr: f64,
}

impl fmt::Display for Proposal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            exposures_s,
            brightest_e_per_s: brightest,
            darkest_e_per_s: darkest,
            black_e_per_s: black,
            darkest_snr: snr,
        } = self;
        write!(
            f,
            "pilot: the brightest pixel gathers {brightest:.0} e⁻/s, 99 % of them more than {darkest:.0} e⁻/s beside \
             {black:.0} e⁻/s of black projector pixels, with a signal of {snr:.0} times the noise in the longest exposure; \
             proposed: {} of {} ms",
            exposures_s.len(),
            milliseconds(exposures_s)
        )
    }
}

/// The exposure times for the brackets of `request` on `rig`, whose camera image is scaled as it will be measured, with
/// patterns of `code` if there is one: the
/// brightest pixel of a few test patterns comes to 80 % of the range in the shortest; 99 % of the pixels reach a signal of
/// 120 times their noise in the longest, unless that is longer than 32 times the rig's default, or black patterns come to
/// 80 % of the range before. `taken` is called while exposures are taken.
///
/// # Errors
/// [`MeasurementError`].
pub fn propose(
    rig: &Rig,
    request: &Request,
    code: Option<Coding>,
    instrument: &mut Instrument,
    taken: &dyn Fn(),
) -> Result<Proposal, MeasurementError> {
    let Rates {
        black,
        lit,
        brightest,
    } = Rates::take(rig, request, code, instrument, taken)?;
    let black_e_per_s = median(black.clone()).unwrap_or(0.0);
    let camera = &rig.camera;
    let faintest = 1.0 / camera.exposure_s; // an electron in the default exposure: as good as nothing
    let most_e = BRIGHTEST * camera.full_well_e;
    let longest_s = (LONGEST * camera.exposure_s)
        .min(60.0)
        .min(most_e / black_e_per_s.max(faintest));
    let dark_e2 = |exposure_s: f64| rig.dark_variance_e2(exposure_s);
    // (signal·t)² = SNR²·(all·t + dark); dark for the longest exposure, to be on the safe side.
    let needed_s = |signal: f64, all: f64| {
        let shot = SNR * SNR * all;
        let dark = 4.0 * (SNR * signal).powi(2) * dark_e2(longest_s);
        (shot + (shot * shot + dark).sqrt()) / (2.0 * signal * signal)
    };
    let mut all: Vec<(f64, f64, f64)> = lit
        .iter()
        .flat_map(|rates| rates.iter().zip(&black))
        .map(|(all, black)| {
            let signal = (all - black).max(faintest);
            let all = all.max(signal);
            (needed_s(signal, all), signal, all)
        })
        .collect();
    let brightest_e_per_s = brightest.max(faintest);
    all.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
    let rank = (all.len() as f64 * DARKEST) as usize;
    let darkest = all.get(rank).copied();
    let (wanted_s, darkest_e_per_s, darkest_all) =
        darkest.unwrap_or((needed_s(faintest, faintest), faintest, faintest));
    let shortest_s = (most_e / brightest_e_per_s).min(longest_s).max(1e-6);
    let wanted_s = wanted_s.min(longest_s).max(shortest_s);
    let exposures_s = match &request.brackets {
        Brackets::Number(number) => {
            let apart_s = shortest_s * APART.powi(*number as i32 - 1);
            geometric(shortest_s, wanted_s.max(apart_s), *number)
        }
        _ if wanted_s < APART * shortest_s => vec![shortest_s],
        _ => {
            let ratio = LARGEST_RATIO.min(largest_ratio(rig)).max(APART);
            let steps = (wanted_s / shortest_s).log(ratio).ceil() as usize;
            geometric(shortest_s, wanted_s, (1 + steps).min(MOST_EXPOSURES))
        }
    };
    let last_s = exposures_s.last().copied().unwrap_or(shortest_s);
    Ok(Proposal {
        exposures_s,
        brightest_e_per_s,
        darkest_e_per_s,
        black_e_per_s: black_e_per_s.max(0.0),
        darkest_snr: darkest_e_per_s * last_s / (darkest_all * last_s + dark_e2(last_s)).sqrt(),
    })
}

/// What pixels gather, e⁻/s.
struct Rates {
    /// Every judged value in black patterns.
    black: Vec<f64>,
    /// Every judged value in each of the others.
    lit: Vec<Vec<f64>>,
    /// The brightest of all values that may not saturate.
    brightest: f64,
}

impl Rates {
    /// Takes the pilot capture.
    fn take(
        rig: &Rig,
        request: &Request,
        code: Option<Coding>,
        instrument: &mut Instrument,
        taken: &dyn Fn(),
    ) -> Result<Self, MeasurementError> {
        let lit = patterns(rig, request, code)?;
        let tests_s: Vec<f64> = (0..TESTS)
            .rev()
            .map(|step| rig.camera.exposure_s / TEST_RATIO.powi(step))
            .filter(|exposure_s| *exposure_s >= 1e-6)
            .collect();
        let timings = Timing::series(rig, &tests_s).map_err(PlanError::from)?;
        let shots = instrument.take(
            BLACK + lit.len(),
            &timings,
            |pattern, image| {
                if let Some(pattern) = pattern.checked_sub(BLACK) {
                    image.light(&lit[pattern]);
                }
            },
            &mut Tally::default(),
            |_| taken(),
        )?;
        let judged: Vec<bool> = judged(rig).collect();
        let (counting, _) = counting(rig, code);
        let mut brightest = 0.0_f64;
        let mut rates: Vec<Vec<f64>> = shots
            .chunks_exact(timings.len())
            .map(|shots| {
                let all = (0..judged.len()).map(|at| rate(rig, shots, &tests_s, at));
                let rated = all.enumerate().filter(|(at, _)| judged[*at] || counting[*at]);
                rated
                    .filter_map(|(at, rate)| {
                        if counting[at] {
                            brightest = brightest.max(rate);
                        }
                        judged[at].then_some(rate)
                    })
                    .collect()
            })
            .collect();
        let lit = rates.split_off(BLACK);
        let black = (0..rates[0].len())
            .map(|at| rates.iter().map(|rates| rates[at]).sum::<f64>() / BLACK as f64)
            .collect();
        Ok(Self {
            black,
            lit,
            brightest,
        })
    }
}

/// Electrons per second of light in a value `at` of the frames of one pattern, `shots` of `tests_s` seconds, ascending.
fn rate(rig: &Rig, shots: &[Captured], tests_s: &[f64], at: usize) -> f64 {
    let of = |dn: u16, exposure_s: f64| rig.light_e_per_s(dn, exposure_s);
    let mut tried = shots.iter().zip(tests_s).rev();
    let clear = tried.find(|(shot, _)| shot.dn[at] < rig.saturation_dn());
    // What saturates even the shortest may be far brighter.
    clear.map_or_else(
        || TEST_RATIO * of(rig.saturation_dn(), tests_s[0]),
        |(shot, exposure_s)| of(shot.dn[at], *exposure_s),
    )
}
