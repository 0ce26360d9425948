//! The views of a geometric calibration: what is shown and taken.

use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::base::progress::Progress;
use crate::calibrate::{CalibrateError, check_image_size, create_raw, file, open_raw, segment_of};
use crate::capture::Tally;
use crate::capture::pilot::TestExposures;
use crate::hemisphere::direction::from_degrees;
use crate::instrument::calibration::geometry::COMMAND;
use crate::instrument::optics::View;
use crate::instrument::rig::Rig;
use crate::plan;
use crate::plan::pattern::{BitPattern, PatternMaker};
use crate::plan::schedule::{SHORTEST_EXPOSURE_S, Timing};
use crate::plan::stripes::Stripes;
use crate::store::whole_file::FileError;
use crate::store::{RawLayout, RawStore};
use crate::virtual_rig::setup::{SetupError, World};
use crate::virtual_rig::{FlatMirror, Held};

/// Name of the raw frames.
pub(super) const RAW: &str = "geometry.raw.zarr";
/// Name of the file that says what the frames are.
const VIEWS: &str = crate::instrument::calibration::VIEWS[0];
/// Share of the light that the flat mirror of the virtual rig reflects: black glass.
const REFLECTANCE: f64 = 0.04;
/// What the diffuse standard of the virtual rig is.
const STANDARD: &str = "lambert:0.5";
/// Opening of the cone that lights the diffuse standard, degrees.
const SPOT_DEG: f64 = 8.0;

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// The nominal rig.
    pub rig: Rig,
    /// Tilts of the flat mirror against the sample's normal and the azimuths towards which it is tilted, sample frame,
    /// degrees.
    pub tilts: Vec<[f64; 2]>,
    /// Pixels a side of the camera's image.
    pub image_size: u32,
    /// Standard uncertainty (k = 1) of each tilt, in its plane and across it, degrees.
    pub tilt_uncertainty_deg: f64,
}

/// What was captured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Views {
    /// The nominal rig.
    pub rig: Rig,
    /// As in [`Request::tilts`].
    pub tilts: Vec<[f64; 2]>,
    /// As in [`Request::image_size`].
    pub image_size: u32,
    /// As in [`Request::tilt_uncertainty_deg`].
    pub tilt_uncertainty_deg: f64,
}

/// What is said of captures when they are fitted; what is not is as when they were made.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Said {
    /// As in [`Request::tilts`]: how the mirror stood, view by view.
    pub tilts: Option<Vec<[f64; 2]>>,
    /// As in [`Request::tilt_uncertainty_deg`].
    pub tilt_uncertainty_deg: Option<f64>,
    /// Pixels a side of the image.
    pub image_size: Option<u32>,
}

impl Said {
    /// Puts what is said in place of what `views` say.
    ///
    /// # Errors
    /// [`CalibrateError`] if something is said that the captures are not.
    pub(super) fn apply(&self, views: &mut Views) -> Result<(), CalibrateError> {
        if let Some(tilts) = &self.tilts {
            if tilts.len() != views.tilts.len() {
                let count = |tilts: &[[f64; 2]]| format!("{} of them", tilts.len());
                return Err(CalibrateError::otherwise(
                    "--tilts",
                    count(&views.tilts),
                    count(tilts),
                ));
            }
            check_tilts(tilts)?;
            views.tilts.clone_from(tilts);
        }
        check_image_size(views.image_size, self.image_size)?;
        views.tilt_uncertainty_deg = self.tilt_uncertainty_deg.unwrap_or(views.tilt_uncertainty_deg);
        Ok(())
    }
}

impl Views {
    /// What `dir` holds, with the frames that were captured of it.
    pub(super) fn read(dir: &Path) -> Result<(Self, RawStore), CalibrateError> {
        let views = file::read(&dir.join(VIEWS), COMMAND)?;
        Ok((views, open_raw(dir, RAW, VIEWS)?))
    }

    /// The nominal rig with the camera's image as captured.
    pub(super) fn scaled(&self) -> Result<Rig, CalibrateError> {
        Ok(self.rig.with_image_size(self.image_size)?)
    }

    /// The patterns of a view of the flat mirror.
    pub(super) fn stripes(&self) -> Stripes {
        let lens = &self.rig.projector.lens;
        Stripes::new(lens.width_px as usize, lens.height_px as usize)
    }

    /// The flat mirror of each view: on the virtual rig, of black glass.
    fn mirrors(&self) -> Vec<FlatMirror> {
        // Behind a neutral filter where its image would fill more than a quarter of the well in the shortest exposures.
        let electrons = self.rig.projector.irradiance * self.rig.sensitivity_e() * 2.0 * SHORTEST_EXPOSURE_S;
        let reflectance = REFLECTANCE.min(self.rig.camera.full_well_e / 4.0 / electrons);
        let of = |&[tilt_deg, azimuth_deg]: &[f64; 2]| FlatMirror {
            normal: from_degrees(tilt_deg, azimuth_deg),
            reflectance,
        };
        self.tilts.iter().map(of).collect()
    }

    /// Whether `dir` holds captures of views.
    #[must_use]
    pub fn exist(dir: &Path) -> bool {
        dir.join(VIEWS).is_file()
    }
}

/// Captures the views of `request` in `world` into the directory `dir`: per tilt one segment of structured light, then one of the
/// diffuse standard, lit and dark.
///
/// # Errors
/// [`CalibrateError`].
pub fn capture(
    request: &Request,
    dir: &Path,
    world: &World,
    progress: &dyn Progress,
) -> Result<(), CalibrateError> {
    check_tilts(&request.tilts)?;
    let views = Views {
        rig: request.rig.clone(),
        tilts: request.tilts.clone(),
        image_size: request.image_size,
        tilt_uncertainty_deg: request.tilt_uncertainty_deg,
    };
    let rig = views.scaled()?;
    let stripes = views.stripes();
    std::fs::create_dir_all(dir).map_err(|source| FileError::at(dir, source))?;
    let format = rig.frame_format();
    let layout = RawLayout {
        exposures: stripes.len() * views.tilts.len() + 2,
        segment: stripes.len(),
        height: format.height_px,
        width: format.width_px,
        channels: format.channels,
        bits: format.bits,
        clock_hz: 0,
    };
    let mut raw: Option<RawStore> = None;
    let text = file::text(&views);
    let spot = PatternMaker::new(View::projector(&rig), SPOT_DEG, 1.0)
        .lit_set(lit_direction(&rig))
        .map(|lit| lit.pixels)
        .unwrap_or_default();
    let mut held: Vec<Held> = views.mirrors().into_iter().map(Held::Mirror).collect();
    held.push(Held::Sample(Arc::from(
        crate::brdf::sample::parse(STANDARD).map_err(SetupError::from)?,
    )));
    progress.begin("calibration views", layout.exposures, "exposures");
    let mut done = 0;
    for (index, held) in held.into_iter().enumerate() {
        let is_mirror = matches!(held, Held::Mirror(_));
        let mut instrument = world.open_held(&rig, held, None)?;
        let draw = |exposure: usize, image: &mut BitPattern| match exposure {
            exposure if is_mirror => stripes.draw(exposure, image),
            0 => image.light(&spot),
            _ => {}
        };
        // The brightest pattern decides how long all are exposed.
        let (width_px, height_px) = instrument.projector.size_px();
        let mut image = BitPattern::black(width_px, height_px);
        draw(0, &mut image);
        let tests = TestExposures::take(&rig, &[image.lit()], &mut instrument)?;
        if tests.is_too_bright {
            return Err(CalibrateError::Views {
                expected: format!("a target that {} ms do not saturate", SHORTEST_EXPOSURE_S * 1e3),
                found: "one that they do".to_owned(),
                advice: "stop the projector or the camera down and state it in the rig file \
                         (light.full_scale_f_sr)",
            });
        }
        let exposure_s = tests.longest_s.clamp(SHORTEST_EXPOSURE_S, 1.0);
        let timing = Timing::patient(&rig, exposure_s).map_err(plan::PlanError::from)?;
        let raw = match &mut raw {
            Some(raw) => raw,
            // Now the clock is known.
            none => none.insert(create_raw(&dir.join(RAW), layout, &instrument, VIEWS, &text)?),
        };
        let count = raw.segment_range(index).len();
        let report = |taken: usize| progress.reach(done + taken);
        let mut tally = Tally::default();
        let shots = instrument.take(count, &[timing], draw, &mut tally, report)?;
        raw.write_segment(index, &segment_of(shots, tally, exposure_s))?;
        done += count;
    }
    progress.end();
    file::write(&dir.join(VIEWS), &views)?;
    Ok(())
}

/// Refuses tilts at which the flat mirror would stand twice: the same evidence counts once.
fn check_tilts(tilts: &[[f64; 2]]) -> Result<(), CalibrateError> {
    for (index, [tilt_deg, azimuth_deg]) in tilts.iter().enumerate() {
        let normal = from_degrees(*tilt_deg, *azimuth_deg);
        let mut before = tilts[..index]
            .iter()
            .map(|[tilt_deg, azimuth_deg]| from_degrees(*tilt_deg, *azimuth_deg));
        if before.any(|other| (other - normal).length() < 1e-9) {
            return Err(CalibrateError::Views {
                expected: "tilts of the flat mirror that differ from each other".to_owned(),
                found: format!("{tilt_deg}:{azimuth_deg} again"),
                advice: "give each of --tilts once, in other azimuths",
            });
        }
    }
    Ok(())
}

/// A direction that the projector can light: the first found beside the normal.
fn lit_direction(rig: &Rig) -> glam::DVec3 {
    let projector = View::projector(rig);
    let directions =
        (1..8).flat_map(|ring| (0..6).map(move |turn| (10.0 * f64::from(ring), 60.0 * f64::from(turn))));
    directions
        .map(|(theta_deg, phi_deg)| from_degrees(theta_deg, phi_deg))
        // Not at an edge, which the real rig may have elsewhere.
        .find(|w| {
            let clearance_rad = 2.0 * SPOT_DEG.to_radians();
            let at = projector.pixel(*w);
            at.is_ok_and(|at| projector.edge_within(at.x, at.y, clearance_rad).is_none())
        })
        .unwrap_or(glam::DVec3::Z)
}
