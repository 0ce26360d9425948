//! Stray light: glare, the ghost of the beam splitter, and direct light of the projector.
//!
//! # Design
//! `capture` takes the views, `fit` finds what is in them; what it is, and how images lose it, stands in
//! [`crate::instrument::calibration`].

mod capture;
mod fit;

pub(super) use capture::StrayViews;
pub(super) use fit::stray;
