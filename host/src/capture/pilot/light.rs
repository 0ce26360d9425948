//! The pilot capture that chooses between single light and codes.
//!
//! # Design
//! A few single patterns, black ones, and a few of the patterns of every code that can be shown say what a pixel gathers: b of all
//! black projector pixels, x of a spot, Σx of the cells of a block. With them the variance of x follows for each way of light,
//! in an exposure that fills the camera as its brightest pixels allow (where many spots are lit, those are brighter), times the
//! time that all exposures take: what is left in the same time. The median of its root over x, over all judged values, counts.
//!
//! The cells of a block are taken to be like those of all.

use std::fmt;

use super::{PILOT_TARGET, TestExposures, judged, patterns};
use crate::base::median::median;
use crate::capture::Instrument;
use crate::capture::directory::MeasurementError;
use crate::instrument::rig::Rig;
use crate::plan::light::{Coding, usable};
use crate::plan::schedule::Timing;
use crate::plan::{Directions, PlanError, Request, most_cells};

/// Black patterns, whose mean counts.
const BLACK: usize = 4;
/// A code is chosen if it leaves less than this share of the noise of single light: beside noise it has no merits.
const WORTH: f64 = 0.9;

/// What was chosen, and why.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightChoice {
    /// The code; `None` for single light.
    pub code: Option<Coding>,
    /// The code that leaves least noise, and its noise over that of single light in the same time; `None` if there is none.
    pub best: Option<(Coding, f64)>,
    /// Light of all black projector pixels over that of a spot, median over the values.
    pub black: f64,
    /// Exposure time of single light over that of the code, in which both fill the camera.
    pub shorter: f64,
}

impl fmt::Display for LightChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some((best, noise)) = self.best else {
            return f.write_str(
                "pilot: single light, as no code can light these directions together without saturating",
            );
        };
        let why = format!(
            "black projector pixels shine {:.1} times as bright as a spot, and coded exposures fill the camera in {:.1} times \
             less time",
            self.black, self.shorter
        );
        if self.code.is_some() {
            write!(
                f,
                "pilot: {best} leaves {noise:.2} times the noise of single light in the same time: {why}"
            )
        } else {
            write!(
                f,
                "pilot: single light, as the best code, {best}, would leave {noise:.2} times its noise in the same time: {why}"
            )
        }
    }
}

/// Rates of judged values in e⁻/s, and how long exposures may be.
struct Rates {
    /// Of each pattern.
    patterns: Vec<Vec<f64>>,
    exposure_s: f64,
    /// Whether they saturate in exposures that are as long as is asked for.
    is_too_bright: bool,
}

/// The light that leaves least noise for `request` on `rig`, whose camera image is scaled as it will be measured; `taken` is called while
/// exposures are taken.
///
/// # Errors
/// [`MeasurementError`].
pub fn choose_light(
    rig: &Rig,
    request: &Request,
    instrument: &mut Instrument,
    taken: &dyn Fn(),
) -> Result<LightChoice, MeasurementError> {
    let single = Rates::take(rig, request, None, instrument, taken)?;
    let (dark, lit) = single.patterns.split_at(BLACK);
    let black: Vec<f64> = (0..dark[0].len())
        .map(|value| (dark.iter().map(|one| one[value]).sum::<f64>() / BLACK as f64).max(0.0))
        .collect();
    let least = 1.0 / single.exposure_s;
    // Of each value its place in a frame and its signal.
    let values: Vec<(usize, f64)> = lit
        .iter()
        .flat_map(|one| one.iter().zip(&black).enumerate())
        .map(|(value, (all, black))| (value, all - black))
        .filter(|(_, signal)| *signal > least)
        .collect();
    let directions = Directions::new(rig, &request.grid)?;
    let cells = directions.lit_sets(rig, request.spot_deg(rig));
    let noise = |exposures: usize, exposure_s: f64, variance_e2: &dyn Fn(usize, f64) -> f64| {
        let timing = Timing::new(rig, exposure_s).map_err(PlanError::from)?;
        let time_s = exposures as f64 * timing.period_s;
        let of =
            |(value, signal): &(usize, f64)| variance_e2(*value, *signal) / (signal * exposure_s).powi(2);
        let all: Vec<f64> = values.iter().map(|value| (time_s * of(value)).sqrt()).collect();
        Ok::<_, MeasurementError>(median(all).unwrap_or(f64::INFINITY))
    };
    let t = single.exposure_s;
    let of_single = noise(cells.len(), t, &|value, signal| {
        rig.dark_variance_e2(t) + (black[value] + signal) * t
    })?;
    let mut best: Option<(Coding, f64, f64)> = None;
    for (order, blocks) in usable(&cells, most_cells(request, rig)).into_iter().flatten() {
        let coding = Coding {
            order,
            complement: false,
        };
        let coded = Rates::take(rig, request, Some(coding), instrument, taken)?;
        if coded.is_too_bright && !single.is_too_bright {
            continue; // where it saturates it has no values
        }
        let t = coded.exposure_s;
        let code = blocks.code(0);
        let of = noise(blocks.exposures(), t, &|value, _| {
            // Half of these have most light of all, which is on the safe side.
            let shown = coded.patterns[BLACK..].iter().map(|one| one[value]);
            let mean = shown.sum::<f64>() / (coded.patterns.len() - BLACK).max(1) as f64;
            code.variance(
                code.order() as f64 * mean.max(black[value]) * t,
                rig.dark_variance_e2(t),
                1.0,
            )
        })?;
        if best.is_none_or(|(_, least, _)| of < least) {
            best = Some((coding, of, t));
        }
    }
    let ratios = values.iter().map(|(value, signal)| black[*value] / signal);
    let is_worth = |(_, noise, _): &(Coding, f64, f64)| *noise < WORTH * of_single;
    Ok(LightChoice {
        code: best.filter(is_worth).map(|(coding, ..)| coding),
        best: best.map(|(coding, noise, _)| (coding, noise / of_single)),
        black: median(ratios.collect()).unwrap_or(0.0),
        shorter: best.map_or(1.0, |(.., coded_s)| single.exposure_s / coded_s),
    })
}

impl Rates {
    /// Of black patterns and some of `code`, or single ones; the exposure time is the one that is asked for, or that which a
    /// measurement would have.
    fn take(
        rig: &Rig,
        request: &Request,
        code: Option<Coding>,
        instrument: &mut Instrument,
        taken: &dyn Fn(),
    ) -> Result<Self, MeasurementError> {
        let mut all = vec![Vec::new(); BLACK];
        all.extend(patterns(rig, request, code)?);
        let tests = TestExposures::take_of(code, rig, &all, instrument, taken)?;
        let judged: Vec<bool> = judged(rig).collect();
        let of = |shot: &crate::capture::Captured| {
            let judged = shot.dn.iter().zip(&judged).filter(|(_, judged)| **judged);
            judged
                .map(|(dn, _)| rig.light_e_per_s(*dn, tests.exposure_s))
                .collect()
        };
        Ok(Self {
            patterns: tests.shots.iter().map(of).collect(),
            exposure_s: request.exposure_s.unwrap_or_else(|| tests.auto_s(rig)),
            is_too_bright: request
                .exposure_s
                .is_some_and(|asked_s| asked_s > tests.longest_s / PILOT_TARGET),
        })
    }
}
