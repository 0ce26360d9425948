//! Pictures of a lit sphere.
//!
//! # Design
//! A sphere under one distant light, seen from +z by a distant camera. At each point the sample's frame has
//! its normal along the sphere's and its +x along the parallel of latitude, so that a brushed metal is brushed
//! around the sphere's upright axis. The picture is linear radiance f·cosθi; exposure and sRGB come last.
//! Directions that were not measured are drawn as a hatch, never invented.

use std::fs::File;
use std::io::{Cursor, Write as _};
use std::path::Path;

use glam::DVec3;
use image::{ImageError, Rgb, RgbImage};

use crate::brdf::Value;
use crate::direction::from_degrees;
use crate::reflectance::Reflectance;
use crate::store::StoreError;

/// One picture: linear radiance per pixel, `None` outside the sphere, and why where there is no value.
pub struct Sphere {
    size: usize,
    pixels: Vec<Option<Value>>,
}

/// Renders a sphere of `size` pixels under a light of unit irradiance from polar angle and azimuth
/// `light_deg` (0, 0 is behind the camera; azimuth 90 is above).
///
/// # Errors
/// [`StoreError`] if the BRDF cannot be read.
pub fn sphere(material: &dyn Reflectance, size: usize, light_deg: (f64, f64)) -> Result<Sphere, StoreError> {
    let light = from_degrees(light_deg.0, light_deg.1);
    let half = size as f64 / 2.0;
    let mut pairs = Vec::new();
    let mut places = Vec::new();
    let mut pixels = vec![None; size * size];
    for (place, pixel) in pixels.iter_mut().enumerate() {
        let x = ((place % size) as f64 + 0.5) / half - 1.0;
        let y = 1.0 - ((place / size) as f64 + 0.5) / half;
        let rr = (x * x + y * y) / (0.96 * 0.96);
        if rr >= 1.0 {
            continue;
        }
        let n = DVec3::new(x / 0.96, y / 0.96, (1.0 - rr).sqrt());
        let tangent = DVec3::Y.cross(n).normalize_or(DVec3::X);
        let bitangent = n.cross(tangent);
        let local = |w: DVec3| DVec3::new(w.dot(tangent), w.dot(bitangent), w.dot(n));
        *pixel = Some(Ok([0.0; 3])); // in its own shadow unless lit
        if light.dot(n) > 0.0 {
            pairs.push((local(light), local(DVec3::Z)));
            places.push(place);
        }
    }
    let values = material.values(&pairs)?;
    for ((place, value), (wi, _)) in places.into_iter().zip(values).zip(pairs) {
        pixels[place] = Some(value.map(|f| f.map(|f| f * wi.z as f32)));
    }
    Ok(Sphere { size, pixels })
}

/// Side by side: one row per entry, each with its pictures; pixels are exposed by `exposure` and coded as sRGB.
#[must_use]
pub fn sheet(rows: &[Vec<Sphere>], exposure: f32) -> RgbImage {
    let size = rows.iter().flatten().map(|sphere| sphere.size).max().unwrap_or(1);
    let columns = rows.iter().map(Vec::len).max().unwrap_or(1);
    let mut image = RgbImage::from_pixel(
        (size * columns) as u32,
        (size * rows.len()) as u32,
        Rgb([24, 26, 30]),
    );
    for (row, spheres) in rows.iter().enumerate() {
        for (column, sphere) in spheres.iter().enumerate() {
            for (place, pixel) in sphere.pixels.iter().enumerate() {
                let (x, y) = (place % sphere.size, place / sphere.size);
                let colour = match pixel {
                    None => continue,
                    Some(Ok(radiance)) => radiance.map(|l| srgb(l * exposure)),
                    // Diagonal hatch: no value.
                    Some(Err(_)) if (x + y) % 8 < 2 => [86, 74, 110],
                    Some(Err(_)) => [52, 46, 66],
                };
                image.put_pixel((column * size + x) as u32, (row * size + y) as u32, Rgb(colour));
            }
        }
    }
    image
}

/// Linear light 0..1 as an sRGB byte (IEC 61966-2-1), clipped.
#[must_use]
pub fn srgb(linear: f32) -> u8 {
    let l = linear.clamp(0.0, 1.0);
    let coded = if l <= 0.003_130_8 {
        12.92 * l
    } else {
        1.055 * l.powf(1.0 / 2.4) - 0.055
    };
    (coded * 255.0).round() as u8
}

/// An exposure that puts the brightest hundredth of the pictures at white.
#[must_use]
pub fn automatic_exposure(rows: &[Vec<Sphere>]) -> f32 {
    let lit = rows.iter().flatten().flat_map(|sphere| &sphere.pixels);
    let mut levels: Vec<f32> = lit
        .filter_map(|pixel| Some(pixel.as_ref()?.ok()?[1]))
        .filter(|&level| level > 0.0)
        .collect();
    levels.sort_by(f32::total_cmp);
    levels
        .get(levels.len() * 97 / 100)
        .map_or(1.0, |&level| 1.0 / level.max(1e-6))
}

/// Why a picture cannot be saved.
#[derive(Debug, thiserror::Error)]
#[error("{path}: the picture cannot be written: {source}")]
pub struct PictureError {
    path: String,
    source: ImageError,
}

/// Saves a picture as PNG.
///
/// # Errors
/// [`PictureError`].
pub fn save<P>(image: &image::ImageBuffer<P, Vec<u8>>, path: &Path) -> Result<(), PictureError>
where
    P: image::PixelWithColorType<Subpixel = u8>,
{
    let fail = |source| PictureError {
        path: path.display().to_string(),
        source,
    };
    let mut bytes = Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, image::ImageFormat::Png)
        .map_err(fail)?;
    let mut file = File::create(path).map_err(|error| fail(ImageError::IoError(error)))?;
    file.write_all(bytes.get_ref()).map_err(|error| {
        // Half a picture goes; a device stays.
        if path.is_file() {
            std::fs::remove_file(path).ok();
        }
        fail(ImageError::IoError(error))
    })
}
