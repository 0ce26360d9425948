//! Reading and writing rigs as TOML.
//!
//! # Design
//! The TOML reader knows the place of a mistake only as a range of bytes. [`place`] turns it into the dotted
//! name of the field, which is what a person looks for.

use std::ops::Range;
use std::path::Path;

use super::{Rig, RigError};

impl Rig {
    /// The rig `spec`: the name of a preset, else the path of a TOML file.
    ///
    /// # Errors
    /// [`RigError`], one sentence, when the file is missing, is not TOML, or does not describe a usable rig.
    pub fn load(spec: &str) -> Result<Rig, RigError> {
        if let Some(text) = preset(spec) {
            return Rig::from_toml(text, Path::new(spec));
        }
        let path = Path::new(spec);
        let text = crate::base::text::read(path).map_err(|found| RigError::Unreadable {
            path: path.to_path_buf(),
            found: found.into(),
        })?;
        Rig::from_toml(&text, path)
    }

    /// The rig that the TOML `text` describes; `path` is only named in errors.
    ///
    /// # Errors
    /// As [`Rig::load`].
    pub fn from_toml(text: &str, path: &Path) -> Result<Rig, RigError> {
        let rig: Rig = toml::from_str(text).map_err(|error| explain(text, path, &error))?;
        rig.check(path)?;
        Ok(rig)
    }

    /// The rig as TOML that [`Rig::from_toml`] reads back to the same numbers.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("invariant: a rig is tables of numbers, strings and flags")
    }
}

/// Text of the preset `name`.
fn preset(name: &str) -> Option<&'static str> {
    match name {
        "rcg-1" => Some(include_str!("presets/rcg-1.toml")),
        "rcg-1-16bit" => Some(include_str!("presets/rcg-1-16bit.toml")),
        "rcg-2" => Some(include_str!("presets/rcg-2.toml")),
        "rcg-3" => Some(include_str!("presets/rcg-3.toml")),
        "dmd" => Some(include_str!("presets/dmd.toml")),
        _ => None,
    }
}

/// The TOML reader's complaint as one sentence with the field's name.
pub(crate) fn explain(text: &str, path: &Path, error: &toml::de::Error) -> RigError {
    let path = path.to_path_buf();
    let message = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
    let span = error.span().unwrap_or(0..0);
    let before = text.get(..span.start).unwrap_or(text);
    if toml::from_str::<toml::Table>(text).is_err() {
        let line = before.matches('\n').count() + 1;
        let column = before.chars().rev().take_while(|&c| c != '\n').count() + 1;
        let (found, expected) = match message.split_once(", expected ") {
            Some((found, expected)) => (found.to_owned(), expected.to_owned()),
            None => (message, "valid TOML".to_owned()),
        };
        return RigError::Syntax {
            path,
            line,
            column,
            expected,
            found,
        };
    }
    let (table, key) = place(text, &span);
    let on_header = key.is_empty();
    let dotted = |key: &str| match table.split('.').position(|part| part.trim() == key) {
        _ if table.is_empty() => key.to_owned(),
        // The header itself is the mistake, such as `[licht]` or `[camera.lense]`.
        Some(depth) if on_header => table.split('.').take(depth + 1).collect::<Vec<_>>().join("."),
        _ => format!("{table}.{key}"),
    };
    if let Some(name) = quoted_after(&message, "missing field ") {
        let (field, expected) = (dotted(name), "a value, as the field is required".to_owned());
        return RigError::Field {
            path,
            field,
            expected,
            found: "nothing".to_owned(),
        };
    }
    let key = quoted_after(&message, "unknown field ").unwrap_or(key);
    let field = if key.is_empty() {
        table.to_owned()
    } else {
        dotted(key)
    };
    let (found, expected) = message
        .split_once(", expected ")
        .unwrap_or((&message, "a file as this program writes it"));
    let found = found
        .trim_start_matches("invalid type: ")
        .trim_start_matches("invalid value: ")
        .to_owned();
    RigError::Field {
        path,
        field,
        expected: in_plain_words(expected),
        found,
    }
}

/// The reader's word for a type as a person would say it.
fn in_plain_words(expected: &str) -> String {
    match expected {
        "u8" => "a whole number from 0 to 255",
        "u32" => "a whole number from 0 to 4294967295",
        "f64" => "a number",
        "a boolean" => "true or false",
        other if other.starts_with("struct ") => "a table",
        other => other,
    }
    .to_owned()
}

/// The name between backticks that follows `start` at the start of `message`.
fn quoted_after<'a>(message: &'a str, start: &str) -> Option<&'a str> {
    message.strip_prefix(start)?.strip_prefix('`')?.split('`').next()
}

/// Table and key at the bytes `span` of valid TOML: the last header at or above its start and the key of that
/// line. The whole file, which is no table, has an empty span.
fn place<'a>(text: &'a str, span: &Range<usize>) -> (&'a str, &'a str) {
    let mut table = "";
    let mut key = "";
    let mut line_start = 0;
    for line in text.split_inclusive('\n') {
        if line_start > span.start {
            break;
        }
        let bare = line.trim();
        if let Some(header) = bare.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
            table = if span.is_empty() { "" } else { header.0.trim() };
            key = "";
        } else if let Some((name, _)) = bare.split_once('=')
            && !bare.starts_with('#')
        {
            key = name.trim();
        }
        line_start += line.len();
    }
    (table, key)
}
