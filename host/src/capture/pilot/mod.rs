//! The pilot capture, which chooses the exposure time, or those of several exposures, and how wide spots of light are.

use crate::capture::directory::MeasurementError;
use crate::capture::{Captured, Instrument, Tally};
use crate::hemisphere::judged::is_judged;
use crate::instrument::optics::{DirectionMap, View};
use crate::instrument::rig::Rig;
use crate::plan::light::Coding;
use crate::plan::pattern::PatternMaker;
use crate::plan::schedule::{LONGEST_EXPOSURE_S, SHORTEST_EXPOSURE_S, Timing};
use crate::plan::{Directions, PlanError, Request};

mod brackets;
mod light;
mod spot;

pub use brackets::{Proposal, propose};
pub use light::{LightChoice, choose_light};
pub use spot::{SpotChoice, choose_spot};

/// Incident directions of the pilot capture that chooses the exposure time.
const PILOT_DIRECTIONS: usize = 48;
/// The pilot's brightest pixels (all but this share) shall come to [`PILOT_TARGET`] of the range.
pub(crate) const PILOT_CLIPPED: f64 = 1e-4;
/// See [`PILOT_CLIPPED`].
pub(crate) const PILOT_TARGET: f64 = 0.85;

/// The exposure time in s at which the brightest pixels of a few test exposures nearly fill the camera's range;
/// at most the rig's default, beyond which the measurement would take longer than the rig is made for.
///
/// `rig` has its camera image scaled as `request` will be measured, with patterns of `code` if there is one; `taken` is called while
/// exposures are taken.
///
/// # Errors
/// [`MeasurementError`].
pub fn auto_exposure_s(
    rig: &Rig,
    request: &Request,
    code: Option<Coding>,
    instrument: &mut Instrument,
    taken: &dyn Fn(),
) -> Result<f64, MeasurementError> {
    let patterns = patterns(rig, request, code)?;
    Ok(TestExposures::take_of(code, rig, &patterns, instrument, taken)?.auto_s(rig))
}

/// Lit pixels of some patterns that are spread over the grid of `request`, or of some patterns of its `code`.
fn patterns(rig: &Rig, request: &Request, code: Option<Coding>) -> Result<Vec<Vec<u32>>, MeasurementError> {
    let directions = Directions::new(rig, &request.grid)?;
    if let Some(code) = code {
        let cells = directions.lit_sets(rig, request.spot_deg(rig));
        let codes = code.patterns(cells.len()).map_err(PlanError::from)?;
        let irradiance = |number: &usize| codes.lit(*number).map(|cell| cells[cell].irradiance).sum::<f64>();
        let mut brightest: Vec<usize> = (0..codes.len()).collect();
        brightest.sort_by_cached_key(|number| (-1e9 * irradiance(number)) as i64);
        // Those with most light, and as many of all; an odd stride again: with inverted patterns both kinds come.
        let half = PILOT_DIRECTIONS / 2;
        brightest.truncate(half);
        brightest.extend((0..codes.len()).step_by((codes.len() / half).max(1) | 1));
        let lit = |number: usize| {
            let lit = codes.lit(number).flat_map(|cell| &cells[cell].pixels);
            lit.copied().collect()
        };
        return Ok(brightest.into_iter().map(lit).collect());
    }
    let measurable: Vec<usize> = directions.measurable().collect();
    let maker = PatternMaker::new(
        View::projector(rig),
        request.spot_deg(rig),
        rig.projector.irradiance,
    );
    Ok(spread(&directions, &measurable)
        .into_iter()
        .map(|at| maker.lit_set(directions.grid.direction(measurable[at])))
        .map(|lit| lit.map_or_else(|_| Vec::new(), |lit| lit.pixels))
        .collect())
}

/// Places in `indices` (of directions) of about [`PILOT_DIRECTIONS`] that are spread over those that are judged, or over all
/// if none is.
pub(crate) fn spread(directions: &Directions, indices: &[usize]) -> Vec<usize> {
    let mut judged: Vec<usize> = (0..indices.len())
        .filter(|&at| is_judged(directions.grid.direction(indices[at])))
        .collect();
    if judged.is_empty() {
        judged = (0..indices.len()).collect();
    }
    // An odd stride, so that halves and quarters of a turn do not come back ring after ring.
    let every = (judged.len() / PILOT_DIRECTIONS).max(1) | 1;
    judged.into_iter().step_by(every).collect()
}

/// Test exposures.
pub(crate) struct TestExposures {
    /// One for each pattern.
    pub(crate) shots: Vec<Captured>,
    /// Exposure time in s with which they were taken.
    pub(crate) exposure_s: f64,
    /// Exposure time in s at which their brightest pixels would come to [`PILOT_TARGET`] of the range.
    pub(crate) longest_s: f64,
    /// Whether they saturate although no exposure is shorter.
    pub(crate) is_too_bright: bool,
}

impl TestExposures {
    /// The exposure time in s that a measurement on `rig` has after them.
    pub(crate) fn auto_s(&self, rig: &Rig) -> f64 {
        self.longest_s
            .min(rig.camera.exposure_s)
            .clamp(SHORTEST_EXPOSURE_S, LONGEST_EXPOSURE_S)
    }

    /// Takes an exposure of each of `patterns` (lit pixels), shorter and shorter ones until they do not saturate, or cannot
    /// be shorter.
    pub(crate) fn take(
        rig: &Rig,
        patterns: &[Vec<u32>],
        instrument: &mut Instrument,
    ) -> Result<Self, MeasurementError> {
        Self::take_of(None, rig, patterns, instrument, &|| {})
    }

    /// As [`take`](Self::take), of rows of a `code` if there is one; `taken` is called while they are taken.
    pub(crate) fn take_of(
        code: Option<Coding>,
        rig: &Rig,
        patterns: &[Vec<u32>],
        instrument: &mut Instrument,
        taken: &dyn Fn(),
    ) -> Result<Self, MeasurementError> {
        let (counting, clipped) = counting(rig, code);
        let range = rig.range_dn();
        let mut exposure_s = rig
            .camera
            .exposure_s
            .clamp(SHORTEST_EXPOSURE_S, LONGEST_EXPOSURE_S);
        loop {
            let timing = Timing::new(rig, exposure_s).map_err(PlanError::from)?;
            let shots = instrument.take(
                patterns.len(),
                &[timing],
                |pattern, image| image.light(&patterns[pattern]),
                &mut Tally::default(),
                |_| taken(),
            )?;
            let mut dn: Vec<u16> = shots
                .iter()
                .flat_map(|shot| shot.dn.iter().zip(&counting))
                .filter_map(|(dn, counts)| counts.then_some(*dn))
                .collect();
            let mut is_too_bright = false;
            let longest_s = if dn.is_empty() {
                exposure_s // nothing to go by
            } else {
                let rank = ((dn.len() as f64 * (1.0 - clipped)) as usize).min(dn.len() - 1);
                let (_, bright, _) = dn.select_nth_unstable(rank);
                is_too_bright = *bright >= rig.saturation_dn();
                if is_too_bright && exposure_s > SHORTEST_EXPOSURE_S {
                    exposure_s = (exposure_s / 8.0).max(SHORTEST_EXPOSURE_S);
                    continue;
                }
                let fill = (f64::from(*bright) - rig.camera.dark_dn) / range;
                exposure_s * PILOT_TARGET / fill.max(1e-6)
            };
            return Ok(Self {
                shots,
                exposure_s,
                longest_s,
                is_too_bright,
            });
        }
    }
}

/// For each value of a frame of `rig`'s camera, whether exposures are chosen by it, and which share of those may clip: of single light those
/// that are judged, of rows of a `code` all, and none may. It would do so in most of the frames, and what is not known of the light that
/// it throws aside is in all directions of the block.
fn counting(rig: &Rig, code: Option<Coding>) -> (Vec<bool>, f64) {
    if code.is_some() {
        (vec![true; rig.frame_format().len()], 0.0)
    } else {
        (judged(rig).collect(), PILOT_CLIPPED)
    }
}

/// For each value of a frame of `rig`'s camera, whether its direction is judged. Near the horizon f grows without bound;
/// those few pixels may clip rather than darken all others.
fn judged(rig: &Rig) -> impl Iterator<Item = bool> {
    let channels = rig.channels();
    let map = DirectionMap::of(&View::camera(rig));
    let judged = map.directions.into_iter().map(|w| w.is_ok_and(is_judged));
    judged.flat_map(move |judged| std::iter::repeat_n(judged, channels))
}
