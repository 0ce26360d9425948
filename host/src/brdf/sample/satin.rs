//! Satin: long floats of warp thread, crossed here and there by weft, each thread a glossy cylinder.
//!
//! f = (1 − w) · G(αx = s, αy = c) + w · G(αx = c, αy = s), where w is the share of the surface that shows weft and
//! G the [`Ggx`] model: a thread along +x (the warp) is nearly flat along its length, roughness s, and round
//! across it, roughness c, so that its highlight is a streak across the thread.
//!
//! Source: the sum over thread directions by the area that they show is that of I. Sadeghi et al., "A practical
//! microcylinder appearance model for cloth rendering", ACM TOG 32(2), 2013. The lobe of a thread is simpler here:
//! an anisotropic microfacet one instead of a scattering cylinder.
//!
//! # Tradeoffs
//! Threads do not shade each other across the two systems. What makes up for it: a mean of two reciprocal and energy
//! conserving models is both itself.

use glam::DVec3;

use super::ggx::Ggx;
use super::spec::{self, Parameter, Preset};
use super::{Outgoing, Sample, SampleError};

const PARAMETERS: [Parameter; 5] = [
    Parameter {
        key: "f0",
        min: 0.0,
        max: 1.0,
    },
    Parameter {
        key: "along",
        min: 0.001,
        max: 1.0,
    },
    Parameter {
        key: "across",
        min: 0.001,
        max: 1.0,
    },
    Parameter {
        key: "weft",
        min: 0.0,
        max: 1.0,
    },
    Parameter {
        key: "rd",
        min: 0.0,
        max: 1.0,
    },
];

const PRESETS: [Preset<5>; 1] = [("silk", [0.3, 0.14, 0.6, 0.2, 0.12])];

/// Satin-like anisotropic cloth, grey.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Satin {
    /// Threads along +x.
    warp: Ggx,
    /// Threads along +y: the same thread turned.
    weft: Ggx,
    /// Share of the surface that shows weft, 0–1.
    weft_share: f64,
}

impl Satin {
    /// From what follows the colon in `spec`; by default silk: f0 0.3, along 0.14, across 0.6, weft 0.2, rd 0.12.
    pub(super) fn from_arguments(spec: &str, arguments: Option<&str>) -> Result<Self, SampleError> {
        let [f0, along, across, weft_share, rho_d] = spec::values(spec, arguments, &PARAMETERS, &PRESETS)?;
        let total = f0 + rho_d;
        if total > 1.0 {
            return Err(spec::error(spec, "f0 + rd", "at most 1", &format!("{total}")));
        }
        let thread = |alpha_x, alpha_y| Ggx {
            f0,
            alpha_x,
            alpha_y,
            rho_d,
        };
        Ok(Self {
            warp: thread(along, across),
            weft: thread(across, along),
            weft_share,
        })
    }
}

impl Sample for Satin {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        Box::new(Lit {
            warp: self.warp.incident(wi),
            weft: self.weft.incident(wi),
            weft_share: self.weft_share,
        })
    }

    fn is_isotropic(&self) -> bool {
        self.warp.is_isotropic()
    }
}

/// Both systems of threads under one incident direction.
struct Lit<'a> {
    warp: Box<dyn Outgoing + 'a>,
    weft: Box<dyn Outgoing + 'a>,
    weft_share: f64,
}

impl Lit<'_> {
    /// Of what both systems do.
    fn mean(&self, warp: [f64; 3], weft: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|c| (1.0 - self.weft_share) * warp[c] + self.weft_share * weft[c])
    }
}

impl Outgoing for Lit<'_> {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        let (warp, weft) = (self.warp.f(wo), self.weft.f(wo));
        self.mean(warp, weft)
    }

    fn across(&self, wo: DVec3) -> [f64; 3] {
        self.mean(self.warp.across(wo), self.weft.across(wo))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::sample::parse;
    use crate::hemisphere::direction::from_degrees;

    #[test]
    fn highlight_of_warp_is_a_streak_across_the_threads() {
        let satin = parse("satin:weft=0").unwrap();
        let along = satin.f(DVec3::Z, from_degrees(40.0, 0.0))[0];
        let across = satin.f(DVec3::Z, from_degrees(40.0, 90.0))[0];
        assert!(across > 2.0 * along, "{along} {across}");
    }

    #[test]
    fn as_much_weft_as_warp_makes_a_quarter_turn_a_symmetry() {
        let satin = parse("satin:weft=0.5").unwrap();
        let (wi, wo) = (from_degrees(30.0, 20.0), from_degrees(50.0, 170.0));
        let turned = |w: DVec3| DVec3::new(-w.y, w.x, w.z);
        let (before, after) = (satin.f(wi, wo)[0], satin.f(turned(wi), turned(wo))[0]);
        assert!((before / after - 1.0).abs() < 1e-12, "{before} {after}");
        let silk = parse("satin").unwrap();
        let (before, after) = (silk.f(wi, wo)[0], silk.f(turned(wi), turned(wo))[0]);
        assert!((before / after - 1.0).abs() > 0.1, "{before} {after}");
    }
}
