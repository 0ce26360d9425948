//! A displaced copy of an image.

use glam::Vec4;

/// How far the interpolation between pixels may be wrong: this share of the range of the pixels around.
const BETWEEN: f32 = 0.15;

/// Where each pixel of a displaced copy comes from.
#[derive(Debug)]
pub(crate) struct Shifted {
    width_px: usize,
    height_px: usize,
    /// Whole pixels, and what is beyond, along x and y.
    x: (isize, f32),
    y: (isize, f32),
}

impl Shifted {
    /// By `shift` half widths, in images of this size.
    pub(crate) fn new(shift: [f64; 2], width_px: usize, height_px: usize) -> Self {
        let [x, y] = shift.map(|shift| {
            let offset = -shift * width_px as f64 / 2.0;
            (offset.floor() as isize, (offset - offset.floor()) as f32)
        });
        Self {
            width_px,
            height_px,
            x,
            y,
        }
    }

    /// The four pixels of `image` around the place that the copy shows at `pixel`; nothing outside.
    fn around(&self, image: &[Vec4], pixel: usize) -> [Vec4; 4] {
        let x = (pixel % self.width_px).cast_signed() + self.x.0;
        let y = (pixel / self.width_px).cast_signed() + self.y.0;
        let inside = |at: isize, size: usize| (0..size.cast_signed()).contains(&at);
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| {
            if inside(x + dx, self.width_px) && inside(y + dy, self.height_px) {
                image[(y + dy).cast_unsigned() * self.width_px + (x + dx).cast_unsigned()]
            } else {
                Vec4::ZERO
            }
        })
    }

    fn between(&self, around: [Vec4; 4]) -> Vec4 {
        let upper = around[0].lerp(around[1], self.x.1);
        let lower = around[2].lerp(around[3], self.x.1);
        upper.lerp(lower, self.y.1)
    }

    /// What the copy of `image` shows at `pixel`.
    pub(crate) fn at(&self, image: &[Vec4], pixel: usize) -> Vec4 {
        self.between(self.around(image, pixel))
    }

    /// Adds the copy of `image`, × `share`, to `out`.
    pub(crate) fn add(&self, image: &[Vec4], share: Vec4, out: &mut [Vec4]) {
        for (pixel, out) in out.iter_mut().enumerate() {
            *out += share * self.at(image, pixel);
        }
    }

    /// Adds to the standard uncertainties `doubt` those of the copy: of its `share`, and of what lies between pixels.
    pub(crate) fn doubt(&self, image: &[Vec4], share: Vec4, uncertainty: f32, doubt: &mut [Vec4]) {
        for (pixel, doubt) in doubt.iter_mut().enumerate() {
            let around = self.around(image, pixel);
            let [a, b, c, d] = around;
            let range = a.max(b).max(c).max(d) - a.min(b).min(c).min(d);
            let copy = self.between(around) * uncertainty;
            *doubt = super::hypot(super::hypot(*doubt, share * range * BETWEEN), copy);
        }
    }
}
