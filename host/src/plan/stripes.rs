//! Structured light: which projector position each camera pixel sees.
//!
//! # Design
//! Per axis of the projector's image come
//! - Gray code of the stripe number, stripes of [`STRIPE_PX`] pixels, each bit also inverted, so that light and dark are
//!   told apart by comparison whatever the surface reflects (Inokuchi, Sato and Matsuda 1984);
//! - a square wave of two stripes' period, shifted pixel by pixel through a whole period. The phase of its first harmonic
//!   is the position within the period, finer than a pixel; the Gray code says in which period.
//!
//! Patterns have two levels only, so that the projector's response plays no part. The harmonics of a square wave that
//! alias into the first are those from the 15th on, which camera pixels wider than a projector pixel do not resolve.
//!
//! At a boundary between stripes the Gray code may be off by one stripe, and the position is still right: it is the one of
//! those that the phase allows that is nearest to the stripe's middle.

use std::f64::consts::TAU;

use glam::DVec2;

use crate::plan::pattern::BitPattern;

/// Width of a stripe of the Gray code, projector pixels.
pub const STRIPE_PX: usize = 8;
/// Period of the square wave, projector pixels; also the number of its shifts.
const PERIOD_PX: usize = 2 * STRIPE_PX;
/// Least difference between light and dark, as a share of the brightest difference of the image.
const LEAST_CONTRAST: f64 = 0.1;
/// Least amplitude of the first harmonic, as a share of that of a sharp square wave.
const LEAST_MODULATION: f64 = 0.4;

/// Bits of the Gray code that tell a position coarsely, and the least difference of a bit and its inverse that is clear, as a share of
/// that of light and dark.
const COARSE: usize = 4;
const CLEARLY: f32 = 0.5;

/// The sequence of patterns for a projector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stripes {
    width_px: usize,
    height_px: usize,
}

/// Across which axis stripes are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Axis {
    U,
    V,
}

/// One pattern of the sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pattern {
    White,
    Black,
    Bit { axis: Axis, bit: usize, inverted: bool },
    Shift { axis: Axis, by_px: usize },
}

impl Stripes {
    /// Patterns for a projector of this size.
    #[must_use]
    pub const fn new(width_px: usize, height_px: usize) -> Self {
        Self { width_px, height_px }
    }

    /// Number of patterns.
    #[must_use]
    pub fn len(&self) -> usize {
        self.patterns().count()
    }

    /// Never: there are always white and black.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        false
    }

    fn size_px(self, axis: Axis) -> usize {
        match axis {
            Axis::U => self.width_px,
            Axis::V => self.height_px,
        }
    }

    fn bits(self, axis: Axis) -> usize {
        let stripes = self.size_px(axis).div_ceil(STRIPE_PX);
        stripes.next_power_of_two().trailing_zeros() as usize
    }

    /// The sequence: white, black, then per axis bits with their inverses and shifts.
    fn patterns(self) -> impl Iterator<Item = Pattern> {
        let of_axis = move |axis: Axis| {
            let bits = (0..self.bits(axis))
                .flat_map(move |bit| [false, true].map(|inverted| Pattern::Bit { axis, bit, inverted }));
            bits.chain((0..PERIOD_PX).map(move |by_px| Pattern::Shift { axis, by_px }))
        };
        [Pattern::White, Pattern::Black]
            .into_iter()
            .chain(of_axis(Axis::U))
            .chain(of_axis(Axis::V))
    }

    /// Draws pattern `index` into the black image `image`.
    pub fn draw(&self, index: usize, image: &mut BitPattern) {
        let Some(pattern) = self.patterns().nth(index) else {
            return;
        };
        let is_lit = |u: usize, v: usize| {
            let along = |axis: Axis| match axis {
                Axis::U => u,
                Axis::V => v,
            };
            match pattern {
                Pattern::White => true,
                Pattern::Black => false,
                Pattern::Bit { axis, bit, inverted } => {
                    let stripe = along(axis) / STRIPE_PX;
                    ((stripe ^ (stripe >> 1)) >> bit & 1 == 1) != inverted
                }
                Pattern::Shift { axis, by_px } => (along(axis) + by_px) % PERIOD_PX < STRIPE_PX,
            }
        };
        let mut lit = Vec::with_capacity(self.width_px * self.height_px);
        for v in 0..self.height_px {
            let of_row = (0..self.width_px).filter(|u| is_lit(*u, v));
            lit.extend(of_row.map(|u| (v * self.width_px + u) as u32));
        }
        image.light(&lit);
    }

    /// Projector positions (pixels, centre of the first pixel = 0.5) that the camera pixels see, from one frame per pattern,
    /// each the brightness of all camera pixels in any unit; `None` where the pixel sees no pattern.
    #[must_use]
    pub fn decode(&self, frames: &[Vec<f32>]) -> Vec<Option<DVec2>> {
        let patterns: Vec<Pattern> = self.patterns().collect();
        let (white, black) = (&frames[0], &frames[1]);
        let brightest = white
            .iter()
            .zip(black)
            .map(|(white, black)| f64::from(white - black))
            .fold(0.0, f64::max);
        (0..white.len())
            .map(|pixel| {
                let contrast = f64::from(white[pixel] - black[pixel]);
                let of = |axis| self.position(axis, &patterns, &|at| f64::from(frames[at][pixel]), contrast);
                (contrast > LEAST_CONTRAST * brightest)
                    .then(|| Some(DVec2::new(of(Axis::U)?, of(Axis::V)?)))
                    .flatten()
            })
            .collect()
    }

    /// Projector positions that the camera pixels see, as [`decode`](Self::decode), but only as fine as the Gray code is clear, which coarse
    /// and blurred images show too: the middle of 2⁻ⁿ of an axis, n at least 4. `None` where not even that is clear, as
    /// where the light of all positions is mixed.
    #[must_use]
    pub fn decode_coarsely(&self, frames: &[Vec<f32>]) -> Vec<Option<DVec2>> {
        let patterns: Vec<Pattern> = self.patterns().collect();
        let (white, black) = (&frames[0], &frames[1]);
        let contrasts: Vec<f32> = white
            .iter()
            .zip(black)
            .map(|(white, black)| white - black)
            .collect();
        let brightest = contrasts.iter().copied().fold(0.0, f32::max);
        let position = |axis: Axis, pixel: usize| {
            let bits = self.bits(axis);
            let (mut stripe, mut known) = (0_usize, 0);
            for bit in (0..bits).rev() {
                let of = |inverted: bool| {
                    let wanted = Pattern::Bit { axis, bit, inverted };
                    let at = patterns.iter().position(|pattern| *pattern == wanted);
                    at.map_or(0.0, |at| frames[at][pixel])
                };
                let difference = of(false) - of(true);
                if difference.abs() < CLEARLY * contrasts[pixel] {
                    break;
                }
                stripe = 2 * stripe + (usize::from(difference > 0.0) ^ (stripe & 1));
                known += 1;
            }
            let width_px = (STRIPE_PX << (bits - known)) as f64;
            (known >= COARSE.min(bits)).then_some((stripe as f64 + 0.5) * width_px)
        };
        (0..contrasts.len())
            .map(|pixel| {
                let is_lit = f64::from(contrasts[pixel]) > LEAST_CONTRAST * f64::from(brightest);
                is_lit
                    .then(|| Some(DVec2::new(position(Axis::U, pixel)?, position(Axis::V, pixel)?)))
                    .flatten()
            })
            .collect()
    }

    /// The position along one axis that a pixel of brightness `seen(pattern)` sees.
    fn position(
        self,
        axis: Axis,
        patterns: &[Pattern],
        seen: &dyn Fn(usize) -> f64,
        contrast: f64,
    ) -> Option<f64> {
        let mut gray = 0_usize;
        let (mut re, mut im) = (0.0, 0.0);
        for (at, pattern) in patterns.iter().enumerate() {
            match *pattern {
                Pattern::Bit {
                    axis: of,
                    bit,
                    inverted: false,
                } if of == axis => gray |= usize::from(seen(at) > seen(at + 1)) << bit,
                Pattern::Shift { axis: of, by_px } if of == axis => {
                    let turn = TAU * by_px as f64 / PERIOD_PX as f64;
                    re += seen(at) * turn.cos();
                    im += seen(at) * turn.sin();
                }
                _ => {}
            }
        }
        // A sharp square wave has |Σ exp(2πij/P)| over its lit half: 1/sin(π/P).
        let sharp = contrast / (TAU / (2 * PERIOD_PX) as f64).sin();
        if re.hypot(im) < LEAST_MODULATION * sharp {
            return None;
        }
        // The lit half of the period is at its phase's −x … −x + P/2 − 1: x = (P/2 − 1)/2 − P·arg/2π, and half a pixel.
        let phase_px = STRIPE_PX as f64 / 2.0 - PERIOD_PX as f64 * im.atan2(re) / TAU;
        let mut stripe = gray;
        let mut shift = gray >> 1;
        while shift > 0 {
            stripe ^= shift;
            shift >>= 1;
        }
        let middle_px = (stripe as f64 + 0.5) * STRIPE_PX as f64;
        let period_px = PERIOD_PX as f64;
        let position_px = phase_px + period_px * ((middle_px - phase_px) / period_px).round();
        (0.0..=self.size_px(axis) as f64)
            .contains(&position_px)
            .then_some(position_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of pixels that see a square of the projector's image, `side_px` wide, around each of `at`.
    fn frames(stripes: &Stripes, at: &[DVec2], side_px: f64, noise: impl Fn(usize) -> f32) -> Vec<Vec<f32>> {
        let mut image = BitPattern::black(stripes.width_px, stripes.height_px);
        (0..stripes.len())
            .map(|index| {
                image.clear();
                stripes.draw(index, &mut image);
                let picture = image.to_image();
                at.iter()
                    .enumerate()
                    .map(|(pixel, at)| {
                        let mut sum = 0.0;
                        for step in 0..400 {
                            let share = |n: i32| (f64::from(n) + 0.5) / 20.0 - 0.5;
                            let p = *at + side_px * DVec2::new(share(step % 20), share(step / 20));
                            sum += f32::from(picture.get_pixel(p.x as u32, p.y as u32).0[0]) / 255.0;
                        }
                        100.0 + 500.0 * sum / 400.0 + noise(index * 7919 + pixel)
                    })
                    .collect()
            })
            .collect()
    }

    fn positions() -> Vec<DVec2> {
        (0..200)
            .map(|step| {
                let share = |stride: f64| (f64::from(step) * stride) % 1.0;
                DVec2::new(4.0 + 192.0 * share(0.618_034), 4.0 + 92.0 * share(0.414_214))
            })
            .collect()
    }

    #[test]
    fn positions_come_back_to_a_fraction_of_a_pixel() {
        let stripes = Stripes::new(200, 100);
        let at = positions();
        for side_px in [1.0, 2.5, 4.0] {
            let found = stripes.decode(&frames(&stripes, &at, side_px, |_| 0.0));
            for (found, at) in found.iter().zip(&at) {
                let missed = found.expect("all see the pattern").distance(*at);
                // What is left are the aliasing harmonics and the coarse square of this test.
                assert!(missed < 0.15, "{side_px}: {found:?} {at}");
            }
        }
    }

    #[test]
    fn blurred_images_show_coarsely_where_and_mixed_ones_nothing() {
        let stripes = Stripes::new(200, 100);
        let at: Vec<DVec2> = (0..40)
            .map(|step| DVec2::new(20.0 + 4.0 * f64::from(step), 30.0 + f64::from(step)))
            .collect();
        let blurred = frames(&stripes, &at, 11.0, |_| 0.0);
        let found: Vec<(&DVec2, DVec2)> = at
            .iter()
            .zip(stripes.decode_coarsely(&blurred))
            .filter_map(|(at, found)| Some((at, found?)))
            .collect();
        assert!(found.len() > 8, "{found:?}");
        for (at, found) in found {
            assert!((found - *at).abs().max_element() < 12.0, "{found} {at}");
        }
        let mixed: Vec<Vec<f32>> = (0..stripes.len())
            .map(|index| {
                vec![if index == 0 {
                    600.0
                } else if index == 1 {
                    100.0
                } else {
                    350.0
                }]
            })
            .collect();
        assert_eq!(stripes.decode_coarsely(&mixed), [None]);
    }

    #[test]
    fn noise_moves_positions_and_never_by_a_stripe() {
        let stripes = Stripes::new(200, 100);
        let at = positions();
        // ±20 of 500: worse than any usable frame.
        let noise = |seed: usize| ((seed * 2_654_435_761) % 41) as f32 - 20.0;
        let found = stripes.decode(&frames(&stripes, &at, 3.0, noise));
        let mut worst = 0.0_f64;
        for (found, at) in found.iter().zip(&at) {
            worst = worst.max(found.expect("all see the pattern").distance(*at));
        }
        assert!((0.01..0.5).contains(&worst), "{worst}");
    }

    #[test]
    fn who_sees_nothing_has_no_position() {
        let stripes = Stripes::new(64, 64);
        let frames = vec![vec![100.0, 100.0]; stripes.len()];
        assert_eq!(stripes.decode(&frames), [None, None]);
        // Bright and dark, but no stripes: somebody switched a lamp on.
        let mut frames = vec![vec![100.0]; stripes.len()];
        frames[0] = vec![600.0];
        assert_eq!(stripes.decode(&frames), [None]);
    }

    #[test]
    fn neighbouring_stripes_differ_in_one_bit() {
        let stripes = Stripes::new(1024, 768);
        assert_eq!(stripes.len(), 2 + 2 * (2 * 7 + 16));
        let bits: Vec<usize> = (0..stripes.len())
            .filter(|at| (2..16).contains(at) && at % 2 == 0)
            .collect();
        let mut image = BitPattern::black(1024, 768);
        let columns: Vec<Vec<bool>> = bits
            .iter()
            .map(|&at| {
                image.clear();
                stripes.draw(at, &mut image);
                let picture = image.to_image();
                (0..1024).map(|u| picture.get_pixel(u, 5).0[0] > 0).collect()
            })
            .collect();
        for u in 1..1024 {
            let changes = columns.iter().filter(|bits| bits[u] != bits[u - 1]).count();
            assert_eq!(changes, usize::from(u % STRIPE_PX == 0), "{u}");
        }
    }
}
