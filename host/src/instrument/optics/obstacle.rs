//! Something dark in front of the mirror: a polygon of directions that it hides, seen from F1.
//!
//! # Design
//! Clamps, cables, a second wire and dust on the mirror hide directions of camera and projector alike, as the wire does. An
//! outline is a polygon on the sphere whose sides are parts of great circles; which side of it a direction is on is asked in the
//! gnomonic projection about its middle, where those are straight.

use glam::{DVec2, DVec3};

use crate::hemisphere::direction::from_degrees;
use crate::instrument::parts::Obstacle;

/// Farthest corner from the middle of an outline, degrees.
pub(crate) const WIDEST_DEG: f64 = 60.0;

/// The hidden directions, in the mirror frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Outline {
    /// Unit vectors.
    corners: Vec<DVec3>,
    middle: DVec3,
    /// Across the middle.
    axes: [DVec3; 2],
    /// The corners in the gnomonic projection about the middle.
    flat: Vec<DVec2>,
    /// Angle from the middle to the farthest corner, radians.
    reach_rad: f64,
}

impl Outline {
    /// The directions that an obstacle of a rig hides.
    pub fn of(obstacle: &Obstacle) -> Self {
        let corners: Vec<DVec3> = obstacle
            .outline_deg
            .iter()
            .map(|[polar_deg, azimuth_deg]| from_degrees(*polar_deg, *azimuth_deg))
            .collect();
        let middle = corners.iter().sum::<DVec3>().try_normalize().unwrap_or(DVec3::Z);
        let (e1, e2) = middle.any_orthonormal_pair();
        Self {
            flat: corners
                .iter()
                .map(|corner| DVec2::new(corner.dot(e1), corner.dot(e2)) / corner.dot(middle))
                .collect(),
            reach_rad: corners
                .iter()
                .map(|corner| corner.angle_between(middle))
                .fold(0.0, f64::max),
            corners,
            middle,
            axes: [e1, e2],
        }
    }

    /// Angle from the middle to the farthest corner, radians.
    pub(crate) fn reach_rad(&self) -> f64 {
        self.reach_rad
    }

    /// Whether it hides the unit direction `w_m` at F1 (mirror frame).
    pub fn hides(&self, w_m: DVec3) -> bool {
        let ahead = w_m.dot(self.middle);
        if ahead <= 0.0 || ahead.min(1.0).acos() > self.reach_rad {
            return false;
        }
        let at = DVec2::new(w_m.dot(self.axes[0]), w_m.dot(self.axes[1])) / ahead;
        let sides = self.flat.iter().zip(self.flat.iter().cycle().skip(1));
        let crossed = sides.filter(|(a, b)| {
            (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x)
        });
        crossed.count() % 2 == 1
    }

    /// Angle from the outline to the unit direction `w_m` at F1, radians, negative within it.
    pub fn distance_rad(&self, w_m: DVec3) -> f64 {
        let sides = self.corners.iter().zip(self.corners.iter().cycle().skip(1));
        let nearest_rad = sides
            .map(|(a, b)| from_side_rad(w_m, *a, *b))
            .fold(f64::INFINITY, f64::min);
        if self.hides(w_m) {
            -nearest_rad
        } else {
            nearest_rad
        }
    }

    /// As [`distance_rad`](Self::distance_rad), if that may be less than `within_rad`.
    pub(super) fn near_rad(&self, w_m: DVec3, within_rad: f64) -> Option<f64> {
        (w_m.angle_between(self.middle) < self.reach_rad + within_rad).then(|| self.distance_rad(w_m))
    }
}

/// Angle from `w` to the part of a great circle from `a` to `b`, radians.
fn from_side_rad(w: DVec3, a: DVec3, b: DVec3) -> f64 {
    let pole = a.cross(b);
    let is_beside = pole.cross(a).dot(w) >= 0.0 && b.cross(pole).dot(w) >= 0.0;
    match pole.try_normalize() {
        Some(pole) if is_beside => w.dot(pole).abs().min(1.0).asin(),
        _ => w.angle_between(a).min(w.angle_between(b)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_outline_hides_what_is_within_and_knows_how_far_off_it_is() {
        // A square of 10° about the horizon, and an L.
        let outline = |outline_deg: &[[f64; 2]]| {
            Outline::of(&Obstacle {
                name: "clamp".to_owned(),
                outline_deg: outline_deg.to_vec(),
            })
        };
        let square = outline(&[[85.0, 20.0], [85.0, 30.0], [95.0, 30.0], [95.0, 20.0]]);
        for (polar_deg, azimuth_deg, distance_deg) in [
            (90.0, 25.0, -5.0),
            (90.0, 22.0, -2.0),
            (90.0, 18.0, 2.0),
            (90.0, 36.0, 6.0),
            (90.0, 205.0, 170.0),
        ] {
            let w = from_degrees(polar_deg, azimuth_deg);
            let found = square.distance_rad(w).to_degrees();
            assert!(
                (found - distance_deg).abs() < 0.03 * distance_deg.abs(),
                "{found}"
            );
            assert_eq!(square.hides(w), distance_deg < 0.0, "{polar_deg} {azimuth_deg}");
            assert!(square.near_rad(w, 0.2).is_some() == (distance_deg < 12.0));
        }
        let l = outline(&[
            [40.0, 0.0],
            [40.0, 40.0],
            [45.0, 40.0],
            [45.0, 8.0],
            [70.0, 8.0],
            [70.0, 0.0],
        ]);
        for (polar_deg, azimuth_deg, hidden) in [
            (42.0, 35.0, true),
            (60.0, 4.0, true),
            (60.0, 25.0, false),
            (42.0, 45.0, false),
        ] {
            assert_eq!(
                l.hides(from_degrees(polar_deg, azimuth_deg)),
                hidden,
                "{polar_deg} {azimuth_deg}"
            );
        }
    }
}
