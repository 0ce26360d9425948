//! The views of a photometric calibration: what is shown and taken.
//!
//! # Design
//! All exposures come in segments of [`SEGMENT`], each of one exposure time:
//!
//! | in the holder | segments | exposures of each |
//! |---|---|---|
//! | standard | one per exposure time of the series | half of one spot, half black |
//! | | one | a spot as wide as the shortest time allows at all levels of grey, of that time |
//! | | one, if the camera has colours | the same spot in one primary after the other, of that time |
//! | | one | black |
//! | | one per 16 incident directions | one of each direction |
//! | standard, at each tilt that is asked for | one | black |
//! | | one per 16 incident directions | one of each direction |
//! | second standard, if there is one | one | black |
//! | | two | one of each of 32 directions |
//! | light trap | one per exposure time of the series | black |
//!
//! Those of stray light follow (`stray`). What watches the lamp ([`crate::instrument::monitor`]) is lit in all that show a standard
//! but those of levels, and in the black ones but for some, as in measurements ([`Exposure::black`]).
//!
//! A tilted sample is seen in parts of both images that the untilted standard does not reach: light and throughput are known
//! there only if the standard was captured at such a tilt.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::by_hand::check_whole;
use super::stray::StrayViews;
use crate::calibrate::{CalibrateError, file, open_raw};
use crate::instrument::calibration::photometry::COMMAND;
use crate::instrument::calibration::{COLOURS, CalibrationError, lights};
use crate::instrument::frame_format::FrameFormat;
use crate::instrument::optics::View;
use crate::instrument::rig::{Rig, Tilt};
use crate::plan::pattern::{BitPattern, PatternMaker};
use crate::plan::{self, Exposure};
use crate::store::{RawLayout, RawStore};

/// Name of the raw frames.
pub(super) const RAW: &str = "photometry.raw.zarr";
/// Name of the file that says what the frames are.
pub(super) const VIEWS: &str = crate::instrument::calibration::VIEWS[1];
/// Exposures of a segment: as many as black patterns of a measurement, among which those stand that watch no lamp.
pub(super) const SEGMENT: usize = plan::BLACK_EXPOSURES;
/// Share of the light that saturates to which levels of grey come, and the widest spot for them, degrees.
const WIDE: f64 = 0.7;
const WIDEST_DEG: f64 = 30.0;
/// Segments of incident directions of the second standard.
const SECOND: usize = 2;
/// Noise dithers steps of up to so many times its standard deviation well enough for a dark standard; of coarser ones more of the light
/// is lost the dimmer it is.
const COARSE: f64 = 4.0;

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// The reflectance standard, as [`crate::brdf::sample::parse`] takes it.
    pub standard: String,
    /// A second standard of another reflectance, for the interreflection; see [`Request::usual_second_standard`].
    pub second_standard: Option<String>,
    /// Tilts at which the standard is captured too: those at which samples will be measured.
    pub tilts: Vec<Tilt>,
    /// Longest exposure time, seconds; `None` for the longest that does not saturate.
    pub exposure_s: Option<f64>,
    /// Pixels a side of the camera's image.
    pub image_size: u32,
}

impl Request {
    /// The second standard that serves on `rig`; `None` where its camera's steps are so coarse that what a dark standard shows is lost
    /// in them.
    #[must_use]
    pub fn usual_second_standard(rig: &Rig) -> Option<&'static str> {
        let step_e = rig.gain_e_per_dn();
        (step_e < COARSE * rig.camera.read_noise_e).then_some("lambert:0.2")
    }
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
    /// Diameter of the cone that one pattern lights, degrees, if it is not that of the rig.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) spot_deg: Option<f64>,
    /// How stray light was looked for.
    pub(super) stray: StrayViews,
    /// How the standard stood.
    pub(super) stands: Vec<Stand>,
}

/// The standard as it stood.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Stand {
    /// Its tilt; none first.
    pub(super) tilt: Option<Tilt>,
    /// Indices of the incident directions (see [`lights`]), whole segments of them.
    pub(super) directions: Vec<usize>,
}

/// What one segment holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shows {
    /// Half of one spot, half black, of the exposure time of this index.
    Series(usize),
    Levels,
    /// One primary after the other.
    Colours,
    /// Darkness, of the stand of this index.
    Black(usize),
    /// Incident directions of the stand of this index, from this place in [`Stand::directions`] on.
    Directions(usize, usize),
    SecondBlack,
    /// Of the first stand.
    SecondDirections(usize),
    /// Darkness, of the exposure time of this index.
    Dark(usize),
}

impl Views {
    /// What `dir` holds, with the frames that were captured of it.
    pub(super) fn read(dir: &Path) -> Result<(Self, RawStore), CalibrateError> {
        let path = dir.join(VIEWS);
        let views: Self = file::read(&path, COMMAND)?;
        views.check(&path)?;
        check_whole(&views, dir)?;
        Ok((views, open_raw(dir, RAW, VIEWS)?))
    }

    /// Refuses what no capture writes; `path` is where it was read.
    fn check(&self, path: &Path) -> Result<(), CalibrateError> {
        self.rig.validate()?;
        let content = |field: &str, expected: String, found: String| {
            Err(CalibrationError::Content {
                path: path.display().to_string(),
                field: field.to_owned(),
                expected,
                found,
            }
            .into())
        };
        let ascends = self.times_s.windows(2).all(|pair| pair[0] < pair[1]);
        if self.times_s.len() < 2 || !ascends || self.times_s[0] <= 0.0 {
            let expected = "two or more ascending times above 0".to_owned();
            return content("times_s", expected, crate::base::text::listed(&self.times_s));
        }
        if self.exposure_s <= 0.0 {
            return content(
                "exposure_s",
                "a time above 0".to_owned(),
                self.exposure_s.to_string(),
            );
        }
        if self.spot_deg() <= 0.0 {
            return content(
                "spot_deg",
                "an angle above 0".to_owned(),
                self.spot_deg().to_string(),
            );
        }
        if self.stands.first().is_none_or(|stand| stand.tilt.is_some()) {
            let expected = "a first one without a tilt".to_owned();
            return content("stands", expected, format!("{}", self.stands.len()));
        }
        for stand in &self.stands {
            let count = stand.directions.len();
            if count == 0 || count % SEGMENT != 0 || stand.directions.iter().any(|at| *at >= lights::LIGHTS) {
                let expected = format!("whole segments of {SEGMENT} numbers below {}", lights::LIGHTS);
                return content("stands.directions", expected, format!("{count} others"));
            }
        }
        Ok(())
    }

    /// Diameter of the cone that one pattern lights, degrees.
    pub(super) fn spot_deg(&self) -> f64 {
        self.spot_deg.unwrap_or(self.rig.light.spot_deg)
    }

    /// Whether `dir` holds captures of views.
    #[must_use]
    pub fn exist(dir: &Path) -> bool {
        dir.join(VIEWS).is_file()
    }

    /// The rig with the standard as it stood, the camera's image as captured.
    pub(super) fn rig_of(&self, stand: usize) -> Result<Rig, CalibrateError> {
        Ok(self
            .rig
            .tilted(self.stands[stand].tilt)?
            .with_image_size(self.image_size)?)
    }

    /// All segments in their order.
    pub(super) fn segments(&self) -> Vec<Shows> {
        let chunks =
            |stand: usize| (0..self.stands[stand].directions.len() / SEGMENT).map(|chunk| chunk * SEGMENT);
        let mut all: Vec<Shows> = (0..self.times_s.len()).map(Shows::Series).collect();
        all.push(Shows::Levels);
        if usize::from(self.rig.camera.channels) == COLOURS {
            all.push(Shows::Colours);
        }
        for stand in 0..self.stands.len() {
            all.push(Shows::Black(stand));
            all.extend(chunks(stand).map(|first| Shows::Directions(stand, first)));
        }
        if self.second_standard.is_some() {
            all.push(Shows::SecondBlack);
            // Spread over all of them.
            let every = (self.stands[0].directions.len() / SEGMENT / SECOND).max(1);
            all.extend(chunks(0).step_by(every).take(SECOND).map(Shows::SecondDirections));
        }
        all.extend((0..self.times_s.len()).map(Shows::Dark));
        all
    }

    pub(super) fn exposure_of(&self, shows: Shows) -> f64 {
        match shows {
            Shows::Series(index) | Shows::Dark(index) => self.times_s[index],
            Shows::Levels | Shows::Colours => self.times_s[0],
            _ => self.exposure_s,
        }
    }
}

/// The holder at each of `tilts`.
pub(super) fn holders(
    full: &Rig,
    request: &Request,
    tilts: &[Option<Tilt>],
) -> Result<Vec<Holder>, CalibrateError> {
    tilts
        .iter()
        .map(|tilt| Holder::new(full, *tilt, request.image_size))
        .collect()
}

/// The raw frames of so many `segments`, the clock left open.
pub(super) fn layout(segments: usize, format: FrameFormat) -> RawLayout {
    RawLayout {
        exposures: segments * SEGMENT,
        segment: SEGMENT,
        height: format.height_px,
        width: format.width_px,
        channels: format.channels,
        bits: format.bits,
        clock_hz: 0,
    }
}

impl Shows {
    /// Whether the lamp is watched: not where all that is lit is grey or coloured, or nothing is.
    pub(super) const fn is_watched(self) -> bool {
        !matches!(self, Self::Levels | Self::Colours | Self::Dark(_))
    }

    /// Draws the `exposure` of this number of the segment into the black `image`.
    pub(super) fn draw(self, exposure: usize, holder: &Holder, series: &Series, image: &mut BitPattern) {
        match self {
            Self::Series(_) if exposure < SEGMENT / 2 => image.light(&series.spot),
            Self::Levels => {
                image.light(&series.wide);
                image.set_level(super::level(exposure));
            }
            Self::Colours => {
                if let Some(primary) = primary(exposure) {
                    image.light(&series.wide);
                    image.set_primary(Some(primary as u8));
                }
            }
            Self::Directions(_, first) | Self::SecondDirections(first) => {
                image.light(&holder.lit(holder.directions[first + exposure]));
            }
            Self::Black(_) | Self::SecondBlack if Exposure::black(exposure) == Exposure::Unwatched => {
                image.clear();
            }
            Self::Series(_) | Self::Black(_) | Self::SecondBlack | Self::Dark(_) => {}
        }
    }
}

/// The primary that is lit in the exposure of this number of a segment of colours; `None` for a black one.
pub(super) const fn primary(exposure: usize) -> Option<usize> {
    let primary = exposure % (COLOURS + 1);
    if primary < COLOURS { Some(primary) } else { None }
}

/// What the series lights.
pub(super) struct Series {
    spot: Vec<u32>,
    /// Beside so much light that of black pixels is little, which the lamp's flicker changes too.
    wide: Vec<u32>,
}

impl Series {
    pub(super) fn of(holder: &Holder, views: &Views) -> Self {
        let direction = holder.series();
        let ratio = views.exposure_s / views.times_s[0];
        let wide_deg = (views.spot_deg() * (WIDE * ratio).sqrt()).clamp(views.spot_deg(), WIDEST_DEG);
        Self {
            spot: holder.lit(direction),
            wide: maker(&holder.rig, wide_deg)
                .lit_set(lights::direction(direction))
                .map_or_else(|_| Vec::new(), |lit| lit.pixels),
        }
    }
}

/// Refuses tilts at which the standard would stand twice: the same evidence counts once.
pub(super) fn check_tilts(tilts: &[Tilt]) -> Result<(), CalibrateError> {
    for (index, tilt) in tilts.iter().enumerate() {
        let mut before = std::iter::once(None).chain(tilts[..index].iter().copied().map(Some));
        if before.any(|other| Tilt::is_same(other, Some(*tilt))) {
            return Err(CalibrateError::Views {
                expected: "tilts of the standard that differ from each other and from none".to_owned(),
                found: format!("{tilt} again"),
                advice: "give each of --tilts once; the standard is captured without a tilt anyway",
            });
        }
    }
    Ok(())
}

/// The holder at one tilt.
pub(super) struct Holder {
    pub(super) tilt: Option<Tilt>,
    /// The rig with the tilt, its camera image scaled.
    pub(super) rig: Rig,
    /// Indices of the directions that are lit, whole segments of them.
    pub(super) directions: Vec<usize>,
    maker: PatternMaker,
}

impl Holder {
    pub(super) fn new(full: &Rig, tilt: Option<Tilt>, image_size: u32) -> Result<Self, CalibrateError> {
        let rig = full.tilted(tilt)?.with_image_size(image_size)?;
        let mut directions = lights::measurable(&rig);
        if directions.len() < SEGMENT {
            return Err(CalibrateError::Views {
                expected: format!("at least {SEGMENT} incident directions that the projector can light"),
                found: directions.len().to_string(),
                advice: "check the rig, and the tilts",
            });
        }
        // The last segment is filled with the first ones again.
        let rest = directions.len().next_multiple_of(SEGMENT) - directions.len();
        directions.extend_from_within(..rest);
        Ok(Self {
            tilt,
            maker: maker(&rig, rig.light.spot_deg),
            rig,
            directions,
        })
    }

    /// Lights cones of `spot_deg` from now on.
    pub(super) fn set_spot(&mut self, spot_deg: f64) {
        self.maker = maker(&self.rig, spot_deg);
    }

    /// Pixels that light the incident direction of this index.
    pub(super) fn lit(&self, index: usize) -> Vec<u32> {
        self.maker
            .lit_set(lights::direction(index))
            .map_or_else(|_| Vec::new(), |lit| lit.pixels)
    }

    /// The direction of the series: one of those nearest to 45°.
    fn series(&self) -> usize {
        let off = |at: &usize| (lights::angles_deg(*at).0 - 45.0).abs();
        let nearest = self
            .directions
            .iter()
            .copied()
            .min_by(|a, b| off(a).total_cmp(&off(b)));
        nearest.expect("invariant: there are directions")
    }
}

/// Patterns of the incident directions.
pub(super) fn maker(rig: &Rig, spot_deg: f64) -> PatternMaker {
    PatternMaker::new(View::projector(rig), spot_deg, 1.0)
}
