//! Calibration of the geometry: poses, lenses, mirror and sample frame.
//!
//! # Design
//! | file | holds |
//! |---|---|
//! | `capture` | the views: what is shown and taken |
//! | [`alignment`] | moves that bring the parts to where the rig file has them |
//! | `by_hand` | views whose targets somebody puts in |
//! | `stands` | which target stands there, told by one view |
//! | `orientation` | which way round the images of camera and projector are |
//! | `mounts` | how the flat mirror stood: tilts are stated by hand |
//! | `sightings` | frames → matches of camera and projector, edges of the mirror |
//! | `shadows` | where the wire is, and what else hides the standard |
//! | `wire` | whether a wire that was fitted is the one that is seen |
//! | `parameters` | the unknowns and their tolerances |
//! | `solve` | robust least squares |
//! | `shape` | what the mirror's shape may make of the unknowns |
//! | `uncertainty` | that of directions |
//! | `leftover` | what the fit leaves that is no chance |
//! | `picture` | the residuals over the camera's image |
//!
//! Two kinds of view make the unknowns observable:
//! - a flat first-surface mirror in the sample's place, at tilts that are stated against the holder. Structured light
//!   ([`crate::plan::stripes`]) tells for each camera pixel which projector position it sees in it. The mirrored direction of the
//!   one is that of the other, so the matches of one tilt tie the two maps of directions together, and those of several
//!   tilts fix both in the sample's frame: no rotation but the identity commutes with reflections at three normals.
//! - a diffuse standard under a single spot: the camera sees all of the mirror that it can, and where it ends: the edges of
//!   hole, rim and wire, which are known about the mirror's axis.
//!
//! What counts in the end are directions, not parameters: [`Geometry`] states the standard uncertainty of the directions of
//! camera and projector as the covariance has it and what no such rig explains adds to it, and views that leave it above [`WORST_DEG`] are refused.

pub mod alignment;
mod by_hand;
mod capture;
mod leftover;
mod mask;
mod mounts;
mod orientation;
mod outlines;
mod parameters;
mod picture;
mod shadows;
mod shape;
mod sightings;
mod solve;
mod stands;
#[cfg(test)]
mod tests;
mod uncertainty;
mod wire;

use std::path::Path;

use glam::DVec2;
use nalgebra::DMatrix;

pub use by_hand::ByHand;
pub use capture::{Request, Said, Views, capture};
pub use mask::Mask;
use mounts::{Agreement, Mount};
use orientation::{orientations, turned};
use parameters::{Parameter, parameters};
use shadows::{Shadows, Wire};
use sightings::Sightings;
use solve::{Residual, Solution, Task, sketch, solve};
use uncertainty::{uncertainties, undetermined};

use super::{CalibrateError, RIG};
use crate::base::median::median;
use crate::instrument::calibration::{Found, GEOMETRY, Geometry, TiltFound, WORST_DEG, file, rig_hash};
use crate::instrument::optics::View;
use crate::instrument::parts::Obstacle;
use crate::instrument::rig::Rig;
use crate::store::whole_file::write_whole;

/// Where the flat mirror stands if nobody says otherwise: tilt and azimuth, degrees.
pub const TILTS: [[f64; 2]; 4] = [[0.0, 0.0], [15.0, 0.0], [15.0, 120.0], [15.0, 240.0]];
/// What a tilt is off by if nobody says otherwise, degrees, k = 1: verniers of rotation and tilt stages are read to 5 minutes of arc, by hand
/// to half of that, and what is mounted on them is straight to as much.
pub const TILT_UNCERTAINTY_DEG: f64 = 0.05;
/// Name of the picture of the residuals.
pub const RESIDUALS: &str = "geometry-residuals.png";
/// Name of the picture of the diffuse standard.
pub const STANDARD: &str = "geometry-standard.png";
/// Fewest matches.
const FEWEST: usize = 500;
/// Positions along each side of an image at which the uncertainty of its directions is found.
const PROBES: u32 = 12;
/// Tolerances by which a rig differs from its file, at most.
const FARTHEST: f64 = 6.0;
/// Matches of each view of a rough fit.
const SKETCHED: usize = 300;

/// Fits the geometry to the captures in `dir`, of which is `said` what they do not show, and writes the calibrated rig, what was
/// found and the residuals beside them.
///
/// # Errors
/// [`CalibrateError::Views`] if the captures do not determine it, or are not what is said of them.
pub fn calibrate(dir: &Path, said: &Said) -> Result<Geometry, CalibrateError> {
    let (mut views, raw) = Views::read(dir)?;
    said.apply(&mut views)?;
    let mask = match &said.mask {
        Some(mask) => Some(mask.clone()),
        None => Mask::of(dir)?,
    };
    let mut seen = Sightings::read(&views, &raw)?;
    picture::save_standard(&seen, &dir.join(STANDARD))?;
    if let Some(mask) = &mask {
        mask.apply(&mut seen);
    }
    check_matches(&seen)?;
    let stated = views.scaled()?;
    let Fit {
        unknowns,
        mounts,
        orientations,
        mut solution,
        wire: placed,
        unseen,
        ..
    } = Fit::of(&views, &stated, &seen)?;
    let found = found(&views, &stated, &seen, &unknowns, &mounts, &solution)?;
    placed?;
    solution.rig.wire = solution.rig.wire.or(unseen);
    if let Some(mask) = &mask {
        let hidden = mask.obstacles(&solution.rig, seen.width)?;
        solution.rig.obstacles.extend(hidden);
    }
    let hidden = hidden(&solution.rig, &seen);
    solution.rig.obstacles.extend(hidden);
    let rig = solution.rig.with_sensor_of(&views.rig)?;
    let geometry = Geometry {
        images: orientations.map(|orientation| orientation.to_string()),
        rig_sha256: rig_hash(&rig),
        ..found
    };
    super::check(&geometry)?;
    if let Some(mask) = &said.mask {
        mask.keep(dir)?;
    }
    picture::save_panels(&views, &seen, &solution, &dir.join(RESIDUALS))?;
    file::write(&dir.join(GEOMETRY), &geometry)?;
    write_whole(&dir.join(RIG), rig.to_toml().as_bytes())?;
    Ok(geometry)
}

/// Refuses matches that are too few to tell anything.
fn check_matches(seen: &Sightings) -> Result<(), CalibrateError> {
    if seen.matches.len() >= FEWEST {
        return Ok(());
    }
    Err(CalibrateError::Views {
        expected: format!("at least {FEWEST} camera pixels that see the projector in the flat mirror"),
        found: seen.matches.len().to_string(),
        advice: "look at the frames: is the mirror in place, and lit?",
    })
}

/// What was seen, fitted.
struct Fit {
    /// The nominal rig with its images turned as they are, without a wire that cannot be seen.
    nominal: Rig,
    unknowns: Vec<Parameter>,
    mounts: Vec<Mount>,
    orientations: [orientation::Orientation; 2],
    solution: Solution,
    /// Where the wire is, or why that is not known.
    wire: Result<Wire, CalibrateError>,
    /// The wire as stated, where none is seen.
    unseen: Option<crate::instrument::parts::Wire>,
}

impl Fit {
    /// That of what was `seen` of the `views` of a rig that is `stated`.
    fn of(views: &Views, stated: &Rig, seen: &Sightings) -> Result<Self, CalibrateError> {
        let mounts: Vec<Mount> = views.tilts.iter().copied().map(Mount::of).collect();
        let task = Task {
            nominal: stated,
            parameters: &parameters(stated),
            mounts: &mounts,
            tilt_deg: views.tilt_uncertainty_deg,
            seen,
        };
        let orientations = orientations(task);
        let mut nominal = turned(stated, orientations);
        // Views that determine nothing show no wire either.
        let wire = place_wire(&mut nominal, task);
        // What cannot be seen has no edges.
        let unseen = nominal.wire.take_if(|_| !matches!(wire, Ok(Wire::At(_))));
        let unknowns = parameters(&nominal);
        let fitted = |nominal: &Rig| {
            let solution = solve(Task {
                nominal,
                parameters: &unknowns,
                ..task
            });
            solution.ok_or_else(|| CalibrateError::Views {
                expected: "views that a rig near the nominal one explains".to_owned(),
                found: "a fit that does not converge".to_owned(),
                advice: "check the tilts that were stated, and the nominal rig",
            })
        };
        let mut solution = fitted(&nominal)?;
        // The azimuth of a wire is searched for from where it was seen.
        if let Some(azimuth_deg) = wire::better_deg(&solution.rig, seen, solution.scales_rad[1])
            && let Some(wire) = &mut nominal.wire
        {
            wire.azimuth_deg = azimuth_deg;
            solution = fitted(&nominal)?;
        }
        Ok(Self {
            nominal,
            unknowns,
            mounts,
            orientations,
            solution,
            wire,
            unseen,
        })
    }
}

/// Puts the wire of `nominal`, the images of which are turned as they should be, where the standard of `task` shows it; says where.
///
/// # Errors
/// [`CalibrateError::Views`] if there is none.
fn place_wire(nominal: &mut Rig, task: Task) -> Result<Wire, CalibrateError> {
    let bare = without_obstacles(nominal);
    let Some(wire) = &mut nominal.wire else {
        return Ok(Wire::OutOfSight);
    };
    let sketch = sketch(Task {
        nominal: &bare,
        parameters: &parameters(&bare),
        seen: &task.seen.thinned(SKETCHED),
        ..task
    });
    let near = sketch.map_or(bare, |sketch| sketch.rig);
    let camera = View::camera(&near);
    let Some(shadows) = Shadows::of(task.seen, &camera) else {
        return Ok(Wire::At(wire.azimuth_deg));
    };
    match shadows.wire(wire.half_width_deg, wire.azimuth_deg) {
        Wire::At(azimuth_deg) => {
            wire.azimuth_deg = azimuth_deg;
            Ok(Wire::At(azimuth_deg))
        }
        Wire::OutOfSight => Ok(Wire::OutOfSight),
        Wire::Missing => Err(CalibrateError::Views {
            expected: format!(
                "a wire {:.2}° wide before the diffuse standard, as the rig file has it at {}°",
                2.0 * wire.half_width_deg,
                wire.azimuth_deg
            ),
            found: "none at any azimuth".to_owned(),
            advice: "look at the frames; if there is none, leave [wire] out of the rig file, if it is not straight, state it as [[obstacle]]",
        }),
    }
}

/// What hides the diffuse standard from the camera of `rig`, as fitted, beyond what the rig has.
fn hidden(rig: &Rig, seen: &Sightings) -> Vec<Obstacle> {
    let bare = without_obstacles(rig);
    let camera = View::camera(&bare);
    Shadows::of(seen, &camera).map_or(Vec::new(), |shadows| shadows.obstacles(rig))
}

/// `rig` with nothing before its mirror.
fn without_obstacles(rig: &Rig) -> Rig {
    Rig {
        wire: None,
        obstacles: Vec::new(),
        ..rig.clone()
    }
}

/// What `solution` makes of the `views` of a `nominal` rig, if it determines the geometry and agrees with what is stated.
fn found(
    views: &Views,
    nominal: &Rig,
    seen: &Sightings,
    unknowns: &[Parameter],
    mounts: &[Mount],
    solution: &Solution,
) -> Result<Geometry, CalibrateError> {
    let left = solution.left;
    let (agreement, covariance) = agreed(solution)?;
    let tilts = tilts(views, mounts, seen, solution, &of_tilts(solution, &covariance));
    agreement.check(mounts, &tilts, views.tilt_uncertainty_deg)?;
    let of_directions = uncertainties(nominal, unknowns, &solution.rig, &in_units(unknowns, &covariance));
    let covariance = in_units(unknowns, &with_shape(solution, &covariance));
    let with_left = |deg: f64| deg.hypot((left.rad / 2_f64.sqrt()).to_degrees());
    let [camera_deg, projector_deg] = of_directions.devices_deg.map(with_left);
    let is_determined = camera_deg.hypot(projector_deg) <= WORST_DEG;
    if !is_determined {
        return Err(CalibrateError::Views {
            expected: format!("views that determine the directions to {WORST_DEG}° (k = 1)"),
            found: format!(
                "{:.3}° together, {camera_deg:.2}° for the camera and {projector_deg:.2}° for the projector, with {} least of all",
                camera_deg.hypot(projector_deg),
                undetermined(unknowns, &of_directions.shares)
            ),
            advice: "add views of the flat mirror at other tilts, in other azimuths (three or more), and know their tilts \
                     better (--tilt-uncertainty-deg)",
        });
    }
    near_stated(unknowns, solution)?;
    let edges = solution.residuals[seen.matches.len()..].iter().flatten().count();
    let mut at_nominal = nominal.clone();
    let mut at_found = solution.rig.clone();
    Ok(Geometry {
        nominal_sha256: rig_hash(&views.rig),
        rig_sha256: String::new(),
        parameters: unknowns
            .iter()
            .enumerate()
            .map(|(at, parameter)| Found {
                name: parameter.name.clone(),
                value: *parameter.of(&mut at_found),
                standard_uncertainty: covariance[(at, at)].sqrt(),
                nominal: *parameter.of(&mut at_nominal),
                tolerance: parameter.tolerance,
            })
            .collect(),
        images: Default::default(),
        tilts,
        tilt_uncertainty_deg: views.tilt_uncertainty_deg,
        covariance: covariance
            .row_iter()
            .map(|row| row.iter().copied().collect())
            .collect(),
        matches: seen.matches.len(),
        edges,
        match_residual_deg: (solution.scales_rad[0] / 1.4826).to_degrees(),
        edge_residual_deg: (edges > 0).then(|| (solution.scales_rad[1] / 1.4826).to_degrees()),
        camera_deg,
        projector_deg,
        azimuth_deg: of_directions.turn_deg,
    })
}

/// How the stated tilts agree, and the covariance of all unknowns, in tolerances, where they count for as much.
///
/// # Errors
/// [`CalibrateError::Views`] if the views tell nothing.
fn agreed(solution: &Solution) -> Result<(Agreement, DMatrix<f64>), CalibrateError> {
    let covariance = |birge: f64| {
        solution.covariance(birge).ok_or_else(|| CalibrateError::Views {
            expected: "views that determine the rig".to_owned(),
            found: "some that tell nothing of it".to_owned(),
            advice: "add views of the flat mirror at other tilts, in other azimuths (three or more)",
        })
    };
    let agreement = Agreement::of(&solution.leans, &of_tilts(solution, &covariance(1.0)?));
    let covariance = covariance(agreement.birge)?;
    Ok((agreement, covariance))
}

/// The `covariance` of all unknowns with what the mirror's shape makes of them. Directions are no more uncertain by it: what a fit puts right
/// of a mirror by moving a lens is right.
fn with_shape(solution: &Solution, covariance: &DMatrix<f64>) -> DMatrix<f64> {
    covariance + solution.shape.covariance(covariance)
}

/// The part of `covariance` that is of the mirror's leans, which stand behind the rig's unknowns.
fn of_tilts(solution: &Solution, covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let (first, count) = (solution.changes.len(), solution.leans.len());
    covariance.view((first, first), (count, count)).into_owned()
}

/// Refuses a rig that no workshop builds from this rig file.
fn near_stated(unknowns: &[Parameter], solution: &Solution) -> Result<(), CalibrateError> {
    let changes = unknowns.iter().zip(&solution.changes);
    let Some((unknown, change)) = changes.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())) else {
        return Ok(());
    };
    if change.abs() <= FARTHEST {
        return Ok(());
    }
    Err(CalibrateError::Views {
        expected: format!(
            "{} as in the rig file, to {} (k = 1)",
            unknown.name, unknown.tolerance
        ),
        found: format!("a difference of {:+.4}", change * unknown.tolerance),
        advice: "put right what the rig file says; are lens, mirror and image those that it describes?",
    })
}

/// The part of `covariance` that is of the rig's unknowns, in the units of the rig file.
fn in_units(unknowns: &[Parameter], covariance: &DMatrix<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(unknowns.len(), unknowns.len(), |row, column| {
        covariance[(row, column)] * unknowns[row].tolerance * unknowns[column].tolerance
    })
}

/// How the flat mirror stood; `covariance` is that of its leans.
fn tilts(
    views: &Views,
    mounts: &[Mount],
    seen: &Sightings,
    solution: &Solution,
    covariance: &DMatrix<f64>,
) -> Vec<TiltFound> {
    let unit_deg = views.tilt_uncertainty_deg;
    let residual = |view: usize| {
        let of_view = |(found, residual): (&sightings::Match, &Residual)| {
            residual.filter(|_| found.view == view).map(DVec2::length)
        };
        let matches = seen.matches.iter().zip(&solution.residuals);
        median(matches.filter_map(of_view).collect()).unwrap_or(0.0)
    };
    mounts
        .iter()
        .enumerate()
        .map(|(view, mount)| TiltFound {
            stated_deg: mount.stated_deg,
            leans_deg: [0, 1].map(|axis| unit_deg * solution.leans[2 * view + axis]),
            standard_uncertainty_deg: [0, 1].map(|axis| {
                let at = 2 * view + axis;
                unit_deg * covariance[(at, at)].sqrt()
            }),
            match_residual_deg: residual(view).to_degrees(),
        })
        .collect()
}
