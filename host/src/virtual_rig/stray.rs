//! Light that reaches a camera pixel by another way than its own: glare, the ghost of the beam splitter, and direct light.
//!
//! # Design
//! Glare is light that dust, roughness and coatings of mirror and lens throw aside: a point becomes a core with long tails, a
//! Moffat function (Moffat 1969; King 1971 saw such tails in telescopes), not quite round, and a veil over the whole image
//! (ISO 9358 calls the sum of both veiling glare). It is a convolution, by FFT, of the image with its border dark.
//!
//! The second surface of a plate beam splitter shows everything once more, dimmer and displaced: of 4 % of uncoated glass or
//! 0.5 % of coated.
//!
//! Some light of the projector goes straight through the splitter and comes back to the camera from what stands behind it. It
//! grows with all light of the pattern, wherever it goes.

use rcg_fourier::{Complex32, Fourier};

use super::flaws::{Flaws, Ghost, Glare};
use crate::instrument::frame_format::FrameFormat;

/// How far the tails reach, half widths of the image; farther out there is the veil alone.
const REACH: f64 = 1.0;
/// Places along a side of a pixel at which the core of the kernel is taken, and how far from the middle that is done, pixels.
const PLACES: usize = 5;
const CORE_PX: f64 = 4.0;

/// What adds stray light to images.
pub(super) struct Stray {
    format: FrameFormat,
    glare: Option<Convolution>,
    glare_share: f64,
    veil: f64,
    ghost: Option<Shift>,
    /// Light of the projector that comes directly, over the camera's image.
    direct: Option<Vec<f64>>,
}

impl Stray {
    /// What `flaws` say of images of this `format`; `None` if there is no stray light.
    pub(super) fn of(flaws: &Flaws, format: FrameFormat) -> Option<Self> {
        let half = format.width_px as f64 / 2.0;
        let (glare, ghost, direct) = (&flaws.glare, &flaws.ghost, &flaws.direct);
        let is_there = glare.share > 0.0 || ghost.share > 0.0 || direct.share > 0.0;
        is_there.then(|| Self {
            format,
            glare: (glare.share > 0.0).then(|| Convolution::new(glare, format, half)),
            glare_share: glare.share,
            veil: glare.veil,
            ghost: (ghost.share > 0.0).then(|| Shift::new(ghost, half)),
            direct: (direct.share > 0.0).then(|| direct.camera.over(format.width_px, format.height_px)),
        })
    }

    /// How much direct light each pixel gets, relative; nothing if there is none.
    pub(super) fn direct(&self) -> Option<&[f64]> {
        self.direct.as_deref()
    }

    /// Adds glare and ghost to an image of charge, [row, column, channel].
    pub(super) fn add(&self, charge_e: &mut [f32]) {
        if self.glare.is_none() && self.ghost.is_none() {
            return;
        }
        let channels = self.format.channels;
        let plane =
            |channel: usize| -> Vec<f32> { charge_e[channel..].iter().step_by(channels).copied().collect() };
        let clean: Vec<Vec<f32>> = (0..channels).map(plane).collect();
        if let Some(glare) = &self.glare {
            let kept = (1.0 - self.glare_share) as f32;
            for charge_e in charge_e.iter_mut() {
                *charge_e *= kept;
            }
            // Two real images go through one complex transform.
            for first in (0..channels).step_by(2) {
                let second = clean.get(first + 1);
                let spread = glare.of(&clean[first], second.map(Vec::as_slice));
                for (of, channel) in (first..channels.min(first + 2)).enumerate() {
                    let sum: f64 = clean[channel].iter().map(|e| f64::from(*e)).sum();
                    let veil = self.glare_share * self.veil * sum / clean[channel].len() as f64;
                    let scale = (self.glare_share * (1.0 - self.veil)) as f32;
                    for (pixel, spread) in spread.iter().enumerate() {
                        let spread = if of == 0 { spread.re } else { spread.im };
                        charge_e[pixel * channels + channel] += scale * spread + veil as f32;
                    }
                }
            }
        }
        if let Some(ghost) = &self.ghost {
            for (channel, clean) in clean.iter().enumerate() {
                ghost.add(clean, self.format.width_px, &mut charge_e[channel..], channels);
            }
        }
    }
}

/// Convolution with a kernel of sum 1.
struct Convolution {
    width_px: usize,
    height_px: usize,
    /// Side of the square of the transform: no tail comes round.
    size: usize,
    fourier: Fourier,
    /// The kernel's transform, transposed; it is real because the kernel is the same both ways round.
    kernel: Vec<f32>,
}

impl Convolution {
    fn new(glare: &Glare, format: FrameFormat, half: f64) -> Self {
        let (width_px, height_px) = (format.width_px, format.height_px);
        let reach = (REACH * half).ceil() as usize;
        let size = fast_length(width_px.max(height_px) + reach);
        let mut convolution = Self {
            width_px,
            height_px,
            size,
            fourier: Fourier::new(size),
            kernel: Vec::new(),
        };
        let mut image = vec![Complex32::ZERO; size * size];
        let mut sum = 0.0;
        let reach = reach.cast_signed();
        for y in -reach..=reach {
            for x in -reach..=reach {
                let value = mean_over_pixel(glare, x as f64, y as f64, half);
                sum += value;
                let at = |offset: isize| offset.rem_euclid(size.cast_signed()).cast_unsigned();
                image[at(y) * size + at(x)].re = value as f32;
            }
        }
        convolution.transform(&mut image, Fourier::forward);
        // Both transforms together multiply by the number of places.
        let scale = 1.0 / (sum * (size * size) as f64);
        convolution.kernel = image
            .iter()
            .map(|value| (f64::from(value.re) * scale) as f32)
            .collect();
        convolution
    }

    /// Of one image, or of two: the first in the real part, the second in the imaginary one.
    fn of(&self, first: &[f32], second: Option<&[f32]>) -> Vec<Complex32> {
        let (width, size) = (self.width_px, self.size);
        let mut image = vec![Complex32::ZERO; size * size];
        for (pixel, value) in first.iter().enumerate() {
            let imaginary = second.map_or(0.0, |second| second[pixel]);
            image[pixel / width * size + pixel % width] = Complex32::new(*value, imaginary);
        }
        self.transform(&mut image, Fourier::forward);
        for (value, kernel) in image.iter_mut().zip(&self.kernel) {
            *value *= kernel;
        }
        // It is transposed now, and is again.
        self.transform(&mut image, Fourier::inverse);
        let rows = image.chunks_exact(size).take(self.height_px);
        rows.flat_map(|row| row[..width].iter().copied()).collect()
    }

    /// Transforms rows, then columns; the result is transposed.
    fn transform(&self, image: &mut [Complex32], one_way: fn(&Fourier, &mut [Complex32])) {
        for _ in 0..2 {
            one_way(&self.fourier, image);
            transpose(image, self.size);
        }
        transpose(image, self.size);
    }
}

/// Turns rows of a square of `size` into columns.
fn transpose(image: &mut [Complex32], size: usize) {
    for row in 0..size {
        for column in row + 1..size {
            image.swap(row * size + column, column * size + row);
        }
    }
}

/// The shortest length from `least` on that has no prime factor above 3.
fn fast_length(least: usize) -> usize {
    let is_fast = |length: &usize| {
        let mut rest = *length;
        for factor in [2, 3] {
            while rest.is_multiple_of(factor) {
                rest /= factor;
            }
        }
        rest == 1
    };
    (least..=least.next_power_of_two())
        .find(is_fast)
        .expect("invariant: a power of 2 is")
}

/// The kernel, not normalised, over the pixel (`x`, `y`) pixels from the middle.
fn mean_over_pixel(glare: &Glare, x: f64, y: f64, half: f64) -> f64 {
    let at = |x: f64, y: f64| {
        let r = x.hypot(y) / half;
        if r > REACH {
            return 0.0;
        }
        let round = 1.0 + glare.stretch * (2.0 * (y.atan2(x) - glare.azimuth_deg.to_radians())).cos();
        round * (1.0 + (r / glare.core).powi(2)).powf(-glare.slope)
    };
    if x.hypot(y) > CORE_PX {
        return at(x, y);
    }
    let place = |index: usize| (index as f64 + 0.5) / PLACES as f64 - 0.5;
    let all = (0..PLACES * PLACES).map(|index| at(x + place(index % PLACES), y + place(index / PLACES)));
    all.sum::<f64>() / (PLACES * PLACES) as f64
}

/// A displaced image, by the interpolation of Catmull and Rom (1974).
struct Shift {
    share: f32,
    /// Whole pixels, and weights of the four pixels around, along x and y.
    x: (isize, [f32; 4]),
    y: (isize, [f32; 4]),
}

impl Shift {
    fn new(ghost: &Ghost, half: f64) -> Self {
        let [x, y] = ghost.shift.map(|shift| catmull_rom(-shift * half));
        Self {
            share: ghost.share as f32,
            x,
            y,
        }
    }

    /// Adds it to every `step`-th number of `out`.
    fn add(&self, clean: &[f32], width_px: usize, out: &mut [f32], step: usize) {
        let height_px = clean.len() / width_px;
        let mut sums = vec![0.0_f32; width_px];
        for y in 0..height_px {
            sums.fill(0.0);
            for (j, wy) in (-1..).zip(self.y.1) {
                let Some(row) = y.checked_add_signed(self.y.0 + j).filter(|row| *row < height_px) else {
                    continue;
                };
                let row = &clean[row * width_px..][..width_px];
                for (i, wx) in (-1..).zip(self.x.1) {
                    let aside = self.x.0 + i;
                    // Where the pixel aside is within the image.
                    let some = sums.iter_mut().skip((-aside).max(0).cast_unsigned());
                    for (sum, shown) in some.zip(row.iter().skip(aside.max(0).cast_unsigned())) {
                        *sum += wx * wy * shown;
                    }
                }
            }
            // The interpolation overshoots beside edges; light does not.
            let row = out[y * width_px * step..].iter_mut().step_by(step);
            for (out, sum) in row.zip(&sums) {
                *out += self.share * sum.max(0.0);
            }
        }
    }
}

/// The whole part of `offset`, and the weights of the four pixels around.
fn catmull_rom(offset: f64) -> (isize, [f32; 4]) {
    let (whole, t) = (offset.floor(), offset - offset.floor());
    let weights = [
        ((2.0 - t) * t - 1.0) * t / 2.0,
        1.0 + (1.5 * t - 2.5) * t * t,
        ((4.0 - 3.0 * t) * t + 1.0) * t / 2.0,
        (t - 1.0) * t * t / 2.0,
    ];
    (whole as isize, weights.map(|weight| weight as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::virtual_rig::flaws::{Direct, Flaws};

    const FORMAT: FrameFormat = FrameFormat {
        width_px: 24,
        height_px: 24,
        channels: 3,
        bits: 16,
    };

    fn glare() -> Glare {
        Glare {
            share: 0.01,
            core: 0.1,
            slope: 1.3,
            veil: 0.2,
            stretch: 0.3,
            azimuth_deg: 20.0,
        }
    }

    #[test]
    fn a_point_becomes_the_kernel_and_no_light_is_lost_but_over_the_border() {
        let flaws = Flaws {
            glare: glare(),
            ..Flaws::default()
        };
        let stray = Stray::of(&flaws, FORMAT).unwrap();
        let mut image = vec![0.0_f32; FORMAT.len()];
        let middle = (12 * 24 + 12) * 3 + 1;
        image[middle] = 1000.0;
        stray.add(&mut image);
        let kernel = |x: f64, y: f64| mean_over_pixel(&flaws.glare, x, y, 12.0);
        let sum: f64 = (-12..=12)
            .flat_map(|y| (-12..=12).map(move |x| (f64::from(x), f64::from(y))))
            .map(|(x, y)| kernel(x, y))
            .sum();
        for (x, y) in [(1_i32, 0_i32), (3, -5), (-8, 2)] {
            let expected = 10.0 * (0.8 * kernel(f64::from(x), f64::from(y)) / sum + 0.2 / 576.0);
            let found = image[((12 + y) * 24 + 12 + x) as usize * 3 + 1];
            assert!(
                (f64::from(found) / expected - 1.0).abs() < 1e-3,
                "{x} {y}: {found} {expected}"
            );
        }
        assert!(image.iter().skip(2).step_by(3).all(|e| e.abs() < 1e-4));
        let total: f64 = image.iter().map(|e| f64::from(*e)).sum();
        assert!((995.0..1000.1).contains(&total), "{total}");
    }

    #[test]
    fn a_ghost_is_the_image_displaced() {
        let flaws = Flaws {
            ghost: Ghost {
                share: 0.04,
                shift: [0.25, -0.125],
            },
            ..Flaws::default()
        };
        let stray = Stray::of(&flaws, FORMAT).unwrap();
        let mut image = vec![0.0_f32; FORMAT.len()];
        image[(12 * 24 + 12) * 3] = 100.0;
        stray.add(&mut image);
        // A quarter of 12 pixels to the right, an eighth up: 1.5 pixels, between two rows.
        assert!((image[(12 * 24 + 12) * 3] - 100.0).abs() < 1e-4);
        let [upper, lower] = [10, 11].map(|row| image[(row * 24 + 15) * 3]);
        assert!(
            (upper - lower).abs() < 1e-4 && (upper - 4.0 * 0.5625).abs() < 1e-3,
            "{upper} {lower}"
        );
    }

    #[test]
    fn without_stray_light_there_is_nothing_to_add() {
        assert!(Stray::of(&Flaws::default(), FORMAT).is_none());
        let flaws = Flaws {
            direct: Direct {
                share: 1e-3,
                ..Direct::default()
            },
            ..Flaws::default()
        };
        let stray = Stray::of(&flaws, FORMAT).unwrap();
        assert_eq!(stray.direct().unwrap().len(), 576);
        let mut image = vec![1.0; FORMAT.len()];
        stray.add(&mut image);
        assert_eq!(image, vec![1.0; FORMAT.len()]);
    }
}
