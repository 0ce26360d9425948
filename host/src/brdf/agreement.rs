//! Whether the arrays of a file agree with each other.
//!
//! # Design
//! Checked with every chunk that is read, so that whoever uses a file uses one that does not contradict itself: a value has
//! a known provenance, is finite and has a finite uncertainty of 0 or more; what is missing has neither; and there is
//! no value in a direction that, as the file says, cannot be had.

use super::Brdf;
use crate::provenance::Provenance;
use crate::store::{BrdfRows, StoreError};

/// Checks `rows`, which are those of chunk number `chunk`.
///
/// # Errors
/// [`StoreError::Chunk`] with the array and the sample.
pub(super) fn check(brdf: &Brdf, chunk: usize, rows: &BrdfRows) -> Result<(), StoreError> {
    let (cells, channels, first) = (brdf.disk.len(), brdf.channels(), brdf.chunk_range(chunk).start);
    for (sample, &code) in rows.provenance.iter().enumerate() {
        let values = sample * channels..(sample + 1) * channels;
        let (f, sigma) = (&rows.f[values.clone()], &rows.sigma[values]);
        let (index, cell) = (first + sample / cells, sample % cells);
        let complain = |array: &'static str, expected: &str, found: String| {
            let size = brdf.disk.size();
            Err(StoreError::Chunk {
                path: brdf.path.join(array),
                array: array.to_owned(),
                chunk,
                expected: expected.to_owned(),
                found: format!(
                    "{found} at incident direction {index}, row {}, column {}",
                    cell / size,
                    cell % size
                ),
            })
        };
        let Some(origin) = Provenance::from_code(code) else {
            return complain("provenance", "a known code", format!("code {code}"));
        };
        if origin == Provenance::Missing {
            if let Some(f) = f.iter().find(|f| !(f.is_nan() || **f == 0.0)) {
                return complain("f", "no value where the provenance is missing", f.to_string());
            }
            if let Some(sigma) = sigma
                .iter()
                .find(|sigma| !(sigma.is_nan() || sigma.to_f32() == 0.0))
            {
                let expected = "no uncertainty where the provenance is missing";
                return complain("sigma", expected, sigma.to_string());
            }
            continue;
        }
        let reason = brdf.incident[index].or(brdf.outgoing[cell]);
        if let Some(reason) = reason {
            let expected = format!("missing where the direction has the reason `{reason}`");
            return complain("provenance", &expected, format!("`{}`", origin.name()));
        }
        if let Some(f) = f.iter().find(|f| !f.is_finite()) {
            let expected = format!("a finite number where the provenance is {}", origin.name());
            return complain("f", &expected, f.to_string());
        }
        if let Some(sigma) = sigma
            .iter()
            .find(|sigma| !(sigma.is_finite() && sigma.to_f32() >= 0.0))
        {
            let expected = "a finite uncertainty of 0 or more where f has a value";
            return complain("sigma", expected, sigma.to_string());
        }
    }
    Ok(())
}
