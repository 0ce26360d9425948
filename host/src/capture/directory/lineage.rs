//! Where a result comes from: the files that decided it, by content, and who measured.

use serde_json::{Map, Value, json};

use super::identity::Sums;
use super::manifest::Manifest;
use super::{Measurement, MeasurementError};
use crate::brdf::evidence::FRAMES;
use crate::capture::Instrument;
use crate::capture::session::{Opening, Record, Session, TriggerBoxFacts};
use crate::instrument::calibration::AppliedCalibration;
use crate::store::RawStore;

/// Fact of the manifest: SHA-256 of the first session of the record.
const FIRST_SESSION: &str = "first_session";

/// What the manifest says of the record in `dir`, if there is one.
pub(super) fn first_session(dir: &std::path::Path) -> Result<Map<String, Value>, MeasurementError> {
    let record = Record::read(dir)?;
    let fact = record.map(|record| (FIRST_SESSION.to_owned(), json!(record.first_sum())));
    Ok(fact.into_iter().collect())
}

impl Measurement {
    /// Who measured, when and with what; `None` if nobody said so.
    ///
    /// # Errors
    /// [`MeasurementError::Session`] if the record is not as this program left it; [`MeasurementError::Changed`] if it is that of another
    /// measurement, or not there any more.
    pub fn record(&self) -> Result<Option<Record>, MeasurementError> {
        let record = Record::read(self.dir())?;
        let held: Option<String> = self.noted(FIRST_SESSION);
        let found = record.as_ref().map(Record::first_sum);
        // A record without a word of it in the manifest is one that a killed process was about to name there.
        if held.is_none() || held == found {
            return Ok(record);
        }
        let told = |sum: Option<String>, which: &str| {
            sum.map_or_else(|| "none".to_owned(), |sum| format!("{which} (SHA-256 {sum:.12})"))
        };
        Err(MeasurementError::Changed {
            path: self.path(Record::FILE).display().to_string(),
            expected: told(held, "the record of a first session"),
            found: told(found, "that of another"),
        })
    }

    /// Adds a session in which somebody goes on.
    ///
    /// # Errors
    /// [`MeasurementError`].
    pub fn note_session(&self, session: &Opening) -> Result<(), MeasurementError> {
        session.note(self.dir())?;
        let facts = first_session(self.dir())?;
        let mut manifest = Manifest::read(self.dir())?;
        if manifest.get::<String>(FIRST_SESSION).is_none() {
            manifest.add(facts);
            manifest.write()?;
        }
        Ok(())
    }

    /// Notes which trigger box fires.
    ///
    /// # Errors
    /// [`MeasurementError::Session`].
    pub(crate) fn note_box(&self, instrument: &Instrument) -> Result<(), MeasurementError> {
        Ok(Record::note_box(self.dir(), box_of(instrument))?)
    }

    /// SHA-256 of all that decides its values: what it was begun with, by the names of the files, and its `raw` frames.
    ///
    /// # Errors
    /// [`MeasurementError::Store`].
    pub fn sums(&self, raw: &RawStore) -> Result<Sums, MeasurementError> {
        let mut sums = self.sums.clone();
        sums.insert(FRAMES.to_owned(), raw.sum()?);
        Ok(sums)
    }

    /// What a result that is assembled from its `raw` frames says of where it comes from; nothing in it depends on when or on which
    /// computer that is done. `other` is the calibration that is taken in place of its own.
    ///
    /// # Errors
    /// [`MeasurementError`].
    pub fn lineage(
        &self,
        raw: &RawStore,
        other: Option<&AppliedCalibration>,
    ) -> Result<Value, MeasurementError> {
        let mut sums = self.sums(raw)?;
        let mut lineage = Map::new();
        lineage.insert(
            "program".to_owned(),
            json!(concat!("rcg ", env!("CARGO_PKG_VERSION"))),
        );
        if let Some(other) = other {
            let before = sums.insert(AppliedCalibration::FILE.to_owned(), other.sum());
            lineage.insert("assembled_again".to_owned(), json!(true));
            lineage.insert("calibration_before".to_owned(), json!(before));
        }
        lineage.insert("sha256".to_owned(), json!(sums));
        let sessions = self.record()?.unwrap_or_default().sessions;
        let texts = |of: fn(&Session) -> Vec<String>| {
            let mut texts: Vec<String> = Vec::new();
            for text in sessions.iter().flat_map(of) {
                if !texts.contains(&text) {
                    texts.push(text);
                }
            }
            texts
        };
        let said: [(&str, Vec<String>); 4] = [
            (
                "operators",
                texts(|session| session.said.operator.iter().cloned().collect()),
            ),
            (
                "laboratories",
                texts(|session| session.said.laboratory.iter().cloned().collect()),
            ),
            ("notes", texts(|session| session.said.notes.clone())),
            (
                "instruments",
                texts(|session| {
                    let named = session.said.instruments.named();
                    named.map(|(part, serial)| format!("{part} {serial}")).collect()
                }),
            ),
        ];
        let said = said.into_iter().filter(|(_, texts)| !texts.is_empty());
        lineage.extend(said.map(|(name, texts)| (name.to_owned(), json!(texts))));
        Ok(lineage.into())
    }
}

/// What the trigger box of an `instrument` says of itself.
pub(crate) fn box_of(instrument: &Instrument) -> TriggerBoxFacts {
    let device = &instrument.device;
    TriggerBoxFacts::new(device.link().peer(), &device.info(), device.protocol())
}
