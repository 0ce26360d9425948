//! Host of the RCG (Rapid Catadioptric Gonioreflectometer).
//!
//! Measure on the virtual rig, read what came of it, look a pair of directions up:
//! ```
//! use rcg::{base::progress::Silent, brdf::Brdf, hemisphere::direction::from_degrees, hemisphere::incident::Grid};
//! use rcg::{instrument::rig::Rig, measure, plan::{Request, Virtual}, virtual_rig::setup::Setup};
//!
//! # let folder = tempfile::tempdir()?;
//! # let folder = folder.path();
//! // A pilot capture finds how long to expose.
//! let request = Request { grid: Grid::ThetaPhi { step_deg: 30.0 }, image_size: 16, ..Request::default() };
//! let setup = Setup::from(Virtual { sample: "ward:brass".to_owned(), ..Virtual::default() });
//! // `folder` is a path: new, or empty.
//! let (job, measurement) = measure::prepare(folder, &Rig::load("rcg-1-16bit")?, request, &setup, &Silent)?;
//! measure::capture(&measurement, &job, &Silent)?;
//! measure::assemble_measurement(&measurement, &Silent)?;
//!
//! let brdf = Brdf::open(&measurement.path("brdf.zarr"))?;
//! match brdf.values(&[(from_degrees(45.0, 0.0), from_degrees(45.0, 120.0))])?[0] {
//!     Ok([r, g, b]) => println!("f = {r} {g} {b} in 1/sr"),
//!     Err(reason) => println!("no value: {reason}"),
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//! [`measure::complete`] does what follows `prepare` in one go, and evaluates and reports too. Longer programs stand in
//! `host/examples/`.
//!
//! # Design
//! Rooms, each of which knows those above it in this table and no other (a test holds the imports to that):
//!
//! | room | holds |
//! |---|---|
//! | [`base`] | words, progress, formats of files by their names, linear fits, eight numbers computed at once |
//! | [`hemisphere`] | directions, grids of incident ones, the disk of outgoing ones, which are judged |
//! | [`store`] | Zarr arrays, frames and BRDFs on disk, provenance, files that are whole or not there |
//! | [`instrument`] | the rig, its optics, the shape of frames, what calibration found |
//! | [`brdf`] | what has values of f: known samples, measured tables, interpolation between directions |
//! | [`plan`] | what is captured and when: schedule, brackets, patterns, codes of light, stripes, time on the instrument |
//! | [`capture`] | trigger box, camera, projector, pairing, pilot captures, the measurement's directory |
//! | [`virtual_rig`] | the simulated side of box, camera and projector, and which instrument a run gets |
//! | [`judge`] | errors, fits, pictures, charts, scans, whole worlds drawn by chance |
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
