//! A file that is whole or not there.
//!
//! # Design
//! What is written goes into a hidden file of its own beside the target, `.NAME.PID-N.partial`, which is synced to the
//! disk and then takes the target's name. So a reader sees the old file or the new one, never a part; where writing
//! fails (disk full), or is given up, the hidden file goes and the old one is still there. No other file is touched: the
//! hidden one must not have existed. `kill -9` leaves it behind, under a name that [`is_partial`] knows.
//!
//! A link stays a link: the file that it leads to is replaced. A device or a pipe is written as it is, as there is
//! nothing to replace.
//!
//! # Tradeoffs
//! Writing needs the right to make files in the folder, not only to write the file, and a file with several names (hard
//! links) gets one of its own. An old file keeps its permissions, not its owner.

use crate::base::blame::Blame;
use std::ffi::{OsStr, OsString};
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// How names of unfinished files end.
const ENDING: &str = ".partial";
/// Names that are longer, in bytes, do not stand in that of the unfinished file, as most systems take 255.
const LONGEST_NAME: usize = 200;

/// A file that cannot be written or read.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {source}")]
pub struct FileError {
    /// The file.
    pub path: String,
    /// What the system says.
    pub source: io::Error,
}

impl Blame for FileError {
    fn is_input(&self) -> bool {
        false
    }
}

impl FileError {
    /// That of the file at `path`.
    #[must_use]
    pub fn at(path: &Path, source: io::Error) -> Self {
        Self {
            path: path.display().to_string(),
            source,
        }
    }
}

/// A file that is being written. It appears under its name with [`finish`](Self::finish), or never.
#[derive(Debug)]
pub struct WholeFile {
    file: File,
    /// The unfinished file and the name that it will get; `None` for a device, and when it has got it.
    rename: Option<[PathBuf; 2]>,
}

impl WholeFile {
    /// Begins the file at `path`. What is there stays until [`finish`](Self::finish).
    ///
    /// # Errors
    /// What the system says if the file cannot be made, or an old one not be written.
    pub fn create(path: &Path) -> io::Result<Self> {
        let target = resolved(path)?;
        let old = match fs::metadata(&target) {
            Ok(old) => Some(old),
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => return Err(error),
        };
        if let Some(old) = &old {
            if old.is_dir() {
                return Err(io::Error::new(
                    io::ErrorKind::IsADirectory,
                    "expected the name of a file, found a directory",
                ));
            }
            // Nobody loses what they may not write, though the folder would let them.
            let file = OpenOptions::new().write(true).open(&target)?;
            if !old.is_file() {
                return Ok(Self { file, rename: None });
            }
        }
        let name = target.file_name().ok_or_else(|| {
            io::Error::new(
                io::ErrorKind::InvalidFilename,
                "expected the name of a file, found none",
            )
        })?;
        let (file, unfinished) = begin(&target, name)?;
        let whole = Self {
            file,
            rename: Some([unfinished, target.clone()]),
        };
        if let Some(old) = old {
            whole.file.set_permissions(old.permissions())?;
        }
        Ok(whole)
    }

    /// Puts the file under its name, in place of an older one.
    ///
    /// # Errors
    /// What the system says; the older file is still there then.
    pub fn finish(mut self) -> io::Result<()> {
        let Some([unfinished, target]) = &self.rename else {
            return self.file.flush();
        };
        self.file.sync_all()?;
        fs::rename(unfinished, target)?;
        self.rename = None;
        Ok(())
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        if let Some([unfinished, _]) = &self.rename {
            // What went wrong before is the thing to tell; a leftover is hidden and harms nothing.
            fs::remove_file(unfinished).ok();
        }
    }
}

/// Writes `bytes` as the file at `path`, whole or not at all.
///
/// # Errors
/// As [`WholeFile::create`] and [`WholeFile::finish`], and where the disk is full.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = WholeFile::create(path)?;
    file.write_all(bytes)?;
    file.finish()
}

/// As [`write()`], with an error that names the file.
///
/// # Errors
/// [`FileError`].
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    write(path, bytes).map_err(|source| FileError::at(path, source))
}

/// Whether a file can be written at `path`, before the work for it is done. Nothing changes.
///
/// # Errors
/// As [`WholeFile::create`].
pub fn check(path: &Path) -> io::Result<()> {
    WholeFile::create(path).map(drop)
}

/// Removes unfinished files of these `names` in the folder `dir`, which killed processes left; only for names that nobody else writes there
/// now. One that cannot be removed is hidden and harms nothing.
pub(crate) fn sweep(dir: &Path, names: &[&str]) {
    let entries = fs::read_dir(dir).into_iter().flatten().flatten();
    for entry in entries.filter(|entry| is_partial(&entry.file_name())) {
        let name = entry.file_name().to_string_lossy().into_owned();
        // What stands between the first dot and the writer, `PID-N.partial`.
        let of = name[1..name.len() - ENDING.len()].rsplit_once('.');
        if of.is_some_and(|(of, _)| names.contains(&of)) {
            fs::remove_file(entry.path()).ok();
        }
    }
}

/// Whether `name` is that of an unfinished file.
#[must_use]
pub fn is_partial(name: &OsStr) -> bool {
    let Some(middle) = name
        .to_str()
        .and_then(|name| name.strip_prefix('.')?.strip_suffix(ENDING))
    else {
        return false;
    };
    let writer = middle.rsplit('.').next().unwrap_or(middle);
    writer.split_once('-').is_some_and(|(process, number)| {
        [process, number]
            .iter()
            .all(|digits| !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit()))
    })
}

/// The file that `path` names, through links, also where it is not there yet.
fn resolved(path: &Path) -> io::Result<PathBuf> {
    // As many as Linux follows.
    const LINKS: usize = 40;
    let mut at = path.to_owned();
    for _ in 0..LINKS {
        match fs::read_link(&at) {
            Ok(next) => at = at.parent().unwrap_or(Path::new("")).join(next),
            Err(_) => return Ok(at),
        }
    }
    Err(io::Error::other("expected a file, found links in a circle"))
}

/// Makes the unfinished file of `target`, whose last component is `name`.
fn begin(target: &Path, name: &OsStr) -> io::Result<(File, PathBuf)> {
    let mut number = 0_u32;
    loop {
        let mut hidden = OsString::from(".");
        if name.len() <= LONGEST_NAME {
            hidden.push(name);
            hidden.push(".");
        }
        hidden.push(format!("{}-{number}{ENDING}", std::process::id()));
        let path = target.with_file_name(hidden);
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            // Of another thread, or of an earlier process with the same number.
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => number += 1,
            file => return Ok((file?, path)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let name = |entry: io::Result<fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
        let mut names: Vec<String> = fs::read_dir(dir).unwrap().map(name).collect();
        names.sort();
        names
    }

    #[test]
    fn what_is_given_up_leaves_the_old_file_and_no_other() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("scan.svg");
        for neighbour in [
            "scan.tmp",
            "scan.svg.tmp",
            "scan.svg.partial",
            ".scan.svg.partial",
        ] {
            fs::write(dir.path().join(neighbour), "mine").unwrap();
        }
        let before = names(dir.path());
        let mut given_up = WholeFile::create(&path).unwrap();
        given_up.write_all(b"half").unwrap();
        assert!(!path.exists());
        let hidden: Vec<String> = names(dir.path())
            .into_iter()
            .filter(|name| is_partial(OsStr::new(name)))
            .collect();
        assert_eq!(hidden.len(), 1, "{hidden:?}");
        sweep(dir.path(), &["scan", "svg", "session.json"]);
        assert_eq!(names(dir.path()).len(), before.len() + 1);
        drop(given_up);
        assert_eq!(names(dir.path()), before);
        fs::write(dir.path().join(".scan.svg.7-0.partial"), "of one that was killed").unwrap();
        sweep(dir.path(), &["scan.svg"]);
        assert_eq!(names(dir.path()), before);

        write(&path, b"whole").unwrap();
        let mut given_up = WholeFile::create(&path).unwrap();
        given_up.write_all(b"half").unwrap();
        drop(given_up);
        check(&path).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
        write(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(names(dir.path()).len(), before.len() + 1);
        for neighbour in before {
            assert_eq!(fs::read(dir.path().join(neighbour)).unwrap(), b"mine");
        }
    }

    #[test]
    fn files_of_one_stem_and_one_moment_do_not_meet() {
        let dir = tempfile::tempdir().unwrap();
        let mut open: Vec<(WholeFile, String)> = ["a.svg", "a.png", "a", "a.svg", "a.svg"]
            .iter()
            .enumerate()
            .map(|(at, name)| {
                (
                    WholeFile::create(&dir.path().join(name)).unwrap(),
                    format!("{name} {at}"),
                )
            })
            .collect();
        for (file, text) in &mut open {
            file.write_all(text.as_bytes()).unwrap();
        }
        for (file, text) in open {
            file.finish().unwrap();
            let name = text.split(' ').next().unwrap();
            assert_eq!(fs::read_to_string(dir.path().join(name)).unwrap(), text);
        }
        assert_eq!(names(dir.path()), ["a", "a.png", "a.svg"]);
    }

    #[test]
    fn names_of_any_length_that_the_system_takes_do() {
        let dir = tempfile::tempdir().unwrap();
        for length in [1, LONGEST_NAME, LONGEST_NAME + 1, 255] {
            write(&dir.path().join("n".repeat(length)), b"x").unwrap();
        }
        assert_eq!(names(dir.path()).len(), 4);
        assert!(write(&dir.path().join("n".repeat(256)), b"x").is_err());
        assert!(write(dir.path(), b"x").is_err());
        assert!(write(Path::new(""), b"x").is_err());
        assert!(write(&dir.path().join("none/x"), b"x").is_err());
        assert_eq!(names(dir.path()).len(), 4);
    }

    #[cfg(unix)]
    #[test]
    fn links_stay_links_and_devices_devices() {
        use std::os::unix::fs::{FileTypeExt as _, PermissionsExt as _, symlink};
        let dir = tempfile::tempdir().unwrap();
        let (link, behind) = (dir.path().join("link"), dir.path().join("deep/behind"));
        fs::create_dir(dir.path().join("deep")).unwrap();
        symlink("deep/behind", &link).unwrap();
        for text in ["first", "second"] {
            write(&link, text.as_bytes()).unwrap();
            assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
            assert_eq!(fs::read_to_string(&behind).unwrap(), text);
            fs::set_permissions(&behind, fs::Permissions::from_mode(0o640)).unwrap();
        }
        assert_eq!(fs::metadata(&behind).unwrap().permissions().mode() & 0o777, 0o640);
        symlink("circle", dir.path().join("circle")).unwrap();
        assert!(write(&dir.path().join("circle"), b"x").is_err());
        write(Path::new("/dev/null"), b"x").unwrap();
        assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_device_that_takes_nothing_is_an_error() {
        assert!(write(Path::new("/dev/full"), b"x").is_err());
    }
}
