//! From the sensor's own pixels to those of an image.
//!
//! # Design
//! A pixel of the image is the mean of the N sensor pixels behind it, kept as a number of 16 bits, rounded with dither, so
//! that what the mean gains is not rounded away. It is described like a single pixel that collects all their charge: N times the full well,
//! the dark current and the variances. Everything that reckons with noise then needs no second rule, and what is known
//! of one size of image is known of another by N alone.
//!
//! The converter's step rounds every sensor pixel before the mean. As far as noise dithers it, rounding is noise of a
//! variance of step²/12 (as in Widrow and Kollár, *Quantization Noise*, 2008, ch. 4); what is left is common to all pixels
//! of a mean, and does not become less with N. With Gaussian noise of standard deviation s (in steps) before the
//! converter, the mean error at a level x (in steps) is Σₖ (−1)ᵏ sin(2πkx)/(πk) · exp(−2π²k²s²), k = 1, 2, …: 2 % of a step
//! at s = 0.4, nothing above 0.6.
//!
//! # Tradeoffs
//! Where an image of another shape than the sensor is asked for, the central square of the sensor is taken. Pixels at the
//! border of two image pixels belong to both by area; that their noise is in both is left out.

use std::f64::consts::{PI, TAU};

use super::{Binned, CameraPart, Lens};

/// Bits of a number of a binned image.
const BITS: u8 = 16;
/// Variance by rounding an image's numbers, in DN²: 1/12 of rounding and as much of the uniform noise that is added before,
/// without which the low noise of a mean would leave the same rounding in all frames.
pub(crate) const ROUNDING_DN2: f64 = 1.0 / 6.0;
/// Terms of the series for rounding; without any noise those left out hold 5 % of its variance.
const TERMS: f64 = 12.0;
/// Noise, in steps, times the number of the term from which on terms are below 10⁻¹⁷: exp(−½(2π·1.41)²).
const FADED: f64 = 1.41;

/// `camera` with its image binned to `size_px` × `size_px` pixels, of which its sensor has as many at least.
pub(super) fn camera(camera: &CameraPart, size_px: u32) -> CameraPart {
    let mut binned = camera.clone();
    binned.lens = lens(&camera.lens, size_px);
    let square_px = camera.lens.width_px.min(camera.lens.height_px);
    let pixels = (f64::from(square_px) / f64::from(size_px)).powi(2);
    let range = |bits: u8| f64::from((1_u32 << bits) - 1);
    binned.binned = if camera.binned.step_e > 0.0 {
        Binned {
            pixels: camera.binned.pixels * pixels,
            ..camera.binned
        }
    } else {
        Binned {
            pixels,
            step_e: camera.full_well_e / (range(camera.bits) - camera.dark_dn),
            read_noise_e: camera.read_noise_e,
        }
    };
    binned.bits = BITS;
    binned.dark_dn *= range(BITS) / range(camera.bits);
    binned.full_well_e *= pixels;
    binned.dark_current_e_per_s *= pixels;
    binned.read_noise_e = binned.binned.noise_e();
    binned
}

/// The central square of `lens`'s image in `size_px` × `size_px` pixels: every direction stays at its relative place.
pub(super) fn lens(lens: &Lens, size_px: u32) -> Lens {
    let (width_px, height_px) = (f64::from(lens.width_px), f64::from(lens.height_px));
    let square_px = width_px.min(height_px);
    let scale = f64::from(size_px) / square_px;
    Lens {
        width_px: size_px,
        height_px: size_px,
        focal_px: lens.focal_px * scale,
        centre_px: [
            (lens.centre_px[0] - (width_px - square_px) / 2.0) * scale,
            (lens.centre_px[1] - (height_px - square_px) / 2.0) * scale,
        ],
        ..lens.clone()
    }
}

impl Binned {
    /// Standard deviation without light of the sum of the pixels, in electrons: read noise, rounding that noise dithers,
    /// and what rounding leaves in common.
    fn noise_e(&self) -> f64 {
        self.random_e().hypot(self.common_e(0.0))
    }

    /// The part of it that differs from pixel to pixel and from frame to frame.
    pub(crate) fn random_e(&self) -> f64 {
        let rounding_e2 = self.step_e * self.step_e / 12.0 - self.undithered_e2(0.0);
        (self.pixels * (self.read_noise_e * self.read_noise_e + rounding_e2.max(0.0))).sqrt()
    }

    /// What rounding leaves that all pixels have in common which hold `light_e` electrons of light all alike, and all frames: repeated
    /// exposures do not show it. Photons dither, too.
    pub(crate) fn common_e(&self, light_e: f64) -> f64 {
        self.pixels * self.undithered_e2(light_e / self.pixels).sqrt()
    }

    /// Variance over all levels of the mean error by rounding of one pixel in `light_e` electrons of light, in electrons².
    fn undithered_e2(&self, light_e: f64) -> f64 {
        if self.step_e <= 0.0 {
            return 0.0;
        }
        let noise = (self.read_noise_e.powi(2) + light_e.max(0.0)).sqrt() / self.step_e;
        let term = |k: f64| (-(TAU * k * noise).powi(2)).exp() / (TAU * k * PI * k);
        self.step_e * self.step_e * (1..=TERMS as u32).map(|k| term(f64::from(k))).sum::<f64>()
    }

    /// The mean error by rounding, in electrons of one pixel, where one pixel holds `charge_e` electrons with noise of a
    /// standard deviation of `noise_e`.
    pub(crate) fn rounding_e(&self, charge_e: f64, noise_e: f64) -> f64 {
        // Above a noise of one step nothing is left.
        if noise_e >= self.step_e {
            return 0.0;
        }
        let (at, noise) = (charge_e / self.step_e, noise_e / self.step_e);
        if noise < 0.01 {
            return (at.round() - at) * self.step_e;
        }
        // Σₖ (−1)ᵏ sin(kα)/(πk)·q^(k²): both by recurrence, up to where no term changes a digit of the sum.
        let (sin, cos) = (TAU * at).sin_cos();
        let q = (-0.5 * (TAU * noise).powi(2)).exp();
        let (mut before, mut sine) = (0.0, sin);
        let (mut faded, mut ratio) = (q, q * q * q);
        let mut sum = 0.0;
        let last = (FADED / noise).min(TERMS) as u32;
        for k in 1..=last.max(1) {
            let sign = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            sum += sign * sine / (PI * f64::from(k)) * faded;
            (before, sine) = (sine, 2.0 * cos * sine - before);
            faded *= ratio;
            ratio *= q * q;
        }
        self.step_e * sum
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_distr::StandardNormal;
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;
    use crate::instrument::rig::Rig;

    #[test]
    fn a_mean_of_rounded_pixels_errs_as_is_said() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
        for (step_e, noise_e) in [(40.0, 3.0), (10.0, 3.0), (10.0, 4.0), (10.0, 8.0), (40.0, 0.1)] {
            let one = Binned {
                pixels: 1.0,
                step_e,
                read_noise_e: noise_e,
            };
            let (mut squares, count) = (0.0, 400);
            for level in 0..count {
                let charge_e = step_e * f64::from(level) / f64::from(count);
                let said = one.rounding_e(charge_e, noise_e);
                squares += said * said / f64::from(count);
                if level % 40 == 7 {
                    let draws = 40_000;
                    let sum: f64 = (0..draws)
                        .map(|_| {
                            let noisy = charge_e + noise_e * rng.sample::<f64, _>(StandardNormal);
                            (noisy / step_e).round() * step_e - charge_e
                        })
                        .sum();
                    let found = sum / f64::from(draws);
                    let allowed = 5.0 * noise_e.hypot(step_e / 3.5) / f64::from(draws).sqrt() + 0.02 * step_e;
                    assert!(
                        (found - said).abs() < allowed,
                        "{step_e} {noise_e}: {found}, {said}"
                    );
                }
            }
            // What reading dithers, photons dither as well.
            let lit = Binned {
                read_noise_e: 0.6 * noise_e,
                ..one
            };
            for expected in [one.undithered_e2(0.0), lit.undithered_e2((0.8 * noise_e).powi(2))] {
                assert!(
                    (squares - expected).abs() < 0.06 * expected + 1e-6,
                    "{squares} {expected}"
                );
            }
        }
    }

    #[test]
    fn a_binned_pixel_is_that_of_a_larger_sensor() {
        let rig = Rig::load("dmd").unwrap();
        let (half, quarter) = (
            rig.with_image_size(256).unwrap(),
            rig.with_image_size(128).unwrap(),
        );
        let again = half.with_image_size(128).unwrap();
        assert!((again.camera.read_noise_e / quarter.camera.read_noise_e - 1.0).abs() < 1e-12);
        assert!((again.camera.full_well_e / rig.camera.full_well_e - 16.0).abs() < 1e-9);
        assert!((again.camera.dark_dn - quarter.camera.dark_dn).abs() < 1e-9);
        assert!((quarter.camera.binned.pixels - 16.0).abs() < 1e-12);
        // 3 e of read-out and a step of 20,000 e in 4031: √16 times their sum.
        let expected_e = 4.0 * 3_f64.hypot(20_000.0 / 4031.0 / 12_f64.sqrt());
        assert!((quarter.camera.read_noise_e / expected_e - 1.0).abs() < 1e-3);
        // The light that fills a sensor pixel fills the mean.
        let fill = |rig: &Rig| rig.sensitivity_e() / rig.camera.full_well_e;
        assert!((fill(&quarter) / fill(&rig) - 1.0).abs() < 1e-12);
    }
}
