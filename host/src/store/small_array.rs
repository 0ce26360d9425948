//! Coordinates and masks that stand beside the big arrays of a file: angles, reasons, wavelengths.
//!
//! # Design
//! A small array is one chunk, written when the file is made and read as a whole. Should the chunk be lost, other programs
//! read NaN, or `NO_CODE` where 0 is a code like any other.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::array::{ArraySpec, ElementType, ZarrArray};
use super::atomic::AtomicStore;
use super::described::{add_codes, described};
use super::error::StoreError;
use super::header::Header;
use crate::base::text::{by, listed};

/// What stands in an array of codes for no code at all.
const NO_CODE: u8 = 255;

/// Values of a small array, row-major.
#[derive(Clone, Debug, PartialEq)]
pub enum SmallData {
    /// Real numbers.
    F64(Vec<f64>),
    /// Codes or masks.
    U8(Vec<u8>),
}

impl SmallData {
    /// Number of values.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::F64(values) => values.len(),
            Self::U8(values) => values.len(),
        }
    }

    /// Whether there are no values.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The real numbers, or `None` if these are codes.
    #[must_use]
    pub fn as_f64(&self) -> Option<&[f64]> {
        match self {
            Self::F64(values) => Some(values),
            Self::U8(_) => None,
        }
    }

    /// The codes, or `None` if these are real numbers.
    #[must_use]
    pub fn as_u8(&self) -> Option<&[u8]> {
        match self {
            Self::U8(values) => Some(values),
            Self::F64(_) => None,
        }
    }
}

/// A small array to write.
#[derive(Clone, Debug, PartialEq)]
pub struct SmallArray<'a> {
    /// Name in the group: letters, digits and `_`.
    pub name: &'a str,
    /// Name of each axis.
    pub dims: &'a [&'a str],
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// The values, row-major.
    pub data: SmallData,
    /// Unit of the values, `1` for none.
    pub units: &'a str,
    /// What the values are.
    pub long_name: &'a str,
    /// Word for each code, if the values are codes; else empty.
    pub codes: &'a [(u8, &'a str)],
}

fn is_name(name: &str) -> bool {
    !name.is_empty()
        && !name.starts_with("__")
        && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
}

/// Checks that the arrays fit each other and the axes in `lengths`, and that `taken` names stay free.
pub(super) fn check(
    root: &std::path::Path,
    arrays: &[SmallArray<'_>],
    mut lengths: BTreeMap<String, usize>,
    taken: &[&str],
) -> Result<(), StoreError> {
    let mut names: Vec<&str> = taken.to_vec();
    for array in arrays {
        let wrong = |expected: String, found: String| {
            Err(StoreError::argument(
                root,
                format!("array `{}`", array.name),
                expected,
                found,
            ))
        };
        if !is_name(array.name) || names.contains(&array.name) {
            return wrong(
                "a free name of letters, digits and _".into(),
                format!("`{}`", array.name),
            );
        }
        names.push(array.name);
        if array.shape.is_empty() || array.shape.len() != array.dims.len() {
            return wrong(
                format!("one length for each of {}", listed(array.dims)),
                by(&array.shape),
            );
        }
        for (&dim, &length) in array.dims.iter().zip(&array.shape) {
            let expected = *lengths.entry(dim.to_owned()).or_insert(length);
            if expected != length {
                return wrong(format!("length {expected} along `{dim}`"), length.to_string());
            }
        }
        let size = array
            .shape
            .iter()
            .try_fold(1usize, |product, &length| product.checked_mul(length));
        if size != Some(array.data.len()) {
            return wrong(
                format!("the values of shape {}", by(&array.shape)),
                format!("{} values", array.data.len()),
            );
        }
        if !array.codes.is_empty() && array.data.as_u8().is_none() {
            return wrong("codes only for u8 values".into(), "codes for f64 values".into());
        }
    }
    Ok(())
}

/// Makes the array and writes its values.
pub(super) fn write(store: &Arc<AtomicStore>, array: &SmallArray<'_>) -> Result<ZarrArray, StoreError> {
    let element = match array.data {
        SmallData::F64(_) => ElementType::F64,
        SmallData::U8(_) => ElementType::U8,
    };
    let (shape, chunk) = (array.shape.clone(), array.shape[0]);
    let spec = ArraySpec {
        name: array.name,
        element,
        shape,
        chunk,
        dims: array.dims,
        packed: false,
    };
    let mut attributes = described(array.units, array.long_name);
    add_codes(&mut attributes, array.codes);
    match &array.data {
        SmallData::F64(values) => {
            let file = ZarrArray::create(store, &spec, attributes)?;
            file.write(0, values)?;
            Ok(file)
        }
        SmallData::U8(values) => {
            let file = ZarrArray::create_filled(store, &spec, attributes, NO_CODE.into())?;
            file.write(0, values)?;
            Ok(file)
        }
    }
}

/// Reads the values of the array `name`.
pub(super) fn read(store: &Arc<AtomicStore>, name: &str) -> Result<SmallData, StoreError> {
    if !is_name(name) {
        return Err(StoreError::ArrayMissing {
            path: store.root().to_path_buf(),
            array: name.to_owned(),
        });
    }
    let header = Header::read(store, name, None)?;
    let element = match header.data_type.as_str() {
        "float64" => ElementType::F64,
        "uint8" => ElementType::U8,
        other => {
            return Err(StoreError::metadata(
                &header.path,
                "data_type",
                "float64 or uint8",
                other,
            ));
        }
    };
    let dims: Vec<&str> = header.dims.iter().map(String::as_str).collect();
    let (shape, chunk) = (header.shape.clone(), header.shape[0]);
    let file = ZarrArray::open(
        store,
        &ArraySpec {
            name,
            element,
            shape,
            chunk,
            dims: &dims,
            packed: false,
        },
        &header,
    )?;
    match element {
        ElementType::F64 => file.read_present(0).map(SmallData::F64),
        _ => file.read_present(0).map(SmallData::U8),
    }
}
