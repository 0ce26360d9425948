//! The views of a photometric calibration: what is shown and taken.
//!
//! # Design
//! All exposures come in segments of [`SEGMENT`], each of one exposure time:
//!
//! | in the holder | segments | exposures of each |
//! |---|---|---|
//! | standard | one per exposure time of the series | half of one spot, half black |
//! | | one | the spot at all levels of grey |
//! | | one | black |
//! | | one per 16 incident directions | one of each direction |
//! | second standard, if there is one | one | black |
//! | | two | one of each of 32 directions |
//! | light trap | one per exposure time of the series | black |

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::Map;

use crate::brackets::Brackets;
use crate::calibrate::{CalibrateError, RIG, read_json, segment_of};
use crate::capture::{Instrument, Tally};
use crate::incident::Grid;
use crate::measurement::write_whole;
use crate::optics::View;
use crate::pattern::PatternMaker;
use crate::pilot::Tests;
use crate::plan::{self, Directions};
use crate::progress::Progress;
use crate::rig::Rig;
use crate::schedule::Timing;
use crate::setup::Setup;
use crate::store::{RawLayout, RawStore};
use crate::virtual_rig::Held;

/// Name of the raw frames.
pub(super) const RAW: &str = "photometry.raw.zarr";
/// Name of the file that says what the frames are.
const VIEWS: &str = "photometry-views.json";
/// Exposures of a segment.
pub(super) const SEGMENT: usize = 16;
/// Exposure times of the series, each √4 = 2 times the one before.
const TIMES: usize = 8;
/// Degrees between the rings of incident directions with which the standard is lit.
const STEP_DEG: f64 = 10.0;
/// Segments of incident directions of the second standard.
const SECOND: usize = 2;

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// The reflectance standard, as [`crate::sample::parse`] takes it.
    pub standard: String,
    /// A second standard of another reflectance, for the interreflection.
    pub second_standard: Option<String>,
    /// Longest exposure time, seconds; `None` for the longest that does not saturate.
    pub exposure_s: Option<f64>,
    /// Pixels a side of the camera's image.
    pub image_size: u32,
    /// How the virtual rig really is; see [`plan::Request::truth`].
    pub truth: Option<String>,
    /// Whether the virtual rig is noisy.
    pub noise: bool,
    /// Source of all chance of the virtual rig.
    pub seed: u64,
}

/// What was captured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Views {
    /// The rig, its camera at full size.
    pub(super) rig: Rig,
    /// As in [`Request::standard`].
    pub(super) standard: String,
    /// As in [`Request::second_standard`].
    pub(super) second_standard: Option<String>,
    /// As in [`Request::image_size`].
    pub(super) image_size: u32,
    /// Exposure times of the series, seconds, ascending.
    pub(super) times_s: Vec<f64>,
    /// Exposure time of the incident directions, seconds.
    pub(super) exposure_s: f64,
    /// Indices of the incident directions in the grid of [`STEP_DEG`], whole segments of them.
    pub(super) directions: Vec<usize>,
}

/// What one segment holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shows {
    /// Half of one spot, half black, of the exposure time of this index.
    Series(usize),
    Levels,
    Black,
    /// Incident directions from this place in [`Views::directions`] on.
    Directions(usize),
    SecondBlack,
    SecondDirections(usize),
    /// Darkness, of the exposure time of this index.
    Dark(usize),
}

impl Views {
    pub(super) fn read(dir: &Path) -> Result<Self, CalibrateError> {
        read_json(&dir.join(VIEWS))
    }

    /// Whether `dir` holds captures of views.
    #[must_use]
    pub fn exist(dir: &Path) -> bool {
        dir.join(VIEWS).is_file()
    }

    /// The rig with the camera's image as captured.
    pub(super) fn scaled(&self) -> Result<Rig, CalibrateError> {
        Ok(self.rig.with_image_size(self.image_size)?)
    }

    /// All segments in their order.
    pub(super) fn segments(&self) -> Vec<Shows> {
        let chunks = || (0..self.directions.len() / SEGMENT).map(|chunk| chunk * SEGMENT);
        let mut all: Vec<Shows> = (0..self.times_s.len()).map(Shows::Series).collect();
        all.extend([Shows::Levels, Shows::Black]);
        all.extend(chunks().map(Shows::Directions));
        if self.second_standard.is_some() {
            all.push(Shows::SecondBlack);
            // Spread over all of them.
            let every = (self.directions.len() / SEGMENT / SECOND).max(1);
            all.extend(chunks().step_by(every).take(SECOND).map(Shows::SecondDirections));
        }
        all.extend((0..self.times_s.len()).map(Shows::Dark));
        all
    }

    fn exposure_of(&self, shows: Shows) -> f64 {
        match shows {
            Shows::Series(index) | Shows::Dark(index) => self.times_s[index],
            _ => self.exposure_s,
        }
    }

    /// Incident directions of the grid.
    pub(super) fn grid(rig: &Rig) -> Result<Directions, CalibrateError> {
        let grid = Grid::ThetaPhi { step_deg: STEP_DEG };
        Ok(Directions::new(rig, &grid).map_err(plan::PlanError::from)?)
    }

    /// Incident direction at a place in [`Views::directions`].
    pub(super) fn direction(&self, grid: &Directions, place: usize) -> DVec3 {
        grid.grid.direction(self.directions[place])
    }
}

/// Captures the views of `request` with the rig of the calibration in `dir`, into it.
///
/// # Errors
/// [`CalibrateError`].
pub fn capture(
    request: &Request,
    dir: &Path,
    setup: &Setup,
    progress: &dyn Progress,
) -> Result<(), CalibrateError> {
    let full = Rig::load(&dir.join(RIG).display().to_string())?;
    let rig = full.with_image_size(request.image_size)?;
    let parse = |spec: &str| -> Result<Held, CalibrateError> {
        let sample = crate::sample::parse(spec).map_err(crate::measure::MeasureError::from)?;
        Ok(Held::Sample(Arc::from(sample)))
    };
    let standard = parse(&request.standard)?;
    let second = request.second_standard.as_deref().map(parse).transpose()?;
    let behaviour = plan::Request {
        grid: Grid::ThetaPhi { step_deg: STEP_DEG },
        image_size: request.image_size,
        exposure_s: None,
        brackets: Brackets::default(),
        sample: None,
        truth: request.truth.clone(),
        tilt: None,
        noise: request.noise,
        seed: request.seed,
    };
    let grid = Views::grid(&rig)?;
    let maker = maker(&rig);
    let lit = |place: usize| {
        maker
            .lit_set(grid.grid.direction(place))
            .map_or_else(|_| Vec::new(), |lit| lit.pixels)
    };
    let mut directions: Vec<usize> = grid.measurable().collect();
    directions.truncate(directions.len() / SEGMENT * SEGMENT);
    let mut instrument = setup.open_held(&rig, standard, &behaviour)?;
    let exposure_s = if let Some(exposure_s) = request.exposure_s {
        exposure_s
    } else {
        let patterns: Vec<Vec<u32>> = directions.iter().step_by(5).map(|at| lit(*at)).collect();
        Tests::take(&rig, &patterns, &mut instrument)?
            .longest_s
            .clamp(1e-5, 10.0)
    };
    let views = Views {
        rig: full,
        standard: request.standard.clone(),
        second_standard: request.second_standard.clone(),
        image_size: request.image_size,
        times_s: (0..TIMES)
            .rev()
            .map(|halvings| exposure_s / f64::from(1 << halvings))
            .collect(),
        exposure_s,
        directions,
    };
    let format = rig.frame_format();
    let segments = views.segments();
    let layout = RawLayout {
        exposures: segments.len() * SEGMENT,
        segment: SEGMENT,
        height: format.height_px,
        width: format.width_px,
        channels: format.channels,
        bits: format.bits,
    };
    let raw = RawStore::create(&dir.join(RAW), layout, Map::new())?;
    // The direction of the series: one of those nearest to 45°.
    let series = *views
        .directions
        .iter()
        .min_by(|a, b| {
            let off = |at: usize| (grid.grid.angles_deg(at).0 - 45.0).abs();
            off(**a).total_cmp(&off(**b))
        })
        .ok_or_else(|| CalibrateError::Views {
            expected: format!("at least {SEGMENT} incident directions that the projector can light"),
            found: "fewer".to_owned(),
            advice: "check the rig",
        })?;
    progress.begin("standard", layout.exposures, "exposures");
    let take = |index: usize, shows: Shows, instrument: &mut Instrument| -> Result<(), CalibrateError> {
        let exposure_s = views.exposure_of(shows);
        let timing = Timing::new(&rig, exposure_s).map_err(plan::PlanError::from)?;
        let shots = instrument.take(
            SEGMENT,
            &[timing],
            |exposure, image| match shows {
                Shows::Series(_) if exposure < SEGMENT / 2 => image.light(&lit(series)),
                Shows::Levels => {
                    image.light(&lit(series));
                    image.set_level(super::level(exposure));
                }
                Shows::Directions(first) | Shows::SecondDirections(first) => {
                    image.light(&lit(views.directions[first + exposure]));
                }
                Shows::Series(_) | Shows::Black | Shows::SecondBlack | Shows::Dark(_) => {}
            },
            &mut Tally::default(),
            |taken| progress.reach(index * SEGMENT + taken),
        )?;
        raw.write_segment(index, &segment_of(shots, 0, exposure_s))?;
        Ok(())
    };
    let mut second_instrument = second
        .map(|held| setup.open_held(&rig, held, &behaviour))
        .transpose()?;
    let mut dark = setup.open_held(&rig, parse("lambert:0")?, &behaviour)?;
    for (index, shows) in segments.into_iter().enumerate() {
        let instrument = match (shows, &mut second_instrument) {
            (Shows::Dark(_), _) => &mut dark,
            (Shows::SecondBlack | Shows::SecondDirections(_), Some(second)) => second,
            _ => &mut instrument,
        };
        take(index, shows, instrument)?;
    }
    progress.end();
    let text = serde_json::to_string_pretty(&views).expect("JSON values can be written");
    write_whole(&dir.join(VIEWS), text.as_bytes())?;
    Ok(())
}

/// Patterns of the incident directions.
pub(super) fn maker(rig: &Rig) -> PatternMaker {
    PatternMaker::new(View::projector(rig), rig.light.spot_deg, 1.0)
}
