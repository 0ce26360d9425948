//! What a measurement would take.

use serde::Serialize;

use super::{DiskSpace, MeasureError};
use crate::assemble::dynamic_range;
use crate::capture::directory::MeasurementError;
use crate::instrument::rig::Rig;
use crate::plan::light::{Coding, Light};
use crate::plan::predicted_time::PredictedTime;
use crate::plan::schedule::Bound;
use crate::plan::{Directions, Plan, PlanError};

/// What a plan takes on a rig.
#[derive(Clone, Debug, Serialize)]
pub struct Forecast {
    /// On disk.
    pub disk_space: DiskSpace,
    /// Name of the rig.
    pub rig: String,
    /// Exposures in all.
    pub exposures: usize,
    /// Incident directions in reach.
    pub directions: usize,
    /// Kind of the grid of incident directions.
    pub grid: &'static str,
    /// Incident directions of the grid.
    pub grid_directions: usize,
    /// Exposure time in s; of several the shortest.
    pub exposure_s: f64,
    /// Exposure times of a pattern in s.
    pub exposures_s: Vec<f64>,
    /// As [`dynamic_range`] says.
    pub dynamic_range: Option<f64>,
    /// What bounds the length of a step.
    pub bound_by: Bound,
    /// Exposures of a segment.
    pub segment_exposures: usize,
    /// How light is made.
    pub light: Light,
    /// On the instrument.
    #[serde(flatten)]
    pub time: PredictedTime,
}

impl Forecast {
    /// What `plan` takes on `rig`, as it is measured with.
    ///
    /// # Errors
    /// [`MeasureError`] if the grid of the plan is none.
    pub fn of(plan: &Plan, rig: &Rig) -> Result<Self, MeasureError> {
        let directions = Directions::new(rig, &plan.request.grid)
            .map_err(|error| MeasurementError::from(PlanError::from(error)))?;
        let exposures_s = plan.exposures_s();
        Ok(Self {
            disk_space: DiskSpace::of(plan, &directions, rig),
            rig: rig.name.clone(),
            exposures: plan.len(),
            directions: plan.direction_count,
            grid: plan.request.grid.kind(),
            grid_directions: directions.grid.len(),
            exposure_s: plan.exposure_s,
            dynamic_range: dynamic_range(rig, &exposures_s),
            exposures_s,
            bound_by: plan.timing.bound(rig),
            segment_exposures: plan.segment,
            light: plan.code.map_or(Light::Single, Coding::light),
            time: PredictedTime::new(plan, &directions, rig),
        })
    }
}
