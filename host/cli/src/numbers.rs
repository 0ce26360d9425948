//! Lines of numbers on stdin.

use std::io::BufRead;

use rcg::base::text::{TextError, lines, numbers};

use crate::failure::Failure;

/// Largest polar angle and azimuth that are taken, degrees. What is beyond is no angle but a mistake.
const LARGEST_DEG: [f64; 2] = [180.0, 3600.0];

/// The directions of every line that `reader` holds, `N` angles (θ, φ of each) in degrees; blank lines and what follows
/// a # are skipped.
pub(crate) fn directions_of<const N: usize>(
    reader: impl BufRead,
    names: &'static str,
) -> impl Iterator<Item = Result<[f64; N], Failure>> {
    lines(reader).filter_map(move |(number, line)| {
        let refused = |expected: &str, found: &str| {
            Failure::input(format!(
                "stdin, line {number}: expected {expected}, found {found}"
            ))
        };
        let expected = || format!("{N} numbers ({names})");
        let line = match line {
            Ok(line) => line,
            Err(TextError::Io(error)) => return Some(Err(error.into())),
            Err(error) => return Some(Err(refused(&expected(), &error.to_string()))),
        };
        match numbers::<N>(&line) {
            Ok(None) => None,
            Ok(Some(angles)) => {
                let mut with_limits = angles.iter().zip(LARGEST_DEG.into_iter().cycle());
                Some(
                    match with_limits.find(|(angle, largest)| angle.abs() > *largest) {
                        None => Ok(angles),
                        Some((angle, largest)) => {
                            let expected = format!("an angle from -{largest} to {largest} degrees");
                            Err(refused(&expected, &angle.to_string()))
                        }
                    },
                )
            }
            Err(found) => Some(Err(refused(&expected(), &found))),
        }
    })
}
