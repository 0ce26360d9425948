//! What everything stands on and nothing optical is in: words, days, progress, whose fault an error is, formats of files by their
//! names, linear fits, medians, eight numbers computed at once.

pub mod blame;
pub(crate) mod bracket;
pub mod date;
pub(crate) mod eight;
pub mod file_format;
pub(crate) mod linear_fit;
pub(crate) mod median;
pub mod progress;
pub(crate) mod student;
pub mod text;
