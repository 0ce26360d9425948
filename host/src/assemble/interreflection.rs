//! Light that leaves the sample and returns onto it.
//!
//! # Design
//! Of the light that leaves the sample a share r returns onto it, so that f + r·ρ(ω_i)·ρ(ω_o)/π was seen, ρ being the sample's
//! directional albedo. Black projector pixels tell it: they light the sample from everywhere at once, and what the black frames
//! show of that in each direction is ρ there, divided by the contrast; by reciprocity it is ρ of light from there. So a lobe that
//! no pixel sees counts too. But what the mirror does not light tells nothing: where the direction that a mirror-like sample would
//! exchange with one is dark, as much as such a lobe might be hidden. A projector without black light tells nothing at all; then ρ
//! is that of each image, what was not seen of the hemisphere is taken to be like the rest, and a lobe might be in it.

use glam::{DVec3, Vec4};

use super::radiometry::Radiometry;
use crate::assemble::resample::Resampling;
use crate::hemisphere::disk::Disk;
use crate::instrument::calibration::{Interreflection, Photometry};
use crate::instrument::rig::Rig;

/// Share of what returns that the model may be wrong by (k = 1): albedos are known as well as black light is even.
const MODEL: f64 = 0.25;
/// Share of the hemisphere, weighted by the cosine, that may be unseen without a lobe in it.
const UNSEEN: f64 = 0.03;

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
    /// Mean over the hemisphere of what is told, of each channel.
    usual: Vec<f64>,
}

/// What one channel of an image is made with.
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
        self.albedo = Some(self.albedo(albedo));
    }

    /// That of `of`, [cell, channel].
    fn albedo(&self, of: Vec<f32>) -> Albedo {
        let is_seen = |cell: usize| {
            of.get(cell * self.channels)
                .is_some_and(|albedo| albedo.is_finite())
        };
        let is_lit = |w: DVec3| {
            let mirrored = DVec3::new(-w.x, -w.y, w.z);
            let around = self.disk.neighbours(mirrored);
            around.is_some_and(|around| {
                around
                    .iter()
                    .all(|(cell, weight)| *weight <= 0.0 || is_seen(*cell))
            })
        };
        let is_told: Vec<bool> = (0..self.disk.len())
            .map(|cell| self.disk.direction(cell).is_some_and(is_lit))
            .collect();
        let usual = |channel: usize| {
            let told = |cell: usize| {
                let of = f64::from(of[cell * self.channels + channel]);
                if is_told[cell] { of } else { f64::NAN }
            };
            self.mean(told).map_or(1.0, |(mean, _)| mean)
        };
        let usual = (0..self.channels).map(usual).collect();
        Albedo { of, is_told, usual }
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
            let (mut sum, mut weights, mut is_told) = (0.0, 0.0, true);
            for (cell, weight) in self.disk.neighbours(wi).unwrap_or_default() {
                let of = albedo.of.get(cell * self.channels + channel);
                if let Some(of) = of.filter(|of| of.is_finite()) {
                    sum += weight * f64::from(*of);
                    weights += weight;
                    is_told &= albedo.is_told[cell];
                }
            }
            let found = if weights > 0.0 { sum / weights } else { usual };
            return Incoming {
                channel,
                albedo: found,
                most: if is_told { found } else { 1.0 },
                usual,
                usual_most: usual,
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
            let most = if albedo.is_told[cell] { of } else { 1.0 };
            of.is_finite().then_some((of, most))
        });
        let (outgoing, outgoing_most) = found.unwrap_or((incoming.usual, incoming.usual_most));
        let per_share = incoming.albedo * outgoing / std::f64::consts::PI;
        let back = self.found.share * per_share;
        let most = self.found.share * incoming.most * outgoing_most / std::f64::consts::PI;
        let uncertainty = (self.found.standard_uncertainty * per_share)
            .hypot(MODEL * back)
            .hypot((most - back).max(0.0) / 2.0);
        Back {
            f: back as f32,
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
        };
        let mut returned = Returned::new(found, disk, 1);
        let is_seen = |cell: usize| disk.direction(cell).is_some_and(seen);
        let of = |value: f32| -> Vec<f32> {
            (0..disk.len())
                .map(|cell| if is_seen(cell) { value } else { f32::NAN })
                .collect()
        };
        returned.albedo = albedo.map(|value| returned.albedo(of(value)));
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
        // And of a whole hemisphere nothing is left.
        let whole = back(None, &everywhere);
        assert!(whole.uncertainty < 0.3 * whole.f, "{whole:?}");
    }
}
