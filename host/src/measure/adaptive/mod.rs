//! Adaptive measurement: starts coarse and captures next where the predicted error is largest.
//!
//! # Design
//! A closed loop in batches of [`BATCH`] captures through the same instrument as every measurement:
//! 1. Some tens of directions that are far apart come first, or those of any grid (`start`).
//! 2. Each captured image is predicted from its Delaunay neighbours as if it had not been captured (`predict`); the
//!    mean squared difference less the noise is the interpolation error there, at that spacing.
//! 3. Each triangle of captured directions inherits the errors of its corners, scaled to its own spacing; the triangles
//!    of the largest error × solid angle are captured next, at the centres of their empty circles (`choose`).
//! 4. The mean error over all triangles is the predicted PSNR. The loop ends at the target, at the budget, or where
//!    more captures cannot help: noise rules, or all spots of light would overlap.
//!
//! The error is that of f·cosθi in luminance at exposure 1, clipped to 1, mean over the pairs of directions within reach
//! and up to θ = 80°, as far as the camera sees them.
//!
//! The loop sees what assembly makes of its captures: brackets merged, calibration and tilt taken into account. What comes out is an ordinary measurement: its plan holds a list of directions, in the order of their capture, and
//! can be measured again. Until then `adaptive.toml`, `directions.txt` and `adaptive.zarr` (`journal`) hold what was
//! asked for and captured; a run that was killed goes on with the next batch.
//!
//! # Tradeoffs
//! Leaving a direction out doubles the spacing, and the error there is scaled back as if it fell with the spacing
//! squared. Sharper lobes fall faster, so that the predicted PSNR errs on the safe side for smooth samples.

mod choose;
mod journal;
mod predict;
mod run;
mod start;

pub use crate::measure::goal::{Adapted, Goal, GoalError, Stop};
pub use journal::AdaptiveError;
pub use run::{Begun, begun, check_same, measure};
pub use start::{at_most, in_batches};

/// Captures that are chosen at a time. They are one run of the controller and one segment of the raw frames, or several
/// where their frames are large.
pub const BATCH: usize = crate::plan::BLACK_EXPOSURES;

#[cfg(test)]
mod tests;
