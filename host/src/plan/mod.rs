//! The plan: which exposures a measurement takes, and how.
//!
//! # Design
//! A plan is derived from a [`Request`] and a rig, and written to `plan.toml`; every later stage, and a
//! resumed measurement, reads that file. Patterns are in the order of their incident directions, or codes that light many at
//! once ([`light`]), with a few black ones among them, evenly over the whole run: lamp and camera drift. Each has one exposure, or
//! several in a row (brackets), the shortest first, black ones too. They are taken in *segments*: one segment is one run of the
//! controller, one load of the projector and one chunk of `raw.zarr`, and what a crash may cost.

pub mod brackets;
pub mod light;
pub mod pattern;
pub mod predicted_time;
pub mod schedule;
pub mod stripes;
mod virtual_rig;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::hemisphere::incident::{Grid, IncidentError, IncidentSet};
use crate::instrument::optics::{Unmeasurable, View};
use crate::instrument::rig::{Rig, Tilt, explain};
use crate::plan::brackets::{Brackets, largest_ratio};
use crate::plan::light::{CodePatterns, Coding, Light};
use crate::plan::pattern::{LitSet, PatternMaker};
use crate::plan::schedule::Timing;

pub use error::PlanError;
pub use exposure::{BLACK_EXPOSURES, Exposure};
pub use virtual_rig::{Faults, Virtual};

mod check;
mod error;
mod exposure;

/// Pixels a side of camera images and of the outgoing grid.
pub const IMAGE_SIZES_PX: std::ops::RangeInclusive<u32> = 8..=4096;
/// Openings of the cone that one pattern lights, degrees.
pub const SPOTS_DEG: std::ops::RangeInclusive<f64> = 0.05..=30.0;
/// A segment holds about this many bytes of frames.
const SEGMENT_BYTES: usize = 16 << 20;
/// What assembly holds of a block of code patterns has at most about this many bytes.
const BLOCK_BYTES: usize = 256 << 20;
/// A segment is at most this long: the table of the controller and the memory of projectors.
const SEGMENT_MAX: usize = 400;

/// Version of the format of `plan.toml`.
const FORMAT: u32 = 5;

/// The key of `plan.toml` that is read first.
#[derive(Deserialize)]
struct Version {
    format: u32,
}

/// What the user wants measured. Kept in `plan.toml` as it was asked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// Incident directions.
    pub grid: Grid,
    /// Camera image and outgoing grid: this many pixels a side.
    pub image_size: u32,
    /// Exposure time in s; `None` lets a pilot capture choose it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_s: Option<f64>,
    /// Opening of the cone that one pattern lights, degrees; `None` for that of the rig, but no wider than the step of the
    /// grid, which it would blur.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spot_deg: Option<f64>,
    /// Whether a pilot capture chooses that opening.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub spot_auto: bool,
    /// Exposures of each pattern; a pilot capture chooses their times unless they are given here.
    #[serde(default, skip_serializing_if = "Brackets::is_one")]
    pub brackets: Brackets,
    /// How light is made.
    #[serde(default, skip_serializing_if = "Light::is_single")]
    pub light: Light,
    /// Whether pixels are fused with what their surroundings say of them.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub estimate: bool,
    /// How the holder tilts the sample; not at all if there is nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tilt: Option<Tilt>,
    /// Whether `brdf.zarr` keeps every bit of f and σ.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub lossless: bool,
    /// What the user calls the sample.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample_name: Option<String>,
    /// What else the user says of the sample: batch, finish, how it lies in the holder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample_description: Option<String>,
    /// A known material that the result is compared with, as [`crate::brdf::sample::parse`] takes it; if there is none, that
    /// which stands in the virtual rig, and for a real instrument nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference: Option<String>,
}

impl Default for Request {
    /// A θ × φ grid of 3°, images of 96 × 96 pixels, one exposure whose time is found by a pilot capture.
    fn default() -> Self {
        Self {
            grid: Grid::ThetaPhi { step_deg: 3.0 },
            image_size: 96,
            exposure_s: None,
            spot_deg: None,
            spot_auto: false,
            brackets: Brackets::One,
            light: Light::Single,
            estimate: false,
            tilt: None,
            lossless: false,
            sample_name: None,
            sample_description: None,
            reference: None,
        }
    }
}

impl Request {
    /// `rig` as it is measured with: its sample tilted, its camera image scaled.
    ///
    /// # Errors
    /// [`PlanError::ImageSize`]; [`PlanError::Toml`] if the tilted sample is out of sight.
    pub fn rig(&self, rig: &Rig) -> Result<Rig, PlanError> {
        self.check_image_size()?;
        Ok(rig.tilted(self.tilt)?.with_image_size(self.image_size)?)
    }

    /// Opening in degrees of the cone that one pattern lights on `rig`.
    #[must_use]
    pub fn spot_deg(&self, rig: &Rig) -> f64 {
        let widest_deg = self.grid.step_deg().unwrap_or(f64::INFINITY);
        self.spot_deg.unwrap_or(rig.light.spot_deg.min(widest_deg))
    }

    /// With the full path of the file that it is compared with, so that it is found from any working directory. A path
    /// that leads nowhere, or is no text, stays as it is.
    #[must_use]
    pub fn located(mut self) -> Self {
        let reference = self.reference.as_deref().and_then(virtual_rig::located_sample);
        self.reference = reference.or(self.reference);
        self
    }

    fn check_image_size(&self) -> Result<(), PlanError> {
        if IMAGE_SIZES_PX.contains(&self.image_size) {
            return Ok(());
        }
        Err(PlanError::ImageSize(self.image_size))
    }
}

/// A plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Version of this file's format.
    pub format: u32,
    /// Name of the rig that it was made for.
    pub rig: String,
    /// What was asked for.
    pub request: Request,
    /// Exposure time in s; of several the shortest.
    pub exposure_s: f64,
    /// Opening of the cone that one pattern lights, in degrees.
    pub spot_deg: f64,
    /// Exposures per segment, all of a pattern in the same one.
    pub segment: usize,
    /// Times of one step; of several exposures the first, which shows the pattern.
    pub timing: Timing,
    /// Indices of the incident directions that are measured are derived from rig and grid; this is how many.
    #[serde(rename = "directions")]
    pub direction_count: usize,
    /// The other exposures of each pattern, longer and longer, while it stays.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub longer: Vec<Timing>,
    /// Whether all black patterns come first: where a plan grows while it is measured, nobody knows its end.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub black_first: bool,
    /// The code of the patterns; `None` if each lights one direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub code: Option<Coding>,
    /// How often each pattern is shown, in one primary after the other, whose frames are the channels of one image: 1 if in white, see
    /// [`Rig::shown_bands`].
    #[serde(default = "in_white", skip_serializing_if = "is_white")]
    pub bands: usize,
    /// Side in pixels of the squares that watch the lamp in every pattern, see [`crate::instrument::monitor`]; 0 for none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub watching_side: u32,
    /// The virtual rig that it is made for; `None` for a real instrument.
    #[serde(default, rename = "virtual", skip_serializing_if = "Option::is_none")]
    pub virtual_rig: Option<Virtual>,
}

/// Whether nothing watches the lamp.
#[allow(clippy::trivially_copy_pass_by_ref)] // serde wants it so
const fn is_zero(side: &u32) -> bool {
    *side == 0
}

/// How often a pattern is shown that has no bands.
const fn in_white() -> usize {
    1
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde wants it so
const fn is_white(bands: &usize) -> bool {
    *bands == in_white()
}

/// The incident directions of a plan.
#[derive(Clone, Debug)]
pub struct Directions {
    /// All of them.
    pub grid: IncidentSet,
    /// For each of them, why it cannot be lit.
    pub reasons: Vec<Option<Unmeasurable>>,
}

impl Directions {
    /// The directions of `grid` as the projector of `rig` sees them.
    ///
    /// # Errors
    /// [`IncidentError`].
    pub fn new(rig: &Rig, grid: &Grid) -> Result<Self, IncidentError> {
        let grid = grid.build()?;
        let projector = View::projector(rig);
        let reasons = (0..grid.len())
            .map(|index| projector.pixel(grid.direction(index)).err())
            .collect();
        Ok(Self { grid, reasons })
    }

    /// Indices of the directions that can be lit, ascending.
    pub fn measurable(&self) -> impl Iterator<Item = usize> + '_ {
        self.reasons
            .iter()
            .enumerate()
            .filter(|(_, reason)| reason.is_none())
            .map(|(index, _)| index)
    }

    /// What a spot of `spot_deg` degrees from each direction that can be lit lights on `rig`, in their order; nothing where the
    /// projector has no pixel for it.
    #[must_use]
    pub fn lit_sets(&self, rig: &Rig, spot_deg: f64) -> Vec<LitSet> {
        let maker = PatternMaker::new(View::projector(rig), spot_deg, rig.projector.irradiance);
        let indices: Vec<usize> = self.measurable().collect();
        let of = |index: &usize| maker.lit_set(self.grid.direction(*index));
        let sets = indices
            .par_iter()
            .map(|index| of(index).unwrap_or_else(|_| light::together([])));
        sets.collect()
    }
}

impl Plan {
    /// What is measured: its name, or what stands in the virtual rig.
    #[must_use]
    pub fn sample(&self) -> Option<&str> {
        let held = self.virtual_rig.as_ref().map(|held| held.sample.as_str());
        self.request.sample_name.as_deref().or(held)
    }

    /// A plan for `request` on `rig` with exposures of `exposure_s` seconds.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn new(request: Request, rig: &Rig, exposure_s: f64) -> Result<Self, PlanError> {
        Self::bracketed(request, rig, &[exposure_s])
    }

    /// A plan for `request` on `rig` with exposures of `exposures_s` seconds of each pattern, one or several, ascending.
    ///
    /// # Errors
    /// [`PlanError`].
    ///
    /// # Panics
    /// If `exposures_s` is empty.
    pub fn bracketed(request: Request, rig: &Rig, exposures_s: &[f64]) -> Result<Self, PlanError> {
        request.check_image_size()?;
        let directions = Directions::new(rig, &request.grid)?;
        let count = directions.measurable().count();
        if count == 0 {
            let reason = directions.reasons[0].unwrap_or(Unmeasurable::OutsideImage);
            return Err(PlanError::NothingToMeasure {
                rig: rig.name.clone(),
                reason,
            });
        }
        let pixels = request.image_size as usize * request.image_size as usize;
        let frame_bytes = pixels * rig.channels() * 2;
        let mut longer = Timing::series(rig, exposures_s)?;
        let timing = longer.remove(0);
        let largest = largest_ratio(rig);
        for pair in exposures_s.windows(2) {
            let found = pair[1] / pair[0];
            if found > largest {
                let [shorter_ms, longer_ms] = [pair[0], pair[1]].map(|s| (s * 1e6).round() * 1e-3);
                return Err(PlanError::Apart {
                    shorter_ms,
                    longer_ms,
                    found,
                    largest,
                });
            }
        }
        let spot_deg = request.spot_deg(rig);
        let code = match request.light {
            Light::Single | Light::Auto => None,
            light => light.coding(&directions.lit_sets(rig, spot_deg), most_cells(&request, rig))?,
        };
        let bands = rig.shown_bands();
        // A projector holds so many pictures, however many of them make an image.
        let segment = (SEGMENT_BYTES / frame_bytes).clamp(8, SEGMENT_MAX / bands);
        let segment = segment / exposures_s.len() * exposures_s.len();
        Ok(Self {
            format: FORMAT,
            rig: rig.name.clone(),
            request,
            exposure_s: timing.cam_width_s,
            spot_deg,
            segment,
            timing,
            direction_count: count,
            longer,
            black_first: false,
            code,
            bands,
            watching_side: 0,
            virtual_rig: None,
        })
    }

    /// This plan, for the virtual rig.
    #[must_use]
    pub fn on(self, virtual_rig: Virtual) -> Self {
        Self {
            virtual_rig: Some(virtual_rig),
            ..self
        }
    }

    /// What the patterns are for, in their order.
    #[must_use]
    pub fn patterns(&self, directions: &Directions) -> Vec<Exposure> {
        let lit: Vec<Exposure> = match self.code_patterns() {
            None => directions.measurable().map(Exposure::Incident).collect(),
            Some(codes) => (0..codes.len()).map(Exposure::Coded).collect(),
        };
        exposure::with_black(&lit, self.black_first)
    }

    /// The longest time from one black pattern to the next, seconds, or to the end if they all come first.
    #[must_use]
    pub fn between_black_s(&self) -> f64 {
        let parts = if self.black_first { 1 } else { BLACK_EXPOSURES - 1 };
        self.duration_s() / parts as f64
    }

    /// The code patterns; `None` if each pattern lights one direction.
    ///
    /// # Panics
    /// If the code is none for so many directions, which [`check`](Self::check) refuses.
    #[must_use]
    pub fn code_patterns(&self) -> Option<CodePatterns> {
        let patterns = |code: Coding| code.patterns(self.direction_count);
        self.code
            .map(|code| patterns(code).expect("invariant: a plan's code fits its directions"))
    }

    /// Number of patterns that are not black.
    #[must_use]
    pub fn lit_patterns(&self) -> usize {
        self.code_patterns()
            .map_or(self.direction_count, |codes| codes.len())
    }

    /// Exposures of each pattern.
    #[must_use]
    pub const fn brackets(&self) -> usize {
        1 + self.longer.len()
    }

    /// The steps of one pattern.
    #[must_use]
    pub fn timings(&self) -> Vec<Timing> {
        let longer = self.longer.iter().copied();
        std::iter::once(self.timing).chain(longer).collect()
    }

    /// Exposure times in s of each pattern, ascending.
    #[must_use]
    pub fn exposures_s(&self) -> Vec<f64> {
        self.timings().iter().map(|timing| timing.cam_width_s).collect()
    }

    /// Number of exposures, all bands of which are one.
    #[must_use]
    pub fn len(&self) -> usize {
        (BLACK_EXPOSURES + self.lit_patterns()) * self.brackets()
    }

    /// Never: there are always black exposures.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        false
    }

    /// Time that the exposures take, all bands of them, in s, without loading.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        let cycle_s: f64 = self.timings().iter().map(|timing| timing.period_s).sum();
        ((BLACK_EXPOSURES + self.lit_patterns()) * self.bands) as f64 * cycle_s
    }

    /// The plan as TOML.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a plan is plain data")
    }

    /// Reads `plan.toml`.
    ///
    /// # Errors
    /// [`PlanError::File`] with the path and what is wrong.
    pub fn read(path: &std::path::Path) -> Result<Self, PlanError> {
        let fail = |reason: String| PlanError::File {
            path: path.display().to_string(),
            reason,
        };
        let text = crate::base::text::read(path)
            .map_err(|e| fail(format!("expected a plan, found no readable file: {e}")))?;
        // Another version may have other keys, which are no mistakes of the user's.
        if let Ok(Version { format }) = toml::from_str(&text)
            && format != FORMAT
        {
            return Err(fail(format!("format: expected {FORMAT}, found {format}")));
        }
        toml::from_str(&text).map_err(|e| explain(&text, path, &e).into())
    }

    /// Reads the plan at `path`, which must have been made for `rig`.
    ///
    /// # Errors
    /// As [`Self::read`] and [`Self::check`]; [`PlanError::OtherRig`].
    pub fn of_rig(path: &std::path::Path, rig: &Rig) -> Result<Self, PlanError> {
        let plan = Self::read(path)?;
        plan.check(path)?;
        if plan.rig != rig.name {
            return Err(PlanError::OtherRig {
                path: path.display().to_string(),
                plan: plan.rig,
                rig: rig.name.clone(),
            });
        }
        if plan.bands != rig.shown_bands() {
            let expected = rig.shown_bands();
            return Err(PlanError::File {
                path: path.display().to_string(),
                reason: format!(
                    "bands: expected {expected} as the rig shows, found {}",
                    plan.bands
                ),
            });
        }
        Ok(plan)
    }

    /// The request that measures the same again, with this plan's exposure times (in milliseconds where there are several,
    /// which may cost the last bit).
    #[must_use]
    pub fn replayed(&self) -> Request {
        let (exposure_s, brackets) = if self.longer.is_empty() {
            (Some(self.exposure_s), Brackets::One)
        } else {
            let times_s = self.exposures_s().into_iter();
            (None, Brackets::TimesMs(times_s.map(|s| s * 1e3).collect()))
        };
        Request {
            exposure_s,
            brackets,
            light: self.code.map_or(Light::Single, Coding::light),
            ..self.request.clone()
        }
    }
}

/// Cells of a block whose frames of `request` on `rig`, as numbers with a point, fill no more than is held of them.
#[must_use]
pub(crate) fn most_cells(request: &Request, rig: &Rig) -> usize {
    let pixels = request.image_size as usize * request.image_size as usize;
    let held = BLOCK_BYTES / (pixels * rig.channels() * size_of::<f32>());
    held.max(light::ORDERS[0])
}
