//! `brdf.zarr`: f, its standard uncertainty and its provenance, for every pair of directions.
//!
//! # Design
//! | array | axes | type | unit | no data |
//! |---|---|---|---|---|
//! | `f` | incident, y, x, channel | f32 | sr⁻¹, without the cosine | NaN |
//! | `sigma` | incident, y, x, channel | f16 | sr⁻¹, standard uncertainty (k = 1) | NaN |
//! | `provenance` | incident, y, x | u8 | codes of [`Provenance`] | 0 |
//!
//! What stands under *no data* is the declared fill value too, so that any reader sees it in an absent chunk as well, and
//! means over `f` are those of what was measured. How the three arrays go together says [`BrdfRows`].
//!
//! `y`, `x` are the outgoing disk grid. Incident directions, reasons and whatever else describes the
//! axes come as [`SmallArray`]s and are coordinates for xarray.
//! A chunk is one or more whole incident directions; an absent one is all missing.
//! Files of version 1 have 0 where there is no value, and only provenance tells: they read as if they had NaN there.
//! The writer works in `<name>.partial` and renames it when it is done: a result under its final
//! name is whole. Several threads may write and read different chunks at a time.
//!
//! Chunks are compressed by zstd. Measured values end in noise, which does not compress: a file whose attribute [`ROUNDED`] says so
//! has values and uncertainties rounded on the way into it ([`BrdfRows::round`]), by no more than that share of σ.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::{Map, Value};

use super::array::{ArraySpec, ElementType, ZarrArray};
use super::atomic::AtomicStore;
use super::brdf_rows::BrdfRows;
use super::described::{add_codes, described};
use super::error::StoreError;
use super::group;
use super::header::Header;
use super::lock::Lock;
use super::small_array::{self, SmallArray, SmallData};
use crate::store::provenance::Provenance;

/// Name of the format in the group's attributes.
const FORMAT: &str = "brdf";
/// Names of the three arrays.
const F: &str = "f";
const SIGMA: &str = "sigma";
const PROVENANCE: &str = "provenance";
/// Attribute of files with rounded values: the most that f is rounded by, over σ.
pub const ROUNDED: &str = "rounded_to_sigma";
/// The last version whose files have 0 where there is no value.
const ZEROS_VERSION: u64 = 1;
/// Axes of `f` and `sigma`; `provenance` has all but the last.
const DIMS: &[&str] = &["incident", "y", "x", "channel"];

/// Size of a `brdf.zarr`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BrdfLayout {
    /// Incident directions.
    pub incident: usize,
    /// Cells along each axis of the outgoing disk grid.
    pub grid: usize,
    /// Colour channels.
    pub channels: usize,
    /// Incident directions per chunk.
    pub chunk: usize,
}

impl BrdfLayout {
    fn spec(&self, name: &'static str, element: ElementType, rank: usize) -> ArraySpec<'static> {
        let shape = [self.incident, self.grid, self.grid, self.channels];
        ArraySpec {
            name,
            element,
            shape: shape[..rank].to_vec(),
            chunk: self.chunk,
            dims: &DIMS[..rank],
            packed: true,
        }
    }

    fn f(&self) -> ArraySpec<'static> {
        self.spec(F, ElementType::F32, 4)
    }

    fn sigma(&self) -> ArraySpec<'static> {
        self.spec(SIGMA, ElementType::F16, 4)
    }

    fn provenance(&self) -> ArraySpec<'static> {
        self.spec(PROVENANCE, ElementType::U8, 3)
    }

    /// Length of each axis by name.
    fn lengths(&self) -> BTreeMap<String, usize> {
        let lengths = [self.incident, self.grid, self.grid, self.channels];
        DIMS.iter().map(|&dim| dim.to_owned()).zip(lengths).collect()
    }
}

/// A `brdf.zarr` that is being made.
#[derive(Debug)]
pub struct BrdfWriter {
    _lock: Lock,
    path: PathBuf,
    partial: PathBuf,
    overwrite: bool,
    store: Arc<AtomicStore>,
    /// Of the group, and the metadata of its arrays.
    attributes: Map<String, Value>,
    metadata: Map<String, Value>,
    layout: BrdfLayout,
    f: ZarrArray,
    sigma: ZarrArray,
    provenance: ZarrArray,
}

impl BrdfWriter {
    /// Begins the file that will be `path` once it is finished, with the coordinates `extra`
    /// and these attributes of the group (`rcg_…` names are the store's own).
    ///
    /// An older unfinished file is removed. With `overwrite` an existing `brdf.zarr` is replaced
    /// when the new one is finished; a folder of another kind never is.
    ///
    /// # Errors
    /// [`StoreError::AlreadyExists`] without `overwrite`; [`StoreError::NotAGroup`] with it, if
    /// `path` is something else; [`StoreError::Argument`] for a layout with an empty axis or
    /// arrays that do not fit it; [`StoreError::Io`] or [`StoreError::DiskFull`].
    pub fn create(
        path: &Path,
        layout: BrdfLayout,
        extra: &[SmallArray<'_>],
        attributes: Map<String, Value>,
        overwrite: bool,
    ) -> Result<Self, StoreError> {
        layout.f().check(path)?;
        small_array::check(path, extra, layout.lengths(), &[F, SIGMA, PROVENANCE])?;
        let lock = Lock::output(path)?;
        let partial = group::start(path, FORMAT, overwrite)?;
        let store = Arc::new(AtomicStore::new(&partial)?);

        let mut about_f = described("sr-1", "BRDF, without the cosine");
        about_f.insert(
            "ancillary_variables".into(),
            format!("{SIGMA} {PROVENANCE}").into(),
        );
        if !extra.is_empty() {
            let names: Vec<&str> = extra.iter().map(|array| array.name).collect();
            about_f.insert("coordinates".into(), names.join(" ").into());
        }
        let f = ZarrArray::create(&store, &layout.f(), about_f)?;
        let about_sigma = described("sr-1", "standard uncertainty (k=1) of the BRDF");
        let sigma = ZarrArray::create(&store, &layout.sigma(), about_sigma)?;
        let mut about_provenance = described("1", "provenance of the BRDF");
        add_codes(
            &mut about_provenance,
            &Provenance::ALL.map(|origin| (origin.code(), origin.name())),
        );
        let provenance = ZarrArray::create(&store, &layout.provenance(), about_provenance)?;
        let small = extra.iter().map(|array| small_array::write(&store, array));
        let small = small.collect::<Result<Vec<_>, _>>()?;

        let arrays = [&f, &sigma, &provenance].into_iter().chain(&small);
        let metadata = arrays
            .map(|array| (array.name().to_owned(), array.metadata()))
            .collect();
        let attributes = group::attributes_of(FORMAT, attributes);
        group::write(&store, &attributes, &metadata)?;
        Ok(Self {
            _lock: lock,
            path: path.to_path_buf(),
            partial,
            overwrite,
            store,
            attributes,
            metadata,
            layout,
            f,
            sigma,
            provenance,
        })
    }

    /// The size of the file.
    pub fn layout(&self) -> &BrdfLayout {
        &self.layout
    }

    /// Writes chunk `index`; in any order, from any thread, each chunk by one thread at a time.
    ///
    /// # Errors
    /// [`StoreError::Argument`] if there is no such chunk, a length is not that of its incident directions, or f, sigma and
    /// provenance contradict each other; [`StoreError::Io`] or [`StoreError::DiskFull`].
    pub fn write_chunk(&self, index: usize, rows: &BrdfRows) -> Result<(), StoreError> {
        let mut rounded;
        let rows = if self.attributes.contains_key(ROUNDED) {
            rounded = rows.clone();
            rounded.round();
            &rounded
        } else {
            rows
        };
        self.f.check_len(index, rows.f.len())?;
        self.sigma.check_len(index, rows.sigma.len())?;
        self.provenance.check_len(index, rows.provenance.len())?;
        if let Some((sample, array, expected, found)) = rows.contradiction() {
            let what = format!("`{array}` of sample {sample} for chunk {index}");
            return Err(StoreError::argument(&self.path, what, expected, found));
        }
        self.provenance.write(index, &rows.provenance)?;
        self.sigma.write(index, &rows.sigma)?;
        self.f.write(index, &rows.f)
    }

    /// Whether `part` says of itself what this file does, but for what is only known when all chunks are written and the attribute `without`.
    #[must_use]
    pub fn is_of_same_origin(&self, part: &BrdfReader, without: &str) -> bool {
        let sum = |attributes| group::sum_of(attributes, &[without]);
        sum(&self.attributes) == sum(&part.attributes)
    }

    /// Where the file is until it has its final name; what was written of it can be read there.
    #[must_use]
    pub fn partial_path(&self) -> &Path {
        &self.partial
    }

    /// Writes the values of a coordinate anew that was given to [`create`](Self::create), in the same shape: for what is
    /// only known when the chunks are written.
    ///
    /// # Errors
    /// [`StoreError::Io`] or [`StoreError::DiskFull`].
    pub fn rewrite(&self, array: &SmallArray<'_>) -> Result<(), StoreError> {
        small_array::write(&self.store, array).map(drop)
    }

    /// Adds an attribute of the group, or changes it: for what is only known when the chunks are written.
    ///
    /// # Errors
    /// [`StoreError::Io`] or [`StoreError::DiskFull`].
    pub fn state(&mut self, name: &str, value: Value) -> Result<(), StoreError> {
        self.attributes.insert(name.to_owned(), value);
        group::write(&self.store, &self.attributes, &self.metadata)
    }

    /// Gives the file its final name. Chunks that were not written are missing values.
    ///
    /// # Errors
    /// [`StoreError::AlreadyExists`] if the path was taken meanwhile; [`StoreError::Io`].
    pub fn finish(self) -> Result<(), StoreError> {
        group::publish(&self.partial, &self.path, FORMAT, self.overwrite)
    }
}

/// An open `brdf.zarr`.
#[derive(Debug)]
pub struct BrdfReader {
    store: Arc<AtomicStore>,
    layout: BrdfLayout,
    attributes: Map<String, Value>,
    /// Whether what has no value is NaN; else only its provenance tells.
    has_nan: bool,
    f: ZarrArray,
    sigma: ZarrArray,
    provenance: ZarrArray,
}

impl BrdfReader {
    /// Opens a file; its layout comes from its metadata.
    ///
    /// # Errors
    /// [`StoreError::NotAGroup`], [`StoreError::ArrayMissing`], [`StoreError::Metadata`] or
    /// [`StoreError::Io`].
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        let attributes = group::read_attributes(path, FORMAT)?;
        let store = Arc::new(AtomicStore::new(path)?);
        let header = Header::read(&store, F, Some(4))?;
        let (shape, chunk) = (&header.shape, header.chunk_shape[0]);
        let layout = BrdfLayout {
            incident: shape[0],
            grid: shape[1],
            channels: shape[3],
            chunk,
        };
        let f = ZarrArray::open(&store, &layout.f(), &header)?;
        let sigma = ZarrArray::open(&store, &layout.sigma(), &Header::read(&store, SIGMA, Some(4))?)?;
        let header = Header::read(&store, PROVENANCE, Some(3))?;
        let provenance = ZarrArray::open(&store, &layout.provenance(), &header)?;
        Ok(Self {
            store,
            layout,
            has_nan: group::version_of(&attributes) > ZEROS_VERSION,
            attributes,
            f,
            sigma,
            provenance,
        })
    }

    /// The size of the file.
    pub fn layout(&self) -> &BrdfLayout {
        &self.layout
    }

    /// All attributes of the group.
    pub fn attributes(&self) -> &Map<String, Value> {
        &self.attributes
    }

    /// Refuses attributes of the file at `path` that something has changed since they were written; those of files without a checksum pass.
    ///
    /// # Errors
    /// [`StoreError::Metadata`].
    pub fn check_attributes(&self, path: &Path) -> Result<(), StoreError> {
        group::check_sum(path, &self.attributes)
    }

    /// Number of chunks, the last perhaps shorter.
    pub fn chunks(&self) -> usize {
        self.f.chunks()
    }

    /// The incident directions of chunk `index`; empty beyond the last chunk.
    pub fn chunk_range(&self, index: usize) -> std::ops::Range<usize> {
        self.f.range(index)
    }

    /// Whether anything of chunk `index` was written; if only a part of it was, reading says so.
    pub fn chunk_is_present(&self, index: usize) -> bool {
        [&self.f, &self.sigma, &self.provenance]
            .iter()
            .any(|array| array.is_present(index))
    }

    /// The values of the small array `name`, row-major.
    ///
    /// # Errors
    /// [`StoreError::ArrayMissing`], [`StoreError::Metadata`], [`StoreError::Checksum`],
    /// [`StoreError::Chunk`] or [`StoreError::Io`].
    pub fn small(&self, name: &str) -> Result<SmallData, StoreError> {
        small_array::read(&self.store, name)
    }

    /// Reads chunk `index`; if it was never written, all of it is [`Provenance::Missing`].
    ///
    /// # Errors
    /// [`StoreError::Checksum`] or [`StoreError::Chunk`] if a part of it is damaged, only some of its arrays are there, or
    /// they contradict each other; [`StoreError::Argument`] if there is no such chunk; [`StoreError::Io`].
    pub fn read_chunk(&self, index: usize) -> Result<BrdfRows, StoreError> {
        if index < self.chunks() && !self.chunk_is_present(index) {
            let samples = self.provenance.len(index);
            return Ok(BrdfRows::missing(samples, self.layout.channels));
        }
        let mut rows = BrdfRows {
            f: self.f.read_present(index)?,
            sigma: self.sigma.read_present(index)?,
            provenance: self.provenance.read_present(index)?,
        };
        if !self.has_nan {
            rows.seal();
        }
        match rows.contradiction() {
            None => Ok(rows),
            Some((sample, array, expected, found)) => {
                let file = if array == F { &self.f } else { &self.sigma };
                Err(StoreError::Chunk {
                    path: file.path_of(index),
                    array: array.to_owned(),
                    chunk: index,
                    expected: format!("{expected}, at sample {sample} of the chunk"),
                    found,
                })
            }
        }
    }
}

#[cfg(test)]
mod tests;
