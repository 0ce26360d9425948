//! Light, throughput and camera as calibration found them.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::crosstalk::{COLOURS, Crosstalk};
use super::field::{self, SmoothField};
use super::lamp::LampFound;
use super::seen_part::SeenPart;
use super::sight::Sight;
use super::standard::Standard;
use super::stray::Stray;
use super::{CalibrationError, check_rig, file};
use crate::instrument::rig::{Binned, ROUNDING_DN2, Rig, Tilt};

/// Name of the file with what was found.
pub const PHOTOMETRY: &str = "photometry.json";
/// What writes the files of this calibration.
pub(crate) const COMMAND: &str = "rcg calibrate photometry --out DIR";
/// Version of `photometry.json`: 2 says where the standard was seen, 3 what the end of a field's series leaves; 4
/// describes pixels of the sensor, not of the image; 5 has stray light, 6 the lamp and what pixels and rows differ by, 7 what
/// part of the sample is seen, 8 up to where the camera is linear, 9 has of what watches the lamp its own light only,
/// 10 states what the lamp of the standard makes of all, 11 has what the camera's colours show of each other, 12 whose word the
/// standards are, and each by its own uncertainty.
pub(crate) const PHOTOMETRY_VERSION: u32 = 12;

/// What calibration found, as `photometry.json` has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Photometry {
    /// Version of this file.
    #[serde(default)]
    pub version: u32,
    /// Hash of the calibrated rig that it belongs to.
    pub rig_sha256: String,
    /// The standard, and the second one if there was one.
    pub standards: Vec<Standard>,
    /// The camera.
    pub camera: CameraFound,
    /// What its colours show of each other, if it has any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crosstalk: Option<Crosstalk>,
    /// Light of the projector with all pixels lit over that with all black; none if black is black.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contrast: Option<f64>,
    /// Light of the levels 0, 17, … 255, relative to the brightest.
    pub projector_response: Vec<f64>,
    /// Exponent that describes the response best.
    pub gamma: f64,
    /// K of each channel: digital numbers per second and f in sr⁻¹ × Σ E·cosθ·Δω, where both fields are 1.
    pub sensitivity: Vec<f64>,
    /// `T_o` over the camera's image.
    pub throughput: SmoothField,
    /// `E_p` over the projector's image.
    pub intensity: SmoothField,
    /// Relative standard uncertainty (k = 1) of K·T_o·E_p by noise, median over the pairs.
    pub field_uncertainty: f64,
    /// That of all of it alike by the lamp while the standard was in the holder.
    pub lamp_uncertainty: f64,
    /// What is left between the product and the frames of the standard beyond their noise and what pixels differ by, relative,
    /// RMS.
    pub field_residual: f64,
    /// Share of the light from the sample that returns onto it, if a second standard showed it.
    pub interreflection: Option<Interreflection>,
    /// Glare, the ghost of the beam splitter, and direct light.
    #[serde(default)]
    pub stray: Stray,
    /// How steady the light is, and what watches it.
    #[serde(default)]
    pub lamp: LampFound,
    /// What part of the sample is seen and lit, if the rig says how wide the pupils are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen_part: Option<SeenPart>,
    /// Where the standard was seen, at each of its tilts: there is no throughput elsewhere.
    #[serde(default)]
    pub sights: Vec<Sight>,
}

/// Light from the sample that returns onto it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interreflection {
    /// The share.
    pub share: f64,
    /// Its standard uncertainty (k = 1) by noise.
    pub standard_uncertainty: f64,
    /// That by the reflectances of both standards, which the sensitivity shares: see `standards_variance`.
    pub by_standards: f64,
    /// What a share of 1 would add to the signal of the first standard, relative.
    pub own: f64,
    /// By how much that is more than it would add to that of the second.
    pub apart: f64,
    /// Its standard uncertainty over what it were if less than nothing could return; both above have it in them.
    #[serde(default = "whole")]
    pub narrowed: f64,
}

/// [`Interreflection::narrowed`] of files that do not say.
const fn whole() -> f64 {
    1.0
}

/// What the reflectances of two standards may be off by.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct TwoStandards {
    /// Of the first and of the second, relative, k = 1.
    pub(crate) uncertainty: [f64; 2],
    /// Whether both may be off together, for all that is known: so plates of one material or of one laboratory may be.
    pub(crate) may_agree: bool,
}

impl Interreflection {
    /// Variance of f in sr⁻² by the reflectances of the `standards`, where a share of 1 would add `per_share` sr⁻¹.
    ///
    /// Of the standards a and b, of which the first is off by δ₁ and the second by δ₂, the share comes out wrong by
    /// (δ₁ − δ₂)/(a − b), and the sensitivity by δ₁ and by a times as much. So a Lambertian sample as dark as the second
    /// standard is as uncertain as that, and one as bright as the first as the first is; others show more of it. Where both may be
    /// off together, that counts as far as it is worse. A share that is not less than nothing follows less far.
    #[must_use]
    pub(crate) fn standards_variance(&self, standards: TwoStandards, f: f32, per_share: f32) -> f32 {
        let by_second = (self.own as f32 * f - per_share) * (self.narrowed / self.apart) as f32;
        let [first, second] = standards.uncertainty.map(|relative| relative as f32);
        let (first, second) = (first * (f - by_second), second * by_second);
        let together = if standards.may_agree {
            (2.0 * first * second).max(0.0)
        } else {
            0.0
        };
        first.powi(2) + second.powi(2) + together
    }
}

/// What may return to a white standard where nothing is known of it, relative: mirror and optics around the hole throw back some
/// thousandths.
const UNKNOWN_RETURN: f64 = 5e-3;

impl Photometry {
    /// Relative standard uncertainty (k = 1) of f that all directions share by the standard's reflectance, and by the light that may have
    /// returned onto it where no second standard told of that: to a darker sample less returns. Everything measured by it has that in
    /// common.
    #[must_use]
    pub fn uncertainty_by_standard(&self) -> f64 {
        let returned = if self.interreflection.is_none() {
            UNKNOWN_RETURN
        } else {
            0.0
        };
        self.standards[0].standard_uncertainty.hypot(returned)
    }

    /// What the standards may be off by, both.
    #[must_use]
    pub(crate) fn two_standards(&self) -> TwoStandards {
        let second = self.standards.get(1);
        TwoStandards {
            uncertainty: [
                self.uncertainty_by_standard(),
                second.map_or(0.0, |second| second.standard_uncertainty),
            ],
            may_agree: self.standards.len() > 1 && self.standards.iter().all(|one| one.certificate.is_some()),
        }
    }

    /// Relative standard uncertainty (k = 1) that neighbouring directions share: of what the fields leave of what the standard showed,
    /// and of how its f goes with direction, as far as that is known.
    #[must_use]
    pub(crate) fn uncertainty_by_fields(&self) -> f64 {
        let angular = 2_f64.sqrt() * self.standards[0].angular.each;
        self.field_residual.hypot(angular)
    }

    /// Reads the photometry at `path`, which must be that of `rig` (its camera at full size).
    ///
    /// # Errors
    /// [`CalibrationError::OtherRig`]; [`CalibrationError::Content`].
    pub fn read(path: &Path, rig: &Rig) -> Result<Self, CalibrationError> {
        let found: Self = file::read(path, COMMAND)?;
        found.check(path, "")?;
        check_rig(path, rig, &found.rig_sha256)?;
        if found.crosstalk.is_some() != (usize::from(rig.camera.channels) == COLOURS) {
            return Err(CalibrationError::Content {
                path: path.display().to_string(),
                field: "crosstalk".to_owned(),
                expected: "one where the camera has colours, none else".to_owned(),
                found: if found.crosstalk.is_some() { "one" } else { "none" }.to_owned(),
            });
        }
        Ok(found)
    }

    /// Refuses numbers that no calibration finds; `path` is where they were read, `within` the field that holds them.
    pub(crate) fn check(&self, path: &Path, within: &str) -> Result<(), CalibrationError> {
        let content = |field: &str, expected: String, found: String| {
            Err(CalibrationError::Content {
                path: path.display().to_string(),
                field: format!("{within}{field}"),
                expected,
                found,
            })
        };
        if self.version != PHOTOMETRY_VERSION {
            let expected = format!("{PHOTOMETRY_VERSION}; `{COMMAND}` fits what was captured again");
            return content("version", expected, self.version.to_string());
        }
        let count = 1 + usize::from(self.interreflection.is_some());
        if self.standards.len() != count {
            let expected = format!("{count}, the second with the interreflection");
            return content("standards", expected, self.standards.len().to_string());
        }
        for (field, found, low, high) in self.ranges() {
            if !(low..=high).contains(&found) {
                return content(
                    &field,
                    format!("a number from {low} to {high}"),
                    found.to_string(),
                );
            }
        }
        if self.sensitivity.is_empty() {
            return content(
                "sensitivity",
                "a number for each channel".to_owned(),
                "none".to_owned(),
            );
        }
        for (name, field) in [("throughput", &self.throughput), ("intensity", &self.intensity)] {
            if !field.is_whole() {
                let expected = format!(
                    "{} finite coefficients, and as many rows of covariance",
                    field::TERMS
                );
                return content(name, expected, "others".to_owned());
            }
        }
        if let Some((field, expected)) = self.stray.flaw(self.sensitivity.len()) {
            return content(&format!("stray.{field}"), expected, "others".to_owned());
        }
        if let Some((field, expected)) = self.lamp.flaw(self.sensitivity.len()) {
            return content(&format!("lamp.{field}"), expected, "another".to_owned());
        }
        if self.crosstalk.is_some() && self.sensitivity.len() != COLOURS {
            let expected = format!("one only where there are {COLOURS} channels");
            return content(
                "crosstalk",
                expected,
                format!("{} channels", self.sensitivity.len()),
            );
        }
        if let Some((field, expected)) = self.crosstalk.as_ref().and_then(Crosstalk::flaw) {
            return content(
                &format!("crosstalk.{field}"),
                expected.to_owned(),
                "others".to_owned(),
            );
        }
        if let Some((field, expected)) = self.seen_part.as_ref().and_then(SeenPart::flaw) {
            return content(
                &format!("seen_part.{field}"),
                expected.to_owned(),
                "others".to_owned(),
            );
        }
        if self.sights.is_empty() {
            return content("sights", "one for each tilt".to_owned(), "none".to_owned());
        }
        for (index, sight) in self.sights.iter().enumerate() {
            if let Some((field, expected)) = sight.flaw() {
                return content(&format!("sights[{index}].{field}"), expected, "others".to_owned());
            }
        }
        Ok(())
    }

    /// Numbers with their names and what they may be at all.
    fn ranges(&self) -> Vec<(String, f64, f64, f64)> {
        let camera = &self.camera;
        let least = f64::MIN_POSITIVE;
        let mut all: Vec<(String, f64, f64, f64)> = [
            ("camera.dark_dn", camera.dark_dn, -65_535.0, 65_535.0),
            ("camera.dark_dn_per_s", camera.dark_dn_per_s, -1e12, 1e12),
            ("camera.gain_e_per_dn", camera.gain_e_per_dn, least, 1e12),
            ("camera.read_noise_e", camera.read_noise_e, 0.0, 1e12),
            // Beyond a half the camera would show less of more light.
            ("camera.nonlinearity", camera.nonlinearity, -0.49, 0.49),
            ("camera.linearity_residual", camera.linearity_residual, 0.0, 1.0),
            ("camera.linear_to", camera.linear_to, 0.5, 1.0),
            ("camera.prnu", camera.prnu, 0.0, 0.5),
            ("camera.row_noise_e", camera.row_noise_e, 0.0, 1e12),
            ("camera.dsnu_e", camera.dsnu_e, 0.0, 1e12),
            ("camera.hot", camera.hot, 0.0, 1.0),
            ("field_uncertainty", self.field_uncertainty, 0.0, 1.0),
            ("lamp_uncertainty", self.lamp_uncertainty, 0.0, 1.0),
            ("field_residual", self.field_residual, 0.0, 1.0),
        ]
        .map(|(field, found, low, high)| (field.to_owned(), found, low, high))
        .to_vec();
        for (index, k) in self.sensitivity.iter().enumerate() {
            all.push((format!("sensitivity[{index}]"), *k, least, f64::MAX));
        }
        for (index, standard) in self.standards.iter().enumerate() {
            let within = |(field, found, low, high): (String, f64, f64, f64)| {
                (format!("standards[{index}].{field}"), found, low, high)
            };
            all.extend(standard.ranges().into_iter().map(within));
        }
        if let Some(back) = self.interreflection {
            let within = |field: &str| format!("interreflection.{field}");
            all.push((within("share"), back.share, -0.5, 0.5));
            all.push((
                within("standard_uncertainty"),
                back.standard_uncertainty,
                0.0,
                0.5,
            ));
            all.push((within("by_standards"), back.by_standards, 0.0, 5.0));
            all.push((within("own"), back.own, 0.0, 2.0));
            all.push((within("apart"), back.apart.abs(), 0.1, 2.0));
            all.push((within("narrowed"), back.narrowed, 0.0, 1.0));
        }
        all
    }

    /// Where the standard was seen at `tilt`.
    ///
    /// # Errors
    /// [`CalibrationError::NoStandard`] if it was not captured there.
    pub fn sight(&self, tilt: Option<Tilt>) -> Result<&Sight, CalibrationError> {
        let found = self.sights.iter().find(|sight| Tilt::is_same(sight.tilt, tilt));
        let name = |tilt: Option<Tilt>| tilt.map_or_else(|| "none".to_owned(), |tilt| tilt.to_string());
        found.ok_or_else(|| CalibrationError::NoStandard {
            tilt: name(tilt),
            tilts: self
                .sights
                .iter()
                .map(|sight| name(sight.tilt))
                .collect::<Vec<_>>()
                .join(", "),
        })
    }
}

/// What is known of the camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraFound {
    /// Digital number without light at an exposure time of zero, mean over the pixels.
    pub dark_dn: f64,
    /// Digital numbers that dark current adds per second, mean over the pixels.
    pub dark_dn_per_s: f64,
    /// Electrons per digital number, of one pixel of the sensor.
    pub gain_e_per_dn: f64,
    /// Standard deviation of the read-out, electrons, of one pixel of the sensor; with what its steps add, without row noise.
    pub read_noise_e: f64,
    /// β: of a signal s the camera shows s·(1 − β·s/range), the range being that above the dark level.
    pub nonlinearity: f64,
    /// Largest deviation from a straight line that is left, of the mean over all pixels, relative.
    pub linearity_residual: f64,
    /// Share of the range above the dark level up to which that holds; what is above counts as saturated.
    #[serde(default)]
    pub linear_to: f64,
    /// Photo-response non-uniformity (EMVA 1288): standard deviation of the response over the sensor's pixels, relative.
    pub prnu: f64,
    /// Whether too few pixels showed that, and it is the most that sensors usually have.
    pub prnu_is_assumed: bool,
    /// Standard deviation of what all pixels of a row of the sensor have in common in one frame, electrons.
    pub row_noise_e: f64,
    /// Dark-signal non-uniformity (EMVA 1288): standard deviation over the sensor's pixels of the level without light at an
    /// exposure time of zero, electrons. Black frames take it away.
    pub dsnu_e: f64,
    /// Share of the sensor's pixels that are hot: whose dark current stands out of the noise.
    pub hot: f64,
}

impl CameraFound {
    /// The least digital number that is not trusted, of a camera that saturates at `saturation_dn`.
    pub(crate) fn trusted_dn(&self, saturation_dn: f64) -> f64 {
        self.dark_dn + self.linear_to * (saturation_dn - self.dark_dn)
    }

    /// The same for a pixel of an image that is `binned`, as what follows reckons with it: of the charge of all sensor
    /// pixels behind it. What their steps leave in common is added, which no series of frames shows.
    #[must_use]
    pub(crate) fn of_image(&self, binned: &Binned) -> Self {
        Self {
            gain_e_per_dn: self.gain_e_per_dn * binned.pixels,
            read_noise_e: (self.read_noise_e * binned.pixels.sqrt()).hypot(binned.common_e(0.0)),
            prnu: self.prnu / binned.pixels.sqrt(),
            row_noise_e: self.row_noise_e * row_share(binned),
            dsnu_e: self.dsnu_e * binned.pixels.sqrt(),
            hot: 1.0 - (1.0 - self.hot).powf(binned.pixels),
            ..*self
        }
    }

    /// Variance of a pixel without charge by reading out and rounding, in DN², alone and with what its row has in common.
    pub(crate) fn read_variance_dn2(&self) -> f64 {
        self.own_variance_dn2() + self.row_variance_dn2()
    }

    /// The part of it that differs from pixel to pixel.
    pub(crate) fn own_variance_dn2(&self) -> f64 {
        (self.read_noise_e / self.gain_e_per_dn).powi(2) + ROUNDING_DN2
    }

    /// The part of it that all pixels of a row have in common in one frame.
    pub(crate) fn row_variance_dn2(&self) -> f64 {
        (self.row_noise_e / self.gain_e_per_dn).powi(2)
    }

    /// What was found with an image that is `binned`, for one pixel of the sensor.
    #[must_use]
    pub(crate) fn of_sensor(&self, binned: &Binned) -> Self {
        Self {
            gain_e_per_dn: self.gain_e_per_dn / binned.pixels,
            read_noise_e: self.read_noise_e / binned.pixels.sqrt(),
            prnu: self.prnu * binned.pixels.sqrt(),
            row_noise_e: self.row_noise_e / row_share(binned),
            dsnu_e: self.dsnu_e / binned.pixels.sqrt(),
            hot: 1.0 - (1.0 - self.hot).powf(binned.pixels.recip()),
            ..*self
        }
    }
}

/// Row noise in the charge of all pixels behind one of an image that is `binned`, over that of a row of the sensor: of N
/// pixels in √N rows, N times the mean over the rows.
fn row_share(binned: &Binned) -> f64 {
    binned.pixels / binned.pixels.sqrt().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_found_at_one_size_of_the_image_holds_at_another() {
        let rig = Rig::load("rcg-3").unwrap();
        let sensor = CameraFound {
            dark_dn: 64.0,
            dark_dn_per_s: 1.0,
            gain_e_per_dn: 2.5,
            read_noise_e: 3.0,
            nonlinearity: 0.01,
            linearity_residual: 0.0,
            linear_to: 1.0,
            prnu: 0.005,
            prnu_is_assumed: false,
            row_noise_e: 0.3,
            dsnu_e: 1.0,
            hot: 1e-3,
        };
        let image = |size_px: u32| rig.with_image_size(size_px).unwrap().camera.binned;
        for size_px in [1024, 512, 96] {
            let binned = image(size_px);
            let of = sensor.of_image(&binned);
            let along = 1024.0 / f64::from(size_px);
            assert!((of.prnu * along / sensor.prnu - 1.0).abs() < 1e-9, "{of:?}");
            // In numbers of the image, a row of it has the mean of those behind it.
            let row_dn = (of.row_noise_e / of.gain_e_per_dn) / (sensor.row_noise_e / sensor.gain_e_per_dn);
            assert!((row_dn * along.sqrt() - 1.0).abs() < 1e-9, "{of:?}");
            let back = of.of_sensor(&binned);
            for (found, expected) in [
                (back.prnu, sensor.prnu),
                (back.row_noise_e, sensor.row_noise_e),
                (back.dsnu_e, sensor.dsnu_e),
                (back.hot, sensor.hot),
            ] {
                assert!((found / expected - 1.0).abs() < 1e-9, "{back:?}");
            }
        }
    }
}
