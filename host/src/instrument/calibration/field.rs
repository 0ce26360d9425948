//! Smooth fields over an image: products of Legendre polynomials in the logarithm.
//!
//! # Design
//! Light and throughput are smooth and positive. ln F(x, y) = Σ c_ij P_i(x) P_j(y) over i + j ≤ the degree, x and y −1 to 1
//! over the image; the constant is not among them, because it belongs to the scale of the whole instrument. Legendre's
//! polynomials keep the fit well conditioned.
//!
//! What a series that ends misses is told by its last step: a fit with one degree less differs by it. Where the standard was
//! seen all around that is little; beyond, where the series is continued, it soon is not.

use serde::{Deserialize, Serialize};

use crate::instrument::frame_format::place_of_pixel;

/// Largest sum of the degrees in x and y.
pub(crate) const DEGREE: usize = 9;
/// Coefficients of a field.
pub(crate) const TERMS: usize = (DEGREE + 1) * (DEGREE + 2) / 2 - 1;

/// A field relative to the middle of its logarithm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SmoothField {
    /// c_ij in the order of i + j, then of i.
    coefficients: Vec<f64>,
    /// Mean of the terms over the pairs that determined them. About it the field is not correlated with the scale of the
    /// whole, nor with the other field.
    centre: Vec<f64>,
    /// Covariance of the coefficients by noise, [row, column]: large for what the standard did not show.
    covariance: Vec<Vec<f64>>,
    /// Coefficients less those of a fit with one degree less.
    last_step: Vec<f64>,
}

impl SmoothField {
    pub(crate) fn new(
        coefficients: Vec<f64>,
        centre: Vec<f64>,
        covariance: Vec<Vec<f64>>,
        last_step: Vec<f64>,
    ) -> Self {
        Self {
            coefficients,
            centre,
            covariance,
            last_step,
        }
    }

    /// Whether it has as many coefficients as it should.
    pub(crate) fn is_whole(&self) -> bool {
        let is_row = |row: &[f64]| row.len() == TERMS && row.iter().all(|c| c.is_finite());
        is_row(&self.coefficients)
            && is_row(&self.centre)
            && is_row(&self.last_step)
            && self.covariance.len() == TERMS
            && self.covariance.iter().all(|row| is_row(row))
    }

    /// The field at (`x`, `y`), −1 to 1 over the image.
    #[must_use]
    pub fn at(&self, x: f64, y: f64) -> f64 {
        dot(&self.coefficients, &terms(x, y)).exp()
    }

    /// Relative standard uncertainty (k = 1) of the field at (`x`, `y`), −1 to 1 over the image, by noise and by the end of the
    /// series, against its mean over what was seen.
    #[must_use]
    pub fn relative_uncertainty_at(&self, x: f64, y: f64) -> f64 {
        let mut terms = terms(x, y);
        for (term, centre) in terms.iter_mut().zip(&self.centre) {
            *term -= centre;
        }
        let rows = self.covariance.iter().map(|row| dot(row, &terms));
        let variance: f64 = rows.zip(terms).map(|(row, term)| row * term).sum();
        variance.max(0.0).sqrt().hypot(dot(&self.last_step, &terms))
    }

    /// The field at every pixel centre of an image, row by row.
    #[must_use]
    pub fn over(&self, width_px: usize, height_px: usize) -> Vec<f64> {
        (0..width_px * height_px)
            .map(|index| {
                let [x, y] = place_of_pixel(index, width_px, height_px);
                self.at(x, y)
            })
            .collect()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Of the highest degree, the places among the coefficients.
pub(crate) const HIGHEST: std::ops::Range<usize> = TERMS - DEGREE - 1..TERMS;

/// i + j of the coefficient at `place`.
pub(crate) fn degree(place: usize) -> usize {
    let last = |degree: usize| (degree + 1) * (degree + 2) / 2 - 1;
    (1..=DEGREE)
        .find(|degree| place < last(*degree))
        .unwrap_or(DEGREE)
}

/// All P_i(x)·P_j(y) but the constant, in the order of the coefficients.
pub(crate) fn terms(x: f64, y: f64) -> [f64; TERMS] {
    let all = products::<{ DEGREE + 1 }, { TERMS + 1 }>(x, y);
    std::array::from_fn(|term| all[term + 1])
}

/// P_i(x)·P_j(y) for i + j below `ORDERS`, in the order of i + j, then of i.
pub(super) fn products<const ORDERS: usize, const TERMS: usize>(x: f64, y: f64) -> [f64; TERMS] {
    let (px, py) = (legendre::<ORDERS>(x), legendre::<ORDERS>(y));
    let mut terms = [0.0; TERMS];
    let mut at = 0;
    for degree in 0..ORDERS {
        for i in 0..=degree {
            terms[at] = px[i] * py[degree - i];
            at += 1;
        }
    }
    terms
}

/// P_0 to the highest of so many `ORDERS`, two at least, at `x`, by Bonnet's recursion.
pub(super) fn legendre<const ORDERS: usize>(x: f64) -> [f64; ORDERS] {
    let mut p = [1.0; ORDERS];
    p[1] = x;
    for n in 1..ORDERS - 1 {
        let k = n as f64;
        p[n + 1] = ((2.0 * k + 1.0) * x * p[n] - k * p[n - 1]) / (k + 1.0);
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn legendre_polynomials_are_those_of_the_textbook() {
        let x = 0.3_f64;
        let p = legendre::<{ DEGREE + 1 }>(x);
        assert!((p[2] - (3.0 * x * x - 1.0) / 2.0).abs() < 1e-15);
        assert!((p[3] - (5.0 * x.powi(3) - 3.0 * x) / 2.0).abs() < 1e-15);
        assert!(
            legendre::<{ DEGREE + 1 }>(1.0)
                .iter()
                .all(|p| (p - 1.0).abs() < 1e-12)
        );
    }

    #[test]
    fn a_field_of_one_term_is_that_term() {
        let mut coefficients = vec![0.0; TERMS];
        coefficients[1] = 0.2; // i = 1, j = 0
        let mut covariance = vec![vec![0.0; TERMS]; TERMS];
        covariance[1][1] = 0.01_f64.powi(2);
        let mut centre = vec![0.0; TERMS];
        centre[1] = 0.2;
        let field = SmoothField::new(coefficients, centre, covariance, vec![0.0; TERMS]);
        assert!((field.at(0.5, -0.7) - (0.2_f64 * 0.5).exp()).abs() < 1e-15);
        assert!((field.relative_uncertainty_at(0.5, -0.7) - 0.01 * 0.3).abs() < 1e-15);
        assert!(field.is_whole());
        let over = field.over(4, 2);
        assert!((over[0] - (0.2_f64 * -0.75).exp()).abs() < 1e-15 && over.len() == 8);
    }
}
