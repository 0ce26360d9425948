//! The unknowns of the geometry.
//!
//! # Design
//! Each unknown is a number of the rig and the tolerance to which the workshop states it. Solving works in units of the
//! tolerances, and each unknown is itself an observation with that uncertainty: what the views do not determine stays where
//! the rig file has it, with the uncertainty of the rig file, and does no harm where the directions do not depend on it.
//!
//! Two things no view can determine, and no direction needs them: the scale (all lengths grow together), and a turn of
//! everything about the mirror's axis, which is held by the sample's azimuth. The sample's offset moves where rays meet
//! it, not their directions.

use crate::instrument::rig::{Lens, Rig};

/// Tolerance of a position, metres.
pub(super) const POSITION_M: f64 = 3e-3;
/// Tolerance of an angle, degrees.
pub(super) const ANGLE_DEG: f64 = 2.0;
/// Tolerance of a focal length and of a principal point against the size of the image, relative.
const LENS: f64 = 0.01;
/// Tolerance of the mirror's semi-axes, relative.
const SHAPE: f64 = 2e-3;
/// Tolerances of k1, k2, p1, p2, k3.
const DISTORTION: [f64; 5] = [0.05, 0.05, 1e-3, 1e-3, 0.02];

/// Where a rig has a number, by the index of the unknown.
type Place = fn(&mut Rig, usize) -> &mut f64;

/// One unknown.
#[derive(Clone)]
pub(super) struct Parameter {
    /// Its place in the rig file.
    pub(super) name: String,
    /// Its standard deviation before anything is seen, in the unit of the rig file.
    pub(super) tolerance: f64,
    of: Place,
    index: usize,
}

impl Parameter {
    /// The number in `rig`.
    pub(super) fn of<'a>(&self, rig: &'a mut Rig) -> &'a mut f64 {
        (self.of)(rig, self.index)
    }
}

/// All unknowns of `rig`.
pub(super) fn parameters(rig: &Rig) -> Vec<Parameter> {
    let mut all = lens_parameters("camera", &rig.camera.lens);
    all.extend(lens_parameters("projector", &rig.projector.lens));
    let mut add = |name: String, tolerance: f64, of: Place, index: usize| {
        all.push(Parameter {
            name,
            tolerance,
            of,
            index,
        });
    };
    add(
        "mirror.a_m".to_owned(),
        SHAPE * rig.mirror.a_m,
        |rig, _| &mut rig.mirror.a_m,
        0,
    );
    add(
        "mirror.b_m".to_owned(),
        SHAPE * rig.mirror.b_m,
        |rig, _| &mut rig.mirror.b_m,
        0,
    );
    for axis in 0..2 {
        let of: Place = |rig, axis| &mut rig.mirror.edge_rotation_deg[axis];
        add(format!("mirror.edge_rotation_deg[{axis}]"), ANGLE_DEG, of, axis);
    }
    add(
        "sample.tilt_deg".to_owned(),
        ANGLE_DEG,
        |rig, _| &mut rig.sample.tilt_deg,
        0,
    );
    add(
        "sample.roll_deg".to_owned(),
        ANGLE_DEG,
        |rig, _| &mut rig.sample.roll_deg,
        0,
    );
    if rig.wire.is_some() {
        let of: Place = |rig, _| &mut rig.wire.as_mut().expect("invariant: there is a wire").azimuth_deg;
        add("wire.azimuth_deg".to_owned(), ANGLE_DEG, of, 0);
    }
    all
}

/// The unknowns of the `lens` of a `device`.
fn lens_parameters(device: &str, lens: &Lens) -> Vec<Parameter> {
    // Function pointers cannot know the device: its number goes in with the index.
    let base = if device == "camera" { 0 } else { 100 };
    let mut all = Vec::new();
    let mut add = |field: String, tolerance: f64, of: Place, index: usize| {
        all.push(Parameter {
            name: format!("{device}.lens.{field}"),
            tolerance,
            of,
            index: base + index,
        });
    };
    for axis in 0..3 {
        add(format!("offset_m[{axis}]"), POSITION_M, offset, axis);
        add(format!("rotation_deg[{axis}]"), ANGLE_DEG, rotation, axis);
    }
    add("focal_px".to_owned(), LENS * lens.focal_px, focal, 0);
    let size_px = f64::from(lens.width_px.max(lens.height_px));
    for axis in 0..2 {
        add(format!("centre_px[{axis}]"), LENS * size_px, centre, axis);
    }
    for (term, tolerance) in DISTORTION.into_iter().enumerate() {
        add(format!("distortion[{term}]"), tolerance, distortion, term);
    }
    all
}

fn lens(rig: &mut Rig, index: usize) -> (&mut Lens, usize) {
    if index < 100 {
        (&mut rig.camera.lens, index)
    } else {
        (&mut rig.projector.lens, index - 100)
    }
}

fn offset(rig: &mut Rig, index: usize) -> &mut f64 {
    let (lens, axis) = lens(rig, index);
    &mut lens.offset_m[axis]
}

fn rotation(rig: &mut Rig, index: usize) -> &mut f64 {
    let (lens, axis) = lens(rig, index);
    &mut lens.rotation_deg[axis]
}

fn focal(rig: &mut Rig, index: usize) -> &mut f64 {
    &mut lens(rig, index).0.focal_px
}

fn centre(rig: &mut Rig, index: usize) -> &mut f64 {
    let (lens, axis) = lens(rig, index);
    &mut lens.centre_px[axis]
}

fn distortion(rig: &mut Rig, index: usize) -> &mut f64 {
    let (lens, term) = lens(rig, index);
    &mut lens.distortion[term]
}
