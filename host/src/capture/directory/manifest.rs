//! `manifest.json`: what a measurement was begun with, by content, and how far it is.
//!
//! # Design
//! The checksums are written once, before `plan.toml` gets its name: a directory with a plan has a manifest. Nothing writes
//! them again, so that a file that was edited or exchanged later is found out. The manifest carries a checksum of itself.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::identity::Sums;
use super::{MeasurementError, State};
use crate::store::checksum::sum_of_json;
use crate::store::whole_file::write_whole;

/// Its name.
pub(super) const MANIFEST: &str = "manifest.json";
/// Version of its format: 1 had neither this number nor sums of calibration, sample and truth.
const FORMAT: u32 = 2;
/// Key of the checksums.
const SUMS: &str = "sha256";
/// Key of the checksum of all else.
const SELF: &str = "checksum";

/// The content of the file.
pub(super) struct Manifest {
    path: PathBuf,
    facts: Map<String, Value>,
}

impl Manifest {
    /// That of the measurement in `dir` that begins now, with what there is to say of it.
    pub(super) fn new(dir: &Path, sums: &Sums, seed: Option<u64>, facts: Map<String, Value>) -> Self {
        let mut all = Map::new();
        all.insert("format".to_owned(), json!(FORMAT));
        all.insert("state".to_owned(), json!(State::Planned));
        all.insert(
            "program".to_owned(),
            json!(concat!("rcg ", env!("CARGO_PKG_VERSION"))),
        );
        all.insert("protocol".to_owned(), json!(rcg_protocol::PROTOCOL_VERSION));
        if let Some(seed) = seed {
            all.insert("seed".to_owned(), json!(seed));
        }
        all.insert(SUMS.to_owned(), json!(sums));
        all.extend(facts);
        Self {
            path: dir.join(MANIFEST),
            facts: all,
        }
    }

    /// Reads that of the measurement in `dir`.
    ///
    /// # Errors
    /// [`MeasurementError::Manifest`] if it is not as this program left it.
    pub(super) fn read(dir: &Path) -> Result<Self, MeasurementError> {
        let path = dir.join(MANIFEST);
        let fail = |found: String| MeasurementError::Manifest {
            path: path.display().to_string(),
            found,
        };
        let bytes = fs::read(&path).map_err(|error| fail(format!("no readable file ({error})")))?;
        let mut facts: Map<String, Value> =
            serde_json::from_slice(&bytes).map_err(|error| fail(format!("no JSON object ({error})")))?;
        match facts.get("format") {
            Some(format) if *format == json!(FORMAT) => {}
            None if facts.contains_key("state") => {
                return Err(fail(format!(
                    "one of an earlier version of this program, which knows format {FORMAT}"
                )));
            }
            format => {
                let format = format.map_or_else(|| "none".to_owned(), ToString::to_string);
                return Err(fail(format!("format {format} instead of {FORMAT}")));
            }
        }
        let checksum = facts.shift_remove(SELF);
        if checksum != Some(json!(sum_of_json(&facts))) {
            return Err(fail("one that something else has changed".to_owned()));
        }
        Ok(Self { path, facts })
    }

    /// Checksums of all that the measurement was begun with.
    pub(super) fn sums(&self) -> Sums {
        let sums = self.facts.get(SUMS).cloned().unwrap_or_default();
        serde_json::from_value(sums).unwrap_or_default()
    }

    /// What it says of `fact`, if it does.
    pub(super) fn get<T: serde::de::DeserializeOwned>(&self, fact: &str) -> Option<T> {
        serde_json::from_value(self.facts.get(fact)?.clone()).ok()
    }

    /// Takes facts in; the state stays.
    pub(super) fn add(&mut self, facts: Map<String, Value>) {
        self.facts.extend(facts);
    }

    /// Takes state and facts in.
    pub(super) fn note(&mut self, state: State, facts: Map<String, Value>) {
        self.facts.insert("state".to_owned(), json!(state));
        self.facts.extend(facts);
    }

    /// Writes the file.
    ///
    /// # Errors
    /// [`MeasurementError::File`].
    pub(super) fn write(&self) -> Result<(), MeasurementError> {
        let mut all = self.facts.clone();
        all.insert(SELF.to_owned(), json!(sum_of_json(&self.facts)));
        let text = serde_json::to_string_pretty(&all).expect("JSON values can be written");
        Ok(write_whole(&self.path, text.as_bytes())?)
    }
}
