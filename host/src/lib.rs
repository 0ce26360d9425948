//! Host of the RCG (Rapid Catadioptric Gonioreflectometer).
#![forbid(unsafe_code)]

pub mod assemble;
pub mod brdf;
pub mod camera;
pub mod capture;
pub mod device;
pub mod direction;
pub mod disk;
pub mod evaluate;
pub mod incident;
pub mod link;
pub mod measure;
pub mod measurement;
pub mod optics;
pub mod pairing;
pub mod pattern;
pub mod plan;
pub mod progress;
pub mod projector;
pub mod provenance;
pub mod reflectance;
pub mod render;
pub mod report;
pub mod rig;
pub mod sample;
pub mod schedule;
pub mod store;
pub mod virtual_rig;
