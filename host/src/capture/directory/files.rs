//! Files that are on the disk before they get their name.

use std::fs;
use std::io::Write as _;
use std::path::Path;

use crate::store::whole_file::FileError;

/// Writes a file to the disk, or removes what was written of it.
///
/// # Errors
/// [`FileError`].
pub(super) fn write_synced(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    let written =
        fs::File::create(path).and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()));
    written.map_err(|source| {
        fs::remove_file(path).ok();
        FileError::at(path, source)
    })
}
