//! The shape of a camera's frames.

use glam::DVec2;

/// Shape of a camera's frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameFormat {
    /// Columns.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// Colour channels: 1 or 3.
    pub channels: usize,
    /// Bits of a digital number.
    pub bits: u8,
}

/// Where the centre of the pixel of this `index` (row-major) is in an image of this size: x and y, −1 to 1 over the image.
pub(crate) fn place_of_pixel(index: usize, width_px: usize, height_px: usize) -> [f64; 2] {
    let half = |at: usize, size: usize| 2.0 * (at as f64 + 0.5) / size as f64 - 1.0;
    [
        half(index % width_px, width_px),
        half(index / width_px, height_px),
    ]
}

/// Position of the centre of the pixel `index` of an image `width_px` wide, pixels.
pub(crate) fn pixel_centre(index: usize, width_px: usize) -> DVec2 {
    DVec2::new((index % width_px) as f64 + 0.5, (index / width_px) as f64 + 0.5)
}

impl FrameFormat {
    /// Digital numbers of a frame.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.width_px * self.height_px * self.channels
    }

    /// Whether frames are empty.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The largest digital number, where the camera saturates.
    #[must_use]
    pub const fn saturation_dn(&self) -> u16 {
        ((1_u32 << self.bits) - 1) as u16
    }
}
