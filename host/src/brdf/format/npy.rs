//! Records of NumPy (`.npy`): `numpy.load(path)` is an array [θi, φi, θo, φo] of records with names.
//!
//! Format version 1.0: `\x93NUMPY`, 1, 0, u16 length of the header, a Python dictionary, then the records, all little-endian:
//!
//! | field | type | content |
//! |---|---|---|
//! | `theta_i_deg`, `phi_i_deg`, `theta_o_deg`, `phi_o_deg` | f4 | directions; φi = 0 alone of an isotropic sample, φo then counts from it |
//! | `f_per_sr` | f4 \[3\] | f, no cosine in it; NaN is no value |
//! | `u_f_per_sr` | f4 \[3\] | standard uncertainty (k = 1); NaN where nobody states one |
//! | `provenance` | u1 | 0 missing, 1 measured, 2 merged, 3 reciprocal, 4 interpolated, 5 modelled, 255 of a model |

use std::io::{BufWriter, Write as _};
use std::path::Path;

use super::table::{Axes, Tabulated, are_angles};
use super::{ExportError, Exporting, Resolution, reading};
use crate::base::text::shown;
use crate::brdf::sample::SampleError;

/// The first bytes.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";
/// Fields of a record.
const RECORD: &str = "[('theta_i_deg', '<f4'), ('phi_i_deg', '<f4'), ('theta_o_deg', '<f4'), ('phi_o_deg', '<f4'), \
                      ('f_per_sr', '<f4', (3,)), ('u_f_per_sr', '<f4', (3,)), ('provenance', '|u1')]";
/// Bytes of one.
const BYTES: usize = 10 * 4 + 1;
/// Step of the angles if nobody says otherwise, degrees; never finer than the source.
const STEP_DEG: f64 = 5.0;
/// Bytes of the largest file that is read.
const MOST_BYTES: u64 = 2_000_000_000;
/// Provenance of what is known.
const KNOWN: u8 = 255;

/// Reads a file that was written here.
pub(super) fn open(path: &Path) -> Result<Tabulated, SampleError> {
    let bytes = reading::bytes(path, MOST_BYTES)?;
    let wrong = |field: &str, expected: &str, found: &str| reading::wrong(path, field, expected, found);
    let start = MAGIC.len() + 2;
    let length = bytes
        .get(MAGIC.len()..start)
        .map_or(0, |two| usize::from(u16::from_le_bytes([two[0], two[1]])));
    let header = bytes
        .get(start..start + length)
        .and_then(|header| std::str::from_utf8(header).ok())
        .ok_or_else(|| wrong("header", &format!("{length} bytes of text"), "less"))?;
    if !header.contains(&format!("'descr': {RECORD}")) || !header.contains("'fortran_order': False") {
        return Err(wrong(
            "descr",
            "records as `rcg export --to npy` writes them",
            &shown(header.trim()),
        ));
    }
    let shape = shape_of(header).ok_or_else(|| wrong("shape", "four lengths", &shown(header.trim())))?;
    let count = shape.iter().fold(1_usize, |all, one| all.saturating_mul(*one));
    let data = &bytes[start + length..];
    if data.len() != count.saturating_mul(BYTES) {
        let expected = format!("{count} records of {BYTES} bytes");
        return Err(wrong("data", &expected, &format!("{} bytes", data.len())));
    }
    let number = |record: &[u8], at: usize| {
        let four = record[4 * at..][..4].try_into().expect("invariant: four bytes");
        f32::from_le_bytes(four)
    };
    let record = |place: usize| &data[place * BYTES..][..BYTES];
    let strides = [shape[1] * shape[2] * shape[3], shape[2] * shape[3], shape[3], 1];
    let axis = |at: usize| -> Vec<f64> {
        (0..shape[at])
            .map(|n| f64::from(number(record(n * strides[at]), at)))
            .collect()
    };
    let axes = Axes {
        theta_i: axis(0),
        phi_i: axis(1),
        theta_o: axis(2),
        phi_o: axis(3),
    };
    for (name, axis, last) in [
        ("theta_i_deg", &axes.theta_i, 90.0),
        ("phi_i_deg", &axes.phi_i, 360.0),
        ("theta_o_deg", &axes.theta_o, 90.0),
        ("phi_o_deg", &axes.phi_o, 360.0),
    ] {
        if !are_angles(axis, last) {
            return Err(wrong(
                name,
                &format!("ascending angles from 0 to {last}°"),
                "others",
            ));
        }
    }
    if let Some(flaw) = axes.flaw() {
        return Err(wrong("data", "angles that can be interpolated between", &flaw));
    }
    let f = (0..count)
        .map(|place| [4, 5, 6].map(|at| number(record(place), at)))
        .collect();
    Ok(Tabulated::new(axes, f))
}

/// The shape that a header names; `None` of none, of another number of axes, or of an empty one.
fn shape_of(header: &str) -> Option<[usize; 4]> {
    let (_, rest) = header.split_once("'shape': (")?;
    let (inside, _) = rest.split_once(')')?;
    let lengths: Option<Vec<usize>> = inside
        .split(',')
        .map(str::trim)
        .filter(|word| !word.is_empty())
        .map(|word| word.parse().ok().filter(|length| *length > 0))
        .collect();
    lengths?.try_into().ok()
}

/// Writes the records.
pub(super) fn write(exporting: &Exporting, resolution: Resolution) -> Result<(), ExportError> {
    let axes = Axes::of(exporting, resolution, STEP_DEG, false)?;
    let [a, b, c, d] = axes.shape();
    let mut header =
        format!("{{'descr': {RECORD}, 'fortran_order': False, 'shape': ({a}, {b}, {c}, {d}), }}");
    // Data begin at a multiple of 64.
    let whole = (MAGIC.len() + 2 + header.len() + 1).next_multiple_of(64);
    header.push_str(&" ".repeat(whole - MAGIC.len() - 2 - header.len() - 1));
    header.push('\n');
    let failed = |error| exporting.failed(error);
    let mut file = BufWriter::new(exporting.create()?);
    file.write_all(MAGIC).map_err(failed)?;
    file.write_all(&(header.len() as u16).to_le_bytes())
        .map_err(failed)?;
    file.write_all(header.as_bytes()).map_err(failed)?;
    axes.scan(exporting, |range, pairs| {
        for (place, entry) in range.zip(exporting.entries(pairs)?) {
            for deg in axes.angles(place) {
                file.write_all(&(deg as f32).to_le_bytes()).map_err(failed)?;
            }
            let (f, sigma, provenance) = entry.map_or(([f32::NAN; 3], [f32::NAN; 3], 0), |entry| {
                let code = entry
                    .provenance
                    .map_or(KNOWN, crate::store::provenance::Provenance::code);
                (entry.f, entry.sigma, code)
            });
            for value in f.into_iter().chain(sigma) {
                file.write_all(&value.to_le_bytes()).map_err(failed)?;
            }
            file.write_all(&[provenance]).map_err(failed)?;
        }
        Ok(())
    })?;
    exporting.finish(file)
}
