//! Lines of numbers on stdin.

use std::io::BufRead;

use rayon::prelude::*;
use rcg::base::text::{TextError, lines, numbers};

use crate::failure::Failure;

/// Largest polar angle and azimuth that are taken, degrees. What is beyond is no angle but a mistake.
const LARGEST_DEG: [f64; 2] = [180.0, 3600.0];

/// A line of text and its number, or why there is none.
type Line = (usize, Result<String, TextError>);

/// The directions of every line that `reader` holds, `N` angles (θ, φ of each) in degrees; blank lines and what follows
/// a # are skipped.
pub(crate) fn directions_of<const N: usize>(
    reader: impl BufRead,
    names: &'static str,
) -> impl Iterator<Item = Result<[f64; N], Failure>> {
    lines(reader).filter_map(move |line| directions(line, names).transpose())
}

/// As [`directions_of`] for the next lines of `lines`, up to `count` of them: those before the first that is bad, and how it ended if it
/// did: with the last line, or with a bad one.
pub(crate) fn next_directions<const N: usize>(
    lines: &mut impl Iterator<Item = Line>,
    count: usize,
    names: &'static str,
) -> (Vec<[f64; N]>, Option<Result<(), Failure>>) {
    let lines: Vec<Line> = lines.take(count).collect();
    let is_end = lines.len() < count;
    let read: Vec<_> = lines
        .into_par_iter()
        .map(|line| directions(line, names))
        .collect();
    let mut all = Vec::with_capacity(read.len());
    for one in read {
        match one {
            Ok(angles) => all.extend(angles),
            Err(failure) => return (all, Some(Err(failure))),
        }
    }
    (all, is_end.then_some(Ok(())))
}

/// The directions of a line; `None` of one that holds nothing.
fn directions<const N: usize>((number, line): Line, names: &str) -> Result<Option<[f64; N]>, Failure> {
    let refused = |expected: &str, found: &str| {
        Failure::input(format!(
            "stdin, line {number}: expected {expected}, found {found}"
        ))
    };
    let expected = || format!("{N} numbers ({names})");
    let line = match line {
        Ok(line) => line,
        Err(TextError::Io(error)) => return Err(error.into()),
        Err(error) => return Err(refused(&expected(), &error.to_string())),
    };
    let Some(angles) = numbers::<N>(&line).map_err(|found| refused(&expected(), &found))? else {
        return Ok(None);
    };
    let mut with_limits = angles.iter().zip(LARGEST_DEG.into_iter().cycle());
    match with_limits.find(|(angle, largest)| angle.abs() > *largest) {
        None => Ok(Some(angles)),
        Some((angle, largest)) => {
            let expected = format!("an angle from -{largest} to {largest} degrees");
            Err(refused(&expected, &angle.to_string()))
        }
    }
}
