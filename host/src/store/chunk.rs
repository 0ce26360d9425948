//! A chunk that is written piece by piece, without a copy of it in memory.
//!
//! # Design
//! The bytes are those that zarrs makes of the same numbers with the codecs of [`ZarrArray`] (`bytes`, little-endian, then `crc32c`): the
//! rows in order, padded to a whole chunk with what stands for no data, and the CRC-32C of all that (Castagnoli; the registry of Zarr codecs,
//! `crc32c` 1.0). The checksum grows with the pieces, which the system takes from where they lie.

use std::fs::File;
use std::io::{self, IoSlice, Write as _};

use super::array::ZarrArray;
use super::atomic::Unfinished;
use super::error::StoreError;

/// Bytes of padding that are written at a time.
const PADDING: usize = 1 << 16;

/// A chunk on its way to its file.
#[derive(Debug)]
pub(super) struct ChunkWriter<'a> {
    array: &'a ZarrArray,
    index: usize,
    file: Unfinished,
    checksum: u32,
    written: usize,
}

impl<'a> ChunkWriter<'a> {
    /// Begins chunk `index` of `array`; an older one stays until this one is finished.
    pub(super) fn begin(array: &'a ZarrArray, index: usize) -> Result<Self, StoreError> {
        array.check_index(index)?;
        let file = array
            .begin_file(index)
            .map_err(|error| StoreError::io(&array.path_of(index), "write", error))?;
        Ok(Self {
            array,
            index,
            file,
            checksum: 0,
            written: 0,
        })
    }

    /// Adds `pieces`, one behind the other: little-endian bytes of elements.
    pub(super) fn push(&mut self, pieces: &[&[u8]]) -> Result<(), StoreError> {
        let total: usize = pieces.iter().map(|piece| piece.len()).sum();
        let room = self.array.bytes_of(self.index) - self.written;
        if total > room {
            let what = format!("data for chunk {} of `{}`", self.index, self.array.name());
            let path = self.array.path_of(self.index);
            return Err(StoreError::argument(
                &path,
                what,
                format!("at most {room} bytes more"),
                format!("{total} bytes"),
            ));
        }
        self.put(pieces)
    }

    fn put(&mut self, pieces: &[&[u8]]) -> Result<(), StoreError> {
        let mut slices: Vec<IoSlice<'_>> = Vec::with_capacity(pieces.len());
        for piece in pieces {
            self.checksum = crc32c::crc32c_append(self.checksum, piece);
            self.written += piece.len();
            slices.push(IoSlice::new(piece));
        }
        write_all(self.file.file(), &mut slices)
            .map_err(|error| StoreError::io(&self.array.path_of(self.index), "write", error))
    }

    /// Bytes of elements that are still missing.
    pub(super) fn missing(&self) -> usize {
        self.array.bytes_of(self.index) - self.written
    }

    /// Gives the chunk its name. All of its elements are there, or those that are missing are no data.
    pub(super) fn finish(mut self) -> Result<(), StoreError> {
        let whole = self.array.chunk_bytes();
        let element = self.array.no_data();
        let padding = element.repeat(PADDING / element.len());
        while self.written < whole {
            let piece = &padding[..padding.len().min(whole - self.written)];
            self.put(&[piece])?;
        }
        let checksum = self.checksum.to_le_bytes();
        let path = self.array.path_of(self.index);
        self.file
            .file()
            .write_all(&checksum)
            .and_then(|()| self.file.publish())
            .map_err(|error| StoreError::io(&path, "write", error))
    }
}

/// Writes all `slices`, many with one call of the system.
fn write_all(file: &mut File, mut slices: &mut [IoSlice<'_>]) -> io::Result<()> {
    // Empty ones in front would be taken for a file that takes no more.
    IoSlice::advance_slices(&mut slices, 0);
    while !slices.is_empty() {
        match file.write_vectored(slices) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(count) => IoSlice::advance_slices(&mut slices, count),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use serde_json::{Map, json};

    use super::super::array::{ArraySpec, ElementType};
    use super::super::atomic::AtomicStore;
    use super::*;

    /// An array of 7 rows of 5 elements in chunks of 3 rows, with 9 for no data.
    fn array(folder: &std::path::Path) -> ZarrArray {
        let store = Arc::new(AtomicStore::new(folder).unwrap());
        let spec = ArraySpec {
            name: "a",
            element: ElementType::U16,
            shape: vec![7, 5],
            chunk: 3,
            dims: &["y", "x"],
            packed: false,
        };
        let mut about = Map::new();
        about.insert("_FillValue".into(), json!(9));
        ZarrArray::create(&store, &spec, about).unwrap()
    }

    #[test]
    fn pieces_of_any_length_make_the_file_that_zarrs_makes() {
        let folder = tempfile::tempdir().unwrap();
        let array = array(folder.path());
        for (index, rows) in [(0, 3), (2, 1)] {
            let values: Vec<u16> = (0..rows * 5).map(|at| at * 4099 + 17).collect();
            array.write(index, &values).unwrap();
            let expected = std::fs::read(array.path_of(index)).unwrap();
            let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
            for length in [1, 3, 7, 30] {
                array.erase(index).unwrap();
                let mut writer = ChunkWriter::begin(&array, index).unwrap();
                let pieces: Vec<&[u8]> = bytes.chunks(length).collect();
                writer.push(&pieces[..1]).unwrap();
                assert!(!array.is_present(index));
                // Empty pieces are nothing.
                writer.push(&[&[], &[]]).unwrap();
                writer.push(&pieces[1..]).unwrap();
                assert_eq!(writer.missing(), 0);
                assert!(
                    writer
                        .push(&[&[0]])
                        .unwrap_err()
                        .to_string()
                        .contains("at most 0 bytes more")
                );
                writer.finish().unwrap();
                assert_eq!(std::fs::read(array.path_of(index)).unwrap(), expected, "{length}");
                assert_eq!(array.read_present::<u16>(index).unwrap(), values);
            }
        }
    }

    #[test]
    fn a_chunk_that_is_not_finished_leaves_the_old_one_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let array = array(folder.path());
        array.write(1, &[1_u16; 15]).unwrap();
        let mut writer = ChunkWriter::begin(&array, 1).unwrap();
        writer.push(&[&[2; 10]]).unwrap();
        drop(writer);
        assert_eq!(array.read_present::<u16>(1).unwrap(), [1; 15]);
        let names = std::fs::read_dir(folder.path().join("a")).unwrap().count();
        assert_eq!(names, 2);
        // What is missing is no data.
        let mut writer = ChunkWriter::begin(&array, 1).unwrap();
        writer.push(&[&[2, 0, 3, 0]]).unwrap();
        writer.finish().unwrap();
        let mut expected = [9; 15];
        (expected[0], expected[1]) = (2, 3);
        assert_eq!(array.read_present::<u16>(1).unwrap(), expected);
    }
}
