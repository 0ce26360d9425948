//! Light and sample as charge of every camera pixel.
//!
//! # Design
//! Finite light and finite pixels blur a sharp lobe, and the virtual rig shows that: f is averaged over four
//! directions of light and four places within the pixel.

use std::sync::Arc;

use glam::DVec3;

use super::light::Light;
use super::sensor::Sensor;
use super::stage::{Shot, Spots};
use crate::camera::FrameFormat;
use crate::optics::{DirectionMap, View};
use crate::quadrature::mean_f;
use crate::rig::Rig;
use crate::sample::Sample;

/// Offset of the two Gauss points from the centre of a pixel: 1/(2√3).
const GAUSS: f64 = 0.288_675_134_594_812_9;

/// A camera pixel that sees the sample: its index and four directions within it, in the order ++, +−, −+, −−
/// (first along u, then along v).
struct Pixel {
    index: usize,
    directions: [DVec3; 4],
}

/// The sample in the rig.
pub(super) struct Scene {
    sample: Arc<dyn Sample>,
    format: FrameFormat,
    pixels: Vec<Pixel>,
    projector: DirectionMap,
    intensity: f64,
    sensor: Sensor,
    /// Electrons per (f in sr⁻¹ × irradiance × second).
    sensitivity: f64,
}

impl Scene {
    pub(super) fn new(rig: &Rig, sample: Arc<dyn Sample>) -> Self {
        let format = rig.frame_format();
        let view = View::camera(rig);
        let pixels = (0..format.width_px * format.height_px)
            .filter_map(|index| {
                let (u, v) = (
                    (index % format.width_px) as f64 + 0.5,
                    (index / format.width_px) as f64 + 0.5,
                );
                let centre = view.direction(u, v).ok()?;
                let at = |du: f64, dv: f64| view.direction(u + du * GAUSS, v + dv * GAUSS).unwrap_or(centre);
                Some(Pixel {
                    index,
                    directions: [at(1.0, 1.0), at(1.0, -1.0), at(-1.0, 1.0), at(-1.0, -1.0)],
                })
            })
            .collect();
        Self {
            sample,
            format,
            pixels,
            projector: DirectionMap::of(&View::projector(rig)),
            intensity: rig.projector.irradiance,
            sensor: Sensor::of(rig),
            sensitivity: rig.sensitivity_e(),
        }
    }

    pub(super) const fn format(&self) -> FrameFormat {
        self.format
    }

    pub(super) const fn sensor(&self) -> &Sensor {
        &self.sensor
    }

    pub(super) const fn projector_size_px(&self) -> (usize, usize) {
        (self.projector.width_px, self.projector.height_px)
    }

    pub(super) fn light(&self, lit: &[u32]) -> Spots {
        Light::spots(lit, &self.projector, self.intensity).into()
    }

    /// Electrons of light in every pixel, [row, column, channel].
    pub(super) fn charge_e(&self, shot: &Shot) -> Vec<f32> {
        let channels = self.format.channels;
        let mut charge_e = vec![0.0; self.format.len()];
        let seen = shot.seen.iter();
        for (light, visible_s) in seen.flat_map(|(spots, s)| spots.iter().map(move |spot| (spot, s))) {
            let lobes = light.nodes.map(|node| self.sample.incident(node));
            let scale = self.sensitivity * light.irradiance * visible_s;
            for pixel in &self.pixels {
                let mut mean = mean_f(&lobes, &pixel.directions);
                if channels == 1 {
                    mean[0] = (mean[0] + mean[1] + mean[2]) / 3.0;
                }
                let out = &mut charge_e[pixel.index * channels..][..channels];
                for (out, f) in out.iter_mut().zip(mean) {
                    *out += (scale * f) as f32;
                }
            }
        }
        charge_e
    }
}
