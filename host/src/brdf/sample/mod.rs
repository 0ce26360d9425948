//! Known materials: the truth of the virtual rig and the reference of `evaluate`.
//!
//! # Design
//! A frame asks one material for 10⁴–10⁵ outgoing directions under one and the same incident direction.
//! Therefore evaluation has two steps: [`Sample::incident`] does once everything that depends on ωi only, and
//! the [`Outgoing`] it returns is cheap, allocates nothing and may be shared between threads.
//!
//! All values are the BRDF f in sr⁻¹, without the cosine, in three channels R, G, B. Directions are unit vectors
//! that point away from the surface, in the sample frame.

mod certified;
mod ggx;
mod lambert;
pub(crate) mod rgl;
mod satin;
mod spec;
mod surface;
mod tensor_file;
pub(crate) mod tensor_writer;
mod turned;
mod velvet;
mod ward;
pub(crate) mod warp;

use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::base::blame::Blame;
use crate::brdf::format::{self, Format};
use crate::hemisphere::direction::{from_angles, is_above_horizon};

pub use certified::{Certified, Contribution, Mean, USUAL, mean_of};
pub use ggx::Ggx;
pub(crate) use ggx::LobeParts;
pub use lambert::Lambert;
pub use rgl::MeasuredRgl;
pub use satin::Satin;
pub(crate) use surface::across;
pub use turned::Turned;
pub use velvet::Velvet;
pub use ward::Ward;

/// A material with known BRDF f (sr⁻¹, no cosine in it), three channels R, G, B.
pub trait Sample: Send + Sync + std::fmt::Debug {
    /// f for one fixed incident direction `wi` (unit vector away from the surface, sample frame).
    ///
    /// Prepares everything that depends on `wi` only; call it once per frame, not once per pixel.
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_>;

    /// f(`wi`, `wo`) in sr⁻¹ of a single pair of directions.
    fn f(&self, wi: DVec3, wo: DVec3) -> [f64; 3] {
        self.incident(wi).f(wo)
    }

    /// Whether f depends on the azimuths only through their difference.
    fn is_isotropic(&self) -> bool;

    /// The tensor file that it is, whose tables can be written as they are; `None` of every other.
    fn tensor(&self) -> Option<&MeasuredRgl> {
        None
    }
}

/// A material under one fixed incident direction.
pub trait Outgoing: Send + Sync {
    /// f in sr⁻¹ towards the unit vector `wo`. If either direction is at or below the horizon f is not defined: this is zero
    /// there, for sums over light, to which such directions add nothing. Who answers with f itself asks
    /// [`is_above_horizon`] first, as [`crate::brdf::reflectance`] does.
    fn f(&self, wo: DVec3) -> [f64; 3];

    /// By how much f is larger, in sr⁻¹, for light that is polarised across the plane of light and view than for light that is not;
    /// along that plane it is smaller by as much. So it is for who sees polarised light only. None of matte samples, nor of those of which nobody knows.
    fn across(&self, _wo: DVec3) -> [f64; 3] {
        [0.0; 3]
    }
}

/// Why a sample could not be made; each is one sentence with what was expected and what was found.
#[derive(Debug, thiserror::Error)]
pub enum SampleError {
    /// The specification of an analytic model is wrong.
    #[error("sample '{spec}', {field}: expected {expected}, found {found}")]
    Spec {
        /// The whole specification as it was given.
        spec: String,
        /// The part of it that is wrong.
        field: String,
        /// What could stand there.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// A measured file cannot be opened or read.
    #[error("{}: expected a readable file, found: {cause}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        #[source]
        cause: std::io::Error,
    },
    /// A measured file was read but its content is wrong.
    #[error("{}, {field}: expected {expected}, found {found}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The part of the file that is wrong.
        field: String,
        /// What could stand there.
        expected: String,
        /// What stands there.
        found: String,
    },
}

impl Blame for SampleError {
    fn is_input(&self) -> bool {
        true
    }
}

/// The sample that `spec` names.
///
/// | `spec` | material |
/// |---|---|
/// | `lambert`, `lambert:0.5` | [`Lambert`] of that albedo, by default 0.5 |
/// | `ward`, `ward:brass`, `ward:rd=0.1,rs=0.33,ax=0.05,ay=0.16` | [`Ward`], by default rolled brass |
/// | `ggx`, `ggx:satin`, `ggx:plastic`, `ggx:f0=0.9,ax=0.1,ay=0.2,rd=0.05` | [`Ggx`] |
/// | `velvet`, `velvet:pile`, `velvet:rd=0.03,rs=0.6,ax=0.7,ay=1.2` | [`Velvet`], anisotropic cloth |
/// | `satin`, `satin:silk`, `satin:f0=0.3,along=0.14,across=0.6,weft=0.2,rd=0.12` | [`Satin`], anisotropic cloth |
/// | a path | a measured file of another program, as its content says ([`crate::brdf::format`]) |
/// | a path that ends in `.toml` | [`Certified`], a reflectance standard with its certificate |
///
/// A preset may be followed by parameters that change it, as in `ward:brass,ax=0.1`; what is not given keeps the
/// default. `@` and degrees behind it turn it: of `ward:brass@30` the +x lies at an azimuth of 30°.
///
/// # Errors
/// [`SampleError::Spec`] for an unknown model, preset or parameter, a bad number or one out of range; for a path
/// the errors of [`MeasuredRgl::open`] and [`Certified::open`].
pub fn parse(spec: &str) -> Result<Box<dyn Sample>, SampleError> {
    let (bare, azimuth_deg) = split_turn(spec)?;
    let sample = unturned(bare)?;
    if azimuth_deg.abs() > 0.0 {
        return Ok(Box::new(Turned::new(sample, azimuth_deg.to_radians())));
    }
    Ok(sample)
}

/// `spec` without its turn, and that in degrees.
fn split_turn(spec: &str) -> Result<(&str, f64), SampleError> {
    let Some((unturned, turn)) = spec.rsplit_once('@').filter(|_| !Path::new(spec).is_file()) else {
        return Ok((spec, 0.0));
    };
    let azimuth_deg = turn.parse().ok().filter(|turn: &f64| turn.abs() <= 360.0);
    azimuth_deg.map(|turn| (unturned, turn)).ok_or_else(|| {
        let expected = "degrees from -360 to 360, as in ward:brass@30";
        spec::error(spec, "azimuth", expected, &format!("'{turn}'"))
    })
}

fn unturned(spec: &str) -> Result<Box<dyn Sample>, SampleError> {
    let (model, arguments) = match spec.split_once(':') {
        Some((model, arguments)) => (model, Some(arguments)),
        None => (spec, None),
    };
    match model {
        "lambert" => Ok(Box::new(Lambert::from_arguments(spec, arguments)?)),
        "ward" => Ok(Box::new(Ward::from_arguments(spec, arguments)?)),
        "ggx" => Ok(Box::new(Ggx::from_arguments(spec, arguments)?)),
        "velvet" => Ok(Box::new(Velvet::from_arguments(spec, arguments)?)),
        "satin" => Ok(Box::new(Satin::from_arguments(spec, arguments)?)),
        _ => {
            let path = Path::new(spec);
            if is_certificate(path) {
                return Ok(Box::new(Certified::open(path)?));
            }
            // A file that exists is judged by its content, whatever its name.
            if Format::is_named(path) || path.is_file() {
                return format::open(path);
            }
            Err(SampleError::Spec {
                spec: spec.to_owned(),
                field: "model".to_owned(),
                expected: "lambert, ward, ggx, velvet, satin or the path of a measured file (.bsdf, .binary, .ssdd, .xml, .brdf, .npy) or of a certificate (.toml)".to_owned(),
                found: format!("'{model}'"),
            })
        }
    }
}

/// The certificate that `spec` names; `None` if it names a model or a measured file.
///
/// # Errors
/// Those of [`Certified::open`].
pub fn certificate_of(spec: &str) -> Result<Option<Certified>, SampleError> {
    let path = file_of(spec).filter(|path| is_certificate(path));
    path.map(Certified::open).transpose()
}

fn is_certificate(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"))
}

/// The file that `spec` names; `None` for a model.
#[must_use]
pub fn file_of(spec: &str) -> Option<&Path> {
    let (spec, _) = split_turn(spec).unwrap_or((spec, 0.0));
    let model = spec.split_once(':').map_or(spec, |(model, _)| model);
    let is_model = ["lambert", "ward", "ggx", "velvet", "satin"].contains(&model);
    (!is_model).then(|| Path::new(spec))
}

/// Directional albedo of `sample` under light from `wi`: ∫ f·cosθo dωo, per channel.
///
/// By quadrature, 1,440 directions at equal steps of sin²θ, which weigh each with its cosine alike; a lobe narrower than
/// some degrees it does not resolve.
#[must_use]
pub fn albedo(sample: &dyn Sample, wi: DVec3) -> [f64; 3] {
    const RINGS: usize = 60;
    const AZIMUTHS: usize = 24;
    let lobe = sample.incident(wi);
    let mut sum = [0.0; 3];
    for ring in 0..RINGS {
        let theta_rad = ((ring as f64 + 0.5) / RINGS as f64).sqrt().asin();
        for azimuth in 0..AZIMUTHS {
            let phi_rad = azimuth as f64 / AZIMUTHS as f64 * std::f64::consts::TAU;
            for (sum, f) in sum.iter_mut().zip(lobe.f(from_angles(theta_rad, phi_rad))) {
                *sum += f * std::f64::consts::PI / (RINGS * AZIMUTHS) as f64;
            }
        }
    }
    sum
}

/// Whether nothing passes because `w` is at or below the horizon (or not a direction at all).
fn below_horizon(w: DVec3) -> bool {
    !is_above_horizon(w)
}

/// Any material under an incident direction that is at or below the horizon.
struct Unlit;

impl Outgoing for Unlit {
    fn f(&self, _wo: DVec3) -> [f64; 3] {
        [0.0; 3]
    }
}

#[cfg(test)]
mod tests;
