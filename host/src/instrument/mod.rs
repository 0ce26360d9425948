//! The instrument: its description, its optics, the shape of its frames, and what calibration found of it.
//!
//! Arrows: `drivers`, `bands` ← `parts` ← `optics` ← `rig` ← `calibration`. `monitor` says which pixels of the projector watch its lamp.

pub mod bands;
pub mod calibration;
pub mod drivers;
pub mod frame_format;
pub mod monitor;
pub mod optics;
pub mod parts;
pub mod pixel_format;
pub mod rig;
