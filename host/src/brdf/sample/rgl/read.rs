//! Reading a file into tables ready for look-ups, and what a file must be.

use std::f64::consts::FRAC_PI_2;
use std::io::{Read, Seek};
use std::path::Path;

use super::azimuth::{ANGLE_TOLERANCE_RAD, Azimuth};
use super::{Facets, MeasuredRgl, Tables, spectra};
use crate::brdf::sample::SampleError;
use crate::brdf::sample::tensor_file::{Extent, TensorFile, file_error};
use crate::brdf::sample::warp::Density;

impl MeasuredRgl {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// [`SampleError::Unreadable`] if it cannot be read, [`SampleError::File`] if it is no RGL tensor file with
    /// RGB values or spectra from which they follow, or if a field is missing, malformed or has values that it must not have.
    pub fn open(path: &Path) -> Result<Self, SampleError> {
        Self::read(TensorFile::open(path)?, path)
    }

    pub(super) fn read<R: Read + Seek>(mut file: TensorFile<R>, path: &Path) -> Result<Self, SampleError> {
        use Extent::{AtLeast, Exactly};
        let phi_i_rad = ascending(&mut file, "phi_i", path)?;
        let theta_i_rad = ascending(&mut file, "theta_i", path)?;
        if let [first, .., last] | [first @ last] = theta_i_rad[..]
            && !(first >= 0.0 && last <= FRAC_PI_2 + ANGLE_TOLERANCE_RAD)
        {
            let found = format!("{first} to {last}");
            return Err(file_error(path, "theta_i", "angles from 0 to π/2", &found));
        }
        let azimuth = Azimuth::of(&phi_i_rad, path)?;
        let wavelengths_nm = if !file.has("rgb") && file.has("spectra") {
            ascending(&mut file, "wavelengths", path)?
        } else {
            Vec::new()
        };
        let (p, t) = (Exactly(phi_i_rad.len()), Exactly(theta_i_rad.len()));
        let side = AtLeast(2);
        let mut read = |name: &str, extents: &[Extent], lowest: f32| {
            let tensor = file.read_f32(name, extents, lowest)?;
            let [.., rows, columns] = tensor.shape[..] else {
                return Err(file_error(path, name, "at least 2 dimensions", "fewer"));
            };
            Ok(Tables {
                rows,
                columns,
                values: tensor.values,
            })
        };
        let ndf = read("ndf", &[side, side], 0.0)?;
        let sigma = read("sigma", &[side, side], 0.0)?;
        let vndf = read("vndf", &[p, t, side, side], 0.0)?;
        let rgb = if wavelengths_nm.is_empty() {
            colours(&mut file, [p, t])?
        } else {
            seen(&mut file, [p, t], &spectra::weights(&wavelengths_nm, path)?)?
        };
        let with_jacobian = file.read_u8("jacobian", &[Exactly(1)])?.first() != Some(&0);

        // Two azimuths make a file isotropic by convention; f is isotropic in fact if both say the same.
        let isotropic = match phi_i_rad.len() {
            1 => true,
            2 => halves_agree(&vndf.values) && halves_agree(&rgb.values),
            _ => false,
        };
        let densities = vndf.values.chunks_exact(vndf.rows * vndf.columns);
        let densities = densities.enumerate().map(|(index, slice)| {
            let field = format!("vndf, slice {index}");
            let empty = || file_error(path, &field, "a density", "zero everywhere");
            Density::new(slice, vndf.columns).ok_or_else(empty)
        });
        Ok(Self {
            path: path.to_owned(),
            azimuth,
            isotropic,
            facets: with_jacobian.then_some(Facets { ndf, sigma }),
            vndf: densities.collect::<Result<_, _>>()?,
            rgb,
            wavelengths_nm,
            phi_i_rad,
            theta_i_rad,
        })
    }
}

/// Whether the first half of the values is the second one again.
fn halves_agree<T: PartialEq>(values: &[T]) -> bool {
    values[..values.len() / 2] == values[values.len() / 2..]
}

/// The tables of `spectra`, summed with the `weights` of their wavelengths on the way: spectra are many times as large.
fn seen<R: Read + Seek>(
    file: &mut TensorFile<R>,
    [p, t]: [Extent; 2],
    weights: &[[f64; 3]],
) -> Result<Tables<[f32; 3]>, SampleError> {
    let extents = [
        p,
        t,
        Extent::Exactly(weights.len()),
        Extent::AtLeast(2),
        Extent::AtLeast(2),
    ];
    let weights: Vec<[f32; 3]> = weights.iter().map(|of| of.map(|weight| weight as f32)).collect();
    let mut values: Vec<[f32; 3]> = Vec::new();
    let shape = file.each_f32("spectra", &extents, f32::MIN, |shape, at, value| {
        let size = shape[3] * shape[4];
        if at % (size * weights.len()) == 0 {
            values.resize(values.len() + size, [0.0; 3]);
        }
        let first = values.len() - size;
        let sum = &mut values[first + at % size];
        let weights = weights[at / size % weights.len()];
        *sum = std::array::from_fn(|c| weights[c].mul_add(value, sum[c]));
    })?;
    Ok(Tables {
        rows: shape[3],
        columns: shape[4],
        values,
    })
}

/// The tables of `rgb`, of which three for each slice become one of three channels, which takes one look-up.
fn colours<R: Read + Seek>(
    file: &mut TensorFile<R>,
    [p, t]: [Extent; 2],
) -> Result<Tables<[f32; 3]>, SampleError> {
    let side = Extent::AtLeast(2);
    let mut values: Vec<[f32; 3]> = Vec::new();
    let extents = [p, t, Extent::Exactly(3), side, side];
    let shape = file.each_f32("rgb", &extents, f32::MIN, |shape, at, value| {
        let size = shape[3] * shape[4];
        if at % (3 * size) == 0 {
            values.resize(values.len() + size, [0.0; 3]);
        }
        let first = values.len() - size;
        values[first + at % size][at / size % 3] = value;
    })?;
    Ok(Tables {
        rows: shape[3],
        columns: shape[4],
        values,
    })
}

/// The values of the 1-D field `name`, of which there must be at least one, each greater than the one before.
fn ascending<R: Read + Seek>(
    file: &mut TensorFile<R>,
    name: &str,
    path: &Path,
) -> Result<Vec<f64>, SampleError> {
    let tensor = file.read_f32(name, &[Extent::AtLeast(1)], f32::MIN)?;
    match tensor.values.windows(2).position(|pair| pair[0] >= pair[1]) {
        None => Ok(tensor.values.into_iter().map(f64::from).collect()),
        Some(at) => {
            let found = format!("{} after {}", tensor.values[at + 1], tensor.values[at]);
            Err(file_error(
                path,
                &format!("{name}, entry {}", at + 1),
                "ascending angles",
                &found,
            ))
        }
    }
}
