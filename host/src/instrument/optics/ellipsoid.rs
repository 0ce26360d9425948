//! The ellipsoidal mirror x²/a² + y²/a² + z²/b² = 1 with its foci F1 = (0, 0, +c) and F2 = (0, 0, −c).
//!
//! # Design
//! The formulas describe the whole ellipsoid; [`Ellipsoid::in_hole`] and [`Ellipsoid::is_beyond_rim`] say
//! which part of it is glass. So the map from pixel to direction is smooth across the edges of the mirror,
//! and pixels on an edge have proper derivatives and corners.

use glam::{DMat3, DVec3};

use crate::instrument::parts::Rig;

/// Rounding that still counts as "on the edge" of the hole, in the cosine.
const EDGE: f64 = 1e-12;

/// The mirror, in the mirror frame, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipsoid {
    /// Semi-axis across, metres.
    pub a_m: f64,
    /// Semi-axis along z, metres.
    pub b_m: f64,
    /// The mirror is the part z ≥ this, metres.
    pub rim_z_m: f64,
    /// Half angle of the hole seen from F1, radians; 0 = none.
    pub hole_rad: f64,
    /// Unit vector along the axis of the machined edges, hole and rim.
    pub edge_axis: DVec3,
}

impl Ellipsoid {
    /// The mirror of a rig.
    pub fn of(rig: &Rig) -> Ellipsoid {
        let mirror = &rig.mirror;
        let [x_rad, y_rad] = mirror.edge_rotation_deg.map(f64::to_radians);
        Ellipsoid {
            a_m: mirror.a_m,
            b_m: mirror.b_m,
            rim_z_m: mirror.rim_z_m,
            hole_rad: mirror.hole_deg.to_radians(),
            edge_axis: DMat3::from_rotation_x(x_rad) * (DMat3::from_rotation_y(y_rad) * DVec3::Z),
        }
    }

    /// Distance c = √(b² − a²) from the centre to a focus, metres.
    pub fn c_m(&self) -> f64 {
        ((self.b_m - self.a_m) * (self.b_m + self.a_m)).sqrt()
    }

    /// The focus with the sample, (0, 0, +c), metres.
    pub fn f1(&self) -> DVec3 {
        DVec3::new(0.0, 0.0, self.c_m())
    }

    /// The focus with camera and projector, (0, 0, −c), metres.
    pub fn f2(&self) -> DVec3 {
        DVec3::new(0.0, 0.0, -self.c_m())
    }

    /// Where the ray from F1 in the unit direction `w_m` (mirror frame) meets the ellipsoid, metres.
    ///
    /// `P = F1 + r₁ω` with `r₁ = a² / (b + c·ω_z)`, the polar equation of an ellipse about its focus.
    pub fn point_from_f1(&self, w_m: DVec3) -> DVec3 {
        let c_m = self.c_m();
        let r1_m = self.a_m * self.a_m / (self.b_m + c_m * w_m.z);
        DVec3::new(r1_m * w_m.x, r1_m * w_m.y, c_m + r1_m * w_m.z)
    }

    /// Where a ray from `origin_m` along `along` leaves the ellipsoid: the farther intersection, metres.
    ///
    /// Nothing when the ray does not meet the ellipsoid in front of its origin.
    pub fn exit_point(&self, origin_m: DVec3, along: DVec3) -> Option<DVec3> {
        // In units of the semi-axes the ellipsoid is the unit sphere: A t² + 2 B t + C = 0.
        let axes_m = DVec3::new(self.a_m, self.a_m, self.b_m);
        let (o, d) = (origin_m / axes_m, along / axes_m);
        let (qa, qb, qc) = (d.length_squared(), o.dot(d), o.length_squared() - 1.0);
        let root = (qb * qb - qa * qc).sqrt();
        // The form without cancellation for either sign of B.
        let t = if qb > 0.0 {
            -qc / (qb + root)
        } else {
            (root - qb) / qa
        };
        (t > 0.0 && t.is_finite()).then(|| origin_m + t * along)
    }

    /// Unit normal at `point_m` on the ellipsoid, pointing inwards.
    pub fn normal(&self, point_m: DVec3) -> DVec3 {
        let (aa, bb) = (self.a_m * self.a_m, self.b_m * self.b_m);
        -DVec3::new(point_m.x / aa, point_m.y / aa, point_m.z / bb).normalize()
    }

    /// Whether `point_m` lies inside the ellipsoid.
    pub fn contains(&self, point_m: DVec3) -> bool {
        (point_m / DVec3::new(self.a_m, self.a_m, self.b_m)).length_squared() < 1.0
    }

    /// Whether the unit direction `w_m` at F1 (mirror frame) goes through the hole, its edge included.
    pub fn in_hole(&self, w_m: DVec3) -> bool {
        self.hole_rad > 0.0 && w_m.dot(self.edge_axis) >= self.hole_rad.cos() - EDGE
    }

    /// Angle from the edge of the hole to the unit direction `w_m` at F1, outwards, radians; `None` without a hole.
    pub fn hole_distance_rad(&self, w_m: DVec3) -> Option<f64> {
        (self.hole_rad > 0.0).then(|| w_m.angle_between(self.edge_axis) - self.hole_rad)
    }

    /// Height of a point on the ellipsoid above the rim, metres.
    pub fn rim_distance_m(&self, point_m: DVec3) -> f64 {
        point_m.dot(self.edge_axis) - self.rim_z_m
    }

    /// Whether a point on the ellipsoid is below the rim.
    pub fn is_beyond_rim(&self, point_m: DVec3) -> bool {
        self.rim_distance_m(point_m) < 0.0
    }

    /// Angle ψ at F2 of the light that leaves F1 at `theta_rad` from the axis, radians.
    ///
    /// tan(ψ/2) = ((b−c)/(b+c)) · tan(θ/2).
    pub fn psi_rad(&self, theta_rad: f64) -> f64 {
        2.0 * (self.compression() * (theta_rad / 2.0).tan()).atan()
    }

    /// Angle θ at F1 of the light that arrives at F2 at `psi_rad` from the axis, radians; inverse of
    /// [`Ellipsoid::psi_rad`].
    pub fn theta_rad(&self, psi_rad: f64) -> f64 {
        2.0 * ((psi_rad / 2.0).tan() / self.compression()).atan()
    }

    /// (b−c)/(b+c), the ratio of tan(ψ/2) to tan(θ/2), written without the difference b−c.
    fn compression(&self) -> f64 {
        (self.a_m / (self.b_m + self.c_m())).powi(2)
    }
}

/// The direction `along` after reflection at a surface with the unit normal `normal`.
pub fn reflect(along: DVec3, normal: DVec3) -> DVec3 {
    along - 2.0 * along.dot(normal) * normal
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    use proptest::prelude::*;

    use super::*;
    use crate::hemisphere::direction::{angle_between, from_angles};

    fn mirrors() -> impl Strategy<Value = Ellipsoid> {
        (0.01..1.0_f64, 1.01..3.0_f64).prop_map(|(a_m, ratio)| Ellipsoid {
            a_m,
            b_m: a_m * ratio,
            rim_z_m: 0.0,
            hole_rad: 0.3,
            edge_axis: DVec3::Z,
        })
    }

    fn directions() -> impl Strategy<Value = DVec3> {
        (0.0..PI, 0.0..TAU).prop_map(|(theta_rad, phi_rad)| from_angles(theta_rad, phi_rad))
    }

    proptest! {
        #[test]
        fn the_path_from_focus_to_focus_is_2b(mirror in mirrors(), w in directions()) {
            let p = mirror.point_from_f1(w);
            let path_m = (p - mirror.f1()).length() + (p - mirror.f2()).length();
            prop_assert!((path_m - 2.0 * mirror.b_m).abs() < 1e-13 * mirror.b_m);
            prop_assert!(((p - mirror.f1()).normalize() - w).length() < 1e-12);
        }

        #[test]
        fn light_from_f1_is_reflected_to_f2(mirror in mirrors(), w in directions()) {
            let p = mirror.point_from_f1(w);
            let reflected = reflect(w, mirror.normal(p));
            prop_assert!(angle_between(reflected, (mirror.f2() - p).normalize()) < 1e-11);
        }

        #[test]
        fn a_ray_from_f1_leaves_where_the_polar_equation_says(mirror in mirrors(), w in directions()) {
            let p = mirror.exit_point(mirror.f1(), w).expect("F1 is inside");
            prop_assert!((p - mirror.point_from_f1(w)).length() < 1e-12 * mirror.b_m);
        }

        #[test]
        fn a_ray_from_outside_leaves_at_the_far_side(mirror in mirrors(), w in directions()) {
            let origin_m = -3.0 * mirror.b_m * w;
            let p = mirror.exit_point(origin_m, w).expect("it goes through the centre");
            prop_assert!(p.dot(w) > 0.0);
            prop_assert!(mirror.exit_point(origin_m, -w).is_none());
            let axes_m = DVec3::new(mirror.a_m, mirror.a_m, mirror.b_m);
            prop_assert!(((p / axes_m).length() - 1.0).abs() < 1e-12);
        }

        #[test]
        fn the_angle_at_f2_follows_the_on_axis_relation(
            mirror in mirrors(), theta_rad in 0.0..3.1_f64, phi_rad in 0.0..TAU,
        ) {
            let p = mirror.point_from_f1(from_angles(theta_rad, phi_rad));
            let at_f2 = p - mirror.f2();
            let psi_rad = at_f2.x.hypot(at_f2.y).atan2(at_f2.z);
            prop_assert!((psi_rad - mirror.psi_rad(theta_rad)).abs() < 1e-12);
            prop_assert!((mirror.theta_rad(mirror.psi_rad(theta_rad)) - theta_rad).abs() < 1e-12);
        }
    }

    #[test]
    fn a_ray_beside_the_ellipsoid_meets_nothing() {
        let mirror = Ellipsoid {
            a_m: 0.15,
            b_m: 0.25,
            rim_z_m: 0.0,
            hole_rad: 0.0,
            edge_axis: DVec3::Z,
        };
        assert_eq!(mirror.exit_point(DVec3::new(0.16, 0.0, -1.0), DVec3::Z), None);
        assert_eq!(mirror.exit_point(DVec3::NAN, DVec3::Z), None);
    }

    #[test]
    fn the_edge_of_the_hole_belongs_to_the_hole() {
        let mirror = Ellipsoid {
            a_m: 0.15,
            b_m: 0.25,
            rim_z_m: 0.0,
            hole_rad: 27_f64.to_radians(),
            edge_axis: DVec3::Z,
        };
        for phi_rad in (0..360).map(|deg| f64::from(deg).to_radians()) {
            assert!(mirror.in_hole(from_angles(mirror.hole_rad, phi_rad)));
            assert!(!mirror.in_hole(from_angles(mirror.hole_rad + 1e-9, phi_rad)));
        }
        let closed = Ellipsoid {
            hole_rad: 0.0,
            ..mirror
        };
        assert!(!closed.in_hole(DVec3::Z));
    }

    #[test]
    fn dimensions_of_the_first_rig() {
        let mirror = Ellipsoid {
            a_m: 0.15,
            b_m: 0.25,
            rim_z_m: 0.18,
            hole_rad: 0.0,
            edge_axis: DVec3::Z,
        };
        assert!((mirror.c_m() - 0.2).abs() < 1e-15);
        assert!((mirror.psi_rad(FRAC_PI_2).tan() - 0.225).abs() < 1e-14);
    }
}
