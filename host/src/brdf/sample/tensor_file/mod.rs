//! The tensor container of the RGL material database (`.bsdf`): named arrays with a type and a shape.
//!
//! All numbers are little-endian:
//!
//! | bytes | content |
//! |---|---|
//! | 12 | `tensor_file\0` |
//! | 2 | version, 1 and 0 |
//! | 4 | u32 number of fields; then for each field: |
//! | 2 + n | u16 length of the name, the name in UTF-8 |
//! | 2 | u16 number of dimensions d |
//! | 1 | type: 1 u8, 2 i8, 3 u16, 4 i16, 5 u32, 6 i32, 7 u64, 8 i64, 9 f16, 10 f32, 11 f64 |
//! | 8 | u64 offset of the data from the start of the file |
//! | 8 d | u64 shape, the last dimension varies fastest |
//!
//! # Design
//! The file is not trusted. The whole header is checked when the file is opened: every field's data must lie inside
//! the file, with checked arithmetic. Nothing is allocated by a size that the file merely claims. Data are read
//! on demand and converted on the way, so that a file of several hundred megabytes is never in memory twice.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use half::f16;

use super::SampleError;
use crate::base::text::listed;

const MAGIC: &[u8; 12] = b"tensor_file\0";
const VERSION: [u8; 2] = [1, 0];
/// How much of a file that is no tensor file is looked at to say what it is instead.
const SNIFF_BYTES: u64 = 16 * 1024;
/// Bytes converted at once; a multiple of every element size.
const CHUNK_BYTES: usize = 16 * 1024;

/// Names and sizes in bytes of the element types 1, 2, … of the format.
const DTYPES: [(&str, u64); 11] = [
    ("u8", 1),
    ("i8", 1),
    ("u16", 2),
    ("i16", 2),
    ("u32", 4),
    ("i32", 4),
    ("u64", 8),
    ("i64", 8),
    ("f16", 2),
    ("f32", 4),
    ("f64", 8),
];

/// What one dimension of a required field must be.
#[derive(Debug, Clone, Copy)]
pub(super) enum Extent {
    /// This number of entries.
    Exactly(usize),
    /// At least this number of entries.
    AtLeast(usize),
}

/// Values of a field that has been read.
#[derive(Debug)]
pub(super) struct Tensor {
    /// Entries along each dimension, slowest first.
    pub(super) shape: Vec<usize>,
    /// All entries, last dimension fastest; all finite.
    pub(super) values: Vec<f32>,
}

/// A field's entry in the header, its data known to lie inside the file.
#[derive(Debug)]
struct Field {
    /// Index into [`DTYPES`].
    dtype: usize,
    offset: u64,
    shape: Vec<u64>,
}

/// An open tensor file whose header has been checked.
#[derive(Debug)]
pub(super) struct TensorFile<R> {
    reader: R,
    path: PathBuf,
    fields: BTreeMap<String, Field>,
}

impl TensorFile<BufReader<File>> {
    /// Opens the file at `path` and checks its header.
    pub(super) fn open(path: &Path) -> Result<Self, SampleError> {
        let file = File::open(path).map_err(|cause| SampleError::Unreadable {
            path: path.to_owned(),
            cause,
        })?;
        TensorFile::new(BufReader::new(file), path)
    }
}

impl<R: Read + Seek> TensorFile<R> {
    /// Checks the header of the file behind `reader`; `path` is for messages only.
    pub(super) fn new(mut reader: R, path: &Path) -> Result<Self, SampleError> {
        let unreadable = |cause| SampleError::Unreadable {
            path: path.to_owned(),
            cause,
        };
        let file_bytes = reader.seek(SeekFrom::End(0)).map_err(unreadable)?;
        reader.rewind().map_err(unreadable)?;
        let mut head = Vec::new();
        reader
            .by_ref()
            .take(MAGIC.len() as u64)
            .read_to_end(&mut head)
            .map_err(unreadable)?;
        if head != MAGIC {
            reader
                .by_ref()
                .take(SNIFF_BYTES)
                .read_to_end(&mut head)
                .map_err(unreadable)?;
            return Err(file_error(
                path,
                "start of file",
                "an RGL tensor file",
                &describe(&head),
            ));
        }
        let mut header = Header {
            reader: &mut reader,
            path,
            file_bytes,
        };
        let version: [u8; 2] = header.array("version")?;
        if version != VERSION {
            return Err(file_error(
                path,
                "version",
                "1.0",
                &format!("{}.{}", version[0], version[1]),
            ));
        }
        let count = u32::from_le_bytes(header.array("number of fields")?);
        let mut fields = BTreeMap::new();
        for index in 0..count {
            let (name, field) = header.field(index)?;
            let label = name.escape_debug().to_string();
            if fields.insert(name, field).is_some() {
                return Err(file_error(
                    path,
                    &label,
                    "a field once",
                    "a second one of this name",
                ));
            }
        }
        Ok(Self {
            reader,
            path: path.to_owned(),
            fields,
        })
    }

    /// Whether the file has a field of this name.
    pub(super) fn has(&self, name: &str) -> bool {
        self.fields.contains_key(name)
    }

    /// The values of the floating-point field `name` as `f32`, none of them below `lowest`.
    ///
    /// # Errors
    /// The field is missing, is not f16, f32 or f64, has another shape than `extents`, or has a value that is not
    /// finite or below `lowest`.
    pub(super) fn read_f32(
        &mut self,
        name: &str,
        extents: &[Extent],
        lowest: f32,
    ) -> Result<Tensor, SampleError> {
        let mut values = Vec::new();
        let shape = self.each_f32(name, extents, lowest, |shape, at, value| {
            if at == 0 {
                values.reserve_exact(shape.iter().product());
            }
            values.push(value);
        })?;
        Ok(Tensor { shape, values })
    }

    /// Hands the shape of the floating-point field `name`, and number and value of each of its entries in order, to `take`; answers the shape.
    ///
    /// # Errors
    /// Those of [`read_f32`](Self::read_f32).
    pub(super) fn each_f32(
        &mut self,
        name: &str,
        extents: &[Extent],
        lowest: f32,
        mut take: impl FnMut(&[usize], usize, f32),
    ) -> Result<Vec<usize>, SampleError> {
        let (dtype, offset, shape) = self.locate(name, extents, &["f32", "f16", "f64"])?;
        let count: usize = shape.iter().product();
        let (mut at, mut wrong) = (0, None);
        self.read_elements(offset, count, DTYPES[dtype].1 as usize, |bytes| {
            let value = match *bytes {
                [a, b] => f16::from_le_bytes([a, b]).to_f32(),
                [a, b, c, d] => f32::from_le_bytes([a, b, c, d]),
                [a, b, c, d, e, f, g, h] => f64::from_le_bytes([a, b, c, d, e, f, g, h]) as f32,
                _ => f32::NAN,
            };
            if wrong.is_none() && (!value.is_finite() || value < lowest) {
                wrong = Some((at, value));
            }
            take(&shape, at, value);
            at += 1;
        })?;
        let Some((at, value)) = wrong else {
            return Ok(shape);
        };
        let expected = if lowest > f32::MIN {
            format!("a finite value of at least {lowest}")
        } else {
            "a finite value".to_owned()
        };
        let field = format!("{name}, entry {at}");
        Err(file_error(&self.path, &field, &expected, &value.to_string()))
    }

    /// The values of the u8 field `name`.
    pub(super) fn read_u8(&mut self, name: &str, extents: &[Extent]) -> Result<Vec<u8>, SampleError> {
        let (_, offset, shape) = self.locate(name, extents, &["u8"])?;
        let count = shape.iter().product();
        let mut values = Vec::with_capacity(count);
        self.read_elements(offset, count, 1, |bytes| values.extend_from_slice(bytes))?;
        Ok(values)
    }

    /// Type, offset and shape of a field after they were checked against what is required of it.
    fn locate(
        &self,
        name: &str,
        extents: &[Extent],
        dtypes: &[&str],
    ) -> Result<(usize, u64, Vec<usize>), SampleError> {
        let expected = || {
            format!(
                "{} [{}]",
                dtypes.join(" or "),
                list(extents.iter().map(extent_text))
            )
        };
        let Some(field) = self.fields.get(name) else {
            let names = list(
                self.fields
                    .keys()
                    .take(16)
                    .map(|name| name.escape_debug().to_string()),
            );
            return Err(file_error(
                &self.path,
                name,
                &expected(),
                &format!("only the fields {names}"),
            ));
        };
        let shape: Option<Vec<usize>> = field.shape.iter().map(|n| usize::try_from(*n).ok()).collect();
        let dtype_name = DTYPES[field.dtype].0;
        if let Some(shape) = shape
            && dtypes.contains(&dtype_name)
            && shape.len() == extents.len()
            && shape.iter().zip(extents).all(|(n, extent)| match extent {
                Extent::Exactly(m) => n == m,
                Extent::AtLeast(m) => n >= m,
            })
        {
            return Ok((field.dtype, field.offset, shape));
        }
        let found = format!("{dtype_name} [{}]", list(field.shape.iter().map(u64::to_string)));
        Err(file_error(&self.path, name, &expected(), &found))
    }

    /// Hands `count` elements of `size` bytes, from `offset` on, to `take` one by one.
    fn read_elements(
        &mut self,
        offset: u64,
        count: usize,
        size: usize,
        mut take: impl FnMut(&[u8]),
    ) -> Result<(), SampleError> {
        let path = &self.path;
        let unreadable = |cause| SampleError::Unreadable {
            path: path.clone(),
            cause,
        };
        self.reader.seek(SeekFrom::Start(offset)).map_err(unreadable)?;
        let mut chunk = [0; CHUNK_BYTES];
        // No overflow: `open` found that so many bytes lie inside the file.
        let mut left_bytes = count * size;
        while left_bytes > 0 {
            let part = &mut chunk[..left_bytes.min(CHUNK_BYTES)];
            self.reader.read_exact(part).map_err(unreadable)?;
            part.chunks_exact(size).for_each(&mut take);
            left_bytes -= part.len();
        }
        Ok(())
    }
}

/// The part of the file that is being read when it is opened.
struct Header<'a, R> {
    reader: &'a mut R,
    path: &'a Path,
    file_bytes: u64,
}

impl<R: Read> Header<'_, R> {
    /// The next `N` bytes of the header.
    fn array<const N: usize>(&mut self, field: &str) -> Result<[u8; N], SampleError> {
        let mut bytes = [0; N];
        self.fill(&mut bytes, field)?;
        Ok(bytes)
    }

    fn fill(&mut self, bytes: &mut [u8], field: &str) -> Result<(), SampleError> {
        self.reader.read_exact(bytes).map_err(|cause| {
            if cause.kind() == std::io::ErrorKind::UnexpectedEof {
                let found = format!("the end of the file after {} bytes", self.file_bytes);
                file_error(self.path, field, "more of the header", &found)
            } else {
                SampleError::Unreadable {
                    path: self.path.to_owned(),
                    cause,
                }
            }
        })
    }

    /// Name and entry of field number `index`.
    fn field(&mut self, index: u32) -> Result<(String, Field), SampleError> {
        let ordinal = format!("field number {index}");
        let name_bytes = u16::from_le_bytes(self.array(&ordinal)?);
        let mut name = vec![0; usize::from(name_bytes)];
        self.fill(&mut name, &ordinal)?;
        let name = String::from_utf8(name).map_err(|e| {
            let bytes = e.as_bytes().iter().take(16).map(|byte| format!("{byte:02x}"));
            let found = format!("bytes {}", listed(&bytes.collect::<Vec<_>>()));
            file_error(self.path, &ordinal, "a name in UTF-8", &found)
        })?;
        let label = if name.is_empty() {
            ordinal
        } else {
            name.escape_debug().to_string()
        };
        let dimensions = u16::from_le_bytes(self.array(&label)?);
        let [code] = self.array(&label)?;
        let offset = u64::from_le_bytes(self.array(&label)?);
        let dtype = usize::from(code).wrapping_sub(1);
        let Some((dtype_name, element_bytes)) = DTYPES.get(dtype) else {
            return Err(file_error(
                self.path,
                &label,
                "a type from 1 to 11",
                &format!("type {code}"),
            ));
        };
        let mut shape = Vec::new();
        for _ in 0..dimensions {
            shape.push(u64::from_le_bytes(self.array(&label)?));
        }
        let end = shape
            .iter()
            .try_fold(*element_bytes, |bytes, n| bytes.checked_mul(*n))
            .and_then(|bytes| bytes.checked_add(offset));
        if end.is_none_or(|end| end > self.file_bytes) {
            let expected = format!("data inside the file of {} bytes", self.file_bytes);
            let text = list(shape.iter().take(8).map(u64::to_string));
            let found = format!("{dtype_name} [{text}] from byte {offset} on");
            return Err(file_error(self.path, &label, &expected, &found));
        }
        Ok((name, Field { dtype, offset, shape }))
    }
}

/// An error about one `field` of the file at `path`.
pub(super) fn file_error(path: &Path, field: &str, expected: &str, found: &str) -> SampleError {
    SampleError::File {
        path: path.to_owned(),
        field: field.to_owned(),
        expected: expected.to_owned(),
        found: found.to_owned(),
    }
}

/// What a file that begins with `head`, and not with [`MAGIC`], seems to be.
fn describe(head: &[u8]) -> String {
    if head.is_empty() {
        return "an empty file".to_owned();
    }
    if MAGIC.starts_with(head) {
        return format!("the end of the file after {} bytes", head.len());
    }
    let has = |word: &[u8]| head.windows(word.len()).any(|part| part == word);
    if has(b"ScatterType") || has(b"AngleOfIncidence") {
        return "a Zemax text file, another format with the same extension".to_owned();
    }
    if head.trim_ascii_start().starts_with(b"<") {
        return "an XML file".to_owned();
    }
    let start = &head[..head.len().min(12)];
    format!("a file that begins with '{}'", start.escape_ascii())
}

fn extent_text(extent: &Extent) -> String {
    match extent {
        Extent::Exactly(n) => n.to_string(),
        Extent::AtLeast(n) => format!("≥{n}"),
    }
}

fn list(items: impl Iterator<Item = String>) -> String {
    items.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests;
