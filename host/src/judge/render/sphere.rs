//! A sphere: every direction of the sample at once.

use glam::DVec3;
use rayon::prelude::*;

use super::around::Place;
use super::{Content, Picture};
use crate::brdf::reflectance::Reflectance;
use crate::brdf::reflectance::Value;
use crate::hemisphere::direction::{HORIZON_COS, from_degrees};
use crate::store::StoreError;

/// Radius of the sphere in half widths of the picture.
const RADIUS: f64 = 0.96;

/// The normal of the sphere at a pixel (row-major index) of a picture of `size` pixels a side; `None` beside it.
pub(super) fn normal(size: usize, place: usize) -> Option<DVec3> {
    let half = size as f64 / 2.0;
    let x = (((place % size) as f64 + 0.5) / half - 1.0) / RADIUS;
    let y = (1.0 - ((place / size) as f64 + 0.5) / half) / RADIUS;
    let rr = x * x + y * y;
    (rr < 1.0).then(|| DVec3::new(x, y, (1.0 - rr).sqrt()))
}

/// +x and +y of the sample where the sphere has this `normal`: +x along the parallel of latitude.
pub(super) fn frame(normal: DVec3) -> [DVec3; 2] {
    let tangent = DVec3::Y.cross(normal).normalize_or(DVec3::X);
    [tangent, normal.cross(tangent)]
}

/// What stands at a pixel of a picture of `size` pixels a side.
pub(super) fn place(size: usize, pixel: usize) -> Option<Place> {
    let normal = normal(size, pixel)?;
    let [x, _] = frame(normal);
    Some(Place {
        at: normal,
        normal,
        x,
    })
}

/// The places of a sphere's picture that a light reaches, and the directions that matter there.
#[derive(Clone, Debug)]
pub struct LitSphere {
    /// Pixels a side.
    size: usize,
    /// Row-major indices of the pixels on the sphere that the light does not reach.
    dark: Vec<usize>,
    /// Row-major indices of the pixels that it does.
    pub places: Vec<usize>,
    /// For each of those, the directions (to the light, to the camera) in the frame of the sample there.
    pub pairs: Vec<(DVec3, DVec3)>,
}

impl LitSphere {
    /// A sphere of `size` pixels under a light at polar angle and azimuth `light_deg`.
    #[must_use]
    pub fn new(size: usize, light_deg: (f64, f64)) -> Self {
        let light = from_degrees(light_deg.0, light_deg.1);
        let row = |row: usize| {
            let mut found = (Vec::new(), Vec::new(), Vec::new());
            for place in row * size..(row + 1) * size {
                let Some(n) = normal(size, place) else { continue };
                if light.dot(n) <= HORIZON_COS {
                    found.0.push(place);
                    continue;
                }
                let [tangent, bitangent] = frame(n);
                let local = |w: DVec3| DVec3::new(w.dot(tangent), w.dot(bitangent), w.dot(n));
                found.1.push(place);
                found.2.push((local(light), local(DVec3::Z)));
            }
            found
        };
        let rows: Vec<_> = (0..size).into_par_iter().map(row).collect();
        let mut sphere = Self {
            size,
            dark: Vec::new(),
            places: Vec::new(),
            pairs: Vec::new(),
        };
        for (dark, places, pairs) in rows {
            sphere.dark.extend(dark);
            sphere.places.extend(places);
            sphere.pairs.extend(pairs);
        }
        sphere
    }

    /// Radiance at [`Self::places`] under unit irradiance: f·cosθi of `values`, which belong to [`Self::pairs`].
    pub fn radiance<'a>(&'a self, values: &'a [Value]) -> impl Iterator<Item = (usize, Value)> + 'a {
        let lit = self.places.iter().zip(&self.pairs).zip(values);
        lit.map(|((&place, (wi, _)), value)| (place, value.map(|f| f.map(|f| f * wi.z as f32))))
    }
}

/// Renders a sphere of `size` pixels under a light of unit irradiance from polar angle and azimuth
/// `light_deg` (0, 0 is behind the camera; azimuth 90 is above).
///
/// # Errors
/// [`StoreError`] if the BRDF cannot be read.
pub fn sphere(material: &dyn Reflectance, size: usize, light_deg: (f64, f64)) -> Result<Picture, StoreError> {
    let lit = LitSphere::new(size, light_deg);
    let values = material.values(&lit.pairs)?;
    let mut pixels = vec![None; size * size];
    for &place in &lit.dark {
        pixels[place] = Some(Ok([0.0; 3]));
    }
    for (place, radiance) in lit.radiance(&values) {
        pixels[place] = Some(radiance);
    }
    Ok(Picture {
        size: lit.size,
        content: Content::Pixels(pixels),
    })
}
