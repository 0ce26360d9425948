//! What `manifest.json` of a measurement says of how far it is.

use std::fs;

use rcg::capture::directory::Measurement;
use serde_json::Value;

use crate::failure::Failure;

/// The fact below these `keys`, null if there is none. The file was found whole when the measurement was opened.
pub(crate) fn fact(measurement: &Measurement, keys: &[&str]) -> Result<Value, Failure> {
    let path = measurement.path("manifest.json");
    let failed = |error: std::io::Error| Failure::Failed(anyhow::anyhow!("{}: {error}", path.display()));
    let bytes = fs::read(&path).map_err(failed)?;
    let all: Value = serde_json::from_slice(&bytes).map_err(|error| failed(error.into()))?;
    Ok(keys
        .iter()
        .fold(all, |value, key| value.get(*key).cloned().unwrap_or_default()))
}
