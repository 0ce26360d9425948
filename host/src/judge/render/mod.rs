//! Pictures of the sample: what it looks like on a sphere, on a corrugated sheet and on a ring.
//!
//! # Design
//! One distant light, or an environment map, seen from +z by a distant camera. The picture is linear radiance f·cosθi; exposure and sRGB
//! come last. At each point of the sphere the sample's frame has its normal along the sphere's and its +x along
//! the parallel of latitude, so that a brushed metal is brushed around the sphere's upright axis; on the corrugated
//! sheet it follows the sheet. Directions that were not measured are drawn as a hatch, never invented.

mod around;
mod camera_colours;
mod corrugated;
mod environment;
mod linear;
mod sphere;
mod torus;

use std::path::Path;

use image::{ImageBuffer, Pixel, Rgb, RgbImage};
use rayon::prelude::*;

use crate::base::blame::Blame;
use crate::base::file_format::{FormatError, PICTURE};
use crate::brdf::reflectance::Value;
use crate::store::whole_file;

pub use around::{Around, corrugated_in, sphere_in, torus_in};
pub use camera_colours::{CameraColours, ColourError};
pub use corrugated::corrugated;
pub use environment::{Environment, EnvironmentError};
pub use linear::save_linear;
pub use sphere::{LitSphere, sphere};
pub use torus::torus;

/// Behind everything, coded.
const BACKGROUND: [u8; 3] = [24, 26, 30];

/// One square picture of linear radiance.
pub struct Picture {
    size: usize,
    content: Content,
}

/// What is in a picture.
enum Content {
    /// Radiance per pixel, row-major: `None` beside the object, or why there is no value.
    Pixels(Vec<Option<Value>>),
    /// Radiance per column, and the rows from and to which the object covers the column, in pixels.
    Columns {
        radiance: Vec<Option<Value>>,
        rows: Vec<(f64, f64)>,
    },
}

impl Picture {
    /// All values that were rendered.
    fn values(&self) -> impl Iterator<Item = &Value> {
        let (Content::Pixels(values) | Content::Columns { radiance: values, .. }) = &self.content;
        values.iter().flatten()
    }

    /// What is at a pixel of this column and row; `None` beside the object.
    fn at(&self, x: usize, y: usize) -> Option<&Value> {
        match &self.content {
            Content::Pixels(pixels) => pixels.get(y * self.size + x)?.as_ref(),
            Content::Columns { radiance, rows } => {
                let covers = rows.get(x)?;
                let is_covered = (covers.0..covers.1).contains(&(y as f64 + 0.5));
                radiance[x].as_ref().filter(|_| is_covered)
            }
        }
    }

    /// Draws into `image`, the rows of a sheet `columns` pictures wide, as the picture in column `column`.
    fn draw(&self, image: &mut [u8], columns: usize, column: usize, width: usize, exposure: f32) {
        let stripe = 3 * columns * width;
        let own = 3 * column * width..3 * (column * width + self.size);
        let rows = image.par_chunks_exact_mut(stripe).take(self.size).enumerate();
        match &self.content {
            Content::Pixels(pixels) => rows.for_each(|(y, row)| {
                let pixels = &pixels[y * self.size..][..self.size];
                for (x, (pixel, bytes)) in pixels
                    .iter()
                    .zip(row[own.clone()].chunks_exact_mut(3))
                    .enumerate()
                {
                    if let Some(value) = pixel {
                        bytes.copy_from_slice(&coded(value, exposure, x, y));
                    }
                }
            }),
            Content::Columns {
                radiance,
                rows: covered,
            } => {
                // The hatch repeats every eight rows, and so does everything else.
                let cycle: Vec<Vec<u8>> = (0..8)
                    .map(|y| {
                        let colour = |(x, value): (usize, &Option<Value>)| {
                            value
                                .as_ref()
                                .map_or(BACKGROUND, |value| coded(value, exposure, x, y))
                        };
                        radiance.iter().enumerate().flat_map(colour).collect()
                    })
                    .collect();
                let first = covered.iter().map(|rows| rows.0).fold(f64::INFINITY, f64::min);
                let full = covered.iter().filter(|rows| rows.1 > rows.0);
                let inner = full.fold((first, f64::INFINITY), |inner, rows| {
                    (inner.0.max(rows.0), inner.1.min(rows.1))
                });
                rows.for_each(|(y, row)| {
                    let (row, colours) = (&mut row[own.clone()], &cycle[y % 8]);
                    let at = y as f64 + 0.5;
                    if (inner.0..inner.1).contains(&at) {
                        row.copy_from_slice(colours);
                        return;
                    }
                    for ((bytes, colour), rows) in
                        row.chunks_exact_mut(3).zip(colours.chunks_exact(3)).zip(covered)
                    {
                        if (rows.0..rows.1).contains(&at) {
                            bytes.copy_from_slice(colour);
                        }
                    }
                });
            }
        }
    }
}

/// A value as sRGB; where there is none, a diagonal hatch.
fn coded(value: &Value, exposure: f32, x: usize, y: usize) -> [u8; 3] {
    match value {
        Ok(radiance) => radiance.map(|l| srgb(l * exposure)),
        Err(_) if (x + y) % 8 < 2 => [86, 74, 110],
        Err(_) => [52, 46, 66],
    }
}

/// Pixels a side of the pictures of a sheet, and how many stand side by side.
fn extent(rows: &[Vec<Picture>]) -> (usize, usize) {
    let sizes = rows.iter().flatten().map(|picture| picture.size);
    let columns = rows.iter().map(Vec::len);
    (sizes.max().unwrap_or(1), columns.max().unwrap_or(1))
}

/// Side by side: one row per entry, each with its pictures; pixels are exposed by `exposure` and coded as sRGB.
#[must_use]
pub fn sheet(rows: &[Vec<Picture>], exposure: f32) -> RgbImage {
    let (size, columns) = extent(rows);
    let mut image = RgbImage::from_pixel(
        (size * columns) as u32,
        (size * rows.len()) as u32,
        Rgb(BACKGROUND),
    );
    for (pictures, band) in rows.iter().zip(image.chunks_exact_mut(3 * columns * size * size)) {
        for (column, picture) in pictures.iter().enumerate() {
            picture.draw(band, columns, column, size, exposure);
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
    // Not `round`, which not every processor has an instruction for.
    (coded * 255.0 + 0.5) as u8
}

/// An exposure that puts the brightest hundredth of the pictures at white.
#[must_use]
pub fn automatic_exposure(rows: &[Vec<Picture>]) -> f32 {
    let mut levels: Vec<f32> = rows
        .iter()
        .flatten()
        .flat_map(Picture::values)
        .filter_map(|value| Some(value.ok()?[1]))
        .filter(|&level| level > 0.0)
        .collect();
    if levels.is_empty() {
        return 1.0;
    }
    let place = levels.len() * 97 / 100;
    let (_, level, _) = levels.select_nth_unstable_by(place, f32::total_cmp);
    1.0 / level.max(1e-6)
}

/// Share of the lit pixels of the pictures that have a value; the others are hatched. `None` if nothing is lit.
#[must_use]
pub fn share_with_values(rows: &[Vec<Picture>]) -> Option<f64> {
    let (mut all, mut known) = (0_usize, 0_usize);
    for value in rows.iter().flatten().flat_map(Picture::values) {
        all += 1;
        known += usize::from(value.is_ok());
    }
    (all > 0).then(|| known as f64 / all as f64)
}

/// Where φ = 0 of the sample lies in the pictures: `zero` says where that is on the sample (as `Azimuth` does), if anybody knows.
#[must_use]
pub fn azimuth_in_words(zero: Option<&str>) -> String {
    let shown = "φ = 0 of the sample points to the right: along a sphere's parallels, across a sheet's folds, around a ring";
    match zero {
        Some(zero) => format!("{shown}; on the sample, {zero}"),
        None => shown.to_owned(),
    }
}

/// Why a picture cannot be saved.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The name of the file says that it is none.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The file.
    #[error("{path}: the picture cannot be written: {source}")]
    File {
        /// The file.
        path: String,
        /// What is wrong.
        source: std::io::Error,
    },
}

impl Blame for PictureError {
    fn is_input(&self) -> bool {
        matches!(self, Self::Format(_))
    }
}

/// Saves a picture as PNG, whole or not at all; packed for speed rather than size: large pictures are bound by it.
///
/// # Errors
/// [`PictureError`].
pub fn save<P>(image: &ImageBuffer<P, Vec<u8>>, path: &Path) -> Result<(), PictureError>
where
    P: Pixel<Subpixel = u8>,
{
    save_described(image, path, None)
}

/// As [`save`], with what a person has to know of the picture in the file: an iTXt chunk `Description` (PNG, third edition, 11.3.3.4).
///
/// # Errors
/// [`PictureError`].
pub fn save_described<P>(
    image: &ImageBuffer<P, Vec<u8>>,
    path: &Path,
    description: Option<&str>,
) -> Result<(), PictureError>
where
    P: Pixel<Subpixel = u8>,
{
    PICTURE.of(path)?;
    let fail = |source| PictureError::File {
        path: path.display().to_string(),
        source,
    };
    let bytes = coded_png(image, description).map_err(|error| fail(error.into()))?;
    whole_file::write(path, &bytes).map_err(fail)
}

/// The bytes of a PNG, with what a person has to know of the picture.
///
/// # Errors
/// What the encoder says.
pub(crate) fn coded_png<P>(
    image: &ImageBuffer<P, Vec<u8>>,
    description: Option<&str>,
) -> Result<Vec<u8>, png::EncodingError>
where
    P: Pixel<Subpixel = u8>,
{
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, image.width(), image.height());
    encoder.set_color(match P::CHANNEL_COUNT {
        1 => png::ColorType::Grayscale,
        2 => png::ColorType::GrayscaleAlpha,
        3 => png::ColorType::Rgb,
        _ => png::ColorType::Rgba,
    });
    encoder.set_compression(png::Compression::Fast);
    encoder.set_filter(png::Filter::Up);
    if let Some(description) = description {
        encoder.add_itxt_chunk("Description".to_owned(), description.to_owned())?;
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(image.as_raw())?;
    writer.finish()?;
    Ok(bytes)
}
