//! What a file is written as: the end of its name says it, and a name that says something else is refused.

use crate::base::blame::Blame;
use std::fmt;
use std::path::Path;

/// Pictures.
pub const PICTURE: Formats = Formats(&["png"]);
/// Pictures as a screen shows them, or as they are.
pub const RENDERED: Formats = Formats(&["png", "exr"]);
/// Charts: vectors or pixels.
pub const CHART: Formats = Formats(&["svg", "pdf", "png"]);
/// Charts, or their numbers.
pub const CHART_OR_TABLE: Formats = Formats(&["svg", "pdf", "png", "csv"]);
/// Tables.
pub const TABLE: Formats = Formats(&["csv"]);
/// Records of the trigger box: a table, or one JSON object a line.
pub const RECORDS: Formats = Formats(&["csv", "jsonl"]);
/// Certificates of standards.
pub const CERTIFICATE: Formats = Formats(&["toml"]);
/// Pages for a browser.
pub const PAGE: Formats = Formats(&["html"]);
/// How a virtual rig really is.
pub const TRUTH: Formats = Formats(&["toml"]);

/// The formats in which one thing can be written, each as its files' names end, in small letters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Formats(&'static [&'static str]);

impl Formats {
    /// Those whose names end so, in small letters.
    #[must_use]
    pub const fn new(endings: &'static [&'static str]) -> Self {
        Self(endings)
    }

    /// The format that the name of `path` asks for, in small letters.
    ///
    /// # Errors
    /// [`FormatError`] if it asks for none of these.
    pub fn of(self, path: &Path) -> Result<&'static str, FormatError> {
        let extension = path.extension().map(|extension| extension.to_string_lossy());
        let known = |&&format: &&&str| {
            extension
                .as_deref()
                .is_some_and(|extension| extension.eq_ignore_ascii_case(format))
        };
        self.0.iter().find(known).copied().ok_or_else(|| FormatError {
            path: path.display().to_string(),
            formats: self,
            found: extension.map_or_else(|| "none".to_owned(), |extension| format!(".{extension}")),
        })
    }
}

impl fmt::Display for Formats {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, format) in self.0.iter().enumerate() {
            let before = match at {
                0 => "",
                _ if at + 1 == self.0.len() => " or ",
                _ => ", ",
            };
            write!(f, "{before}.{format}")?;
        }
        Ok(())
    }
}

/// A name that ends in no format that can be written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{path}: expected a file name that ends in {formats}, found {found}")]
pub struct FormatError {
    path: String,
    formats: Formats,
    found: String,
}

impl Blame for FormatError {
    fn is_input(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_what_is_written_and_refusals_what_could_be() {
        let of = |name: &str| CHART_OR_TABLE.of(Path::new(name));
        for (name, format) in [("a.svg", "svg"), ("a.b.PNG", "png"), ("dir.svg/a.Csv", "csv")] {
            assert_eq!(of(name), Ok(format));
        }
        for (name, found) in [
            ("a.exr", ".exr"),
            ("svg", "none"),
            ("a.svg/b", "none"),
            (".svg", "none"),
        ] {
            assert_eq!(
                of(name).unwrap_err().to_string(),
                format!("{name}: expected a file name that ends in .svg, .pdf, .png or .csv, found {found}")
            );
        }
        assert_eq!(CHART.to_string(), ".svg, .pdf or .png");
        assert_eq!(PICTURE.to_string(), ".png");
    }
}
