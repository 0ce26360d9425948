//! How wide a lobe is along its axes, and where those lie.
//!
//! # Design
//! A fit has the three unknowns m, u and v, where the lobe's roughness along its axes is αx = exp(m + a) and αy = exp(m − a), and
//! (u, v) = a·(cos 2φ, sin 2φ), with the azimuth φ of the first axis. Nothing is singular there where a lobe is as wide both ways, and none
//! of the two axes comes first; φ within 45° of the frame's x is a choice.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DMat3, DVec3};
use nalgebra::DMatrix;

/// Number of its unknowns.
pub(super) const SHAPE: usize = 3;

/// Roughness along two axes, and the azimuth of the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Shape {
    /// Along the first and the second axis.
    pub(crate) alpha: [f64; 2],
    /// Of the first axis from the frame's x towards its y, radians.
    pub(crate) azimuth_rad: f64,
}

impl Shape {
    /// That of a fit's unknowns, with an azimuth from −45° to 45°.
    pub(super) fn of_unknowns([mean, u, v]: [f64; SHAPE]) -> Self {
        let (mut half, mut twice_rad) = (u.hypot(v), v.atan2(u));
        if twice_rad.abs() > FRAC_PI_2 {
            half = -half;
            twice_rad -= PI.copysign(twice_rad);
        }
        Self {
            alpha: [(mean + half).exp(), (mean - half).exp()],
            azimuth_rad: 0.5 * twice_rad,
        }
    }

    /// Those of the unknowns that stand for it.
    pub(super) fn unknowns(self) -> [f64; SHAPE] {
        let [x, y] = self.alpha.map(f64::ln);
        let (half, (sin, cos)) = (0.5 * (x - y), (2.0 * self.azimuth_rad).sin_cos());
        [0.5 * (x + y), half * cos, half * sin]
    }

    /// The same along the frame's axes, as far as it has a width there.
    pub(super) fn along_frame([mean, u, _]: [f64; SHAPE]) -> Self {
        Self::of_unknowns([mean, u, 0.0])
    }

    /// Derivatives of αx, αy and the azimuth in degrees (rows) by m, u and v (columns); without azimuth those of
    /// [`along_frame`](Self::along_frame).
    pub(super) fn derivatives([mean, u, v]: [f64; SHAPE], has_azimuth: bool) -> DMatrix<f64> {
        let [x, y] = if has_azimuth {
            Self::of_unknowns([mean, u, v])
        } else {
            Self::along_frame([mean, u, v])
        }
        .alpha;
        if !has_azimuth {
            return DMatrix::from_row_slice(2, SHAPE, &[x, x, 0.0, y, -y, 0.0]);
        }
        let half = u.hypot(v).copysign(u);
        let [by_u, by_v] = [u / half, v / half];
        let turn = 0.5_f64.to_degrees() / (half * half);
        DMatrix::from_row_slice(
            3,
            SHAPE,
            &[
                x,
                x * by_u,
                x * by_v,
                y,
                -y * by_u,
                -y * by_v,
                0.0,
                -v * turn,
                u * turn,
            ],
        )
    }

    /// By how much the azimuth is off, degrees, where half of the share `left` is left of the roughness along the diagonals.
    pub(super) fn azimuth_left_deg(self, left: f64) -> f64 {
        let half = 0.5 * (self.alpha[0] / self.alpha[1]).ln().abs();
        (0.25 * left / half).to_degrees()
    }

    /// Directions as the lobe's own axes see them.
    pub(super) fn along_axes(self, four: &[DVec3; 4]) -> [DVec3; 4] {
        let to_own = DMat3::from_rotation_z(-self.azimuth_rad);
        four.map(|w| to_own * w)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknowns_stand_for_the_same_lobe_and_their_derivatives_are_its() {
        for (alpha, azimuth_deg) in [([0.05, 0.16], 30.0), ([0.3, 0.1], -44.0), ([0.2, 0.21], 10.0)] {
            let shape = Shape {
                alpha,
                azimuth_rad: f64::to_radians(azimuth_deg),
            };
            let unknowns = shape.unknowns();
            let numbers = |unknowns| {
                let Shape { alpha, azimuth_rad } = Shape::of_unknowns(unknowns);
                [alpha[0], alpha[1], azimuth_rad.to_degrees()]
            };
            for (found, truth) in numbers(unknowns)
                .into_iter()
                .zip([alpha[0], alpha[1], azimuth_deg])
            {
                assert!((found - truth).abs() < 1e-9, "{found} {truth}");
            }
            let derivatives = Shape::derivatives(unknowns, true);
            for column in 0..SHAPE {
                let moved = |by: f64| {
                    let mut unknowns = unknowns;
                    unknowns[column] += by;
                    numbers(unknowns)
                };
                let (up, down) = (moved(1e-6), moved(-1e-6));
                for row in 0..3 {
                    let rise = (up[row] - down[row]) / 2e-6;
                    let expected = derivatives[(row, column)];
                    assert!(
                        (rise - expected).abs() < 1e-5 * (1.0 + expected.abs()),
                        "{rise} {expected}"
                    );
                }
            }
            // The axes exchanged, a quarter of a turn away, are the same.
            let same = Shape {
                alpha: [alpha[1], alpha[0]],
                azimuth_rad: shape.azimuth_rad + FRAC_PI_2,
            };
            for (one, other) in same.unknowns().into_iter().zip(unknowns) {
                assert!((one - other).abs() < 1e-12);
            }
        }
    }
}
