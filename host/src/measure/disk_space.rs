//! What a measurement takes on disk.

use std::collections::BTreeSet;

use serde::Serialize;

use crate::assemble::CHUNK;
use crate::instrument::rig::Rig;
use crate::plan::{Directions, Plan};

/// Bytes of a value of f, of its standard uncertainty, and of where both come from; and of a digital number.
const F: usize = 4;
const SIGMA: usize = 2;
const PROVENANCE: usize = 1;
const NUMBER: usize = 2;

/// Bytes that a measurement takes on disk at most; a few per cent more with coordinates, records and pictures. Values are compressed
/// ([`crate::store::brdf_file`]), which nobody knows the size of beforehand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct DiskSpace {
    /// Of `raw.zarr`.
    pub raw_bytes: usize,
    /// Of `brdf.zarr`.
    pub brdf_bytes: usize,
}

impl DiskSpace {
    /// Of `plan` for its `directions`, captured by `rig`. Files hold whole segments, and whole chunks where any direction is lit.
    #[must_use]
    pub fn of(plan: &Plan, directions: &Directions, rig: &Rig) -> Self {
        let format = rig.frame_format();
        let captured = plan.len().next_multiple_of(plan.segment.max(1));
        let chunks: BTreeSet<usize> = directions.measurable().map(|index| index / CHUNK).collect();
        let cells = plan.request.image_size.pow(2) as usize;
        let value = format.channels * (F + SIGMA) + PROVENANCE;
        Self {
            raw_bytes: captured * format.len() * NUMBER,
            brdf_bytes: chunks.len() * CHUNK * cells * value,
        }
    }
}
