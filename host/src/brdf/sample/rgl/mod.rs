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
//! | `spectra` | \[P, T, W, ≥2, ≥2\] | the same by wavelength, in place of `rgb`; RGB are made of them as `spectra` says |
//! | `wavelengths` | \[W\] | nm, ascending |
//! | `jacobian` | u8 \[1\] | 0: the factor ndf/(4 sigma) is left out |
//!
//! # Design
//! The warp of the density between tabulated incident directions needs its cumulative distributions. They are linear
//! in the density: those of each slice are integrated once, when the file is read, and interpolated like it.
//! `incident()` interpolates the whole tables for its (φi, θi); `Outgoing::f` then does three bilinear look-ups. `f()`
//! of a single pair makes its look-ups in each of the up to four slices around (φi, θi) and interpolates what it found.
//!
//! An anisotropic file may hold a half or a quarter of all incident azimuths: half for materials that look the same when
//! turned by 180°, a quarter for those that are mirror symmetric about the x and the y axis.
//!
//! # Tradeoffs
//! With its integral each value of `vndf` takes 16 bytes of memory, four times as many as in the file.
//!
//! The published files are interpolations of measurements and reciprocal to a few per cent only; f is returned
//! as the file has it. They hold f cosθo, so near the horizon the division by cosθo amplifies their error.

mod azimuth;
mod read;
mod spectra;

use std::f64::consts::{PI, TAU};
use std::path::PathBuf;

use glam::{DMat2, DVec2, DVec3};

use self::azimuth::Azimuth;
use super::warp::{Density, Patch};
use super::{Outgoing, Sample, Unlit, below_horizon};
use crate::base::bracket::bracket;

/// A material from a measured `.bsdf` file of the RGL material database, or one written in that format.
pub struct MeasuredRgl {
    path: PathBuf,
    phi_i_rad: Vec<f64>,
    theta_i_rad: Vec<f64>,
    azimuth: Azimuth,
    isotropic: bool,
    /// `None` if the values do not contain the factor ndf/(4 sigma).
    facets: Option<Facets>,
    /// One for each pair of incident angles, φi by φi.
    vndf: Vec<Density>,
    /// As many slices.
    rgb: Tables<[f32; 3]>,
    /// Those of spectra; none of a file that has RGB.
    wavelengths_nm: Vec<f64>,
}

/// Statistics of the microfacets, independent of the incident direction.
#[derive(Debug)]
struct Facets {
    ndf: Tables<f32>,
    sigma: Tables<f32>,
}

/// Equally large 2-D tables one after another.
#[derive(Clone, Debug)]
pub(crate) struct Tables<T> {
    /// Along the axis before the last one.
    pub(crate) rows: usize,
    /// Along the last axis.
    pub(crate) columns: usize,
    /// Row by row, table by table.
    pub(crate) values: Vec<T>,
}

impl<T> Tables<T> {
    /// Table number `index`, row by row.
    pub(crate) fn slice(&self, index: usize) -> &[T] {
        let size = self.rows * self.columns;
        &self.values[index * size..(index + 1) * size]
    }

    /// Where (`x`, `y`) is in any of them.
    pub(crate) fn patch(&self, x: f64, y: f64) -> Patch {
        Patch::at(x, y, self.rows, self.columns)
    }
}

/// An incident direction above the horizon that facets face.
struct Incidence {
    /// The direction, brought to the tabulated azimuths.
    wi: DVec3,
    /// What brought it there; the outgoing direction must follow.
    to_table: DMat2,
    /// Its neighbours among the tabulated incident directions: the number of the slice and its weight. The weights sum
    /// to 1; a slice without weight may not exist.
    neighbours: [(usize, f64); 4],
    /// 1/(4 sigma).
    scale: f64,
}

impl Incidence {
    fn neighbours(&self) -> impl Iterator<Item = (usize, f64)> {
        self.neighbours.into_iter().filter(|(_, weight)| *weight > 0.0)
    }

    /// (u, v) of the half vector to `wo`, which is above the horizon.
    fn half(&self, wo: DVec3) -> (f64, f64) {
        let m = self.wi + (self.to_table * wo.truncate()).extend(wo.z);
        (u_of_theta(m), v_of_phi(m.y.atan2(m.x)))
    }
}

/// The tables of a file, as it has them.
pub(crate) struct Content<'a> {
    /// Radians.
    pub(crate) phi_i: &'a [f64],
    /// Radians.
    pub(crate) theta_i: &'a [f64],
    /// `ndf` and `sigma`; `None` if the values do not contain the factor ndf/(4 sigma).
    pub(crate) facets: Option<[&'a Tables<f32>; 2]>,
    /// One for each pair of incident angles, φi by φi.
    pub(crate) vndf: &'a [Density],
    /// As many tables of R, G and B.
    pub(crate) rgb: &'a Tables<[f32; 3]>,
}

impl MeasuredRgl {
    /// How R, G and B were made of spectra, in words; `None` of a file that has them itself.
    #[must_use]
    pub fn colours(&self) -> Option<String> {
        // As the file has them, in single precision.
        match self.wavelengths_nm[..] {
            [] => None,
            [one] => Some(format!("one wavelength, {} nm, in each channel", one as f32)),
            [first, .., last] => Some(format!(
                "{} wavelengths from {} to {} nm as {}",
                self.wavelengths_nm.len(),
                first as f32,
                last as f32,
                spectra::WORDS
            )),
        }
    }

    /// Its tables.
    pub(crate) fn content(&self) -> Content<'_> {
        let facets = self.facets.as_ref();
        Content {
            phi_i: &self.phi_i_rad,
            theta_i: &self.theta_i_rad,
            facets: facets.map(|Facets { ndf, sigma }| [ndf, sigma]),
            vndf: &self.vndf,
            rgb: &self.rgb,
        }
    }

    /// What all look-ups from `wi` share; `None` where f is zero.
    fn incidence(&self, wi: DVec3) -> Option<Incidence> {
        if below_horizon(wi) {
            return None;
        }
        let theta_rad = wi.truncate().length().atan2(wi.z);
        let to_table = self.azimuth.to_table(wi);
        let wi_table = (to_table * wi.truncate()).extend(wi.z);
        // A file with two azimuths is isotropic by convention, yet has a table for each.
        let phi_rad = match self.azimuth {
            Azimuth::Relative => azimuth_rad(wi),
            _ => azimuth_rad(wi_table),
        };
        let scale = match &self.facets {
            None => 1.0,
            Some(Facets { sigma, .. }) => {
                let sigma = sigma
                    .patch(u_of_theta(wi), v_of_phi(phi_rad))
                    .value(&sigma.values);
                // Where no facet faces the incident direction nothing is reflected.
                (sigma > 0.0).then_some(0.25 / sigma)?
            }
        };
        let (phi, phi_weights) = bracket(&self.phi_i_rad, self.azimuth.unwind(phi_rad));
        let (theta, theta_weights) = bracket(&self.theta_i_rad, theta_rad);
        let neighbours = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(a, b)| {
            let index = (phi + a) * self.theta_i_rad.len() + theta + b;
            (index, phi_weights[a] * theta_weights[b])
        });
        Some(Incidence {
            wi: wi_table,
            to_table,
            neighbours,
            scale,
        })
    }

    /// f in sr⁻¹ where the half vector is at (`u`, `v`) and the outgoing direction has `cos`, from the value of `rgb`.
    fn scaled(&self, incidence: &Incidence, (u, v): (f64, f64), cos: f64, rgb: [f64; 3]) -> [f64; 3] {
        let facets = self.facets.as_ref();
        let ndf = facets.map_or(1.0, |Facets { ndf, .. }| ndf.patch(u, v).value(&ndf.values));
        let scale = incidence.scale * ndf / cos;
        rgb.map(|value| value.max(0.0) * scale)
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
        let Some(incidence) = self.incidence(wi) else {
            return Box::new(Unlit);
        };
        let densities = incidence.neighbours().map(|(i, weight)| (&self.vndf[i], weight));
        let density = Density::mean(densities).expect("the weights sum to 1");
        let mut rgb = vec![[0.0_f32; 3]; self.rgb.rows * self.rgb.columns];
        for (index, weight) in incidence.neighbours() {
            for (sum, value) in rgb.iter_mut().zip(self.rgb.slice(index)) {
                *sum = std::array::from_fn(|c| sum[c] + weight as f32 * value[c]);
            }
        }
        Box::new(Lit {
            sample: self,
            incidence,
            density,
            rgb,
        })
    }

    fn f(&self, wi: DVec3, wo: DVec3) -> [f64; 3] {
        let Some(incidence) = self.incidence(wi).filter(|_| !below_horizon(wo)) else {
            return [0.0; 3];
        };
        let (u, v) = incidence.half(wo);
        let densities = incidence.neighbours().map(|(i, weight)| (&self.vndf[i], weight));
        let (s_u, s_v) = Density::invert_mean(densities, u, v);
        let patch = self.rgb.patch(s_u, s_v);
        let rgb = incidence.neighbours().fold([0.0; 3], |sum, (index, weight)| {
            let values = patch.values(self.rgb.slice(index));
            std::array::from_fn(|c| sum[c] + weight * values[c])
        });
        self.scaled(&incidence, (u, v), wo.z, rgb)
    }

    fn is_isotropic(&self) -> bool {
        self.isotropic
    }

    fn tensor(&self) -> Option<&MeasuredRgl> {
        Some(self)
    }
}

/// A measured surface under an incident direction above the horizon.
struct Lit<'a> {
    sample: &'a MeasuredRgl,
    incidence: Incidence,
    /// `vndf` at the incident direction.
    density: Density,
    /// `rgb` at the incident direction, row by row.
    rgb: Vec<[f32; 3]>,
}

impl Outgoing for Lit<'_> {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        if below_horizon(wo) {
            return [0.0; 3];
        }
        let (u, v) = self.incidence.half(wo);
        let (s_u, s_v) = self.density.invert(u, v);
        let rgb = self.sample.rgb.patch(s_u, s_v).values(&self.rgb);
        self.sample.scaled(&self.incidence, (u, v), wo.z, rgb)
    }
}

#[cfg(test)]
mod tests;
