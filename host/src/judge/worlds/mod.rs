//! Whole worlds by chance: a virtual rig, what is measured on it, and whether the result holds what is there.
//!
//! # Design
//! | file | holds |
//! |---|---|
//! | `draw` | how a rig and a measurement are drawn from a seed |
//! | `judgement` | a `brdf.zarr` against the sample in closed form, sample by sample |
//! | `outcome` | how a world ended |
//! | `summary` | what many worlds come to |
//!
//! A world is *right* if every stage answered and all samples hold the truth within what they state, *refused* if a stage said
//! in one sentence why it does not answer, *silent* if all answered and a result is wrong, *broken* if a stage ended without a
//! sentence. The last two are faults of the program. Drawing and judging stand here; who runs the stages is the caller's
//! choice, so that they can be run as a user would.

mod draw;
mod judgement;
mod outcome;
mod summary;
#[cfg(test)]
mod tests;

pub use draw::{DrawnRequest, DrawnRig, FLAWS, Flaw, Kind, Sizes};
pub use judgement::{Judgement, Origins, Scale, Worst, judge};
pub use outcome::{File, Outcome, World, build_of};
pub use summary::{Cause, Drawn, OfPreset, Summary};
