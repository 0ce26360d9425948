//! Objects in light from all around.
//!
//! # Design
//! What a place reflects towards the camera is the integral of f·cosθi times the radiance of the environment over the hemisphere. It is a
//! sum over cells of directions that are laid around the mirror direction, in rings whose widths grow with the distance from it: narrow
//! where a highlight is narrow, wide where f changes slowly. Each cell has the mean radiance over its solid angle; lights are added as they
//! are. The sum is scaled so that it is exact for a white standard in light that is the same from everywhere. Where the object itself stands
//! before a cell's middle or a light, nothing comes from there: what one part of it throws onto another is not in the picture.
//!
//! Nothing is drawn by chance: the same picture comes out each time. How far it is from the integral is found by cells of half the size at
//! some places of the object ([`Around::error`]); where that is too much, the whole picture is made with those.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::environment::Environment;
use super::{Content, Picture, corrugated, sphere, torus};
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

/// A place of an object: where it is, its normal and +x of the sample there, in the frame of the picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) at: DVec3,
    pub(super) normal: DVec3,
    pub(super) x: DVec3,
}

impl Place {
    /// `w` in the frame of the sample there.
    pub(super) fn local(&self, w: DVec3) -> DVec3 {
        DVec3::new(
            w.dot(self.x),
            w.dot(self.normal.cross(self.x)),
            w.dot(self.normal),
        )
    }
}

/// Whether the object keeps away from a place what comes from a direction, which is above the horizon there.
type Shade<'a> = &'a (dyn Fn(&Place, DVec3) -> bool + Sync);

/// An object in an environment.
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
    /// At that place of an object.
    fn new(place: &Place, is_shaded: Shade, environment: &Environment, cells: &Cells) -> Self {
        let normal = place.normal;
        let view = place.local(DVec3::Z);
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
                if is_shaded(place, w) {
                    continue;
                }
                sum.pairs.push((place.local(w), view));
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
            if cos > HORIZON_COS && !is_shaded(place, light.direction) {
                sum.pairs.push((place.local(light.direction), view));
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

/// Radiance towards the camera at `places`, and the shares of light without a value.
fn radiances(
    material: &dyn Reflectance,
    environment: &Environment,
    (places, is_shaded): (&[Place], Shade),
    cells: &Cells,
) -> Result<Vec<(Value, f64)>, StoreError> {
    let mut all = Vec::with_capacity(places.len());
    for some in places.chunks((TOGETHER / (cells.0.len() + environment.lights.len())).max(1)) {
        let sums: Vec<Sum> = some
            .par_iter()
            .map(|place| Sum::new(place, is_shaded, environment, cells))
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

/// What all places of an object reflect: radiances, [`Around::error`] and [`Around::unseen`].
type Reflected = (Vec<Value>, [f64; 2], f64);

fn reflected(
    material: &dyn Reflectance,
    environment: &Environment,
    (places, is_shaded): (&[Place], Shade),
) -> Result<Reflected, StoreError> {
    let every = places.len().div_ceil(PROBES).max(1) | 1;
    let probes: Vec<Place> = places.iter().step_by(every).copied().collect();
    let probes = (&probes[..], is_shaded);
    let mut finer = 1;
    let mut cells = Cells::new(finer);
    let mut coarse = radiances(material, environment, probes, &cells)?;
    let error = loop {
        let next = Cells::new(2 * finer);
        let fine = radiances(material, environment, probes, &next)?;
        let (error, brightest) = differences(&coarse, &fine);
        if finer == FINEST || error[1] <= ENOUGH * brightest {
            break error;
        }
        finer *= 2;
        (cells, coarse) = (next, fine);
    };
    let found = radiances(material, environment, (places, is_shaded), &cells)?;
    let drawn = found.iter().filter(|(value, _)| value.is_ok());
    let unseen = drawn.fold(0.0, |most, (_, missing)| f64::max(most, *missing));
    Ok((found.into_iter().map(|(value, _)| value).collect(), error, unseen))
}

/// A picture of `size` pixels a side of what stands at some of its pixels.
fn pictured(
    material: &dyn Reflectance,
    size: usize,
    environment: &Environment,
    seen: Vec<(usize, Place)>,
    is_shaded: Shade,
) -> Result<Around, StoreError> {
    let (pixels, places): (Vec<usize>, Vec<Place>) = seen.into_iter().unzip();
    let (values, error, unseen) = reflected(material, environment, (&places, is_shaded))?;
    let mut picture = vec![None; size * size];
    for (pixel, value) in pixels.into_iter().zip(values) {
        picture[pixel] = Some(value);
    }
    let content = Content::Pixels(picture);
    Ok(Around {
        picture: Picture { size, content },
        error,
        unseen,
    })
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
    let seen = (0..size * size).filter_map(|pixel| Some((pixel, sphere::place(size, pixel)?)));
    pictured(material, size, environment, seen.collect(), &|_, _| false)
}

/// Renders a ring of `size` pixels in `environment`.
///
/// # Errors
/// [`StoreError`] if the BRDF cannot be read.
pub fn torus_in(
    material: &dyn Reflectance,
    size: usize,
    environment: &Environment,
) -> Result<Around, StoreError> {
    let pixels = (0..size * size).into_par_iter();
    let seen = pixels.filter_map(|pixel| Some((pixel, torus::place(size, pixel)?)));
    pictured(material, size, environment, seen.collect(), &torus::is_shaded)
}

/// Renders a corrugated sheet of `size` pixels whose upper edge leans `tilt_deg` away from the camera in `environment`.
///
/// # Errors
/// [`StoreError`] if the BRDF cannot be read.
pub fn corrugated_in(
    material: &dyn Reflectance,
    size: usize,
    tilt_deg: f64,
    environment: &Environment,
) -> Result<Around, StoreError> {
    let sheet = corrugated::Sheet::new(size, tilt_deg);
    let columns: Vec<(usize, Place)> = (0..size)
        .filter_map(|column| Some((column, sheet.place(column)?)))
        .collect();
    let (numbers, places): (Vec<usize>, Vec<Place>) = columns.into_iter().unzip();
    let is_shaded = |place: &Place, w: DVec3| sheet.is_shaded(place, w);
    let (values, error, unseen) = reflected(material, environment, (&places, &is_shaded))?;
    let mut radiance = vec![None; size];
    for (column, value) in numbers.into_iter().zip(values) {
        radiance[column] = Some(value);
    }
    let rows = (0..size).map(|column| sheet.rows(column)).collect();
    let content = Content::Columns { radiance, rows };
    Ok(Around {
        picture: Picture { size, content },
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
    use super::sphere::{frame, normal};
    use super::*;
    use crate::brdf::sample::parse;
    use crate::hemisphere::direction::from_degrees;

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

    #[test]
    fn a_sun_casts_the_shadows_of_a_distant_light_on_every_object() {
        let (width, index) = (512, 75 * 512 + 380);
        let mut sky = vec![Vec3::splat(1e-9); width * width / 2];
        sky[index] = Vec3::splat(1e4);
        let environment = Environment::new(width, &sky);
        let sun = environment.lights[0];
        let light_deg = (
            sun.direction.z.acos().to_degrees(),
            sun.direction.y.atan2(sun.direction.x).to_degrees(),
        );
        assert!((from_degrees(light_deg.0, light_deg.1) - sun.direction).length() < 1e-9);
        let satin = parse("satin").unwrap();
        let size = 48;
        for (around, expected) in [
            (
                sphere_in(&satin, size, &environment),
                sphere(&satin, size, light_deg),
            ),
            (
                torus_in(&satin, size, &environment),
                torus(&satin, size, light_deg),
            ),
            (
                corrugated_in(&satin, size, 25.0, &environment),
                corrugated(&satin, size, 25.0, light_deg),
            ),
        ] {
            let (found, expected) = (around.unwrap().picture, expected.unwrap());
            let (mut lit, mut dark) = (0, 0);
            for pixel in 0..size * size {
                let [found, expected] = [&found, &expected]
                    .map(|of| of.at(pixel % size, pixel / size).map(|value| value.unwrap()[1]));
                assert_eq!(found.is_some(), expected.is_some());
                if let (Some(found), Some(expected)) = (found, expected.map(|f| f * sun.irradiance.y)) {
                    assert!(
                        (found - expected).abs() <= 1e-3 * expected + 1e-6,
                        "{pixel}: {found} {expected}"
                    );
                    *if expected > 0.0 { &mut lit } else { &mut dark } += 1;
                }
            }
            assert!(lit > 200 && dark > 50, "{lit} {dark}");
        }
    }

    #[test]
    fn what_an_object_hides_from_itself_is_dark_and_nothing_else() {
        let everywhere = Environment::new(64, &vec![Vec3::ONE; 64 * 32]);
        let white = parse("lambert:1").unwrap();
        let of = |around: Result<Around, StoreError>| {
            let picture = around.unwrap().picture;
            let greens: Vec<f32> = picture.values().map(|value| value.unwrap()[1]).collect();
            let ends = |of: fn(f32, f32) -> f32| greens.iter().copied().reduce(of).unwrap();
            [ends(f32::min), ends(f32::max)]
        };
        let [least, most] = of(sphere_in(&white, 32, &everywhere));
        assert!(least > 0.999 && most < 1.001, "{least} {most}");
        // Beside the hole of a ring the other side hides a part of the sky, outside nothing does.
        let [least, most] = of(torus_in(&white, 32, &everywhere));
        assert!(
            (0.5..0.95).contains(&least) && (0.99..1.001).contains(&most),
            "{least} {most}"
        );
    }
}
