//! One writer at a time: the lock on what is being written.
//!
//! # Design
//! Who writes a folder holds an exclusive lock on the file [`NAME`] in it, from before the first look at its content to
//! the last write; who makes a file such as a `brdf.zarr` holds one on `<name>.lock` beside it. A second writer is
//! refused in one sentence; readers take no lock and are never kept waiting. The kernel holds the lock, not the
//! file's existence: it is gone with the process, however that ends, and the file that a killed one leaves behind locks
//! nobody out. Those who make parts of a file hold the lock together (a shared lock), who makes the whole holds it alone. The holder, or the last
//! of them, removes the file when it is done. One who opened it before that would then lock a file without
//! a name, therefore the name is looked up again under the lock.
//!
//! The lock is `flock(2)` ([`File::try_lock`]). On a network disk Linux turns it into a byte-range lock that the server
//! keeps (NFS since 2.6.12, SMB since 5.5), so that two machines keep each other out too; the server frees the lock of a
//! machine that has died when its lease ends, with NFSv4 after 90 s. A file system that keeps no locks is refused.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::error::StoreError;

/// Name of the lock in a folder that is written.
pub const NAME: &str = "write.lock";

/// A holder that was killed this very moment may still be on its way out: so often it is waited for, this long each time.
const PATIENCE: u32 = 6;
const MOMENT: Duration = Duration::from_millis(50);

/// The right to write something, until it is dropped.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    /// The open file, whose lock it is.
    file: File,
    _made: Made,
}

/// The folder that was made for a lock; it goes again if nothing else comes into it.
#[derive(Debug)]
struct Made(Option<PathBuf>);

impl Lock {
    /// The right to write in `folder`, which is made if it is not there, and removed again with the lock if it is still
    /// empty then.
    ///
    /// # Errors
    /// [`StoreError::Busy`] if another process has it; [`StoreError::NotAGroup`] for a link that leads nowhere;
    /// [`StoreError::Io`] or [`StoreError::DiskFull`].
    pub fn folder(folder: &Path) -> Result<Self, StoreError> {
        let made = Made((!folder.exists()).then(|| folder.to_owned()));
        make_folder(folder)?;
        Self::take(folder, folder.join(NAME), made, File::try_lock)
    }

    /// The right to write what will be `path`.
    ///
    /// # Errors
    /// As for [`folder`](Self::folder), and [`StoreError::Argument`] for a path without a name.
    pub fn output(path: &Path) -> Result<Self, StoreError> {
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            make_folder(folder)?;
        }
        let lock = super::group::with_suffix(path, ".lock")?;
        Self::take(path, lock, Made(None), File::try_lock)
    }

    /// The right to write parts of what will be `path`, together with others that have it; nobody writes the whole meanwhile.
    ///
    /// # Errors
    /// As for [`output`](Self::output).
    pub fn output_together(path: &Path) -> Result<Self, StoreError> {
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            make_folder(folder)?;
        }
        let lock = super::group::with_suffix(path, ".lock")?;
        Self::take(path, lock, Made(None), File::try_lock_shared)
    }

    /// The right to write beside a measurement in `folder` together with others that have it; nobody changes the measurement meanwhile.
    ///
    /// # Errors
    /// As for [`folder`](Self::folder).
    pub fn folder_together(folder: &Path) -> Result<Self, StoreError> {
        Self::take(folder, folder.join(NAME), Made(None), File::try_lock_shared)
    }

    fn take(
        what: &Path,
        path: PathBuf,
        made: Made,
        try_lock: fn(&File) -> Result<(), TryLockError>,
    ) -> Result<Self, StoreError> {
        let mut patience = PATIENCE;
        loop {
            let mut file = OpenOptions::new()
                .create(true)
                .truncate(false)
                .read(true)
                .write(true)
                .open(&path)
                .map_err(|error| StoreError::io(&path, "create", error))?;
            match try_lock(&file) {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) if patience > 0 => {
                    patience -= 1;
                    std::thread::sleep(MOMENT);
                    continue;
                }
                Err(TryLockError::WouldBlock) => {
                    let mut holder = String::new();
                    // For people only; the holder may not have written it yet.
                    (&file).take(20).read_to_string(&mut holder).ok();
                    return Err(StoreError::Busy {
                        path: what.to_owned(),
                        holder: match holder.trim() {
                            "" => "another process".to_owned(),
                            number => format!("process {number}"),
                        },
                    });
                }
                Err(TryLockError::Error(error)) => {
                    return Err(StoreError::io(
                        &path,
                        "lock (a file system that keeps locks is needed)",
                        error,
                    ));
                }
            }
            if is_at(&file, &path).map_err(|error| StoreError::io(&path, "inspect", error))? {
                let lock = Self {
                    path,
                    file: file
                        .try_clone()
                        .map_err(|error| StoreError::io(what, "lock", error))?,
                    _made: made,
                };
                let noted = file
                    .set_len(0)
                    .and_then(|()| file.rewind())
                    .and_then(|()| write!(file, "{}", std::process::id()));
                noted.map_err(|error| StoreError::io(&lock.path, "write", error))?;
                return Ok(lock);
            }
        }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Still locked: who opens the file from now on makes a new one. If it stays, it locks nobody out. Of those who have it together
        // the last one can have it alone.
        #[cfg(unix)]
        if self.file.try_lock().is_ok() {
            fs::remove_file(&self.path).ok();
        }
    }
}

impl Drop for Made {
    fn drop(&mut self) {
        if let Some(folder) = &self.0 {
            // Only an empty folder can be removed.
            fs::remove_dir(folder).ok();
        }
    }
}

/// Makes `folder` and what is missing above it.
///
/// # Errors
/// [`StoreError::NotAGroup`] names a link in the path that leads nowhere; [`StoreError::Io`], [`StoreError::DiskFull`].
pub fn make_folder(folder: &Path) -> Result<(), StoreError> {
    let taken = |path: &Path, found: &str| StoreError::NotAGroup {
        path: path.to_owned(),
        expected: "a folder, or a free place to make one".to_owned(),
        found: found.to_owned(),
    };
    fs::create_dir_all(folder).map_err(|error| match dangling(folder) {
        Some(link) => taken(link, "a link that leads nowhere"),
        None if folder.is_file() => taken(folder, "a file"),
        None => StoreError::io(folder, "create", error),
    })
}

/// The part of `path` that is a link to what does not exist, if there is one.
#[must_use]
pub fn dangling(path: &Path) -> Option<&Path> {
    path.ancestors().find(|part| part.is_symlink() && !part.exists())
}

/// Whether the open `file` is what is found at `path`.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt as _;
    let ours = file.metadata()?;
    match fs::metadata(path) {
        Ok(there) => Ok((there.dev(), there.ino()) == (ours.dev(), ours.ino())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

/// Elsewhere the file of a lock is never removed.
#[cfg(not(unix))]
fn is_at(_file: &File, _path: &Path) -> io::Result<bool> {
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_who_want_it_at_once_one_has_it_at_a_time() {
        use std::sync::atomic::{AtomicUsize, Ordering};
        let scratch = tempfile::tempdir().unwrap();
        let folder = scratch.path().join("m");
        let (holders, had) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for _ in 0..20 {
                        match Lock::folder(&folder) {
                            Ok(lock) => {
                                assert_eq!(holders.fetch_add(1, Ordering::SeqCst), 0);
                                had.fetch_add(1, Ordering::SeqCst);
                                std::thread::yield_now();
                                holders.fetch_sub(1, Ordering::SeqCst);
                                drop(lock);
                            }
                            // The folder of another may just be going again.
                            Err(StoreError::Busy { .. } | StoreError::Io { .. }) => {}
                            Err(other) => panic!("{other}"),
                        }
                    }
                });
            }
        });
        assert!(had.into_inner() > 0);
        // Who found the folder there leaves it there, without anything in it.
        assert!(fs::read_dir(&folder).map_or(true, |mut entries| entries.next().is_none()));
    }

    #[test]
    fn a_file_that_a_killed_holder_left_locks_nobody_out_and_readers_are_free() {
        let scratch = tempfile::tempdir().unwrap();
        fs::write(scratch.path().join(NAME), "4711").unwrap();
        let lock = Lock::folder(scratch.path()).unwrap();
        let told = Lock::folder(scratch.path()).unwrap_err().to_string();
        assert!(
            told.contains(&format!("process {}", std::process::id())) && !told.contains('\n'),
            "{told}"
        );
        assert!(fs::read_dir(scratch.path()).is_ok());
        drop(lock);
        assert_eq!(fs::read_dir(scratch.path()).unwrap().count(), 0);
    }

    #[test]
    #[cfg(unix)]
    fn a_link_that_leads_nowhere_is_named_wherever_it_stands() {
        let scratch = tempfile::tempdir().unwrap();
        let link = scratch.path().join("link");
        std::os::unix::fs::symlink("nowhere", &link).unwrap();
        for folder in [link.clone(), link.join("below"), link.join("below/that")] {
            for refused in [Lock::folder(&folder), Lock::output(&folder.join("x.zarr"))] {
                let told = refused.unwrap_err().to_string();
                assert!(
                    told.starts_with(&format!("{}: ", link.display())) && told.contains("leads nowhere"),
                    "{told}"
                );
            }
        }
    }
}
