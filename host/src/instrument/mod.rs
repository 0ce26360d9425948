//! The instrument: its description, its optics, the shape of its frames, and what calibration found of it.
//!
//! Arrows: `parts` ← `optics` ← `rig` ← `calibration`.

pub mod calibration;
pub mod frame_format;
pub mod optics;
pub mod parts;
pub mod rig;
