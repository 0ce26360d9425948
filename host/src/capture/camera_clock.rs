//! The camera's clock against that of the trigger box.
//!
//! # Design
//! Box and camera each have a clock: t_camera = offset + (1 + drift) · t_box, within a run. Both times are stored with each exposure, so what they
//! say of each other is found from the file, by runs: the camera is armed anew for each, and may begin to count anew. The drift is
//! the median of slopes between exposures an eighth of the run apart (after Theil, *Indagationes Mathematicae* 12, 1950; Sen, *J. Am. Stat.
//! Assoc.* 63, 1968, 1379): a time-stamp that is wrong moves it little, and one jump is in an eighth of the slopes. A *jump* is where the
//! medians of the residuals on both sides differ by much more than residuals scatter. The residual is the standard
//! deviation that their median absolute deviation stands for (1.4826 of it, of normal noise), jumps taken out.
//!
//! Pairing does not rest on this: it follows the clock from frame to frame (`pairing`), and takes again what it cannot tell apart.

use serde::{Deserialize, Serialize};

use crate::base::median::median;
use crate::store::{ExposureRecord, RawStore, StoreError};

/// A run of fewer exposures says nothing.
const LEAST: usize = 16;
/// Residuals on each side of a jump that speak for it.
const SIDE: usize = 5;
/// A jump is so many times what residuals scatter by, …
const SCATTERS: f64 = 8.0;
/// … and no less than this, s: time-stamps count microseconds at worst.
const LEAST_JUMP_S: f64 = 5e-6;
/// Jumps of a run that are told.
const JUMPS: usize = 8;
/// Standard deviation of normal noise per median absolute deviation.
const NORMAL: f64 = 1.4826;

/// A time-stamp that is off what those before it say.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Jump {
    /// The first exposure behind it; of a [`fit`] counted from the run's first.
    pub exposure: usize,
    /// How far the camera's clock jumps, s.
    pub by_s: f64,
}

/// The two clocks in one run.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The camera's time at the box's time 0, s.
    pub offset_s: f64,
    /// How much faster the camera's clock is, 1e-6.
    pub drift_ppm: f64,
    /// Standard deviation of one time-stamp from that, s.
    pub residual_s: f64,
    /// Jumps, in their order.
    pub jumps: Vec<Jump>,
}

/// The two clocks in all runs of a file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraClock {
    /// Runs that are long enough to say something.
    pub runs: usize,
    /// Drift, 1e-6: the lowest, the median and the highest of the runs; `None` without a run.
    pub drift_ppm: Option<[f64; 3]>,
    /// The largest residual of a run, s.
    pub residual_s: Option<f64>,
    /// Where the camera's clock jumped.
    pub jumps: Vec<Jump>,
}

impl CameraClock {
    /// What the exposures of `raw` say, which are all there.
    ///
    /// # Errors
    /// [`StoreError`] if records are missing or damaged.
    pub fn of(raw: &RawStore) -> Result<Self, StoreError> {
        let mut fits = Vec::new();
        let mut jumps = Vec::new();
        let tick_s = 1.0 / f64::from(raw.layout().clock_hz);
        for segment in 0..raw.segments() {
            let records = raw.read_records(segment)?;
            let first = raw.segment_range(segment).start;
            for attempts in 1..=records.iter().map(|record| record.attempts).max().unwrap_or(0) {
                let run: Vec<usize> = (0..records.len())
                    .filter(|&at| records[at].attempts == attempts)
                    .collect();
                let times: Vec<[f64; 2]> = run.iter().map(|&at| times_s(&records[at], tick_s)).collect();
                let Some(found) = fit(&times) else { continue };
                jumps.extend(found.jumps.iter().map(|jump| Jump {
                    exposure: first + run[jump.exposure],
                    ..*jump
                }));
                fits.push(found);
            }
        }
        let mut drifts: Vec<f64> = fits.iter().map(|fit| fit.drift_ppm).collect();
        drifts.sort_by(f64::total_cmp);
        let drift_ppm = match drifts.as_slice() {
            [] => None,
            [lowest, .., highest] => Some([*lowest, drifts[drifts.len() / 2], *highest]),
            [only] => Some([*only; 3]),
        };
        Ok(Self {
            runs: fits.len(),
            drift_ppm,
            residual_s: fits.iter().map(|fit| fit.residual_s).max_by(f64::total_cmp),
            jumps,
        })
    }
}

/// Time of the strobe on the box's clock and of the frame on the camera's, s.
fn times_s(record: &ExposureRecord, tick_s: f64) -> [f64; 2] {
    [record.strobe_on_tick as f64 * tick_s, record.camera_timestamp_s]
}

/// The two clocks in a run with these `times` of its exposures in their order, (box, camera) in s; `None` of fewer than 16, of times that do not
/// increase, and of a camera without a clock.
#[must_use]
pub fn fit(times: &[[f64; 2]]) -> Option<Fit> {
    let increases = times.windows(2).all(|pair| pair[1][0] > pair[0][0]);
    if times.len() < LEAST || !increases || times.iter().flatten().any(|time| !time.is_finite()) {
        return None;
    }
    // From the first on: differences of large numbers would lose what is looked for.
    let [box_s, camera_s] = times[0];
    let ahead: Vec<[f64; 2]> = times
        .iter()
        .map(|[of_box, of_camera]| {
            let since = of_box - box_s;
            [since, of_camera - camera_s - since]
        })
        .collect();
    let lag = times.len() / 8;
    let slopes = (lag..ahead.len()).map(|at| {
        let ([t, y], [t0, y0]) = (ahead[at], ahead[at - lag]);
        (y - y0) / (t - t0)
    });
    let drift = median(slopes.collect())?;
    let mut residuals: Vec<f64> = ahead.iter().map(|[t, y]| y - drift * t).collect();
    let jumps = take_jumps_out(&mut residuals);
    let middle = median(residuals.clone())?;
    let deviations: Vec<f64> = residuals
        .iter()
        .map(|residual| (residual - middle).abs())
        .collect();
    Some(Fit {
        offset_s: camera_s + middle - (1.0 + drift) * box_s,
        drift_ppm: drift * 1e6,
        residual_s: NORMAL * median(deviations)?,
        jumps,
    })
}

/// Finds where `residuals` jump, and moves what is behind to what was before.
fn take_jumps_out(residuals: &mut [f64]) -> Vec<Jump> {
    let mut jumps: Vec<Jump> = Vec::new();
    let steps: Vec<f64> = residuals
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs())
        .collect();
    // A difference of two has √2 of the noise of one.
    let scatter_s = NORMAL / std::f64::consts::SQRT_2 * median(steps).unwrap_or(0.0);
    let least_s = LEAST_JUMP_S.max(SCATTERS * scatter_s);
    while jumps.len() < JUMPS {
        let middle = |some: &[f64]| median(some.to_vec()).unwrap_or(0.0);
        let steps = (SIDE..=residuals.len() - SIDE).map(|at| {
            let by_s = middle(&residuals[at..at + SIDE]) - middle(&residuals[at - SIDE..at]);
            // Where several places tell of the same jump, it is where the two neighbours differ most.
            let here = (residuals[at] - residuals[at - 1]).abs();
            (at, by_s, here)
        });
        let found = steps
            .filter(|(_, by_s, here)| by_s.abs() > least_s && *here > by_s.abs() / 2.0)
            .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
        let Some((at, by_s, _)) = found else { break };
        for residual in &mut residuals[at..] {
            *residual -= by_s;
        }
        jumps.push(Jump { exposure: at, by_s });
    }
    jumps.sort_by_key(|jump| jump.exposure);
    jumps
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise from −1 to 1 that is a function of `at`.
    fn noise(at: usize) -> f64 {
        let mut z = (at as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        ((z ^ (z >> 27)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// A run of `count` exposures, 1 ms apart, with noise of ±`noise_s` in the camera's time-stamps.
    fn run(count: usize, drift_ppm: f64, noise_s: f64, jump: impl Fn(usize) -> f64) -> Vec<[f64; 2]> {
        let of = |at: usize| {
            let of_box = 0.25 + at as f64 * 1e-3;
            let of_camera = 4000.0 + of_box * (1.0 + drift_ppm * 1e-6);
            [of_box, of_camera + noise_s * noise(at) + jump(at)]
        };
        (0..count).map(of).collect()
    }

    #[test]
    fn a_drift_is_found_whatever_single_time_stamps_say() {
        for drift_ppm in [-200.0, -3.0, 0.0, 200.0] {
            for count in [16, 100, 400] {
                let noise_s = 1e-6;
                // Every 20th time-stamp is a millisecond late.
                let late = |at: usize| if at % 20 == 7 { 1e-3 } else { 0.0 };
                let found = fit(&run(count, drift_ppm, noise_s, late)).unwrap();
                let within_ppm = 4e6 * noise_s / (count as f64 * 1e-3);
                assert!(
                    (found.drift_ppm - drift_ppm).abs() < within_ppm,
                    "{count}: {found:?}"
                );
                assert!(
                    (found.offset_s - 4000.0).abs() < 3e-6 + 0.5e-6 * within_ppm,
                    "{found:?}"
                );
                assert!((0.2e-6..2e-6).contains(&found.residual_s), "{found:?}");
                assert_eq!(found.jumps, []);
            }
        }
    }

    #[test]
    fn jumps_are_named_where_they_are_and_change_nothing_else() {
        for (at_jump, by_s) in [(60, 2e-3), (200, -30e-6), (390, 1.0)] {
            let jump = |at: usize| if at >= at_jump { by_s } else { 0.0 };
            let found = fit(&run(400, 50.0, 0.5e-6, jump)).unwrap();
            assert_eq!(found.jumps.len(), 1, "{found:?}");
            assert_eq!(found.jumps[0].exposure, at_jump);
            assert!((found.jumps[0].by_s - by_s).abs() < 2e-6, "{found:?}");
            assert!(
                (found.drift_ppm - 50.0).abs() < 4.0 && found.residual_s < 1e-6,
                "{found:?}"
            );
        }
        let two = |at: usize| {
            if at >= 300 {
                5e-3
            } else if at >= 100 {
                9e-3
            } else {
                0.0
            }
        };
        let found = fit(&run(400, 0.0, 0.5e-6, two)).unwrap();
        let places: Vec<usize> = found.jumps.iter().map(|jump| jump.exposure).collect();
        assert_eq!(places, [100, 300]);
    }

    #[test]
    fn what_says_nothing_is_no_fit() {
        assert_eq!(fit(&run(15, 1.0, 0.0, |_| 0.0)), None);
        assert_eq!(
            fit(&run(20, 1.0, 0.0, |at| if at == 3 { f64::NAN } else { 0.0 })),
            None
        );
        let mut back = run(20, 1.0, 0.0, |_| 0.0);
        back.swap(4, 5);
        assert_eq!(fit(&back), None);
    }
}
