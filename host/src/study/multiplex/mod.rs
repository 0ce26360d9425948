//! Multiplexed illumination: many incident directions are lit at once, and computed apart afterwards.
//!
//! # Design
//! The directions of a measurement are split into *blocks*. The directions of a block, its *cells*, are lit together
//! in as many combinations as the [`Code`] has exposures; [`demultiplex()`] turns these exposures into the frames that
//! each cell would have given alone. Light adds up, so nothing but the noise differs:
//!
//! - read noise is shared by all cells that are lit: its variance falls to 4n/(n+1)², about 4/n;
//! - photon noise is not: every value carries that of all cells, 2Σx/(n+1), about twice their mean.
//!
//! So multiplexing gains where read noise rules and *loses* where photons do: a factor √2 for a flat sample, and far
//! more where the signal is below the mean, as in the tails of a glossy sample.
//!
//! - [`code`]: which cells are lit in which exposure, and the variance that follows
//! - [`demultiplex`](mod@demultiplex): the fast transform
//! - [`cells`]: blocks of cells that share no projector pixel
//! - [`choose`](mod@choose): whether it is worth it, from a pilot capture

pub mod choose;
mod pilot;
#[cfg(test)]
mod tests;

pub use crate::plan::light::{Blocks, CellError, Code, CodeError, cells, code, demultiplex};
pub use choose::{Choice, MultiplexError, choose};
