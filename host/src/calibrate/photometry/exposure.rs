//! How long the standard is exposed, and how much of it is lit.
//!
//! # Design
//! The longest exposure is the longest that does not saturate the standard at any stand; the others of the series, which show
//! camera and dark current, are halves of halves of it. A bright rig leaves no room for that above the shortest exposure
//! there is. Then the series is closer, in whole microseconds, because clocks round shorter ones; and where even that is too
//! narrow, spots are made smaller, down to single projector pixels, whose light is known as well as that of many.
//!
//! Black projector pixels fill the range too, with light that says nothing but noise. Where they leave the spot too little
//! above it, it is made wider: the standard is diffuse and the fields are smooth.

use super::capture::Holder;
use crate::calibrate::CalibrateError;
use crate::calibrate::by_hand::Bench;
use crate::capture::pilot::TestExposures;
use crate::plan::schedule::{LONGEST_EXPOSURE_S, SHORTEST_EXPOSURE_S};
use crate::virtual_rig::Held;

/// Exposure times of the series.
const TIMES: usize = 8;
/// The longest exposure is at least so many times the shortest there is: linearity wants some that fill more than a tenth
/// of the range.
const LEAST_RATIO: f64 = 16.0;
/// No longest exposure is longer, seconds.
const PATIENCE_S: f64 = 10.0;
/// Below this times are whole microseconds, seconds.
const ROUNDED_S: f64 = 1e-4;
/// Opening in degrees beyond which no spot is made wider: light is known at its middle only, and keeps clear of edges.
const WIDEST_DEG: f64 = 5.0;
/// Signal over noise that a spot at 75° shall have beside the light of black pixels.
const CLEAR_SNR: f64 = 40.0;
/// Share of the full well that it is exposed to, and cosine of 75°.
const FULL: f64 = 0.8;
const GRAZING_COS: f64 = 0.26;
/// Halvings of the spot that are tried.
const HALVINGS: usize = 8;

/// Exposure times, and the light.
pub(super) struct Exposures {
    /// Of the series, seconds, ascending; that of the incident directions is the last.
    pub(super) times_s: Vec<f64>,
    /// Diameter of the cone that one pattern lights, degrees, if it is not that of the rig.
    pub(super) spot_deg: Option<f64>,
}

/// Exposure times for `standard` at all stands: up to `exposure_s` if it is given, else up to the longest that does not
/// saturate. The holders light what is returned.
///
/// # Errors
/// [`CalibrateError::Views`] if there is too much light for any.
pub(super) fn light(
    holders: &mut [Holder],
    standard: &Held,
    exposure_s: Option<f64>,
    bench: &mut dyn Bench,
) -> Result<Exposures, CalibrateError> {
    let least_s = LEAST_RATIO * SHORTEST_EXPOSURE_S;
    if let Some(exposure_s) = exposure_s
        && !(least_s..=LONGEST_EXPOSURE_S).contains(&exposure_s)
    {
        return Err(CalibrateError::Views {
            expected: format!(
                "a longest exposure time from {} to {} ms",
                least_s * 1e3,
                LONGEST_EXPOSURE_S * 1e3
            ),
            found: format!("{} ms", exposure_s * 1e3),
            advice: "give another --exposure-ms, or let it be found",
        });
    }
    let whole_deg = holders[0].rig.light.spot_deg;
    let mut spot_deg = clear_deg(&holders[0], standard, bench)?;
    for holder in holders.iter_mut() {
        holder.set_spot(spot_deg);
    }
    let given = |spot_deg: f64| (spot_deg.total_cmp(&whole_deg).is_ne()).then_some(spot_deg);
    if let Some(exposure_s) = exposure_s {
        return Ok(Exposures {
            times_s: series(exposure_s),
            spot_deg: given(spot_deg),
        });
    }
    for _ in 0..=HALVINGS {
        let longest_s = longest_s(holders, standard, bench)?;
        if longest_s >= least_s {
            return Ok(Exposures {
                times_s: series(longest_s),
                spot_deg: given(spot_deg),
            });
        }
        spot_deg /= 2.0;
        for holder in holders.iter_mut() {
            holder.set_spot(spot_deg);
        }
    }
    Err(CalibrateError::Views {
        expected: format!(
            "a standard that single projector pixels do not saturate in {} ms",
            least_s * 1e3
        ),
        found: "one that they do".to_owned(),
        advice: "take a darker --standard, or stop the projector or the camera down and state it in the rig file \
                 (light.full_scale_f_sr)",
    })
}

/// The opening in degrees of a spot that stands [`CLEAR_SNR`] above the noise of all black projector pixels together at
/// 75°: that of the rig or wider.
fn clear_deg(holder: &Holder, standard: &Held, bench: &mut dyn Bench) -> Result<f64, CalibrateError> {
    let whole_deg = holder.rig.light.spot_deg;
    let mut instrument = bench.open(&holder.rig, standard.clone(), holder.tilt)?;
    // A black pattern first.
    let mut patterns = vec![Vec::new()];
    patterns.extend(holder.directions.iter().step_by(5).map(|at| holder.lit(*at)));
    let shots = TestExposures::take(&holder.rig, &patterns, &mut instrument)?.shots;
    let light = |dn: &[u16]| {
        dn.iter()
            .map(|dn| f64::from(*dn) - holder.rig.camera.dark_dn)
            .sum::<f64>()
    };
    let black = light(&shots[0].dn);
    let lit = shots[1..].iter().map(|shot| light(&shot.dn)).sum::<f64>() / (shots.len() - 1) as f64;
    let share = black / (lit - black);
    let bearable = GRAZING_COS * (FULL * holder.rig.camera.full_well_e).sqrt() / CLEAR_SNR;
    let wider = (share / bearable).max(1.0).sqrt();
    Ok((wider * whole_deg).min(WIDEST_DEG).max(whole_deg))
}

/// The longest exposure time in s that saturates `standard` at no stand; 0 if all do.
fn longest_s(holders: &[Holder], standard: &Held, bench: &mut dyn Bench) -> Result<f64, CalibrateError> {
    let mut longest_s = PATIENCE_S;
    for holder in holders {
        let mut instrument = bench.open(&holder.rig, standard.clone(), holder.tilt)?;
        let patterns: Vec<Vec<u32>> = holder
            .directions
            .iter()
            .step_by(5)
            .map(|at| holder.lit(*at))
            .collect();
        let tests = TestExposures::take(&holder.rig, &patterns, &mut instrument)?;
        longest_s = longest_s.min(if tests.is_too_bright { 0.0 } else { tests.longest_s });
    }
    Ok(longest_s)
}

/// The series up to `longest_s`, ascending.
fn series(longest_s: f64) -> Vec<f64> {
    let halved = |halvings: usize| longest_s / f64::from(1 << halvings);
    if halved(TIMES - 1) >= ROUNDED_S {
        return (0..TIMES).rev().map(halved).collect();
    }
    let ratio = (longest_s / SHORTEST_EXPOSURE_S)
        .powf(1.0 / (TIMES - 1) as f64)
        .min(2.0);
    let mut micros: Vec<f64> = (0..TIMES as i32)
        .rev()
        .map(|step| (longest_s / ratio.powi(step) * 1e6 + 1e-6).floor().max(1.0))
        .collect();
    micros.dedup();
    micros.into_iter().map(|micros| micros * 1e-6).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use rand::{RngExt as _, SeedableRng as _};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;
    use crate::calibrate::by_hand::VirtualBench;
    use crate::instrument::rig::Rig;
    use crate::plan::Virtual;
    use crate::virtual_rig::setup::Setup;

    #[test]
    fn the_series_stays_within_what_there_is_and_reaches_from_dim_to_bright() {
        let mut longest_s = LEAST_RATIO * SHORTEST_EXPOSURE_S;
        while longest_s < LONGEST_EXPOSURE_S {
            let times_s = series(longest_s);
            let last_s = *times_s.last().unwrap();
            assert!(
                times_s[0] >= SHORTEST_EXPOSURE_S && last_s <= longest_s * (1.0 + 1e-12),
                "{times_s:?}"
            );
            assert!(last_s > 0.93 * longest_s, "{times_s:?}");
            assert!(times_s.windows(2).all(|pair| pair[0] < pair[1]), "{times_s:?}");
            // Linearity: some that fill more than a tenth of the range.
            assert!(
                times_s.iter().filter(|time_s| **time_s > 0.15 * last_s).count() >= 3,
                "{times_s:?}"
            );
            assert!(last_s / times_s[0] >= 15.0, "{times_s:?}");
            // Clocks of whole megahertz round no short one.
            let micros = times_s[0] * 1e6;
            assert!(
                times_s[0] >= ROUNDED_S || (micros - micros.round()).abs() < 1e-6,
                "{times_s:?}"
            );
            longest_s *= 1.07;
        }
    }

    /// A rig as bright, as fast and as fine as chance will have it.
    fn drawn(preset: &str, rng: &mut Xoshiro256PlusPlus) -> Rig {
        let mut power = |low: f64, high: f64| 10_f64.powf(rng.random_range(low..high));
        let mut rig = Rig::load(preset).unwrap();
        rig.light.full_scale_f_sr = power(-5.0, 2.0);
        rig.camera.exposure_s = power(-7.0, 1.0);
        rig.camera.full_well_e = power(3.3, 5.0);
        rig.light.spot_deg = power(-0.5, 0.7);
        let lens = &mut rig.projector.lens;
        (lens.width_px, lens.height_px) = (256, 192);
        lens.focal_px *= 0.25;
        lens.centre_px = lens.centre_px.map(|px| 0.25 * px);
        rig.camera.bits = [8, 10, 12, 16][rng.random_range(0..4)];
        rig.camera.dark_dn = 4.0;
        rig.validate().unwrap();
        rig
    }

    #[test]
    fn whatever_the_rig_the_exposures_fill_the_range_within_what_there_is_or_the_light_is_refused() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(5);
        let standard = Held::Sample(Arc::from(crate::brdf::sample::parse("lambert:0.98").unwrap()));
        let (mut found, mut smaller, mut refused) = (0, 0, 0);
        for draw in 0..12 {
            let mut rig = drawn(["rcg-1-16bit", "rcg-2", "rcg-3", "dmd"][draw % 4], &mut rng);
            if draw % 3 == 0 {
                // A little brighter than the shortest series takes, with whole spots.
                rig.light.spot_deg = 4.0;
                rig.camera.exposure_s = 1e-3;
                rig.light.full_scale_f_sr = 0.3 * rng.random_range(2e-6..12e-6) / rig.camera.exposure_s;
            }
            let setup = Setup::from(Virtual {
                seed: draw as u64,
                ..Virtual::default()
            });
            let world = setup.world().unwrap();
            let mut holders = [Holder::new(&rig, None, 12).unwrap()];
            match light(&mut holders, &standard, None, &mut VirtualBench::new(&world)) {
                Ok(exposures) => {
                    found += 1;
                    smaller += u32::from(exposures.spot_deg.is_some());
                    let times_s = &exposures.times_s;
                    assert!(times_s[0] >= SHORTEST_EXPOSURE_S, "{times_s:?}");
                    // What is lit does not saturate.
                    let longest_s = longest_s(&holders, &standard, &mut VirtualBench::new(&world)).unwrap();
                    assert!(
                        *times_s.last().unwrap() <= longest_s * 1.05,
                        "{times_s:?} {longest_s}"
                    );
                }
                Err(error) => {
                    refused += 1;
                    let error = error.to_string();
                    assert!(error.contains("take a darker --standard"), "{error}");
                }
            }
        }
        println!("{found} found, {smaller} of them with smaller spots, {refused} refused");
        assert!(
            found >= 6 && smaller >= 1 && refused >= 1,
            "{found} {smaller} {refused}"
        );
    }
}
