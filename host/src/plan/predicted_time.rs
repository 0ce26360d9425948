//! How long a plan takes on a rig, what bounds it, and what would help.
//!
//! # Design
//! A step is bound by whatever it would be shorter without: each limit of the rig is taken away in turn, and the period
//! that is left says what that limit costs. A monitor that a window fills ([`window`](crate::capture)) shows a picture for whole display
//! frames: until the box has said that the step is over; then a dark one follows. Each exposure has a picture of its own there, also those
//! of one pattern. Loading patterns into the projector between segments is not counted: no
//! projector's loading time is part of a rig file.

use serde::Serialize;

use crate::instrument::rig::Rig;
use crate::plan::schedule::periods_s;
use crate::plan::{BLACK_EXPOSURES, Directions, Plan};

/// A limit of the rig on the length of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Limit {
    /// `projector.settle_s`.
    Settling,
    /// The exposure time.
    Exposure,
    /// `camera.readout_s` of a camera that cannot expose meanwhile.
    Readout,
    /// `projector.min_period_s`.
    PatternRate,
    /// Display frames of `projector.window`.
    Display,
}

impl Limit {
    const ALL: [Self; 5] = [
        Self::Settling,
        Self::Exposure,
        Self::Readout,
        Self::PatternRate,
        Self::Display,
    ];

    /// What takes the limit away, for people.
    #[must_use]
    pub const fn remedy(self) -> &'static str {
        match self {
            Self::Settling => "a projector that settles at once",
            Self::Exposure => "light enough for a very short exposure",
            Self::Readout => "a camera that reads out while it exposes, or at once",
            Self::PatternRate => "a projector without a limit on its pattern rate",
            Self::Display => "a projector that is triggered, whose pictures wait for no display frame",
        }
    }

    /// Shortest mean period in s on `rig` without this limit.
    fn without(self, rig: &Rig, exposures_s: &[f64]) -> f64 {
        let mut rig = rig.clone();
        let mut exposures_s = exposures_s.to_vec();
        match self {
            Self::Settling => rig.projector.settle_s = 0.0,
            Self::Exposure => exposures_s.fill(0.0),
            Self::Readout => rig.camera.readout_s = 0.0,
            Self::PatternRate => rig.projector.min_period_s = 0.0,
            Self::Display => return mean(&periods_s(&rig, &exposures_s)),
        }
        mean(&displayed_s(&rig, &exposures_s))
    }
}

/// The trigger box is asked every millisecond whether a step is over, and its answer takes another.
const ROUND_TRIP_S: f64 = 2e-3;

/// From one exposure to the next in s, for exposures of `exposures_s` seconds of one pattern on `rig`, with what its display adds.
fn displayed_s(rig: &Rig, exposures_s: &[f64]) -> Vec<f64> {
    let Some(hz) = rig.refresh_hz() else {
        return periods_s(rig, exposures_s);
    };
    // Each is shown anew.
    let steps_s = exposures_s
        .iter()
        .flat_map(|exposure_s| periods_s(rig, &[*exposure_s]));
    steps_s
        .map(|step_s| (((step_s + ROUND_TRIP_S) * hz).ceil() + 1.0) / hz)
        .collect()
}

/// Time that the exposures of `plan` take on `rig`, all bands of them, with what its display adds, in s; without loading.
#[must_use]
pub fn instrument_s(plan: &Plan, rig: &Rig) -> f64 {
    if rig.refresh_hz().is_none() {
        return plan.duration_s();
    }
    (plan.len() * plan.bands) as f64 * mean(&displayed_s(rig, &plan.exposures_s()))
}

fn mean(times_s: &[f64]) -> f64 {
    times_s.iter().sum::<f64>() / times_s.len() as f64
}

/// What one limit costs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// The limit.
    pub limit: Limit,
    /// Mean period of a step without it, in s.
    pub period_without_s: f64,
    /// Time of the whole plan without it, in s.
    pub instrument_without_s: f64,
}

/// Predicted time of a measurement.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PredictedTime {
    /// Mean time from one exposure to the next, in s.
    pub period_s: f64,
    /// Exposures per second.
    pub rate_hz: f64,
    /// Time of all exposures of the plan, in s.
    pub instrument_s: f64,
    /// Its part with light: the directions in reach, in s.
    pub lit_s: f64,
    /// Its part with black patterns, in s.
    pub black_s: f64,
    /// Time of all directions of the grid if all were in reach, in s.
    pub grid_s: f64,
    /// Share of a step in which the camera gathers light.
    pub exposing_share: f64,
    /// Display frames that each exposure takes, on average; `None` where the projector is triggered.
    pub display_frames: Option<f64>,
    /// Times that patterns are loaded, which takes time that is not counted.
    pub loads: usize,
    /// What the limits cost, the dearest first; those that cost nothing are left out.
    pub costs: Vec<Cost>,
}

impl PredictedTime {
    /// The pace of `plan` on `rig`.
    #[must_use]
    pub fn new(plan: &Plan, directions: &Directions, rig: &Rig) -> Self {
        let exposures_s = plan.exposures_s();
        let period_s = instrument_s(plan, rig) / (plan.len() * plan.bands) as f64;
        let exposures = (plan.len() * plan.bands) as f64;
        let each = plan.brackets() * plan.bands;
        // Patterns per direction, 1 but for codes.
        let shared = plan.lit_patterns() as f64 / plan.direction_count.max(1) as f64;
        let mut costs: Vec<Cost> = Limit::ALL
            .into_iter()
            .map(|limit| (limit, limit.without(rig, &exposures_s)))
            .filter(|(_, without_s)| *without_s < period_s * (1.0 - 1e-6))
            .map(|(limit, period_without_s)| Cost {
                limit,
                period_without_s,
                instrument_without_s: exposures * period_without_s,
            })
            .collect();
        costs.sort_by(|a, b| a.period_without_s.total_cmp(&b.period_without_s));
        Self {
            period_s,
            rate_hz: 1.0 / period_s,
            instrument_s: exposures * period_s,
            lit_s: (plan.lit_patterns() * each) as f64 * period_s,
            black_s: (BLACK_EXPOSURES * each) as f64 * period_s,
            grid_s: (directions.grid.len() * each) as f64 * period_s * shared,
            exposing_share: mean(&exposures_s) / period_s,
            display_frames: rig.refresh_hz().map(|hz| period_s * hz),
            loads: plan.len().div_ceil(plan.segment),
            costs,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::incident::Grid;
    use crate::plan::Request;

    fn pace(rig: &Rig, step_deg: f64) -> PredictedTime {
        let request = Request {
            grid: Grid::ThetaPhi { step_deg },
            image_size: 32,
            ..Request::default()
        };
        let plan = Plan::new(request.clone(), rig, rig.camera.exposure_s).unwrap();
        PredictedTime::new(&plan, &Directions::new(rig, &request.grid).unwrap(), rig)
    }

    fn limits(pace: &PredictedTime) -> Vec<Limit> {
        pace.costs.iter().map(|cost| cost.limit).collect()
    }

    #[test]
    fn the_prototype_takes_the_papers_50_minutes_and_the_dmd_3_4_seconds() {
        let rcg1 = pace(&Rig::load("rcg-1-16bit").unwrap(), 1.0);
        assert!((rcg1.grid_s / 60.0 - 50.0).abs() < 0.1, "{}", rcg1.grid_s);
        assert!((rcg1.lit_s + rcg1.black_s - rcg1.instrument_s).abs() < 1e-9);
        assert!(rcg1.lit_s < rcg1.grid_s);
        // Settling and exposing cost 33.3 ms each, reading out 26 ms.
        assert_eq!(limits(&rcg1), [Limit::Settling, Limit::Exposure, Limit::Readout]);
        let dmd = pace(&Rig::load("dmd").unwrap(), 1.0);
        assert!((dmd.grid_s - 32_400.0 / 9_523.8).abs() < 1e-3, "{}", dmd.grid_s);
        assert_eq!(limits(&dmd), [Limit::PatternRate]);
        // Then settling, delay and exposure are what is left.
        assert!((dmd.costs[0].period_without_s - 90e-6).abs() < 1e-9);
    }

    #[test]
    fn a_commodity_projector_of_60_hz_needs_seconds_for_few_captures() {
        let mut rig = Rig::load("rcg-2").unwrap();
        rig.projector.settle_s = 0.004;
        rig.projector.min_period_s = 1.0 / 60.0;
        rig.camera.exposure_s = 0.008;
        rig.camera.overlap = true;
        rig.camera.readout_s = 0.010;
        let pace = pace(&rig, 15.0);
        assert!((pace.rate_hz - 60.0).abs() < 1e-9);
        assert!(
            (pace.instrument_s - (144.0 + 16.0) / 60.0).abs() < 1e-9,
            "{}",
            pace.instrument_s
        );
        assert_eq!(limits(&pace), [Limit::PatternRate]);
    }

    #[test]
    fn a_display_shows_each_picture_for_whole_frames_and_a_dark_one() {
        let mut rig = Rig::load("rcg-2").unwrap();
        rig.projector.settle_s = 0.010;
        rig.projector.min_period_s = 0.0;
        rig.camera.exposure_s = 0.004;
        rig.camera.overlap = true;
        rig.camera.readout_s = 0.0;
        let triggered = pace(&rig, 15.0);
        assert_eq!(triggered.display_frames, None);
        rig.projector.driver = crate::instrument::drivers::ProjectorDriver::Window;
        // Whoever does not say how often has 60 Hz: the step ends in the first frame, the next goes dark.
        for (exposure_s, frames) in [(0.004, 2.0), (0.008, 3.0), (0.024, 4.0)] {
            rig.camera.exposure_s = exposure_s;
            let led = pace(&rig, 15.0);
            assert!((led.display_frames.unwrap() - frames).abs() < 1e-9, "{led:?}");
            assert!((led.instrument_s - 160.0 * frames / 60.0).abs() < 1e-9, "{led:?}");
            assert!(limits(&led).contains(&Limit::Display), "{led:?}");
        }
    }

    #[test]
    fn without_a_limit_nothing_takes_longer() {
        for preset in crate::instrument::rig::PRESETS {
            let rig = Rig::load(preset).unwrap();
            let pace = pace(&rig, 15.0);
            assert!(!pace.costs.is_empty(), "{preset}: something bounds it");
            assert!(
                pace.costs
                    .iter()
                    .all(|cost| cost.period_without_s < pace.period_s)
            );
            assert!(pace.exposing_share > 0.0 && pace.exposing_share <= 1.0);
        }
    }
}
