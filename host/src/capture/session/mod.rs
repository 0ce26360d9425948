//! Who measured, when, where and with what: `session.json`.
//!
//! # Design
//! | file | holds |
//! |---|---|
//! | `said` | what people say of a session, in a TOML file |
//! | `record` | the file `session.json` of a measurement or a calibration |
//! | `attachments` | photographs and other files that go along |
//!
//! Every command that measures or goes on adds an entry and never changes an older one. An entry that says the same as an older one, to
//! the second, is the same and stands there once: with a fixed clock (`SOURCE_DATE_EPOCH`) what is made stays the same to the bit.
//! The file carries a checksum of itself, and the manifest of a measurement that of the first entry, so that neither a change nor
//! its absence goes unnoticed. The library has no clock and knows no host: the command says both.

mod attachments;
mod record;
mod said;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::base::blame::Blame;
use crate::base::text::TextError;
use crate::instrument::calibration::{GEOMETRY, PHOTOMETRY, Photometry, RIG};
use crate::instrument::rig::RigError;
use crate::store::checksum::sum_of;
use crate::store::whole_file::FileError;

pub use attachments::{ATTACHMENTS, Attachment, LARGEST_BYTES, MOST};
pub use record::{Record, TriggerBoxFacts};
pub use said::{Instruments, Said, is_words};

/// Why a session is not recorded.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// What is said of it, or what its file holds.
    #[error("{path}: {field}: expected {expected}, found {found}")]
    Content {
        /// The file.
        path: String,
        /// What in it.
        field: String,
        /// What was expected.
        expected: String,
        /// What is there.
        found: String,
    },
    /// What is said of it is no such TOML.
    #[error(transparent)]
    Toml(#[from] RigError),
    /// What is said of it is no text.
    #[error("{path}: expected what there is to say of a session, found no readable file: {source}")]
    Text {
        /// The file.
        path: String,
        /// What is wrong.
        source: TextError,
    },
    /// A file cannot be written or read.
    #[error(transparent)]
    File(#[from] FileError),
}

impl Blame for SessionError {
    fn is_input(&self) -> bool {
        !matches!(self, Self::File(_))
    }
}

/// One session: one command that measures, or goes on with it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Session {
    /// When it began, UTC, as RFC 3339 writes it.
    pub began: String,
    /// The command, without its options.
    pub command: String,
    /// Program and version.
    pub program: String,
    /// The state of the source that the program was built from, if that is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub revision: Option<String>,
    /// Name of the computer, if that is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub host: Option<String>,
    /// What people say of it, without the paths of attachments.
    #[serde(default)]
    pub said: Said,
    /// What went along, as it lies in the folder [`ATTACHMENTS`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub attached: Vec<Attachment>,
}

/// A session that begins: its entry, where its attachments are, and the calibration that it is begun with.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Opening {
    /// The entry.
    pub session: Session,
    /// The files of its attachments, in their order.
    pub sources: Vec<PathBuf>,
    /// The calibration.
    pub calibration: Option<CalibrationUsed>,
}

impl Opening {
    /// That of `session`, of which `said` is said; the attachments are read once, to tell what they are.
    ///
    /// # Errors
    /// [`SessionError`] if an attachment cannot go along.
    pub fn new(session: Session, said: Said) -> Result<Self, SessionError> {
        let sources = said.attachments.clone();
        let attached = attachments::read(&sources)?;
        let said = Said {
            attachments: Vec::new(),
            ..said
        };
        Ok(Self {
            session: Session {
                said,
                attached,
                ..session
            },
            sources,
            calibration: None,
        })
    }

    /// Refuses attachments that the folder of `dir` has already with another content.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn check(&self, dir: &Path) -> Result<(), SessionError> {
        attachments::check(&self.session.attached, dir)
    }

    /// Adds it to the record in `dir`, with its attachments, which are there first.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn note(&self, dir: &Path) -> Result<Record, SessionError> {
        self.check(dir)?;
        attachments::copy(&self.sources, &self.session.attached, dir)?;
        let before = Record::read(dir)?;
        let mut record = before.clone().unwrap_or_default();
        record.add(self);
        if before.as_ref() != Some(&record) {
            record.write(dir)?;
        }
        Ok(record)
    }
}

/// The calibration that a measurement was begun with.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationUsed {
    /// SHA-256 of its files by their names.
    pub sha256: BTreeMap<String, String>,
    /// The sessions in which it was made, the oldest first; none if it does not say.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub made: Vec<Session>,
    /// The standards of its photometry: certificate, or what was assumed, and how uncertain.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub standards: Vec<String>,
}

impl CalibrationUsed {
    /// The one in `dir`, of which this is the `photometry`, if there is one.
    ///
    /// # Errors
    /// [`SessionError`] if a file of it cannot be read.
    pub fn read(dir: &Path, photometry: Option<&Photometry>) -> Result<Self, SessionError> {
        let mut sha256 = BTreeMap::new();
        for name in [RIG, GEOMETRY, PHOTOMETRY] {
            let path = dir.join(name);
            if path.is_file() {
                let sum = sum_of(&path).map_err(|source| FileError::at(&path, source))?;
                sha256.insert(name.to_owned(), sum);
            }
        }
        Ok(Self {
            sha256,
            made: Record::read(dir)?.unwrap_or_default().sessions,
            standards: photometry
                .iter()
                .flat_map(|found| &found.standards)
                .map(ToString::to_string)
                .collect(),
        })
    }
}

#[cfg(test)]
mod tests;
