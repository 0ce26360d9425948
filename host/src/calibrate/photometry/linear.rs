//! Numbers as a linear camera would give them.

use super::camera::{Times, moments};
use crate::instrument::calibration::CameraFound;
use crate::instrument::calibration::lamp::SLOW;
use crate::instrument::calibration::stray::offset_dn;
use crate::instrument::rig::{Binned, Rig};

/// Digital numbers → what they would be if the camera were linear, above the dark level.
pub(super) struct Linear {
    pub(super) camera: CameraFound,
    /// The same of a pixel of the sensor.
    pub(super) sensor: CameraFound,
    /// What dim pixels that are alike all fall short by at most, in every frame: what noise leaves of the converter's steps, DN (k = 1).
    pub(super) steps_dn: f64,
    binned: Binned,
    /// What the camera's offset is another by in frames that were taken at another time, DN (k = 1).
    offset_dn: f64,
    /// Of numbers above the dark level.
    pub(super) range: f64,
}

impl Linear {
    /// The camera that was `found` with the image of `rig`.
    pub(super) fn new(found: &CameraFound, rig: &Rig) -> Self {
        let binned = &rig.camera.binned;
        let sensor = found.of_sensor(binned);
        let camera = sensor.of_image(binned);
        Self {
            camera,
            steps_dn: binned.common_e(0.0) / camera.gain_e_per_dn,
            binned: *binned,
            offset_dn: offset_dn(rig),
            sensor,
            range: f64::from(rig.saturation_dn()) - found.dark_dn,
        }
    }

    /// The camera with the image of `rig`.
    pub(super) fn camera_of(&self, rig: &Rig) -> CameraFound {
        self.sensor.of_image(&rig.camera.binned)
    }

    /// The same where all pixels show this light above the dark level.
    pub(super) fn steps_in_dn(&self, light_dn: f64) -> f64 {
        let gain_e_per_dn = self.camera.gain_e_per_dn;
        self.binned.common_e(light_dn * gain_e_per_dn) / gain_e_per_dn
    }

    /// Whether a number says how much light there was, or counts as saturated.
    pub(super) fn trusts(&self, dn: f64) -> bool {
        dn < self.camera.dark_dn + self.camera.linear_to * self.range
    }

    pub(super) fn of(&self, dn: f64) -> f64 {
        let signal = dn - self.camera.dark_dn;
        signal * (1.0 + self.camera.nonlinearity * signal / self.range)
    }

    /// Mean over frames of each value.
    pub(super) fn mean(&self, frames: &[&[u16]]) -> Vec<f64> {
        moments(frames).0.into_iter().map(|dn| self.of(dn)).collect()
    }

    /// Light of the lamp at each time of the `series`, relative to their mean, by `pixels` that are dark otherwise; what they
    /// cannot tell is 1 within its `flicker`. Of each of so many `bands` that are lit one after the other, [time][band].
    pub(super) fn lamp(
        &self,
        series: &[Times],
        pixels: &[u32],
        (channels, bands): (usize, usize),
        flicker: f64,
    ) -> Vec<Vec<f64>> {
        let of_bands: Vec<Vec<f64>> = (0..bands)
            .map(|band| {
                let of_band = |pixel: &u32| {
                    let first = *pixel as usize * channels;
                    (band..channels)
                        .step_by(bands)
                        .map(move |channel| first + channel)
                };
                self.lamp_of(
                    series,
                    &pixels.iter().flat_map(of_band).collect::<Vec<_>>(),
                    flicker,
                )
            })
            .collect();
        (0..series.len())
            .map(|time| of_bands.iter().map(|band| band[time]).collect())
            .collect()
    }

    /// The same by these `values` of frames.
    fn lamp_of(&self, series: &[Times], values: &[usize], flicker: f64) -> Vec<f64> {
        let each = |frames: &[&[u16]]| -> f64 {
            let sum: f64 = values
                .iter()
                .flat_map(|at| frames.iter().map(move |frame| f64::from(frame[*at])))
                .map(|dn| self.of(dn))
                .sum();
            sum / frames.len() as f64
        };
        let count = values.len() as f64;
        let rates: Vec<(f64, f64)> = series
            .iter()
            .map(|times| {
                let light = each(&times.lit) - each(&times.dark);
                let noise =
                    self.camera.read_variance_dn2() * count + light.max(0.0) / self.camera.gain_e_per_dn;
                // Darkness is another segment, long after.
                let common_dn = self.steps_dn.hypot(self.offset_dn) * count;
                let variance = noise / times.lit.len() as f64 + common_dn.powi(2);
                let relative = variance / light.powi(2).max(f64::MIN_POSITIVE);
                (light / times.exposure_s, relative)
            })
            .collect();
        let weights: f64 = rates.iter().map(|(_, variance)| variance.recip()).sum();
        let mean = rates.iter().map(|(rate, variance)| rate / variance).sum::<f64>() / weights;
        let prior = flicker * flicker / series[0].lit.len() as f64 + SLOW * SLOW;
        rates
            .into_iter()
            .map(|(rate, variance)| {
                let told = 1.0 + prior / (prior + variance) * (rate / mean - 1.0);
                if told.is_finite() { told } else { 1.0 }
            })
            .collect()
    }

    /// Light of each level above the black frame, relative to the last.
    pub(super) fn levels(&self, frames: &[&[u16]], black: &[f64]) -> Vec<f64> {
        let light = |frame: &&[u16]| {
            let lit = frame.iter().map(|dn| self.of(f64::from(*dn)));
            lit.zip(black).map(|(lit, black)| lit - black).sum::<f64>()
        };
        let all: Vec<f64> = frames.iter().map(light).collect();
        let brightest = all.last().copied().unwrap_or(1.0);
        all.into_iter().map(|light| light / brightest).collect()
    }
}
