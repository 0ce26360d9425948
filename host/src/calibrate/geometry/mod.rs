//! Calibration of the geometry: poses, lenses, mirror and sample frame.
//!
//! # Design
//! | file | holds |
//! |---|---|
//! | `capture` | the views: what is shown and taken |
//! | `sightings` | frames → matches of camera and projector, edges of the mirror |
//! | `parameters` | the unknowns and their tolerances |
//! | `solve` | robust least squares |
//! | `leftover` | what the fit leaves that is no chance |
//! | `picture` | the residuals over the camera's image |
//!
//! Two kinds of view make the unknowns observable:
//! - a flat first-surface mirror in the sample's place, at tilts that are known against the holder. Structured light
//!   ([`crate::plan::stripes`]) tells for each camera pixel which projector position it sees in it. The mirrored direction of the
//!   one is that of the other, so the matches of one tilt tie the two maps of directions together, and those of several
//!   tilts fix both in the sample's frame: no rotation but the identity commutes with reflections at three normals.
//! - a diffuse standard under a single spot: the camera sees all of the mirror that it can, and where it ends: the edges of
//!   hole, rim and wire, which are known about the mirror's axis.
//!
//! What counts in the end are directions, not parameters: [`Geometry`] states the standard uncertainty of the directions of
//! camera and projector as the covariance has it and what no such rig explains adds to it, and views that leave it above [`WORST_DEG`] are refused.

mod capture;
mod leftover;
mod parameters;
mod picture;
mod sightings;
mod solve;
#[cfg(test)]
mod tests;

use std::path::Path;

use nalgebra::{DMatrix, DVector};

pub use capture::{Request, Views, capture};
use leftover::Leftover;
use parameters::{Parameter, parameters};
use sightings::Sightings;
use solve::{Solution, moved, solve};

use super::{CalibrateError, RIG};
use crate::hemisphere::direction::from_degrees;
use crate::hemisphere::judged::is_judged;
use crate::instrument::calibration::{Found, GEOMETRY, Geometry, WORST_DEG, file, rig_hash};
use crate::instrument::optics::View;
use crate::instrument::rig::Rig;
use crate::plan::schedule::SHORTEST_EXPOSURE_S;
use crate::store::whole_file::write_whole;
use crate::virtual_rig::FlatMirror;

/// Name of the picture of the residuals.
pub const RESIDUALS: &str = "geometry-residuals.png";
/// Fewest matches.
const FEWEST: usize = 500;
/// Positions along each side of an image at which the uncertainty of its directions is found.
const PROBES: u32 = 12;

/// Fits the geometry to the captures in `dir` and writes the calibrated rig, what was found and the residuals beside them.
///
/// # Errors
/// [`CalibrateError::Views`] if the captures do not determine it.
pub fn calibrate(dir: &Path) -> Result<Geometry, CalibrateError> {
    let (views, raw) = Views::read(dir)?;
    let seen = Sightings::read(&views, &raw)?;
    if seen.matches.len() < FEWEST {
        return Err(CalibrateError::Views {
            expected: format!("at least {FEWEST} camera pixels that see the projector in the flat mirror"),
            found: seen.matches.len().to_string(),
            advice: "look at the frames: is the mirror in place, and lit?",
        });
    }
    let nominal = &views.scaled()?;
    let unknowns = parameters(nominal);
    let mirrors = views.mirrors();
    let mut solution = solve(nominal, &unknowns, &mirrors, &seen).ok_or_else(|| CalibrateError::Views {
        expected: "views that a rig near the nominal one explains".to_owned(),
        found: "a fit that does not converge".to_owned(),
        advice: "check the tilts that were stated, and the nominal rig",
    })?;
    let lens = &nominal.camera.lens;
    let size_px = [lens.width_px, lens.height_px];
    let left = Leftover::of(
        &seen,
        &solution.residuals,
        solution.scales_rad[0],
        unknowns.len(),
        size_px,
    );
    solution.covariance *= left.design_effect;
    let [camera, projector] = uncertainties(nominal, &unknowns, &solution);
    let with_left = |deg: f64| deg.hypot((left.rad / 2_f64.sqrt()).to_degrees());
    let (camera_deg, projector_deg) = (with_left(camera.rms_deg), with_left(projector.rms_deg));
    let is_determined = camera_deg.hypot(projector_deg) <= WORST_DEG;
    if !is_determined {
        return Err(CalibrateError::Views {
            expected: format!("views that determine the directions to {WORST_DEG}° (k = 1)"),
            found: format!(
                "{camera_deg:.2}° for the camera and {projector_deg:.2}° for the projector, with {} least of all",
                undetermined(&unknowns, [&camera, &projector])
            ),
            advice: "add views of the flat mirror at other tilts, in other azimuths (three or more)",
        });
    }
    let rig = solution.rig.with_sensor_of(&views.rig)?;
    let edges = solution.residuals[seen.matches.len()..].iter().flatten().count();
    let mut at_nominal = nominal.clone();
    let mut at_found = solution.rig.clone();
    let geometry = Geometry {
        nominal_sha256: rig_hash(&views.rig),
        rig_sha256: rig_hash(&rig),
        parameters: unknowns
            .iter()
            .enumerate()
            .map(|(at, parameter)| Found {
                name: parameter.name.clone(),
                value: *parameter.of(&mut at_found),
                standard_uncertainty: solution.covariance[(at, at)].sqrt(),
                nominal: *parameter.of(&mut at_nominal),
                tolerance: parameter.tolerance,
            })
            .collect(),
        covariance: solution
            .covariance
            .row_iter()
            .map(|row| row.iter().copied().collect())
            .collect(),
        matches: seen.matches.len(),
        edges,
        match_residual_deg: (solution.scales_rad[0] / 1.4826).to_degrees(),
        edge_residual_deg: (edges > 0).then(|| (solution.scales_rad[1] / 1.4826).to_degrees()),
        camera_deg,
        projector_deg,
    };
    super::check(&geometry)?;
    picture::save_panels(&views, &seen, &solution, &dir.join(RESIDUALS))?;
    file::write(&dir.join(GEOMETRY), &geometry)?;
    write_whole(&dir.join(RIG), rig.to_toml().as_bytes())?;
    Ok(geometry)
}

/// How uncertain the directions of one device are.
struct Uncertainty {
    /// Standard uncertainty, RMS over what of the image is judged, degrees.
    rms_deg: f64,
    /// What each parameter by itself would make of it, squared.
    shares: Vec<f64>,
}

/// Uncertainty of the directions of camera and projector.
fn uncertainties(nominal: &Rig, parameters: &[Parameter], solution: &Solution) -> [Uncertainty; 2] {
    // A difference that is small against the uncertainty and large against rounding.
    let step = 1e-4;
    let mut rigs = vec![solution.rig.clone()];
    rigs.extend((0..parameters.len()).map(|at| {
        let mut by = DVector::zeros(parameters.len());
        by[at] = step;
        moved(&solution.rig, parameters, &by)
    }));
    [View::camera as fn(&Rig) -> View, View::projector].map(|view| {
        let (views, reference): (Vec<View>, View) = (rigs.iter().map(view).collect(), view(nominal));
        let (width, height) = (reference.pinhole().width_px(), reference.pinhole().height_px());
        let (mut sum, mut count) = (0.0, 0_u32);
        let mut shares = vec![0.0; parameters.len()];
        for row in 0..PROBES {
            for column in 0..PROBES {
                let at =
                    |index: u32, size: u32| (f64::from(index) + 0.5) / f64::from(PROBES) * f64::from(size);
                let (u, v) = (at(column, width), at(row, height));
                // Towards the border of the hemisphere nothing holds the lenses, and nothing is judged.
                if !views[0].direction(u, v).is_ok_and(is_judged) {
                    continue;
                }
                let Some(w) = views[0].sight(u, v) else { continue };
                let jacobian = DMatrix::from_fn(3, parameters.len(), |axis, at| {
                    let moved = views[at + 1].sight(u, v).unwrap_or(w);
                    (moved - w)[axis] / (step * parameters[at].tolerance)
                });
                sum += (&jacobian * &solution.covariance * jacobian.transpose()).trace();
                for (at, share) in shares.iter_mut().enumerate() {
                    *share += jacobian.column(at).norm_squared() * solution.covariance[(at, at)];
                }
                count += 1;
            }
        }
        Uncertainty {
            rms_deg: (sum / f64::from(count.max(1))).sqrt().to_degrees(),
            shares,
        }
    })
}

/// Names of the unknowns whose uncertainty turns the directions most.
fn undetermined(parameters: &[Parameter], devices: [&Uncertainty; 2]) -> String {
    let share = |at: usize| devices.iter().map(|device| device.shares[at]).sum::<f64>();
    let mut order: Vec<usize> = (0..parameters.len()).collect();
    order.sort_by(|a, b| share(*b).total_cmp(&share(*a)));
    let names: Vec<&str> = order
        .iter()
        .take(3)
        .map(|at| parameters[*at].name.as_str())
        .collect();
    names.join(", ")
}

impl Views {
    /// The flat mirror of each view: on the virtual rig, of black glass.
    fn mirrors(&self) -> Vec<FlatMirror> {
        // Behind a neutral filter where its image would fill more than a quarter of the well in the shortest exposures.
        let electrons = self.rig.projector.irradiance * self.rig.sensitivity_e() * 2.0 * SHORTEST_EXPOSURE_S;
        let reflectance = capture::REFLECTANCE.min(self.rig.camera.full_well_e / 4.0 / electrons);
        let of = |&[tilt_deg, azimuth_deg]: &[f64; 2]| FlatMirror {
            normal: from_degrees(tilt_deg, azimuth_deg),
            reflectance,
        };
        self.tilts.iter().map(of).collect()
    }
}
