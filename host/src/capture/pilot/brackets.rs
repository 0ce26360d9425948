//! The pilot capture that proposes exposure brackets.
//!
//! # Design
//! A few patterns, each exposed from the rig's default time down in steps of [`TEST_RATIO`], in one run. A pixel's rate comes
//! from its longest exposure that does not saturate. The shortest bracket is made for the brightest pixel, the longest for
//! the darkest; [`crate::plan::brackets::LARGEST_RATIO`] says how many are between them.

use std::fmt;

use super::{judged, patterns};
use crate::capture::directory::MeasurementError;
use crate::capture::{Instrument, Tally};
use crate::hemisphere::incident::Grid;
use crate::instrument::rig::Rig;
use crate::plan::PlanError;
use crate::plan::brackets::{
    Brackets, LARGEST_RATIO, MOST_EXPOSURES, geometric, largest_ratio, milliseconds,
};
use crate::plan::schedule::Timing;

/// Exposure times of the pilot capture, each [`TEST_RATIO`] times shorter than the one before.
const TESTS: i32 = 5;
/// Ratio of neighbouring exposure times of the pilot capture: five of them reach over 4096 : 1.
const TEST_RATIO: f64 = 8.0;
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
    /// Rate that all but 1 % of the pixels reach, in e⁻/s.
    pub darkest_e_per_s: f64,
    /// Signal over noise at that rate in the longest exposure.
    pub darkest_snr: f64,
}

impl fmt::Display for Proposal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            exposures_s,
            brightest_e_per_s: brightest,
            darkest_e_per_s: darkest,
            darkest_snr: snr,
        } = self;
        write!(
            f,
            "pilot: the brightest pixel gathers {brightest:.0} e⁻/s, 99 % of them more than {darkest:.0} e⁻/s, with a \
             signal of {snr:.0} times the noise in the longest exposure; proposed: {} of {} ms",
            exposures_s.len(),
            milliseconds(exposures_s)
        )
    }
}

/// The exposure times for `brackets` on `rig`, whose camera image is scaled as it will be measured: the brightest pixel
/// of a few test patterns of `grid` comes to 80 % of the range in the shortest; 99 % of the pixels reach a signal of 120
/// times their noise in the longest, unless that is longer than 32 times the rig's default.
///
/// # Errors
/// [`MeasurementError`].
pub fn propose(
    rig: &Rig,
    grid: &Grid,
    brackets: &Brackets,
    instrument: &mut Instrument,
) -> Result<Proposal, MeasurementError> {
    let patterns = patterns(rig, grid)?;
    let tests_s: Vec<f64> = (0..TESTS)
        .rev()
        .map(|step| rig.camera.exposure_s / TEST_RATIO.powi(step))
        .filter(|exposure_s| *exposure_s >= 1e-6)
        .collect();
    let timings = Timing::series(rig, &tests_s).map_err(PlanError::from)?;
    let shots = instrument.take(
        patterns.len(),
        &timings,
        |pattern, image| image.light(&patterns[pattern]),
        &mut Tally::default(),
        |_| {},
    )?;
    let judged: Vec<bool> = judged(rig).collect();
    let (camera, gain) = (&rig.camera, rig.gain_e_per_dn());
    let rate = |dn: u16, exposure_s: f64| {
        (f64::from(dn) - camera.dark_dn) * gain / exposure_s - camera.dark_current_e_per_s
    };
    let mut rates: Vec<f64> = shots
        .chunks_exact(timings.len())
        .flat_map(|shots| {
            (0..judged.len()).filter(|&at| judged[at]).map(|at| {
                let mut tried = shots.iter().zip(&tests_s).rev();
                let clear = tried.find(|(shot, _)| shot.dn[at] < rig.saturation_dn());
                // What saturates even the shortest may be far brighter.
                clear.map_or_else(
                    || TEST_RATIO * rate(rig.saturation_dn(), tests_s[0]),
                    |(shot, exposure_s)| rate(shot.dn[at], *exposure_s),
                )
            })
        })
        .collect();
    rates.sort_unstable_by(f64::total_cmp);
    let faintest = 1.0 / camera.exposure_s; // an electron in the default exposure: as good as nothing
    let rank = (rates.len() as f64 * DARKEST) as usize;
    let brightest_e_per_s = rates.last().map_or(faintest, |rate| rate.max(faintest));
    let darkest_e_per_s = rates.get(rank).map_or(faintest, |rate| rate.max(faintest));
    let longest_s = (LONGEST * camera.exposure_s).min(60.0);
    let dark_e2 = |exposure_s: f64| {
        camera.read_noise_e.powi(2) + gain * gain / 12.0 + camera.dark_current_e_per_s * exposure_s
    };
    let shortest_s = (BRIGHTEST * camera.full_well_e / brightest_e_per_s).clamp(1e-6, longest_s);
    // s² = SNR²·(s + dark) for the signal s; dark for the longest exposure, to be on the safe side.
    let square = SNR * SNR;
    let wanted_e = f64::midpoint(
        square,
        (square * square + 4.0 * square * dark_e2(longest_s)).sqrt(),
    );
    let wanted_s = (wanted_e / darkest_e_per_s).clamp(shortest_s, longest_s);
    let exposures_s = match brackets {
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
    let signal_e = darkest_e_per_s * last_s;
    Ok(Proposal {
        exposures_s,
        brightest_e_per_s,
        darkest_e_per_s,
        darkest_snr: signal_e / (signal_e + dark_e2(last_s)).sqrt(),
    })
}
