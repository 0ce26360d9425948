//! From the bytes of a camera's frame to the image that is stored.
//!
//! # Design
//! A sensor has its own pixels; the image that is stored has fewer. A pixel of the image is the mean of the sensor's pixels of
//! its colour behind it, weighted by the area that they share, of the central square of the region that is read; it is kept as a
//! number of 16 bits, rounded with dither, as [`Rig::with_image_size`](crate::instrument::rig::Rig::with_image_size) describes
//! its noise. The dither is a function of the frame's number and the pixel: the same frame gives the same image.

use crate::instrument::frame_format::FrameFormat;
use crate::instrument::pixel_format::PixelFormat;

/// Bits of a number of a stored image that is a mean.
const STORED_BITS: u8 = 16;

/// What stands in the way of an image.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NativeError {
    /// The mosaic is too coarse for so many pixels.
    #[error(
        "expected an image of at most {most} pixels a side from a mosaic of colours on {square} sensor pixels, found {asked}"
    )]
    Mosaic {
        /// The most there can be.
        most: usize,
        /// The sensor's pixels.
        square: usize,
        /// What was asked for.
        asked: usize,
    },
    /// The sensor has fewer pixels.
    #[error(
        "expected an image of at most {most} pixels a side, as many as are read of the sensor, found {asked}"
    )]
    Pixels {
        /// What there is.
        most: usize,
        /// What was asked for.
        asked: usize,
    },
    /// Other colours than the rig has.
    #[error("expected {expected} channels of the pixel format, as the rig's camera has, found {found}")]
    Channels {
        /// The rig's.
        expected: usize,
        /// The format's.
        found: usize,
    },
}

/// Makes images of frames.
#[derive(Clone, Debug)]
pub struct Binner {
    format: PixelFormat,
    /// Columns and rows of a frame.
    region_px: (usize, usize),
    image: FrameFormat,
    /// First pixel of the central square, column and row.
    square_at: (usize, usize),
    /// For each pixel of a side of the image: the first sensor pixel of the square behind it, and the shares of it and the
    /// following ones that are.
    shares: Vec<(usize, Vec<f64>)>,
}

impl Binner {
    /// Images of `size_px` pixels a side and `channels` colours from frames of `format` and `region_px` (width, height).
    ///
    /// # Errors
    /// [`NativeError`].
    pub fn new(
        format: PixelFormat,
        region_px: (usize, usize),
        size_px: usize,
        channels: usize,
    ) -> Result<Self, NativeError> {
        let square = region_px.0.min(region_px.1);
        if size_px > square {
            return Err(NativeError::Pixels {
                most: square,
                asked: size_px,
            });
        }
        if format.mosaic().is_some() && size_px * 2 > square {
            return Err(NativeError::Mosaic {
                most: square / 2,
                square,
                asked: size_px,
            });
        }
        if format.channels() != channels {
            return Err(NativeError::Channels {
                expected: channels,
                found: format.channels(),
            });
        }
        let scale = square as f64 / size_px as f64;
        let shares = (0..size_px).map(|at| {
            let (from, to) = (at as f64 * scale, (at + 1) as f64 * scale);
            let (first, end) = (from as usize, (to.ceil() as usize).min(square));
            let shared = |pixel: usize| (to.min(pixel as f64 + 1.0) - from.max(pixel as f64)).max(0.0);
            (first, (first..end).map(shared).collect())
        });
        let is_native = size_px == square && format.bits() == STORED_BITS;
        Ok(Self {
            format,
            region_px,
            square_at: ((region_px.0 - square) / 2, (region_px.1 - square) / 2),
            shares: shares.collect(),
            image: FrameFormat {
                width_px: size_px,
                height_px: size_px,
                channels,
                bits: if is_native { format.bits() } else { STORED_BITS },
            },
        })
    }

    /// The shape of the images.
    #[must_use]
    pub const fn image(&self) -> FrameFormat {
        self.image
    }

    /// Bytes of a frame.
    #[must_use]
    pub const fn frame_bytes(&self) -> usize {
        self.format.bytes(self.region_px.0 * self.region_px.1)
    }

    /// The image of the frame of this `number` that has these `bytes`, [row, column, channel]; `None` if they are too few.
    #[must_use]
    pub fn image_of(&self, bytes: &[u8], number: u64) -> Option<Vec<u16>> {
        let (width, height) = self.region_px;
        let values = self.format.values_of(bytes, width * height)?;
        let side = self.image.width_px;
        if side == width && side == height && self.format.bits() == STORED_BITS {
            return Some(values);
        }
        let channels = self.image.channels;
        let to_stored = f64::from(u16::MAX) / f64::from(u16::MAX >> (16 - self.format.bits()));
        if side == width && side == height {
            // One pixel behind each: nothing to weigh. Mosaics have two at least.
            let stored = |(index, &value): (usize, &u16)| {
                rounded(to_stored * f64::from(value) + dither(number, index as u64))
            };
            return Some(values.iter().enumerate().map(stored).collect());
        }
        let mut dn = Vec::with_capacity(self.image.len());
        for (first_row, rows) in &self.shares {
            for (first_column, columns) in &self.shares {
                let mut sums = [0.0; 3];
                let mut weights = [0.0; 3];
                for (row, by_row) in rows.iter().enumerate() {
                    let y = self.square_at.1 + first_row + row;
                    for (column, by_column) in columns.iter().enumerate() {
                        let x = self.square_at.0 + first_column + column;
                        let (at, weight) = (y * width + x, by_row * by_column);
                        if let Some(mosaic) = self.format.mosaic() {
                            let channel = mosaic[y % 2 * 2 + x % 2];
                            sums[channel] += weight * f64::from(values[at]);
                            weights[channel] += weight;
                        } else {
                            for channel in 0..channels {
                                sums[channel] += weight * f64::from(values[at * channels + channel]);
                                weights[channel] += weight;
                            }
                        }
                    }
                }
                for channel in 0..channels {
                    let stored = to_stored * sums[channel] / weights[channel];
                    dn.push(rounded(stored + dither(number, dn.len() as u64)));
                }
            }
        }
        Some(dn)
    }
}

/// The whole number of 16 bits nearest to `value`, halves away from 0: what `f64::round` gives, without its call.
fn rounded(value: f64) -> u16 {
    let below = value as u32;
    let up = u32::from(value - f64::from(below) >= 0.5);
    (below + up).min(u32::from(u16::MAX)) as u16
}

/// A number from −0.5 to 0.5 that is a function of the frame's number and the value's index: `SplitMix64` (Steele, Lea, Flood 2014).
fn dither(number: u64, index: u64) -> f64 {
    let mut z = number
        .wrapping_mul(0xd134_2543_de82_ef95)
        .wrapping_add(index)
        .wrapping_add(1)
        .wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_is_the_mean_by_area_of_the_central_square() {
        // 9 × 7 pixels, f = 3 + 2x + 5y: the mean over a square is f at its centre.
        let (width, height) = (9, 7);
        let plane = |x: f64, y: f64| 300.0 + 20.0 * x + 50.0 * y;
        let bytes: Vec<u8> = (0..width * height)
            .flat_map(|at| (plane((at % width) as f64, (at / width) as f64) as u16).to_le_bytes())
            .collect();
        for size in [1, 2, 3, 5, 7] {
            let binner = Binner::new(PixelFormat::of("Mono12").unwrap(), (width, height), size, 1).unwrap();
            let image = binner.image_of(&bytes, 3).unwrap();
            // Means of the pixel's number over each part of 420 equal ones along a side.
            let means: Vec<f64> = (0..size)
                .map(|part| {
                    let parts = part * 420 / size..(part + 1) * 420 / size;
                    let count = parts.len() as f64;
                    parts.map(|at| (at / 60) as f64).sum::<f64>() / count
                })
                .collect();
            for (at, &dn) in image.iter().enumerate() {
                let f = plane(1.0 + means[at % size], means[at / size]) * 65_535.0 / 4095.0;
                assert!((f64::from(dn) - f).abs() <= 1.0 + 1e-9, "{size} {at}: {dn} {f}");
            }
        }
    }

    #[test]
    fn under_a_mosaic_each_colour_has_its_own_pixels() {
        for (name, colours) in [
            ("BayerRG8", [10, 20, 20, 30]),
            ("BayerGR8", [20, 10, 30, 20]),
            ("BayerGB8", [20, 30, 10, 20]),
            ("BayerBG8", [30, 20, 20, 10]),
        ] {
            let bytes: Vec<u8> = (0..12 * 12).map(|at| colours[at / 12 % 2 * 2 + at % 2]).collect();
            for size in [1, 5, 6] {
                let binner = Binner::new(PixelFormat::of(name).unwrap(), (12, 12), size, 3).unwrap();
                let image = binner.image_of(&bytes, 0).unwrap();
                for (at, &dn) in image.iter().enumerate() {
                    let expected = 257.0 * [10.0, 20.0, 30.0][at % 3];
                    assert!(
                        (f64::from(dn) - expected).abs() <= 1.0,
                        "{name} {size} {at}: {dn}"
                    );
                }
            }
            let error = Binner::new(PixelFormat::of(name).unwrap(), (12, 12), 7, 3).unwrap_err();
            assert!(error.to_string().contains("at most 6 pixels"), "{error}");
        }
    }

    #[test]
    fn one_pixel_behind_each_is_the_mean_of_one_and_rounding_is_that_of_the_language() {
        for at in 0..200_000 {
            let value = f64::from(at) * 0.5 - 3.0;
            for value in [value, value.next_up(), value.next_down()] {
                let expected = value.round().clamp(0.0, f64::from(u16::MAX)) as u16;
                assert_eq!(rounded(value), expected, "{value}");
            }
        }
        // A frame that is one column wider has the same central square, by the rule for all sizes.
        for (name, pixels) in [("Mono8", 1), ("Mono12", 1), ("RGB8", 3)] {
            let format = PixelFormat::of(name).unwrap();
            let width = format.bytes(1);
            let row = |y: usize, wide: usize| {
                (0..wide * width).map(move |x| ((x * 7 + y * 131) % 251) as u8 & 0x0f)
            };
            let [square, wide]: [Vec<u8>; 2] =
                [12, 13].map(|wide| (0..12).flat_map(|y| row(y, wide)).collect());
            let [quick, general] = [(12, &square), (13, &wide)].map(|(wide, bytes)| {
                let binner = Binner::new(format, (wide, 12), 12, pixels).unwrap();
                binner.image_of(bytes, 77).unwrap()
            });
            assert_eq!(quick, general, "{name}");
        }
    }

    #[test]
    fn dither_lets_a_mean_between_two_numbers_be_seen_and_native_numbers_stay() {
        // Half of a stored step: 12 bits of 1 and 2 pixels.
        let bytes = [100_u16, 101].map(u16::to_le_bytes).concat();
        let bytes = [bytes.clone(), bytes].concat();
        let binner = Binner::new(PixelFormat::of("Mono16").unwrap(), (2, 2), 1, 1).unwrap();
        let frames = 4000;
        let sum: u64 = (0..frames)
            .map(|n| u64::from(binner.image_of(&bytes, n).unwrap()[0]))
            .sum();
        assert!((sum as f64 / frames as f64 - 100.5).abs() < 0.05, "{sum}");

        let native = Binner::new(PixelFormat::of("Mono16").unwrap(), (2, 2), 2, 1).unwrap();
        assert_eq!(native.image_of(&bytes, 9).unwrap(), [100, 101, 100, 101]);
        assert_eq!(native.image_of(&bytes[1..], 9), None);
    }
}
