//! Models that can be fitted, as sums of a diffuse part and a lobe.

use std::f64::consts::FRAC_1_PI;

use super::observations::Observation;
use super::shape::Shape;
use crate::brdf::quadrature::mean_f;
use crate::brdf::sample::{Ggx, LobeParts, Sample, Turned, Ward};

/// Which model is fitted.
///
/// Both have a roughness along two axes of the sample, αx and αy, and the azimuth of the first, common to all channels, and for each
/// channel a diffuse reflectance ρd and the strength of the lobe, Ward's ρs or the reflectance F0 at normal incidence of GGX.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// [`Ward`]
    Ward,
    /// [`Ggx`]
    Ggx,
}

impl Model {
    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ward => "Ward",
            Self::Ggx => "GGX",
        }
    }

    /// Name of the strength of the lobe.
    pub(super) const fn strength(self) -> &'static str {
        match self {
            Self::Ward => "rs",
            Self::Ggx => "f0",
        }
    }

    /// The model with the same numbers in all channels.
    pub(crate) fn sample(self, shape: Shape, rho_d: f64, strength: f64) -> Box<dyn Sample> {
        let along_axes = self.along_axes(shape.alpha, rho_d, strength);
        if shape.azimuth_rad.abs() > 0.0 {
            Box::new(Turned::new(along_axes, shape.azimuth_rad))
        } else {
            along_axes
        }
    }

    fn along_axes(self, [alpha_x, alpha_y]: [f64; 2], rho_d: f64, strength: f64) -> Box<dyn Sample> {
        match self {
            Self::Ward => Box::new(Ward {
                rho_d,
                rho_s: strength,
                alpha_x,
                alpha_y,
            }),
            Self::Ggx => Box::new(Ggx {
                f0: strength,
                alpha_x,
                alpha_y,
                rho_d,
            }),
        }
    }

    /// Means over light and pixel of the parts of f = ρd/π + `0` + strength·`1`, in sr⁻¹.
    pub(super) fn parts(self, shape: Shape, seen: &Observation) -> [f64; 2] {
        let (light, places) = (shape.along_axes(&seen.light), shape.along_axes(&seen.places));
        let (places, alpha) = (places.map(Some), shape.alpha);
        match self {
            Self::Ward => {
                let lobe = self.along_axes(alpha, 0.0, 1.0);
                [0.0, mean_f(&light.map(|wi| lobe.incident(wi)), &places)[0]]
            }
            Self::Ggx => {
                let [none, rise, _] = mean_f(&light.map(|wi| LobeParts::incident(alpha, wi)), &places);
                [none, rise]
            }
        }
    }
}

/// f of a Lambertian surface of reflectance 1, in sr⁻¹.
pub(super) const WHITE: f64 = FRAC_1_PI;

/// f in sr⁻¹ from the [`Model::parts`] of a sample.
pub(super) fn combine(parts: [f64; 2], rho_d: f64, strength: f64) -> f64 {
    rho_d * WHITE + parts[0] + strength * parts[1]
}
