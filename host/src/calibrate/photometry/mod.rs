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
mod rank_one;
mod share;
#[cfg(test)]
mod tests;

use std::path::Path;

pub use capture::{Request, Views, capture};

use camera::{Times, camera, moments};
use capture::{SEGMENT, Shows, VIEWS};
use rank_one::Seen;
use share::{Frames, fit_whole};

use super::{CalibrateError, RIG};
use crate::base::text::by;
use crate::brdf::sample::{Sample, albedo};
use crate::hemisphere::direction::from_degrees;
use crate::instrument::calibration::{
    CalibrationError, CameraFound, Interreflection, PHOTOMETRY, PHOTOMETRY_VERSION, Photometry, check_rig,
    file, rig_hash,
};
use crate::instrument::rig::Rig;
use crate::store::Segment;

/// The reflectances of two standards that show the interreflection differ at least by this.
const APART: f64 = 0.3;
/// Share of saturated values in frames of the standard that is too much.
const SATURATED: f64 = 0.002;

/// Level of grey of the exposure `index` of the series of levels.
fn level(index: usize) -> u8 {
    (17 * index) as u8
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
        return Err(CalibrationError::Content {
            path: dir.join(capture::RAW).display().to_string(),
            field: "exposures × segment × rows × columns × channels".to_owned(),
            expected: format!("{} as {VIEWS} says", by(&expected)),
            found: by(&found),
        }
        .into());
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

    let standard =
        crate::brdf::sample::parse(&views.standard).map_err(crate::virtual_rig::setup::SetupError::from)?;
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
            let second =
                crate::brdf::sample::parse(spec).map_err(crate::virtual_rig::setup::SetupError::from)?;
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
        version: PHOTOMETRY_VERSION,
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
    super::check(&photometry)?;
    let path = dir.join(PHOTOMETRY);
    photometry.check(&path, "")?;
    file::write(&path, &photometry)?;
    Ok(photometry)
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
