//! How steady the projector's light is, and what tells it.
//!
//! # Design
//! Pixels of the projector that light no sample are lit in every pattern ([`crate::instrument::monitor`]); what of their light
//! comes directly shines in pixels of the camera that are dark otherwise. Calibration knows how bright that was with the
//! light that the standard had. How a frame is compared with it stands in `stray`.

use serde::{Deserialize, Serialize};

use super::field::{DEGREE, TERMS, products};
use crate::instrument::frame_format::place_of_pixel;
use crate::instrument::monitor::BLOCK_PX;

/// Share of the camera's range that what watches the lamp comes to in the longest exposure.
const SHARE: f64 = 0.05;
/// With less than this share nothing is watched.
const LEAST_SHARE: f64 = 5e-4;
/// How far slow changes may take the lamp from what it was in the black frames of a measurement, relative (k = 1); what it
/// is by itself calibration cannot tell without anything that watches it.
pub(crate) const SLOW: f64 = 3e-3;
/// What one size of lit squares and another differ by beside the square of their sides, relative (k = 1).
const SQUARES: f64 = 5e-4;

/// Terms of what watches the lamp. At each tilt other pixels are dark, and all of them have to tell the same lamp.
pub(crate) const WATCH_TERMS: usize = 1 + TERMS;

/// The terms at the centre of this pixel (row-major) of a camera's image of this size.
pub(crate) fn watch_terms(pixel: usize, width_px: usize, height_px: usize) -> [f64; WATCH_TERMS] {
    let [x, y] = place_of_pixel(pixel, width_px, height_px);
    products::<{ DEGREE + 1 }, WATCH_TERMS>(x, y)
}

/// The lamp as calibration found it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LampFound {
    /// Standard deviation of the light from exposure to exposure, relative.
    pub flicker: f64,
    /// What watches it; none if too little light comes directly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub monitor: Option<Monitor>,
}

/// What watches the lamp.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Monitor {
    /// Side of the lit squares, pixels.
    pub side: u32,
    /// Their direct light in digital numbers per second over the camera's image, [channel, term]: a constant and the terms of fields.
    pub light: Vec<Vec<f64>>,
    /// Relative standard uncertainty (k = 1) of that in the pixels that are dark otherwise.
    pub standard_uncertainty: f64,
}

impl LampFound {
    /// Relative standard uncertainty (k = 1) of light that nothing compares with that of the calibration.
    pub const UNWATCHED: f64 = 0.02;
    /// The same of light between two views of one calibration, which are minutes apart where lamps change by per cents in an hour.
    pub(crate) const BETWEEN_VIEWS: f64 = 5e-3;

    /// Relative standard uncertainty (k = 1) of the light of a measurement over that of the calibration.
    #[must_use]
    pub fn since_uncertainty(&self) -> f64 {
        let watched = self
            .monitor
            .as_ref()
            .map_or(f64::INFINITY, |monitor| monitor.standard_uncertainty);
        (watched.powi(-2) + Self::UNWATCHED.powi(-2)).sqrt().recip()
    }

    /// Variance of the light of one exposure over that of the black ones, as far as nothing watches it.
    pub(crate) fn prior_variance(&self) -> f64 {
        (2.0 * self.flicker).powi(2) + SLOW * SLOW
    }

    /// Side in pixels of the lit squares for exposures of up to `longest_s` seconds by a camera with a range of `range_dn`
    /// digital numbers.
    #[must_use]
    pub fn side(&self, longest_s: f64, range_dn: f64) -> u32 {
        self.monitor.as_ref().map_or(0, |monitor| {
            let each = monitor.mean_dn_per_s() * longest_s / f64::from(monitor.side * monitor.side);
            side(each, range_dn)
        })
    }

    /// What is wrong with it for a camera of so many channels: the field, and what was expected.
    pub(crate) fn flaw(&self, channels: usize) -> Option<(&'static str, String)> {
        if !(0.0..=0.5).contains(&self.flicker) {
            return Some(("flicker", "a number from 0 to 0.5".to_owned()));
        }
        let monitor = self.monitor.as_ref()?;
        if !(1..=BLOCK_PX).contains(&monitor.side) {
            let expected = format!("a number from 1 to {BLOCK_PX}");
            return Some(("monitor.side", expected));
        }
        let is_row = |row: &Vec<f64>| row.len() == WATCH_TERMS && row.iter().all(|c| c.is_finite());
        if monitor.light.len() != channels || !monitor.light.iter().all(is_row) {
            let expected = format!("{WATCH_TERMS} finite numbers for each of {channels} channels");
            return Some(("monitor.light", expected));
        }
        (!(0.0..=0.5).contains(&monitor.standard_uncertainty)).then(|| {
            (
                "monitor.standard_uncertainty",
                "a number from 0 to 0.5".to_owned(),
            )
        })
    }
}

impl Monitor {
    /// Light at a pixel with these terms for squares of `side` pixels, of each channel.
    pub(crate) fn light_at<'a>(&'a self, terms: &'a [f64], side: u32) -> impl Iterator<Item = f64> + 'a {
        let scale = f64::from(side * side) / f64::from(self.side * self.side);
        let sum = move |row: &Vec<f64>| row.iter().zip(terms).map(|(c, term)| c * term).sum::<f64>();
        self.light.iter().map(move |row| scale * sum(row))
    }

    /// Mean over image and channels, digital numbers per second.
    fn mean_dn_per_s(&self) -> f64 {
        self.light.iter().filter_map(|row| row.first()).sum::<f64>() / self.light.len() as f64
    }

    /// Relative standard uncertainty (k = 1) of its light with squares of `side` pixels.
    pub(crate) fn uncertainty_of(&self, side: u32) -> f64 {
        let by_side = if side == self.side { 0.0 } else { SQUARES };
        self.standard_uncertainty.hypot(by_side)
    }
}

/// Side in pixels of squares that come to [`SHARE`] of `range_dn`, if each pixel of their sides' squares gives `each_dn`; 0 if
/// the largest give nothing to speak of.
pub(crate) fn side(each_dn: f64, range_dn: f64) -> u32 {
    let light = |side: u32| each_dn * f64::from(side * side);
    if light(BLOCK_PX) < LEAST_SHARE * range_dn {
        return 0;
    }
    (1..=BLOCK_PX)
        .rev()
        .find(|side| light(*side) <= SHARE * range_dn)
        .unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_are_as_large_as_light_allows_and_none_where_there_is_too_little() {
        assert_eq!(
            [1e-3, 1.0, 10.0, 1e4].map(|each| side(each, 4000.0)),
            [0, 14, 4, 1]
        );
    }
}
