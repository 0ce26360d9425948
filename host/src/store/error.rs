//! What can be wrong with a file of a measurement, one sentence each.

use crate::base::blame::Blame;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use zarrs::array::{ArrayCreateError, ArrayError, CodecError};
use zarrs::storage::StorageError;

/// A file of a measurement could not be read or written.
///
/// Every variant names the path and, where something was expected, what was found instead.
#[derive(Clone, Debug, thiserror::Error)]
pub enum StoreError {
    /// The path to create is taken; nothing was changed.
    #[error("{path}: expected a free path to create, found that it already exists")]
    AlreadyExists {
        /// The path that is taken.
        path: PathBuf,
    },
    /// Another process is writing there; nothing was changed.
    #[error(
        "{path}: expected to be the only one who writes there, found {holder} writing it; try again when that has ended"
    )]
    Busy {
        /// What was to be written.
        path: PathBuf,
        /// Who holds the lock.
        holder: String,
    },
    /// The path is not a file of this kind.
    #[error("{path}: expected {expected}, found {found}")]
    NotAGroup {
        /// The path that was opened.
        path: PathBuf,
        /// The kind of file that was expected.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The group lacks an array.
    #[error("{path}: expected an array `{array}`, found no zarr.json for it")]
    ArrayMissing {
        /// The `zarr.json` that should exist.
        path: PathBuf,
        /// Name of the array.
        array: String,
    },
    /// A field of a `zarr.json` is not what this program writes.
    #[error("{path}: field `{field}`: expected {expected}, found {found}")]
    Metadata {
        /// The `zarr.json`.
        path: PathBuf,
        /// The field, with dots between levels.
        field: String,
        /// What would have been right.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// The content of a chunk does not match its checksum.
    #[error("{path}: chunk {chunk} of array `{array}`: expected a matching CRC-32C, found a damaged file")]
    Checksum {
        /// The chunk's file.
        path: PathBuf,
        /// Name of the array.
        array: String,
        /// Index of the chunk along the first axis.
        chunk: usize,
    },
    /// A chunk is absent, torn or cannot be decoded.
    #[error("{path}: chunk {chunk} of array `{array}`: expected {expected}, found {found}")]
    Chunk {
        /// The chunk's file.
        path: PathBuf,
        /// Name of the array.
        array: String,
        /// Index of the chunk along the first axis.
        chunk: usize,
        /// What would have been right.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The caller's data do not fit the file; nothing was written.
    #[error("{path}: {what}: expected {expected}, found {found}")]
    Argument {
        /// The group that was to be written or read.
        path: PathBuf,
        /// Which argument.
        what: String,
        /// What would have been right.
        expected: String,
        /// What was given.
        found: String,
    },
    /// No room is left, or a quota is used up; no partial file was left behind.
    #[error("{path}: expected room to write, found the disk full ({source})")]
    DiskFull {
        /// The file that was to be written.
        path: PathBuf,
        /// What the system said.
        source: Arc<io::Error>,
    },
    /// The file system refused.
    #[error("{path}: cannot {action}: {source}")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was tried, as a verb.
        action: &'static str,
        /// What the system said.
        source: Arc<io::Error>,
    },
}

impl Blame for StoreError {
    fn is_input(&self) -> bool {
        !matches!(
            self,
            Self::DiskFull { .. } | Self::Io { .. } | Self::Argument { .. } | Self::Busy { .. }
        )
    }
}

impl StoreError {
    pub(crate) fn io(path: &Path, action: &'static str, source: impl Into<Arc<io::Error>>) -> Self {
        let (path, source) = (path.to_path_buf(), source.into());
        match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => Self::DiskFull { path, source },
            _ => Self::Io { path, action, source },
        }
    }

    pub(super) fn storage(path: &Path, action: &'static str, error: StorageError) -> Self {
        match error {
            StorageError::IOError(source) => Self::io(path, action, source),
            other => Self::io(path, action, io::Error::other(other.to_string())),
        }
    }

    pub(super) fn array(path: &Path, error: ArrayCreateError) -> Self {
        match error {
            ArrayCreateError::StorageError(error) => Self::storage(path, "read", error),
            other => Self::metadata(
                path,
                "array",
                "metadata of a readable Zarr v3 array",
                other.to_string(),
            ),
        }
    }

    pub(super) fn chunk(
        path: &Path,
        array: &str,
        chunk: usize,
        action: &'static str,
        error: ArrayError,
    ) -> Self {
        let (path_buf, array) = (path.to_path_buf(), array.to_owned());
        match error {
            ArrayError::CodecError(CodecError::InvalidChecksum) => Self::Checksum {
                path: path_buf,
                array,
                chunk,
            },
            ArrayError::StorageError(error) | ArrayError::CodecError(CodecError::StorageError(error)) => {
                Self::storage(path, action, error)
            }
            other => Self::Chunk {
                path: path_buf,
                array,
                chunk,
                expected: format!("a chunk to {action}"),
                found: other.to_string(),
            },
        }
    }

    pub(super) fn metadata(
        path: &Path,
        field: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Metadata {
            path: path.to_path_buf(),
            field: field.into(),
            expected: expected.into(),
            found: found.into(),
        }
    }

    pub(super) fn argument(
        path: &Path,
        what: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Argument {
            path: path.to_path_buf(),
            what: what.into(),
            expected: expected.into(),
            found: found.into(),
        }
    }
}
