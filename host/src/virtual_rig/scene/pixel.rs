//! What a camera pixel sees of the sample.

use glam::DVec3;

use crate::brdf::quadrature::{PLACES, mean_f};
use crate::brdf::sample::Outgoing;
use crate::instrument::frame_format::FrameFormat;
use crate::instrument::optics::View;
use crate::virtual_rig::areas::{LitArea, SeenArea};
use crate::virtual_rig::flaws::{Flaws, Pupils};
use crate::virtual_rig::light::Spot;
use crate::virtual_rig::polarisation::axis;

/// Offset of the two Gauss points from the centre of a pixel: 1/(2√3).
const GAUSS: f64 = 0.288_675_134_594_812_9;
/// No part of a pixel is wider than this, degrees …
const PART_DEG: f64 = 2.5;
/// … as far as so many parts along an axis do.
const MOST_PARTS: f64 = 4.0;

/// A camera pixel that sees the sample.
pub(super) struct Pixel {
    pub(super) index: usize,
    /// Directions within each part of it, in the order ++, +−, −+, −− (first along u, then along v); `None` where none is
    /// seen.
    pub(super) parts: Vec<[Option<DVec3>; 4]>,
    /// One of them, and the share of the pixel that sees.
    pub(super) one: DVec3,
    pub(super) seen: f64,
    pub(super) throughput: f64,
    /// What it sees of the sample: a point, if that is `None`.
    pub(super) area: Option<SeenArea>,
    /// Along which what it sees is polarised, see [`axis`].
    pub(super) axis: DVec3,
}

impl Pixel {
    /// f over light and pixel, from the lobes of the directions of light.
    pub(super) fn mean_f(&self, lobes: &[Box<dyn Outgoing + '_>; 4]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for part in &self.parts {
            for (sum, f) in sum.iter_mut().zip(mean_f(lobes, part)) {
                *sum += f / self.parts.len() as f64;
            }
        }
        sum
    }

    /// The same over one light among many, whose means come to the same together: of many parts each is looked at from two of its
    /// directions, at each place once, so that what an edge cuts off is what it is.
    pub(super) fn mean_f_of_many(&self, lobes: &[Box<dyn Outgoing + '_>; 4]) -> [f64; 3] {
        if self.parts.len() < lobes.len() {
            return self.mean_f(lobes);
        }
        let mut sum = DVec3::ZERO;
        for (part, pair) in self.parts.iter().zip([[0, 1], [2, 3]].into_iter().cycle()) {
            for lobe in pair {
                for wo in PLACES[lobe].into_iter().filter_map(|place| part[place]) {
                    sum += DVec3::from(lobes[lobe].f(wo));
                }
            }
        }
        (sum / (4 * self.parts.len()) as f64).to_array()
    }

    /// What of it is both seen and lit by `spot`, as `share_of` has it.
    pub(super) fn share(&self, spot: &Spot, share_of: impl FnOnce(&SeenArea, &LitArea) -> f64) -> f64 {
        let areas = self.area.as_ref().zip(spot.area.as_ref());
        areas.map_or(1.0, |(seen, lit)| share_of(seen, lit))
    }
}

/// The places in each part of the pixel around (`u`, `v`).
fn parts(view: &View, u: f64, v: f64) -> Vec<[Option<DVec3>; 4]> {
    let width_deg = view.solid_angle_sr(u, v).map_or(0.0, f64::sqrt).to_degrees();
    let along = (width_deg / PART_DEG).ceil().clamp(1.0, MOST_PARTS);
    let middle = |part: usize| (part as f64 + 0.5) / along - 0.5;
    let count = along as usize;
    (0..count * count)
        .map(|part| {
            let (u, v) = (u + middle(part % count), v + middle(part / count));
            let step = GAUSS / along;
            let at = |du: f64, dv: f64| view.direction(u + du * step, v + dv * step).ok();
            [at(1.0, 1.0), at(1.0, -1.0), at(-1.0, 1.0), at(-1.0, -1.0)]
        })
        .collect()
}

/// The pixels of the camera with this `view` that see the sample.
pub(super) fn pixels(view: &View, flaws: &Flaws, format: FrameFormat, pupils: Option<&Pupils>) -> Vec<Pixel> {
    let throughput = flaws.throughput.over(format.width_px, format.height_px);
    (0..format.width_px * format.height_px)
        .filter_map(|index| {
            let (u, v) = (
                (index % format.width_px) as f64 + 0.5,
                (index / format.width_px) as f64 + 0.5,
            );
            let parts = parts(view, u, v);
            let seen = parts.iter().flatten().flatten();
            let one = *seen.clone().next()?;
            let area = match pupils {
                // What is seen edge on is nothing.
                Some(pupils) => Some(SeenArea::new(
                    view,
                    seen.clone().sum::<DVec3>().normalize(),
                    pupils,
                )?),
                None => None,
            };
            Some(Pixel {
                index,
                axis: axis(view, one),
                one,
                area,
                seen: seen.count() as f64 / (4 * parts.len()) as f64,
                parts,
                throughput: throughput[index],
            })
        })
        .collect()
}
