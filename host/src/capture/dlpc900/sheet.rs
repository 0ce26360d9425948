//! Sheets: 24 patterns of one bit in a picture of three colours, for programs that show such frames.

use super::image::{PLANES, Planes};
use crate::plan::pattern::BitPattern;

/// Which colours have planes 0–7, 8–15 and 16–23, each from its least significant bit on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// Green, red, blue: what a DLPC350 or DLPC900 shows of a video frame (DLPU010, table of pattern numbers).
    #[default]
    Grb,
    /// Red, green, blue.
    Rgb,
    /// Blue, green, red.
    Bgr,
}

impl Order {
    /// The order of this name.
    ///
    /// # Errors
    /// What is expected.
    pub fn parse(name: &str) -> Result<Self, String> {
        match name {
            "grb" => Ok(Self::Grb),
            "rgb" => Ok(Self::Rgb),
            "bgr" => Ok(Self::Bgr),
            _ => Err("expected grb, rgb or bgr, the colours of planes 0–7, 8–15 and 16–23".to_owned()),
        }
    }

    /// Places of red, green and blue in bytes of which the first has planes 0–7.
    const fn places(self) -> [usize; 3] {
        match self {
            Self::Grb => [1, 0, 2],
            Self::Rgb => [0, 1, 2],
            Self::Bgr => [2, 1, 0],
        }
    }
}

/// The sheet of at most 24 `patterns` of one size, the first in plane 0.
#[must_use]
pub fn sheet(patterns: &[BitPattern], order: Order) -> image::RgbImage {
    debug_assert!(patterns.len() <= PLANES, "{} patterns", patterns.len());
    let (width, height) = patterns.first().map_or((0, 0), BitPattern::size_px);
    let planes = Planes::of(patterns, 1);
    let mut sheet = image::RgbImage::new(width as u32, height as u32);
    let mut row = vec![0; width];
    for y in 0..height {
        planes.row(y, 0, &mut row);
        for (x, pixel) in row.iter().enumerate().filter(|(_, pixel)| **pixel != 0) {
            let bytes = pixel.to_le_bytes();
            let colour = image::Rgb(order.places().map(|place| bytes[place]));
            sheet.put_pixel(x as u32, y as u32, colour);
        }
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_pattern_is_one_bit_of_one_colour() {
        let patterns: Vec<BitPattern> = (0..PLANES as u32)
            .map(|number| {
                let mut pattern = BitPattern::black(13, 2);
                pattern.light(&[number, 25]);
                pattern
            })
            .collect();
        for (name, colours) in [("grb", [1, 0, 2]), ("rgb", [0, 1, 2]), ("bgr", [2, 1, 0])] {
            let sheet = sheet(&patterns, Order::parse(name).unwrap());
            assert_eq!(sheet.get_pixel(12, 1).0, [255; 3]);
            for number in 0..PLANES {
                let mut expected = [0; 3];
                expected[colours[number / 8]] = 1 << (number % 8);
                let found = sheet.get_pixel(number as u32 % 13, number as u32 / 13);
                assert_eq!(found.0, expected, "{name} {number}");
            }
        }
        assert!(Order::parse("gbr").is_err());
    }
}
