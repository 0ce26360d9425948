//! Stray light: glare, the ghost of the beam splitter, and direct light of the projector.
//!
//! # Design
//! `capture` takes the views, `fit` finds direct light in them, `lamp` what watches the lamp and `glare` the rest; what it is,
//! and how images lose it, stands in [`crate::instrument::calibration`].

mod capture;
mod fit;
mod glare;
mod lamp;

pub(super) use capture::{Part, RAW, SEGMENTS, StrayViews, mirror};
pub(super) use fit::stray;
