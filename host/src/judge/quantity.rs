//! The quantities in which reflectance is stated.
//!
//! # Design
//! All are f times what the pair of directions says. In the limit of small solid angles, which light and pixels are, reflectance
//! factor and radiance factor are the same number, π·f (Nicodemus et al., *Geometrical Considerations and Nomenclature for
//! Reflectance*, NBS Monograph 160, 1977; CIE 17.4).

use std::f64::consts::PI;
use std::fmt;

use glam::DVec3;
use serde::Serialize;

/// Luma (BT.601) of three channels.
pub(crate) fn luma(rgb: [f32; 3]) -> f64 {
    let [r, g, b] = rgb.map(f64::from);
    0.299 * r + 0.587 * g + 0.114 * b
}

/// What is stated of a pair of directions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quantity {
    /// f in sr⁻¹, without the cosine.
    #[default]
    Brdf,
    /// Cosine-corrected BRDF f·cosθo in sr⁻¹: radiant intensity over incident flux (ASTM E2387).
    Ccbrdf,
    /// Reflectance factor R = π·f: over what a perfect diffuser reflects into the same solid angle.
    ReflectanceFactor,
    /// Radiance factor β = π·f: over the radiance of a perfect diffuser lit alike.
    RadianceFactor,
}

impl Quantity {
    /// All of them, as the command takes them.
    pub const ALL: [Self; 4] = [
        Self::Brdf,
        Self::Ccbrdf,
        Self::ReflectanceFactor,
        Self::RadianceFactor,
    ];

    /// Its name on the command line and in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Brdf => "brdf",
            Self::Ccbrdf => "ccbrdf",
            Self::ReflectanceFactor => "reflectance-factor",
            Self::RadianceFactor => "radiance-factor",
        }
    }

    /// That with this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|quantity| quantity.name() == name)
    }

    /// Its symbol with its unit, in JSON.
    #[must_use]
    pub fn key(self) -> String {
        format!("{}{}", self.column(), self.column_unit())
    }

    /// Its symbol in heads of columns.
    #[must_use]
    pub(crate) const fn column(self) -> &'static str {
        match self {
            Self::Brdf => "f",
            Self::Ccbrdf => "f_cos",
            Self::ReflectanceFactor => "reflectance_factor",
            Self::RadianceFactor => "radiance_factor",
        }
    }

    /// Its unit in heads of columns.
    #[must_use]
    pub(crate) const fn column_unit(self) -> &'static str {
        match self {
            Self::Brdf | Self::Ccbrdf => "_per_sr",
            Self::ReflectanceFactor | Self::RadianceFactor => "",
        }
    }

    /// Its symbol and unit, for axes.
    #[must_use]
    pub(crate) fn label(self) -> String {
        match self {
            Self::Brdf => "BRDF f (1/sr)",
            Self::Ccbrdf => "cosine-corrected BRDF f·cosθr (1/sr)",
            Self::ReflectanceFactor => "reflectance factor π·f",
            Self::RadianceFactor => "radiance factor π·f",
        }
        .to_owned()
    }

    /// What f in sr⁻¹ is multiplied with for the outgoing unit vector `wo`.
    #[must_use]
    pub fn factor(self, wo: DVec3) -> f64 {
        match self {
            Self::Brdf => 1.0,
            Self::Ccbrdf => wo.z,
            Self::ReflectanceFactor | Self::RadianceFactor => PI,
        }
    }
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::sample::parse;
    use crate::hemisphere::direction::from_degrees;

    #[test]
    fn a_perfect_diffuser_has_factors_of_one_and_the_intensity_of_a_cosine() {
        let (wi, wo) = (from_degrees(20.0, 10.0), from_degrees(60.0, 200.0));
        let f = parse("lambert:1").unwrap().f(wi, wo)[0];
        let of = |quantity: Quantity| f * quantity.factor(wo);
        let found = Quantity::ALL.map(of);
        for (found, expected) in found.into_iter().zip([1.0 / PI, 0.5 / PI, 1.0, 1.0]) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        for quantity in Quantity::ALL {
            assert_eq!(Quantity::named(quantity.name()), Some(quantity));
        }
        assert_eq!(Quantity::named("f"), None);
    }
}
