//! Ward's model of anisotropic reflection, with which the RCG paper simulates its instrument.
//!
//! Source: G. J. Ward, "Measuring and modeling anisotropic reflection", SIGGRAPH 1992, in the
//! half-vector form (with h = ωi + ωo, not normalised):
//!
//! f = ρd/π + ρs / (4π αx αy √(cosθi cosθo)) · exp(−((hx/αx)² + (hy/αy)²) / hz²)
//!
//! # Tradeoffs
//! This is the original model: reciprocal, but not energy conserving at grazing angles, where 1/√(cosθi cosθo)
//! grows without bound. It is kept so because published parameters belong to it.

use std::f64::consts::{FRAC_1_PI, PI};

use glam::DVec3;

use super::spec::{self, Parameter, Preset};
use super::{Outgoing, Sample, SampleError, Unlit, across, below_horizon};

const PARAMETERS: [Parameter; 4] = [
    Parameter {
        key: "rd",
        min: 0.0,
        max: 1.0,
    },
    Parameter {
        key: "rs",
        min: 0.0,
        max: 1.0,
    },
    // Slopes below 0.001 make lobes far narrower than any pixel; above 1 the model is meaningless.
    Parameter {
        key: "ax",
        min: 0.001,
        max: 1.0,
    },
    Parameter {
        key: "ay",
        min: 0.001,
        max: 1.0,
    },
];

const PRESETS: [Preset<4>; 1] = [("brass", [0.10, 0.33, 0.05, 0.16])];

/// Ward's anisotropic material, grey.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ward {
    /// Diffuse reflectance ρd, 0–1.
    pub rho_d: f64,
    /// Specular reflectance ρs, 0–1; ρd + ρs ≤ 1.
    pub rho_s: f64,
    /// Standard deviation of the surface slope along +x, αx, in (0, 1].
    pub alpha_x: f64,
    /// Standard deviation of the surface slope along +y, αy, in (0, 1].
    pub alpha_y: f64,
}

impl Ward {
    /// Rolled brass as Ward measured it: ρd 0.10, ρs 0.33, αx 0.05, αy 0.16.
    pub const BRASS: Self = Self::from_values(PRESETS[0].1);

    const fn from_values([rho_d, rho_s, alpha_x, alpha_y]: [f64; 4]) -> Self {
        Self {
            rho_d,
            rho_s,
            alpha_x,
            alpha_y,
        }
    }

    /// From what follows the colon in `spec`.
    pub(super) fn from_arguments(spec: &str, arguments: Option<&str>) -> Result<Self, SampleError> {
        let ward = Self::from_values(spec::values(spec, arguments, &PARAMETERS, &PRESETS)?);
        let total = ward.rho_d + ward.rho_s;
        if total > 1.0 {
            return Err(spec::error(spec, "rd + rs", "at most 1", &format!("{total}")));
        }
        Ok(ward)
    }
}

impl Sample for Ward {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        if below_horizon(wi) {
            return Box::new(Unlit);
        }
        Box::new(Lit {
            wi,
            diffuse: self.rho_d * FRAC_1_PI,
            specular: self.rho_s / (4.0 * PI * self.alpha_x * self.alpha_y * wi.z.sqrt()),
            inv_alpha_x2: self.alpha_x.powi(-2),
            inv_alpha_y2: self.alpha_y.powi(-2),
        })
    }

    fn is_isotropic(&self) -> bool {
        self.alpha_x.total_cmp(&self.alpha_y).is_eq()
    }
}

/// A Ward surface under an incident direction above the horizon.
struct Lit {
    wi: DVec3,
    /// ρd/π.
    diffuse: f64,
    /// ρs / (4π αx αy √cosθi).
    specular: f64,
    /// αx⁻².
    inv_alpha_x2: f64,
    /// αy⁻².
    inv_alpha_y2: f64,
}

/// Reflectance of a lobe's surface at normal incidence, as far as polarisation is concerned: Ward's are those of metals.
const F0: f64 = 0.6;

impl Lit {
    /// f of the lobe alone.
    fn lobe(&self, wo: DVec3) -> f64 {
        let h = self.wi + wo;
        let slope2 = (h.x * h.x * self.inv_alpha_x2 + h.y * h.y * self.inv_alpha_y2) / (h.z * h.z);
        self.specular * (-slope2).exp() / wo.z.sqrt()
    }
}

impl Outgoing for Lit {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        if below_horizon(wo) {
            return [0.0; 3];
        }
        [self.diffuse + self.lobe(wo); 3]
    }

    fn across(&self, wo: DVec3) -> [f64; 3] {
        if below_horizon(wo) {
            return [0.0; 3];
        }
        [self.lobe(wo) * across(F0, 0.5 * (self.wi + wo).length()); 3]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;

    fn close(found: f64, expected: f64) {
        assert!(
            (found / expected - 1.0).abs() < 1e-12,
            "{found} instead of {expected}"
        );
    }

    #[test]
    fn peak_of_brass_is_the_literal_value() {
        // 0.1/π + 0.33/(4π·0.05·0.16), computed by itself.
        close(Ward::BRASS.f(DVec3::Z, DVec3::Z)[0], PEAK_OF_BRASS);
    }
    const PEAK_OF_BRASS: f64 = 3.314_401_689_888_720_5;

    #[test]
    fn agrees_with_the_angular_form() {
        let (wi, wo) = (from_degrees(35.0, 20.0), from_degrees(50.0, 190.0));
        let h = (wi + wo).normalize();
        let (delta_rad, phi_rad) = crate::hemisphere::direction::to_angles(h);
        let Ward {
            rho_d,
            rho_s,
            alpha_x,
            alpha_y,
        } = Ward::BRASS;
        let exponent =
            delta_rad.tan().powi(2) * ((phi_rad.cos() / alpha_x).powi(2) + (phi_rad.sin() / alpha_y).powi(2));
        let expected =
            rho_d / PI + rho_s / (4.0 * PI * alpha_x * alpha_y * (wi.z * wo.z).sqrt()) * (-exponent).exp();
        close(Ward::BRASS.f(wi, wo)[1], expected);
    }

    #[test]
    fn x_is_the_narrow_axis_of_brass() {
        let along_x = Ward::BRASS.f(DVec3::Z, from_degrees(15.0, 0.0))[0];
        let along_y = Ward::BRASS.f(DVec3::Z, from_degrees(15.0, 90.0))[0];
        assert!(along_y > 10.0 * along_x, "{along_x} {along_y}");
    }
}
