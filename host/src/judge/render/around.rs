//! A sphere in light from all around.
//!
//! # Design
//! What a place reflects towards the camera is the integral of f·cosθi times the radiance of the environment over the hemisphere. It is a
//! sum over cells of directions that are laid around the mirror direction, in rings whose widths grow with the distance from it: narrow
//! where a highlight is narrow, wide where f changes slowly. Each cell has the mean radiance over its solid angle; lights are added as they
//! are. The sum is scaled so that it is exact for a white standard in light that is the same from everywhere.
//!
//! Nothing is drawn by chance: the same picture comes out each time. How far it is from the integral is found by cells of half the size at
//! some places of the sphere ([`Around::error`]); where that is too much, the whole picture is made with those.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::environment::Environment;
use super::sphere::{frame, normal};
use super::{Content, Picture};
use crate::brdf::reflectance::{Reflectance, Value};
use crate::hemisphere::direction::HORIZON_COS;
use crate::store::StoreError;

/// Rings around the mirror direction and cells of each, and the radius of the first in degrees.
const RINGS: usize = 24;
const SECTORS: usize = 32;
const FIRST_DEG: f64 = 0.5;
/// How much finer cells get at most.
const FINEST: usize = 2;
/// Pairs of directions that are looked up together.
const TOGETHER: usize = 1 << 20;
/// Places at which the error is looked for.
const PROBES: usize = 96;
/// Error over the brightest place up to which cells are fine enough: half a step of a byte.
const ENOUGH: f64 = 0.5 / 255.0;
/// Share of the light at a place that may come from directions without a value.
const MOST_MISSING: f64 = 0.02;

/// A sphere in an environment.
pub struct Around {
    /// The picture: radiance in the unit of the map.
    pub picture: Picture,
    /// Root mean square and largest difference in luma at some places from what cells of half the size give, in the unit of the map.
    pub error: [f64; 2],
    /// Largest share of the light of a drawn place that came from directions without a value; it is replaced by as much of the rest.
    pub unseen: f64,
}

/// Cells of directions around +z: the middle of each, and its solid angle.
struct Cells(Vec<(DVec3, f64)>);

impl Cells {
    /// Those so many times finer than the usual ones.
    fn new(finer: usize) -> Self {
        let (rings, sectors) = (RINGS * finer, SECTORS * finer);
        let first_deg = FIRST_DEG / finer as f64;
        let growth = (180.0 / first_deg).powf(1.0 / (rings - 1) as f64);
        let edge = |ring: usize| match ring {
            0 => 0.0,
            _ if ring == rings => PI,
            _ => (first_deg * growth.powi(ring as i32 - 1)).to_radians(),
        };
        let mut cells = Vec::with_capacity(rings * sectors);
        for ring in 0..rings {
            let (inner, outer) = (edge(ring).cos(), edge(ring + 1).cos());
            // In the middle a ring is one cell.
            let sectors = if ring == 0 { 1 } else { sectors };
            let cos = if ring == 0 { 1.0 } else { 0.5 * (inner + outer) };
            let sin = (1.0 - cos * cos).max(0.0).sqrt();
            for sector in 0..sectors {
                let (y, x) = (TAU * (sector as f64 + 0.5 * (ring % 2) as f64) / sectors as f64).sin_cos();
                let solid_angle = TAU * (inner - outer) / sectors as f64;
                cells.push((DVec3::new(sin * x, sin * y, cos), solid_angle));
            }
        }
        Self(cells)
    }
}

/// What is summed at one place: pairs of directions, the irradiance that each stands for, and which of them are cells, not lights.
struct Sum {
    pairs: Vec<(DVec3, DVec3)>,
    irradiances: Vec<Vec3>,
}

impl Sum {
    /// At the place of the sphere with this `normal`.
    fn new(normal: DVec3, environment: &Environment, cells: &Cells) -> Self {
        let [tangent, bitangent] = frame(normal);
        let local = |w: DVec3| DVec3::new(w.dot(tangent), w.dot(bitangent), w.dot(normal));
        let view = local(DVec3::Z);
        let mirror = 2.0 * normal.z * normal - DVec3::Z;
        let (a, b) = mirror.any_orthonormal_pair();
        let mut sum = Self {
            pairs: Vec::with_capacity(cells.0.len() + environment.lights.len()),
            irradiances: Vec::with_capacity(cells.0.len() + environment.lights.len()),
        };
        let mut projected = 0.0;
        for &(cell, solid_angle) in &cells.0 {
            let w = cell.x * a + cell.y * b + cell.z * mirror;
            let cos = w.dot(normal);
            if cos > HORIZON_COS {
                projected += cos * solid_angle;
                sum.pairs.push((local(w), view));
                let weight = (cos * solid_angle) as f32;
                sum.irradiances.push(weight * environment.mean(w, solid_angle));
            }
        }
        let scale = (PI / projected) as f32;
        for irradiance in &mut sum.irradiances {
            *irradiance *= scale;
        }
        for light in &environment.lights {
            let cos = light.direction.dot(normal);
            if cos > HORIZON_COS {
                sum.pairs.push((local(light.direction), view));
                sum.irradiances.push(cos as f32 * light.irradiance);
            }
        }
        sum
    }

    /// Radiance towards the camera by the `values` of its pairs, and the share of light without one.
    fn radiance(&self, values: &[Value]) -> (Value, f64) {
        let (mut radiance, mut seen, mut all) = (Vec3::ZERO, 0.0, 0.0);
        let mut why = None;
        for (value, irradiance) in values.iter().zip(&self.irradiances) {
            let light = luma(*irradiance);
            all += light;
            match value {
                Ok(f) => {
                    radiance += Vec3::from(*f) * *irradiance;
                    seen += light;
                }
                Err(reason) => why = Some(*reason),
            }
        }
        let missing = if all > 0.0 { 1.0 - seen / all } else { 0.0 };
        match why {
            Some(reason) if missing > MOST_MISSING => (Err(reason), missing),
            _ if seen > 0.0 => (Ok((radiance * (all / seen) as f32).to_array()), missing),
            _ => (Ok([0.0; 3]), 0.0),
        }
    }
}

fn luma(rgb: Vec3) -> f64 {
    f64::from(rgb.dot(Vec3::new(0.299, 0.587, 0.114)))
}

/// Radiance towards the camera at places of the sphere with these `normals`, and the shares of light without a value.
fn radiances(
    material: &dyn Reflectance,
    environment: &Environment,
    normals: &[DVec3],
    cells: &Cells,
) -> Result<Vec<(Value, f64)>, StoreError> {
    let mut all = Vec::with_capacity(normals.len());
    for some in normals.chunks((TOGETHER / (cells.0.len() + environment.lights.len())).max(1)) {
        let sums: Vec<Sum> = some
            .par_iter()
            .map(|&normal| Sum::new(normal, environment, cells))
            .collect();
        let pairs: Vec<(DVec3, DVec3)> = sums.iter().flat_map(|sum| sum.pairs.iter().copied()).collect();
        let values = material.values(&pairs)?;
        let mut rest = &values[..];
        for sum in &sums {
            let (own, others) = rest.split_at(sum.pairs.len());
            all.push(sum.radiance(own));
            rest = others;
        }
    }
    Ok(all)
}

/// Renders a sphere of `size` pixels in `environment`.
///
/// # Errors
/// [`StoreError`] if the BRDF cannot be read.
pub fn sphere_in(
    material: &dyn Reflectance,
    size: usize,
    environment: &Environment,
) -> Result<Around, StoreError> {
    let places: Vec<(usize, DVec3)> = (0..size * size)
        .filter_map(|place| Some((place, normal(size, place)?)))
        .collect();
    let every = places.len().div_ceil(PROBES).max(1) | 1;
    let probes: Vec<DVec3> = places.iter().step_by(every).map(|place| place.1).collect();
    let mut finer = 1;
    let mut cells = Cells::new(finer);
    let mut coarse = radiances(material, environment, &probes, &cells)?;
    let error = loop {
        let next = Cells::new(2 * finer);
        let fine = radiances(material, environment, &probes, &next)?;
        let (error, brightest) = differences(&coarse, &fine);
        if finer == FINEST || error[1] <= ENOUGH * brightest {
            break error;
        }
        finer *= 2;
        (cells, coarse) = (next, fine);
    };
    let normals: Vec<DVec3> = places.iter().map(|place| place.1).collect();
    let found = radiances(material, environment, &normals, &cells)?;
    let mut pixels = vec![None; size * size];
    let mut unseen: f64 = 0.0;
    for ((place, _), (value, missing)) in places.into_iter().zip(found) {
        if value.is_ok() {
            unseen = unseen.max(missing);
        }
        pixels[place] = Some(value);
    }
    Ok(Around {
        picture: Picture {
            size,
            content: Content::Pixels(pixels),
        },
        error,
        unseen,
    })
}

/// Root mean square and largest difference in luma, and the largest luma.
fn differences(one: &[(Value, f64)], other: &[(Value, f64)]) -> ([f64; 2], f64) {
    let (mut squares, mut largest, mut brightest, mut count) = (0.0, 0.0, 0.0, 0.0);
    for ((a, _), (b, _)) in one.iter().zip(other) {
        if let (Ok(a), Ok(b)) = (a, b) {
            let [a, b] = [a, b].map(|rgb| luma(Vec3::from(*rgb)));
            squares += (a - b).powi(2);
            largest = f64::max(largest, (a - b).abs());
            brightest = f64::max(brightest, b);
            count += 1.0;
        }
    }
    ([f64::sqrt(squares / f64::max(count, 1.0)), largest], brightest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::sample::parse;

    /// Green of all pixels of a sphere.
    fn greens(spec: &str, environment: &Environment) -> (Vec<f32>, [f64; 2]) {
        let around = sphere_in(&parse(spec).unwrap(), 24, environment).unwrap();
        let greens = around.picture.values().map(|value| value.unwrap()[1]).collect();
        (greens, around.error)
    }

    #[test]
    fn a_white_sphere_in_light_from_everywhere_is_that_light() {
        let everywhere = Environment::new(64, &vec![Vec3::new(1.0, 0.7, 2.0); 64 * 32]);
        assert!(everywhere.lights.is_empty());
        let (greens, error) = greens("lambert:1", &everywhere);
        assert!(greens.len() > 350);
        for green in greens {
            assert!((green / 0.7 - 1.0).abs() < 1e-5, "{green}");
        }
        assert!(error[1] < 1e-5);
    }

    #[test]
    fn half_a_bright_sky_lights_as_the_integral_says() {
        // Radiance 1 above: the irradiance of a plane whose normal has the height y is π·(1 + y)/2.
        let sky: Vec<Vec3> = (0..256 * 128)
            .map(|index| if index < 128 * 128 { Vec3::ONE } else { Vec3::ZERO })
            .collect();
        let environment = Environment::new(256, &sky);
        let around = sphere_in(&parse("lambert:1").unwrap(), 24, &environment).unwrap();
        for place in 0..24 * 24 {
            if let (Some(normal), Some(Ok(found))) =
                (normal(24, place), around.picture.at(place % 24, place / 24))
            {
                let expected = f64::midpoint(1.0, normal.y);
                assert!(
                    (f64::from(found[1]) - expected).abs() < 0.01,
                    "{normal}: {found:?} {expected}"
                );
            }
        }
    }

    #[test]
    fn a_sun_lights_as_the_same_distant_light_does() {
        // A pixel of the map that alone shines, and its direction as that of a light.
        let (width, index) = (512, 60 * 512 + 300);
        let mut sky = vec![Vec3::splat(1e-6); width * width / 2];
        sky[index] = Vec3::splat(1e4);
        let environment = Environment::new(width, &sky);
        let [sun] = environment.lights[..] else {
            panic!("{}", environment.lights.len())
        };
        for spec in ["lambert:0.5", "ward:brass"] {
            let sample = parse(spec).unwrap();
            let around = sphere_in(&sample, 24, &environment).unwrap();
            for place in 0..24 * 24 {
                let Some(normal) = normal(24, place) else { continue };
                let [x, y] = frame(normal);
                let local = |w: DVec3| DVec3::new(w.dot(x), w.dot(y), w.dot(normal));
                let (wi, wo) = (local(sun.direction), local(DVec3::Z));
                let expected = if wi.z > HORIZON_COS {
                    sample.f(wi, wo)[1] * wi.z * f64::from(sun.irradiance.y)
                } else {
                    0.0
                };
                let found = f64::from(around.picture.at(place % 24, place / 24).unwrap().unwrap()[1]);
                assert!(
                    (found - expected).abs() < 1e-3 * expected + 1e-5,
                    "{spec} {normal}: {found} {expected}"
                );
            }
        }
    }
}
