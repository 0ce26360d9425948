//! What binds the chunks of one segment to each other and to their measurement.
//!
//! # Design
//! Every chunk's CRC-32C says that it is undamaged, not that it belongs here: a chunk of another segment, or of another
//! measurement of the same size, is just as undamaged. The *seal* of a segment is a digest of what the file is about (the
//! checksums of plan, rig and so on), of the segment's index and of the CRC-32C of all of its chunks. It is written last, and
//! its presence says that the segment is whole.

use std::sync::Arc;

use serde_json::json;
use sha2::{Digest as _, Sha256};

use super::array::{ArraySpec, ElementType, ZarrArray};
use super::atomic::AtomicStore;
use super::checksum::hex;
use super::described::described;
use super::error::StoreError;
use super::exposure_record::FILL_U64;
use super::header::Header;

/// Name of its array.
const SEAL: &str = "seal";

/// The seals of all segments.
#[derive(Debug)]
pub(super) struct Seals {
    array: ZarrArray,
    /// What the file is about.
    subject: String,
}

fn spec(segments: usize) -> ArraySpec<'static> {
    ArraySpec {
        name: SEAL,
        element: ElementType::U64,
        shape: vec![segments],
        chunk: 1,
        dims: &["segment"],
        packed: false,
    }
}

impl Seals {
    /// Makes the array for `segments` of a file about `subject`.
    pub(super) fn create(
        store: &Arc<AtomicStore>,
        segments: usize,
        subject: String,
    ) -> Result<Self, StoreError> {
        let mut about = described("1", "digest of the checksums of the segment's chunks");
        about.insert("_FillValue".into(), json!(FILL_U64));
        let array = ZarrArray::create(store, &spec(segments), about)?;
        Ok(Self { array, subject })
    }

    /// Opens the array.
    pub(super) fn open(
        store: &Arc<AtomicStore>,
        segments: usize,
        subject: String,
    ) -> Result<Self, StoreError> {
        let header = Header::read(store, SEAL, Some(1))?;
        let array = ZarrArray::open(store, &spec(segments), &header)?;
        Ok(Self { array, subject })
    }

    pub(super) fn array(&self) -> &ZarrArray {
        &self.array
    }

    /// Whether segment `index` has a seal.
    pub(super) fn is_present(&self, index: usize) -> bool {
        self.array.is_present(index)
    }

    /// SHA-256 of the seals of all `segments`, in their order, each as eight bytes with the least significant first: what binds all chunks.
    pub(super) fn sum(&self, segments: usize) -> Result<String, StoreError> {
        let mut digest = Sha256::new();
        for index in 0..segments {
            for seal in self.array.read_present::<u64>(index)? {
                digest.update(seal.to_le_bytes());
            }
        }
        Ok(hex(&digest.finalize()))
    }

    /// Removes the seal of segment `index`: it is not whole from now on.
    pub(super) fn erase(&self, index: usize) -> Result<(), StoreError> {
        self.array.erase(index)
    }

    /// Seals segment `index`, whose chunks are those of `parts`, one in each.
    pub(super) fn write<'a>(
        &self,
        index: usize,
        parts: impl Iterator<Item = &'a ZarrArray>,
    ) -> Result<(), StoreError> {
        let seal = self.of(index, parts)?;
        self.array.write(index, &[seal])
    }

    /// Checks the seal of segment `index`.
    ///
    /// # Errors
    /// [`StoreError::Chunk`] if it is not that of the chunks of `parts`.
    pub(super) fn check<'a>(
        &self,
        index: usize,
        parts: impl Iterator<Item = &'a ZarrArray>,
    ) -> Result<(), StoreError> {
        let found = self.array.read_present::<u64>(index)?;
        if found == [self.of(index, parts)?] {
            return Ok(());
        }
        Err(StoreError::Chunk {
            path: self.array.path_of(index),
            array: SEAL.to_owned(),
            chunk: index,
            expected: "the seal of the segment's chunks".to_owned(),
            found: "another: at least one of them belongs to another segment or another measurement"
                .to_owned(),
        })
    }

    fn of<'a>(&self, index: usize, parts: impl Iterator<Item = &'a ZarrArray>) -> Result<u64, StoreError> {
        let mut digest = Sha256::new();
        digest.update(self.subject.as_bytes());
        digest.update((index as u64).to_le_bytes());
        for part in parts {
            digest.update(part.stored_checksum(index)?);
        }
        let digest = digest.finalize();
        let (first, _) = digest.split_first_chunk::<8>().expect("invariant: 32 bytes");
        // Never the fill value.
        Ok(u64::from_le_bytes(*first) >> 1)
    }
}
