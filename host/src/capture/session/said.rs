//! What people say of a session.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::SessionError;
use crate::base::text;
use crate::instrument::rig::explain;

/// Notes of one session, at most.
const MOST_NOTES: usize = 100;
/// Bytes of a text, at most.
const LONGEST: usize = 1000;
/// Numbers are kept to so many parts of one, which JSON gives back to the bit.
const PARTS: f64 = 1000.0;

/// What people say of a session, as its TOML file has it. All of it may be absent.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Said {
    /// Who measures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
    /// Where.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub laboratory: Option<String>,
    /// Temperature of the air, degrees Celsius, to a thousandth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<f64>,
    /// Relative humidity of the air, percent, to a thousandth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub humidity_percent: Option<f64>,
    /// What else there is to say.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Serial numbers.
    #[serde(skip_serializing_if = "Instruments::is_empty")]
    pub instruments: Instruments,
    /// Files that go along, such as photographs of sample and set-up; relative ones count from the folder of the TOML file.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub attachments: Vec<PathBuf>,
}

/// Serial numbers of the parts of an instrument.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Instruments {
    /// Of the camera.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<String>,
    /// Of the projector.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub projector: Option<String>,
    /// Of the mirror.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mirror: Option<String>,
    /// Of the trigger box.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trigger_box: Option<String>,
}

impl Instruments {
    /// What has a serial number, and that.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, &str)> {
        [
            ("camera", &self.camera),
            ("projector", &self.projector),
            ("mirror", &self.mirror),
            ("trigger box", &self.trigger_box),
        ]
        .into_iter()
        .filter_map(|(part, serial)| Some((part, serial.as_deref()?)))
    }

    fn is_empty(&self) -> bool {
        self.named().next().is_none()
    }
}

/// Whether `text` is some words on one line that no terminal obeys, of at most 1000 bytes.
#[must_use]
pub fn is_words(text: &str) -> bool {
    !text.trim().is_empty() && text.len() <= LONGEST && !text.contains(char::is_control)
}

impl Said {
    /// Reads the TOML file at `path`.
    ///
    /// # Errors
    /// [`SessionError`] with the field that is unknown or says something impossible.
    pub fn read(path: &Path) -> Result<Self, SessionError> {
        let text = text::read(path).map_err(|source| SessionError::Text {
            path: path.display().to_string(),
            source,
        })?;
        let mut said: Self = toml::from_str(&text).map_err(|error| explain(&text, path, &error))?;
        if let Some((field, expected, found)) = said.flaw() {
            return Err(SessionError::Content {
                path: path.display().to_string(),
                field,
                expected,
                found,
            });
        }
        for number in [&mut said.temperature_c, &mut said.humidity_percent] {
            *number = number.map(|number| (number * PARTS).round() / PARTS);
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        for attachment in &mut said.attachments {
            *attachment = folder.join(&*attachment);
        }
        Ok(said)
    }

    /// The first field that says something impossible: its name, what was expected and what was found.
    fn flaw(&self) -> Option<(String, String, String)> {
        let texts = [("operator", &self.operator), ("laboratory", &self.laboratory)];
        let texts = texts
            .into_iter()
            .filter_map(|(field, text)| Some((field.to_owned(), text.as_deref()?)));
        let serials = self.instruments.named();
        let serials =
            serials.map(|(part, serial)| (format!("instruments.{}", part.replace(' ', "_")), serial));
        let notes = self.notes.iter().enumerate();
        let notes = notes.map(|(place, note)| (format!("notes[{place}]"), note.as_str()));
        if let Some((field, found)) = texts
            .chain(serials)
            .chain(notes)
            .find(|(_, text)| !is_words(text))
        {
            let expected = format!("some words on one line, of at most {LONGEST} bytes");
            return Some((field, expected, text::cut(&text::shown(found), 100)));
        }
        let numbers = [
            ("temperature_c", self.temperature_c, -50.0, 100.0),
            ("humidity_percent", self.humidity_percent, 0.0, 100.0),
        ];
        for (field, number, low, high) in numbers {
            if let Some(number) = number.filter(|number| !(low..=high).contains(number)) {
                let expected = format!("a number from {low} to {high}");
                return Some((field.to_owned(), expected, number.to_string()));
            }
        }
        (self.notes.len() > MOST_NOTES).then(|| {
            let expected = format!("at most {MOST_NOTES} notes");
            ("notes".to_owned(), expected, self.notes.len().to_string())
        })
    }
}
