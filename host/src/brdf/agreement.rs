//! Whether the values of a file agree with its reasons.
//!
//! # Design
//! Checked with every chunk that is read, so that whoever uses a file uses one that does not contradict itself: there is no
//! value in a direction that, as the file says, cannot be had. That f, sigma and provenance agree with each other
//! [`BrdfRows`] sees to when they are read.

use super::Brdf;
use crate::store::provenance::Provenance;
use crate::store::{BrdfRows, StoreError};

/// Checks `rows`, which are those of chunk number `chunk`.
///
/// # Errors
/// [`StoreError::Chunk`] with the sample.
pub(super) fn check(brdf: &Brdf, chunk: usize, rows: &BrdfRows) -> Result<(), StoreError> {
    let (cells, size, first) = (brdf.disk.len(), brdf.disk.size(), brdf.chunk_range(chunk).start);
    for (index, codes) in (first..).zip(rows.provenance.chunks(cells)) {
        let incident = brdf.incident[index];
        for (cell, (&code, outgoing)) in codes.iter().zip(&brdf.outgoing).enumerate() {
            if code == Provenance::Missing.code() {
                continue;
            }
            let Some(reason) = incident.or(*outgoing) else {
                continue;
            };
            let found = Provenance::from_code(code)
                .map_or_else(|| code.to_string(), |origin| origin.name().to_owned());
            return Err(StoreError::Chunk {
                path: brdf.path.join("provenance"),
                array: "provenance".to_owned(),
                chunk,
                expected: format!("missing where the direction has the reason `{reason}`"),
                found: format!(
                    "`{found}` at incident direction {index}, row {}, column {}",
                    cell / size,
                    cell % size
                ),
            });
        }
    }
    Ok(())
}
