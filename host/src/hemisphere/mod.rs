//! Directions above the sample: angles, grids of incident ones, the disk of outgoing ones, and which are judged.

pub mod direction;
pub mod disk;
pub mod incident;
pub mod judged;
