//! The group around the arrays: made under another name, shown under its own when whole.
//!
//! # Design
//! A file is built in `<name>.partial` and renamed when its metadata (raw) or all of its content
//! (BRDF) is there, so that a path with the final name is always a file that opens. The group's
//! `zarr.json` also repeats the metadata of its arrays ("consolidated metadata"), which spares
//! xarray a search and a warning; this program does not read that copy.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};
use zarrs::storage::{StoreKey, WritableStorageTraits as _};

use super::atomic::AtomicStore;
use super::checksum::sum_of_json;
use super::error::StoreError;

/// Attribute of the group that says which kind of file it is.
const FORMAT: &str = "rcg_format";
/// Attribute of the group that says which version of that kind.
const FORMAT_VERSION: &str = "rcg_format_version";
/// Attribute of the group: SHA-256 of all others. Files of before have none.
const CHECKSUM: &str = "rcg_checksum";
/// The version of `brdf.zarr` that this program writes; it reads those of before too. 3 may lie turned on the sample.
const BRDF_VERSION: u64 = 3;
/// The version of `raw.zarr` that this program writes, and the only one that it reads: 2 has tallies, seals and orphans by
/// segments, the camera's time-stamps, the clock's rate and declared fill values.
const RAW_VERSION: u64 = 2;

/// The versions of `format` that this program reads; it writes the last.
fn versions(format: &str) -> std::ops::RangeInclusive<u64> {
    match format {
        "brdf" => 1..=BRDF_VERSION,
        _ => RAW_VERSION..=RAW_VERSION,
    }
}

/// The version that the attributes of a group of an accepted format state.
pub(super) fn version_of(attributes: &Map<String, Value>) -> u64 {
    let version = attributes.get(FORMAT_VERSION).and_then(Value::as_u64);
    version.expect("invariant: it was checked when the attributes were read")
}

/// `path` with a suffix on its last component, which a trailing slash does not hide.
pub(crate) fn with_suffix(path: &Path, suffix: &str) -> Result<PathBuf, StoreError> {
    let Some(name) = path.file_name() else {
        return Err(StoreError::argument(
            path,
            "path",
            "one that ends in a name",
            "none",
        ));
    };
    let mut name = name.to_owned();
    name.push(suffix);
    Ok(path.with_file_name(name))
}

/// Makes the empty folder in which the file that will be `path` is built, and returns it. The caller has the right to write
/// there: its own for that file, or that for the folder around.
///
/// An unfinished one of a writer that is no more is removed. An existing `path` is refused, unless `overwrite` is set and
/// it is a file of the same `format`.
pub(super) fn start(path: &Path, format: &str, overwrite: bool) -> Result<PathBuf, StoreError> {
    check_free(path, format, overwrite)?;
    let partial = with_suffix(path, ".partial")?;
    remove_folder(&partial)?;
    fs::create_dir_all(&partial).map_err(|error| StoreError::io(&partial, "create", error))?;
    Ok(partial)
}

/// Gives the finished `partial` its final name `path`.
pub(super) fn publish(partial: &Path, path: &Path, format: &str, overwrite: bool) -> Result<(), StoreError> {
    check_free(path, format, overwrite)?;
    if !exists(path)? {
        return fs::rename(partial, path).map_err(|error| StoreError::io(path, "create", error));
    }
    // A folder cannot be replaced in one step: the old one makes way first and is deleted last.
    let replaced = with_suffix(path, ".replaced")?;
    remove_folder(&replaced)?;
    fs::rename(path, &replaced).map_err(|error| StoreError::io(path, "replace", error))?;
    if let Err(error) = fs::rename(partial, path) {
        // The old one comes back; should even that fail, it is still whole under the other name.
        let _ = fs::rename(&replaced, path);
        return Err(StoreError::io(path, "create", error));
    }
    remove_folder(&replaced)
}

fn exists(path: &Path) -> Result<bool, StoreError> {
    match fs::symlink_metadata(path) {
        Ok(_) => Ok(true),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(StoreError::io(path, "inspect", error)),
    }
}

fn check_free(path: &Path, format: &str, overwrite: bool) -> Result<(), StoreError> {
    if !exists(path)? {
        return Ok(());
    }
    if !overwrite {
        return Err(StoreError::AlreadyExists {
            path: path.to_path_buf(),
        });
    }
    // To overwrite means to overwrite a file of this kind, not whatever folder bears the name.
    read_attributes(path, format).map(|_| ())
}

fn remove_folder(path: &Path) -> Result<(), StoreError> {
    match fs::remove_dir_all(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(StoreError::io(path, "remove", error)),
        _ => Ok(()),
    }
}

/// `attributes` with the format and its version in front.
pub(super) fn attributes_of(format: &str, attributes: Map<String, Value>) -> Map<String, Value> {
    let mut all = Map::new();
    all.insert(FORMAT.into(), format.into());
    all.insert(FORMAT_VERSION.into(), (*versions(format).end()).into());
    for (name, value) in attributes {
        all.entry(name).or_insert(value);
    }
    all
}

/// Writes the group's `zarr.json`; `arrays` are the names and the metadata of its arrays.
pub(super) fn write(
    store: &AtomicStore,
    attributes: &Map<String, Value>,
    arrays: &Map<String, Value>,
) -> Result<(), StoreError> {
    let mut attributes = attributes.clone();
    let sum = sum_of(&attributes, &[]);
    attributes.insert(CHECKSUM.to_owned(), sum.into());
    let metadata = json!({
        "zarr_format": 3,
        "node_type": "group",
        "attributes": attributes,
        "consolidated_metadata": { "kind": "inline", "must_understand": false, "metadata": arrays },
    });
    let key = metadata_key("");
    let text = format!("{metadata:#}\n");
    store
        .set(&key, text.into())
        .map_err(|error| StoreError::storage(&store.path_of(&key), "write", error))
}

/// SHA-256 of `attributes` as they are once they were written and read, but for their own sum and those `without` which they are compared.
pub(super) fn sum_of(attributes: &Map<String, Value>, without: &[&str]) -> String {
    let mut kept = attributes.clone();
    kept.retain(|name, _| name != CHECKSUM && !without.contains(&name.as_str()));
    let text = serde_json::to_string(&kept).expect("JSON values can be written");
    sum_of_json(&serde_json::from_str(&text).expect("what was written is JSON"))
}

/// Refuses `attributes` of the group at `path` that something else than this program has changed since they were written.
pub(super) fn check_sum(path: &Path, attributes: &Map<String, Value>) -> Result<(), StoreError> {
    let Some(expected) = attributes.get(CHECKSUM) else {
        return Ok(());
    };
    let found = sum_of(attributes, &[]);
    if *expected == found {
        return Ok(());
    }
    let expected = format!("those that were written (SHA-256 {})", short(expected));
    let found = format!("others ({found})");
    Err(StoreError::metadata(
        &path.join("zarr.json"),
        "attributes",
        expected,
        found,
    ))
}

/// Key of the metadata of `array`, or of the group itself if that is empty.
pub(super) fn metadata_key(array: &str) -> StoreKey {
    let key = if array.is_empty() {
        "zarr.json".to_owned()
    } else {
        format!("{array}/zarr.json")
    };
    StoreKey::new(key).expect("invariant: names of arrays have no slash")
}

/// All attributes of the group at `path`, if it is a file of this `format` that this program reads.
pub(super) fn read_attributes(path: &Path, format: &str) -> Result<Map<String, Value>, StoreError> {
    let not_a_group = |found: &str| StoreError::NotAGroup {
        path: path.to_path_buf(),
        expected: format!("a Zarr v3 group with {FORMAT} = \"{format}\""),
        found: found.to_owned(),
    };
    if !path.is_dir() {
        return Err(not_a_group(if exists(path)? { "no folder" } else { "nothing" }));
    }
    let file = path.join("zarr.json");
    let metadata = match fs::read(&file) {
        Ok(bytes) => parse(&file, &bytes)?,
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return Err(not_a_group("a folder without zarr.json"));
        }
        Err(error) => return Err(StoreError::io(&file, "read", error)),
    };
    expect_field(&file, &metadata, "zarr_format", &json!(3))?;
    expect_field(&file, &metadata, "node_type", &json!("group"))?;
    let Some(Value::Object(attributes)) = metadata.get("attributes") else {
        return Err(not_a_group("a group without attributes"));
    };
    match attributes.get(FORMAT) {
        Some(Value::String(found)) if found == format => {}
        Some(found) => return Err(not_a_group(&format!("one with {FORMAT} = {}", short(found)))),
        None => return Err(not_a_group("a group without that attribute")),
    }
    match attributes.get(FORMAT_VERSION) {
        Some(version)
            if version
                .as_u64()
                .is_some_and(|version| versions(format).contains(&version)) =>
        {
            Ok(attributes.clone())
        }
        version => Err(StoreError::metadata(
            &file,
            format!("attributes.{FORMAT_VERSION}"),
            versions(format)
                .map(|version| version.to_string())
                .collect::<Vec<_>>()
                .join(" or "),
            version.map_or_else(|| "nothing".to_owned(), short),
        )),
    }
}

/// The JSON object in `bytes`, read from `file`.
pub(super) fn parse(file: &Path, bytes: &[u8]) -> Result<Map<String, Value>, StoreError> {
    serde_json::from_slice(bytes)
        .map_err(|error| StoreError::metadata(file, "(whole file)", "a JSON object", format!("{error}")))
}

/// Checks that `field` of `metadata`, read from `file`, is `expected`.
pub(super) fn expect_field(
    file: &Path,
    metadata: &Map<String, Value>,
    field: &str,
    expected: &Value,
) -> Result<(), StoreError> {
    match metadata.get(field) {
        Some(found) if found == expected => Ok(()),
        found => {
            let found = found.map_or_else(|| "nothing".to_owned(), short);
            Err(StoreError::metadata(file, field, expected.to_string(), found))
        }
    }
}

/// A JSON value on one line of bounded length, for messages.
pub(super) fn short(value: &Value) -> String {
    const LONGEST: usize = 120;
    let text = value.to_string();
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}
