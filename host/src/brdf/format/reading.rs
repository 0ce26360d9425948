//! What readers share: files that are not trusted.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use crate::brdf::sample::SampleError;

/// Bytes that tell formats apart.
const HEAD: u64 = 16 * 1024;
/// Bytes of the largest file that is read as a whole.
const MOST_BYTES: u64 = 2_000_000_000;

/// The first bytes of the file at `path`.
pub(super) fn head(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut head = Vec::new();
    File::open(path)?.take(HEAD).read_to_end(&mut head)?;
    Ok(head)
}

/// All of the file at `path`, which may have `most` bytes.
pub(super) fn bytes(path: &Path, most: u64) -> Result<Vec<u8>, SampleError> {
    let unreadable = |cause| SampleError::Unreadable {
        path: path.to_owned(),
        cause,
    };
    let most = most.min(MOST_BYTES);
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(unreadable)?;
    file.take(most + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > most {
        return Err(wrong(path, "size", &format!("at most {most} bytes"), "more"));
    }
    Ok(bytes)
}

/// All of the file at `path` as text.
pub(super) fn text(path: &Path, most: u64) -> Result<String, SampleError> {
    String::from_utf8(bytes(path, most)?).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        wrong(path, "text", "UTF-8", &format!("something else at byte {at}"))
    })
}

/// What is wrong with a file.
pub(super) fn wrong(path: &Path, field: &str, expected: &str, found: &str) -> SampleError {
    SampleError::File {
        path: path.to_owned(),
        field: field.to_owned(),
        expected: expected.to_owned(),
        found: found.to_owned(),
    }
}
