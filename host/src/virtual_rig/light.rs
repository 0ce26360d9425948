//! Lit projector pixels as light at the sample.
//!
//! # Design
//! A spot of light is some ten to some hundred pixels that lie close together. The sum over them in the signal model,
//! Σ f(ω_p, ω_o)·E_p·cosθ_p·Δω_p, is replaced by four directions of equal weight whose mean and covariance
//! are those of the lit pixels: exact for an f that is cubic over the spot along each principal axis
//! (two-point Gauss quadrature), and 10 to 100 times faster.
//!
//! A pattern may have many spots (multiplexed light). Spots are the connected parts of the lit pixels, neighbours being
//! those at the sides and corners; the light of a pattern is the sum over its spots.
//!
//! # Tradeoffs
//! Spots that touch count as one, which four nodes describe less well. Cells that are lit together are kept apart by
//! [`crate::plan::light::cells`].

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::areas::LitArea;
use crate::instrument::optics::DirectionTiles;

/// What one pattern does.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Glow {
    pub(super) at_sample: AtSample,
    /// Radiance that the camera gets without the sample, as irradiance × f in sr⁻¹.
    pub(super) direct: f64,
    /// Share of red, green and blue that it has.
    pub(super) colour: [f64; 3],
}

/// What one pattern does at the sample.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum AtSample {
    /// Spots of light; none for a black pattern.
    Spots(Arc<[Spot]>),
    /// Relative radiance of every camera pixel, where a mirror shows the pattern itself.
    Image(Arc<[f32]>),
}

impl Default for AtSample {
    fn default() -> Self {
        Self::Spots(Arc::default())
    }
}

impl Glow {
    /// Whether it is black.
    pub(super) fn is_black(&self) -> bool {
        let is_dark = matches!(&self.at_sample, AtSample::Spots(spots) if spots.is_empty());
        is_dark && self.direct <= 0.0
    }
}

/// A pattern on the screen.
#[derive(Debug, Default)]
pub(super) struct Shown {
    pub(super) glow: Glow,
    /// What the camera gets of it, made once for all exposures.
    image: OnceLock<Vec<f32>>,
}

impl From<Glow> for Shown {
    fn from(glow: Glow) -> Self {
        Self {
            glow,
            image: OnceLock::new(),
        }
    }
}

impl Shown {
    /// What the camera gets of it, which is as `make` makes it.
    pub(super) fn image(&self, make: impl FnOnce(&Glow) -> Vec<f32>) -> &[f32] {
        self.image.get_or_init(|| make(&self.glow))
    }
}

/// Light from one spot of a pattern, and what it lights of the sample: all, if that is `None`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spot {
    pub(super) light: Light,
    pub(super) area: Option<LitArea>,
    /// Along which it is polarised, see [`axis`](super::polarisation::axis).
    pub(super) axis: DVec3,
}

/// Light from one spot of a pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Light {
    /// Σ E·cosθ·Δω, relative.
    pub(super) irradiance: f64,
    /// Four directions (unit vectors) of equal weight: mean ± σ₁ ± σ₂, in the order ++, +−, −+, −−.
    pub(super) nodes: [DVec3; 4],
}

impl Light {
    /// The light of each spot among the pixels `lit` (row-major indices) of the projector `projector` whose
    /// pixels have the relative intensity `intensity`, each spread by a standard deviation of `blur_px` pixels; spots that do not
    /// reach the sample are left out.
    pub(super) fn spots(
        lit: &[u32],
        projector: &DirectionTiles,
        blur_px: f64,
        intensity: &dyn Fn(usize) -> f64,
    ) -> Vec<Self> {
        connected(&projector.seeing(lit), projector.view().size_px().0)
            .iter()
            .filter_map(|spot| Self::of(spot, projector, blur_px, intensity))
            .collect()
    }

    /// The light of one spot, or `None` where it does not reach the sample.
    pub(super) fn of(
        lit: &[u32],
        projector: &DirectionTiles,
        blur_px: f64,
        intensity: &dyn Fn(usize) -> f64,
    ) -> Option<Self> {
        let weighted = || {
            lit.iter().filter_map(|&pixel| {
                let (direction, sr) = projector.pixel(pixel as usize)?;
                Some((direction, intensity(pixel as usize) * direction.z * sr))
            })
        };
        let irradiance: f64 = weighted().map(|(_, weight)| weight).sum();
        if irradiance <= 0.0 {
            return None;
        }
        let mean: DVec3 = weighted().map(|(w, weight)| w * weight).sum::<DVec3>() / irradiance;
        let axis = mean.normalize();
        let (e1, e2) = axis.any_orthonormal_pair();
        // A pixel is as wide as its solid angle.
        let reached = || lit.iter().filter_map(|&pixel| projector.pixel(pixel as usize));
        let pixel_sr = reached().map(|(_, sr)| sr).sum::<f64>() / reached().count() as f64;
        let spread = blur_px * blur_px * pixel_sr * irradiance;
        let (mut xx, mut xy, mut yy) = (spread, 0.0, spread);
        for (w, weight) in weighted() {
            let (x, y) = ((w - mean).dot(e1), (w - mean).dot(e2));
            xx += weight * x * x;
            xy += weight * x * y;
            yy += weight * y * y;
        }
        let (xx, xy, yy) = (xx / irradiance, xy / irradiance, yy / irradiance);
        // Principal axes of the 2×2 covariance.
        let turn = 0.5 * (2.0 * xy).atan2(xx - yy);
        let (sin, cos) = turn.sin_cos();
        let half = ((xx - yy) / 2.0).hypot(xy);
        let middle = f64::midpoint(xx, yy);
        let (major, minor) = (middle + half, (middle - half).max(0.0));
        let a = (e1 * cos + e2 * sin) * major.sqrt();
        let b = (e2 * cos - e1 * sin) * minor.sqrt();
        Some(Self {
            irradiance,
            nodes: [mean + a + b, mean + a - b, mean - a + b, mean - a - b].map(DVec3::normalize),
        })
    }
}

/// The connected parts of the pixels `lit` of an image `width_px` wide, each in the order of `lit`.
fn connected(lit: &[u32], width_px: usize) -> Vec<Vec<u32>> {
    let place: HashMap<u32, usize> = lit.iter().enumerate().map(|(at, pixel)| (*pixel, at)).collect();
    let mut part_of = vec![None; lit.len()];
    let mut parts = 0;
    for start in 0..lit.len() {
        if part_of[start].is_some() {
            continue;
        }
        part_of[start] = Some(parts);
        let mut open = vec![start];
        while let Some(at) = open.pop() {
            for neighbour in neighbours(lit[at], width_px) {
                if let Some(&next) = place.get(&neighbour)
                    && part_of[next].is_none()
                {
                    part_of[next] = Some(parts);
                    open.push(next);
                }
            }
        }
        parts += 1;
    }
    let mut spots = vec![Vec::new(); parts];
    for (pixel, part) in lit.iter().zip(part_of) {
        spots[part.expect("every pixel was visited")].push(*pixel);
    }
    spots
}

/// The up to eight pixels at the sides and corners of `pixel`.
fn neighbours(pixel: u32, width_px: usize) -> impl Iterator<Item = u32> {
    let (x, y) = (
        i64::from(pixel) % width_px as i64,
        i64::from(pixel) / width_px as i64,
    );
    let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy)));
    around.filter_map(move |(dx, dy)| {
        let inside = (0..width_px as i64).contains(&(x + dx)) && (dx, dy) != (0, 0);
        u32::try_from((y + dy) * width_px as i64 + x + dx)
            .ok()
            .filter(|_| inside)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;
    use crate::instrument::optics::View;
    use crate::instrument::rig::Rig;
    use crate::plan::pattern::PatternMaker;

    #[test]
    fn four_nodes_have_the_moments_of_the_lit_pixels() {
        let view = View::projector(&Rig::load("rcg-1-16bit").unwrap());
        let projector = DirectionTiles::of(view.clone());
        let maker = PatternMaker::new(view, 4.0, 1.0);
        for theta_deg in [35.0, 60.0, 80.0] {
            let lit = maker.lit_set(from_degrees(theta_deg, 33.0)).unwrap();
            let lights = Light::spots(&lit.pixels, &projector, 0.0, &|_| 1.0);
            let [light] = lights[..] else {
                panic!("one spot: {lights:?}")
            };
            assert!((light.irradiance / lit.irradiance - 1.0).abs() < 1e-12);
            // Any quadratic function of direction has the same mean over both.
            let functions: [fn(DVec3) -> f64; 4] = [|w| w.x, |w| w.z * w.z, |w| w.x * w.y, |w| w.y * w.z];
            for f in functions {
                let direct: f64 = lit
                    .pixels
                    .iter()
                    .map(|&pixel| {
                        let (w, sr) = projector.pixel(pixel as usize).unwrap();
                        f(w) * w.z * sr
                    })
                    .sum::<f64>()
                    / lit.irradiance;
                let nodes = light.nodes.map(f).iter().sum::<f64>() / 4.0;
                assert!((direct - nodes).abs() < 2e-5, "θ {theta_deg}: {direct} {nodes}");
            }
        }
    }

    #[test]
    fn blur_widens_a_spot_and_leaves_its_light() {
        let view = View::projector(&Rig::load("rcg-1-16bit").unwrap());
        let projector = DirectionTiles::of(view.clone());
        let lit = PatternMaker::new(view, 1.0, 1.0)
            .lit_set(from_degrees(60.0, 33.0))
            .unwrap();
        let light = |blur_px: f64| Light::of(&lit.pixels, &projector, blur_px, &|_| 1.0).unwrap();
        let (sharp, soft) = (light(0.0), light(2.0));
        assert!((soft.irradiance / sharp.irradiance - 1.0).abs() < 1e-12);
        // The mean square of the nodes' distances from their middle, both axes together.
        let spread = |light: &Light| {
            let middle = light.nodes.iter().sum::<DVec3>() / 4.0;
            light
                .nodes
                .iter()
                .map(|node| node.distance_squared(middle))
                .sum::<f64>()
                / 4.0
        };
        let pixel_sr = lit
            .pixels
            .iter()
            .map(|pixel| projector.pixel(*pixel as usize).unwrap().1)
            .sum::<f64>()
            / lit.pixels.len() as f64;
        let widened = spread(&soft) - spread(&sharp);
        assert!(
            (widened / (2.0 * 4.0 * pixel_sr) - 1.0).abs() < 0.02,
            "{widened} {pixel_sr}"
        );
    }

    #[test]
    fn the_light_of_separate_spots_is_that_of_each() {
        let view = View::projector(&Rig::load("rcg-1-16bit").unwrap());
        let projector = DirectionTiles::of(view.clone());
        let maker = PatternMaker::new(view, 1.0, 1.0);
        let sets = [(35.0, 10.0), (60.0, 10.0), (60.0, 200.0), (75.0, 100.0)]
            .map(|(theta_deg, phi_deg)| maker.lit_set(from_degrees(theta_deg, phi_deg)).unwrap());
        let ascending = |mut pixels: Vec<u32>| {
            pixels.sort_unstable();
            pixels
        };
        let all = ascending(sets.iter().flat_map(|set| set.pixels.clone()).collect());
        let lights = Light::spots(&all, &projector, 0.0, &|_| 1.0);
        assert_eq!(lights.len(), sets.len());
        for set in &sets {
            // To the bit: a spot does not know what else is lit.
            let alone = Light::of(&ascending(set.pixels.clone()), &projector, 0.0, &|_| 1.0).unwrap();
            assert!(lights.contains(&alone));
        }
    }

    #[test]
    fn spots_are_connected_at_sides_and_corners_and_not_around_the_border() {
        // Columns 0 to 4; a diagonal, then a pixel at each end of neighbouring rows.
        assert_eq!(connected(&[0, 6, 12], 5), [[0, 6, 12]]);
        assert_eq!(connected(&[4, 5], 5), [[4], [5]]);
        assert_eq!(connected(&[0, 2, 6, 24], 5), [vec![0, 2, 6], vec![24]]);
    }

    #[test]
    fn no_pixels_no_light() {
        let projector = DirectionTiles::of(View::projector(&Rig::load("rcg-1-16bit").unwrap()));
        assert_eq!(Light::spots(&[], &projector, 0.0, &|_| 1.0), []);
        assert_eq!(Light::spots(&[0, u32::MAX], &projector, 0.0, &|_| 1.0), []);
    }
}
