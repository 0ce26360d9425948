//! Text that people and other programs write: how it is read, and how it is shown in messages.
//!
//! # Design
//! All text is UTF-8. A byte order mark before it is skipped; other encodings are refused by their names. Lines end in LF
//! or CR LF. Files and lines that have no end are not taken into memory: there is a longest file and a longest line.
//!
//! Messages quote what was read, which may hold anything. [`plain`] shows what a terminal would obey instead of print
//! (control characters, and those that turn the direction of writing) by its escape, [`shown`] cuts too.

use std::fmt::{self, Display, Write as _};
use std::fs::File;
use std::io::{self, BufRead, Read as _};
use std::path::Path;

/// Bytes of the longest file of text that is read: a plan with a million directions is shorter.
pub const LONGEST_FILE: u64 = 64 << 20;
/// Bytes of the longest line that is read.
pub const LONGEST_LINE: u64 = 64 << 10;
/// Characters of a quotation.
const QUOTATION: usize = 120;

const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Why text cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum TextError {
    /// What the system says.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// Its byte order mark is that of another encoding.
    #[error("{0} text (save it as UTF-8)")]
    Encoding(&'static str),
    /// It is no UTF-8.
    #[error("bytes that are no UTF-8 text{}", line.map_or_else(String::new, |line| format!(" in line {line}")))]
    Bytes {
        /// The line, from 1 on, if it is not known already.
        line: Option<usize>,
    },
    /// It is longer than this program takes.
    #[error("{what} of more than {most} bytes")]
    Long {
        /// Whether a line or a file.
        what: &'static str,
        /// The longest.
        most: u64,
    },
}

impl From<TextError> for io::Error {
    fn from(error: TextError) -> Self {
        match error {
            TextError::Io(error) => error,
            other => Self::new(io::ErrorKind::InvalidData, other.to_string()),
        }
    }
}

/// The text of the file at `path`.
///
/// # Errors
/// [`TextError`].
pub fn read(path: &Path) -> Result<String, TextError> {
    let mut bytes = Vec::new();
    // One more tells that there is more.
    File::open(path)?.take(LONGEST_FILE + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > LONGEST_FILE {
        return Err(TextError::Long {
            what: "a file",
            most: LONGEST_FILE,
        });
    }
    let bytes = without_mark(bytes)?;
    String::from_utf8(bytes).map_err(|error| {
        let before = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        TextError::Bytes {
            line: Some(before.split(|&byte| byte == b'\n').count()),
        }
    })
}

fn without_mark(mut bytes: Vec<u8>) -> Result<Vec<u8>, TextError> {
    // That of UTF-32 begins as that of UTF-16.
    for (mark, encoding) in [
        (&b"\xff\xfe\0\0"[..], "UTF-32"),
        (b"\0\0\xfe\xff", "UTF-32"),
        (b"\xff\xfe", "UTF-16"),
        (b"\xfe\xff", "UTF-16"),
    ] {
        if bytes.starts_with(mark) {
            return Err(TextError::Encoding(encoding));
        }
    }
    if bytes.starts_with(BYTE_ORDER_MARK) {
        bytes.drain(..BYTE_ORDER_MARK.len());
    }
    Ok(bytes)
}

/// The lines of `reader`, without what ends them, and their numbers from 1 on. Ends after the first error.
pub fn lines(mut reader: impl BufRead) -> impl Iterator<Item = (usize, Result<String, TextError>)> {
    let mut next = Some(1);
    std::iter::from_fn(move || {
        let number = next?;
        let line = line(&mut reader, number == 1).transpose()?;
        next = line.is_ok().then_some(number + 1);
        Some((number, line))
    })
}

fn line(reader: &mut impl BufRead, is_first: bool) -> Result<Option<String>, TextError> {
    let mut bytes = Vec::new();
    reader.take(LONGEST_LINE + 1).read_until(b'\n', &mut bytes)?;
    if bytes.is_empty() {
        return Ok(None);
    }
    if bytes.last() == Some(&b'\n') {
        bytes.pop();
        if bytes.last() == Some(&b'\r') {
            bytes.pop();
        }
    } else if bytes.len() as u64 > LONGEST_LINE {
        return Err(TextError::Long {
            what: "a line",
            most: LONGEST_LINE,
        });
    }
    if is_first {
        bytes = without_mark(bytes)?;
    }
    let text = String::from_utf8(bytes).map_err(|_| TextError::Bytes { line: None })?;
    Ok(Some(text))
}

/// The `N` finite numbers on a line, with blanks or tabs between them; `None` where there is nothing but blanks before the
/// end or a #.
///
/// # Errors
/// What is there instead, as [`shown`].
pub fn numbers<const N: usize>(line: &str) -> Result<Option<[f64; N]>, String> {
    let content = line.split('#').next().unwrap_or_default().trim();
    if content.is_empty() {
        return Ok(None);
    }
    let number = |word: &str| word.parse().ok().filter(|number: &f64| number.is_finite());
    let mut words = content.split([' ', '\t']).filter(|word| !word.is_empty());
    let mut all = [0.0; N];
    let is_read = all
        .iter_mut()
        .all(|slot| words.next().and_then(number).map(|read| *slot = read).is_some());
    (is_read && words.next().is_none())
        .then_some(Some(all))
        .ok_or_else(|| shown(content))
}

/// `text` as a quotation: [`plain`], between backticks, cut where it is long.
#[must_use]
pub fn shown(text: &str) -> String {
    format!("`{}`", cut(&plain(text), QUOTATION))
}

/// `text` with a question mark in place of every letter beyond ASCII, for formats that have no others.
pub(crate) fn ascii(text: &str) -> String {
    text.chars().map(|c| if c.is_ascii() { c } else { '?' }).collect()
}

/// `text` with escapes in place of what a terminal would obey.
#[must_use]
pub fn plain(text: &str) -> String {
    text.chars()
        .fold(String::with_capacity(text.len()), |mut plain, c| {
            if is_obeyed(c) {
                plain.extend(c.escape_default());
            } else {
                plain.push(c);
            }
            plain
        })
}

/// Whether `c` is a control character, or one without width that ends lines or turns the direction of writing.
fn is_obeyed(c: char) -> bool {
    let turns =
        matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}');
    c.is_control() || turns
}

/// `text`, or if it has more than `most` characters its beginning, … and its end.
#[must_use]
pub fn cut(text: &str, most: usize) -> String {
    let count = text.chars().count();
    if count <= most {
        return text.to_owned();
    }
    let end = most / 4;
    let head: String = text.chars().take(most - end - 1).collect();
    let tail: String = text.chars().skip(count - end).collect();
    format!("{head}…{tail}")
}

/// `values` with ` × ` between them, as lengths of axes are written.
#[must_use]
pub fn by<T: Display>(values: &[T]) -> String {
    joined(values, " × ")
}

/// `values` with commas between them.
#[must_use]
pub fn listed<T: Display>(values: &[T]) -> String {
    joined(values, ", ")
}

fn joined<T: Display>(values: &[T], between: &str) -> String {
    if values.is_empty() {
        return "none".to_owned();
    }
    values
        .iter()
        .enumerate()
        .fold(String::new(), |mut text, (at, value)| {
            write!(text, "{}{value}", if at == 0 { "" } else { between }).expect("strings take everything");
            text
        })
}

/// What may not be there, in words.
#[derive(Clone, Copy, Debug)]
pub struct Maybe<T>(pub Option<T>);

impl<T: Display> Display for Maybe<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Some(value) => value.fmt(f),
            None => f.write_str("none"),
        }
    }
}

/// A duration in s for people.
#[must_use]
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 1e-3 => format!("{:.1} µs", s * 1e6),
        s if s < 1.0 => format!("{:.1} ms", s * 1e3),
        s if s < 120.0 => format!("{s:.1} s"),
        s if s < 7200.0 => format!("{:.1} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// A name as a field of a table (RFC 4180).
#[must_use]
pub fn quoted(name: &str) -> String {
    if name.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", name.replace('"', "\"\""))
    } else {
        name.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(bytes: &[u8]) -> Vec<Result<String, String>> {
        lines(bytes)
            .map(|(_, line)| line.map_err(|error| error.to_string()))
            .collect()
    }

    #[test]
    fn lines_end_as_systems_end_them_and_a_mark_before_them_is_skipped() {
        let expected = ["1 2", "", "3"].map(|line| Ok(line.to_owned()));
        for text in [
            "1 2\n\n3\n",
            "1 2\n\n3",
            "1 2\r\n\r\n3\r\n",
            "\u{feff}1 2\n\n3",
            "\u{feff}1 2\r\n\r\n3",
        ] {
            assert_eq!(all(text.as_bytes()), expected, "{text:?}");
        }
        assert_eq!(all(b""), []);
        // Only before the first.
        assert_eq!(all("1\n\u{feff}2".as_bytes())[1], Ok("\u{feff}2".to_owned()));
    }

    #[test]
    fn other_encodings_are_named_and_nothing_follows_an_error() {
        let utf16 = |swap: bool| -> Vec<u8> {
            let units = "\u{feff}45 0\n".encode_utf16();
            units
                .flat_map(|unit| {
                    if swap {
                        unit.to_be_bytes()
                    } else {
                        unit.to_le_bytes()
                    }
                })
                .collect()
        };
        for swap in [false, true] {
            assert_eq!(
                all(&utf16(swap)),
                [Err("UTF-16 text (save it as UTF-8)".to_owned())]
            );
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("list.txt");
            std::fs::write(&path, utf16(swap)).unwrap();
            assert!(matches!(read(&path), Err(TextError::Encoding("UTF-16"))));
            std::fs::write(&path, b"\xef\xbb\xbfone\ntwo \xff").unwrap();
            assert!(matches!(read(&path), Err(TextError::Bytes { line: Some(2) })));
            std::fs::write(&path, b"\xef\xbb\xbfone").unwrap();
            assert_eq!(read(&path).unwrap(), "one");
        }
        assert_eq!(
            all(b"\xff\xfe\0\0"),
            [Err("UTF-32 text (save it as UTF-8)".to_owned())]
        );
        let bad = all(b"1\n\xff\n3\n");
        assert_eq!(
            bad,
            [Ok("1".to_owned()), Err("bytes that are no UTF-8 text".to_owned())]
        );
    }

    #[test]
    fn a_line_without_end_is_not_kept() {
        let endless = io::BufReader::new(io::repeat(b'7'));
        let (number, line) = lines(endless).next().unwrap();
        assert_eq!(
            (number, line.unwrap_err().to_string().as_str()),
            (1, "a line of more than 65536 bytes")
        );
        let longest = "7".repeat(LONGEST_LINE as usize);
        assert_eq!(all(longest.as_bytes()), [Ok(longest)]);
    }

    #[test]
    fn numbers_are_as_many_as_asked_for_and_finite() {
        assert_eq!(numbers(" 1 \t-2.5e1 # remark"), Ok(Some([1.0, -25.0])));
        for blank in ["", " ", "# 1 2", "\t#"] {
            assert_eq!(numbers::<2>(blank), Ok(None));
        }
        for bad in [
            "1", "1 2 3", "1 nan", "1 inf", "1 1e400", "1, 2", "1 2\r3", "1\u{b}2", "1\0 2", "1_0 2",
        ] {
            assert_eq!(numbers::<2>(bad), Err(shown(bad)), "{bad:?}");
        }
    }

    #[test]
    fn what_is_shown_is_short_and_obeyed_by_no_terminal() {
        for code in (0..0x3000).chain([0xfeff]).filter_map(char::from_u32) {
            let text = plain(&code.to_string());
            assert!(!text.chars().any(is_obeyed), "{code:?}");
            assert!(code.is_control() || !text.is_empty());
        }
        assert_eq!(plain("a\r\u{1b}[31mü\0"), "a\\r\\u{1b}[31mü\\u{0}");
        let long = format!("{}\u{1b}end", "ü".repeat(1_000_000));
        let quoted = shown(&long);
        assert_eq!(quoted.chars().count(), QUOTATION + 2);
        assert!(quoted.starts_with("`üü") && quoted.contains('…') && quoted.ends_with("\\u{1b}end`"));
        assert_eq!(cut("12345", 5), "12345");
    }
}
