//! Calibration of the photometry: camera, projector's response, light, throughput, interreflection.
//!
//! # Design
//! | file | holds |
//! |---|---|
//! | `capture` | the views: what is shown and taken |
//! | `lights` | the incident directions of the views |
//! | `exposure` | how long they are exposed, and how much light there is |
//! | `camera` | dark level, photon transfer, linearity |
//! | `field` | smooth fields over an image |
//! | `rank_one` | light and throughput from the standard |
//! | `share` | what of both images the standard truly filled |
//! | `sight` | that as files and assembly have it |
//!
//! The standard may be seen at several tilts, as samples will be.
//!
//! The signal model of [`crate::assemble`] has one number per pair of projector and camera pixel, K·T_o·E_p, and it is a
//! product: two smooth fields, which some thousand frames of a standard of known f determine (`rank_one`).
//!
//! Of the light that leaves the sample, mirror and optics throw a share back onto it. A second standard of another
//! reflectance shows how large it is: of the two, the brighter one gains more.
//!
//! Assembly takes all of it into account; what it does about interreflection stands there.

mod camera;
mod capture;
mod exposure;
mod field;
mod lights;
mod rank_one;
mod share;
mod sight;
#[cfg(test)]
mod tests;

use std::path::Path;

use serde::{Deserialize, Serialize};

pub use camera::CameraFound;
pub(super) use capture::VIEWS;
pub use capture::{Request, Views, capture};
pub use field::SmoothField;
pub use sight::Sight;

use camera::{Times, camera, moments};
use capture::{SEGMENT, Shows};
use rank_one::Seen;
use share::{Frames, fit_whole};

use super::{CalibrateError, RIG, check_rig, file, rig_hash};
use crate::direction::from_degrees;
use crate::rig::{Rig, Tilt};
use crate::sample::{Sample, albedo};
use crate::store::Segment;
use crate::text::by;

/// Name of the file with what was found.
pub const PHOTOMETRY: &str = "photometry.json";
/// What writes the files.
const COMMAND: &str = "rcg calibrate photometry --out DIR";
/// Version of `photometry.json`: 2 says where the standard was seen.
const VERSION: u32 = 3;
/// The reflectances of two standards that show the interreflection differ at least by this.
const APART: f64 = 0.3;
/// Share of saturated values in frames of the standard that is too much.
const SATURATED: f64 = 0.002;

/// Level of grey of the exposure `index` of the series of levels.
fn level(index: usize) -> u8 {
    (17 * index) as u8
}

/// What calibration found, as `photometry.json` has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Photometry {
    /// Version of this file.
    #[serde(default)]
    pub version: u32,
    /// Hash of the calibrated rig that it belongs to.
    pub rig_sha256: String,
    /// The standard.
    pub standard: String,
    /// Relative standard uncertainty of its reflectance.
    pub standard_uncertainty: f64,
    /// The camera.
    pub camera: CameraFound,
    /// Light of the black projector pixels, as digital numbers per second on the standard, mean over the pixels.
    pub stray_dn_per_s: f64,
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
    /// What is left between the product and the frames of the standard beyond their noise, relative, RMS.
    pub field_residual: f64,
    /// Share of the light from the sample that returns onto it, if a second standard showed it.
    pub interreflection: Option<Interreflection>,
    /// Where the standard was seen, at each of its tilts: there is no throughput elsewhere.
    #[serde(default)]
    pub sights: Vec<Sight>,
}

/// Light from the sample that returns onto it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interreflection {
    /// The share.
    pub share: f64,
    /// Its standard uncertainty (k = 1).
    pub standard_uncertainty: f64,
}

/// Fits the photometry to the captures in `dir` and writes what was found beside them; the standard's reflectance is known
/// to `standard_uncertainty` (relative, k = 1).
///
/// # Errors
/// [`CalibrateError`].
pub fn calibrate(dir: &Path, standard_uncertainty: f64) -> Result<Photometry, CalibrateError> {
    let (views, raw) = Views::read(dir)?;
    let rig_path = dir.join(RIG);
    check_rig(
        &dir.join(capture::RAW),
        &Rig::load(&rig_path.display().to_string())?,
        &rig_hash(&views.rig),
    )?;
    let rig = views.rig_of(0)?;
    let shows = views.segments();
    let format = rig.frame_format();
    let layout = raw.layout();
    let expected = [
        shows.len() * SEGMENT,
        SEGMENT,
        format.height_px,
        format.width_px,
        format.channels,
    ];
    let found = [
        layout.exposures,
        layout.segment,
        layout.height,
        layout.width,
        layout.channels,
    ];
    if expected != found {
        return Err(CalibrateError::Content {
            path: dir.join(capture::RAW).display().to_string(),
            field: "exposures × segment × rows × columns × channels".to_owned(),
            expected: format!("{} as {VIEWS} says", by(&expected)),
            found: by(&found),
        });
    }
    let segments: Vec<Segment> = (0..raw.segments())
        .map(|index| raw.read_segment(index))
        .collect::<Result<_, _>>()?;
    let length = format.len();
    let frames_of = |wanted: Shows| -> Vec<&[u16]> {
        let at = shows.iter().position(|shows| *shows == wanted);
        at.map(|at| segments[at].frames.chunks_exact(length).collect())
            .unwrap_or_default()
    };
    let series: Vec<Times> = (0..views.times_s.len())
        .map(|index| {
            let mut lit = frames_of(Shows::Series(index));
            let black = lit.split_off(SEGMENT / 2);
            Times {
                exposure_s: views.times_s[index],
                lit,
                black,
                dark: frames_of(Shows::Dark(index)),
            }
        })
        .collect();
    let saturation_dn = f64::from(rig.saturation_dn());
    let camera = camera(&series, saturation_dn)?;
    let linear = Linear {
        camera,
        range: saturation_dn - camera.dark_dn,
    };
    let black = linear.mean(&frames_of(Shows::Black(0)));
    let dark = linear.mean(&series[series.len() - 1].dark);
    let stray = black
        .iter()
        .zip(&dark)
        .map(|(black, dark)| black - dark)
        .sum::<f64>()
        / length as f64;
    let projector_response = linear.levels(&frames_of(Shows::Levels), &black);

    let standard = crate::sample::parse(&views.standard).map_err(crate::measure::MeasureError::from)?;
    let (mut all, mut frames) = (Vec::new(), Vec::new());
    let blacks: Vec<Vec<f64>> = (0..views.stands.len())
        .map(|stand| linear.mean(&frames_of(Shows::Black(stand))))
        .collect();
    for (stand, black) in blacks.iter().enumerate() {
        let mut seen = Seen::new(&views, stand)?;
        let mut lit = Vec::new();
        for wanted in shows.iter().copied() {
            let Shows::Directions(of, first) = wanted else {
                continue;
            };
            if of == stand {
                let frames = frames_of(wanted);
                seen.add(first, &frames, &linear, black, standard.as_ref(), &views.standard)?;
                lit.extend(frames);
            }
        }
        all.push(seen);
        frames.push(Frames {
            linear: &linear,
            black,
            lit,
            standard: standard.as_ref(),
        });
    }
    let (saturated, values) = all
        .iter()
        .map(Seen::saturated)
        .fold((0, 0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
    let saturated_share = saturated as f64 / values.max(1) as f64;
    if saturated_share > SATURATED {
        return Err(CalibrateError::Views {
            expected: format!(
                "frames of the standard with at most {} % saturated",
                100.0 * SATURATED
            ),
            found: format!("{:.1} %", 100.0 * saturated_share),
            advice: "take them with a shorter --exposure-ms, or let it be found",
        });
    }
    let fields = fit_whole(&mut all, &frames).ok_or_else(|| CalibrateError::Views {
        expected: "frames of the standard that determine light and throughput".to_owned(),
        found: "too little of the image lit".to_owned(),
        advice: "is the standard in place, and lit?",
    })?;
    let own = interreflected(standard.as_ref());
    let interreflection = match &views.second_standard {
        None => None,
        Some(spec) => {
            let second = crate::sample::parse(spec).map_err(crate::measure::MeasureError::from)?;
            let black = linear.mean(&frames_of(Shows::SecondBlack));
            let mut other = Seen::new(&views, 0)?;
            other.judged = all[0].judged.clone();
            for wanted in shows.iter().copied() {
                if let Shows::SecondDirections(first) = wanted {
                    other.add(first, &frames_of(wanted), &linear, &black, second.as_ref(), spec)?;
                }
            }
            Some(interreflection(
                &all[0],
                &other,
                own,
                interreflected(second.as_ref()),
            )?)
        }
    };
    let exposure_s = views.exposure_s;
    let photometry = Photometry {
        version: VERSION,
        sights: all.iter().map(Seen::sight).collect(),
        rig_sha256: rig_hash(&views.rig),
        standard: views.standard.clone(),
        standard_uncertainty,
        camera,
        stray_dn_per_s: stray / exposure_s,
        gamma: gamma(&projector_response),
        projector_response,
        // The standard's own interreflection is no property of the instrument.
        sensitivity: fields
            .sensitivity
            .into_iter()
            .map(|k| k / (1.0 + own * interreflection.map_or(0.0, |found| found.share)))
            .collect(),
        throughput: fields.throughput,
        intensity: fields.intensity,
        field_uncertainty: fields.uncertainty,
        field_residual: fields.residual,
        interreflection,
    };
    file::check(&photometry)?;
    let path = dir.join(PHOTOMETRY);
    photometry.check(&path, "")?;
    file::write(&path, &photometry)?;
    Ok(photometry)
}

impl Photometry {
    /// Relative standard uncertainty (k = 1) that everything measured by it has in common: the standard's reflectance, and
    /// what is left between the fields and the frames of the standard.
    #[must_use]
    pub fn common_uncertainty(&self) -> f64 {
        self.standard_uncertainty.hypot(self.field_residual)
    }

    /// Reads the photometry at `path`, which must be that of `rig` (its camera at full size).
    ///
    /// # Errors
    /// [`CalibrateError::OtherRig`]; [`CalibrateError::Content`].
    pub fn read(path: &Path, rig: &Rig) -> Result<Self, CalibrateError> {
        let found: Self = file::read(path, COMMAND)?;
        found.check(path, "")?;
        check_rig(path, rig, &found.rig_sha256)?;
        Ok(found)
    }

    /// Refuses numbers that no calibration finds; `path` is where they were read, `within` the field that holds them.
    pub(super) fn check(&self, path: &Path, within: &str) -> Result<(), CalibrateError> {
        let content = |field: &str, expected: String, found: String| {
            Err(CalibrateError::Content {
                path: path.display().to_string(),
                field: format!("{within}{field}"),
                expected,
                found,
            })
        };
        if self.version != VERSION {
            let expected = format!("{VERSION}; `{COMMAND}` fits what was captured again");
            return content("version", expected, self.version.to_string());
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
            ("standard_uncertainty", self.standard_uncertainty, 0.0, 0.5),
            ("camera.dark_dn", camera.dark_dn, -65_535.0, 65_535.0),
            ("camera.dark_dn_per_s", camera.dark_dn_per_s, -1e12, 1e12),
            ("camera.gain_e_per_dn", camera.gain_e_per_dn, least, 1e12),
            ("camera.read_noise_e", camera.read_noise_e, 0.0, 1e12),
            // Beyond a half the camera would show less of more light.
            ("camera.nonlinearity", camera.nonlinearity, -0.49, 0.49),
            ("camera.linearity_residual", camera.linearity_residual, 0.0, 1.0),
            ("field_uncertainty", self.field_uncertainty, 0.0, 1.0),
            ("field_residual", self.field_residual, 0.0, 1.0),
        ]
        .map(|(field, found, low, high)| (field.to_owned(), found, low, high))
        .to_vec();
        for (index, k) in self.sensitivity.iter().enumerate() {
            all.push((format!("sensitivity[{index}]"), *k, least, f64::MAX));
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
        }
        all
    }

    /// Where the standard was seen at `tilt`.
    ///
    /// # Errors
    /// [`CalibrateError::Views`] if it was not captured there.
    pub fn sight(&self, tilt: Option<Tilt>) -> Result<&Sight, CalibrateError> {
        let found = self.sights.iter().find(|sight| Tilt::is_same(sight.tilt, tilt));
        let name = |tilt: Option<Tilt>| tilt.map_or_else(|| "none".to_owned(), |tilt| tilt.to_string());
        found.ok_or_else(|| CalibrateError::Views {
            expected: format!(
                "a standard that was captured at the tilt of the sample, {}",
                name(tilt)
            ),
            found: format!(
                "it at {}",
                self.sights
                    .iter()
                    .map(|sight| name(sight.tilt))
                    .collect::<Vec<_>>()
                    .join(", ")
            ),
            advice: "give `rcg calibrate photometry` all --tilts at which samples are measured",
        })
    }
}

/// Digital numbers → what they would be if the camera were linear, above the dark level.
struct Linear {
    camera: CameraFound,
    range: f64,
}

impl Linear {
    fn of(&self, dn: f64) -> f64 {
        let signal = dn - self.camera.dark_dn;
        signal * (1.0 + self.camera.nonlinearity * signal / self.range)
    }

    /// Mean over frames of each value.
    fn mean(&self, frames: &[&[u16]]) -> Vec<f64> {
        moments(frames).0.into_iter().map(|dn| self.of(dn)).collect()
    }

    /// Light of each level above the black frame, relative to the last.
    fn levels(&self, frames: &[&[u16]], black: &[f64]) -> Vec<f64> {
        let light = |frame: &&[u16]| {
            let lit = frame.iter().map(|dn| self.of(f64::from(*dn)));
            lit.zip(black).map(|(lit, black)| lit - black).sum::<f64>()
        };
        let all: Vec<f64> = frames.iter().map(light).collect();
        let brightest = all.last().copied().unwrap_or(1.0);
        all.into_iter().map(|light| light / brightest).collect()
    }
}

/// Exponent of the power that describes the levels best, in the logarithm, those above a tenth counting.
fn gamma(response: &[f64]) -> f64 {
    let (mut xy, mut xx) = (0.0, 0.0);
    for (index, light) in response.iter().enumerate() {
        let x = (f64::from(level(index)) / 255.0).ln();
        if *light > 0.1 && x < 0.0 {
            xy += x * light.ln();
            xx += x * x;
        }
    }
    if xx > 0.0 { xy / xx } else { 1.0 }
}

/// What the interreflection of the whole light adds to the signal of a standard, relative: of f the standard shows
/// f + share·ρ(ω_i)·ρ(ω_o)/π, with its directional albedo ρ. Standards are diffuse: one pair stands for all.
fn interreflected(standard: &dyn Sample) -> f64 {
    let mean = |values: [f64; 3]| values.iter().sum::<f64>() / 3.0;
    let (wi, wo) = (from_degrees(45.0, 0.0), from_degrees(30.0, 180.0));
    mean(albedo(standard, wi)) * mean(albedo(standard, wo))
        / (std::f64::consts::PI * mean(standard.f(wi, wo)))
}

/// The share that returns, from what the standards show of their own reflectance: `first` adds share·`a`, `second`
/// share·`b`.
fn interreflection(first: &Seen, second: &Seen, a: f64, b: f64) -> Result<Interreflection, CalibrateError> {
    check_apart(a, b)?;
    let (ratio, uncertainty) = first.ratio_to(second).ok_or_else(|| CalibrateError::Views {
        expected: "frames of the second standard that are as bright as their noise is small".to_owned(),
        found: "none".to_owned(),
        advice: "give a brighter --second-standard, or none",
    })?;
    // (1 + share·a)/(1 + share·b) = ratio.
    Ok(Interreflection {
        share: (ratio - 1.0) / (a - ratio * b),
        standard_uncertainty: uncertainty / (a - b).abs(),
    })
}

/// Refuses standards so alike that their own uncertainty would pass for interreflection.
fn check_apart(a: f64, b: f64) -> Result<(), CalibrateError> {
    let is_apart = (a - b).abs() >= APART;
    if is_apart {
        return Ok(());
    }
    Err(CalibrateError::Views {
        expected: format!("two standards whose reflectances differ by {APART} or more"),
        found: format!("{a:.3} and {b:.3}"),
        advice: "give a darker --second-standard, or none to do without interreflection",
    })
}
