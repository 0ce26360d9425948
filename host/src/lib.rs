//! Host of the RCG (Rapid Catadioptric Gonioreflectometer).
//!
//! # Design
//! The way through the crate is that of a measurement:
//!
//! | stage | modules |
//! |---|---|
//! | the instrument | [`rig`] (its description), [`optics`] (pixels ↔ directions), [`direction`] |
//! | what to measure | [`incident`] (directions of light), [`pattern`], [`schedule`], [`pilot`] (exposure time), [`brackets`] (several of them), [`plan`], [`pace`] (how long it takes) |
//! | the world | [`link`], [`device`] and [`run`] (trigger box), [`firing`] and [`records`] (by itself), [`camera`], [`projector`], or [`virtual_rig`] for all three |
//! | capture | [`setup`] (which instrument), [`capture`] (fire, collect, repeat), [`pairing`] (which frame belongs to which trigger) |
//! | files | [`store`] (Zarr), [`measurement`] (the directory and its stages), [`whole_file`] (whole or not there), [`file_format`], [`text`] |
//! | many directions at once | [`multiplex`] (codes, cells, demultiplexing) |
//! | the result | [`assemble`] (with the private `resample`), [`disk`] (outgoing directions), [`provenance`], [`brdf`] (look-up) |
//! | judgement | [`sample`] (known materials), [`reflectance`], [`evaluate`], [`fit`], [`render`], [`scan`], [`study`], [`chart`], [`report`], [`paper`] |
//!
//! [`measure`] does all of it in one go; [`adaptive`] chooses the directions on the way. From the raw frames on, every stage reads files only.
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
