//! Light and what is held in it as charge of every camera pixel.
//!
//! # Design
//! Finite light and finite pixels blur a sharp lobe, and the virtual rig shows that: f is averaged over four
//! directions of light and four places within each part of the pixel. A coarse pixel has so many parts that none is wider
//! than a lobe is sharp: as the mean of the sensor's own pixels it misses no lobe. Of a pixel that an edge cuts, the
//! places behind it are dark.
//!
//! To the light of the pattern comes that of the black projector pixels, and what the mirror throws back onto the sample:
//! of the light that leaves the sample a share returns from all directions alike, so that the sample shows it with its
//! directional albedo both ways, here taken as a function of θ. What reaches a pixel by another way than its own stands in
//! `stray`.

mod pixel;
mod shining;
mod spots;

use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

pub(super) use shining::Shining;

use pixel::{Pixel, pixels};
use spots::SpotImages;

use super::areas::LitArea;
use super::crosstalk::Crosstalk;
use super::flaws::Pupils;
use super::held::{Held, Reflections};
use super::interreflection::Interreflection;
use super::light::{AtSample, Glow, Light, Spot};
use super::pixels::PixelMaps;
use super::polarisation::{Polarisation, axis};
use super::sensor::{Noise, Sensor};
use super::stage::Shot;
use super::stray::Stray;
use super::truth::Truth;
use crate::brdf::sample::{Outgoing, Sample};
use crate::instrument::frame_format::FrameFormat;
use crate::instrument::optics::{DirectionTiles, View};
use crate::instrument::rig::Rig;
use crate::plan::pattern::BitPattern;

/// Beams reach so far beyond the sample at most, metres: half the mirror.
const BEAM_M: f64 = 0.1;
/// Side of the blocks of black pixels that count as one light, and of the squares of pixels that are traced as one.
const BLOCK_PX: usize = 64;
const COARSE_PX: u32 = 4;

/// The rig for rays that wide pupils make of a beam: one that meets the plane beside the sample may still be of a beam that
/// meets the sample.
fn rays(rig: &Rig, is_wide: bool) -> Rig {
    let mut rays = rig.clone();
    if is_wide {
        rays.sample.radius_m += BEAM_M;
    }
    rays
}

/// What is held in the rig.
pub(super) struct Scene {
    held: Held,
    format: FrameFormat,
    pixels: Vec<Pixel>,
    projector: DirectionTiles,
    /// If they are more than points.
    pupils: Option<Pupils>,
    sample_radius_m: f64,
    /// What the projector's pixels shine.
    shining: Arc<Shining>,
    gamma: f64,
    /// By how many pixels the light of each projector pixel is spread (standard deviation).
    blur_px: f64,
    sensor: Sensor,
    crosstalk: Crosstalk,
    polarisation: Polarisation,
    /// What its pixels differ by; `None` if they do not.
    maps: Option<PixelMaps>,
    /// Electrons per (f in sr⁻¹ × irradiance × second).
    sensitivity: f64,
    /// What each colour counts in a camera without them: a third of white light, or as much as all of it where the projector shows one
    /// after the other.
    colour_weight: f64,
    interreflection: Option<Interreflection>,
    reflections: Option<Reflections>,
    /// What the camera gets of the black projector pixels, see [`Scene::shown`]; nothing if they are black.
    black: Option<Vec<f32>>,
    stray: Option<Stray>,
    /// Of patterns with many of them.
    spots: SpotImages,
}

impl Scene {
    pub(super) fn new(truth: &Truth, held: Held) -> Self {
        Self::of(truth, held, Arc::new(Shining::of(truth)))
    }

    /// With a projector whose pixels are `shining` as they do by this `truth`.
    pub(super) fn of(truth: &Truth, held: Held, shining: Arc<Shining>) -> Self {
        let Truth { rig, flaws, .. } = truth;
        let pupils = flaws.pupils.are_wide().then(|| flaws.pupils.clone());
        let rays = rays(rig, pupils.is_some());
        let format = rig.camera_format();
        let figure = flaws.figure.of(rig);
        let views = |rig: &Rig| {
            [View::camera(rig), View::projector(rig)].map(|view| view.with_figure(figure.clone()))
        };
        let [view, projector] = views(&rays);
        let pixels = match held {
            Held::Trap => Vec::new(),
            _ => pixels(&view, flaws, format, pupils.as_ref()),
        };
        let projector = DirectionTiles::of(projector);
        let mut scene = Self {
            interreflection: match &held {
                Held::Sample(sample) if flaws.interreflection > 0.0 => {
                    Some(Interreflection::of(sample.as_ref(), flaws.interreflection))
                }
                _ => None,
            },
            reflections: match held {
                Held::Mirror(mirror) => Some(Reflections::of(rig, &views(rig), mirror)),
                Held::Sample(_) | Held::Trap => None,
            },
            held,
            format,
            pixels,
            projector,
            pupils,
            sample_radius_m: rig.sample.radius_m,
            shining,
            gamma: if flaws.gamma > 0.0 { flaws.gamma } else { 1.0 },
            blur_px: flaws.focus.blur_px,
            sensor: Sensor::of(rig).with_response(flaws.nonlinearity, flaws.knee),
            crosstalk: flaws.crosstalk,
            polarisation: flaws.polarisation,
            maps: PixelMaps::of(&flaws.pixels, rig),
            sensitivity: rig.sensitivity_e(),
            colour_weight: if rig.shows_bands() { 1.0 } else { 1.0 / 3.0 },
            black: None,
            stray: Stray::of(flaws, format),
            spots: SpotImages::default(),
        };
        if flaws.black_level > 0.0 {
            let mut image = vec![0.0; format.len()];
            if let Held::Sample(_) = scene.held {
                let [_, projector] = views(&rays.with_coarse_projector(COARSE_PX));
                let light = scene.black_pixels(&DirectionTiles::of(projector));
                for (pixel, f) in scene.pixels.iter().zip(light) {
                    scene.add(&mut image, pixel.index, DVec3::from(f));
                }
            }
            scene.black = Some(scene.shown(image, scene.shining.black_direct * DVec3::ONE));
        }
        scene
    }

    /// Whether it shows the very sample that is `held`.
    pub(super) fn is_of(&self, held: &Held) -> bool {
        self.held.is_same(held)
    }

    pub(super) const fn format(&self) -> FrameFormat {
        self.format
    }

    pub(super) fn projector_size_px(&self) -> (usize, usize) {
        self.projector.view().size_px()
    }

    /// What `pattern`, with these lit pixels, does at the sample.
    pub(super) fn light(&self, pattern: &BitPattern, lit: &[u32]) -> Glow {
        let level = (f64::from(pattern.level()) / 255.0).powf(self.gamma);
        let has = |colour: u8| pattern.primary().is_none_or(|primary| primary == colour);
        Glow {
            at_sample: self.at_sample(level, lit),
            direct: level * self.shining.direct(lit),
            colour: [0, 1, 2].map(|colour| f64::from(u8::from(has(colour)))),
        }
    }

    /// What the pixels `lit` at this `level` of light, 0 to 1, do at the sample.
    fn at_sample(&self, level: f64, lit: &[u32]) -> AtSample {
        if let Some(reflections) = &self.reflections {
            let mut intensity: Vec<f32> = self.shining.black.iter().map(|black| *black as f32).collect();
            intensity.resize(self.shining.lit.len(), 0.0);
            for &pixel in lit {
                intensity[pixel as usize] = (level * self.shining.lit[pixel as usize]) as f32;
            }
            return AtSample::Image(reflections.image(&intensity).into());
        }
        if let Held::Trap = self.held {
            return AtSample::default();
        }
        let intensity = |pixel: usize| level * self.shining.lit[pixel];
        let lights = Light::spots(lit, &self.projector, self.blur_px, &intensity);
        AtSample::Spots(lights.into_iter().filter_map(|light| self.spot(light)).collect())
    }

    /// With what it lights of the sample; `None` where it meets the sample edge on.
    fn spot(&self, light: Light) -> Option<Spot> {
        let area = match &self.pupils {
            Some(pupils) => {
                let middle = light.nodes.iter().sum::<DVec3>().normalize();
                Some(LitArea::new(self.projector.view(), middle, pupils)?)
            }
            None => None,
        };
        let axis = axis(self.projector.view(), light.nodes[0]);
        Some(Spot { light, area, axis })
    }

    /// f × irradiance of all projector pixels as black ones, by the `coarse` pixels of the same projector.
    fn black_pixels(&self, coarse: &DirectionTiles) -> Vec<[f64; 3]> {
        let Held::Sample(sample) = &self.held else {
            return vec![[0.0; 3]; self.pixels.len()];
        };
        coarse.trace_all();
        let (full_px, _) = self.projector_size_px();
        let (width_px, height_px) = coarse.view().size_px();
        let times = full_px / width_px;
        let intensity = |pixel: usize| {
            let at = |at: usize| at * times + times / 2;
            // A coarse pixel's solid angle is that of all.
            self.shining.black[at(pixel / width_px) * full_px + at(pixel % width_px)]
        };
        let block_px = BLOCK_PX / times;
        let blocks = (0..height_px)
            .step_by(block_px)
            .flat_map(|top| (0..width_px).step_by(block_px).map(move |left| (top, left)));
        let spots: Vec<Spot> = blocks
            .filter_map(|(top, left)| {
                let rows = top..(top + block_px).min(height_px);
                let columns = left..(left + block_px).min(width_px);
                let block: Vec<u32> = rows
                    .flat_map(|y| columns.clone().map(move |x| (y * width_px + x) as u32))
                    .collect();
                self.spot(Light::of(&block, coarse, 0.0, &intensity)?)
            })
            .collect();
        let lobes: Vec<_> = spots
            .iter()
            .map(|spot| spot.light.nodes.map(|node| sample.incident(node)))
            .collect();
        let of = |pixel: &Pixel| {
            let mut sum = [0.0; 3];
            for (spot, lobes) in spots.iter().zip(&lobes) {
                let share = pixel.share(spot, |seen, lit| seen.share_of_many(lit, self.sample_radius_m));
                let f = self.f(spot, lobes, pixel, share, Pixel::mean_f_of_many);
                for (sum, f) in sum.iter_mut().zip(f) {
                    *sum += spot.light.irradiance * f;
                }
            }
            sum
        };
        self.pixels.par_iter().map(of).collect()
    }

    /// f of what is both seen and lit, which is this `share`, with what interreflection adds to it, in sr⁻¹ × throughput;
    /// from the lobes of the directions of light, by `mean_f`.
    fn f(
        &self,
        spot: &Spot,
        lobes: &[Box<dyn Outgoing + '_>; 4],
        pixel: &Pixel,
        share: f64,
        mean_f: impl Fn(&Pixel, &[Box<dyn Outgoing + '_>; 4]) -> [f64; 3],
    ) -> [f64; 3] {
        if share <= 0.0 {
            return [0.0; 3];
        }
        let mut f = mean_f(pixel, lobes);
        if self.polarisation.is_any() {
            let directions = [spot.light.nodes[0], pixel.one];
            let axes = [spot.axis, pixel.axis];
            let factor = self.polarisation.factor(lobes[0].as_ref(), directions, axes);
            for (f, factor) in f.iter_mut().zip(factor) {
                *f *= factor;
            }
        }
        if let Some(interreflection) = &self.interreflection {
            let back = interreflection.f(spot.light.nodes[0], pixel.one);
            for (f, back) in f.iter_mut().zip(back) {
                *f += pixel.seen * back;
            }
        }
        f.map(|f| f * share * pixel.throughput)
    }

    /// Digital numbers of `shot`, [row, column, channel].
    pub(super) fn frame(&self, shot: &Shot, noise: Noise) -> Vec<u16> {
        let mut charge_e = self.charge_e(shot);
        let mut offset_e = Vec::new();
        if let Some(maps) = &self.maps {
            maps.expose(&mut charge_e, shot.exposure_s);
            offset_e = maps.offset_e(noise, shot.seed, shot.hours);
        }
        self.sensor
            .digitise(&charge_e, &offset_e, shot.exposure_s, noise, shot.seed)
    }

    /// Electrons of light in every pixel, [row, column, channel].
    fn charge_e(&self, shot: &Shot) -> Vec<f32> {
        let mut charge_e = vec![0.0; self.format.len()];
        let light_e = self.sensitivity * shot.lamp;
        let mut add = |image: &[f32], seconds: f64| {
            let scale = (light_e * seconds) as f32;
            for (charge_e, light) in charge_e.iter_mut().zip(image) {
                *charge_e += scale * light;
            }
        };
        for (shown, visible_s) in &shot.seen {
            add(shown.image(|glow| self.image(glow)), *visible_s);
        }
        if let Some(black) = &self.black {
            add(black, shot.exposure_s);
        }
        charge_e
    }

    /// The image `light` of what the sample sends, f × irradiance, [row, column, channel], as the sensor shows it: with stray light,
    /// `direct` light of the projector among it, and what leaks between colours. All of that grows with the light, so that it is
    /// done once for each pattern.
    fn shown(&self, mut light: Vec<f32>, direct: DVec3) -> Vec<f32> {
        let FrameFormat {
            width_px,
            height_px,
            channels,
            ..
        } = self.format;
        if let Some(stray) = &self.stray {
            if !matches!(self.held, Held::Trap) {
                stray.add(&mut light);
            }
            let all = self.as_seen(direct);
            if let Some(direct) = stray.direct() {
                for (out, share) in light.chunks_exact_mut(channels).zip(direct) {
                    for (out, all) in out.iter_mut().zip(all) {
                        *out += (all * share) as f32;
                    }
                }
            }
        }
        if channels == 3 {
            self.crosstalk.leak(&mut light, width_px, height_px);
        }
        light
    }

    /// Adds `light`, by colours, to the pixel with this index.
    fn add(&self, image: &mut [f32], index: usize, light: DVec3) {
        let channels = self.format.channels;
        let out = &mut image[index * channels..][..channels];
        for (out, light) in out.iter_mut().zip(self.as_seen(light)) {
            *out += light as f32;
        }
    }

    /// Colours as the camera's channels show them.
    fn as_seen(&self, light: DVec3) -> [f64; 3] {
        if self.format.channels == 1 {
            [light.element_sum() * self.colour_weight; 3]
        } else {
            light.to_array()
        }
    }

    /// Light of one spot with this `colour` on the `sample`, [row, column, channel].
    fn of_spot(&self, spot: &Spot, sample: &dyn Sample, colour: DVec3) -> Vec<f32> {
        let mut light = vec![0.0; self.format.len()];
        let lobes = spot.light.nodes.map(|node| sample.incident(node));
        for pixel in &self.pixels {
            let share = pixel.share(spot, |seen, lit| seen.share(lit, self.sample_radius_m));
            let f = self.f(spot, &lobes, pixel, share, Pixel::mean_f);
            let f = spot.light.irradiance * DVec3::from(f);
            self.add(&mut light, pixel.index, f * colour);
        }
        light
    }

    /// What the camera gets of a pattern, see [`Scene::shown`].
    fn image(&self, glow: &Glow) -> Vec<f32> {
        let mut light = vec![0.0; self.format.len()];
        if glow.is_black() {
            return light;
        }
        let colour = DVec3::from(glow.colour);
        match (&glow.at_sample, &self.held) {
            (AtSample::Spots(spots), Held::Sample(sample)) => {
                if let [spot] = **spots {
                    light = self.of_spot(&spot, sample.as_ref(), colour);
                } else {
                    for spot in spots.iter() {
                        let one = self
                            .spots
                            .of(spot, colour, || self.of_spot(spot, sample.as_ref(), colour));
                        for (all, one) in light.iter_mut().zip(one.iter()) {
                            *all += one;
                        }
                    }
                }
            }
            (AtSample::Image(image), _) => {
                for pixel in &self.pixels {
                    let radiance = f64::from(image[pixel.index]) * pixel.throughput;
                    self.add(&mut light, pixel.index, radiance * colour);
                }
            }
            (AtSample::Spots(_), Held::Mirror(_) | Held::Trap) => {}
        }
        self.shown(light, glow.direct * colour)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::virtual_rig::Tolerances;

    #[test]
    fn coarse_pixels_make_as_much_black_light_as_all_of_them() {
        let rig = Rig::load("rcg-2").unwrap().with_image_size(16).unwrap();
        let truth = Truth::drawn(&rig, Tolerances::DRAWN, 5).unwrap();
        let sample = Arc::from(crate::brdf::sample::parse("ggx:satin").unwrap());
        let scene = Scene::new(&truth, Held::Sample(sample));
        let [all, found] = [1, COARSE_PX].map(|coarse_px| {
            let rig = rays(&rig, true).with_coarse_projector(coarse_px);
            scene.black_pixels(&DirectionTiles::of(View::projector(&rig)))
        });
        assert!(found.len() > 100);
        let sum = |light: &[[f64; 3]]| light.iter().map(|f| f[0]).sum::<f64>();
        // Edges of mirror and sample are coarser.
        let far = |(found, all): &(&[f64; 3], &[f64; 3])| (found[0] - all[0]).abs() > 0.05 * all[0];
        let far = found.iter().zip(&all).filter(far).count();
        assert!(far < found.len() / 20, "{far} of {}", found.len());
        assert!(
            (sum(&found) / sum(&all) - 1.0).abs() < 0.02,
            "{} {}",
            sum(&found),
            sum(&all)
        );
    }
}
