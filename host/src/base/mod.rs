//! What everything stands on and nothing optical is in: words, progress, whose fault an error is, formats of files by their
//! names, linear fits.

pub mod blame;
pub mod file_format;
pub(crate) mod linear_fit;
pub mod progress;
pub mod text;
