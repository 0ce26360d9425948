//! The anisotropic Trowbridge–Reitz ("GGX") microfacet model over a Lambert base.
//!
//! f = rd/π + D(h) · G₂(ωi, ωo) · F(ωi·h) / (4 cosθi cosθo), where h is the half vector and
//! - D = 1 / (π αx αy ((hx/αx)² + (hy/αy)² + hz²)²), Trowbridge–Reitz,
//! - G₂ = 1 / (1 + Λ(ωi) + Λ(ωo)), Smith masking correlated in height,
//!   Λ(ω) = (√(1 + (αx²ωx² + αy²ωy²)/ωz²) − 1) / 2,
//! - F = f0 + (1 − f0)(1 − ωi·h)⁵, Schlick.
//!
//! Source: E. Heitz, "Understanding the masking-shadowing function in microfacet-based BRDFs", JCGT 3(2), 2014.
//!
//! # Tradeoffs
//! The Lambert term is a plain sum, not coupled to the Fresnel term. f0 + rd ≤ 1 keeps the directional albedo
//! below 1 at normal incidence; towards grazing Schlick's term grows, and a smooth surface over a bright base can
//! then exceed 1 (by quadrature: 1.07 at 80° for f0 0.5, α 0.1, rd 0.5). The presets stay below 1, and
//! so does any surface with rd = 0. Light scattered more than once between facets is lost.

use std::f64::consts::{FRAC_1_PI, PI};

use glam::DVec3;

use super::spec::{self, Parameter, Preset};
use super::{Outgoing, Sample, SampleError, Unlit, across, below_horizon};

const PARAMETERS: [Parameter; 4] = [
    Parameter {
        key: "f0",
        min: 0.0,
        max: 1.0,
    },
    // Below 0.001 the lobe is far narrower than any pixel.
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
    Parameter {
        key: "rd",
        min: 0.0,
        max: 1.0,
    },
];

const PRESETS: [Preset<4>; 3] = [
    ("metal", [0.9, 0.1, 0.2, 0.05]),
    ("satin", [0.6, 0.15, 0.35, 0.1]),
    ("plastic", [0.04, 0.15, 0.15, 0.5]),
];

/// Anisotropic microfacet material over a Lambert base, grey.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ggx {
    /// Fresnel reflectance at normal incidence, 0–1.
    pub f0: f64,
    /// Roughness along +x, αx, in (0, 1].
    pub alpha_x: f64,
    /// Roughness along +y, αy, in (0, 1].
    pub alpha_y: f64,
    /// Albedo of the Lambert base, 0–1; f0 + rd ≤ 1.
    pub rho_d: f64,
}

impl Ggx {
    /// Brushed metal, the default: f0 0.9, αx 0.1, αy 0.2, rd 0.05.
    pub const METAL: Self = Self::from_values(PRESETS[0].1);
    /// Satin-finished metal with a broad anisotropic lobe: f0 0.6, αx 0.15, αy 0.35, rd 0.1.
    pub const SATIN: Self = Self::from_values(PRESETS[1].1);
    /// Isotropic semi-gloss plastic: f0 0.04, αx = αy = 0.15, rd 0.5.
    pub const PLASTIC: Self = Self::from_values(PRESETS[2].1);

    const fn from_values([f0, alpha_x, alpha_y, rho_d]: [f64; 4]) -> Self {
        Self {
            f0,
            alpha_x,
            alpha_y,
            rho_d,
        }
    }

    /// Under light from `wi`, above the horizon.
    fn lit(&self, wi: DVec3) -> Lit {
        let lit = Lit {
            wi,
            diffuse: self.rho_d * FRAC_1_PI,
            f0: self.f0,
            distribution: 1.0 / (2.0 * PI * self.alpha_x * self.alpha_y),
            alpha_x2: self.alpha_x * self.alpha_x,
            alpha_y2: self.alpha_y * self.alpha_y,
            inv_alpha_x2: self.alpha_x.powi(-2),
            inv_alpha_y2: self.alpha_y.powi(-2),
            masking: 0.0,
        };
        let masking = lit.masking(wi);
        Lit { masking, ..lit }
    }

    /// From what follows the colon in `spec`.
    pub(super) fn from_arguments(spec: &str, arguments: Option<&str>) -> Result<Self, SampleError> {
        let ggx = Self::from_values(spec::values(spec, arguments, &PARAMETERS, &PRESETS)?);
        let total = ggx.f0 + ggx.rho_d;
        if total > 1.0 {
            return Err(spec::error(spec, "f0 + rd", "at most 1", &format!("{total}")));
        }
        Ok(ggx)
    }
}

/// Of a lobe under one incident direction what it has at f0 = 0, and by how much more it has at f0 = 1, in sr⁻¹, in place of the first
/// two channels: f is linear in f0.
pub(crate) struct LobeParts(Lit);

impl LobeParts {
    /// Of roughness `alpha_x` and `alpha_y`; nothing of light from below.
    pub(crate) fn incident([alpha_x, alpha_y]: [f64; 2], wi: DVec3) -> Box<dyn Outgoing> {
        let lobe = Ggx {
            f0: 0.0,
            alpha_x,
            alpha_y,
            rho_d: 0.0,
        };
        if below_horizon(wi) {
            return Box::new(Unlit);
        }
        Box::new(Self(lobe.lit(wi)))
    }
}

impl Outgoing for LobeParts {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        if below_horizon(wo) {
            return [0.0; 3];
        }
        let [facets, grazing5, _] = self.0.facets(wo);
        [facets * grazing5, facets * (1.0 - grazing5), 0.0]
    }
}

impl Sample for Ggx {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        if below_horizon(wi) {
            return Box::new(Unlit);
        }
        Box::new(self.lit(wi))
    }

    fn is_isotropic(&self) -> bool {
        self.alpha_x.total_cmp(&self.alpha_y).is_eq()
    }
}

/// A GGX surface under an incident direction above the horizon.
struct Lit {
    wi: DVec3,
    /// rd/π.
    diffuse: f64,
    f0: f64,
    /// 1 / (2π αx αy): the constant of D and of G₂/(4 cosθi cosθo) together.
    distribution: f64,
    /// αx² and αy², and their inverses.
    alpha_x2: f64,
    alpha_y2: f64,
    inv_alpha_x2: f64,
    inv_alpha_y2: f64,
    /// `self.masking(wi)`.
    masking: f64,
}

impl Lit {
    /// (1 + 2Λ(w)) cosθ of a direction, free of the division by cosθ.
    fn masking(&self, w: DVec3) -> f64 {
        (w.z * w.z + self.alpha_x2 * w.x * w.x + self.alpha_y2 * w.y * w.y).sqrt()
    }

    /// f of the surface alone, and the cosine of the angle to the half vector.
    fn surface(&self, wo: DVec3) -> [f64; 2] {
        let [facets, grazing5, cos] = self.facets(wo);
        [facets * (self.f0 + (1.0 - self.f0) * grazing5), cos]
    }

    /// f of the surface if its facets were perfect mirrors, Schlick's (1 − ωi·h)⁵, and ωi·h.
    fn facets(&self, wo: DVec3) -> [f64; 3] {
        let h = self.wi + wo;
        let length2 = h.length_squared();
        // D is homogeneous of degree −4 in h, so h need not be normalised.
        let ellipse = (h.x * h.x * self.inv_alpha_x2 + h.y * h.y * self.inv_alpha_y2 + h.z * h.z) / length2;
        // G₂/(4 cosθi cosθo) = 1 / (2 (cosθo·masking(ωi) + cosθi·masking(ωo))).
        let visibility = wo.z * self.masking + self.wi.z * self.masking(wo);
        // For unit vectors ωi·h/|h| = |h|/2.
        let cos = 0.5 * length2.sqrt();
        let grazing = (1.0 - cos).max(0.0);
        let grazing2 = grazing * grazing;
        [
            self.distribution / (ellipse * ellipse * visibility),
            grazing2 * grazing2 * grazing,
            cos,
        ]
    }
}

impl Outgoing for Lit {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        if below_horizon(wo) {
            return [0.0; 3];
        }
        [self.diffuse + self.surface(wo)[0]; 3]
    }

    fn across(&self, wo: DVec3) -> [f64; 3] {
        if below_horizon(wo) {
            return [0.0; 3];
        }
        let [surface, cos] = self.surface(wo);
        [surface * across(self.f0, cos); 3]
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
    fn agrees_with_the_textbook_form() {
        let Ggx {
            f0,
            alpha_x: ax,
            alpha_y: ay,
            rho_d,
        } = Ggx::METAL;
        let (wi, wo) = (from_degrees(40.0, 10.0), from_degrees(70.0, 200.0));
        let h = (wi + wo).normalize();
        let d = 1.0 / (PI * ax * ay * ((h.x / ax).powi(2) + (h.y / ay).powi(2) + h.z.powi(2)).powi(2));
        let lambda =
            |w: DVec3| ((1.0 + ((ax * w.x).powi(2) + (ay * w.y).powi(2)) / w.z.powi(2)).sqrt() - 1.0) / 2.0;
        let g2 = 1.0 / (1.0 + lambda(wi) + lambda(wo));
        let fresnel = f0 + (1.0 - f0) * (1.0 - wi.dot(h)).powi(5);
        close(
            Ggx::METAL.f(wi, wo)[2],
            rho_d / PI + d * g2 * fresnel / (4.0 * wi.z * wo.z),
        );
    }

    #[test]
    fn distribution_of_normals_covers_the_surface_once() {
        // ∫ D cosθh dω = 1; at ωi = +z with f0 = 1, rd = 0 the BRDF gives D by f = D·G₂/(4 cosθo).
        let ggx = Ggx {
            f0: 1.0,
            alpha_x: 0.3,
            alpha_y: 0.6,
            rho_d: 0.0,
        };
        let lit = ggx.incident(DVec3::Z);
        let (n_theta, n_phi) = (400, 400);
        // Over normals up to 45° only: beyond, the mirror direction is below the horizon.
        let mut covered = 0.0;
        for i in 0..n_theta {
            let theta_rad = (f64::from(i) + 0.5) / f64::from(n_theta) * PI / 4.0;
            for j in 0..n_phi {
                let phi_rad = (f64::from(j) + 0.5) / f64::from(n_phi) * 2.0 * PI;
                let wo = crate::hemisphere::direction::from_angles(2.0 * theta_rad, phi_rad);
                let lambda =
                    ((1.0 + ((0.3 * wo.x).powi(2) + (0.6 * wo.y).powi(2)) / wo.z.powi(2)).sqrt() - 1.0) / 2.0;
                let d = lit.f(wo)[0] * 4.0 * wo.z * (1.0 + lambda);
                covered += d * theta_rad.cos() * theta_rad.sin();
            }
        }
        covered *= PI / 4.0 / f64::from(n_theta) * 2.0 * PI / f64::from(n_phi);
        // The same share analytically, by the slope t = tanθ and q = cos²φ/αx² + sin²φ/αy².
        let mut expected = 0.0;
        for j in 0..n_phi {
            let phi_rad = (f64::from(j) + 0.5) / f64::from(n_phi) * 2.0 * PI;
            let q = (phi_rad.cos() / 0.3).powi(2) + (phi_rad.sin() / 0.6).powi(2);
            // ∫ t dt / (π αx αy (1 + q t²)²) from 0 to 1 = 1/(2π αx αy (1 + q)).
            expected += 1.0 / (2.0 * PI * 0.3 * 0.6 * (1.0 + q)) * 2.0 * PI / f64::from(n_phi);
        }
        assert!(
            (covered - expected).abs() < 1e-4,
            "{covered} instead of {expected}"
        );
    }
}
