//! Files that go along with a measurement.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::SessionError;
use crate::store::checksum::{sum, sum_of};
use crate::store::whole_file::{FileError, write_whole};

/// The folder of a measurement that holds them.
pub const ATTACHMENTS: &str = "attachments";
/// Bytes of one of them, at most.
pub const LARGEST_BYTES: u64 = 32 << 20;
/// So many go along with one session, at most.
pub const MOST: usize = 20;

/// A file that went along.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Attachment {
    /// Its name.
    pub name: String,
    /// Its length.
    pub bytes: u64,
    /// SHA-256 of its content.
    pub sha256: String,
}

fn refused(path: &Path, expected: String, found: String) -> SessionError {
    SessionError::Content {
        path: path.display().to_string(),
        field: ATTACHMENTS.to_owned(),
        expected,
        found,
    }
}

/// What the files at `paths` are.
///
/// # Errors
/// [`SessionError`] if one is no file, too large, or its name cannot be kept beside the others.
pub(super) fn read(paths: &[PathBuf]) -> Result<Vec<Attachment>, SessionError> {
    if let Some(path) = paths.get(MOST) {
        return Err(refused(
            path,
            format!("at most {MOST} attachments"),
            paths.len().to_string(),
        ));
    }
    let mut names = BTreeSet::new();
    paths
        .iter()
        .map(|path| {
            let name = name_of(path)?;
            if !names.insert(name.to_lowercase()) {
                let expected = "attachments of different names".to_owned();
                return Err(refused(path, expected, "another of this name".to_owned()));
            }
            let bytes = content(path)?;
            Ok(Attachment {
                name,
                bytes: bytes.len() as u64,
                sha256: sum(&bytes),
            })
        })
        .collect()
}

/// The name of the file at `path`, as it is kept.
fn name_of(path: &Path) -> Result<String, SessionError> {
    let name = path.file_name().and_then(|name| name.to_str());
    let is_plain = |name: &&str| !name.starts_with('.') && !name.contains(char::is_control);
    name.filter(is_plain).map(str::to_owned).ok_or_else(|| {
        let expected = "the path of a file whose name is text that does not begin with a dot".to_owned();
        refused(path, expected, "another one".to_owned())
    })
}

/// What is in the file at `path`.
fn content(path: &Path) -> Result<Vec<u8>, SessionError> {
    let expected = || format!("a file of at most {} MiB", LARGEST_BYTES >> 20);
    let about = fs::metadata(path)
        .map_err(|error| refused(path, expected(), format!("none that can be read ({error})")))?;
    if !about.is_file() {
        return Err(refused(path, expected(), "something that is no file".to_owned()));
    }
    if about.len() > LARGEST_BYTES {
        return Err(refused(path, expected(), format!("{} bytes", about.len())));
    }
    fs::read(path).map_err(|error| refused(path, expected(), format!("none that can be read ({error})")))
}

/// Refuses what `dir` holds already with another content.
///
/// # Errors
/// [`SessionError`].
pub(super) fn check(attached: &[Attachment], dir: &Path) -> Result<(), SessionError> {
    for one in attached {
        let path = dir.join(ATTACHMENTS).join(&one.name);
        if path.exists() && sum_of(&path).ok().as_ref() != Some(&one.sha256) {
            let expected = format!("none yet of this name, or the same (SHA-256 {:.12})", one.sha256);
            return Err(refused(&path, expected, "another file".to_owned()));
        }
    }
    Ok(())
}

/// Copies the files at `sources`, which are what `attached` says, into the folder of `dir`, where they are not there yet.
///
/// # Errors
/// [`SessionError`], also if one has changed since it was read.
pub(super) fn copy(sources: &[PathBuf], attached: &[Attachment], dir: &Path) -> Result<(), SessionError> {
    if attached.is_empty() {
        return Ok(());
    }
    let folder = dir.join(ATTACHMENTS);
    fs::create_dir_all(&folder).map_err(|source| FileError::at(&folder, source))?;
    for (source, one) in sources.iter().zip(attached) {
        let path = folder.join(&one.name);
        if path.exists() {
            continue; // the same, by `check`
        }
        let bytes = content(source)?;
        if sum(&bytes) != one.sha256 {
            let expected = format!("the file as it was at first (SHA-256 {:.12})", one.sha256);
            return Err(refused(source, expected, "another one".to_owned()));
        }
        write_whole(&path, &bytes)?;
    }
    Ok(())
}
