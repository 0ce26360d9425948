//! One device (camera or projector) in the rig: what each of its pixels sees at the sample.
//!
//! # Design
//! A pixel's ray starts at the optical centre C, leaves the ellipsoid at P, is reflected and meets the sample
//! plane; the direction at the sample is the reversed reflected ray. With C exactly at F2 every ray meets
//! F1. With C beside F2 the pixels look at slightly different points of the sample, and the direction is
//! that of the ray, not that of the line from F1. A sample whose centre is beside F1 changes no direction, but where the
//! rays meet it.
//! Hole, rim, wire and obstacles are judged where the ray meets the mirror, seen from F1.

use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3, EulerRot};

use super::{Ellipsoid, Figure, Outline, Pinhole, SampleFrame, Unmeasurable, WireStrip, reflect};
use crate::hemisphere::direction::HORIZON_COS;
use crate::instrument::parts::{Lens, Rig};

/// A direction this little below the horizon is rounding of a grazing one, which has its place in the image.
const HORIZON: f64 = HORIZON_COS;
/// A grazing ray this close to the sample plane lies in it, metres.
const IN_PLANE_M: f64 = 1e-12;

/// Camera or projector of a rig, ready to map pixels to directions and back.
#[derive(Debug, Clone)]
pub struct View {
    pub(super) ellipsoid: Ellipsoid,
    /// Where the mirror is not the ellipsoid; `None` if it is.
    figure: Option<Arc<dyn Figure>>,
    pub(super) pinhole: Pinhole,
    frame: SampleFrame,
    pub(super) wire: Option<WireStrip>,
    pub(super) obstacles: Arc<[Outline]>,
    /// Optical centre, mirror frame, metres.
    pub(super) centre_m: DVec3,
    /// Whether the optical centre is exactly at F2, and the mirror images it to F1.
    pub(super) at_focus: bool,
    /// Rotation from the device's frame to the mirror frame.
    device_to_m: DMat3,
    sample_radius_m: f64,
    /// Centre of the sample minus F1, mirror frame, metres.
    sample_offset_m: DVec3,
}

/// The way of one pixel's ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trace {
    /// Direction at the sample, sample frame, unit length, away from the surface.
    pub direction: DVec3,
    /// Where the ray meets the sample plane, sample frame (from the sample's centre), metres; z is 0 but for rounding.
    pub hit_m: DVec3,
    /// Where the ray meets the mirror, mirror frame, metres.
    pub mirror_m: DVec3,
}

/// A ray's reflection, mirror frame, whatever is in its way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reflection {
    /// Point on the ellipsoid, metres.
    pub(super) mirror_m: DVec3,
    /// Unit direction from the sample towards the mirror.
    pub(super) direction: DVec3,
}

impl View {
    /// The rig's camera.
    pub fn camera(rig: &Rig) -> View {
        View::of(rig, &rig.camera.lens)
    }

    /// The rig's projector.
    pub fn projector(rig: &Rig) -> View {
        View::of(rig, &rig.projector.lens)
    }

    fn of(rig: &Rig, lens: &Lens) -> View {
        let ellipsoid = Ellipsoid::of(rig);
        let offset_m = DVec3::from_array(lens.offset_m);
        let [x_rad, y_rad, z_rad] = lens.rotation_deg.map(f64::to_radians);
        View {
            ellipsoid,
            figure: None,
            pinhole: Pinhole::of(lens),
            frame: SampleFrame::of(&rig.sample),
            wire: rig.wire.as_ref().map(WireStrip::of),
            obstacles: rig.obstacles.iter().map(Outline::of).collect(),
            centre_m: ellipsoid.f2() + offset_m,
            at_focus: offset_m == DVec3::ZERO,
            // R_x · R_y · R_z: the rotation about z acts first.
            device_to_m: DMat3::from_euler(EulerRot::XYZ, x_rad, y_rad, z_rad),
            sample_radius_m: rig.sample.radius_m,
            sample_offset_m: DVec3::from_array(rig.sample.offset_m),
        }
    }

    /// The same device before a mirror with this figure; no rig file has one.
    #[must_use]
    pub fn with_figure(self, figure: Option<Arc<dyn Figure>>) -> View {
        View {
            at_focus: self.at_focus && figure.is_none(),
            figure,
            ..self
        }
    }

    /// Unit normal of the mirror at `mirror_m`, inwards.
    fn normal(&self, mirror_m: DVec3) -> DVec3 {
        let normal = self.ellipsoid.normal(mirror_m);
        match &self.figure {
            None => normal,
            Some(figure) => {
                let slope = figure.slope(mirror_m).reject_from_normalized(normal);
                (normal - slope).normalize()
            }
        }
    }

    /// Size of the image in pixels (width, height).
    pub fn size_px(&self) -> (usize, usize) {
        (
            self.pinhole.width_px() as usize,
            self.pinhole.height_px() as usize,
        )
    }

    /// The device's projection.
    pub fn pinhole(&self) -> &Pinhole {
        &self.pinhole
    }

    /// The mirror.
    pub fn ellipsoid(&self) -> &Ellipsoid {
        &self.ellipsoid
    }

    /// How the sample stands in the mirror.
    pub fn frame(&self) -> &SampleFrame {
        &self.frame
    }

    /// Direction at the sample (sample frame, unit, away from the surface) that the position (`u_px`,
    /// `v_px`) of the image sees.
    ///
    /// # Errors
    /// The reason why it sees none.
    pub fn direction(&self, u_px: f64, v_px: f64) -> Result<DVec3, Unmeasurable> {
        self.trace(u_px, v_px).map(|trace| trace.direction)
    }

    /// As [`View::direction`], with the points where the ray meets mirror and sample plane.
    ///
    /// # Errors
    /// The reason why the ray does not reach the sample from above.
    pub fn trace(&self, u_px: f64, v_px: f64) -> Result<Trace, Unmeasurable> {
        let pixel = DVec2::new(u_px, v_px);
        if !self.pinhole.contains(pixel) {
            return Err(Unmeasurable::OutsideImage);
        }
        let reflection = self.reflect_pixel(pixel).ok_or(Unmeasurable::OutsideImage)?;
        self.admit(&reflection)?;
        self.reach_sample(&reflection)
    }

    /// Direction at the sample (sample frame, unit) of the ray of the position (`u_px`, `v_px`), whatever is in its way;
    /// `None` where there is no ray. Smooth across all edges.
    pub fn sight(&self, u_px: f64, v_px: f64) -> Option<DVec3> {
        self.reflect_pixel(DVec2::new(u_px, v_px))
            .map(|found| self.to_sample(found.direction))
    }

    /// How far the ray of the position (`u_px`, `v_px`) passes the edges of hole, rim and wire, seen from F1, radians;
    /// positive on the side that sees the sample. `None` where there is no ray or no such edge.
    pub fn edge_distances_rad(&self, u_px: f64, v_px: f64) -> [Option<f64>; 3] {
        self.reflect_pixel(DVec2::new(u_px, v_px))
            .map_or([None; 3], |found| self.edge_distances_of(&found))
    }

    /// Which edge of hole, rim, wire or obstacles the ray of the position (`u_px`, `v_px`) passes closer than `clearance_rad`
    /// radians, or is behind, if any.
    pub fn edge_within(&self, u_px: f64, v_px: f64, clearance_rad: f64) -> Option<Unmeasurable> {
        let found = self.reflect_pixel(DVec2::new(u_px, v_px))?;
        self.edge_within_of(&found, clearance_rad)
    }

    /// The same of a ray.
    pub(super) fn edge_within_of(&self, reflection: &Reflection, clearance_rad: f64) -> Option<Unmeasurable> {
        let reasons = [
            Unmeasurable::Hole,
            Unmeasurable::BeyondRim,
            Unmeasurable::Occluded,
        ];
        let mut edges = self.edge_distances_of(reflection).into_iter().zip(reasons);
        edges
            .find_map(|(rad, reason)| rad.is_some_and(|rad| rad < clearance_rad).then_some(reason))
            .or_else(|| {
                self.is_behind_obstacle(self.seen_from_f1(reflection), clearance_rad)
                    .then_some(Unmeasurable::Occluded)
            })
    }

    /// Whether the unit direction `from_f1` (mirror frame) is behind an obstacle, or closer to one than `clearance_rad` radians.
    pub(super) fn is_behind_obstacle(&self, from_f1: DVec3, clearance_rad: f64) -> bool {
        self.obstacles.iter().any(|outline| {
            outline
                .near_rad(from_f1, clearance_rad)
                .is_some_and(|rad| rad < clearance_rad)
        })
    }

    /// How far a ray passes the edges of hole, rim and wire, as [`View::edge_distances_rad`] says.
    fn edge_distances_of(&self, reflection: &Reflection) -> [Option<f64>; 3] {
        let from_f1 = reflection.mirror_m - self.ellipsoid.f1();
        let w = from_f1.normalize();
        [
            self.ellipsoid.hole_distance_rad(w),
            Some(self.ellipsoid.rim_distance_m(reflection.mirror_m) / from_f1.length()),
            self.wire.and_then(|wire| wire.distance_rad(w)),
        ]
    }

    /// Reflection of a position's ray at the whole ellipsoid, obstacles and image border ignored.
    pub(super) fn reflect_pixel(&self, pixel: DVec2) -> Option<Reflection> {
        self.reflect_ray(self.pinhole.ray(pixel)?)
    }

    /// Reflection of a ray of the device's frame at the whole ellipsoid.
    pub(super) fn reflect_ray(&self, ray: DVec3) -> Option<Reflection> {
        let along = (self.device_to_m * ray).normalize();
        let mirror_m = self.ellipsoid.exit_point(self.centre_m, along)?;
        let reflected = reflect(along, self.normal(mirror_m));
        Some(Reflection {
            mirror_m,
            direction: -reflected,
        })
    }

    /// The vector from the optical centre to `point_m` (mirror frame) in the device's frame.
    pub(super) fn ray_to(&self, point_m: DVec3) -> DVec3 {
        self.device_to_m.transpose() * (point_m - self.centre_m)
    }

    /// Whether every ray meets the sample at its centre: both are where they should be.
    pub(super) fn is_stigmatic(&self) -> bool {
        self.at_focus && self.sample_offset_m == DVec3::ZERO
    }

    /// The vector `w_m` of the mirror frame in the sample frame.
    pub(super) fn to_sample(&self, w_m: DVec3) -> DVec3 {
        self.frame.to_sample(w_m)
    }

    /// The unit direction from F1 to where the ray of the position (`u_px`, `v_px`) meets the mirror, mirror frame, whatever is in
    /// its way; `None` where there is no ray.
    pub fn from_f1(&self, u_px: f64, v_px: f64) -> Option<DVec3> {
        self.reflect_pixel(DVec2::new(u_px, v_px))
            .map(|found| self.seen_from_f1(&found))
    }

    /// The unit direction from F1 to where a ray meets the mirror, mirror frame.
    fn seen_from_f1(&self, reflection: &Reflection) -> DVec3 {
        (reflection.mirror_m - self.ellipsoid.f1()).normalize()
    }

    /// Checks horizon, hole, rim, wire and obstacles, in this order.
    pub(super) fn admit(&self, reflection: &Reflection) -> Result<(), Unmeasurable> {
        if !is_above_horizon(self.to_sample(reflection.direction)) {
            return Err(Unmeasurable::BelowHorizon);
        }
        let from_f1 = self.seen_from_f1(reflection);
        if self.ellipsoid.in_hole(from_f1) {
            return Err(Unmeasurable::Hole);
        }
        if self.ellipsoid.is_beyond_rim(reflection.mirror_m) {
            return Err(Unmeasurable::BeyondRim);
        }
        let is_hidden = self.wire.is_some_and(|wire| wire.hides(from_f1))
            || self.obstacles.iter().any(|outline| outline.hides(from_f1));
        if is_hidden {
            return Err(Unmeasurable::Occluded);
        }
        Ok(())
    }

    /// Follows a reflected ray to the sample.
    pub(super) fn reach_sample(&self, reflection: &Reflection) -> Result<Trace, Unmeasurable> {
        let trace = self.meet_plane(reflection)?;
        if trace.hit_m.length() <= self.sample_radius_m {
            Ok(trace)
        } else {
            Err(Unmeasurable::OffSample)
        }
    }

    /// Follows a reflected ray to the sample plane, however far out.
    pub(super) fn meet_plane(&self, reflection: &Reflection) -> Result<Trace, Unmeasurable> {
        let direction = self.to_sample(reflection.direction);
        let from_m = self.to_sample_place(reflection.mirror_m);
        let hit_m = if direction.z.abs() > HORIZON {
            from_m - from_m.z / direction.z * direction
        } else if from_m.z.abs() <= IN_PLANE_M {
            // The ray lies in the sample plane: it meets the sample where it passes the origin.
            from_m - from_m.dot(direction) * direction
        } else {
            return Err(Unmeasurable::OffSample);
        };
        Ok(Trace {
            direction,
            hit_m,
            mirror_m: reflection.mirror_m,
        })
    }

    /// The place `point_m` of the mirror frame in the sample frame, from the sample's centre, metres.
    pub(super) fn to_sample_place(&self, point_m: DVec3) -> DVec3 {
        self.to_sample(point_m - self.ellipsoid.f1() - self.sample_offset_m)
    }

    /// Where the ray that leaves the place `at_m` of the sample plane along `w` (sample frame, unit) crosses the plane of the
    /// device's pupil, from its middle along the device's x and y, metres; `None` where it does not.
    pub fn pupil_at(&self, at_m: DVec2, w: DVec3) -> Option<DVec2> {
        let from_m = self.frame.to_mirror(at_m.extend(0.0)) + self.ellipsoid.f1() + self.sample_offset_m;
        let along = self.frame.to_mirror(w);
        let mirror_m = self.ellipsoid.exit_point(from_m, along)?;
        let back = self.device_to_m.transpose() * reflect(along, self.normal(mirror_m));
        let start_m = self.ray_to(mirror_m);
        let steps = -start_m.z / back.z;
        (steps > 0.0 && steps.is_finite()).then(|| (start_m + steps * back).truncate())
    }
}

/// Whether a direction of the sample frame is above the surface or grazing.
pub(super) fn is_above_horizon(w: DVec3) -> bool {
    w.z >= -HORIZON
}
