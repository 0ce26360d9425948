//! Velvet: a pile of upright fibres, whose facets mostly look sideways, over a Lambert base.
//!
//! f = rd/π + rs · D(h) / (4 (cosθi + cosθo − cosθi cosθo)), where h is the half vector and
//! D = (1 + 4 exp(−cot²θh (cos²φh/αx² + sin²φh/αy²)) / sin⁴θh) / (π (1 + 4 αx αy)):
//! an inverted Gaussian, dark where the cloth is looked at straight on and bright towards its edges.
//!
//! Source: M. Ashikhmin, S. Premože, P. Shirley, "A microfacet-based BRDF generator", SIGGRAPH 2000 (inverted
//! Gaussian); M. Ashikhmin, S. Premože, "Distribution-based BRDFs", 2007 (the denominator); D. Neubelt, M. Pettineo,
//! "Crafting a next-gen material pipeline for The Order: 1886", SIGGRAPH 2013 course (1/sin⁴ and the amplitude 4 for
//! a distribution that can be normalised). Two widths instead of one are ours: ∫ D cosθ dω is still 1.
//!
//! # Tradeoffs
//! Fibres stand upright on average: pile that was brushed to one side would not be symmetric under a half turn.

use std::f64::consts::{FRAC_1_PI, PI};

use glam::DVec3;

use super::spec::{self, Parameter, Preset};
use super::{Outgoing, Sample, SampleError, Unlit, below_horizon};

/// Height of the inverted Gaussian above the uniform distribution of facets.
const AMPLITUDE: f64 = 4.0;

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
    // Below 0.05 the rim is narrower than any pixel; above 2 the cloth is no longer dark in the middle.
    Parameter {
        key: "ax",
        min: 0.05,
        max: 2.0,
    },
    Parameter {
        key: "ay",
        min: 0.05,
        max: 2.0,
    },
];

const PRESETS: [Preset<4>; 1] = [("pile", [0.03, 0.6, 0.7, 1.2])];

/// Velvet-like anisotropic cloth, grey.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Velvet {
    /// Albedo of the Lambert base, 0–1.
    pub rho_d: f64,
    /// Reflectance of a fibre, 0–1; rd + rs ≤ 1.
    pub rho_s: f64,
    /// Spread of the facets from upright along +x, as a cotangent, 0.05–2.
    pub alpha_x: f64,
    /// Spread of the facets from upright along +y, as a cotangent, 0.05–2.
    pub alpha_y: f64,
}

impl Velvet {
    /// The default: rd 0.03, rs 0.6, αx 0.7, αy 1.2.
    pub const PILE: Self = Self::from_values(PRESETS[0].1);

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
        let velvet = Self::from_values(spec::values(spec, arguments, &PARAMETERS, &PRESETS)?);
        let total = velvet.rho_d + velvet.rho_s;
        if total > 1.0 {
            return Err(spec::error(spec, "rd + rs", "at most 1", &format!("{total}")));
        }
        Ok(velvet)
    }
}

impl Sample for Velvet {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        if below_horizon(wi) {
            return Box::new(Unlit);
        }
        Box::new(Lit {
            wi,
            diffuse: self.rho_d * FRAC_1_PI,
            fibres: self.rho_s / (4.0 * PI * (1.0 + AMPLITUDE * self.alpha_x * self.alpha_y)),
            inv_alpha_x2: self.alpha_x.powi(-2),
            inv_alpha_y2: self.alpha_y.powi(-2),
        })
    }

    fn is_isotropic(&self) -> bool {
        self.alpha_x.total_cmp(&self.alpha_y).is_eq()
    }
}

/// Velvet under an incident direction above the horizon.
struct Lit {
    wi: DVec3,
    /// rd/π.
    diffuse: f64,
    /// rs / (4π (1 + 4 αx αy)).
    fibres: f64,
    /// αx⁻².
    inv_alpha_x2: f64,
    /// αy⁻².
    inv_alpha_y2: f64,
}

impl Outgoing for Lit {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        if below_horizon(wo) {
            return [0.0; 3];
        }
        let h = (self.wi + wo).normalize();
        let sin2 = h.x * h.x + h.y * h.y;
        // Straight up the exponential wins over 1/sin⁴.
        let inverted = if sin2 > 0.0 {
            let width = h.x * h.x * self.inv_alpha_x2 + h.y * h.y * self.inv_alpha_y2;
            (-h.z * h.z * width / (sin2 * sin2)).exp() / (sin2 * sin2)
        } else {
            0.0
        };
        let (ci, co) = (self.wi.z, wo.z);
        [self.diffuse + self.fibres * (1.0 + AMPLITUDE * inverted) / (ci + co - ci * co); 3]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;

    #[test]
    fn agrees_with_the_angular_form() {
        let (wi, wo) = (from_degrees(60.0, 20.0), from_degrees(70.0, 55.0));
        let (theta_rad, phi_rad) = crate::hemisphere::direction::to_angles((wi + wo).normalize());
        let Velvet {
            rho_d,
            rho_s,
            alpha_x,
            alpha_y,
        } = Velvet::PILE;
        let width = (phi_rad.cos() / alpha_x).powi(2) + (phi_rad.sin() / alpha_y).powi(2);
        let d = (1.0 + 4.0 * (-width / theta_rad.tan().powi(2)).exp() / theta_rad.sin().powi(4))
            / (PI * (1.0 + 4.0 * alpha_x * alpha_y));
        let expected = rho_d / PI + rho_s * d / (4.0 * (wi.z + wo.z - wi.z * wo.z));
        let found = Velvet::PILE.f(wi, wo)[1];
        assert!((found / expected - 1.0).abs() < 1e-12, "{found} {expected}");
    }

    #[test]
    fn distribution_of_facets_covers_the_surface_once() {
        // ∫ D cosθ dω = 1; at ωi = ωo the BRDF gives D, for rd 0 and rs 1.
        let velvet = Velvet {
            rho_d: 0.0,
            rho_s: 1.0,
            alpha_x: 0.3,
            alpha_y: 0.8,
        };
        let (n_sin2, n_phi) = (2000_u32, 400_u32);
        let mut covered = 0.0;
        for i in 0..n_sin2 {
            let sin2 = (f64::from(i) + 0.5) / f64::from(n_sin2);
            let theta_rad = sin2.sqrt().asin();
            for j in 0..n_phi {
                let h = crate::hemisphere::direction::from_angles(
                    theta_rad,
                    f64::from(j) / f64::from(n_phi) * 2.0 * PI,
                );
                covered += velvet.f(h, h)[0] * 4.0 * (2.0 * h.z - h.z * h.z);
            }
        }
        // cosθ dω = d(sin²θ) dφ / 2.
        covered *= PI / f64::from(n_sin2) / f64::from(n_phi);
        assert!((covered - 1.0).abs() < 1e-3, "{covered}");
    }

    #[test]
    fn edges_are_brighter_than_the_middle() {
        // Lit from behind the camera: f at 75° against f straight on.
        let straight = Velvet::PILE.f(DVec3::Z, DVec3::Z)[0];
        for phi_deg in [0.0, 90.0] {
            let edge = from_degrees(75.0, phi_deg);
            let ratio = Velvet::PILE.f(edge, edge)[0] / straight;
            assert!(ratio > 3.0, "{phi_deg}: {ratio}");
        }
    }
}
