//! Patterns: which projector pixels light the sample from one direction.
//!
//! # Design
//! The lit set is the pixels nearest to the wanted direction, taken until their solid angle at the sample is
//! as near as it gets to the wanted one. The number of pixels changes over the hemisphere; the solid angle
//! stays. What whole pixels leave of error is known exactly, and assembly divides by the solid angle that was
//! actually lit.

use glam::DVec3;

use crate::instrument::optics::{DirectionTiles, Unmeasurable, View, cone_sr};

/// So many bytes are looked at together, whether anything is lit in them.
const DARK_BYTES: usize = 16;

/// A 1-bit image for the projector: rows from the top, 8 pixels per byte, first pixel in the highest bit. The lit pixels
/// have one level of grey, which is the brightest but for the calibration of the projector's response, and are white but for that of
/// the camera's colours.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BitPattern {
    level: u8,
    primary: Option<u8>,
    width_px: usize,
    height_px: usize,
    stride: usize,
    bytes: Vec<u8>,
}

impl BitPattern {
    /// A black image.
    #[must_use]
    pub fn black(width_px: usize, height_px: usize) -> Self {
        let stride = width_px.div_ceil(8);
        Self {
            level: u8::MAX,
            primary: None,
            width_px,
            height_px,
            stride,
            bytes: vec![0; stride * height_px],
        }
    }

    /// Level of grey of the lit pixels, of 255.
    #[must_use]
    pub const fn level(&self) -> u8 {
        self.level
    }

    /// Gives the lit pixels the level of grey `level` of 255.
    pub const fn set_level(&mut self, level: u8) {
        self.level = level;
    }

    /// The only one of the projector's primaries that lit pixels have: 0 red, 1 green, 2 blue; `None` for white.
    #[must_use]
    pub const fn primary(&self) -> Option<u8> {
        self.primary
    }

    /// Gives the lit pixels this primary only.
    pub const fn set_primary(&mut self, primary: Option<u8>) {
        self.primary = primary;
    }

    /// Size in pixels (width, height).
    #[must_use]
    pub const fn size_px(&self) -> (usize, usize) {
        (self.width_px, self.height_px)
    }

    /// The packed rows.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Makes all pixels black, and the level the brightest again, and white.
    pub fn clear(&mut self) {
        self.bytes.fill(0);
        self.level = u8::MAX;
        self.primary = None;
    }

    /// Lights the pixels with these row-major indices.
    pub fn light(&mut self, pixels: &[u32]) {
        // Most lie side by side.
        let (mut row, mut first) = (0..0, 0);
        for &pixel in pixels {
            let pixel = pixel as usize;
            if !row.contains(&pixel) {
                let y = pixel / self.width_px;
                row = y * self.width_px..(y + 1) * self.width_px;
                first = y * self.stride;
            }
            let x = pixel - row.start;
            self.bytes[first + x / 8] |= 0x80 >> (x % 8);
        }
    }

    /// The pattern as a black and white picture.
    #[must_use]
    pub fn to_image(&self) -> image::GrayImage {
        let lit =
            |x: u32, y: u32| self.bytes[y as usize * self.stride + x as usize / 8] & (0x80 >> (x % 8)) != 0;
        image::GrayImage::from_fn(self.width_px as u32, self.height_px as u32, |x, y| {
            image::Luma([if lit(x, y) { 255 } else { 0 }])
        })
    }

    /// The pattern as a picture of its primary, full on where it is lit; white if it has none.
    #[must_use]
    pub fn to_coloured(&self) -> image::RgbImage {
        let colour = |is_lit: bool| match self.primary {
            None => [if is_lit { 255 } else { 0 }; 3],
            Some(primary) => [0, 1, 2].map(|at| if is_lit && at == primary { 255 } else { 0 }),
        };
        let image = self.to_image();
        image::RgbImage::from_fn(self.width_px as u32, self.height_px as u32, |x, y| {
            image::Rgb(colour(image.get_pixel(x, y).0[0] > 0))
        })
    }

    /// Row-major indices of the lit pixels, ascending.
    #[must_use]
    pub fn lit(&self) -> Vec<u32> {
        let mut lit = Vec::new();
        for (y, row) in self.bytes.chunks_exact(self.stride.max(1)).enumerate() {
            // Most of a pattern is dark.
            let bright = row
                .chunks(DARK_BYTES)
                .enumerate()
                .filter(|(_, bytes)| bytes.iter().fold(0, |all, byte| all | byte) != 0);
            for (at, byte) in bright.flat_map(|(chunk, bytes)| (chunk * DARK_BYTES..).zip(bytes)) {
                for bit in (0..8).filter(|bit| byte & (0x80 >> bit) != 0) {
                    lit.push((y * self.width_px + at * 8 + bit) as u32);
                }
            }
        }
        lit
    }
}

/// The light of one pattern at the sample.
#[derive(Clone, Debug, PartialEq)]
pub struct LitSet {
    /// Row-major indices of the lit pixels, nearest first.
    pub pixels: Vec<u32>,
    /// Their solid angle at the sample in sr.
    pub solid_angle_sr: f64,
    /// Σ E·cosθ·Δω over them: irradiance at the sample in units of the projector's relative intensity.
    pub irradiance: f64,
    /// Their mean direction, sample frame.
    pub centroid: DVec3,
}

/// Makes patterns for one projector.
#[derive(Debug)]
pub struct PatternMaker {
    projector: DirectionTiles,
    spot_sr: f64,
    intensity: f64,
}

impl PatternMaker {
    /// Patterns that light a cone of `spot_deg` degrees through the projector `view`; every pixel has the
    /// relative intensity `intensity`.
    #[must_use]
    pub fn new(view: View, spot_deg: f64, intensity: f64) -> Self {
        Self {
            projector: DirectionTiles::of(view),
            spot_sr: cone_sr(spot_deg),
            intensity,
        }
    }

    /// Size of the patterns in pixels (width, height).
    #[must_use]
    pub fn size_px(&self) -> (usize, usize) {
        self.projector.view().size_px()
    }

    /// The pixels to light for incident direction `w`.
    ///
    /// # Errors
    /// Why the projector does not reach `w`.
    pub fn lit_set(&self, w: DVec3) -> Result<LitSet, Unmeasurable> {
        let view = self.projector.view();
        let centre = view.pixel(w)?;
        let (width, height) = self.size_px();
        // Of the position, not of the pixel around it: an edge may pass between it and the pixel's centre.
        let pixel_sr = view.solid_angle_sr(centre.x, centre.y)?;
        let pixel_sr = pixel_sr.max(self.spot_sr * 1e-6);
        // The spot is a disc of spot_sr / pixel_sr pixels; half as wide again for distortion, and a border.
        let radius = 1.5 * (self.spot_sr / pixel_sr / std::f64::consts::PI).sqrt() + 2.0;
        let range = |c: f64, size: usize| {
            ((c - radius).floor().max(0.0) as usize)..((c + radius).ceil().max(0.0) as usize).min(size)
        };

        let mut candidates = Vec::with_capacity((4.0 * radius * radius) as usize + 16);
        for y in range(centre.y, height) {
            for x in range(centre.x, width) {
                let index = y * width + x;
                if let Some(traced) = self.projector.pixel(index) {
                    // |a−b|² orders like the angle and keeps its digits where the dot product loses them.
                    candidates.push(((traced.0 - w).length_squared(), index as u32, traced));
                }
            }
        }
        candidates.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));

        let mut lit = LitSet {
            pixels: Vec::new(),
            solid_angle_sr: 0.0,
            irradiance: 0.0,
            centroid: DVec3::ZERO,
        };
        for (_, pixel, (direction, sr)) in candidates {
            let undershoot = self.spot_sr - lit.solid_angle_sr;
            if !lit.pixels.is_empty() && sr / 2.0 > undershoot {
                break; // one pixel more would be farther off than one less
            }
            lit.pixels.push(pixel);
            lit.solid_angle_sr += sr;
            lit.irradiance += self.intensity * direction.z * sr;
            lit.centroid += direction * sr;
        }
        lit.centroid = lit.centroid.normalize_or(w);
        if lit.pixels.is_empty() {
            Err(Unmeasurable::OutsideImage)
        } else {
            Ok(lit)
        }
    }
}

impl PatternMaker {
    /// Σ E·cosθ·Δω over the pixels of `lit`, if the projector's pixels have the intensities `intensity` (row by row)
    /// relative to what the maker was told.
    #[must_use]
    pub fn irradiance_of(&self, lit: &LitSet, intensity: &[f64]) -> f64 {
        let of = |&pixel: &u32| {
            let pixel = pixel as usize;
            let (direction, sr) = self
                .projector
                .pixel(pixel)
                .expect("invariant: lit pixels are measurable");
            self.intensity * intensity[pixel] * direction.z * sr
        };
        lit.pixels.iter().map(of).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::{angle_between, from_degrees};
    use crate::hemisphere::incident::Rings;
    use crate::instrument::rig::Rig;
    use crate::virtual_rig::{Tolerances, Truth};

    fn maker(preset: &str, spot_deg: f64) -> PatternMaker {
        PatternMaker::new(View::projector(&Rig::load(preset).unwrap()), spot_deg, 1.0)
    }

    #[test]
    fn the_cone_is_that_of_the_textbook() {
        assert!((cone_sr(180.0) - std::f64::consts::TAU).abs() < 1e-12);
        assert!((cone_sr(1.0) / (std::f64::consts::PI * 0.5_f64.to_radians().powi(2)) - 1.0).abs() < 1e-4);
    }

    #[test]
    fn the_solid_angle_is_constant_to_half_a_pixel_and_the_centroid_is_where_it_should_be() {
        for preset in ["rcg-1-16bit", "rcg-2"] {
            let maker = maker(preset, 1.0);
            let grid = Rings::theta_phi(5.0).unwrap();
            let mut pixels = (usize::MAX, 0);
            for index in 0..grid.len() {
                let w = grid.direction(index);
                let Ok(lit) = maker.lit_set(w) else { continue };
                let pixel_sr = lit.solid_angle_sr / lit.pixels.len() as f64;
                let error = (lit.solid_angle_sr - cone_sr(1.0)).abs();
                // At the hole's and the disc's edge there may be no pixels on one side.
                let inside = (35.0..80.0).contains(&grid.angles_deg(index).0) || preset == "rcg-2";
                if inside && grid.angles_deg(index).0 < 85.0 {
                    assert!(
                        error < 0.6 * pixel_sr,
                        "{preset} {index}: off by {} pixels",
                        error / pixel_sr
                    );
                    let off = angle_between(lit.centroid, w);
                    assert!(
                        off < 0.5 * pixel_sr.sqrt(),
                        "{preset} {index}: centroid off by {off} rad"
                    );
                    pixels = (pixels.0.min(lit.pixels.len()), pixels.1.max(lit.pixels.len()));
                }
            }
            // Constant solid angle is not a constant number of pixels.
            assert!(pixels.1 > pixels.0 * 3 / 2, "{preset}: {pixels:?}");
        }
    }

    #[test]
    fn irradiance_falls_with_the_cosine() {
        let maker = maker("rcg-2", 1.0);
        for theta_deg in [5.0, 30.0, 60.0, 80.0] {
            let lit = maker.lit_set(from_degrees(theta_deg, 20.0)).unwrap();
            let expected = lit.solid_angle_sr * theta_deg.to_radians().cos();
            assert!((lit.irradiance / expected - 1.0).abs() < 0.02, "{theta_deg}");
        }
    }

    #[test]
    fn what_cannot_be_lit_says_why() {
        let maker = maker("rcg-1-16bit", 1.0);
        assert_eq!(
            maker.lit_set(from_degrees(10.0, 0.0)).unwrap_err(),
            Unmeasurable::Hole
        );
        assert_eq!(
            maker.lit_set(from_degrees(95.0, 0.0)).unwrap_err(),
            Unmeasurable::BelowHorizon
        );
        assert_eq!(
            maker.lit_set(from_degrees(60.0, 270.0)).unwrap_err(),
            Unmeasurable::Occluded
        );
    }

    #[test]
    fn whatever_is_in_reach_is_lit_at_edges_too() {
        let nominal = Rig::load("rcg-1-16bit").unwrap();
        let tolerances = Tolerances {
            position_m: 5e-4,
            angle_deg: 0.3,
            field: 0.0,
            standard: 0.0,
            ..Tolerances::DRAWN
        };
        for seed in 0..4 {
            let rig = Truth::drawn(&nominal, tolerances, seed).unwrap().rig;
            let view = View::projector(&rig);
            let maker = PatternMaker::new(view.clone(), 1.0, 1.0);
            let grid = Rings::theta_phi(2.0).unwrap();
            let mut count = 0;
            for w in (0..grid.len()).map(|index| grid.direction(index)) {
                if view.pixel(w).is_ok() {
                    let lit = maker
                        .lit_set(w)
                        .unwrap_or_else(|reason| panic!("{seed} {w}: {reason}"));
                    assert!(lit.irradiance > 0.0, "{seed} {w}");
                    count += 1;
                }
            }
            assert!(count > 5000, "{count}");
        }
    }

    #[test]
    fn packed_pixels_come_back() {
        let mut image = BitPattern::black(13, 5);
        let lit = [0, 7, 8, 12, 13, 30, 64];
        image.light(&lit);
        assert_eq!(image.lit(), lit);
        assert_eq!(image.bytes()[..2], [0b1000_0001, 0b1000_1000]);
        let picture = image.to_image();
        assert_eq!(
            picture.pixels().filter(|pixel| pixel.0[0] == 255).count(),
            lit.len()
        );
        image.clear();
        assert!(image.lit().is_empty());
    }
}
