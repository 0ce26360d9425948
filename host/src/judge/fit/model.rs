//! Models that can be fitted, as sums of a diffuse part and a lobe.

use std::f64::consts::FRAC_1_PI;

use super::observations::Observation;
use crate::brdf::quadrature::mean_f;
use crate::brdf::sample::{Ggx, Sample, Ward};

/// Which model is fitted.
///
/// Both have a roughness along +x and +y, αx and αy, common to all channels, and for each channel a diffuse reflectance
/// ρd and the strength of the lobe, Ward's ρs or the reflectance F0 at normal incidence of GGX.
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
    pub(super) const fn name(self) -> &'static str {
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
    pub(crate) fn sample(self, [alpha_x, alpha_y]: [f64; 2], rho_d: f64, strength: f64) -> Box<dyn Sample> {
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
    pub(super) fn parts(self, alpha: [f64; 2], seen: &Observation) -> [f64; 2] {
        let mean = |strength| {
            let sample = self.sample(alpha, 0.0, strength);
            mean_f(&seen.light.map(|wi| sample.incident(wi)), &seen.places.map(Some))[0]
        };
        let none = match self {
            Self::Ward => 0.0,
            Self::Ggx => mean(0.0),
        };
        [none, mean(1.0) - none]
    }
}

/// f of a Lambertian surface of reflectance 1, in sr⁻¹.
pub(super) const WHITE: f64 = FRAC_1_PI;

/// f in sr⁻¹ from the [`Model::parts`] of a sample.
pub(super) fn combine(parts: [f64; 2], rho_d: f64, strength: f64) -> f64 {
    rho_d * WHITE + parts[0] + strength * parts[1]
}
