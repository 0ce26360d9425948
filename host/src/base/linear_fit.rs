//! Weighted linear least squares by the normal equations, row by row.

use nalgebra::{DMatrix, DVector};

/// Solves for rows (values, target, weight); also the inverse of the normal matrix, which is the covariance if the weights
/// are inverse variances. `None` if the rows do not determine the unknowns.
pub(crate) fn least_squares(
    unknowns: usize,
    rows: impl Iterator<Item = (Vec<f64>, f64, f64)>,
) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let mut normal = DMatrix::zeros(unknowns, unknowns);
    let mut right = DVector::zeros(unknowns);
    for (row, target, weight) in rows {
        let row = DVector::from_vec(row);
        normal.syger(weight, &row, &row, 1.0);
        right.axpy(weight * target, &row, 1.0);
    }
    normal.fill_upper_triangle_with_lower_triangle();
    let inverse = normal.cholesky()?.inverse();
    Some((&inverse * right, inverse))
}
