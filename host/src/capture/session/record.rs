//! `session.json`: all sessions of a measurement or a calibration.

use std::path::Path;

use rcg_protocol::Info;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::{CalibrationUsed, Opening, Session, SessionError};
use crate::store::checksum::{sum, sum_of_json};
use crate::store::whole_file::write_whole;

/// Version of its format.
const FORMAT: u32 = 1;
/// Keys of the version and of the checksum of all else.
const VERSION: &str = "format";
const SELF: &str = "checksum";

/// What `session.json` holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// The sessions, the oldest first.
    pub sessions: Vec<Session>,
    /// The calibration that a measurement was begun with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<CalibrationUsed>,
    /// The trigger boxes that fired for a measurement, each once.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub trigger_boxes: Vec<TriggerBoxFacts>,
}

/// What a trigger box says of itself.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TriggerBoxFacts {
    /// Where it was: a port, or `sim` for the simulated one.
    pub port: String,
    /// Version of its firmware.
    pub firmware: String,
    /// Version of the protocol.
    pub protocol: u32,
    /// Ticks per second.
    pub clock_hz: u32,
    /// Steps and output words that its table holds.
    pub table: [u32; 2],
}

impl TriggerBoxFacts {
    /// Those of the box at `port` that says `info` and speaks this version of the protocol.
    #[must_use]
    pub fn new(port: &str, info: &Info, protocol: u16) -> Self {
        let (major, minor, patch) = info.firmware;
        Self {
            port: port.to_owned(),
            firmware: format!("{major}.{minor}.{patch}"),
            protocol: u32::from(protocol),
            clock_hz: info.clock_hz,
            table: [info.max_steps, info.max_words],
        }
    }
}

impl Record {
    /// Name of its file.
    pub const FILE: &str = "session.json";

    /// That of the measurement or calibration in `dir`; `None` if there is none.
    ///
    /// # Errors
    /// [`SessionError`] if it is not as this program left it.
    pub fn read(dir: &Path) -> Result<Option<Self>, SessionError> {
        let path = dir.join(Self::FILE);
        let fail = |found: String| SessionError::Content {
            path: path.display().to_string(),
            field: "file".to_owned(),
            expected: format!("the record of all sessions as this program left it, of format {FORMAT}"),
            found,
        };
        let bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(fail(format!("no readable file ({error})"))),
        };
        let mut all: Map<String, Value> =
            serde_json::from_slice(&bytes).map_err(|error| fail(format!("no JSON object ({error})")))?;
        let version = all.get(VERSION).cloned().unwrap_or_default();
        if version != json!(FORMAT) {
            return Err(fail(format!("format {version}")));
        }
        // As text: numbers need not come back from JSON to the last bit.
        if !is_sealed(&bytes) {
            return Err(fail("one that something else has changed".to_owned()));
        }
        all.shift_remove(SELF);
        all.shift_remove(VERSION);
        let record: Self = serde_json::from_value(all.into()).map_err(|error| fail(error.to_string()))?;
        if record.sessions.is_empty() {
            return Err(fail("none".to_owned()));
        }
        Ok(Some(record))
    }

    /// Writes it into `dir`.
    ///
    /// # Errors
    /// [`SessionError::File`].
    pub(super) fn write(&self, dir: &Path) -> Result<(), SessionError> {
        let mut all = Map::new();
        all.insert(VERSION.to_owned(), json!(FORMAT));
        all.extend(object(self));
        let text = serde_json::to_string_pretty(&all).expect("JSON values can be written");
        Ok(write_whole(&dir.join(Self::FILE), sealed(&text).as_bytes())?)
    }

    /// Adds a session, unless it stands there, and the calibration, if there is none yet.
    pub(super) fn add(&mut self, opening: &Opening) {
        if !self.sessions.contains(&opening.session) {
            self.sessions.push(opening.session.clone());
        }
        if self.calibration.is_none() {
            self.calibration.clone_from(&opening.calibration);
        }
    }

    /// Notes in the record in `dir`, if there is one, that the box of these `facts` fires.
    ///
    /// # Errors
    /// [`SessionError`].
    pub(crate) fn note_box(dir: &Path, facts: TriggerBoxFacts) -> Result<(), SessionError> {
        match Self::read(dir)? {
            Some(mut record) if !record.trigger_boxes.contains(&facts) => {
                record.trigger_boxes.push(facts);
                record.write(dir)
            }
            _ => Ok(()),
        }
    }

    /// SHA-256 of the first session, which never changes.
    ///
    /// # Panics
    /// If there is none.
    #[must_use]
    pub(crate) fn first_sum(&self) -> String {
        sum_of_json(&object(&self.sessions[0]))
    }
}

/// The text of an object with the checksum of it as its last field.
fn sealed(text: &str) -> String {
    let body = text.strip_suffix("\n}").unwrap_or(text);
    format!("{body},\n  \"{SELF}\": \"{}\"\n}}", sum(body.as_bytes()))
}

/// Whether `bytes` are what [`sealed`] made.
fn is_sealed(bytes: &[u8]) -> bool {
    let text = String::from_utf8_lossy(bytes);
    let Some((body, _)) = text.rsplit_once(&format!(",\n  \"{SELF}\": ")) else {
        return false;
    };
    text == sealed(&format!("{body}\n}}"))
}

fn object(value: &impl Serialize) -> Map<String, Value> {
    match serde_json::to_value(value) {
        Ok(Value::Object(object)) => object,
        _ => unreachable!("structures are objects"),
    }
}
