//! The pilot capture, which chooses the exposure time.

use crate::capture::{Instrument, Tally};
use crate::evaluate::is_judged;
use crate::incident::Grid;
use crate::measurement::MeasurementError;
use crate::optics::{DirectionMap, View};
use crate::pattern::{LitSet, PatternMaker};
use crate::plan::{Directions, PlanError, spot_deg};
use crate::rig::Rig;
use crate::schedule::Timing;

/// Incident directions of the pilot capture that chooses the exposure time.
const PILOT_DIRECTIONS: usize = 48;
/// The pilot's brightest pixels (all but this share) shall come to [`PILOT_TARGET`] of the range.
const PILOT_CLIPPED: f64 = 1e-4;
/// See [`PILOT_CLIPPED`].
const PILOT_TARGET: f64 = 0.85;

/// The exposure time in s at which the brightest pixels of a few test exposures nearly fill the camera's range;
/// at most the rig's default, beyond which the measurement would take longer than the rig is made for.
///
/// `rig` has its camera image scaled as it will be measured.
///
/// # Errors
/// [`MeasurementError`].
pub fn pilot(rig: &Rig, grid: &Grid, instrument: &mut Instrument) -> Result<f64, MeasurementError> {
    let directions = Directions::new(rig, grid)?;
    let lit = |index: &usize| is_judged(directions.grid.direction(*index));
    let measurable: Vec<usize> = directions.measurable().filter(lit).collect();
    // A stride that shares no factor with the ring length visits all azimuths.
    let every = (measurable.len() / PILOT_DIRECTIONS).max(1) | 1;
    let maker = PatternMaker::new(
        View::projector(rig),
        spot_deg(rig, grid),
        rig.projector.irradiance,
    );
    let lit: Vec<Option<LitSet>> = measurable
        .iter()
        .step_by(every)
        .map(|&index| maker.lit_set(directions.grid.direction(index)).ok())
        .collect();
    let range = f64::from(rig.saturation_dn()) - rig.camera.dark_dn;
    // Near the horizon f grows without bound; those few pixels may clip rather than darken all others.
    let channels = rig.camera.channels as usize;
    let judged: Vec<bool> = DirectionMap::of(&View::camera(rig))
        .directions
        .into_iter()
        .flat_map(|w| std::iter::repeat_n(w.is_ok_and(is_judged), channels))
        .collect();
    let mut exposure_s = rig.camera.exposure_s;
    for _ in 0..8 {
        let timing = Timing::new(rig, exposure_s).map_err(PlanError::from)?;
        let shots = instrument.take_lit(&lit, &timing, &mut Tally::default(), &mut |_| {})?;
        let mut dn: Vec<u16> = Vec::new();
        for shot in shots {
            dn.extend(
                shot.dn
                    .iter()
                    .zip(&judged)
                    .filter(|(_, judged)| **judged)
                    .map(|(dn, _)| dn),
            );
        }
        if dn.is_empty() {
            return Ok(exposure_s); // nothing to go by
        }
        let rank = ((dn.len() as f64 * (1.0 - PILOT_CLIPPED)) as usize).min(dn.len().saturating_sub(1));
        let (_, bright, _) = dn.select_nth_unstable(rank);
        if *bright < rig.saturation_dn() {
            let fill = (f64::from(*bright) - rig.camera.dark_dn) / range;
            return Ok((exposure_s * PILOT_TARGET / fill.max(1e-6)).min(rig.camera.exposure_s));
        }
        exposure_s /= 8.0;
    }
    Ok(exposure_s)
}
