//! Files that are whole or not there.

use std::fs;
use std::io::Write as _;
use std::path::Path;

use super::MeasurementError;
use crate::whole_file;

/// The error of the file at `path`.
pub(super) fn io(path: &Path, source: std::io::Error) -> MeasurementError {
    MeasurementError::Io {
        path: path.display().to_string(),
        source,
    }
}

/// Writes a file so that it is whole or not there, as [`whole_file::write`].
///
/// # Errors
/// [`MeasurementError::Io`].
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), MeasurementError> {
    whole_file::write(path, bytes).map_err(|source| io(path, source))
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
