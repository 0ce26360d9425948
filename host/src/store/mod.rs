//! The files of a measurement: `raw.zarr` (what the camera saw) and `brdf.zarr` (what follows from it).
//!
//! # Design
//! Both are Zarr v3 groups that xarray opens as they are: every array has dimension names, `units`
//! and `long_name`. A chunk spans all axes but the first and carries a CRC-32C, so a chunk
//! is one or more whole exposures or incident directions, and damage is found when it is read.
//!
//! | file | what |
//! |---|---|
//! | [`atomic`] | a file under its real name is always whole |
//! | [`raw`] | append-only frames and their records, by segments; survives `kill -9` |
//! | [`exposure_record`] | the columns that stand beside each raw frame |
//! | [`brdf_file`] | f, its standard uncertainty and its provenance |
//! | [`tally`] | what happened on the way, by segments |
//! | [`lock`] | one writer at a time |
//! | [`brdf_rows`] | the three together, and NaN where there is no value |
//! | [`small_array`] | coordinates and masks beside them |
//! | [`provenance`] | where a value comes from |
//! | `checksum` | SHA-256 of contents |
//! | [`whole_file`] | any other file, whole or not there |
//!
//! # Tradeoffs
//! Frames are not compressed. zstd at level 1 takes 12-bit frames with shot noise to 75 %: the four unused
//! bits, for a third of the speed. Chunks without compression have a known length, so a torn file is
//! told from a damaged one. Values are ([`brdf_file`]): rounded to what their uncertainty justifies, they take a fifth, and each is read more
//! often than written.

mod array;
pub mod atomic;
pub mod brdf_file;
pub mod brdf_rows;
pub mod checksum;
mod chunk;
mod described;
mod error;
pub mod exposure_record;
mod group;
mod header;
pub mod lock;
pub mod provenance;
pub mod raw;
mod seal;
pub mod small_array;
pub mod tally;
pub mod whole_file;

pub use atomic::AtomicStore;
pub use brdf_file::{BrdfLayout, BrdfReader, BrdfWriter, ROUNDED};
pub use brdf_rows::{BrdfRows, ROUNDING};
pub(crate) use brdf_rows::{LEAST_SIGMA, USELESS_SIGMA, stored_sigma};
pub use error::StoreError;
pub use exposure_record::ExposureRecord;
pub(crate) use group::with_suffix;
pub use lock::Lock;
pub use raw::{RawLayout, RawStore, Segment, SegmentWriter};
pub use small_array::{SmallArray, SmallData};
pub use tally::{OrphanFrame, Tally};
