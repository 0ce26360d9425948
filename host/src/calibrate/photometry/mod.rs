//! Calibration of the photometry: camera, projector's response, light, throughput, interreflection.
//!
//! # Design
//! | file | holds |
//! |---|---|
//! | `capture` | the views: what is shown and taken |
//! | `capturing` | how they are taken, target by target |
//! | `by_hand` | views whose targets somebody puts in |
//! | `looks` | which target stands there, told by a few test exposures |
//! | `captured` | the frames of the views, and what each is for |
//! | `frames` | frames of the standard: what came other ways, and the lamp |
//! | `in_holder` | what is put into the holder |
//! | `lights` | the incident directions of the views |
//! | `exposure` | how long they are exposed, and how much light there is |
//! | `camera` | dark level, photon transfer, linearity |
//! | `knee` | up to where the camera is linear |
//! | `linear` | numbers as a linear camera would give them, and what they say of the lamp |
//! | `field` | smooth fields over an image |
//! | `rank_one` | light and throughput from the standard |
//! | `standards` | what is known of the standards |
//! | `interreflection` | what returns onto the sample, from two standards |
//! | `crosstalk` | what the camera's colours show of each other |
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

mod again;
mod by_hand;
mod camera;
mod capture;
mod captured;
mod capturing;
mod contrast;
mod crosstalk;
mod exposure;
mod frames;
mod in_holder;
mod interreflection;
mod knee;
mod linear;
mod looks;
mod pixels;
mod rank_one;
mod share;
mod standards;
mod stray;
#[cfg(test)]
mod tests;
mod turns;
mod weakness;

use std::path::Path;

pub use again::{NONE, Said};
pub use by_hand::ByHand;
pub use capture::{Request, Views};
pub use capturing::capture;
pub use standards::{Trust, standards};
pub use weakness::{Height, Weakness, height, weaknesses};

use camera::{Times, camera, flicker, set_linearity};
use capture::Shows;
use captured::{Black, Captured, OtherLight};
use crosstalk::AsSeen;
use frames::Frames;
use interreflection::interreflected;
use linear::Linear;
use pixels::Layout;
use rank_one::Seen;
use turns::{NoFields, fit_whole};

use super::{CalibrateError, RIG};
use crate::instrument::calibration::stray::dark_of;
use crate::instrument::calibration::{
    LampFound, PHOTOMETRY, PHOTOMETRY_VERSION, Photometry, SeenPart, check_rig, file, rig_hash,
};
use crate::instrument::rig::Rig;

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

/// Fits the photometry to the captures in `dir`, of which that is `said`, and writes what was found beside them; `trust` says what
/// standards without a certificate are known to, and when they were captured.
///
/// # Errors
/// [`CalibrateError`].
pub fn calibrate(dir: &Path, said: &Said, trust: &Trust) -> Result<Photometry, CalibrateError> {
    let (mut views, raw) = Views::read(dir)?;
    let second_standard = said.apply(&mut views)?;
    let calibrated = Rig::load(&dir.join(RIG).display().to_string())?;
    check_rig(&dir.join(capture::RAW), &calibrated, &rig_hash(&views.rig))?;
    let rig = views.rig_of(0)?;
    let known = standards(
        (&views.standard, second_standard.as_deref()),
        rig.channels(),
        trust,
    )?;
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

    let mut standard = AsSeen::new(&views.standard, None)?;
    let crosstalk = captured.crosstalk(&linear, &standard, flicker)?;
    standard.crosstalk = crosstalk;
    let (mut all, mut frames) = (Vec::new(), Vec::new());
    let blacks: Vec<Black> = (0..views.stands.len())
        .map(|stand| captured.black(Shows::Black(stand), &linear))
        .collect();
    for (stand, black) in blacks.iter().enumerate() {
        let (seen, shown) = captured.standard_at(stand, &linear, black, other, &standard)?;
        all.push(seen);
        frames.push(shown);
    }
    check_saturated(&all)?;
    let (fields, seen_part) = explain(&mut all, &frames)?;
    let prnu = captured.prnu(&all, &linear, &Layout::of(&rig));
    let mut camera = linear.sensor;
    (camera.prnu, camera.prnu_is_assumed) = (prnu.unwrap_or(MOST_PRNU), prnu.is_none());
    let own = interreflected(&standard);
    let interreflection = match &second_standard {
        None => None,
        Some(spec) => {
            let second = AsSeen::new(spec, crosstalk)?;
            let known = (own, [0, 1].map(|number| known[number].standard_uncertainty));
            Some(captured.interreflection((&second, spec), &linear, other, &all[0], known)?)
        }
    };
    // The standard's own interreflection is no property of the instrument.
    let without = 1.0 + own * interreflection.map_or(0.0, |found| found.share);
    let photometry = Photometry {
        version: PHOTOMETRY_VERSION,
        sights: all.iter().map(Seen::sight).collect(),
        rig_sha256: rig_hash(&views.rig),
        standards: known,
        camera,
        crosstalk,
        contrast: contrast::contrast(
            &all[0],
            (&rig, views.times_s[0]),
            &fields,
            &standard,
            &black_light,
        ),
        gamma: gamma(&projector_response),
        projector_response,
        field_residual: fields.residual_beside(&camera.of_image(&rig.camera.binned)),
        sensitivity: fields.sensitivity.into_iter().map(|k| k / without).collect(),
        throughput: fields.throughput,
        intensity: fields.intensity,
        lamp_uncertainty: fields.by_lamp,
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

/// The camera of `rig` by the `series`, which then know how bright the lamp was, and by how much it flickers.
fn camera_of(series: &mut [Times], rig: &Rig) -> Result<(Linear, f64), CalibrateError> {
    let saturation_dn = f64::from(rig.saturation_dn());
    let mut found = camera(series, saturation_dn, &Layout::of(rig))?;
    let linear = Linear::new(&found, rig);
    let flicker = flicker(series, found.dark_dn);
    // What tells the lamp's light has to be linear itself, and how linear the camera is shows beside it.
    let bands = (rig.channels(), rig.shown_bands());
    let lamp = linear.lamp(series, &dark_of(rig), bands, flicker);
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
                 (pupil_m)? Is --image-size enough, 48 pixels or more?",
    })
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
