//! The JSON files of a calibration: numbers only.
//!
//! # Design
//! JSON has no NaN and no infinity: serde writes them as null. A number that a fit did not find must neither be written nor
//! read as if it had been, so that both ways the whole file is searched for nulls, and the field is named. What may be
//! absent is listed in [`OPTIONAL`].

use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::CalibrationError;
use crate::store::whole_file::{FileError, write_whole};

/// Fields that may be absent, wherever they are.
const OPTIONAL: [&str; 8] = [
    "tilt",
    "second_standard",
    "interreflection",
    "edge_residual_deg",
    "photometry",
    "wire",
    "spot_deg",
    "ghost",
];

/// Reads the JSON file at `path`, which `command` writes.
///
/// # Errors
/// [`CalibrationError::Content`] with the field that is no number, or where the file breaks off.
pub(crate) fn read<T: DeserializeOwned>(path: &Path, command: &str) -> Result<T, CalibrationError> {
    let content = |field: &str, found: String| CalibrationError::Content {
        path: path.display().to_string(),
        field: field.to_owned(),
        expected: format!("a whole file as `{command}` writes it"),
        found,
    };
    let bytes = std::fs::read(path).map_err(|error| content("file", error.to_string()))?;
    let value: Value = serde_json::from_slice(&bytes).map_err(|error| content("file", error.to_string()))?;
    if let Some(field) = absent(&value) {
        return Err(CalibrationError::Content {
            path: path.display().to_string(),
            field,
            expected: format!("a finite number as `{command}` writes it"),
            found: "null".to_owned(),
        });
    }
    serde_json::from_value(value).map_err(|error| content("file", error.to_string()))
}

/// Writes `value` as the JSON file at `path`, whole or not at all.
///
/// # Errors
/// [`FileError`].
pub(crate) fn write(path: &Path, value: &impl Serialize) -> Result<(), FileError> {
    write_whole(path, text(value).as_bytes())
}

/// `value` as it is written.
pub(crate) fn text(value: &impl Serialize) -> String {
    serde_json::to_string_pretty(value).expect("JSON values can be written")
}

/// The place of the first null that is no absent option, as `a.b[3]`.
pub(crate) fn absent(value: &Value) -> Option<String> {
    match value {
        Value::Object(fields) => fields.iter().find_map(|(name, value)| match value {
            Value::Null => (!OPTIONAL.contains(&name.as_str())).then(|| name.clone()),
            _ => absent(value).map(|within| {
                let dot = if within.starts_with('[') { "" } else { "." };
                format!("{name}{dot}{within}")
            }),
        }),
        Value::Array(items) => items.iter().enumerate().find_map(|(index, value)| match value {
            Value::Null => Some(format!("[{index}]")),
            _ => absent(value).map(|within| {
                let dot = if within.starts_with('[') { "" } else { "." };
                format!("[{index}]{dot}{within}")
            }),
        }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn whatever_is_not_finite_is_named() {
        let named = |value: Value| absent(&value);
        assert_eq!(
            named(json!({"a": 1.0, "tilt": null, "b": [{"tilt": null}]})),
            None
        );
        assert_eq!(named(json!({"a": {"b": f64::NAN}})).as_deref(), Some("a.b"));
        assert_eq!(
            named(json!({"a": [[0.0], [1.0, f64::INFINITY]]})).as_deref(),
            Some("a[1][1]")
        );
        assert_eq!(
            named(json!({"a": [{"c": f64::NEG_INFINITY}]})).as_deref(),
            Some("a[0].c")
        );
    }
}
