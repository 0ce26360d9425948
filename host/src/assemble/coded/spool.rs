//! What cells and blocks show, on disk between the frames and the rows.
//!
//! # Design
//! The cells of a block are a comb over all incident directions, and a chunk of `brdf.zarr` holds neighbours. So the images of
//! the cells go into a file as blocks are done, and are read in the order of the chunks. The file stands in the directory of
//! the result until that is whole, and goes with it if it never is.

use std::fs::{File, OpenOptions};
use std::io::{Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::store::StoreError;

/// Images of numbers, all of one size.
pub(super) struct Spool {
    file: Mutex<File>,
    path: PathBuf,
    /// Numbers of an image.
    length: usize,
}

impl Spool {
    /// An empty one in the directory `folder`, for images of `length` numbers.
    pub(super) fn create(folder: &Path, length: usize) -> Result<Self, StoreError> {
        let path = folder.join("cells.tmp");
        let mut options = OpenOptions::new();
        let file = options
            .read(true)
            .write(true)
            .create(true)
            .truncate(true)
            .open(&path);
        Ok(Self {
            file: Mutex::new(file.map_err(|error| StoreError::io(&path, "create", error))?),
            path,
            length,
        })
    }

    /// Puts `images` at the place `first` and those behind it.
    pub(super) fn write(&self, first: usize, images: &[f32]) -> Result<(), StoreError> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(self.offset(first)))
            .and_then(|_| file.write_all(bytemuck::cast_slice(images)))
            .map_err(|error| StoreError::io(&self.path, "write", error))
    }

    /// The `count` images from the place `first` on.
    pub(super) fn read(&self, first: usize, count: usize) -> Result<Vec<f32>, StoreError> {
        let mut images = vec![0.0_f32; count * self.length];
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(self.offset(first)))
            .and_then(|_| file.read_exact(bytemuck::cast_slice_mut(&mut images)))
            .map_err(|error| StoreError::io(&self.path, "read", error))?;
        Ok(images)
    }

    const fn offset(&self, place: usize) -> u64 {
        (place * self.length * size_of::<f32>()) as u64
    }

    /// Removes it.
    pub(super) fn remove(self) -> Result<(), StoreError> {
        let Self { file, path, .. } = self;
        drop(file);
        std::fs::remove_file(&path).map_err(|error| StoreError::io(&path, "remove", error))
    }
}
