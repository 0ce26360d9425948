//! One array of a file: chunks along the first axis only, each with a CRC-32C.
//!
//! # Design
//! Chunks are named `c.<index>.0…` in the array's own folder: no folder per chunk, one file creation
//! per write. A plain chunk's length is known beforehand; a torn file is refused by its length before it
//! is read. Those of a packed array are compressed by zstd, which any reader of Zarr has, before the checksum; a torn one fails that,
//! and none is unpacked into more bytes than a chunk has.
//!
//! No data never equals a legal value: floating-point arrays have NaN as their fill value, which is what a chunk that was
//! never written reads as, and what a partial chunk is padded with.
//!
//! zarrs is told to use one thread per chunk: callers write and read several chunks at a time.

use std::borrow::Cow;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytemuck::Pod;
use serde_json::{Map, Value};
use zarrs::array::codec::{BytesCodec, Crc32cCodec, ZstdCodec};
use zarrs::array::{
    Array, ArrayBuilder, ArrayBytes, ArrayMetadataOptions, BytesToBytesCodecTraits, ChunkKeySeparator,
    CodecOptions, ElementOwned,
};
use zarrs::metadata::FillValueMetadata;
use zarrs::storage::{ReadableStorageTraits as _, StoreKey};

use super::atomic::{AtomicStore, Unfinished};
use super::error::StoreError;
use super::group::metadata_key;
use super::header::Header;
use crate::base::text::{by, listed};

/// Bytes of the largest chunk that is accepted; more is a mistake in the layout or in a file.
const LARGEST_CHUNK: usize = 1 << 32;
/// Bytes of the CRC-32C at the end of a chunk.
const CHECKSUM: usize = 4;

/// Level of zstd: higher ones take several times as long for a few per cent of the bytes.
const ZSTD_LEVEL: i32 = 1;

/// Type of an array's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ElementType {
    U8,
    U16,
    U64,
    I64,
    F16,
    F32,
    F64,
}

impl ElementType {
    /// The name in `zarr.json`.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::U8 => "uint8",
            Self::U16 => "uint16",
            Self::U64 => "uint64",
            Self::I64 => "int64",
            Self::F16 => "float16",
            Self::F32 => "float32",
            Self::F64 => "float64",
        }
    }

    /// What stands for no data, as in `zarr.json`: the array's attribute `_FillValue` if it has one, else NaN, or 0 among
    /// integers, which are codes and counts: 0 has to mean nothing there.
    fn no_data(self, attributes: &Map<String, Value>) -> FillValueMetadata {
        match (attributes.get("_FillValue").and_then(Value::as_number), self) {
            (Some(fill), _) => FillValueMetadata::Number(fill.clone()),
            (None, Self::F16 | Self::F32 | Self::F64) => FillValueMetadata::String("NaN".to_owned()),
            (None, _) => FillValueMetadata::Number(0.into()),
        }
    }

    /// Bytes per element.
    const fn size(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::F16 => 2,
            Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

/// What an array is, apart from its content.
#[derive(Clone, Debug)]
pub(super) struct ArraySpec<'a> {
    pub(super) name: &'a str,
    pub(super) element: ElementType,
    /// Length of each axis.
    pub(super) shape: Vec<usize>,
    /// Length of a chunk along the first axis; along the others a chunk is whole.
    pub(super) chunk: usize,
    pub(super) dims: &'a [&'a str],
    /// Whether chunks are compressed; those of older files are not.
    pub(super) packed: bool,
}

impl ArraySpec<'_> {
    /// Checks the sizes that a caller gave for a file at `path`.
    pub(super) fn check(&self, path: &Path) -> Result<(), StoreError> {
        self.sizes().map(|_| ()).map_err(|found| {
            StoreError::argument(path, format!("layout of `{}`", self.name), SANE_SHAPE, found)
        })
    }

    fn chunk_shape(&self) -> Vec<u64> {
        let whole = self.shape.iter().skip(1);
        std::iter::once(&self.chunk)
            .chain(whole)
            .map(|&length| length as u64)
            .collect()
    }

    /// Elements of one index along the first axis and bytes of a chunk, or what is wrong.
    fn sizes(&self) -> Result<(usize, usize), String> {
        let product = |lengths: &[usize]| {
            lengths
                .iter()
                .try_fold(1usize, |product, &length| product.checked_mul(length))
        };
        let row = self.shape.get(1..).and_then(product).filter(|&row| row > 0);
        let bytes = row.and_then(|row| product(&[row, self.chunk, self.element.size()]));
        match (row, bytes) {
            (Some(row), Some(bytes)) if bytes > 0 && bytes <= LARGEST_CHUNK && self.shape[0] > 0 => {
                Ok((row, bytes))
            }
            _ => Err(format!("shape {} in chunks of {}", by(&self.shape), self.chunk)),
        }
    }
}

/// What every array's shape has to be, for messages.
const SANE_SHAPE: &str = "no empty axis and chunks of at most 4 GiB";

/// An open array.
#[derive(Debug)]
pub(super) struct ZarrArray {
    array: Array<AtomicStore>,
    store: Arc<AtomicStore>,
    name: String,
    /// Length of the first axis.
    rows: usize,
    /// Rows per chunk.
    chunk: usize,
    /// Elements per row.
    row: usize,
    /// Bytes of a chunk without its checksum, and before it is compressed.
    chunk_bytes: usize,
    /// Whether chunks are compressed.
    packed: bool,
    options: CodecOptions,
}

impl ZarrArray {
    /// Makes the array with these attributes and writes its metadata; NaN stands for no data, or 0 among integers.
    pub(super) fn create(
        store: &Arc<AtomicStore>,
        spec: &ArraySpec<'_>,
        attributes: Map<String, Value>,
    ) -> Result<Self, StoreError> {
        let no_data = spec.element.no_data(&attributes);
        Self::create_filled(store, spec, attributes, no_data)
    }

    /// As [`create`](Self::create), with `no_data` as the fill value.
    pub(super) fn create_filled(
        store: &Arc<AtomicStore>,
        spec: &ArraySpec<'_>,
        attributes: Map<String, Value>,
        no_data: FillValueMetadata,
    ) -> Result<Self, StoreError> {
        spec.sizes()
            .map_err(|found| StoreError::argument(store.root(), spec.name, SANE_SHAPE, found))?;
        let path = store.path_of(&metadata_key(spec.name));
        let shape: Vec<u64> = spec.shape.iter().map(|&length| length as u64).collect();
        let array = ArrayBuilder::new(shape, spec.chunk_shape(), spec.element.name(), no_data)
            .chunk_key_encoding_default_separator(ChunkKeySeparator::Dot)
            .array_to_bytes_codec(Arc::new(BytesCodec::little()))
            .bytes_to_bytes_codecs(codecs(spec.packed))
            .dimension_names(Some(spec.dims.iter().copied()))
            .attributes(attributes)
            .build(Arc::clone(store), &format!("/{}", spec.name))
            .map_err(|error| StoreError::array(&path, error))?
            .with_metadata_options(ArrayMetadataOptions::default().with_include_zarrs_metadata(false));
        array
            .store_metadata()
            .map_err(|error| StoreError::storage(&path, "write", error))?;
        Self::wrap(array, store, spec, spec.packed)
    }

    /// Opens the array if its metadata are those of `spec`; `header` was read from it.
    pub(super) fn open(
        store: &Arc<AtomicStore>,
        spec: &ArraySpec<'_>,
        header: &Header,
    ) -> Result<Self, StoreError> {
        let expect = |field: &str, expected: String, found: String| {
            if expected == found {
                Ok(())
            } else {
                Err(StoreError::metadata(&header.path, field, expected, found))
            }
        };
        expect("shape", by(&spec.shape), by(&header.shape))?;
        expect(
            "data_type",
            spec.element.name().to_owned(),
            header.data_type.clone(),
        )?;
        expect("dimension_names", listed(spec.dims), listed(&header.dims))?;
        if header.packed && !spec.packed {
            expect(
                "codecs",
                "bytes, then crc32c".to_owned(),
                "zstd between them".to_owned(),
            )?;
        }
        expect(
            "chunk_grid.configuration.chunk_shape",
            by(&spec.chunk_shape()),
            by(&header.chunk_shape),
        )?;
        spec.sizes()
            .map_err(|found| StoreError::metadata(&header.path, "shape", SANE_SHAPE, found))?;
        let array = Array::open(Arc::clone(store), &format!("/{}", spec.name))
            .map_err(|error| StoreError::array(&header.path, error))?;
        Self::wrap(array, store, spec, header.packed)
    }

    fn wrap(
        array: Array<AtomicStore>,
        store: &Arc<AtomicStore>,
        spec: &ArraySpec<'_>,
        packed: bool,
    ) -> Result<Self, StoreError> {
        let (row, bytes) = spec
            .sizes()
            .map_err(|found| StoreError::argument(store.root(), spec.name, SANE_SHAPE, found))?;
        Ok(Self {
            array,
            store: Arc::clone(store),
            name: spec.name.to_owned(),
            rows: spec.shape[0],
            chunk: spec.chunk,
            row,
            chunk_bytes: bytes,
            packed,
            // An absent chunk means "not written": one of zeros has to be stored, not left out.
            options: CodecOptions::default()
                .with_concurrent_target(1)
                .with_validate_checksums(true)
                .with_store_empty_chunks(true),
        })
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// The metadata as JSON, for the group's copy.
    pub(super) fn metadata(&self) -> Value {
        let options = ArrayMetadataOptions::default().with_include_zarrs_metadata(false);
        serde_json::to_value(self.array.metadata_opt(&options)).unwrap_or_default()
    }

    /// Number of chunks, the last perhaps partial.
    pub(super) fn chunks(&self) -> usize {
        self.rows.div_ceil(self.chunk)
    }

    /// The rows in chunk `index`; empty beyond the last chunk.
    pub(super) fn range(&self, index: usize) -> Range<usize> {
        let start = index.saturating_mul(self.chunk).min(self.rows);
        start..start.saturating_add(self.chunk).min(self.rows)
    }

    /// Elements in chunk `index` that belong to the array (the rest of a partial chunk is padding).
    pub(super) fn len(&self, index: usize) -> usize {
        self.range(index).len() * self.row
    }

    fn indices(&self, index: usize) -> Vec<u64> {
        let mut indices = vec![0; self.array.dimensionality()];
        indices[0] = index as u64;
        indices
    }

    fn key(&self, index: usize) -> StoreKey {
        self.array.chunk_key(&self.indices(index))
    }

    /// The file of chunk `index`.
    pub(super) fn path_of(&self, index: usize) -> PathBuf {
        self.store.path_of(&self.key(index))
    }

    pub(super) fn check_index(&self, index: usize) -> Result<(), StoreError> {
        if index < self.chunks() {
            return Ok(());
        }
        let expected = format!("an index below {}", self.chunks());
        Err(StoreError::argument(
            self.store.root(),
            format!("chunk of `{}`", self.name),
            expected,
            index.to_string(),
        ))
    }

    /// Begins the file of chunk `index`.
    pub(super) fn begin_file(&self, index: usize) -> std::io::Result<Unfinished> {
        self.store.begin(&self.path_of(index))
    }

    /// Bytes of a whole chunk without its checksum, and before it is compressed.
    pub(super) const fn chunk_bytes(&self) -> usize {
        self.chunk_bytes
    }

    /// Bytes of the elements in chunk `index` that belong to the array.
    pub(super) fn bytes_of(&self, index: usize) -> usize {
        self.chunk_bytes() / self.chunk * self.range(index).len()
    }

    /// The element that stands for no data, little-endian.
    pub(super) fn no_data(&self) -> Vec<u8> {
        let mut bytes = self.array.fill_value().as_ne_bytes().to_vec();
        if cfg!(target_endian = "big") {
            bytes.reverse();
        }
        bytes
    }

    /// Whether chunk `index` was written.
    pub(super) fn is_present(&self, index: usize) -> bool {
        index < self.chunks() && self.path_of(index).is_file()
    }

    /// Checks that `len` elements are what chunk `index` takes.
    pub(super) fn check_len(&self, index: usize, len: usize) -> Result<(), StoreError> {
        self.check_index(index)?;
        if len == self.len(index) {
            return Ok(());
        }
        let expected = format!("{} elements", self.len(index));
        let what = format!("data for chunk {index} of `{}`", self.name);
        Err(StoreError::argument(
            self.store.root(),
            what,
            expected,
            format!("{len} elements"),
        ))
    }

    /// Writes chunk `index`: its rows in order, without padding.
    pub(super) fn write<T: ElementOwned + Copy>(&self, index: usize, rows: &[T]) -> Result<(), StoreError> {
        self.check_len(index, rows.len())?;
        let full = self.chunk * self.row;
        let rows = if rows.len() == full {
            Cow::Borrowed(rows)
        } else {
            let no_data = self.array.fill_value().as_ne_bytes().to_vec();
            let no_data = T::from_array_bytes(self.array.data_type(), no_data.into())
                .expect("invariant: the fill value is one element");
            let mut padded = rows.to_vec();
            padded.resize(full, no_data[0]);
            Cow::Owned(padded)
        };
        self.array
            .store_chunk_opt(&self.indices(index), rows.as_ref(), &self.options)
            .map_err(|error| StoreError::chunk(&self.path_of(index), &self.name, index, "write", error))
    }

    /// Reads chunk `index` without its padding, or `None` if it was never written.
    pub(super) fn read<T: ElementOwned + Pod>(&self, index: usize) -> Result<Option<Vec<T>>, StoreError> {
        self.check_index(index)?;
        let path = self.path_of(index);
        let failed = |error| StoreError::chunk(&path, &self.name, index, "read", error);
        T::validate_data_type(self.array.data_type()).map_err(|error| failed(error.into()))?;
        if self.packed {
            return self.read_packed(index);
        }
        let found = self.store.size_key(&self.key(index));
        match found.map_err(|error| StoreError::storage(&path, "inspect", error))? {
            None => return Ok(None),
            Some(bytes) if bytes == (self.chunk_bytes + CHECKSUM) as u64 => {}
            Some(bytes) => {
                let expected = format!("{} bytes", self.chunk_bytes + CHECKSUM);
                return Err(self.unlike(index, expected, format!("{bytes} bytes")));
            }
        }
        // As bytes, and copied here: zarrs makes the numbers of them one by one.
        let bytes = self
            .array
            .retrieve_chunk_if_exists_opt::<ArrayBytes>(&self.indices(index), &self.options)
            .map_err(failed)?;
        let Some(bytes) = bytes else { return Ok(None) };
        let bytes = bytes.into_fixed().expect("invariant: numbers have one length");
        let mut rows = vec![T::zeroed(); self.len(index)];
        let kept = &bytes[..size_of_val(rows.as_slice())];
        bytemuck::cast_slice_mut(&mut rows).copy_from_slice(kept);
        Ok(Some(rows))
    }

    /// As [`read`](Self::read) of compressed chunks. Whatever a file claims, no more is unpacked than a chunk has, for which zarrs has
    /// no bound.
    fn read_packed<T: Pod>(&self, index: usize) -> Result<Option<Vec<T>>, StoreError> {
        let path = self.path_of(index);
        let found = self.store.get(&self.key(index));
        let Some(file) = found.map_err(|error| StoreError::storage(&path, "read", error))? else {
            return Ok(None);
        };
        let Some((packed, checksum)) = file.split_last_chunk::<CHECKSUM>() else {
            return Err(self.unlike(
                index,
                "a chunk and its CRC-32C".to_owned(),
                format!("{} bytes", file.len()),
            ));
        };
        if crc32c::crc32c(packed).to_le_bytes() != *checksum {
            return Err(StoreError::Checksum {
                path,
                array: self.name.clone(),
                chunk: index,
            });
        }
        let mut rows = vec![T::zeroed(); self.chunk_bytes / size_of::<T>()];
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut rows);
        let expected = || format!("{} bytes compressed by zstd", self.chunk_bytes);
        match zstd::bulk::decompress_to_buffer(packed, bytes) {
            Ok(length) if length == self.chunk_bytes => {}
            Ok(length) => return Err(self.unlike(index, expected(), format!("{length} bytes"))),
            Err(error) => return Err(self.unlike(index, expected(), error.to_string())),
        }
        if cfg!(target_endian = "big") {
            bytes.chunks_exact_mut(size_of::<T>()).for_each(<[u8]>::reverse);
        }
        rows.truncate(self.len(index));
        Ok(Some(rows))
    }

    /// That chunk `index` is not what was `expected`.
    fn unlike(&self, index: usize, expected: String, found: String) -> StoreError {
        StoreError::Chunk {
            path: self.path_of(index),
            array: self.name.clone(),
            chunk: index,
            expected,
            found,
        }
    }

    /// Reads chunk `index`, which has to exist.
    pub(super) fn read_present<T: ElementOwned + Pod>(&self, index: usize) -> Result<Vec<T>, StoreError> {
        self.read(index)?
            .ok_or_else(|| self.unlike(index, "a file".to_owned(), "none".to_owned()))
    }

    /// The CRC-32C with which the file of chunk `index` ends, as it stands there.
    pub(super) fn stored_checksum(&self, index: usize) -> Result<[u8; CHECKSUM], StoreError> {
        let path = self.path_of(index);
        let mut checksum = [0; CHECKSUM];
        let read = File::open(&path).and_then(|mut file| {
            file.seek(SeekFrom::End(-(CHECKSUM as i64)))?;
            file.read_exact(&mut checksum)
        });
        read.map_err(|error| StoreError::io(&path, "read", error))?;
        Ok(checksum)
    }

    /// Removes chunk `index` if it exists.
    pub(super) fn erase(&self, index: usize) -> Result<(), StoreError> {
        self.array
            .erase_chunk(&self.indices(index))
            .map_err(|error| StoreError::storage(&self.path_of(index), "remove", error))
    }
}

/// What makes files of the bytes of chunks.
fn codecs(packed: bool) -> Vec<Arc<dyn BytesToBytesCodecTraits>> {
    let checksum: Arc<dyn BytesToBytesCodecTraits> = Arc::new(Crc32cCodec::new());
    if packed {
        vec![Arc::new(ZstdCodec::new(ZSTD_LEVEL, false)), checksum]
    } else {
        vec![checksum]
    }
}
