//! How long a plan takes on a rig, what bounds it, and what would help.
//!
//! # Design
//! A step is bound by whatever it would be shorter without: each limit of the rig is taken away in turn, and the period
//! that is left says what that limit costs. Loading patterns into the projector between segments is not counted: no
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
}

impl Limit {
    const ALL: [Self; 4] = [Self::Settling, Self::Exposure, Self::Readout, Self::PatternRate];

    /// What takes the limit away, for people.
    #[must_use]
    pub const fn remedy(self) -> &'static str {
        match self {
            Self::Settling => "a projector that settles at once",
            Self::Exposure => "light enough for a very short exposure",
            Self::Readout => "a camera that reads out while it exposes, or at once",
            Self::PatternRate => "a projector without a limit on its pattern rate",
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
        }
        mean(&periods_s(&rig, &exposures_s))
    }
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
        let periods: Vec<f64> = plan.timings().iter().map(|timing| timing.period_s).collect();
        let period_s = mean(&periods);
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
