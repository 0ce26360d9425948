//! Lambert's law: the perfectly diffuse reflector, the model of a reflectance standard.

use std::f64::consts::FRAC_1_PI;

use glam::DVec3;

use super::spec::{self, Parameter};
use super::{Outgoing, Sample, SampleError, Unlit, below_horizon};

const ALBEDO: Parameter = Parameter {
    key: "albedo",
    min: 0.0,
    max: 1.0,
};

/// Perfectly diffuse material, f = albedo/π.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lambert {
    /// Reflected fraction of the incident power of each channel, 0–1, for every incident direction.
    pub albedo: [f64; 3],
}

impl Default for Lambert {
    fn default() -> Self {
        Self { albedo: [0.5; 3] }
    }
}

impl Lambert {
    /// From what follows the colon in `spec`: nothing, the albedo, or those of red, green and blue.
    pub(super) fn from_arguments(spec: &str, arguments: Option<&str>) -> Result<Self, SampleError> {
        let Some(text) = arguments else {
            return Ok(Self::default());
        };
        let each: Vec<&str> = text.split(',').collect();
        let number = |text: &str| spec::number(spec, &ALBEDO, text);
        let albedo = match *each.as_slice() {
            [red, green, blue] => [number(red)?, number(green)?, number(blue)?],
            _ => [number(text)?; 3],
        };
        Ok(Self { albedo })
    }
}

impl Sample for Lambert {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        if below_horizon(wi) {
            Box::new(Unlit)
        } else {
            Box::new(Lit {
                f: self.albedo.map(|albedo| albedo * FRAC_1_PI),
            })
        }
    }

    fn is_isotropic(&self) -> bool {
        true
    }
}

/// A Lambert surface under an incident direction above the horizon.
struct Lit {
    f: [f64; 3],
}

impl Outgoing for Lit {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        if below_horizon(wo) { [0.0; 3] } else { self.f }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;

    #[test]
    fn is_constant_above_the_horizon_and_zero_below() {
        let albedo = [0.8, 0.4, 0.1];
        let sample = Lambert { albedo };
        let up = from_degrees(20.0, 70.0);
        for (theta_deg, lit) in [(0.0, true), (89.9, true), (90.0, false), (120.0, false)] {
            let w = from_degrees(theta_deg, 200.0);
            let expected = albedo.map(|albedo| if lit { albedo * FRAC_1_PI } else { 0.0 });
            let is_expected = |f: [f64; 3]| f.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-15);
            assert!(is_expected(sample.f(up, w)), "outgoing at {theta_deg}");
            assert!(is_expected(sample.f(w, up)), "incident at {theta_deg}");
        }
    }
}
