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

/// Some rows, each a column here, so that its values lie one behind the other.
struct Block {
    rows: DMatrix<f64>,
    targets: DVector<f64>,
    weights: DVector<f64>,
}

/// All `rows`, in blocks of [`TOGETHER`].
fn blocks(unknowns: usize, mut rows: impl Iterator<Item = (Vec<f64>, f64, f64)>) -> Vec<Block> {
    let mut blocks = Vec::new();
    loop {
        let (mut values, mut targets, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        for (row, target, weight) in rows.by_ref().take(TOGETHER) {
            values.extend(row);
            targets.push(target);
            weights.push(weight);
        }
        if targets.is_empty() {
            return blocks;
        }
        blocks.push(Block {
            rows: DMatrix::from_vec(unknowns, targets.len(), values),
            targets: DVector::from_vec(targets),
            weights: DVector::from_vec(weights),
        });
    }
}

/// Solves for rows (values, target, weight); also the inverse of the normal matrix, which is the covariance if the weights
/// are inverse variances. `None` if the rows do not determine the unknowns.
pub(crate) fn least_squares(
    unknowns: usize,
    rows: impl Iterator<Item = (Vec<f64>, f64, f64)>,
) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let blocks = blocks(unknowns, rows);
    let mut normal = DMatrix::zeros(unknowns, unknowns);
    for block in &blocks {
        let mut weighted = block.rows.clone();
        for (mut row, weight) in weighted.column_iter_mut().zip(block.weights.iter()) {
            row *= *weight;
        }
        normal.gemm(1.0, &weighted, &block.rows.transpose(), 1.0);
    }
    let inverse = normal.cholesky()?.inverse();
    let mut found = DVector::zeros(unknowns);
    for _ in 0..=REFINEMENTS {
        let mut right = DVector::zeros(unknowns);
        for block in &blocks {
            let mut left = block.targets.clone();
            left.gemv_tr(-1.0, &block.rows, &found, 1.0);
            left.component_mul_assign(&block.weights);
            right.gemv(1.0, &block.rows, &left, 1.0);
        }
        found += &inverse * right;
    }
    Some((found, inverse))
}
