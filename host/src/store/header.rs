//! The metadata of an array, read and checked before zarrs sees them.
//!
//! # Design
//! Files come from anywhere. Every field that sizes follow from is checked here, one sentence per
//! field, so that nonsense ends neither in a panic nor in a huge allocation.

use std::path::PathBuf;

use serde_json::{Map, Value, json};
use zarrs::storage::ReadableStorageTraits as _;

use super::atomic::AtomicStore;
use super::error::StoreError;
use super::group::{expect_field, metadata_key, parse, short};
use crate::base::text::by;

/// The parts of an array's `zarr.json` from which a layout is read.
#[derive(Debug)]
pub(super) struct Header {
    /// The `zarr.json`.
    pub(super) path: PathBuf,
    pub(super) shape: Vec<usize>,
    pub(super) chunk_shape: Vec<usize>,
    pub(super) data_type: String,
    pub(super) dims: Vec<String>,
    pub(super) attributes: Map<String, Value>,
    /// Whether chunks are compressed.
    pub(super) packed: bool,
}

impl Header {
    /// Reads and checks the metadata of the array `name`, which has `rank` axes (if given).
    pub(super) fn read(store: &AtomicStore, name: &str, rank: Option<usize>) -> Result<Self, StoreError> {
        let key = metadata_key(name);
        let path = store.path_of(&key);
        let bytes = store
            .get(&key)
            .map_err(|error| StoreError::storage(&path, "read", error))?;
        let Some(bytes) = bytes else {
            return Err(StoreError::ArrayMissing {
                path,
                array: name.to_owned(),
            });
        };
        let metadata = parse(&path, &bytes)?;
        expect_field(&path, &metadata, "zarr_format", &json!(3))?;
        expect_field(&path, &metadata, "node_type", &json!("array"))?;

        let at = |pointer: &str| metadata_at(&metadata, pointer);
        let wrong = |field: &str, expected: &str, found: Option<&Value>| {
            StoreError::metadata(
                &path,
                field,
                expected,
                found.map_or_else(|| "nothing".to_owned(), short),
            )
        };
        let lengths = |field: &str| {
            let found = at(field);
            lengths(found, rank).ok_or_else(|| {
                wrong(
                    field,
                    &rank.map_or("a list of lengths".into(), |n| format!("{n} lengths")),
                    found,
                )
            })
        };
        let grid = at("chunk_grid.name");
        if grid.and_then(Value::as_str) != Some("regular") {
            return Err(wrong("chunk_grid.name", "\"regular\"", grid));
        }
        let shape = lengths("shape")?;
        let chunk_shape = lengths("chunk_grid.configuration.chunk_shape")?;
        if chunk_shape.len() != shape.len() || chunk_shape[1..] != shape[1..] {
            let expected = format!("any × {}", by(&shape[1..]));
            return Err(StoreError::metadata(
                &path,
                "chunk_grid.configuration.chunk_shape",
                expected,
                by(&chunk_shape),
            ));
        }
        let data_type = at("data_type");
        let Some(Value::String(data_type)) = data_type else {
            return Err(wrong("data_type", "the name of a type", data_type));
        };
        let dims = at("dimension_names");
        let names = dims.and_then(names);
        let Some(names) = names.filter(|names| names.len() == shape.len()) else {
            return Err(wrong("dimension_names", &format!("{} names", shape.len()), dims));
        };
        let codecs = at("codecs");
        let packed = match codecs.and_then(codec_names).as_deref() {
            // With these two codecs the length of a chunk's file is known.
            Some(["bytes", "crc32c"]) => false,
            Some(["bytes", "zstd", "crc32c"]) => true,
            _ => return Err(wrong("codecs", "bytes, perhaps zstd, then crc32c", codecs)),
        };
        let attributes = at("attributes")
            .and_then(Value::as_object)
            .cloned()
            .unwrap_or_default();
        Ok(Self {
            shape,
            chunk_shape,
            data_type: data_type.clone(),
            dims: names,
            attributes,
            packed,
            path,
        })
    }
}

/// The value at a path of object fields with dots between.
fn metadata_at<'a>(metadata: &'a Map<String, Value>, path: &str) -> Option<&'a Value> {
    let mut fields = path.split('.');
    let first = metadata.get(fields.next()?)?;
    fields.try_fold(first, |value, field| value.get(field))
}

/// A list of lengths, one or more: `rank` of them, if that is given.
fn lengths(found: Option<&Value>, rank: Option<usize>) -> Option<Vec<usize>> {
    let axes = found.and_then(Value::as_array).and_then(|lengths| {
        lengths
            .iter()
            .map(|n| n.as_u64().and_then(|n| usize::try_from(n).ok()))
            .collect::<Option<Vec<_>>>()
    });
    axes.filter(|axes| !axes.is_empty() && rank.is_none_or(|rank| rank == axes.len()))
}

/// A list of names.
fn names(found: &Value) -> Option<Vec<String>> {
    let names = found.as_array()?.iter();
    names.map(|name| name.as_str().map(str::to_owned)).collect()
}

/// The names of a list of codecs.
fn codec_names(found: &Value) -> Option<Vec<&str>> {
    let codecs = found.as_array()?.iter();
    codecs.map(|codec| codec.get("name")?.as_str()).collect()
}
