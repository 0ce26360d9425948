//! Alignment: by which moves of camera, projector and sample the rig becomes what its file says.
//!
//! # Design
//! The same views and the same fit as those of a calibration, but what comes of them is advice to hands. A lateral move is the
//! difference of what the rig file says and what was found. Where a camera looks and how wide can be put right by turning it, moving it
//! along its axis, or by another lens (principal point, focal length), and nothing in the views, nor in directions, tells these
//! apart: so the three turns and the move along the axis are those that, together, leave the least error of directions (least squares
//! over the device's image), and stand for all of them. Their uncertainty is that of the combined move; how far the part itself
//! is known is stated beside it, and so is what no view tells: where on its plane, and how high, the sample lies.
//!
//! Axes are those of the device, on which its stages stand: x (the right of its image, unless that is mirrored), y (down), and z, along
//! which it looks. In those of the mirror, a device that looks aside would have what nothing tells in two axes. A turn is a difference of
//! the rig file's `rotation_deg`. The sample's axes are the mirror's.

mod words;

use glam::{DMat3, DVec3, EulerRot};
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use self::words::{name, words};
use super::parameters::{ANGLE_DEG, POSITION_M};
use super::{Fit, PROBES, Sightings, Views, agreed, check_matches, in_units, with_shape};
use crate::calibrate::CalibrateError;
use crate::hemisphere::judged::is_judged;
use crate::instrument::optics::View;
use crate::instrument::parts::Lens;
use crate::instrument::rig::Rig;

/// RMS error of directions, degrees, and lateral offset, millimetres, below which there is nothing more to move.
pub const ALIGNED_DEG: f64 = 0.3;
/// See [`ALIGNED_DEG`].
pub const ALIGNED_MM: f64 = 0.3;
/// A move is worth making from this share of its standard uncertainty on: nothing is nearer to the truth than what was found, but hands
/// would never come to rest.
const CLEAR: f64 = 0.3;
/// Moves that no screw is turned for, millimetres and degrees.
const FINEST: f64 = 0.05;
/// Rounds of least squares for the combined moves.
const ROUNDS: usize = 4;
/// Steps for derivatives: metres and degrees of moves, tolerances of unknowns.
const STEPS: [f64; 2] = [1e-6, 1e-4];
const STEP: f64 = 1e-4;

/// What is moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Part {
    /// The camera.
    Camera,
    /// The projector.
    Projector,
    /// The sample's holder.
    Sample,
}

/// How it is moved: along an axis of the device, of the mirror for the sample, or about one (x, y, z are 0, 1, 2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Motion {
    /// Along it, in millimetres.
    Shift(usize),
    /// About it, in degrees: a difference of `rotation_deg`; of the sample 0 is its roll and 1 its tilt.
    Turn(usize),
}

/// A move.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Move {
    /// What is moved.
    pub part: Part,
    /// How.
    pub motion: Motion,
    /// By how much, millimetres or degrees.
    pub by: f64,
    /// Its standard uncertainty (k = 1), in the same unit.
    pub standard_uncertainty: f64,
    /// Whether it is worth making.
    pub is_clear: bool,
    /// Whether it stands for others that nothing tells apart from it.
    pub is_combined: bool,
    /// It in words.
    pub words: String,
}

/// What nothing in the views tells.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Undetermined {
    /// What, and why.
    pub what: String,
    /// How well it is known (k = 1), in `unit`.
    pub standard_uncertainty: f64,
    /// mm or degrees.
    pub unit: &'static str,
}

/// What is to be done.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Advice {
    /// All moves, of each part the lateral ones first.
    pub moves: Vec<Move>,
    /// What is not told.
    pub undetermined: Vec<Undetermined>,
    /// By how much directions of the rig file are off those of the rig as it stands, RMS over camera and projector, degrees.
    pub directions_deg: f64,
    /// The same behind the moves: distortion and the mirror's shape, which no move puts right and a calibration finds.
    pub directions_after_deg: f64,
    /// The larger of the distances of camera and projector from their places, across their axes, millimetres.
    pub lateral_mm: f64,
    /// Standard uncertainty (k = 1) of that, the larger of both devices': what is nearer to the focus than this nobody can tell.
    pub lateral_uncertainty_mm: f64,
    /// How the images of camera and projector are turned against the rig file.
    pub images: [String; 2],
    /// Whether the rig stands as well as it has to before it is calibrated.
    pub is_aligned: bool,
}

impl Move {
    /// Makes this move on `rig`: what a person does with screws.
    pub fn apply(&self, rig: &mut Rig) {
        apply(rig, self.part, self.motion, self.by);
    }
}

/// Moves a part of `rig` by so many millimetres or degrees.
pub fn apply(rig: &mut Rig, part: Part, motion: Motion, by: f64) {
    let lens = match part {
        Part::Camera => &mut rig.camera.lens,
        Part::Projector => &mut rig.projector.lens,
        Part::Sample => {
            match motion {
                Motion::Shift(axis) => rig.sample.offset_m[axis.min(2)] += by * 1e-3,
                Motion::Turn(0) => rig.sample.roll_deg += by,
                Motion::Turn(1) => rig.sample.tilt_deg += by,
                Motion::Turn(_) => rig.sample.azimuth_deg += by,
            }
            return;
        }
    };
    match motion {
        Motion::Shift(axis) => {
            let moved = DVec3::from_array(lens.offset_m) + by * 1e-3 * axes(lens).col(axis.min(2));
            lens.offset_m = moved.to_array();
        }
        Motion::Turn(axis) => lens.rotation_deg[axis.min(2)] += by,
    }
}

/// The axes of a device, as columns, mirror frame.
fn axes(lens: &Lens) -> DMat3 {
    let [x_rad, y_rad, z_rad] = lens.rotation_deg.map(f64::to_radians);
    DMat3::from_euler(EulerRot::XYZ, x_rad, y_rad, z_rad)
}

/// By how much a device is off its place in `nominal`, along the axes that it has there, millimetres.
#[must_use]
pub fn offset_mm(lens: &Lens, nominal: &Lens) -> [f64; 3] {
    let off_m = DVec3::from_array(lens.offset_m) - DVec3::from_array(nominal.offset_m);
    (axes(nominal).transpose() * off_m * 1e3).to_array()
}

/// What the captures in `dir` of a rig advise; they are those of a calibration of the geometry.
///
/// # Errors
/// [`CalibrateError::Views`] if they tell nothing of the rig, or others if they cannot be read.
pub fn advise(dir: &std::path::Path) -> Result<Advice, CalibrateError> {
    let (views, raw) = Views::read(dir)?;
    let seen = Sightings::read(&views, &raw)?;
    check_matches(&seen)?;
    let stated = views.scaled()?;
    let fit = Fit::of(&views, &stated, &seen)?;
    let (_, covariance) = agreed(&fit.solution)?;
    Ok(Finding {
        covariance: in_units(&fit.unknowns, &covariance),
        of_parts: in_units(&fit.unknowns, &with_shape(&fit.solution, &covariance)),
        fit: &fit,
    }
    .advice())
}

/// Camera and projector, and where their lenses are.
const DEVICES: [(Part, Aim); 2] = [
    (
        Part::Camera,
        Aim {
            view: View::camera,
            lens: |rig| &rig.camera.lens,
        },
    ),
    (
        Part::Projector,
        Aim {
            view: View::projector,
            lens: |rig| &rig.projector.lens,
        },
    ),
];

/// How a device of a rig is looked at.
#[derive(Clone, Copy)]
struct Aim {
    view: fn(&Rig) -> View,
    lens: fn(&Rig) -> &Lens,
}

/// The combined moves: along the axis and the three turns.
const COMBINED: [Motion; 4] = [
    Motion::Shift(2),
    Motion::Turn(0),
    Motion::Turn(1),
    Motion::Turn(2),
];

/// What was found, and what should be.
struct Finding<'a> {
    fit: &'a Fit,
    /// Covariance of the unknowns for directions, in the units of the rig file.
    covariance: DMatrix<f64>,
    /// Covariance of where the parts are, in the same units: what the mirror's shape makes of them counts.
    of_parts: DMatrix<f64>,
}

impl Finding<'_> {
    /// The place of the unknown `name`.
    fn place(&self, name: &str) -> Option<usize> {
        self.fit.unknowns.iter().position(|unknown| unknown.name == name)
    }

    /// Standard uncertainty of the unknown `name`, in the unit of the rig file.
    fn sigma(&self, name: &str) -> f64 {
        self.place(name).map_or(0.0, |at| self.of_parts[(at, at)].sqrt())
    }

    /// Standard uncertainty of where a device is along the unit vector `axis`, mirror frame, metres.
    fn sigma_along(&self, part: Part, axis: DVec3) -> f64 {
        let places = [0, 1, 2].map(|at| self.place(&format!("{}.lens.offset_m[{at}]", name(part))));
        let mut variance = 0.0;
        for (row, along) in places.iter().zip(axis.to_array()) {
            for (column, other) in places.iter().zip(axis.to_array()) {
                if let (Some(row), Some(column)) = (row, column) {
                    variance += along * other * self.of_parts[(*row, *column)];
                }
            }
        }
        variance.max(0.0).sqrt()
    }

    fn advice(&self) -> Advice {
        let (nominal, found) = (&self.fit.nominal, &self.fit.solution.rig);
        let mut moves = self.sample_moves();
        let mut after = found.clone();
        for one in &moves {
            one.apply(&mut after);
        }
        let mut squares = [0.0; 2];
        let mut undetermined = vec![Undetermined {
            what: "sample, right, down and forward: where it lies changes no direction; centre it in the lit area by eye".to_owned(),
            standard_uncertainty: POSITION_M * 1e3,
            unit: "mm",
        }];
        let (mut lateral_mm, mut lateral_uncertainty_mm) = (0.0_f64, 0.0_f64);
        for (part, aim) in DEVICES {
            let device = self.device_moves(part, aim, &after);
            let probes = probes(aim, nominal);
            squares[0] += misses(&probes, &(aim.view)(found)).norm_squared() / probes.len().max(1) as f64;
            for one in &device {
                one.apply(&mut after);
            }
            squares[1] += misses(&probes, &(aim.view)(&after)).norm_squared() / probes.len().max(1) as f64;
            let [right, down, _] = offset_mm((aim.lens)(found), (aim.lens)(nominal));
            lateral_mm = lateral_mm.max(right.hypot(down));
            let own = axes((aim.lens)(found));
            let [sigma_right, sigma_down] = [own.x_axis, own.y_axis].map(|axis| self.sigma_along(part, axis));
            lateral_uncertainty_mm =
                lateral_uncertainty_mm.max(1e3 * sigma_right.hypot(sigma_down) / 2_f64.sqrt());
            undetermined.extend(self.apart(part, axes((aim.lens)(found)).z_axis));
            moves.extend(device);
        }
        let [directions_deg, directions_after_deg] = squares.map(|sum| (sum / 2.0).sqrt().to_degrees());
        Advice {
            moves,
            undetermined,
            directions_deg,
            directions_after_deg,
            lateral_mm,
            lateral_uncertainty_mm,
            images: self.fit.orientations.map(|orientation| orientation.to_string()),
            is_aligned: directions_deg < ALIGNED_DEG && lateral_mm < ALIGNED_MM,
        }
    }

    /// How the sample is to be turned.
    fn sample_moves(&self) -> Vec<Move> {
        let (nominal, found) = (&self.fit.nominal.sample, &self.fit.solution.rig.sample);
        let roll = nominal.roll_deg - found.roll_deg;
        let tilt = nominal.tilt_deg - found.tilt_deg;
        vec![
            made(
                Part::Sample,
                Motion::Turn(0),
                roll,
                self.sigma("sample.roll_deg"),
                false,
            ),
            made(
                Part::Sample,
                Motion::Turn(1),
                tilt,
                self.sigma("sample.tilt_deg"),
                false,
            ),
        ]
    }

    /// How a device is to be moved where the rest of the rig is `around` it.
    fn device_moves(&self, part: Part, aim: Aim, around: &Rig) -> Vec<Move> {
        let nominal = &self.fit.nominal;
        let mut rig = around.clone();
        let mut moves = Vec::new();
        let off_m =
            DVec3::from_array((aim.lens)(nominal).offset_m) - DVec3::from_array((aim.lens)(&rig).offset_m);
        let frame = axes((aim.lens)(&rig));
        for axis in 0..2 {
            let by = frame.col(axis).dot(off_m) * 1e3;
            let sigma = self.sigma_along(part, frame.col(axis)) * 1e3;
            moves.push(made(part, Motion::Shift(axis), by, sigma, false));
            apply(&mut rig, part, Motion::Shift(axis), by);
        }
        let probes = probes(aim, nominal);
        let mut by = DVector::zeros(COMBINED.len());
        for motion in &COMBINED[1..] {
            // Near to the end: least squares then are as good as linear.
            let Motion::Turn(axis) = *motion else { continue };
            let turn = (aim.lens)(nominal).rotation_deg[axis] - (aim.lens)(&rig).rotation_deg[axis];
            by[1 + axis] += turn;
            apply(&mut rig, part, *motion, turn);
        }
        let mut solver = None;
        for _ in 0..ROUNDS {
            let missed = misses(&probes, &(aim.view)(&rig));
            let jacobian = jacobian(part, aim, &rig, &probes);
            let normal = jacobian.tr_mul(&jacobian);
            let Some(inverse) = normal.try_inverse() else {
                break;
            };
            let solve = inverse * jacobian.transpose();
            let step = -(&solve * missed);
            for (motion, step) in COMBINED.into_iter().zip(step.iter()) {
                apply(&mut rig, part, motion, *step);
            }
            by += step;
            solver = Some(solve);
        }
        let sigmas = solver.map_or(vec![0.0; COMBINED.len()], |solve| {
            self.combined(aim, &probes, &solve)
        });
        moves.extend(
            COMBINED
                .into_iter()
                .zip(by.iter().zip(sigmas))
                .map(|(motion, (by, sigma))| made(part, motion, *by, sigma, true)),
        );
        moves
    }

    /// Standard uncertainties of the combined moves, which `solve` makes of what is missed: those of all unknowns that change the directions
    /// of the device, but for what a lateral move and the sample's turn put right.
    fn combined(&self, aim: Aim, probes: &[Probe], solve: &DMatrix<f64>) -> Vec<f64> {
        let found = &self.fit.solution.rig;
        let columns: Vec<DVector<f64>> = self
            .fit
            .unknowns
            .iter()
            .map(|unknown| {
                let step = STEP * unknown.tolerance;
                let side = |by: f64| {
                    let mut rig = found.clone();
                    *unknown.of(&mut rig) += by;
                    misses(probes, &(aim.view)(&rig))
                };
                solve * ((side(step) - side(-step)) / (2.0 * step))
            })
            .collect();
        let of_unknowns = DMatrix::from_columns(&columns);
        let covariance = &of_unknowns * &self.covariance * of_unknowns.transpose();
        covariance
            .diagonal()
            .iter()
            .map(|variance| variance.max(0.0).sqrt())
            .collect()
    }

    /// What the combined moves of a device, which looks along `axis`, do not tell apart.
    fn apart(&self, part: Part, axis: DVec3) -> [Undetermined; 2] {
        let name = name(part);
        let turn = (0..2)
            .map(|axis| self.sigma(&format!("{name}.lens.rotation_deg[{axis}]")))
            .fold(0.0, f64::max);
        [
            Undetermined {
                what: format!("{name}, forward, apart from its focal length"),
                standard_uncertainty: self.sigma_along(part, axis) * 1e3,
                unit: "mm",
            },
            Undetermined {
                what: format!("{name}, turned, apart from its principal point"),
                standard_uncertainty: turn.min(ANGLE_DEG),
                unit: "°",
            },
        ]
    }
}

/// A position of a device's image and the direction that the rig file has there.
struct Probe {
    at_px: [f64; 2],
    direction: DVec3,
}

/// Positions that are judged over the image of a device of the `nominal` rig.
fn probes(aim: Aim, nominal: &Rig) -> Vec<Probe> {
    let view = (aim.view)(nominal);
    let (width, height) = view.size_px();
    let at = |index: u32, size: usize| (f64::from(index) + 0.5) * size as f64 / f64::from(PROBES);
    let all = (0..PROBES).flat_map(|row| (0..PROBES).map(move |column| (column, row)));
    all.filter_map(|(column, row)| {
        let at_px = [at(column, width), at(row, height)];
        let direction = view
            .direction(at_px[0], at_px[1])
            .ok()
            .filter(|w| is_judged(*w))?;
        Some(Probe { at_px, direction })
    })
    .collect()
}

/// Derivatives of what is missed at the `probes` by the combined moves.
fn jacobian(part: Part, aim: Aim, rig: &Rig, probes: &[Probe]) -> DMatrix<f64> {
    let columns = COMBINED.map(|motion| {
        let step = match motion {
            Motion::Shift(_) => STEPS[0] * 1e3,
            Motion::Turn(_) => STEPS[1],
        };
        let side = |by: f64| {
            let mut rig = rig.clone();
            apply(&mut rig, part, motion, by);
            misses(probes, &(aim.view)(&rig))
        };
        (side(step) - side(-step)) / (2.0 * step)
    });
    DMatrix::from_columns(&columns)
}

/// By how much what a device sees at the `probes` is off, three components each.
fn misses(probes: &[Probe], view: &View) -> DVector<f64> {
    let off = probes.iter().flat_map(|probe| {
        let [u, v] = probe.at_px;
        let seen = view.sight(u, v).unwrap_or(probe.direction);
        (seen - probe.direction).to_array()
    });
    DVector::from_iterator(3 * probes.len(), off)
}

fn made(part: Part, motion: Motion, by: f64, standard_uncertainty: f64, is_combined: bool) -> Move {
    let is_clear = by.abs() > (CLEAR * standard_uncertainty).max(FINEST);
    Move {
        words: words(part, motion, by, standard_uncertainty, is_clear),
        part,
        motion,
        by,
        standard_uncertainty,
        is_clear,
        is_combined,
    }
}
