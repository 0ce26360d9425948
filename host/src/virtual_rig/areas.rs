//! What part of the sample each camera pixel sees and each spot of light lights.
//!
//! # Design
//! The mirror images pupils onto the sample. Here rays are traced back: one that leaves a place of the sample in the
//! direction of a pixel or a spot crosses the pupil's plane somewhere ([`View::pupil_at`]), and that says whether, and how
//! brightly, the place is seen or lit. Of the projector this map is taken to the second order, because its pupil is wide; its
//! light falls off towards a soft edge. The camera's pupil is the hexagon of an iris. A pixel's light is the mean over the
//! places that it sees; beyond the edge of the sample there is none.

use std::f64::consts::FRAC_PI_2;
use std::sync::LazyLock;

use glam::{DMat2, DVec2, DVec3};

use super::flaws::Pupils;
use crate::instrument::optics::View;

/// Rings of places around the middle of a hexagon.
const RINGS: i32 = 4;
/// Circumscribed circle of a hexagon of the area of the unit disk.
const HEXAGON: f64 = 1.099_636;
/// Width of the soft edge of a pupil, of its radius, and of the sample's chamfer, metres.
const SOFT: f64 = 0.06;
const CHAMFER_M: f64 = 1e-4;
/// Step for derivatives, metres, and how far out the second order is taken, of the radius of what is lit.
const STEP_M: f64 = 2e-5;
const FAR: f64 = 0.7;

/// Places in a hexagon of the area of the unit disk, evenly.
static PLACES: LazyLock<Vec<DVec2>> = LazyLock::new(|| {
    let apart = HEXAGON / (f64::from(RINGS) + 0.5);
    let all = (-RINGS..=RINGS).flat_map(|i| (-RINGS..=RINGS).map(move |j| (i, j)));
    all.filter(|(i, j)| (i + j).abs() <= RINGS)
        .map(|(i, j)| {
            let (i, j) = (f64::from(i), f64::from(j));
            DVec2::new(i + 0.5 * j, j * 0.75_f64.sqrt()) * apart
        })
        .collect()
});
/// A few of them with the same mean square, for where nothing changes much.
static FEW: LazyLock<Vec<DVec2>> = LazyLock::new(|| {
    let mean2 = PLACES.iter().map(|at| at.length_squared()).sum::<f64>() / PLACES.len() as f64;
    (0..6)
        .map(|turn| DVec2::from_angle(f64::from(turn) * FRAC_PI_2 / 1.5) * mean2.sqrt())
        .collect()
});

/// What a camera pixel sees of the sample plane.
#[derive(Clone, Copy, Debug)]
pub(super) struct SeenArea {
    centre_m: DVec2,
    /// Takes places in the pupil, of radius 1, to the sample about the centre.
    axes_m: DMat2,
}

/// What a spot lights of the sample plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LitArea {
    centre_m: DVec2,
    /// Takes places of the sample about the centre to units of [`FAR`] of what is lit.
    to_units: DMat2,
    /// Place in the pupil, of radius 1, by units: first order, then of x², y² and xy.
    first: DMat2,
    second: [DVec2; 3],
    falloff: f64,
}

/// Derivative of the place in the pupil of `view` by that on the sample, around the ray in the direction `w` that meets the sample
/// at the first number returned.
fn around(view: &View, w: DVec3) -> Option<(DVec2, DMat2)> {
    let at = view.pixel(w).ok()?;
    let trace = view.trace(at.x, at.y).ok()?;
    let (centre_m, w) = (trace.hit_m.truncate(), trace.direction);
    let along = |step: DVec2| -> Option<DVec2> {
        Some((view.pupil_at(centre_m + step, w)? - view.pupil_at(centre_m - step, w)?) / (2.0 * STEP_M))
    };
    Some((
        centre_m,
        DMat2::from_cols(along(DVec2::X * STEP_M)?, along(DVec2::Y * STEP_M)?),
    ))
}

impl SeenArea {
    /// Of the pixel of `camera` that looks along `w`; `None` where the sample is seen edge on.
    pub(super) fn new(camera: &View, w: DVec3, pupils: &Pupils) -> Option<Self> {
        let (centre_m, slope) = around(camera, w)?;
        let turn = DMat2::from_angle(pupils.blades_deg.to_radians());
        let axes_m = slope.inverse() * turn * (0.5 * pupils.camera_m);
        axes_m.is_finite().then_some(Self { centre_m, axes_m })
    }

    /// Mean of what `lit` lights of it, of a sample of `radius_m`.
    pub(super) fn share(&self, lit: &LitArea, radius_m: f64) -> f64 {
        self.share_at(&PLACES, lit, radius_m)
    }

    /// The same by a few places: of one light among many, whose edges come to the same together.
    pub(super) fn share_of_many(&self, lit: &LitArea, radius_m: f64) -> f64 {
        self.share_at(&FEW, lit, radius_m)
    }

    /// The same by these `places` where something changes.
    fn share_at(&self, places: &[DVec2], lit: &LitArea, radius_m: f64) -> f64 {
        let rim = |axes: DMat2| (axes.x_axis.length() + axes.y_axis.length()) * HEXAGON;
        let (from_m, reach_m) = (self.centre_m.length(), rim(self.axes_m));
        if from_m - reach_m > radius_m + CHAMFER_M {
            return 0.0;
        }
        // In units of what is lit.
        let (centre, axes) = (lit.units(self.centre_m), lit.to_units * self.axes_m);
        let (middle, reach) = (lit.in_pupil(centre).length(), rim(lit.first * axes));
        if middle - 2.0 * reach > 1.5 {
            return 0.0;
        }
        let light = |place: &DVec2| lit.light(centre + axes * *place);
        let is_whole = from_m + reach_m < radius_m - CHAMFER_M;
        let places = if is_whole && middle + 1.5 * reach < 1.0 - SOFT {
            FEW.as_slice()
        } else {
            places
        };
        let sum: f64 = if is_whole {
            places.iter().map(light).sum()
        } else {
            let on = |place: &DVec2| {
                let at_m = self.centre_m + self.axes_m * *place;
                ((radius_m - at_m.length()) / CHAMFER_M + 0.5).clamp(0.0, 1.0)
            };
            places.iter().map(|place| on(place) * light(place)).sum()
        };
        sum / places.len() as f64
    }
}

impl LitArea {
    /// Of light of `projector` from `w`; `None` where it meets the sample edge on.
    pub(super) fn new(projector: &View, w: DVec3, pupils: &Pupils) -> Option<Self> {
        let (centre_m, slope) = around(projector, w)?;
        let radius_m = 0.5 * pupils.projector_m;
        let units_m = slope.inverse() * (FAR * radius_m);
        let [a, b] = [units_m.x_axis, units_m.y_axis];
        let at = |step: DVec2| projector.pupil_at(centre_m + step, w).map(|at| at / radius_m);
        let traced = || Some([at(a)?, at(-a)?, at(b)?, at(-b)?, at(a + b)?, at(-a - b)?]);
        let (first, second) = match traced() {
            Some([a, minus_a, b, minus_b, both, minus_both]) => {
                let (aa, bb) = ((a + minus_a) / 2.0, (b + minus_b) / 2.0);
                let ab = (both + minus_both) / 2.0 - aa - bb;
                (
                    DMat2::from_cols((a - minus_a) / 2.0, (b - minus_b) / 2.0),
                    [aa, bb, ab],
                )
            }
            None => (DMat2::IDENTITY * FAR, [DVec2::ZERO; 3]),
        };
        let to_units = units_m.inverse();
        (to_units.is_finite() && first.is_finite()).then_some(Self {
            centre_m,
            to_units,
            first,
            second,
            falloff: pupils.falloff,
        })
    }

    /// The place `at_m` in units of [`FAR`] of what is lit, about its centre.
    fn units(&self, at_m: DVec2) -> DVec2 {
        self.to_units * (at_m - self.centre_m)
    }

    /// Where in the pupil, of radius 1, light to the place `s`, in these units, comes from.
    fn in_pupil(&self, s: DVec2) -> DVec2 {
        let [xx, yy, xy] = self.second;
        self.first * s + xx * (s.x * s.x) + yy * (s.y * s.y) + xy * (s.x * s.y)
    }

    /// Light at the place `s`, in these units, over that in the middle.
    fn light(&self, s: DVec2) -> f64 {
        let rho2 = self.in_pupil(s).length_squared();
        if rho2 > (1.0 + SOFT) * (1.0 + SOFT) {
            return 0.0;
        }
        let rho = rho2.sqrt();
        let on = ((1.0 - rho) / SOFT + 0.5).clamp(0.0, 1.0);
        let inner = rho.min(1.0);
        on * (1.0 - self.falloff * inner * inner * (3.0 - 2.0 * inner))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;
    use crate::instrument::optics::{LitPatch, Patch};
    use crate::instrument::rig::Rig;

    #[test]
    fn traced_shares_are_near_those_of_ellipses_but_for_their_edges() {
        let pupils = Pupils {
            camera_m: 1.8e-3,
            projector_m: 0.04,
            falloff: 0.0,
            blades_deg: 10.0,
        };
        for (preset, offset_m) in [("rcg-1-16bit", 0.0), ("rcg-3", 0.0), ("rcg-3", 5e-4)] {
            let mut rig = Rig::load(preset).unwrap();
            rig.camera.lens.offset_m = [offset_m, -offset_m, offset_m];
            rig.sample.offset_m = [offset_m; 3];
            let (camera, projector) = (View::camera(&rig), View::projector(&rig));
            let patch = |view: &View, w: DVec3, pupil_m: f64| -> Option<Patch> {
                let at = view.pixel(w).ok()?;
                view.patch(at.x, at.y, pupil_m).ok()
            };
            let (mut sum, mut part, mut far, mut count) = (0.0, 0, 0, 0);
            for turn in 0..2000 {
                let w = |k: f64| {
                    let along = (f64::from(turn) * k).fract();
                    from_degrees(80.0 * along.sqrt(), 360.0 * (f64::from(turn) * k * 7.3).fract())
                };
                let (wi, wo) = (w(0.618_034), w(0.414_214));
                let areas = SeenArea::new(&camera, wo, &pupils).zip(LitArea::new(&projector, wi, &pupils));
                let patches =
                    patch(&camera, wo, pupils.camera_m).zip(patch(&projector, wi, pupils.projector_m));
                let (Some((seen, lit)), Some((seen_patch, lit_patch))) = (areas, patches) else {
                    continue;
                };
                let truth = seen.share(&lit, 0.01);
                let model = seen_patch.lit(&LitPatch::new(&lit_patch, 0.0).unwrap(), 0.01);
                count += 1;
                part += i32::from(truth < 0.999);
                far += i32::from((truth - model).abs() > 0.1);
                sum += (truth - model).abs();
            }
            let mean = sum / f64::from(count);
            println!("{preset} {offset_m}: {count} pairs, {part} in part, {far} far, mean difference {mean}");
            assert!(
                count > 1000 && mean < 0.005 && far < count / 50,
                "{preset}: {mean} {far}"
            );
            assert!(offset_m <= 0.0 || part > count / 20, "{part}");
        }
    }
}
