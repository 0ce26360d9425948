//! Pictures as they are, not as a screen shows them: linear radiance, for programs that go on with it.

use std::fs::File;
use std::io::{BufReader, Cursor};
use std::path::Path;

use exr::prelude::{
    Encoding, Image, Layer, LayerAttributes, SpecificChannels, Text, Vec2, WritableImage as _,
    read_first_rgba_layer_from_file,
};
use glam::Vec3;
use image::DynamicImage;
use image::codecs::hdr::HdrDecoder;

use super::{Picture, PictureError, extent};
use crate::base::text::ascii;
use crate::store::whole_file;

/// Saves pictures side by side, one row per entry, as OpenEXR: R, G, B are the radiance f·cosθi in sr⁻¹ under unit irradiance, in 32-bit
/// floats; A is 1 where there is a value and 0 beside the object and where nothing was measured.
///
/// # Errors
/// [`PictureError`].
pub fn save_linear(rows: &[Vec<Picture>], path: &Path, description: &str) -> Result<(), PictureError> {
    let fail = |source| PictureError::File {
        path: path.display().to_string(),
        source,
    };
    let (size, columns) = extent(rows);
    let channels = SpecificChannels::rgba(|Vec2(x, y): Vec2<usize>| {
        let picture = rows[y / size].get(x / size);
        match picture.and_then(|picture| picture.at(x % size, y % size)) {
            Some(Ok([r, g, b])) => (*r, *g, *b, 1.0_f32),
            _ => (0.0, 0.0, 0.0, 0.0),
        }
    });
    let attributes = LayerAttributes {
        // The format's texts are of Latin letters.
        comments: Text::new_or_none(ascii(description)),
        ..LayerAttributes::default()
    };
    let layer = Layer::new(
        Vec2(size * columns, size * rows.len()),
        attributes,
        Encoding::SMALL_LOSSLESS,
        channels,
    );
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer)
        .write()
        .to_buffered(&mut bytes)
        .map_err(|error| fail(std::io::Error::other(error)))?;
    whole_file::write(path, bytes.get_ref()).map_err(fail)
}

/// Reads the linear picture at `path`: its width, and red, green and blue of its pixels, row-major.
///
/// # Errors
/// What is there instead, in words.
pub(super) fn read(path: &Path) -> Result<(usize, Vec<Vec3>), String> {
    let ending = path
        .extension()
        .map(|ending| ending.to_string_lossy().to_lowercase());
    match ending.as_deref() {
        Some("exr") => {
            let image = read_first_rgba_layer_from_file(
                path,
                |size, _| (size.width(), vec![Vec3::ZERO; size.area()]),
                |(width, pixels), at, (r, g, b, _): (f32, f32, f32, f32)| {
                    pixels[at.y() * *width + at.x()] = Vec3::new(r, g, b);
                },
            );
            Ok(image
                .map_err(|error| error.to_string())?
                .layer_data
                .channel_data
                .pixels)
        }
        Some("hdr") => {
            let file = File::open(path).map_err(|error| error.to_string())?;
            let decoder = HdrDecoder::new(BufReader::new(file)).map_err(|error| error.to_string())?;
            let image = DynamicImage::from_decoder(decoder).map_err(|error| error.to_string())?;
            let width = image.width() as usize;
            let pixels = image.into_rgb32f().into_raw();
            Ok((width, pixels.chunks_exact(3).map(Vec3::from_slice).collect()))
        }
        other => Err(other.map_or_else(|| "no ending of its name".to_owned(), |other| format!(".{other}"))),
    }
}

#[cfg(test)]
mod tests {
    use exr::prelude::read_first_flat_layer_from_file;

    use super::*;
    use crate::brdf::sample::parse;
    use crate::judge::render::{corrugated, sphere};

    #[test]
    fn what_is_saved_is_the_radiance() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let white = parse("lambert:1").unwrap();
        let light = (30.0, 90.0);
        let rows = [
            vec![
                sphere(&white, 32, light).unwrap(),
                sphere(&white, 32, (0.0, 0.0)).unwrap(),
            ],
            vec![corrugated(&white, 32, 0.0, light).unwrap()],
        ];
        save_linear(&rows, &path, "φ and more").unwrap();
        let image = read_first_flat_layer_from_file(&path).unwrap();
        assert_eq!(image.layer_data.size, Vec2(64, 64));
        let lanes: Vec<Vec<f32>> = ["R", "A"]
            .map(|name| {
                let channels = &image.layer_data.channel_data.list;
                let found = channels
                    .iter()
                    .find(|channel| channel.name.to_string() == name)
                    .unwrap();
                found.sample_data.values_as_f32().collect()
            })
            .to_vec();
        // The middle of the second sphere faces its light.
        let middle = 16 * 64 + 48;
        assert!(
            (lanes[0][middle] * std::f32::consts::PI - 1.0).abs() < 0.01,
            "{}",
            lanes[0][middle]
        );
        assert!((lanes[1][middle] - 1.0).abs() < 1e-6 && lanes[1][0] <= 0.0);
        // Nothing stands below the second sphere, and a sheet below the first.
        assert!(lanes[1][48 * 64 + 48] <= 0.0 && lanes[1][48 * 64 + 16] > 0.0);
    }
}
