//! Host of the RCG (Rapid Catadioptric Gonioreflectometer).
#![forbid(unsafe_code)]

pub mod device;
pub mod direction;
pub mod link;
