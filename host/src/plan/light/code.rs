//! S-matrix codes: which cells are lit in which exposure.
//!
//! # Design
//! An S-matrix of order n is an n×n matrix of 0 and 1 with (n+1)/2 ones in every row and column, of which two columns
//! share (n+1)/4 (Harwit and Sloane, *Hadamard Transform Optics*, 1979). Exposure i lights cell j where S_ij = 1. With H the
//! Sylvester–Hadamard matrix of order N = n + 1 = 2^k and G that matrix without its first row and column,
//!
//! S = (J − G)/2, S⁻¹ = 2/(n+1)·(2Sᵀ − J) = −2/N · G,   H_ij = (−1)^popcount(i & j).
//!
//! **Variance.** All entries of S⁻¹ are ±2/(n+1). Exposure i holds y_i = Σ_j S_ij x_j electrons and has the variance
//! σ² + y_i, independent of the others; therefore *every* cell of the block has the variance
//!
//! 4/(n+1)² · Σ_i (σ² + y_i) = 4nσ²/(n+1)² + 2Σ_j x_j/(n+1),
//!
//! since Σ_i y_i = (n+1)/2 · Σ_j x_j: a column has (n+1)/2 ones.
//!
//! **Padding.** A block of m < n cells leaves n − m columns unused: these cells hold x_j = 0. Nothing above asks for more,
//! so the variance is the same expression with Σ over the m cells that exist, and n the order of the code.
//!
//! # Tradeoffs
//! Only orders 2^k − 1. Orders between exist (quadratic residues give every prime p ≡ 3 mod 4, 251 among them), but
//! their transform is a convolution of prime length, a dozen times dearer than the one here. 251 cells in a code of order 255 cost 1.6 %
//! more exposures and, at the same signal, have 1.6 % less variance: nothing is lost. Just above a power of two padding
//! costs up to twice the exposures; blocks are therefore made to fit the codes, and not the other way round.

/// Most cells of a block: beyond it, the exposures of one block fill gigabytes.
pub const MAX_CELLS: usize = 4095;

/// A code of order 2^k − 1 for a block of cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Code {
    order: usize,
    cells: usize,
}

/// A block that has no code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("order: expected a number of cells from 1 to {MAX_CELLS}, found {cells}")]
pub struct CodeError {
    /// What was asked for.
    pub cells: usize,
}

impl Code {
    /// The smallest code for a block of `cells` cells.
    ///
    /// # Errors
    /// [`CodeError`] for 0 cells or more than [`MAX_CELLS`].
    pub const fn for_cells(cells: usize) -> Result<Self, CodeError> {
        if cells == 0 || cells > MAX_CELLS {
            return Err(CodeError { cells });
        }
        let order = (cells + 1).next_power_of_two() - 1;
        Ok(Self { order, cells })
    }

    /// Order n of the S-matrix: the number of exposures. 1 is a single exposure of a single cell.
    #[must_use]
    pub const fn order(self) -> usize {
        self.order
    }

    /// Cells that are used, at most the order.
    #[must_use]
    pub const fn cells(self) -> usize {
        self.cells
    }

    /// Whether `exposure` lights `cell`: the entry S_ij. Both count from 0.
    #[must_use]
    pub const fn lights(self, exposure: usize, cell: usize) -> bool {
        ((exposure + 1) & (cell + 1)).count_ones() % 2 == 1
    }

    /// Variance of the value of any cell whose exposures sum to `sum`; each exposure alone has the variance
    /// `read_variance` + `shot`·signal. In electrons `shot` is 1, in digital numbers 1/gain.
    #[must_use]
    pub fn variance(self, sum: f64, read_variance: f64, shot: f64) -> f64 {
        let n = self.order as f64;
        4.0 / (n + 1.0).powi(2) * (n * read_variance + shot * sum)
    }

    /// The same from the cells: `total` is Σ x over the cells of the block, each as it would be alone.
    #[must_use]
    pub fn variance_of_cells(self, total: f64, read_variance: f64, shot: f64) -> f64 {
        self.variance(total * (self.order as f64 + 1.0) / 2.0, read_variance, shot)
    }
}
