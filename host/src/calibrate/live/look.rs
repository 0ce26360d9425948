//! What one looks at of a frame: histogram, saturation, sharpness, and the frame as a picture.

use serde::Serialize;

use crate::calibrate::brightness;
use crate::instrument::frame_format::FrameFormat;

/// Classes of a histogram, from 0 to the saturation.
pub const CLASSES: usize = 64;
/// The largest picture that is sent, pixels a side: of larger frames each pixel is the brightest of some.
const LARGEST_PX: usize = 1024;
/// The value of a saturated pixel in a picture.
pub const SATURATED: u8 = 255;

/// Figures of a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Look {
    /// How many values lie in each of [`CLASSES`] equal classes from 0 to `full_dn`.
    pub histogram: Vec<u32>,
    /// Values at the saturation.
    pub saturated: usize,
    /// Values in all.
    pub values: usize,
    /// The digital number at which the camera saturates.
    pub full_dn: u16,
    /// Median digital number.
    pub median_dn: u16,
    /// The digital number that one value in a thousand exceeds.
    pub bright_dn: u16,
    /// Focus figure: mean square of the gradient over that of the light, 10⁻³ px⁻²; it grows as the image becomes sharper, and is
    /// compared only with that of the same scene.
    pub sharpness: f64,
}

impl Look {
    /// Of the digital numbers `dn` (row, column, channel) of a frame of this `format`, whose dark pixels have `dark_dn`.
    #[must_use]
    pub fn of(dn: &[u16], format: FrameFormat, dark_dn: f64) -> Self {
        let full_dn = format.saturation_dn();
        let mut counts = vec![0_u32; usize::from(full_dn) + 1];
        for value in dn {
            counts[usize::from((*value).min(full_dn))] += 1;
        }
        let mut histogram = vec![0; CLASSES];
        for (value, count) in counts.iter().enumerate() {
            histogram[value * CLASSES / counts.len()] += count;
        }
        let at = |share: f64| {
            let rank = (dn.len() as f64 * share) as usize;
            let mut sum = 0;
            let found = counts.iter().position(|count| {
                sum += *count as usize;
                sum > rank
            });
            found.unwrap_or(0) as u16
        };
        Self {
            histogram,
            saturated: counts[usize::from(full_dn)] as usize,
            values: dn.len(),
            full_dn,
            median_dn: at(0.5),
            bright_dn: at(0.999),
            sharpness: sharpness(&brightness(dn, format.channels), format.width_px, dark_dn),
        }
    }
}

fn sharpness(light: &[f32], width: usize, dark_dn: f64) -> f64 {
    let (mut gradients, mut squares) = (0.0, 0.0);
    for (upper, lower) in light
        .chunks_exact(width)
        .zip(light[width.min(light.len())..].chunks_exact(width))
    {
        for x in 0..width.saturating_sub(1) {
            let (across, down) = (upper[x + 1] - upper[x], lower[x] - upper[x]);
            gradients += f64::from(across * across + down * down);
            squares += (f64::from(upper[x]) - dark_dn).powi(2);
        }
    }
    if squares > 0.0 {
        1e3 * gradients / squares
    } else {
        0.0
    }
}

/// A frame for eyes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Picture {
    /// Columns.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// 1 or 3.
    pub channels: usize,
    /// Frame pixels behind one of the picture, along each side.
    pub step: usize,
    /// The square root of the share of the range, 0 to 254, [row, column, channel]; [`SATURATED`] where a value is saturated.
    pub bytes: Vec<u8>,
}

impl Picture {
    /// Of the digital numbers `dn` of a frame of this `format`.
    #[must_use]
    pub fn of(dn: &[u16], format: FrameFormat) -> Self {
        let FrameFormat {
            width_px,
            height_px,
            channels,
            ..
        } = format;
        let step = width_px.max(height_px).div_ceil(LARGEST_PX).max(1);
        let (width, height) = (width_px / step, height_px / step);
        let full_dn = format.saturation_dn();
        let coded = |value: u16| match value {
            value if value >= full_dn => SATURATED,
            value => (254.0 * (f32::from(value) / f32::from(full_dn)).sqrt()) as u8,
        };
        let mut bytes = Vec::with_capacity(width * height * channels);
        for y in 0..height {
            for x in 0..width {
                for channel in 0..channels {
                    let behind = (0..step).flat_map(|row| {
                        let first = (y * step + row) * width_px + x * step;
                        (first..first + step).map(|pixel| dn[pixel * channels + channel])
                    });
                    bytes.push(coded(behind.max().unwrap_or(0)));
                }
            }
        }
        Self {
            width_px: width,
            height_px: height,
            channels,
            step,
            bytes,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FORMAT: FrameFormat = FrameFormat {
        width_px: 8,
        height_px: 4,
        channels: 1,
        bits: 12,
    };

    #[test]
    fn figures_count_every_value_and_blur_makes_the_figure_of_focus_smaller() {
        let mut sharp = vec![100_u16; 32];
        for at in (4..32).step_by(8) {
            sharp[at] = 4095;
        }
        let look = Look::of(&sharp, FORMAT, 90.0);
        assert_eq!(look.saturated, 4);
        assert_eq!(look.histogram.iter().sum::<u32>(), 32);
        assert_eq!((look.median_dn, look.bright_dn), (100, 4095));
        let blurred: Vec<u16> = (0..32)
            .map(|at| if at % 8 == 3 || at % 8 == 4 { 2000 } else { 100 })
            .collect();
        let blurred = Look::of(&blurred, FORMAT, 90.0);
        assert!(blurred.sharpness < look.sharpness, "{blurred:?} {look:?}");
        assert_eq!(blurred.saturated, 0);
    }

    #[test]
    fn pictures_keep_saturated_pixels_however_small_they_are_shown() {
        let picture = Picture::of(&[vec![0; 31], vec![4095]].concat(), FORMAT);
        assert_eq!(picture.bytes[31], SATURATED);
        assert!(picture.bytes[..31].iter().all(|value| *value == 0));
        let format = FrameFormat {
            width_px: 3000,
            height_px: 3000,
            ..FORMAT
        };
        let mut large = vec![4094; 9_000_000];
        large[1_500_100] = 4095;
        let picture = Picture::of(&large, format);
        assert_eq!((picture.step, picture.width_px), (3, 1000));
        let saturated = picture.bytes.iter().filter(|value| **value == SATURATED);
        assert_eq!(saturated.count(), 1);
    }
}
