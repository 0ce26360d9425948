//! Which captures stand behind a file, so that none counts twice.
//!
//! # Design
//! A capture is known by its content: the SHA-256 of every measured f and where it stands. A copy, a link or another name is
//! the same capture. One that was assembled again, with another calibration perhaps, has other values; it is known by the sum of its
//! frames, which stands in the lineage of the file. What is made of captures (`fill`) names them in its
//! attribute `captures`, so that it is no evidence beside them either.

use rayon::prelude::*;
use serde_json::Value;
use sha2::{Digest as _, Sha256};

use super::{Brdf, BrdfError, LINEAGE};
use crate::store::StoreError;
use crate::store::checksum::hex;
use crate::store::provenance::Provenance;

/// Attribute with the captures that a file was made of.
pub(crate) const CAPTURES: &str = "captures";
/// Name of a measurement's frames among the sums of a lineage.
pub(crate) const FRAMES: &str = "raw.zarr";

/// The captures behind `brdf`, as hexadecimal sums; none if nothing was measured.
///
/// # Errors
/// [`StoreError`].
pub(crate) fn captures(brdf: &Brdf) -> Result<Vec<String>, StoreError> {
    let named = brdf.attributes().get(CAPTURES).and_then(Value::as_array);
    if let Some(named) = named {
        return Ok(named
            .iter()
            .filter_map(|name| Some(name.as_str()?.to_owned()))
            .collect());
    }
    let channels = brdf.channels();
    let sums: Vec<Option<[u8; 32]>> = (0..brdf.chunks())
        .into_par_iter()
        .map(|chunk| {
            let Some(rows) = brdf.chunk(chunk)? else {
                return Ok(None);
            };
            let (mut sum, mut any) = (Sha256::new(), false);
            for (sample, code) in rows.provenance.iter().enumerate() {
                if Provenance::from_code(*code).is_some_and(Provenance::is_seen) {
                    any = true;
                    sum.update((sample as u64).to_le_bytes());
                    for f in &rows.f[sample * channels..(sample + 1) * channels] {
                        sum.update(f.to_le_bytes());
                    }
                }
            }
            Ok(any.then(|| sum.finalize().into()))
        })
        .collect::<Result<_, StoreError>>()?;
    if sums.iter().all(Option::is_none) {
        return Ok(Vec::new());
    }
    let mut all = Vec::new();
    if let Some(lineage) = brdf.attributes().get(LINEAGE) {
        frames(lineage, &mut all);
    }
    let mut sum = Sha256::new();
    for (chunk, part) in sums.iter().enumerate() {
        if let Some(part) = part {
            sum.update((chunk as u64).to_le_bytes());
            sum.update(part);
        }
    }
    all.push(hex(&sum.finalize()));
    Ok(all)
}

/// The captures behind all files, each of which may be there once: a second time it is no evidence.
///
/// # Errors
/// [`BrdfError`] if one stands behind two of them, or a file cannot be read.
pub(crate) fn captures_of(all: &[&Brdf]) -> Result<Vec<String>, BrdfError> {
    let mut found: Vec<Vec<String>> = Vec::new();
    for other in all {
        let own = captures(other)?;
        let twice = found
            .iter()
            .position(|before| own.iter().any(|one| before.contains(one)));
        if let Some(number) = twice {
            return Err(twice_in(all[number], other));
        }
        found.push(own);
    }
    Ok(found.concat())
}

/// Adds the sums of all frames that a `lineage` names, its own or those of what it was made of.
fn frames(lineage: &Value, all: &mut Vec<String>) {
    if let Some(sum) = lineage["sha256"][FRAMES].as_str() {
        all.push(format!("{FRAMES} {sum}"));
    }
    for input in lineage["inputs"].as_array().into_iter().flatten() {
        frames(&input[LINEAGE], all);
    }
}

/// Whether no capture stands behind both files.
///
/// # Errors
/// [`BrdfError`] if one does, or a file cannot be read.
pub(crate) fn check_apart(a: &Brdf, b: &Brdf) -> Result<(), BrdfError> {
    let (of_a, of_b) = (captures(a)?, captures(b)?);
    if of_a.iter().any(|capture| of_b.contains(capture)) {
        return Err(twice_in(a, b));
    }
    Ok(())
}

/// The complaint that `b` holds a capture that `a` holds.
fn twice_in(a: &Brdf, b: &Brdf) -> BrdfError {
    BrdfError::Content {
        path: b.path().display().to_string(),
        field: CAPTURES,
        expected: format!("another capture than {} holds", a.path().display()),
        found: "the same one, which is no evidence a second time".to_owned(),
    }
}
