//! A folder of Zarr keys in which a file under its real name is always whole.
//!
//! # Design
//! A value is written to `<name>.tmp-<pid>-<n>` beside its target and then renamed. A reader sees the
//! old file or the new one, never a part. When the write fails (disk full), the temporary is removed
//! and the error returned; after `kill -9` it stays, is never listed, and goes with
//! [`AtomicStore::remove_temporaries`].
//!
//! # Tradeoffs
//! No `fsync`, unlike the file-system store of zarrs: the kernel keeps what a killed process wrote,
//! so the rename alone is enough against `kill -9`, and an `fsync` per chunk would cost more than
//! the chunk. A power cut can tear a file that was already renamed; the CRC-32C in every chunk
//! finds it, and the segment is measured again.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use zarrs::filesystem::FilesystemStore;
use zarrs::storage::byte_range::ByteRangeIterator;
use zarrs::storage::{
    Bytes, ListableStorageTraits, MaybeBytes, MaybeBytesIterator, OffsetBytesIterator, ReadableStorageTraits,
    StorageError, StoreKey, StoreKeys, StoreKeysPrefixes, StorePrefix, WritableStorageTraits,
    store_set_partial_many,
};

use super::StoreError;

/// What stands between a file's real name and the number of the process that is writing it.
const TEMPORARY: &str = ".tmp-";

/// A Zarr store in a folder, with atomic writes.
#[derive(Debug)]
pub struct AtomicStore {
    root: PathBuf,
    files: FilesystemStore,
    /// Number of the next temporary, so that two threads never share one.
    next: AtomicU64,
}

impl AtomicStore {
    /// The store in the folder `root`, which need not exist yet.
    ///
    /// # Errors
    /// [`StoreError::Io`] if the path is not valid UTF-8.
    pub fn new(root: &Path) -> Result<Self, StoreError> {
        let files = FilesystemStore::new(root)
            .map_err(|error| StoreError::io(root, "use as a store", io::Error::other(error.to_string())))?;
        Ok(Self {
            root: root.to_path_buf(),
            files,
            next: AtomicU64::new(0),
        })
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The file that holds `key`.
    pub fn path_of(&self, key: &StoreKey) -> PathBuf {
        self.files.key_to_fspath(key)
    }

    /// Removes what killed writers have left; returns how many files that were.
    ///
    /// Only for the one process that writes this store: the temporary of a living writer would go too.
    ///
    /// # Errors
    /// [`StoreError::Io`] if a folder cannot be listed or a file not removed.
    pub fn remove_temporaries(&self) -> Result<usize, StoreError> {
        remove_temporaries(&self.root)
    }

    fn write_and_rename(&self, target: &Path, value: &[u8]) -> io::Result<()> {
        let mut unfinished = self.begin(target)?;
        unfinished.file().write_all(value)?;
        unfinished.publish()
    }

    /// Begins a file that will be `target`, to be written piece by piece.
    pub(super) fn begin(&self, target: &Path) -> io::Result<Unfinished> {
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        let mut name = target
            .file_name()
            .ok_or(io::ErrorKind::InvalidFilename)?
            .to_owned();
        name.push(format!("{TEMPORARY}{}-{number}", std::process::id()));
        let temporary = target.with_file_name(name);
        Ok(Unfinished {
            file: create_with_folder(&temporary)?,
            temporary,
            target: target.to_owned(),
            is_published: false,
        })
    }
}

/// A file under its temporary name. Dropped before it is published, it goes.
#[derive(Debug)]
pub(super) struct Unfinished {
    file: File,
    temporary: PathBuf,
    target: PathBuf,
    is_published: bool,
}

impl Unfinished {
    /// The file, to write to.
    pub(super) const fn file(&mut self) -> &mut File {
        &mut self.file
    }

    /// Gives it its real name.
    pub(super) fn publish(mut self) -> io::Result<()> {
        fs::rename(&self.temporary, &self.target)?;
        self.is_published = true;
        Ok(())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        if !self.is_published {
            // Why it was not finished is told; if this fails too, the leftover is a temporary.
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

/// Creates the file, and its folder only if that turns out to be missing.
fn create_with_folder(path: &Path) -> io::Result<File> {
    match File::create(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            if let Some(folder) = path.parent() {
                fs::create_dir_all(folder)?;
            }
            File::create(path)
        }
        result => result,
    }
}

/// Whether a file name is that of an unfinished write.
fn is_temporary(name: &str) -> bool {
    name.rsplit_once(TEMPORARY).is_some_and(|(target, writer)| {
        !target.is_empty()
            && writer.split_once('-').is_some_and(|(process, number)| {
                [process, number]
                    .iter()
                    .all(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
            })
    })
}

fn remove_temporaries(folder: &Path) -> Result<usize, StoreError> {
    let mut removed = 0;
    for entry in fs::read_dir(folder).map_err(|error| StoreError::io(folder, "list", error))? {
        let entry = entry.map_err(|error| StoreError::io(folder, "list", error))?;
        let path = entry.path();
        let kind = entry
            .file_type()
            .map_err(|error| StoreError::io(&path, "inspect", error))?;
        if kind.is_dir() {
            removed += remove_temporaries(&path)?;
        } else if entry.file_name().to_str().is_some_and(is_temporary) {
            fs::remove_file(&path).map_err(|error| StoreError::io(&path, "remove", error))?;
            removed += 1;
        }
    }
    Ok(removed)
}

impl WritableStorageTraits for AtomicStore {
    fn set(&self, key: &StoreKey, value: Bytes) -> Result<(), StorageError> {
        Ok(self.write_and_rename(&self.path_of(key), &value)?)
    }

    fn set_partial_many(
        &self,
        key: &StoreKey,
        offset_values: OffsetBytesIterator,
    ) -> Result<(), StorageError> {
        // Reads, changes and writes the whole value: a change in place would not be atomic.
        store_set_partial_many(self, key, offset_values)
    }

    fn erase(&self, key: &StoreKey) -> Result<(), StorageError> {
        self.files.erase(key)
    }

    fn erase_prefix(&self, prefix: &StorePrefix) -> Result<(), StorageError> {
        self.files.erase_prefix(prefix)
    }

    fn supports_set_partial(&self) -> bool {
        false
    }
}

impl ReadableStorageTraits for AtomicStore {
    fn get(&self, key: &StoreKey) -> Result<MaybeBytes, StorageError> {
        match fs::read(self.path_of(key)) {
            Ok(bytes) => Ok(Some(bytes.into())),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    fn get_partial_many<'a>(
        &'a self,
        key: &StoreKey,
        byte_ranges: ByteRangeIterator<'a>,
    ) -> Result<MaybeBytesIterator<'a>, StorageError> {
        self.files.get_partial_many(key, byte_ranges)
    }

    fn size_key(&self, key: &StoreKey) -> Result<Option<u64>, StorageError> {
        self.files.size_key(key)
    }

    fn supports_get_partial(&self) -> bool {
        self.files.supports_get_partial()
    }
}

/// Keys without those of unfinished writes.
fn finished(mut keys: StoreKeys) -> StoreKeys {
    keys.retain(|key| !key.as_str().rsplit('/').next().is_some_and(is_temporary));
    keys
}

impl ListableStorageTraits for AtomicStore {
    fn list(&self) -> Result<StoreKeys, StorageError> {
        self.files.list().map(finished)
    }

    fn list_prefix(&self, prefix: &StorePrefix) -> Result<StoreKeys, StorageError> {
        self.files.list_prefix(prefix).map(finished)
    }

    fn list_dir(&self, prefix: &StorePrefix) -> Result<StoreKeysPrefixes, StorageError> {
        let found = self.files.list_dir(prefix)?;
        Ok(StoreKeysPrefixes::new(
            finished(found.keys().clone()),
            found.prefixes().clone(),
        ))
    }

    fn size_prefix(&self, prefix: &StorePrefix) -> Result<u64, StorageError> {
        self.files.size_prefix(prefix)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(name: &str) -> StoreKey {
        StoreKey::new(name).unwrap()
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn what_is_set_is_got_and_nothing_else_is_left_in_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        let store = AtomicStore::new(folder.path()).unwrap();
        for value in [&b"first"[..], b"", b"a third and longer value"] {
            store.set(&key("a/b/c.0"), Bytes::copy_from_slice(value)).unwrap();
            assert_eq!(store.get(&key("a/b/c.0")).unwrap().unwrap(), value);
        }
        assert_eq!(names(&folder.path().join("a/b")), ["c.0"]);
        assert!(store.get(&key("a/b/c.1")).unwrap().is_none());
    }

    #[test]
    fn a_partial_set_changes_only_its_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let store = AtomicStore::new(folder.path()).unwrap();
        store.set(&key("v"), Bytes::from_static(b"0123456789")).unwrap();
        store
            .set_partial(&key("v"), 3, Bytes::from_static(b"abc"))
            .unwrap();
        assert_eq!(store.get(&key("v")).unwrap().unwrap(), &b"012abc6789"[..]);
    }

    #[test]
    fn temporaries_are_neither_listed_nor_kept_when_swept() {
        let folder = tempfile::tempdir().unwrap();
        let store = AtomicStore::new(folder.path()).unwrap();
        store.set(&key("f/c.0"), Bytes::from_static(b"whole")).unwrap();
        fs::write(folder.path().join("f/c.1.tmp-4711-0"), b"half").unwrap();
        // Names that only look similar are somebody's files.
        fs::write(folder.path().join("f/notes.tmp-old"), b"mine").unwrap();

        let whole = vec![key("f/c.0"), key("f/notes.tmp-old")];
        assert_eq!(store.list().unwrap(), whole);
        assert_eq!(
            store.list_prefix(&StorePrefix::new("f/").unwrap()).unwrap(),
            whole
        );
        let mut in_folder = store
            .list_dir(&StorePrefix::new("f/").unwrap())
            .unwrap()
            .keys()
            .clone();
        in_folder.sort();
        assert_eq!(in_folder, whole);
        assert_eq!(store.remove_temporaries().unwrap(), 1);
        assert_eq!(names(&folder.path().join("f")), ["c.0", "notes.tmp-old"]);
    }

    #[test]
    fn threads_that_set_the_same_key_leave_one_whole_value() {
        let folder = tempfile::tempdir().unwrap();
        let store = AtomicStore::new(folder.path()).unwrap();
        std::thread::scope(|scope| {
            for byte in 0..4u8 {
                let store = &store;
                scope.spawn(move || {
                    for _ in 0..50 {
                        store
                            .set(&key("v"), vec![byte; 10_000 + usize::from(byte)].into())
                            .unwrap();
                        let read = store.get(&key("v")).unwrap().unwrap();
                        assert_eq!(read.len(), 10_000 + usize::from(read[0]));
                        assert!(read.iter().all(|&b| b == read[0]));
                    }
                });
            }
        });
        assert_eq!(names(folder.path()), ["v"]);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_is_told_and_leaves_the_old_value_and_no_temporary() {
        let folder = tempfile::tempdir().unwrap();
        let store = AtomicStore::new(folder.path()).unwrap();
        store.set(&key("v"), Bytes::from_static(b"old")).unwrap();
        // The next temporary leads to the device that is always full.
        let temporary = folder.path().join(format!("v.tmp-{}-1", std::process::id()));
        std::os::unix::fs::symlink("/dev/full", &temporary).unwrap();

        let error = store.set(&key("v"), Bytes::from_static(b"new")).unwrap_err();
        let StorageError::IOError(source) = &error else {
            panic!("{error}")
        };
        assert_eq!(source.kind(), io::ErrorKind::StorageFull);
        assert!(matches!(
            StoreError::storage(folder.path(), "write", error),
            StoreError::DiskFull { .. }
        ));
        assert_eq!(names(folder.path()), ["v"]);
        assert_eq!(store.get(&key("v")).unwrap().unwrap(), &b"old"[..]);
    }

    #[test]
    fn a_path_that_cannot_be_made_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("file"), b"").unwrap();
        let store = AtomicStore::new(folder.path()).unwrap();
        assert!(store.set(&key("file/c.0"), Bytes::from_static(b"x")).is_err());
        assert_eq!(names(folder.path()), ["file"]);
    }
}
