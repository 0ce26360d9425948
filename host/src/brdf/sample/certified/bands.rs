//! What of a certified value each channel sees.
//!
//! # Design
//! A rig knows nothing of the wavelengths of its light and its camera. So one value, or three of red, green and blue, are taken as they
//! are; of a table by wavelength no mean is made, because nobody could say with which weights. Whatever the weights, a channel sees no
//! more than the largest and no less than the smallest value of the wavelengths that reach it: the middle between them is off by their
//! distance over √12 (k = 1, rectangular).

use std::path::Path;

use super::geometry::Quantity;
use super::read::{CertificateFile, Line, content};
use super::shape::linear;
use crate::brdf::sample::SampleError;

/// Values by channel, in the unit of the quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bands {
    pub(super) value: [f64; 3],
    /// Standard uncertainty (k = 1) by the certificate, and by what the channels may see.
    pub(super) certified: [f64; 3],
    pub(super) spread: [f64; 3],
    pub(super) is_grey: bool,
}

/// Wavelengths that a rig may have at all, nanometres.
const WAVELENGTHS_NM: [f64; 2] = [200.0, 2500.0];
/// The most that a standard uncertainty may be of its value.
const LARGEST: f64 = 0.25;

impl CertificateFile {
    /// The values by channel of the file at `path`.
    pub(super) fn bands(&self, path: &Path, quantity: Quantity) -> Result<Bands, SampleError> {
        if !(self.k > 0.0 && self.k <= 10.0) {
            let expected = "the coverage factor, a number above 0 up to 10, as the certificate states it";
            return Err(content(path, "k", expected, self.k));
        }
        let bands = match (&self.value, self.spectrum.is_empty()) {
            (Some(value), true) => self.stated(path, &value.0)?,
            (None, false) => self.weighted(path)?,
            (value, _) => {
                let expected = "a value (one, or those of red, green and blue), or else a spectrum";
                let found = if value.is_some() { "both" } else { "neither" };
                return Err(content(path, "value", expected, found));
            }
        };
        let [low, high] = quantity.range();
        for (value, sigma) in bands.value.into_iter().zip(bands.certified) {
            if !(low..=high).contains(&value) {
                let expected = format!("numbers from {low} to {high} for {}", quantity.name());
                return Err(content(path, "value", &expected, value));
            }
            if !(sigma > 0.0 && sigma < LARGEST * value) {
                let expected = format!("a number above 0, over k below {LARGEST} of the value");
                return Err(content(
                    path,
                    "expanded_uncertainty",
                    &expected,
                    format!("{} of {value}", sigma * self.k),
                ));
            }
        }
        Ok(bands)
    }

    /// Of one value, or three.
    fn stated(&self, path: &Path, value: &[f64]) -> Result<Bands, SampleError> {
        let field = "expanded_uncertainty";
        let Some(expanded) = &self.expanded_uncertainty else {
            let expected = "that of the value, in its unit, as the certificate states it";
            return Err(content(path, field, expected, "nothing"));
        };
        if self.bands_nm.is_some() {
            let expected = "none without a spectrum";
            return Err(content(path, "bands_nm", expected, "wavelengths"));
        }
        let all = |numbers: &[f64]| match *numbers {
            [red, green, blue] => Some([red, green, blue]),
            [one] => Some([one; 3]),
            _ => None,
        };
        let (Some(value_of), Some(sigma)) = (all(value), all(&expanded.0)) else {
            let expected = "one number, or those of red, green and blue";
            return Err(content(path, field, expected, "others"));
        };
        if expanded.0.len() > value.len() {
            let expected = "one number for one value";
            return Err(content(path, field, expected, "three"));
        }
        Ok(Bands {
            value: value_of,
            certified: sigma.map(|sigma| sigma / self.k),
            spread: [0.0; 3],
            is_grey: value.len() == 1,
        })
    }

    /// Of a table by wavelength.
    fn weighted(&self, path: &Path) -> Result<Bands, SampleError> {
        if self.expanded_uncertainty.is_some() {
            let expected = "that of each line of the spectrum in its line";
            return Err(content(path, "expanded_uncertainty", expected, "another"));
        }
        let field = "bands_nm";
        let expected = "wavelengths [from, to] beyond which no channel sees light, or three of red, green and blue: the rig knows \
                        nothing of its bands";
        let bands = match self.bands_nm.as_deref() {
            Some([one]) => [*one; 3],
            Some([red, green, blue]) => [*red, *green, *blue],
            Some(others) => return Err(content(path, field, expected, format!("{} bands", others.len()))),
            None => return Err(content(path, field, expected, "nothing")),
        };
        self.check_spectrum(path)?;
        let of = |number: fn(&Line) -> f64| -> Vec<[f64; 2]> {
            self.spectrum
                .iter()
                .map(|line| [line.wavelength_nm, number(line)])
                .collect()
        };
        let (values, expanded) = (of(|line| line.value), of(|line| line.expanded_uncertainty));
        let [first, last] = [values[0][0], values[values.len() - 1][0]];
        let mut found = Bands {
            value: [0.0; 3],
            certified: [0.0; 3],
            spread: [0.0; 3],
            is_grey: self.bands_nm.as_ref().is_some_and(|bands| bands.len() == 1),
        };
        for (channel, [from, to]) in bands.into_iter().enumerate() {
            if !(first <= from && from < to && to <= last) {
                let expected = format!("ascending wavelengths within the spectrum, {first} to {last} nm");
                return Err(content(path, field, &expected, format!("{from} to {to} nm")));
            }
            let seen = |points: &[[f64; 2]]| -> [f64; 2] {
                let ends = [from, to].map(|at| linear(points, at));
                let within = points.iter().filter(|[nm, _]| (from..=to).contains(nm));
                let all = || ends.into_iter().chain(within.clone().map(|[_, value]| *value));
                [
                    all().fold(f64::INFINITY, f64::min),
                    all().fold(f64::NEG_INFINITY, f64::max),
                ]
            };
            let [low, high] = seen(&values);
            found.value[channel] = low.midpoint(high);
            found.spread[channel] = (high - low) / 12_f64.sqrt();
            found.certified[channel] = seen(&expanded)[1] / self.k;
        }
        Ok(found)
    }

    fn check_spectrum(&self, path: &Path) -> Result<(), SampleError> {
        let [shortest, longest] = WAVELENGTHS_NM;
        for (index, line) in self.spectrum.iter().enumerate() {
            let field = |name: &str| format!("spectrum[{index}].{name}");
            let nm = line.wavelength_nm;
            let is_later = index == 0 || nm > self.spectrum[index - 1].wavelength_nm;
            if !(is_later && (shortest..=longest).contains(&nm)) {
                let expected = format!("ascending wavelengths from {shortest} to {longest} nm");
                return Err(content(path, &field("wavelength_nm"), &expected, nm));
            }
            for (name, number) in [
                ("value", line.value),
                ("expanded_uncertainty", line.expanded_uncertainty),
            ] {
                if !(number > 0.0 && number.is_finite()) {
                    return Err(content(path, &field(name), "a number above 0", number));
                }
            }
        }
        Ok(())
    }
}
