//! A reflectance standard as its certificate has it.
//!
//! # Design
//! | file | holds |
//! |---|---|
//! | `read` | the file of a certificate (TOML), and what in it makes no sense |
//! | `geometry` | under which light and towards which view its value is |
//! | `shape` | how f goes with direction |
//! | `bands` | what of a value by wavelength each channel may see |
//! | `mean` | one certificate of several |
//!
//! A certificate states one number for each band, of one geometry, and hardly ever how f goes with direction. So f is that number
//! times a shape, which is 1 everywhere (Lambert's law) where the certificate has none, scaled such that what was calibrated comes out
//! just so. What that may be off by is no part of the certificate's uncertainty and is added to it, each part under its own name
//! ([`Certified::contributions`]); nothing of it is corrected for, as nobody measured it of this plate.
//!
//! Of a plate of PTFE the reflectance factor at 0/45 is one to two percent above its reflectance at 8/hemisphere (Weidner and Hsia, J.
//! Opt. Soc. Am. 71, 856, 1981), so that where nobody says better f is off by [`USUAL`] (k = 1) together, and by as much again from
//! direction to direction; towards grazing light and view by more ([`Angular`]).

mod bands;
mod geometry;
mod mean;
mod read;
mod shape;
#[cfg(test)]
mod tests;

use std::f64::consts::FRAC_1_PI;
use std::path::Path;

use glam::DVec3;

use super::{Outgoing, Sample, SampleError, albedo, below_horizon};
use crate::instrument::calibration::{Angular, Certificate, Standard};

pub use mean::{Mean, mean_of};

use geometry::{Geometry, Quantity};
use read::{AngularFile, CertificateFile};
use shape::Shape;

/// Relative standard uncertainty (k = 1) of f of a matte standard in one direction, of which the certificate knows another one, or the
/// hemisphere.
pub const USUAL: f64 = 0.015;

/// One cause of the uncertainty of f, relative, k = 1.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Contribution {
    /// What it is.
    pub cause: &'static str,
    /// How much it makes of all f alike.
    pub relative: f64,
}

/// A standard of known f, with what is known of it.
#[derive(Clone, Debug)]
pub struct Certified {
    /// f of each channel where the shape is 1, sr⁻¹.
    scale: [f64; 3],
    shape: Shape,
    standard: Standard,
    contributions: Vec<Contribution>,
    is_grey: bool,
}

impl Certified {
    /// Reads the certificate at `path`.
    ///
    /// # Errors
    /// [`SampleError::Unreadable`]; [`SampleError::File`] with the field, what was expected and what was found.
    pub fn open(path: &Path) -> Result<Self, SampleError> {
        let (file, sha256) = read::open(path)?;
        Self::of(&file, path, sha256)
    }

    fn of(file: &CertificateFile, path: &Path, sha256: String) -> Result<Self, SampleError> {
        let geometry = file.geometry(path)?;
        let bands = file.bands(path, geometry.quantity)?;
        let shape = Shape::new(file.angular.as_ref(), path)?;
        let scale = bands.value.map(|value| shape.scale(geometry, value));
        let [angular, shared] = angular(file.angular.as_ref(), &shape);
        let relative = |sigma: [f64; 3]| {
            let each = sigma.iter().zip(bands.value).map(|(sigma, value)| sigma / value);
            each.fold(0.0, f64::max)
        };
        let contributions = vec![
            Contribution {
                cause: "certificate",
                relative: relative(bands.certified),
            },
            Contribution {
                cause: "bands",
                relative: relative(bands.spread),
            },
            Contribution {
                cause: "departure from the angular behaviour that is taken",
                relative: shared.each,
            },
            Contribution {
                cause: "part of the hemisphere where nobody knows that behaviour",
                // The usual departure is that of the hemisphere from one direction, and has this already.
                relative: if file.angular.is_some() && geometry.outgoing_deg.is_none() {
                    unknown_hemisphere(&angular)
                } else {
                    0.0
                },
            },
        ];
        let count = if bands.is_grey { 1 } else { 3 };
        let certificate = Certificate {
            name: file.name.clone(),
            serial: file.serial.clone(),
            number: file.certificate.clone(),
            laboratory: file.laboratory.clone(),
            calibrated: file.calibrated.0,
            expires: file.expires.as_ref().map(|day| day.0),
            expired: false,
            quantity: geometry.quantity.name().to_owned(),
            geometry: geometry.to_string(),
            value: bands.value[..count].to_vec(),
            standard_uncertainty: bands.certified[..count].to_vec(),
            sha256,
        };
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        Ok(Self {
            scale,
            shape,
            is_grey: bands.is_grey,
            standard: Standard {
                named: name.into_owned(),
                standard_uncertainty: contributions.iter().map(|of| of.relative).fold(0.0, f64::hypot),
                angular,
                certificate: Some(certificate),
            },
            contributions,
        })
    }

    /// What of it travels with results. Of channels that are known to different shares it has the largest.
    #[must_use]
    pub const fn standard(&self) -> &Standard {
        &self.standard
    }

    /// What makes the uncertainty that all f share; that from direction to direction the [`Angular`] of the standard has.
    #[must_use]
    pub fn contributions(&self) -> &[Contribution] {
        &self.contributions
    }

    /// Whether all channels have one value.
    #[must_use]
    pub const fn is_grey(&self) -> bool {
        self.is_grey
    }
}

/// What one direction is off by beside all others, and (as its `each`) what all share.
fn angular(stated: Option<&AngularFile>, shape: &Shape) -> [Angular; 2] {
    let (total, correlation, known_to_deg) = match stated {
        None => (USUAL, None, [0.0; 2]),
        Some(stated) => (
            stated.standard_uncertainty,
            stated.correlation,
            stated.to_deg.map_or_else(|| shape.known_to_deg(), |deg| [deg; 2]),
        ),
    };
    // Who does not know how much of it directions share takes all of it for both.
    let (shared, own) = correlation.map_or((1.0, 1.0), |share| (share, 1.0 - share));
    let of = |share: f64| Angular {
        each: total * share.sqrt(),
        known_to_deg,
    };
    // One half of the variance by light, the other by view.
    [of(own / 2.0), of(shared)]
}

/// By how much the reflectance of the hemisphere is off for the directions of view beyond which nobody knows f, all of them at once,
/// relative: the mean over the hemisphere of what f may be off by there.
fn unknown_hemisphere(angular: &Angular) -> f64 {
    const RINGS: usize = 900;
    let of_ring = |ring: usize| {
        let sine2 = (ring as f64 + 0.5) / RINGS as f64;
        angular.beyond(1, sine2.sqrt().asin().to_degrees())
    };
    (0..RINGS).map(of_ring).sum::<f64>() / RINGS as f64
}

impl Sample for Certified {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        Box::new(Lit {
            scale: self.scale,
            shape: OfShape {
                shape: &self.shape,
                wi,
            },
        })
    }

    fn is_isotropic(&self) -> bool {
        true
    }
}

/// A standard under one incident direction.
struct Lit<'a> {
    scale: [f64; 3],
    shape: OfShape<'a>,
}

impl Outgoing for Lit<'_> {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        let [ratio, ..] = self.shape.f(wo);
        self.scale.map(|scale| scale * ratio)
    }
}

impl Shape {
    /// f in sr⁻¹ where the shape is 1, of what has this `value` in this `geometry`.
    fn scale(&self, geometry: Geometry, value: f64) -> f64 {
        let [wi, wo] = geometry.directions();
        match geometry.quantity {
            Quantity::Reflectance => value / albedo(self, wi)[0],
            Quantity::ReflectanceFactor => value * FRAC_1_PI / self.ratio(wi, wo),
            Quantity::Brdf => value / self.ratio(wi, wo),
        }
    }
}

/// The shape by itself, as f.
impl Sample for Shape {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        Box::new(OfShape { shape: self, wi })
    }

    fn is_isotropic(&self) -> bool {
        true
    }
}

struct OfShape<'a> {
    shape: &'a Shape,
    wi: DVec3,
}

impl Outgoing for OfShape<'_> {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        if below_horizon(self.wi) || below_horizon(wo) {
            return [0.0; 3];
        }
        [self.shape.ratio(self.wi, wo); 3]
    }
}
