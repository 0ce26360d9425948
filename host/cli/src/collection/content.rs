//! Whether a result is what it was.

use std::fmt::Write as _;
use std::io;
use std::path::Path;
use std::time::UNIX_EPOCH;

use rcg::store::checksum::{files_below, sum, sum_of_files};
use rcg::store::whole_file::FileError;

use crate::failure::Failure;

/// The files below a folder, by their paths, and the bytes of all.
pub(super) struct Content<'a> {
    dir: &'a Path,
    names: Vec<String>,
    pub(super) bytes: u64,
    /// SHA-256 over path, size and time of change of each: as long as it stays nobody need read them.
    pub(super) stamp: String,
}

impl<'a> Content<'a> {
    /// That of the folder `dir`.
    pub(super) fn of(dir: &'a Path) -> Result<Self, Failure> {
        let looked = || -> io::Result<Self> {
            let names = files_below(dir)?;
            let (mut bytes, mut lines) = (0, String::new());
            for name in &names {
                let about = dir.join(name).metadata()?;
                let changed = about.modified()?.duration_since(UNIX_EPOCH);
                let changed_ns = changed.map_or(0, |since| since.as_nanos());
                bytes += about.len();
                writeln!(lines, "{name}\n{} {changed_ns}", about.len()).expect("strings take everything");
            }
            Ok(Self {
                dir,
                names,
                bytes,
                stamp: sum(lines.as_bytes()),
            })
        };
        looked().map_err(|source| FileError::at(dir, source).into())
    }

    /// SHA-256 of all files, as lineages have it.
    pub(super) fn sum(&self) -> Result<String, Failure> {
        sum_of_files(self.dir, &self.names).map_err(|source| FileError::at(self.dir, source).into())
    }
}
