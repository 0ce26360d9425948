//! Host of the RCG (Rapid Catadioptric Gonioreflectometer).
//!
//! # Design
//! Rooms, each of which knows those above it in this table and no other (a test holds the imports to that):
//!
//! | room | holds |
//! |---|---|
//! | [`base`] | words, progress, formats of files by their names, linear fits |
//! | [`hemisphere`] | directions, grids of incident ones, the disk of outgoing ones, which are judged |
//! | [`store`] | Zarr arrays, frames and BRDFs on disk, provenance, files that are whole or not there |
//! | [`instrument`] | the rig, its optics, the shape of frames, what calibration found |
//! | [`brdf`] | what has values of f: known samples, measured tables, interpolation between directions |
//! | [`plan`] | what is captured and when: schedule, brackets, patterns, stripes, time on the instrument |
//! | [`capture`] | trigger box, camera, projector, pairing, pilot captures, the measurement's directory |
//! | [`virtual_rig`] | the simulated side of box, camera and projector, and which instrument a run gets |
//! | [`judge`] | errors, fits, pictures, charts, scans |
//! | [`calibrate`] | how the instrument really is, found with targets in place of the sample |
//! | [`assemble`] | frames → BRDF with uncertainties, and what fills its gaps |
//! | [`measure`] | the job from end to end, directions chosen on the way, the report |
//! | [`study`] | sampling study, many directions at once, the figures of the paper |
//!
//! From the raw frames on, every stage reads files only.
//!
//! Directions are unit vectors away from the surface, f is in sr⁻¹ without the cosine, and names carry units.
//! Time, chance and progress are arguments: the crate has no clock, no random source and no voice of its own.

#![forbid(unsafe_code)]

pub mod assemble;
pub mod base;
pub mod brdf;
pub mod calibrate;
pub mod capture;
pub mod hemisphere;
pub mod instrument;
pub mod judge;
pub mod measure;
pub mod plan;
pub mod store;
pub mod study;
pub mod virtual_rig;
