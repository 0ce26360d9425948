//! Measured materials in the parameterisation of the RGL material database.
//!
//! Source: J. Dupuy and W. Jakob, "An adaptive parameterization for efficient material acquisition and
//! rendering", ACM TOG 37(6), 2018. With m the half vector, u(θ) = √(2θ/π) and v(φ) = (φ + π)/(2π):
//!
//! f cosθo = max(0, rgb(s | φi, θi)) · ndf(um) / (4 · sigma(ui)),  s = warp⁻¹(um | φi, θi)
//!
//! where um = (u(θm), v(φm)), for isotropic materials (u(θm), v(φm − φi)); ui = (u(θi), v(φi)); the warp is that
//! of the density `vndf`. All tables are bilinear in the last two axes (v, then u), and linear in φi and θi.
//!
//! | field | shape | values |
//! |---|---|---|
//! | `phi_i`, `theta_i` | \[P\], \[T\] | incident angles in rad, ascending; P ≤ 2 means isotropic |
//! | `ndf`, `sigma` | \[≥2, ≥2\] | microfacet distribution, projected microfacet area, ≥ 0 |
//! | `vndf` | \[P, T, ≥2, ≥2\] | density of visible normals, ≥ 0, not normalised |
//! | `rgb` | \[P, T, 3, ≥2, ≥2\] | the warped and scaled values |
//! | `jacobian` | u8 \[1\] | 0: the factor ndf/(4 sigma) is left out |
//!
//! # Design
//! `incident()` interpolates the `vndf` and `rgb` tables for its (φi, θi) and integrates the first, once;
//! `Outgoing::f` then does three bilinear look-ups. An anisotropic file may hold a half or a quarter of all
//! incident azimuths: half for materials that look the same when turned by 180°, a quarter for those that are
//! mirror symmetric about the x and the y axis.
//!
//! # Tradeoffs
//! The published files are interpolations of measurements and reciprocal to a few per cent only; f is returned
//! as the file has it. They hold f cosθo, so near the horizon the division by cosθo amplifies their error.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};

use glam::{DMat2, DVec2, DVec3};

use super::tensor_file::{Extent, TensorFile, file_error};
use super::warp::{Density, Patch, integral};
use super::{Outgoing, Sample, SampleError, Unlit, below_horizon};

/// Allowed error of tabulated angles in rad: they are single-precision numbers, some written from rounded degrees.
const ANGLE_TOLERANCE_RAD: f64 = 1e-3;

/// A material from a measured `.bsdf` file of the RGL material database, or one written in that format.
pub struct MeasuredRgl {
    path: PathBuf,
    phi_i_rad: Vec<f64>,
    theta_i_rad: Vec<f64>,
    azimuth: Azimuth,
    isotropic: bool,
    /// `None` if the values do not contain the factor ndf/(4 sigma).
    facets: Option<Facets>,
    vndf: Slices,
    /// What each slice of `vndf` must be multiplied by to have an integral of 1.
    vndf_scale: Vec<f64>,
    rgb: Slices,
}

/// Statistics of the microfacets, independent of the incident direction.
#[derive(Debug)]
struct Facets {
    ndf: Slices,
    sigma: Slices,
}

/// Equally large 2-D tables one after another.
#[derive(Debug)]
struct Slices {
    rows: usize,
    columns: usize,
    values: Vec<f32>,
}

impl Slices {
    /// Slice number `index`, row by row.
    fn slice(&self, index: usize) -> &[f32] {
        let size = self.rows * self.columns;
        &self.values[index * size..(index + 1) * size]
    }
}

/// How the tabulated incident azimuths cover the circle.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Azimuth {
    /// Isotropic: φm counts from φi.
    Relative,
    /// 360° around the given middle.
    Full(f64),
    /// 180° around the given middle; the material is the same when turned by 180°.
    Half(f64),
    /// The quadrant around the given middle; the material is mirror symmetric in x and in y.
    Quadrant(f64),
}

impl Azimuth {
    fn of(phi_i_rad: &[f64], path: &Path) -> Result<Self, SampleError> {
        let (first, last) = match phi_i_rad {
            [first, _, .., last] => (*first, *last),
            _ => return Ok(Self::Relative),
        };
        let near = |a: f64, b: f64| (a - b).abs() < ANGLE_TOLERANCE_RAD;
        let (span, middle) = (last - first, 0.5 * (first + last));
        let from_axis = first.rem_euclid(FRAC_PI_2);
        if near(span, TAU) {
            Ok(Self::Full(middle))
        } else if near(span, PI) {
            Ok(Self::Half(middle))
        } else if near(span, FRAC_PI_2) && (near(from_axis, 0.0) || near(from_axis, FRAC_PI_2)) {
            Ok(Self::Quadrant(middle))
        } else {
            let expected = "azimuths that span 2π, π or one quadrant";
            Err(file_error(path, "phi_i", expected, &format!("{first} to {last}")))
        }
    }

    /// The linear map of the horizontal plane that brings `wi` to the tabulated azimuths.
    fn to_table(self, wi: DVec3) -> DMat2 {
        match self {
            // Turns the incident direction to φ = 0, so that φm becomes φm − φi.
            Self::Relative => {
                let along = wi.truncate().normalize_or(DVec2::X);
                DMat2::from_cols(DVec2::new(along.x, -along.y), DVec2::new(along.y, along.x))
            }
            Self::Full(_) => DMat2::IDENTITY,
            Self::Half(middle) => {
                let beyond = wi.truncate().dot(DVec2::from_angle(middle)) < 0.0;
                if beyond { -DMat2::IDENTITY } else { DMat2::IDENTITY }
            }
            Self::Quadrant(middle) => {
                let sign_of = |product: f64| if product < 0.0 { -1.0 } else { 1.0 };
                let (sin, cos) = middle.sin_cos();
                DMat2::from_diagonal(DVec2::new(sign_of(wi.x * cos), sign_of(wi.y * sin)))
            }
        }
    }

    /// The azimuth `phi_rad`, already brought to the table, by the turn in which the table counts.
    fn unwind(self, phi_rad: f64) -> f64 {
        let middle = match self {
            Self::Relative => return phi_rad,
            Self::Full(middle) | Self::Half(middle) | Self::Quadrant(middle) => middle,
        };
        middle + (phi_rad - middle + PI).rem_euclid(TAU) - PI
    }
}

impl MeasuredRgl {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// [`SampleError::Unreadable`] if it cannot be read, [`SampleError::File`] if it is no RGL tensor file with
    /// RGB values, or if a field is missing, malformed or has values that it must not have.
    pub fn open(path: &Path) -> Result<Self, SampleError> {
        Self::read(TensorFile::open(path)?, path)
    }

    fn read<R: Read + Seek>(mut file: TensorFile<R>, path: &Path) -> Result<Self, SampleError> {
        use Extent::{AtLeast, Exactly};
        if !file.has("rgb") && file.has("spectra") {
            return Err(file_error(path, "rgb", "RGB values", "only spectra"));
        }
        let phi_i_rad = ascending(&mut file, "phi_i", path)?;
        let theta_i_rad = ascending(&mut file, "theta_i", path)?;
        if let [first, .., last] | [first @ last] = theta_i_rad[..]
            && !(first >= 0.0 && last <= FRAC_PI_2 + ANGLE_TOLERANCE_RAD)
        {
            let found = format!("{first} to {last}");
            return Err(file_error(path, "theta_i", "angles from 0 to π/2", &found));
        }
        let azimuth = Azimuth::of(&phi_i_rad, path)?;
        let (p, t) = (Exactly(phi_i_rad.len()), Exactly(theta_i_rad.len()));
        let side = AtLeast(2);
        let mut read = |name: &str, extents: &[Extent], lowest: f32| {
            let tensor = file.read_f32(name, extents, lowest)?;
            let [.., rows, columns] = tensor.shape[..] else {
                return Err(file_error(path, name, "at least 2 dimensions", "fewer"));
            };
            Ok(Slices {
                rows,
                columns,
                values: tensor.values,
            })
        };
        let ndf = read("ndf", &[side, side], 0.0)?;
        let sigma = read("sigma", &[side, side], 0.0)?;
        let vndf = read("vndf", &[p, t, side, side], 0.0)?;
        let rgb = read("rgb", &[p, t, Exactly(3), side, side], f32::MIN)?;
        let with_jacobian = file.read_u8("jacobian", &[Exactly(1)])?.first() != Some(&0);

        let count = phi_i_rad.len() * theta_i_rad.len();
        let mut vndf_scale = Vec::with_capacity(count);
        for index in 0..count {
            let total = integral(vndf.slice(index), vndf.columns);
            if total <= 0.0 {
                let field = format!("vndf, slice {index}");
                return Err(file_error(path, &field, "a density", "zero everywhere"));
            }
            vndf_scale.push(1.0 / total);
        }
        // Two azimuths make a file isotropic by convention; f is isotropic in fact if both say the same.
        let halves_agree = |values: &[f32]| values[..values.len() / 2] == values[values.len() / 2..];
        let isotropic = match phi_i_rad.len() {
            1 => true,
            2 => halves_agree(&vndf.values) && halves_agree(&rgb.values),
            _ => false,
        };
        let facets = with_jacobian.then_some(Facets { ndf, sigma });
        Ok(Self {
            path: path.to_owned(),
            phi_i_rad,
            theta_i_rad,
            azimuth,
            isotropic,
            facets,
            vndf,
            vndf_scale,
            rgb,
        })
    }

    /// Up to four neighbours of (`phi_rad`, `theta_rad`) among the tabulated incident directions: the number of
    /// the slice and its weight. The weights sum to 1.
    fn neighbours(&self, phi_rad: f64, theta_rad: f64) -> impl Iterator<Item = (usize, f64)> + use<> {
        let (phi, phi_weights) = bracket(&self.phi_i_rad, phi_rad);
        let (theta, theta_weights) = bracket(&self.theta_i_rad, theta_rad);
        let thetas = self.theta_i_rad.len();
        (0..4)
            .map(move |i| {
                let (a, b) = (i / 2, i % 2);
                ((phi + a) * thetas + theta + b, phi_weights[a] * theta_weights[b])
            })
            // A neighbour without weight may not exist.
            .filter(|(_, weight)| *weight > 0.0)
    }
}

/// The interval of ascending `values` that holds `value`, and the weights of its two ends; clamped to the ends.
fn bracket(values: &[f64], value: f64) -> (usize, [f64; 2]) {
    let above = values.partition_point(|v| *v <= value);
    if above == 0 {
        return (0, [1.0, 0.0]);
    }
    let below = above - 1;
    match values.get(above) {
        None => (below, [1.0, 0.0]),
        Some(end) => {
            let t = (value - values[below]) / (end - values[below]);
            (below, [1.0 - t, t])
        }
    }
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

/// Azimuth of `w` in (−π, π]; 0 at the pole, whatever the signs of zero there.
fn azimuth_rad(w: DVec3) -> f64 {
    if w.truncate() == DVec2::ZERO {
        0.0
    } else {
        w.y.atan2(w.x)
    }
}

/// u(θ) of the direction of `v`, which is above the horizon and need not be a unit vector.
fn u_of_theta(v: DVec3) -> f64 {
    // Not atan2, which is slower: with z > 0 there is no quadrant to find.
    (((v.x * v.x + v.y * v.y).sqrt() / v.z).atan() * (2.0 / PI)).sqrt()
}

/// v(φ) of an azimuth in (−π, π], wrapped to [0, 1).
fn v_of_phi(phi_rad: f64) -> f64 {
    let v = (phi_rad + PI) * (1.0 / TAU);
    if v < 1.0 { v } else { v - 1.0 }
}

impl std::fmt::Debug for MeasuredRgl {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // Without the tables, which are megabytes.
        f.debug_struct("MeasuredRgl")
            .field("path", &self.path)
            .field("phi_i_rad", &self.phi_i_rad)
            .field("theta_i_rad", &self.theta_i_rad)
            .field("azimuth", &self.azimuth)
            .finish_non_exhaustive()
    }
}

impl Sample for MeasuredRgl {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        if below_horizon(wi) {
            return Box::new(Unlit);
        }
        let theta_rad = wi.truncate().length().atan2(wi.z);
        let to_table = self.azimuth.to_table(wi);
        let wi_table = (to_table * wi.truncate()).extend(wi.z);
        // A file with two azimuths is isotropic by convention, yet has a table for each.
        let phi_rad = match self.azimuth {
            Azimuth::Relative => azimuth_rad(wi),
            _ => azimuth_rad(wi_table),
        };

        let mut density = vec![0.0; self.vndf.rows * self.vndf.columns];
        let mut rgb = vec![[0.0_f32; 3]; self.rgb.rows * self.rgb.columns];
        for (index, weight) in self.neighbours(self.azimuth.unwind(phi_rad), theta_rad) {
            let scale = weight * self.vndf_scale[index];
            for (sum, value) in density.iter_mut().zip(self.vndf.slice(index)) {
                *sum += scale * f64::from(*value);
            }
            for channel in 0..3 {
                for (sum, value) in rgb.iter_mut().zip(self.rgb.slice(3 * index + channel)) {
                    sum[channel] += weight as f32 * value;
                }
            }
        }
        let sigma = self.facets.as_ref().map(|Facets { sigma, .. }| {
            let at = Patch::at(u_of_theta(wi), v_of_phi(phi_rad), sigma.rows, sigma.columns);
            at.value(&sigma.values)
        });
        let scale = match sigma {
            None => 1.0,
            Some(sigma) if sigma > 0.0 => 0.25 / sigma,
            // No facet faces the incident direction: nothing is reflected.
            Some(_) => return Box::new(Unlit),
        };
        Box::new(Lit {
            wi: wi_table,
            to_table,
            density: Density::new(&density, self.vndf.columns),
            rgb,
            rgb_rows: self.rgb.rows,
            rgb_columns: self.rgb.columns,
            ndf: self.facets.as_ref().map(|facets| &facets.ndf),
            scale,
        })
    }

    fn is_isotropic(&self) -> bool {
        self.isotropic
    }
}

/// A measured surface under an incident direction above the horizon.
struct Lit<'a> {
    /// The incident direction, brought to the tabulated azimuths.
    wi: DVec3,
    /// What brought it there; the outgoing direction must follow.
    to_table: DMat2,
    /// `vndf` at the incident direction.
    density: Density,
    /// `rgb` at the incident direction, row by row.
    rgb: Vec<[f32; 3]>,
    rgb_rows: usize,
    rgb_columns: usize,
    ndf: Option<&'a Slices>,
    /// 1/(4 sigma).
    scale: f64,
}

impl Outgoing for Lit<'_> {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        if below_horizon(wo) {
            return [0.0; 3];
        }
        let m = self.wi + (self.to_table * wo.truncate()).extend(wo.z);
        let (u, v) = (u_of_theta(m), v_of_phi(m.y.atan2(m.x)));
        let ndf = self.ndf.map_or(1.0, |ndf| {
            Patch::at(u, v, ndf.rows, ndf.columns).value(&ndf.values)
        });
        let (s_u, s_v) = self.density.invert(u, v);
        let rgb = Patch::at(s_u, s_v, self.rgb_rows, self.rgb_columns).values(&self.rgb);
        let scale = self.scale * ndf / wo.z;
        rgb.map(|value| value.max(0.0) * scale)
    }
}

#[cfg(test)]
mod tests;
