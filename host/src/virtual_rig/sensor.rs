//! From charge to digital numbers.
//!
//! # Design
//! The charge is that of all sensor pixels behind a pixel of the image, and so is the noise that is drawn: their sum is
//! described, not each of them, so that an image costs what its pixels cost. A mean that may hold a saturated pixel is
//! given as saturated, as binning a real frame must.

use rand::{RngExt as _, SeedableRng as _};
use rand_distr::{Distribution as _, Poisson, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::knee::Knee;
use crate::instrument::rig::{Binned, Rig};

/// Whether images are noisy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Noise {
    /// Shot noise and read noise.
    On,
    /// Neither; the converter still rounds to whole numbers.
    Off,
}

/// Charge above which the normal distribution stands in for Poisson's: at 50 e⁻ its skewness is 0.14.
const NORMAL_ABOVE_E: f64 = 50.0;

/// The camera's pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sensor {
    /// The sensor's pixels behind one of the image.
    binned: Binned,
    /// Of their sum, without light.
    read_noise_e: f64,
    /// Of their sum.
    full_well_e: f64,
    gain_e_per_dn: f64,
    dark_dn: f64,
    dark_current_e_per_s: f64,
    saturation_dn: f64,
    /// Share of the charge at saturation that is not shown; see [`Flaws`](super::truth::Flaws).
    nonlinearity: f64,
    knee: Knee,
}

impl Sensor {
    pub(super) fn of(rig: &Rig) -> Self {
        let camera = &rig.camera;
        Self {
            binned: camera.binned,
            read_noise_e: if camera.binned.step_e > 0.0 {
                camera.binned.random_e()
            } else {
                camera.read_noise_e
            },
            full_well_e: camera.full_well_e,
            gain_e_per_dn: rig.gain_e_per_dn(),
            dark_dn: camera.dark_dn,
            dark_current_e_per_s: camera.dark_current_e_per_s,
            saturation_dn: f64::from(rig.saturation_dn()),
            nonlinearity: 0.0,
            knee: Knee::default(),
        }
    }

    pub(super) const fn with_response(self, nonlinearity: f64, knee: Knee) -> Self {
        Self {
            nonlinearity,
            knee,
            ..self
        }
    }

    /// Digital numbers of pixels that collected `signal_e` electrons of light in `exposure_s` seconds, and show `offset_e`
    /// electrons more; nothing where that is empty.
    pub(super) fn digitise(
        &self,
        signal_e: &[f32],
        offset_e: &[f32],
        exposure_s: f64,
        noise: Noise,
        seed: u64,
    ) -> Vec<u16> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let dark_e = self.dark_current_e_per_s * exposure_s;
        let per_e = 1.0 / self.gain_e_per_dn;
        let deviations = self.deviations(noise);
        signal_e
            .iter()
            .enumerate()
            .map(|(at, &signal_e)| {
                let mean_e = f64::from(signal_e) + dark_e;
                let charge_e = match noise {
                    Noise::Off => mean_e,
                    Noise::On => self.noisy(mean_e, &mut rng),
                };
                if self.may_saturate(mean_e, deviations) {
                    return self.saturation_dn as u16;
                }
                let offset_e = offset_e.get(at).map_or(0.0, |offset_e| f64::from(*offset_e));
                let signal_dn = (charge_e + offset_e + self.rounding_e(mean_e)) * per_e;
                let fill = (signal_dn / (self.saturation_dn - self.dark_dn)).clamp(0.0, 1.0);
                let shown = (1.0 - self.nonlinearity * fill) * self.knee.shown(fill);
                let dn = self.dark_dn + signal_dn * shown;
                let dither = match noise {
                    Noise::On => rng.random_range(-0.5..0.5),
                    Noise::Off => 0.0,
                };
                (dn + dither).round().clamp(0.0, self.saturation_dn) as u16
            })
            .collect()
    }

    /// Of the pixels behind a pixel, by how many standard deviations the brightest is above their mean: of N normal numbers
    /// about √(2 ln N).
    fn deviations(&self, noise: Noise) -> f64 {
        match noise {
            Noise::On => (2.0 * self.binned.pixels.ln()).max(0.0).sqrt(),
            Noise::Off => 0.0,
        }
    }

    /// Whether one of the pixels behind a pixel that holds `mean_e` electrons is likely to saturate, the brightest being
    /// `deviations` above their mean.
    fn may_saturate(&self, mean_e: f64, deviations: f64) -> bool {
        let pixels = self.binned.pixels;
        let (one_e, well_e) = (mean_e / pixels, self.full_well_e / pixels);
        pixels > 1.0 && one_e + deviations * one_e.max(0.0).sqrt() >= well_e
    }

    /// What the converter's steps leave in the sum of pixels that hold `mean_e` electrons.
    fn rounding_e(&self, mean_e: f64) -> f64 {
        let one_e = mean_e / self.binned.pixels;
        let noise_e = (self.binned.read_noise_e.powi(2) + one_e.max(0.0)).sqrt();
        self.binned.pixels * self.binned.rounding_e(one_e, noise_e)
    }

    fn noisy(&self, mean_e: f64, rng: &mut Xoshiro256PlusPlus) -> f64 {
        let normal: f64 = rng.sample(StandardNormal);
        if mean_e > NORMAL_ABOVE_E {
            return mean_e + normal * (mean_e + self.read_noise_e * self.read_noise_e).sqrt();
        }
        let shot_e = Poisson::new(mean_e).map_or(0.0, |poisson| poisson.sample(rng));
        shot_e + normal * self.read_noise_e
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instrument::rig::ROUNDING_DN2;

    const SENSOR: Sensor = Sensor {
        binned: Binned {
            pixels: 1.0,
            step_e: 0.0,
            read_noise_e: 0.0,
        },
        read_noise_e: 3.0,
        full_well_e: 20_155.0,
        gain_e_per_dn: 5.0,
        dark_dn: 64.0,
        dark_current_e_per_s: 0.0,
        saturation_dn: 4095.0,
        nonlinearity: 0.0,
        knee: Knee {
            start: 0.0,
            loss: 0.0,
        },
    };

    #[test]
    fn mean_and_variance_follow_the_photon_transfer_curve() {
        for signal_e in [0.0_f32, 5.0, 40.0, 60.0, 1000.0, 15_000.0] {
            let dn = SENSOR.digitise(&vec![signal_e; 200_000], &[], 0.01, Noise::On, 1);
            let mean = dn.iter().map(|&v| f64::from(v)).sum::<f64>() / dn.len() as f64;
            let var = dn.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum::<f64>() / dn.len() as f64;
            let expected = 64.0 + f64::from(signal_e) / 5.0;
            // var(g) = σ_read² + (g − dark)/gain, and 1/6 of rounding with dither.
            let var_expected = (9.0 + f64::from(signal_e)) / 25.0 + ROUNDING_DN2;
            assert!(
                (mean - expected).abs() < 5.0 * (var_expected / 2e5).sqrt() + 1e-3,
                "{signal_e} e: {mean}"
            );
            assert!(
                (var / var_expected - 1.0).abs() < 0.02,
                "{signal_e} e: {var} {var_expected}"
            );
        }
    }

    #[test]
    fn saturation_clips_and_the_same_seed_repeats() {
        assert_eq!(SENSOR.digitise(&[1e9], &[], 0.01, Noise::On, 1), [4095]);
        let signal = [100.0; 50];
        let first = SENSOR.digitise(&signal, &[], 0.01, Noise::On, 7);
        assert_eq!(first, SENSOR.digitise(&signal, &[], 0.01, Noise::On, 7));
        assert_ne!(first, SENSOR.digitise(&signal, &[], 0.01, Noise::On, 8));
        assert_eq!(SENSOR.digitise(&[100.0], &[], 0.01, Noise::Off, 7), [84]);
    }
}
