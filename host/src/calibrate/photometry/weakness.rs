//! What limits an instrument most, and what to do against it.
//!
//! # Design
//! Each flaw that calibration found leaves something of a white matte sample's BRDF, relative (k = 1): that is one scale for all, and
//! the largest is what to mend first. What part of the sample is not seen costs directions instead. Noise is that of one exposure
//! which fills the camera, with the rig's spot at 45°.

use std::f64::consts::{FRAC_PI_4, PI};

use glam::DVec3;
use serde::Serialize;

use crate::hemisphere::direction::from_degrees;
use crate::instrument::calibration::{Photometry, SeenPart, Shares};
use crate::instrument::optics::{SampleFrame, View, cone_sr};
use crate::instrument::rig::{Rig, RigError};

/// Share of the full well that an exposure fills.
const FULL: f64 = 0.8;
/// Polar angles and azimuths of the directions of which pairs are looked at, degrees.
const THETAS_DEG: [f64; 4] = [20.0, 40.0, 60.0, 75.0];
const AZIMUTHS: u32 = 8;
/// Pixels a side of the image that they are looked at in, and of that of a measurement.
const LOOKED_PX: u32 = 48;
const IMAGE_PX: u32 = 96;

/// A flaw, and what it does.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Weakness {
    /// What is weak.
    pub name: &'static str,
    /// What it leaves of the BRDF of a white matte sample, relative (k = 1).
    pub left: f64,
    /// What to do or buy against it.
    pub remedy: String,
}

/// How the standard stood, and what that costs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Height {
    /// Height above where the rig file has it, along its normal, and its standard uncertainty (k = 1), metres.
    pub height_m: f64,
    /// See [`Height::height_m`].
    pub standard_uncertainty_m: f64,
    /// Share of the pairs of directions up to 75° that have no value for it.
    pub lost: f64,
}

/// What `found` on `rig` (its camera at full size) is weak in, the worst first.
///
/// # Errors
/// [`RigError`] if the rig has no image of the usual size.
pub fn weaknesses(found: &Photometry, rig: &Rig) -> Result<Vec<Weakness>, RigError> {
    let image = rig.with_image_size(IMAGE_PX.min(rig.camera.lens.width_px))?;
    let camera = found.camera.of_image(&image.camera.binned);
    let weakness = |name, left, remedy: &str| Weakness {
        name,
        left,
        remedy: remedy.to_owned(),
    };
    let mut all = vec![
        weakness(
            "standard",
            // What the polar angles of light and view make of it comes to what all directions share.
            found.standards[0]
                .standard_uncertainty
                .hypot(2_f64.sqrt() * found.standards[0].angular.each),
            "a reflectance standard with a closer certificate, one that says how it reflects by angle",
        ),
        weakness(
            "light and throughput",
            found.field_residual.hypot(found.field_uncertainty),
            "a larger --image-size of `calibrate photometry`; a flat and even standard",
        ),
        weakness(
            "glare",
            found.stray.glare() * found.stray.halo_uncertainty,
            "clean mirror and lenses, a hood against light from aside",
        ),
        weakness(
            "lamp",
            found.lamp.since_uncertainty().hypot(found.lamp_uncertainty),
            "an LED with a regulated current; black cloth that shows direct light to watch it by",
        ),
        weakness(
            "linearity of the camera",
            found.camera.linearity_residual,
            "a camera that is linear up to its full well, or shorter exposures",
        ),
        weakness(
            "response of the camera's pixels",
            camera.prnu,
            "a smaller --image-size, of which each pixel has more of the sensor's",
        ),
    ];
    if let Some(ghost) = &found.stray.ghost {
        all.push(weakness(
            "ghost of the splitter",
            ghost.standard_uncertainty,
            "a beam splitter with an anti-reflection coating, or a pellicle",
        ));
    }
    if let Some(back) = &found.interreflection {
        all.push(weakness(
            "interreflection",
            back.standard_uncertainty,
            "a darker second standard",
        ));
    }
    let noise = Noise::of(found, &image);
    all.push(Weakness {
        name: "noise beside black light",
        left: noise.relative(1.0),
        remedy: match found.contrast {
            Some(contrast) => format!(
                "a wider --spot, or a projector of more than {contrast:.0} : 1: of twice that it were {:.2} %",
                100.0 * noise.relative(2.0)
            ),
            None => "a wider --spot, a brighter projector or more --brackets".to_owned(),
        },
    });
    all.sort_by(|a, b| b.left.total_cmp(&a.left));
    Ok(all)
}

/// Noise of one exposure.
struct Noise {
    /// Light of all black pixels over that of the spot.
    black: f64,
    /// Electrons that an exposure fills a pixel of the image with.
    full_e: f64,
}

impl Noise {
    fn of(found: &Photometry, image: &Rig) -> Self {
        // Radiance is the same all over the hemisphere: its irradiance is π, that of a spot its solid angle × cosine.
        let spot = cone_sr(image.light.spot_deg) * FRAC_PI_4.cos();
        Self {
            black: found.contrast.map_or(0.0, |contrast| PI / contrast / spot),
            full_e: FULL * image.camera.full_well_e,
        }
    }

    /// Relative noise with a projector of so many times the contrast.
    fn relative(&self, contrast: f64) -> f64 {
        // Of what fills the camera only the spot's part says anything.
        (1.0 + self.black / contrast) / self.full_e.sqrt()
    }
}

/// How the standard stood without a tilt, as calibration `found` it on `rig` (its camera at full size); `None` if it did not ask.
///
/// # Errors
/// [`RigError`] if the rig has no image of the size in which that is looked at.
pub fn height(found: &Photometry, rig: &Rig) -> Result<Option<Height>, RigError> {
    let Some(part) = &found.seen_part else {
        return Ok(None);
    };
    let normal = SampleFrame::of(&rig.sample).to_mirror(DVec3::Z);
    let along = |axis: usize| -> f64 {
        (0..3)
            .map(|other| part.covariance[axis][other] * normal[other])
            .sum()
    };
    let variance: f64 = (0..3).map(|axis| normal[axis] * along(axis)).sum();
    Ok(Some(Height {
        height_m: DVec3::from_array(part.offset_m).dot(normal),
        standard_uncertainty_m: variance.max(0.0).sqrt(),
        lost: lost(
            part,
            &rig.with_image_size(LOOKED_PX.min(rig.camera.lens.width_px))?,
        ),
    }))
}

/// Share of the pairs of directions of which too little is seen and lit, or nobody knows how much.
fn lost(part: &SeenPart, rig: &Rig) -> f64 {
    let directions = || {
        let azimuths = |theta_deg: f64| {
            (0..AZIMUTHS)
                .map(move |turn| from_degrees(theta_deg, f64::from(turn) * 360.0 / f64::from(AZIMUTHS)))
        };
        THETAS_DEG.into_iter().flat_map(azimuths)
    };
    let camera = View::camera(rig);
    let (width_px, _) = camera.size_px();
    let seen: Vec<usize> = directions()
        .filter_map(|w| camera.pixel(w).ok())
        .map(|at| at.y as usize * width_px + at.x as usize)
        .collect();
    let lit: Vec<Option<DVec3>> = directions().map(Some).collect();
    let shares = Shares::new(part, rig, &lit);
    let pairs = || (0..lit.len()).flat_map(|lit| seen.iter().map(move |seen| (lit, *seen)));
    let known = pairs().filter(|(lit, seen)| shares.share(*lit, *seen).known().is_some());
    1.0 - known.count() as f64 / pairs().count().max(1) as f64
}
