//! A ring: curved both ways, with a shadow of its own.
//!
//! # Design
//! A torus whose axis leans from the camera's upwards, so that one looks through it. Rays are followed by the distance to its surface, which
//! is known exactly (Hart, "Sphere tracing", The Visual Computer 12, 1996). +x of the sample runs around the ring as if it had been
//! turned on a lathe. Where the ring stands between a place and the light it is dark.

use glam::DVec3;
use rayon::prelude::*;

use super::around::Place;
use super::{Content, Picture};
use crate::brdf::reflectance::Reflectance;
use crate::hemisphere::direction::{HORIZON_COS, from_degrees};
use crate::store::StoreError;

/// Radius of the ring's middle line, and of the ring itself, in half widths of the picture.
const RING: f64 = 0.64;
const TUBE: f64 = 0.3;
/// By how much its axis leans, degrees.
const LEAN_DEG: f64 = 40.0;
/// How near to the surface is on it, and steps at most.
const NEAR: f64 = 1e-6;
const STEPS: usize = 200;
/// Beyond this it has passed.
const FAR: f64 = 3.0;

/// Distance from `p` to the surface, less than 0 inside; the axis is z.
fn distance(p: DVec3) -> f64 {
    (p.truncate().length() - RING).hypot(p.z) - TUBE
}

/// Where a ray from `from` along `along` first meets the surface.
fn hit(from: DVec3, along: DVec3) -> Option<DVec3> {
    let mut t = 0.0;
    for _ in 0..STEPS {
        let p = from + t * along;
        let d = distance(p);
        if d < NEAR {
            return Some(p);
        }
        t += d;
        if t > FAR {
            return None;
        }
    }
    None
}

/// The outward normal at `p` on the surface, and the way around the ring.
fn frame(p: DVec3) -> (DVec3, DVec3) {
    let middle = RING * p.with_z(0.0).normalize_or(DVec3::X);
    (
        (p - middle).normalize_or(DVec3::Z),
        DVec3::Z.cross(middle).normalize_or(DVec3::Y),
    )
}

/// From the camera's frame to the ring's, whose axis is z.
fn to_ring(w: DVec3) -> DVec3 {
    let (sin, cos) = LEAN_DEG.to_radians().sin_cos();
    DVec3::new(w.x, w.y * cos + w.z * sin, w.z * cos - w.y * sin)
}

/// And back.
fn from_ring(w: DVec3) -> DVec3 {
    let (sin, cos) = LEAN_DEG.to_radians().sin_cos();
    DVec3::new(w.x, w.y * cos - w.z * sin, w.z * cos + w.y * sin)
}

/// What stands at a pixel of a picture of `size` pixels a side; `None` beside the ring.
pub(super) fn place(size: usize, pixel: usize) -> Option<Place> {
    let half = size as f64 / 2.0;
    let x = ((pixel % size) as f64 + 0.5) / half - 1.0;
    let y = 1.0 - ((pixel / size) as f64 + 0.5) / half;
    let p = hit(to_ring(DVec3::new(x, y, 1.5)), -to_ring(DVec3::Z))?;
    let (normal, x) = frame(p);
    Some(Place {
        at: from_ring(p),
        normal: from_ring(normal),
        x: from_ring(x),
    })
}

/// Whether the ring stands between a place and what is in direction `w` of it.
pub(super) fn is_shaded(place: &Place, w: DVec3) -> bool {
    // A step away from the surface, so that it does not shade itself.
    hit(to_ring(place.at + 1e-3 * place.normal), to_ring(w)).is_some()
}

/// Renders a ring of `size` pixels a side under a light of unit irradiance from polar angle and azimuth `light_deg` (0, 0 is behind the
/// camera; azimuth 90 is above).
///
/// # Errors
/// [`StoreError`] if the BRDF cannot be read.
pub fn torus(material: &dyn Reflectance, size: usize, light_deg: (f64, f64)) -> Result<Picture, StoreError> {
    let light = from_degrees(light_deg.0, light_deg.1);
    let seen: Vec<Option<Option<(DVec3, DVec3)>>> = (0..size * size)
        .into_par_iter()
        .map(|pixel| {
            let place = place(size, pixel)?;
            let is_lit = light.dot(place.normal) > HORIZON_COS && !is_shaded(&place, light);
            Some(is_lit.then(|| (place.local(light), place.local(DVec3::Z))))
        })
        .collect();
    let pairs: Vec<(DVec3, DVec3)> = seen.iter().flatten().flatten().copied().collect();
    let mut values = material.values(&pairs)?.into_iter().zip(&pairs);
    let mut radiance = |lit: Option<(DVec3, DVec3)>| match lit.and_then(|_| values.next()) {
        Some((value, (wi, _))) => value.map(|f| f.map(|f| f * wi.z as f32)),
        None => Ok([0.0; 3]),
    };
    let pixels = seen.into_iter().map(|lit| lit.map(&mut radiance)).collect();
    Ok(Picture {
        size,
        content: Content::Pixels(pixels),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::sample::parse;

    #[test]
    fn rays_meet_the_surface_and_frames_stand_on_it() {
        for (x, y) in [(0.64, 0.0), (0.7, 0.2), (-0.5, -0.5), (0.0, 0.9)] {
            let p = hit(DVec3::new(x, y, 1.5), DVec3::NEG_Z).unwrap();
            assert!(distance(p).abs() < 1e-5, "{p}");
            let (n, along) = frame(p);
            assert!(n.dot(along).abs() < 1e-12 && (n.length() - 1.0).abs() < 1e-12);
            assert!(distance(p + 0.1 * n) > 0.099, "outwards");
        }
        assert!(
            hit(DVec3::new(0.0, 0.0, 1.5), DVec3::NEG_Z).is_none(),
            "through the ring"
        );
    }

    #[test]
    fn a_white_ring_is_as_bright_as_its_cosine_and_shades_itself() {
        let white = parse("lambert:1").unwrap();
        let lit = |light| {
            let picture = torus(&white, 64, light).unwrap();
            let values: Vec<f32> = picture.values().map(|value| value.unwrap()[0]).collect();
            let most = values.iter().copied().fold(0.0, f32::max);
            let dark = values.iter().filter(|value| **value <= 0.0).count();
            (values.len(), most, dark)
        };
        let (seen, most, dark) = lit((0.0, 0.0));
        assert!((1200..2400).contains(&seen), "{seen}");
        // From behind the camera all that is seen is lit.
        assert!(
            (most * std::f32::consts::PI - 1.0).abs() < 0.01 && dark == 0,
            "{most} {dark}"
        );
        let (_, most, dark) = lit((70.0, 90.0));
        assert!(
            (most * std::f32::consts::PI - 1.0).abs() < 0.1 && dark > seen / 5,
            "{most} {dark}"
        );
    }
}
