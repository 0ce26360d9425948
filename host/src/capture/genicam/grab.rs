//! One frame by software, to look at.

use std::path::Path;
use std::time::Duration;

use aravis::CameraExt as _;

use super::set::{format_or_set, set_image, set_levels, set_network};
use super::stream::{by_software, stream_of};
use super::{Refusal, open_device};
use crate::capture::camera::CameraError;
use crate::instrument::drivers::Genicam;
use crate::instrument::pixel_format::PixelFormat;
use crate::store::whole_file::{FileError, write_whole};

/// Frames that may wait.
const BUFFERS: u32 = 4;

/// A frame as the sensor gave it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Grabbed {
    /// The camera.
    pub id: String,
    /// Name of the pixel format.
    pub pixel_format: String,
    /// Columns and rows.
    pub region_px: (usize, usize),
    /// Values of a pixel: 1, or 3 for red, green, blue. Under a mosaic of colours it is 1.
    pub values: usize,
    /// Bits of a value.
    pub bits: u8,
    /// Values, [row, column, value].
    pub dn: Vec<u16>,
}

impl Grabbed {
    /// Largest number that a value can be.
    #[must_use]
    pub const fn range_dn(&self) -> u16 {
        u16::MAX >> (16 - self.bits)
    }

    /// Writes it as a PNG of 16 bits at `path`; the whole range of the values is that of the picture.
    ///
    /// # Errors
    /// [`FileError`].
    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        let scale = f64::from(u16::MAX) / f64::from(self.range_dn());
        let values = self.dn.iter().map(|&dn| (f64::from(dn) * scale).round() as u16);
        let bytes: Vec<u8> = values.flat_map(u16::to_be_bytes).collect();
        let encoded = || -> Result<Vec<u8>, png::EncodingError> {
            let mut png = Vec::new();
            let (width, height) = self.region_px;
            let mut encoder = png::Encoder::new(&mut png, width as u32, height as u32);
            encoder.set_depth(png::BitDepth::Sixteen);
            encoder.set_color(if self.values == 3 {
                png::ColorType::Rgb
            } else {
                png::ColorType::Grayscale
            });
            let mut writer = encoder.write_header()?;
            writer.write_image_data(&bytes)?;
            writer.finish()?;
            Ok(png)
        };
        let png = encoded().map_err(|error| FileError::at(path, std::io::Error::other(error.to_string())))?;
        write_whole(path, &png)
    }
}

/// A frame of `exposure_s` seconds of the camera of these `settings`, triggered by software.
///
/// # Errors
/// [`CameraError`].
pub fn grab(settings: &Genicam, exposure_s: f64) -> Result<Grabbed, CameraError> {
    let (id, camera) = open_device(settings.device.as_deref())?;
    let refusal = Refusal(&id);
    let pixel_format = format_or_set(&refusal, &camera, settings)?;
    let format = PixelFormat::of(&pixel_format).ok_or_else(|| {
        refusal.failed(format!(
            "PixelFormat: expected Mono, Bayer or RGB of 8 to 16 bits, found {pixel_format}"
        ))
    })?;
    let region_px = set_image(&refusal, &camera, settings, &pixel_format)?;
    set_levels(&refusal, &camera, settings)?;
    set_network(&refusal, &camera, settings)?;
    camera
        .set_exposure_time(exposure_s * 1e6)
        .map_err(refusal.feature("ExposureTime"))?;
    let (stream, _) = stream_of(&refusal, &camera, BUFFERS)?;
    let patience = Duration::from_secs_f64(exposure_s + 2.0);
    let (buffer, _) = by_software(&refusal, &camera, &stream, patience)?;
    let dn = format
        .values_of(&buffer.image_data(), region_px.0 * region_px.1)
        .ok_or_else(|| refusal.failed("expected a frame of the region's size, found a shorter one"))?;
    Ok(Grabbed {
        values: format.values(),
        bits: format.bits(),
        id,
        pixel_format,
        region_px,
        dn,
    })
}
