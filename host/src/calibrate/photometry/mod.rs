//! Calibration of the photometry: camera, projector's response, light, throughput, interreflection.
//!
//! # Design
//! | file | holds |
//! |---|---|
//! | `capture` | the views: what is shown and taken |
//! | `in_holder` | what is put into the holder |
//! | `lights` | the incident directions of the views |
//! | `exposure` | how long they are exposed, and how much light there is |
//! | `camera` | dark level, photon transfer, linearity |
//! | `knee` | up to where the camera is linear |
//! | `linear` | numbers as a linear camera would give them, and what they say of the lamp |
//! | `field` | smooth fields over an image |
//! | `rank_one` | light and throughput from the standard |
//! | `interreflection` | what returns onto the sample, from two standards |
//! | `contrast` | light of black projector pixels |
//! | `stray` | glare, ghost and direct light |
//! | `share` | what of both images the standard truly filled |
//! | `pixels` | how the camera's pixels and rows differ |
//! | `sight` | that as files and assembly have it |
//!
//! The standard may be seen at several tilts, as samples will be.
//!
//! The signal model of [`crate::assemble`] has one number per pair of projector and camera pixel, K·T_o·E_p, and it is a
//! product: two smooth fields, which some thousand frames of a standard of known f determine (`rank_one`).
//!
//! Assembly takes all of it into account; what it does about interreflection stands there.

mod camera;
mod capture;
mod contrast;
mod exposure;
mod in_holder;
mod interreflection;
mod knee;
mod linear;
mod pixels;
mod rank_one;
mod share;
mod stray;
#[cfg(test)]
mod tests;
mod turns;
mod weakness;

use std::path::Path;

pub use capture::{Request, Views, capture};
pub use weakness::{Height, Weakness, height, weaknesses};

use camera::{Times, camera, flicker, set_linearity};
use capture::{SEGMENT, Shows, VIEWS};
use interreflection::{interreflected, interreflection};
use linear::Linear;
use pixels::{Layout, every_second};
use rank_one::Seen;
use share::Frames;
use turns::{NoFields, fit_whole};

use super::{CalibrateError, RIG};
use crate::base::text::by;
use crate::brdf::sample::Sample;
use crate::instrument::calibration::stray::{Removal, dark_of};
use crate::instrument::calibration::{
    CalibrationError, Interreflection, LampFound, PHOTOMETRY, PHOTOMETRY_VERSION, Photometry, SeenPart,
    Stray, check_rig, file, rig_hash,
};
use crate::instrument::rig::Rig;
use crate::plan::Exposure;
use crate::store::{RawStore, Segment};

/// Share of saturated values in frames of the standard that is too much.
const SATURATED: f64 = 0.002;

/// What the response of pixels is taken for where too few show it, relative: data sheets by EMVA 1288 have 0.2 to 1 %.
const MOST_PRNU: f64 = 0.01;

/// The most that light and throughput may leave of what the standard shows, relative, RMS.
const WORST_RESIDUAL: f64 = 0.015;

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
    let captured = Captured::read(dir, &views, &raw, &rig)?;
    let mut series = captured.series();
    let (linear, flicker) = camera_of(&mut series, &rig)?;
    let (stray_light, monitor) = stray::stray(dir, &views.rig, &views.stray, &linear)?;
    let lamp = LampFound { flicker, monitor };
    let other = OtherLight {
        stray: &stray_light,
        lamp: &lamp,
    };
    let (projector_response, black_light) = captured.levels(&linear, &series);

    let standard =
        crate::brdf::sample::parse(&views.standard).map_err(crate::virtual_rig::setup::SetupError::from)?;
    let (mut all, mut frames) = (Vec::new(), Vec::new());
    let blacks: Vec<Black> = (0..views.stands.len())
        .map(|stand| captured.black(Shows::Black(stand), &linear))
        .collect();
    for (stand, black) in blacks.iter().enumerate() {
        let (seen, shown) = captured.standard_at(stand, &linear, black, other, standard.as_ref())?;
        all.push(seen);
        frames.push(shown);
    }
    check_saturated(&all)?;
    let (fields, seen_part) = explain(&mut all, &frames)?;
    let prnu = captured.prnu(&all, &linear, &Layout::of(&rig));
    let mut camera = linear.sensor;
    (camera.prnu, camera.prnu_is_assumed) = (prnu.unwrap_or(MOST_PRNU), prnu.is_none());
    let own = interreflected(standard.as_ref());
    let interreflection = match &views.second_standard {
        None => None,
        Some(spec) => {
            Some(captured.interreflection(spec, &linear, other, &all[0], (own, standard_uncertainty))?)
        }
    };
    let photometry = Photometry {
        version: PHOTOMETRY_VERSION,
        sights: all.iter().map(Seen::sight).collect(),
        rig_sha256: rig_hash(&views.rig),
        standard: views.standard.clone(),
        standard_uncertainty,
        camera,
        contrast: contrast::contrast(
            &all[0],
            (&rig, views.times_s[0]),
            &fields,
            standard.as_ref(),
            &black_light,
        ),
        gamma: gamma(&projector_response),
        projector_response,
        field_residual: fields.residual_beside(&camera.of_image(&rig.camera.binned)),
        // The standard's own interreflection is no property of the instrument.
        sensitivity: fields
            .sensitivity
            .into_iter()
            .map(|k| k / (1.0 + own * interreflection.map_or(0.0, |found| found.share)))
            .collect(),
        throughput: fields.throughput,
        intensity: fields.intensity,
        field_uncertainty: fields.uncertainty,
        interreflection,
        stray: stray_light,
        lamp,
        seen_part,
    };
    super::check(&photometry)?;
    let path = dir.join(PHOTOMETRY);
    photometry.check(&path, "")?;
    file::write(&path, &photometry)?;
    Ok(photometry)
}

/// All frames of the views, by what they show.
struct Captured<'a> {
    views: &'a Views,
    /// What each segment shows.
    shows: Vec<Shows>,
    segments: Vec<Segment>,
    /// Digital numbers of a frame.
    length: usize,
}

impl<'a> Captured<'a> {
    /// The frames in `raw` of the `views` in `dir`; `rig` has the camera's image as captured.
    fn read(dir: &Path, views: &'a Views, raw: &RawStore, rig: &Rig) -> Result<Self, CalibrateError> {
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
        Ok(Self {
            views,
            shows,
            segments,
            length: format.len(),
        })
    }

    /// The frames of the segment that shows what is `wanted`; none if there is none.
    fn frames(&self, wanted: Shows) -> Vec<&[u16]> {
        let at = self.shows.iter().position(|shows| *shows == wanted);
        at.map(|at| self.segments[at].frames.chunks_exact(self.length).collect())
            .unwrap_or_default()
    }

    /// What the black segment shows that is `wanted`.
    fn black(&self, wanted: Shows, linear: &Linear) -> Black {
        let (watched, others): (Vec<_>, Vec<_>) = self
            .frames(wanted)
            .into_iter()
            .enumerate()
            .partition(|(exposure, _)| Exposure::black(*exposure) == Exposure::Black);
        let mean = |frames: Vec<(usize, &[u16])>| {
            let frames: Vec<&[u16]> = frames.into_iter().map(|(_, frame)| frame).collect();
            linear.mean(&frames)
        };
        Black {
            counts: [watched.len(), others.len()],
            light: mean(watched),
            unwatched: mean(others),
        }
    }

    /// The frames of each exposure time of the series.
    fn series(&self) -> Vec<Times<'_>> {
        (0..self.views.times_s.len())
            .map(|index| {
                let mut lit = self.frames(Shows::Series(index));
                let black = lit.split_off(SEGMENT / 2);
                Times {
                    exposure_s: self.views.times_s[index],
                    lit,
                    black,
                    dark: self.frames(Shows::Dark(index)),
                    lamp: 1.0,
                }
            })
            .collect()
    }

    /// Light of each level, relative to the last, and what a black pattern adds to the darkness at the shortest time of the
    /// `series`, linear digital numbers.
    fn levels(&self, linear: &Linear, series: &[Times]) -> (Vec<f64>, Vec<f64>) {
        let levels = self.frames(Shows::Levels);
        // Of level 0, which nothing else is beside.
        let black = linear.mean(&levels[..1]);
        let dark = linear.mean(&series[0].dark);
        let light = black.iter().zip(dark).map(|(black, dark)| black - dark);
        (linear.levels(&levels, &black), light.collect())
    }

    /// What was seen of the `standard` at the stand of this index, and the frames of it; `black` is its black frame, linear.
    fn standard_at<'b>(
        &'b self,
        stand: usize,
        linear: &'b Linear,
        black: &'b Black,
        other: OtherLight<'_>,
        standard: &'b dyn Sample,
    ) -> Result<(Seen<'b>, Frames<'b>), CalibrateError> {
        let mut seen = Seen::new(self.views, stand)?;
        let removal = self.removal(stand, other)?;
        seen.compare_lamp(&removal, black)?;
        let black = black.light.as_slice();
        let mut lit = Vec::new();
        for wanted in self.shows.iter().copied() {
            let Shows::Directions(of, first) = wanted else {
                continue;
            };
            if of == stand {
                let frames = seen.lit(first, &self.frames(wanted), linear, black, &removal);
                seen.add(first, &frames, linear, black, standard, &self.views.standard)?;
                lit.extend(frames);
            }
        }
        let frames = Frames {
            linear,
            black,
            lit,
            standard,
        };
        Ok((seen, frames))
    }

    /// Standard deviation of the response over the sensor's pixels, from all that was `seen` of the standard; `None` if that is
    /// too little.
    fn prnu(&self, seen: &[Seen], linear: &Linear, layout: &Layout) -> Option<f64> {
        // Of the exposure time of the standard.
        let dark = self.frames(Shows::Dark(self.views.times_s.len() - 1));
        let lit = seen.iter().enumerate().map(|(stand, seen)| {
            let is_of_it = |shows: &Shows| match shows {
                Shows::Black(of) | Shows::Directions(of, _) => *of == stand,
                _ => false,
            };
            let wanted = self.shows.iter().copied().filter(is_of_it);
            let frames: Vec<&[u16]> = wanted.flat_map(|shows| self.frames(shows)).collect();
            let half = |first: usize| {
                let [light, dark] = [&frames, &dark].map(|frames| linear.mean(&every_second(frames, first)));
                light
                    .into_iter()
                    .zip(dark)
                    .map(|(light, dark)| light - dark)
                    .collect()
            };
            pixels::Lit {
                is_whole: seen.whole_pixels(),
                halves: [half(0), half(1)],
            }
        });
        pixels::response(&lit.collect::<Vec<_>>(), layout)
    }

    /// How frames of the standard at the stand of this index lose `other` light.
    fn removal(&self, stand: usize, other: OtherLight) -> Result<Removal, CalibrateError> {
        let side = self.views.stray.watching_side;
        Ok(Removal::of(
            other.stray,
            other.lamp,
            side,
            &self.views.rig_of(stand)?,
        ))
    }

    /// The interreflection from the second standard, named `spec`, beside the `first`, which has its `own` (see
    /// [`interreflected`]); both are known to a relative standard uncertainty.
    fn interreflection(
        &self,
        spec: &str,
        linear: &Linear,
        other: OtherLight,
        first: &Seen,
        (own, standard_uncertainty): (f64, f64),
    ) -> Result<Interreflection, CalibrateError> {
        let second = crate::brdf::sample::parse(spec).map_err(crate::virtual_rig::setup::SetupError::from)?;
        let black = self.black(Shows::SecondBlack, linear);
        let removal = self.removal(0, other)?;
        let mut other = Seen::new(self.views, 0)?;
        other.compare_lamp(&removal, &black)?;
        let black = black.light.as_slice();
        other.judged = first.judged.clone();
        for wanted in self.shows.iter().copied() {
            if let Shows::SecondDirections(place) = wanted {
                let frames = other.lit(place, &self.frames(wanted), linear, black, &removal);
                other.add(place, &frames, linear, black, second.as_ref(), spec)?;
            }
        }
        interreflection(
            first,
            &other,
            (own, interreflected(second.as_ref())),
            standard_uncertainty,
        )
    }
}

/// The camera of `rig` by the `series`, which then know how bright the lamp was, and by how much it flickers.
fn camera_of(series: &mut [Times], rig: &Rig) -> Result<(Linear, f64), CalibrateError> {
    let saturation_dn = f64::from(rig.saturation_dn());
    let mut found = camera(series, saturation_dn, &Layout::of(rig))?;
    let linear = Linear::new(&found, rig);
    let flicker = flicker(series, found.dark_dn, linear.camera.gain_e_per_dn);
    // What tells the lamp's light has to be linear itself, and how linear the camera is shows beside it.
    let lamp = linear.lamp(series, &dark_of(rig), rig.camera.channels as usize, flicker);
    for (times, lamp) in series.iter_mut().zip(lamp) {
        times.lamp = lamp;
    }
    set_linearity(&mut found, series, saturation_dn)?;
    Ok((Linear::new(&found, rig), flicker))
}

/// Refuses frames of the standard that are saturated in more than [`SATURATED`] of their values.
fn check_saturated(all: &[Seen]) -> Result<(), CalibrateError> {
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
    Ok(())
}

/// What explains all that was `seen` in the `frames`: light and throughput, and what part of the standard is seen.
///
/// # Errors
/// [`CalibrateError::Views`] if they leave more than [`WORST_RESIDUAL`], or nothing does.
fn explain(
    seen: &mut [Seen],
    frames: &[Frames],
) -> Result<(rank_one::Fields, Option<SeenPart>), CalibrateError> {
    let (fields, part) = fit_whole(seen, frames).map_err(|why| match why {
        NoFields::TooLittle => CalibrateError::Views {
            expected: "frames of the standard that determine light and throughput".to_owned(),
            found: "too little of the image lit".to_owned(),
            advice: "is the standard in place, and lit?",
        },
        NoFields::Unsettled => CalibrateError::Views {
            expected: "frames of the standard that tell where it stands".to_owned(),
            found: "another place in every turn of the fit".to_owned(),
            advice: "is the standard flat, in the middle of the holder and at its height?",
        },
    })?;
    if fields.residual <= WORST_RESIDUAL {
        return Ok((fields, part));
    }
    Err(CalibrateError::Views {
        expected: format!(
            "light and throughput that explain what the standard shows to {:.1} %",
            100.0 * WORST_RESIDUAL
        ),
        found: format!("{:.1} % that they do not", 100.0 * fields.residual),
        advice: "is the standard flat, in the middle of the holder and at its height? Are the pupils those of the rig file \
                 (pupil_m)?",
    })
}

/// Mean black frames of a stand, linear digital numbers above the dark level.
struct Black {
    /// With what watches the lamp, as in all other frames, and without.
    light: Vec<f64>,
    unwatched: Vec<f64>,
    /// Frames of both.
    counts: [usize; 2],
}

/// What of the light in frames is not the spot's, or not the lamp's as it was.
#[derive(Clone, Copy)]
struct OtherLight<'a> {
    stray: &'a Stray,
    lamp: &'a LampFound,
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
