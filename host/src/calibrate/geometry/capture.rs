//! The views of a geometric calibration: what is shown and taken.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::by_hand::check_whole;
use super::mask::Mask;
use crate::base::progress::Progress;
use crate::calibrate::by_hand::{Bench, VirtualBench, black_mirror};
use crate::calibrate::{
    CalibrateError, check_clock, check_image_size, create_raw, discard_unfinished, file, open_raw, segment_of,
};
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
use crate::store::whole_file::{FileError, write_whole};
use crate::store::{RawLayout, RawStore, Segment};
use crate::virtual_rig::Held;
use crate::virtual_rig::setup::{SetupError, World};

/// Name of the raw frames.
pub(super) const RAW: &str = "geometry.raw.zarr";
/// Name of the file that says what the frames are.
pub(super) const VIEWS: &str = crate::instrument::calibration::VIEWS[0];
/// What the diffuse standard of the virtual rig is.
const STANDARD: &str = "lambert:0.5";
/// Opening of the cone that lights the diffuse standard, degrees.
pub(super) const SPOT_DEG: f64 = 8.0;

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
    /// Where something is before the mirror.
    pub mask: Option<Mask>,
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
        check_whole(&views, dir)?;
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
    let mut capturing = Capturing::new(request.views()?, dir)?;
    discard_unfinished(dir, &[RAW], VIEWS)?;
    let mut bench = VirtualBench::new(world);
    progress.begin("calibration views", capturing.layout.exposures, "exposures");
    let mut done = 0;
    for view in 0..capturing.count() {
        let segment = capturing.take(view, &mut bench, &|taken| progress.reach(done + taken))?;
        done += segment.records.len();
        capturing.write(view, &segment)?;
    }
    progress.end();
    write_whole(&dir.join(VIEWS), capturing.text.as_bytes())?;
    Ok(())
}

impl Request {
    /// The views that are asked for.
    pub(super) fn views(&self) -> Result<Views, CalibrateError> {
        check_tilts(&self.tilts)?;
        Ok(Views {
            rig: self.rig.clone(),
            tilts: self.tilts.clone(),
            image_size: self.image_size,
            tilt_uncertainty_deg: self.tilt_uncertainty_deg,
        })
    }
}

/// Views that are being captured.
pub(super) struct Capturing {
    pub(super) views: Views,
    /// The nominal rig with the camera's image as captured.
    pub(super) rig: Rig,
    pub(super) dir: PathBuf,
    /// The views, as the file of them says.
    pub(super) text: String,
    layout: RawLayout,
    stripes: Stripes,
    /// What lights the diffuse standard.
    spot: Vec<u32>,
    pub(super) raw: Option<RawStore>,
    /// Ticks per second of the trigger box.
    clock_hz: u32,
}

impl Capturing {
    /// Of `views`, into `dir`.
    pub(super) fn new(views: Views, dir: &Path) -> Result<Self, CalibrateError> {
        let rig = views.scaled()?;
        let stripes = views.stripes();
        std::fs::create_dir_all(dir).map_err(|source| FileError::at(dir, source))?;
        let format = rig.frame_format();
        Ok(Self {
            layout: RawLayout {
                exposures: stripes.len() * views.tilts.len() + 2,
                segment: stripes.len(),
                height: format.height_px,
                width: format.width_px,
                channels: format.channels,
                bits: format.bits,
                clock_hz: 0,
            },
            spot: PatternMaker::new(View::projector(&rig), SPOT_DEG, 1.0)
                .lit_set(lit_direction(&rig))
                .map(|lit| lit.pixels)
                .unwrap_or_default(),
            text: file::text(&views),
            dir: dir.to_owned(),
            stripes,
            rig,
            views,
            raw: None,
            clock_hz: 0,
        })
    }

    /// How many views there are: those of the flat mirror, and that of the diffuse standard.
    pub(super) fn count(&self) -> usize {
        self.views.tilts.len() + 1
    }

    /// Exposures of the view of this index.
    pub(super) fn exposures_of(&self, view: usize) -> usize {
        if view < self.views.tilts.len() {
            self.stripes.len()
        } else {
            2
        }
    }

    /// Takes the view of this index at the `bench`; `reach` is told how many of its exposures are taken.
    pub(super) fn take(
        &mut self,
        view: usize,
        bench: &mut dyn Bench,
        reach: &dyn Fn(usize),
    ) -> Result<Segment, CalibrateError> {
        let tilt = self.views.tilts.get(view);
        let held = match tilt {
            Some([tilt_deg, azimuth_deg]) => {
                black_mirror(&self.views.rig, from_degrees(*tilt_deg, *azimuth_deg))
            }
            None => Held::Sample(Arc::from(
                crate::brdf::sample::parse(STANDARD).map_err(SetupError::from)?,
            )),
        };
        bench.set_opened(view as u32);
        let mut instrument = bench.open(&self.rig, held, None)?;
        let draw = |exposure: usize, image: &mut BitPattern| match exposure {
            exposure if tilt.is_some() => self.stripes.draw(exposure, image),
            0 => image.light(&self.spot),
            _ => {}
        };
        // The brightest pattern decides how long all are exposed.
        let (width_px, height_px) = instrument.projector.size_px();
        let mut image = BitPattern::black(width_px, height_px);
        draw(0, &mut image);
        let tests = TestExposures::take(&self.rig, &[image.lit()], &mut instrument)?;
        if tests.is_too_bright {
            return Err(CalibrateError::Views {
                expected: format!("a target that {} ms do not saturate", SHORTEST_EXPOSURE_S * 1e3),
                found: "one that they do".to_owned(),
                advice: "stop the projector or the camera down and state it in the rig file \
                         (light.full_scale_f_sr)",
            });
        }
        let exposure_s = tests.longest_s.clamp(SHORTEST_EXPOSURE_S, 1.0);
        let timing = Timing::patient(&self.rig, exposure_s).map_err(plan::PlanError::from)?;
        let mut tally = Tally::default();
        let shots = instrument.take(self.exposures_of(view), &[timing], draw, &mut tally, reach)?;
        self.clock_hz = instrument.device.info().clock_hz;
        Ok(segment_of(shots, tally, exposure_s))
    }

    /// Stores a view, in place of an older one.
    pub(super) fn write(&mut self, view: usize, segment: &Segment) -> Result<(), CalibrateError> {
        if self.raw.is_none() {
            // Now the clock is known.
            let made = create_raw(&self.dir.join(RAW), self.layout, self.clock_hz, VIEWS, &self.text)?;
            self.raw = Some(made);
        }
        let raw = self.raw.as_ref().expect("invariant: made above");
        check_clock(&self.dir.join(RAW), raw, self.clock_hz)?;
        Ok(raw.put_segment(view, segment)?)
    }
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
