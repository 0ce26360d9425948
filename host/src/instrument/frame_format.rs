//! The shape of a camera's frames.

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
