//! Lines of numbers on stdin.

use std::io::{self, BufRead};

use crate::failure::Failure;

/// The `N` numbers of every line that `reader` holds; blank lines and those that begin with # are skipped.
pub(crate) fn lines_of<const N: usize>(
    reader: impl BufRead,
    names: &'static str,
) -> impl Iterator<Item = Result<[f64; N], Failure>> {
    reader.lines().enumerate().filter_map(move |(index, line)| {
        let line = match line {
            Ok(line) => line,
            Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                return Some(Err(Failure::input(format!(
                    "stdin, line {}: expected {N} numbers ({names}), found bytes that are no UTF-8 text",
                    index + 1
                ))));
            }
            Err(error) => return Some(Err(error.into())),
        };
        let text = line.trim();
        (!text.is_empty() && !text.starts_with('#')).then(|| {
            let numbers: Option<Vec<f64>> = text
                .split_whitespace()
                .map(|word| word.parse().ok().filter(|n: &f64| n.is_finite()))
                .collect();
            numbers
                .and_then(|numbers| <[f64; N]>::try_from(numbers).ok())
                .ok_or_else(|| {
                    Failure::input(format!(
                        "stdin, line {}: expected {N} numbers ({names}), found `{text}`",
                        index + 1
                    ))
                })
        })
    })
}
