//! Light that leaves the sample and returns onto it.
//!
//! # Design
//! Of the light that leaves the sample a share r returns onto it, so that f + r·ρ(ω_i)·ρ(ω_o)/π was seen, ρ being the sample's
//! directional albedo. Black projector pixels tell it: they light the sample from everywhere at once, and what the black frames
//! show of that in each direction is ρ there, divided by the contrast; by reciprocity it is ρ of light from there. So a lobe that
//! no pixel sees counts too. But light tells nothing that the projector does not send, or to another part of the sample than is seen:
//! where that is so around the direction that a mirror-like sample would exchange with one, as much as such a lobe might be hidden, and
//! elsewhere the dark part of the hemisphere may be as bright as the lit one. A projector without black light tells nothing at all; then ρ is that of each image, what was not seen of the
//! hemisphere is taken to be like the rest, and a lobe might be in it.

use std::collections::HashMap;

use glam::{DVec2, DVec3, Vec4};

use super::radiometry::Radiometry;
use crate::assemble::resample::{Resampling, Taps};
use crate::brdf::quadrature::around;
use crate::hemisphere::disk::Disk;
use crate::instrument::calibration::{Interreflection, Patches, Photometry};
use crate::instrument::optics::View;
use crate::instrument::rig::Rig;

/// Share of what returns that the model may be wrong by (k = 1): albedos are known as well as black light is even.
const MODEL: f64 = 0.25;
/// Share of the hemisphere, weighted by the cosine, that may be unseen without a lobe in it.
const UNSEEN: f64 = 0.03;
/// A lobe counts as lit if all is so far around its middle, radians, and so much of what is seen of the sample.
const LOBE_RAD: f64 = 0.26;
const WHOLE: f64 = 0.8;
/// Cells a side of a disk whose directions stand for the hemisphere.
const COARSE: usize = 12;

/// What returns, of all images.
pub(super) struct Returned {
    found: Interreflection,
    disk: Disk,
    channels: usize,
    /// cosθ times solid angle of each cell, 0 beyond the horizon.
    cosine_sr: Vec<f32>,
    /// If black light tells it.
    albedo: Option<Albedo>,
}

/// Directional albedo by black light.
struct Albedo {
    /// [cell, channel], NaN where it was not seen.
    of: Vec<f32>,
    /// Whether a lobe around the mirrored direction would be in it, [cell].
    is_told: Vec<bool>,
    /// Share of light from everywhere, weighted by the cosine, that is in it, [cell].
    lit: Vec<f64>,
    /// Mean over the hemisphere of what is told, of each channel.
    usual: Vec<f64>,
}

/// What one channel of an image is made with.
#[derive(Debug)]
pub(super) struct Incoming {
    channel: usize,
    /// Albedo for the light that comes in, and the most that it may be.
    albedo: f64,
    most: f64,
    /// The same of cells of which nothing else is known.
    usual: f64,
    usual_most: f64,
}

/// What returned in one cell, sr⁻¹.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Back {
    pub(super) f: f32,
    /// Standard uncertainty (k = 1) by noise and model.
    pub(super) uncertainty: f32,
    /// What a share of 1 would add.
    pub(super) per_share: f32,
}

impl Albedo {
    /// The most that one of which so much was `found` may be in `cell`.
    fn most(&self, found: f64, cell: usize) -> f64 {
        if self.is_told[cell] {
            (found / self.lit[cell]).min(1.0)
        } else {
            1.0
        }
    }
}

/// The direction from which a mirror sends light to `w`.
fn mirrored(w: DVec3) -> DVec3 {
    w * DVec3::new(-1.0, -1.0, 1.0)
}

/// What light pixels see: that of directions which the projector lights, as far as both see the same part of the sample.
struct Reach {
    /// Number of cells, after whose mirrored directions come those that stand for the hemisphere.
    cells: usize,
    /// Cosines of the latter.
    cosines: Vec<f64>,
    /// Whether each direction is lit, and all around it.
    is_lit: Vec<bool>,
    is_whole: Vec<bool>,
    patches: Option<Patches>,
}

impl Reach {
    fn new(rig: &Rig, photometry: &Photometry, disk: Disk) -> Self {
        let projector = View::projector(rig);
        let mirrored = (0..disk.len()).map(|cell| disk.direction(cell).map(mirrored));
        let coarse = Disk::new(COARSE);
        let all = (0..coarse.len()).filter_map(|cell| coarse.direction(cell));
        let cosines = all.clone().map(|w| w.z).collect();
        let directions: Vec<Option<DVec3>> = mirrored.chain(all.map(Some)).collect();
        let is_lit = |w: DVec3| projector.pixel(w).is_ok();
        // Beyond the horizon there is no lobe.
        let is_whole = |w: DVec3| around(w, LOBE_RAD).into_iter().all(|w| w.z <= 0.0 || is_lit(w));
        let px: Vec<Option<DVec2>> = directions.iter().map(|w| projector.pixel((*w)?).ok()).collect();
        Self {
            cells: disk.len(),
            cosines,
            is_lit: px.iter().map(Option::is_some).collect(),
            is_whole: directions[..disk.len()]
                .iter()
                .map(|w| w.is_some_and(is_whole))
                .collect(),
            patches: photometry.seen_part.as_ref().map(|part| part.patches(rig, &px)),
        }
    }

    /// What the pixel that shows a `cell` most sees of light from everywhere, weighted by the cosine, and whether a lobe around the mirrored
    /// direction is in that.
    fn seen_by(&self, cell: usize, pixel: usize) -> (f64, bool) {
        let share = |direction: usize| {
            if self.is_lit[direction] {
                self.patches
                    .as_ref()
                    .map_or(1.0, |patches| patches.share(direction, pixel))
            } else {
                0.0
            }
        };
        let all = self.cosines.iter().enumerate();
        let sum: f64 = all.map(|(at, cosine)| cosine * share(self.cells + at)).sum();
        let is_told = self.is_whole[cell] && share(cell) > WHOLE;
        (sum / self.cosines.iter().sum::<f64>(), is_told)
    }
}

impl Returned {
    pub(super) fn new(found: Interreflection, disk: Disk, channels: usize) -> Self {
        let cosine = |cell: usize| {
            disk.direction(cell)
                .map_or(0.0, |w| (w.z * disk.cell_sr()) as f32)
        };
        Self {
            found,
            disk,
            channels,
            cosine_sr: (0..disk.len()).map(cosine).collect(),
            albedo: None,
        }
    }

    pub(super) const fn found(&self) -> &Interreflection {
        &self.found
    }

    /// Learns the albedo from the black frames of `radiometry`, one for each exposure time, the longest last; values are to be
    /// multiplied by `cells`, [cell, channel].
    pub(super) fn learn(
        &mut self,
        rig: &Rig,
        photometry: &Photometry,
        radiometry: &[Radiometry],
        resampling: &Resampling,
        cells: &[f32],
    ) {
        let Some(contrast) = photometry.contrast else {
            return;
        };
        let current_dn_per_s = photometry.camera.of_image(&rig.camera.binned).dark_dn_per_s;
        let mut albedo = vec![f32::NAN; cells.len()];
        // The longest exposure shows most, where it is not full.
        for one in radiometry {
            let current_dn = (current_dn_per_s * one.exposure_s) as f32;
            // From everywhere comes a radiance of one over the contrast: a white sample shows 1/π of π times that.
            let scale = contrast * one.numbers.scale / (one.exposure_s * rig.projector.irradiance);
            let light = one.black_image(self.channels);
            for taps in &resampling.taps {
                let shown = taps.pixel.iter().zip(&taps.weight);
                let sum = shown.fold(Vec4::ZERO, |sum, (pixel, weight)| {
                    sum + (light[*pixel as usize] - current_dn) * *weight
                });
                let first = taps.cell as usize * self.channels;
                let of = albedo[first..].iter_mut().zip(&cells[first..]);
                for ((albedo, cell), dn) in of.take(self.channels).zip(sum.to_array()) {
                    if dn.is_finite() {
                        *albedo = (dn * cell * scale as f32).clamp(0.0, 1.0);
                    }
                }
            }
        }
        let reach = Reach::new(rig, photometry, self.disk);
        let pixel_of: HashMap<usize, usize> = resampling.taps.iter().map(Taps::heaviest).collect();
        let seen = |cell: usize| {
            pixel_of
                .get(&cell)
                .map_or((0.0, false), |pixel| reach.seen_by(cell, *pixel))
        };
        self.albedo = Some(self.albedo(albedo, seen));
    }

    /// That of `of`, [cell, channel], of which each cell shows what `seen` says: see [`Reach::seen_by`].
    fn albedo(&self, of: Vec<f32>, seen: impl Fn(usize) -> (f64, bool)) -> Albedo {
        let (lit, is_told): (Vec<f64>, Vec<bool>) = (0..self.disk.len()).map(seen).unzip();
        let usual = |channel: usize| {
            let told = |cell: usize| {
                let of = f64::from(of[cell * self.channels + channel]);
                if is_told[cell] { of } else { f64::NAN }
            };
            self.mean(told).map_or(1.0, |(mean, _)| mean)
        };
        let usual = (0..self.channels).map(usual).collect();
        Albedo {
            of,
            is_told,
            lit,
            usual,
        }
    }

    /// For the image f of light from `wi`, of which those cells are known that are `measured`.
    pub(super) fn incoming(
        &self,
        wi: DVec3,
        f: &[f32],
        measured: &dyn Fn(usize) -> bool,
        channel: usize,
    ) -> Incoming {
        if let Some(albedo) = &self.albedo {
            let usual = albedo.usual[channel];
            let (mut sum, mut most, mut weights, mut is_told) = (0.0, 0.0, 0.0, true);
            for (cell, weight) in self.disk.neighbours(wi).unwrap_or_default() {
                let of = albedo.of.get(cell * self.channels + channel);
                if let Some(of) = of.filter(|of| of.is_finite()) {
                    sum += weight * f64::from(*of);
                    most += weight * albedo.most(f64::from(*of), cell);
                    weights += weight;
                    is_told &= albedo.is_told[cell];
                }
            }
            // Where no pixel looks a lobe may be too.
            let (found, most) = if weights > 0.0 {
                (sum / weights, if is_told { most / weights } else { 1.0 })
            } else {
                (usual, 1.0)
            };
            return Incoming {
                channel,
                albedo: found,
                most,
                usual,
                usual_most: 1.0,
            };
        }
        let of = |cell: usize| {
            if measured(cell) {
                std::f64::consts::PI * f64::from(f[cell * self.channels + channel])
            } else {
                f64::NAN
            }
        };
        let (albedo, seen) = self.mean(of).unwrap_or((0.0, 1.0));
        let albedo = albedo.clamp(0.0, 1.0);
        let most = if seen < 1.0 - UNSEEN { 1.0 } else { albedo };
        Incoming {
            channel,
            albedo,
            most,
            usual: albedo,
            usual_most: most,
        }
    }

    /// Mean of what is a number over the hemisphere, weighted by the cosine, and the share of it that is one.
    fn mean(&self, of: impl Fn(usize) -> f64) -> Option<(f64, f64)> {
        let (mut sum, mut seen, mut all) = (0.0, 0.0, 0.0);
        for (cell, cosine_sr) in self.cosine_sr.iter().enumerate() {
            let (value, weight) = (of(cell), f64::from(*cosine_sr));
            all += weight;
            if value.is_finite() {
                sum += weight * value;
                seen += weight;
            }
        }
        (seen > 0.0).then(|| (sum / seen, seen / all))
    }

    /// What returned in `cell`.
    pub(super) fn back(&self, incoming: &Incoming, cell: usize) -> Back {
        let found = self.albedo.as_ref().and_then(|albedo| {
            let of = f64::from(albedo.of[cell * self.channels + incoming.channel]);
            of.is_finite().then_some((of, albedo.most(of, cell)))
        });
        let (outgoing, outgoing_most) = found.unwrap_or((incoming.usual, incoming.usual_most));
        let per_share = incoming.albedo * outgoing / std::f64::consts::PI;
        let most = incoming.most * outgoing_most / std::f64::consts::PI;
        let of_albedos = (MODEL * per_share).hypot((most - per_share).max(0.0) / 2.0);
        // Of a product, of which both may be more uncertain than they are large.
        let Interreflection {
            share,
            standard_uncertainty,
            by_standards,
            ..
        } = self.found;
        let uncertainty = (standard_uncertainty * per_share)
            .hypot(share * of_albedos)
            .hypot(standard_uncertainty.hypot(by_standards) * of_albedos);
        Back {
            f: (share * per_share) as f32,
            uncertainty: uncertainty as f32,
            per_share: per_share as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;

    fn returned(albedo: Option<f32>, seen: &dyn Fn(DVec3) -> bool) -> (Returned, Vec<f32>) {
        let disk = Disk::new(24);
        let found = Interreflection {
            share: 0.01,
            standard_uncertainty: 0.0,
            by_standards: 0.0,
            own: 0.0,
            apart: 0.8,
            narrowed: 1.0,
        };
        let mut returned = Returned::new(found, disk, 1);
        let is_seen = |cell: usize| disk.direction(cell).is_some_and(seen);
        let of = |value: f32| -> Vec<f32> {
            (0..disk.len())
                .map(|cell| if is_seen(cell) { value } else { f32::NAN })
                .collect()
        };
        returned.albedo = albedo.map(|value| {
            let sees = |cell: usize| (1.0, disk.direction(cell).map(mirrored).is_some_and(seen));
            returned.albedo(of(value), sees)
        });
        (returned, of(0.02))
    }

    fn back(albedo: Option<f32>, seen: &dyn Fn(DVec3) -> bool) -> Back {
        let (returned, f) = returned(albedo, seen);
        let measured = |cell: usize| f[cell].is_finite();
        let wi = from_degrees(30.0, 0.0);
        let incoming = returned.incoming(wi, &f, &measured, 0);
        let cell = f.iter().position(|f| f.is_finite()).unwrap();
        returned.back(&incoming, cell)
    }

    #[test]
    fn a_lobe_that_nobody_sees_returns_light_too_or_its_doubt() {
        let everywhere = |_: DVec3| true;
        // A dark image of a sample that returns nine tenths: black light tells.
        let told = back(Some(0.9), &everywhere);
        let expected = 0.01 * 0.81 / std::f64::consts::PI;
        assert!((f64::from(told.f) / expected - 1.0).abs() < 1e-3, "{told:?}");
        assert!(told.uncertainty < 0.3 * told.f, "{told:?}");
        // Where half of the hemisphere stays dark, and where nothing tells and half stays unseen, a lobe may be there.
        let half = |w: DVec3| w.x > 0.0;
        for dark in [back(Some(0.06), &half), back(None, &half)] {
            assert!(
                f64::from(dark.f) + 2.1 * f64::from(dark.uncertainty) > 0.01 / std::f64::consts::PI,
                "{dark:?}"
            );
        }
        // A share that is not known is not known of the light that a hidden lobe returns either.
        let (mut returned, f) = returned(Some(0.06), &half);
        returned.found.share = 0.0;
        returned.found.by_standards = 0.005;
        let incoming = returned.incoming(from_degrees(30.0, 0.0), &f, &|cell| f[cell].is_finite(), 0);
        let cell = f.iter().position(|f| f.is_finite()).unwrap();
        let unknown = returned.back(&incoming, cell);
        assert!(
            f64::from(unknown.uncertainty) > 0.4 * 0.005 / std::f64::consts::PI,
            "{unknown:?}"
        );
        let unseen = returned.incoming(from_degrees(30.0, 180.0), &f, &|cell| f[cell].is_finite(), 0);
        assert!(unseen.most > 0.99, "{unseen:?}");
        // And of a whole hemisphere nothing is left.
        let whole = back(None, &everywhere);
        assert!(whole.uncertainty < 0.3 * whole.f, "{whole:?}");
    }
}
