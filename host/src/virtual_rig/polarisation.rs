//! Light of the virtual rig that is polarised a little, and a camera that prefers some of it.
//!
//! # Design
//! A plate beam splitter reflects and transmits light polarised across and along its plane of incidence differently, by some per cent even
//! where it is called non-polarising (±5 to 10 % in data sheets of such plates); panels polarise all of it. Depolarisers before both lenses leave
//! up to 1 or 2 % (data sheets of quartz wedges and of patterned retarders). What is left is polarised along, or across, the mirror's x
//! as the splitter lies, and the mirror turns it on the way to the sample.
//!
//! A first surface reflects more of what is polarised across the plane of light and view: there a sample looks brighter or darker by the degree of
//! polarisation times what it makes of it ([`Outgoing::across`]). What the degrees make together is left out: 10⁻⁴ of f.

use std::ops::RangeInclusive;

use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};

use super::flaws::log_uniform;
use crate::brdf::sample::Outgoing;
use crate::instrument::optics::{View, reflect};

/// Degrees of polarisation behind depolarisers: usually 0.5 %, 2 % of bad ones.
pub const POLARISATIONS: RangeInclusive<f64> = 2e-3..=2e-2;
/// What tells the chance of polarisation from that of the rest of the rig: the letters of `pola`.
const STREAM: u64 = 0x706f_6c61;

/// Degrees of polarisation along the mirror's x as camera and projector see it; less than 0 stands for across.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Polarisation {
    /// Of the light.
    pub projector: f64,
    /// By how much more the camera shows of light that is polarised so than of light that is not, relative.
    pub camera: f64,
}

impl Polarisation {
    /// By chance. Its chance is its own, so that it changes no other flaw that follows from the `seed`.
    pub(super) fn drawn(seed: u64) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed ^ STREAM);
        let mut one = || {
            let degree = log_uniform(POLARISATIONS, &mut rng);
            if rng.random_bool(0.5) { degree } else { -degree }
        };
        Self {
            projector: one(),
            camera: one(),
        }
    }

    /// The same with degrees as large as `degree`.
    pub(super) fn of_degree(self, degree: f64) -> Self {
        Self {
            projector: degree.copysign(self.projector),
            camera: degree.copysign(self.camera),
        }
    }

    pub(super) fn is_any(self) -> bool {
        self.projector != 0.0 || self.camera != 0.0
    }

    /// Factor of f towards `wo`, and what light of `lit` makes of it; `axes` are those of light and view (see [`axis`]).
    pub(super) fn factor(self, lit: &dyn Outgoing, [wi, wo]: [DVec3; 2], axes: [DVec3; 2]) -> [f64; 3] {
        let across = lit.across(wo);
        if across.iter().all(|across| *across == 0.0) {
            return [1.0; 3];
        }
        let f = lit.f(wo);
        let normal = wi.cross(wo).normalize_or_zero();
        let [projector, camera] = axes.map(|axis| 2.0 * axis.dot(normal).powi(2) - 1.0);
        let degree = self.projector * projector + self.camera * camera;
        std::array::from_fn(|channel| {
            if f[channel] > 0.0 {
                1.0 + degree * across[channel] / f[channel]
            } else {
                1.0
            }
        })
    }
}

/// The direction, sample frame, along which light from or to the direction `w` there is polarised whose polarisation lies along the
/// mirror's x at the device of this `view`.
pub(super) fn axis(view: &View, w: DVec3) -> DVec3 {
    let (ellipsoid, frame) = (view.ellipsoid(), view.frame());
    let point_m = ellipsoid.point_from_f1(frame.to_mirror(w));
    let ray = (point_m - ellipsoid.f2()).normalize_or(DVec3::Z);
    let at_device = DVec3::X.reject_from_normalized(ray).normalize_or(DVec3::Y);
    frame.to_sample(reflect(at_device, ellipsoid.normal(point_m)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::sample::parse;
    use crate::hemisphere::direction::from_degrees;
    use crate::instrument::rig::Rig;

    #[test]
    fn axes_lie_across_their_rays_and_a_mirror_keeps_those_in_its_planes() {
        let view = View::camera(&Rig::load("rcg-1-16bit").unwrap());
        for (theta_deg, phi_deg) in [(40.0, 0.0), (60.0, 90.0), (70.0, 200.0)] {
            let w = from_degrees(theta_deg, phi_deg);
            let axis = axis(&view, w);
            assert!(axis.dot(w).abs() < 1e-9 && (axis.length() - 1.0).abs() < 1e-9);
        }
        // The sample lies flat: in the plane of x it stays in that plane, in the plane of y it stays along x.
        assert!(axis(&view, from_degrees(60.0, 0.0)).y.abs() < 1e-9);
        assert!(axis(&view, from_degrees(60.0, 90.0)).x.abs() > 1.0 - 1e-9);
    }

    #[test]
    fn gloss_is_brighter_in_light_polarised_across_and_a_matte_sample_is_not() {
        let polarisation = Polarisation {
            projector: 0.02,
            camera: 0.0,
        };
        let [wi, wo] = [from_degrees(50.0, 0.0), from_degrees(50.0, 180.0)];
        let factor = |spec: &str, axis: DVec3| {
            let sample = parse(spec).unwrap();
            polarisation.factor(sample.incident(wi).as_ref(), [wi, wo], [axis; 2])[0]
        };
        let along = DVec3::Y.cross(wi).normalize();
        let (bright, dark) = (factor("ggx:plastic", DVec3::Y), factor("ggx:plastic", along));
        assert!(
            (1.005..1.02).contains(&bright) && (bright + dark - 2.0).abs() < 1e-9,
            "{bright} {dark}"
        );
        assert!((factor("lambert:0.5", DVec3::Y) - 1.0).abs() < 1e-15);
        assert!(factor("ggx:metal", DVec3::Y) < 1.003);
    }
}
