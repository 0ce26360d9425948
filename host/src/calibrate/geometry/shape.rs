//! What the shape of the mirror may make of the unknowns.
//!
//! # Design
//! A mirror that is no ellipsoid turns directions, and a fit puts some of that right by moving lenses: directions are right then, and where the
//! lenses are is not. How far, residuals do not show. So the mirror may have any smooth shape, heights that are products of Chebyshev's
//! polynomials across it, all with the same RMS slope, and each is asked what the fit makes of it: what it pulls at the unknowns, and what it
//! leaves of itself. What is left of the real mirror, beyond chance, then tells the slope, and with that the variance of the unknowns. A mirror
//! that seems perfect has the slope of a good one.

use std::sync::Arc;

use glam::DVec3;
use nalgebra::DMatrix;

use crate::instrument::optics::Figure;

/// Shapes up to this order: two waves from rim to rim.
const ORDER: u32 = 5;
/// RMS slope of good mirrors, radians: diamond-turned ones.
const GOOD_RAD: f64 = 5e-5;
/// Slope at which a shape is looked at, radians: directions are as good as linear in it.
pub(super) const STEP_RAD: f64 = 1e-5;

/// A shape: the product of Chebyshev's polynomials of two orders across the mirror.
#[derive(Debug)]
struct Product {
    /// Half of the mirror's width, metres.
    half_m: f64,
    orders: [u32; 2],
}

/// Chebyshev's polynomial of an order, and its derivative.
fn chebyshev(order: u32, x: f64) -> [f64; 2] {
    let (mut before, mut now) = ([1.0, 0.0], [x, 1.0]);
    if order == 0 {
        return before;
    }
    for _ in 1..order {
        let next = [
            2.0 * x * now[0] - before[0],
            2.0 * (now[0] + x * now[1]) - before[1],
        ];
        before = std::mem::replace(&mut now, next);
    }
    now
}

impl Figure for Product {
    fn slope(&self, mirror_m: DVec3) -> DVec3 {
        let [along_x, along_y] = self.orders;
        let x = chebyshev(along_x, mirror_m.x / self.half_m);
        let y = chebyshev(along_y, mirror_m.y / self.half_m);
        DVec3::new(x[1] * y[0], x[0] * y[1], 0.0) * STEP_RAD
    }
}

/// The shapes of a mirror that is so wide, with slopes of about [`STEP_RAD`].
pub(super) fn shapes(half_m: f64) -> Vec<Arc<dyn Figure>> {
    let orders = (0..=ORDER).flat_map(|x| (0..=ORDER - x).map(move |y| [x, y]));
    orders
        .filter(|orders| *orders != [0, 0])
        .map(|orders| Arc::new(Product { half_m, orders }) as Arc<dyn Figure>)
        .collect()
}

/// What the shape of the mirror makes of the unknowns.
pub(super) struct Shape {
    /// What each shape pulls at each unknown, [unknown, shape], per radian of RMS slope.
    pulls: DMatrix<f64>,
    /// RMS slope of each shape, radians.
    pub(super) slope_rad: f64,
}

impl Shape {
    /// Of the `rows` of residuals that each shape makes of an RMS slope of 1 rad, [row, shape], where the unknowns have this `jacobian` and, with
    /// what is stated of them, this `covariance`. Rows count as much as `weights`, of which those of matches come first, and of whose
    /// residuals (two rows each) the mean square is `left_rad2`, radians², beyond chance.
    pub(super) fn of(
        rows: &DMatrix<f64>,
        jacobian: &DMatrix<f64>,
        covariance: &DMatrix<f64>,
        weights: &[f64],
        left_rad2: f64,
    ) -> Self {
        let pulls = jacobian.tr_mul(rows);
        let left = rows - jacobian * (covariance * &pulls);
        let (mut sum, mut matches) = (0.0, 0.0);
        for (at, weight) in weights.iter().enumerate() {
            if *weight > 0.0 {
                sum += left.rows(2 * at, 2).norm_squared() / weight.powi(2);
                matches += 1.0;
            }
        }
        // Of all shapes together, each with a slope of 1 rad.
        let of_one = sum / f64::max(matches, 1.0);
        let good_rad = GOOD_RAD / (rows.ncols() as f64).sqrt();
        let seen_rad = (left_rad2 / of_one.max(f64::MIN_POSITIVE)).sqrt();
        Self {
            pulls,
            slope_rad: seen_rad.max(good_rad),
        }
    }

    /// What it adds to the `covariance` of the unknowns.
    pub(super) fn covariance(&self, covariance: &DMatrix<f64>) -> DMatrix<f64> {
        let moved = covariance * &self.pulls * self.slope_rad;
        &moved * moved.transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_are_derivatives_of_heights() {
        for order in 0..=ORDER {
            for x in [-0.9, -0.2, 0.4, 0.8] {
                let (height, step) = (|x: f64| chebyshev(order, x)[0], 1e-6);
                let slope = (height(x + step) - height(x - step)) / (2.0 * step);
                assert!((chebyshev(order, x)[1] - slope).abs() < 1e-7, "{order} {x}");
                assert!((height(x) - (f64::from(order) * x.acos()).cos()).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn what_is_left_of_a_shape_tells_how_far_it_moved_what_is_fitted() {
        // One unknown, which takes half of a shape's rows, two components of each of two matches.
        let jacobian = DMatrix::from_column_slice(4, 1, &[1.0, 1.0, 0.0, 0.0]);
        let rows = DMatrix::from_column_slice(4, 1, &[1.0, 1.0, 1.0, 1.0]);
        let covariance = DMatrix::from_element(1, 1, 0.5);
        let shape = Shape::of(&rows, &jacobian, &covariance, &[1.0, 1.0], 4e-6);
        // Of a slope of 1 rad a mean square of 1 is left; it moves the unknown by 1.
        assert!((shape.slope_rad - 2e-3).abs() < 1e-12);
        assert!((shape.covariance(&covariance)[(0, 0)] - 4e-6).abs() < 1e-12);
    }
}
