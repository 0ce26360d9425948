//! Weighted linear least squares by the normal equations, row by row.
//!
//! # Design
//! The normal matrix squares the condition of the problem, and with it the error by rounding. Its factor is good enough to
//! correct a solution by its own residuals, though, which are as exact as the rows are: iterative refinement (Higham,
//! *Accuracy and Stability of Numerical Algorithms*, 2002, ch. 20).

use nalgebra::{DMatrix, DVector};

/// Steps of refinement.
const REFINEMENTS: usize = 3;
/// Rows whose products are summed together, as a product of matrices.
const TOGETHER: usize = 128;

/// Solves for rows (values, target, weight); also the inverse of the normal matrix, which is the covariance if the weights
/// are inverse variances. `None` if the rows do not determine the unknowns.
pub(crate) fn least_squares(
    unknowns: usize,
    rows: &(impl Iterator<Item = (Vec<f64>, f64, f64)> + Clone),
) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let mut normal = DMatrix::zeros(unknowns, unknowns);
    let mut right = DVector::zeros(unknowns);
    // A row is a column here: so they lie one behind the other.
    let mut some = DMatrix::zeros(unknowns, TOGETHER);
    let mut weighted = DMatrix::zeros(unknowns, TOGETHER);
    let mut count = 0;
    let mut add = |some: &DMatrix<f64>, weighted: &DMatrix<f64>, count: usize| {
        let (some, weighted) = (some.columns(0, count), weighted.columns(0, count));
        normal.gemm(1.0, &weighted, &some.transpose(), 1.0);
    };
    for (row, target, weight) in rows.clone() {
        let row = DVector::from_vec(row);
        right.axpy(weight * target, &row, 1.0);
        weighted.set_column(count, &(weight * &row));
        some.set_column(count, &row);
        count += 1;
        if count == TOGETHER {
            add(&some, &weighted, count);
            count = 0;
        }
    }
    add(&some, &weighted, count);
    let inverse = normal.cholesky()?.inverse();
    let mut found = &inverse * right;
    for _ in 0..REFINEMENTS {
        let mut right = DVector::zeros(unknowns);
        for (row, target, weight) in rows.clone() {
            let row = DVector::from_vec(row);
            right.axpy(weight * (target - row.dot(&found)), &row, 1.0);
        }
        found += &inverse * right;
    }
    Some((found, inverse))
}
