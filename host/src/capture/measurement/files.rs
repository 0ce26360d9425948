//! Files of a measurement, and what goes wrong with them.

use std::fs;
use std::io::Write as _;
use std::path::Path;

use super::MeasurementError;
use crate::store::whole_file::FileError;

/// The error of the file at `path`.
pub(super) fn io(path: &Path, source: std::io::Error) -> MeasurementError {
    FileError::at(path, source).into()
}

/// Writes a file to the disk, or removes what was written of it.
pub(super) fn write_synced(path: &Path, bytes: &[u8]) -> Result<(), MeasurementError> {
    let written =
        fs::File::create(path).and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()));
    written.map_err(|source| {
        fs::remove_file(path).ok();
        io(path, source)
    })
}
