//! Errors that all samples have in common, which no residual shows.
//!
//! # Design
//! All f may be too large by the same share, as the standard's reflectance is known to some share only. All outgoing and all
//! incident directions may be turned about an axis, or lie farther from the normal by the same angle: that is what wrong poses
//! of camera, projector and sample do. Each of these is a pattern of errors over the samples, one standard uncertainty large.

use glam::{DQuat, DVec3};
use nalgebra::DVector;

use super::observations::Observations;

/// The patterns, in sr⁻¹ for each channel of each sample; `f` gives the model's values at the directions of some samples.
pub(super) fn errors(seen: &Observations, f: impl Fn(&Observations) -> DVector<f64>) -> Vec<DVector<f64>> {
    let here = f(seen);
    let mut errors = vec![&here * seen.common_uncertainty];
    for (is_light, rad) in [false, true].into_iter().zip(seen.direction_rad) {
        if rad > 0.0 {
            errors.extend(shifts(rad).iter().map(|shift| {
                let moved = |four: &[DVec3; 4]| four.map(shift);
                let shifted = if is_light {
                    seen.with_directions(moved, |places| *places)
                } else {
                    seen.with_directions(|light| *light, moved)
                };
                f(&shifted) - &here
            }));
        }
    }
    errors
}

/// Shifts of directions by `rad` radians: turns about the sample's axes, and away from its normal.
fn shifts(rad: f64) -> [Box<dyn Fn(DVec3) -> DVec3>; 4] {
    let turn = move |axis: DVec3| -> Box<dyn Fn(DVec3) -> DVec3> {
        let turn = DQuat::from_axis_angle(axis, rad);
        Box::new(move |w| turn * w)
    };
    [
        turn(DVec3::X),
        turn(DVec3::Y),
        turn(DVec3::Z),
        Box::new(move |w: DVec3| {
            let axis = DVec3::Z.cross(w).try_normalize();
            axis.map_or(w, |axis| DQuat::from_axis_angle(axis, rad) * w)
        }),
    ]
}
