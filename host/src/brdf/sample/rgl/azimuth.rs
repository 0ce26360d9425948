//! Incident azimuths: which part of the circle a file tabulates, and how the rest follows by symmetry.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;

use glam::{DMat2, DVec2, DVec3};

use crate::brdf::sample::SampleError;
use crate::brdf::sample::tensor_file::file_error;

/// Allowed error of tabulated angles in rad: they are single-precision numbers, some written from rounded degrees.
pub(super) const ANGLE_TOLERANCE_RAD: f64 = 1e-3;

/// How the tabulated incident azimuths cover the circle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Azimuth {
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
    pub(super) fn of(phi_i_rad: &[f64], path: &Path) -> Result<Self, SampleError> {
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
    pub(super) fn to_table(self, wi: DVec3) -> DMat2 {
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
    pub(super) fn unwind(self, phi_rad: f64) -> f64 {
        let middle = match self {
            Self::Relative => return phi_rad,
            Self::Full(middle) | Self::Half(middle) | Self::Quadrant(middle) => middle,
        };
        middle + (phi_rad - middle + PI).rem_euclid(TAU) - PI
    }
}
