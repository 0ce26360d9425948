//! The chooser: single, longer or multiplexed exposures, from a pilot capture and the photon-transfer curve.
//!
//! # Design
//! All alternatives fill the same time: that of the slowest among one pass of single exposures at the exposure time of a
//! plain measurement and one pass at each order. An alternative that is faster is exposed longer, as far as the camera does
//! not saturate, and then repeated. With σ² the variance of an exposure without light, x the signal of a value in electrons
//! and Σx that of its block, the variance of one pass is σ² + x alone and [`Code::variance_of_cells`] multiplexed; repeats
//! divide it. What counts is the **median relative standard uncertainty** √variance/x over all values with θ ≤ 80° both
//! ways; the same is given for regions of the angle from the mirror direction.
//!
//! # Tradeoffs
//! The block of a value is taken as one whose sum was captured, with the value itself in place of an average cell. In blocks
//! of few cells on a glossy sample that is right on average only.
//!
//! [`Code::variance_of_cells`]: super::Code::variance_of_cells

use serde::Serialize;

use super::pilot::{Singles, Sums, Value};
use crate::base::blame::Blame;
use crate::base::median::median;
use crate::capture::Instrument;
use crate::capture::directory::MeasurementError;
use crate::hemisphere::incident::IncidentError;
use crate::instrument::rig::Rig;
use crate::plan::light::cells::{CellError, disjoint_blocks};
use crate::plan::schedule::Timing;
use crate::plan::{PlanError, Request};

/// Orders that are tried unless one is asked for.
const ORDERS: [usize; 6] = [7, 15, 31, 63, 127, 255];

/// Regions of the angle from the mirror direction: name and where it ends in degrees.
pub const REGIONS: [(&str, f64); 4] = [("peak", 5.0), ("lobe", 20.0), ("diffuse", 60.0), ("tail", 180.0)];

/// Why nothing was chosen.
#[derive(Debug, thiserror::Error)]
pub enum MultiplexError {
    /// The order, or cells that overlap.
    #[error(transparent)]
    Cells(#[from] CellError),
    /// Planning and capture.
    #[error(transparent)]
    Measurement(#[from] MeasurementError),
}

impl Blame for MultiplexError {
    fn is_input(&self) -> bool {
        match self {
            Self::Cells(_) => true,
            Self::Measurement(error) => error.is_input(),
        }
    }
}

impl From<IncidentError> for MultiplexError {
    fn from(error: IncidentError) -> Self {
        Self::Measurement(error.into())
    }
}

/// How light is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// One exposure per direction, as a plain measurement takes it.
    Single,
    /// Single exposures, longer or repeated to fill the time.
    LongSingle,
    /// Coded exposures of blocks.
    Multiplexed,
}

/// One way to measure, and what is predicted for it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Alternative {
    /// How light is made.
    pub method: Method,
    /// Most cells of a block: 1 for single exposures.
    pub order: usize,
    /// Exposures of one pass.
    pub exposures: usize,
    /// Exposure time in s.
    pub exposure_s: f64,
    /// Passes that are averaged.
    pub repeats: usize,
    /// Time that all of it takes in s.
    pub time_s: f64,
    /// Median relative standard uncertainty over all values (k = 1); `None` without a value, or if half of them or more
    /// saturate.
    pub uncertainty: Option<f64>,
    /// The same in each of [`REGIONS`]; `None` where the pilot has no value.
    pub by_region: [Option<f64>; 4],
}

/// What was chosen, and from what.
#[derive(Clone, Debug, Serialize)]
pub struct Choice {
    /// Incident directions that can be lit.
    pub directions: usize,
    /// Time in s that every alternative may take.
    pub time_s: f64,
    /// Share of photon noise in the variance of a single exposure, median over all values; `None` without a value.
    pub photon_share: Option<f64>,
    /// All of them; the first is the plain measurement.
    pub alternatives: Vec<Alternative>,
    /// Orders that were left out, and why.
    pub refused: Vec<Refused>,
    /// Which alternative has the smallest median uncertainty.
    pub pick: usize,
    /// The pick and its reason in a sentence.
    pub verdict: String,
}

/// An order that cannot be used.
#[derive(Clone, Debug, Serialize)]
pub struct Refused {
    /// The order.
    pub order: usize,
    /// Why.
    pub reason: String,
}

/// Chooses for the directions of `request` on `rig` (its camera image scaled) from a pilot capture with `instrument`.
/// Without `order` all of 7, 15, … 255 are tried whose cells do not overlap.
///
/// # Errors
/// [`MultiplexError`].
pub fn choose(
    rig: &Rig,
    request: &Request,
    order: Option<usize>,
    instrument: &mut Instrument,
) -> Result<Choice, MultiplexError> {
    let singles = Singles::take(rig, request, instrument)?;
    let directions = singles.cells.len();
    let mut refused = Vec::new();
    let mut sums = Vec::new();
    for order in order.map_or_else(|| ORDERS.to_vec(), |order| vec![order]) {
        match disjoint_blocks(&singles.cells, order) {
            Ok(blocks) => sums.push((order, Sums::take(rig, &singles, blocks, instrument)?)),
            Err(error) => refused.push((order, error)),
        }
    }
    if sums.is_empty()
        && let Some((_, error)) = refused.first()
    {
        return Err((*error).into());
    }

    let cap_s = rig.camera.exposure_s;
    let plain_s = singles.longest_s.min(cap_s);
    let mut time_s = pass_s(rig, directions, plain_s)?;
    for (_, sums) in &sums {
        time_s = time_s.max(pass_s(rig, sums.blocks.exposures(), sums.longest_s.min(cap_s))?);
    }
    let mut alternatives = vec![
        single(rig, &singles, Method::Single, plain_s, 1)?,
        long_single(rig, &singles, time_s)?,
    ];
    for (order, sums) in sums {
        alternatives.push(multiplexed(rig, &singles, order, &sums, time_s)?);
    }
    let pick = (0..alternatives.len())
        .min_by(|a, b| rank(&alternatives[*a]).total_cmp(&rank(&alternatives[*b])))
        .expect("there are always single exposures");
    let photon_share = median(
        singles
            .values
            .iter()
            .map(|value| value.rate * plain_s)
            .map(|x| x / (x + rig.dark_variance_e2(plain_s)))
            .collect(),
    )
    .filter(|share| share.is_finite());
    Ok(Choice {
        directions,
        time_s,
        photon_share,
        verdict: verdict(&alternatives, pick, photon_share),
        alternatives,
        refused: refused
            .into_iter()
            .map(|(order, error)| Refused {
                order,
                reason: error.to_string(),
            })
            .collect(),
        pick,
    })
}

/// Single exposures of `exposure_s` seconds, `repeats` times, which are of `method`.
fn single(
    rig: &Rig,
    singles: &Singles,
    method: Method,
    exposure_s: f64,
    repeats: usize,
) -> Result<Alternative, MultiplexError> {
    let directions = singles.cells.len();
    let variance = |value: &Value, _: usize| rig.dark_variance_e2(exposure_s) + value.rate * exposure_s;
    let (uncertainty, by_region) = medians(&singles.values, exposure_s, repeats, variance);
    Ok(Alternative {
        method,
        order: 1,
        exposures: directions,
        exposure_s,
        repeats,
        time_s: pass_s(rig, directions, exposure_s)? * repeats as f64,
        uncertainty,
        by_region,
    })
}

/// Single exposures that fill `time_s` seconds.
fn long_single(rig: &Rig, singles: &Singles, time_s: f64) -> Result<Alternative, MultiplexError> {
    let (exposure_s, repeats) = filled(rig, singles.cells.len(), singles.longest_s, time_s)?;
    single(rig, singles, Method::LongSingle, exposure_s, repeats)
}

/// Coded exposures of blocks of `order` cells, whose `sums` were captured, that fill `time_s` seconds.
fn multiplexed(
    rig: &Rig,
    singles: &Singles,
    order: usize,
    sums: &Sums,
    time_s: f64,
) -> Result<Alternative, MultiplexError> {
    let exposures = sums.blocks.exposures();
    let (exposure_s, repeats) = filled(rig, exposures, sums.longest_s, time_s)?;
    let code = sums.blocks.code(0);
    let variance = |value: &Value, turn: usize| {
        let Some((rates, cells)) = sums.rates.get(turn % sums.rates.len().max(1)) else {
            return f64::INFINITY; // saturated even at the shortest exposure
        };
        let others = rates[value.pixel].max(0.0) * (*cells as f64 - 1.0) / *cells as f64;
        let total = (others + value.rate) * exposure_s;
        code.variance_of_cells(total, rig.dark_variance_e2(exposure_s), 1.0)
    };
    let (uncertainty, by_region) = medians(&singles.values, exposure_s, repeats, variance);
    Ok(Alternative {
        method: Method::Multiplexed,
        order,
        exposures,
        exposure_s,
        repeats,
        time_s: pass_s(rig, exposures, exposure_s)? * repeats as f64,
        uncertainty,
        by_region,
    })
}

/// The uncertainty to compare by: none is worse than any.
fn rank(alternative: &Alternative) -> f64 {
    alternative.uncertainty.unwrap_or(f64::INFINITY)
}

/// Time in s of `exposures` exposures of `exposure_s` seconds, all bands of them.
fn pass_s(rig: &Rig, exposures: usize, exposure_s: f64) -> Result<f64, MultiplexError> {
    let timing =
        Timing::new(rig, exposure_s).map_err(|error| MeasurementError::from(PlanError::from(error)))?;
    Ok(timing.period_s * (exposures * rig.shown_bands()) as f64)
}

/// Exposure time in s, at most `longest_s`, and repeats with which passes of `exposures` exposures fill `time_s`.
fn filled(rig: &Rig, exposures: usize, longest_s: f64, time_s: f64) -> Result<(f64, usize), MultiplexError> {
    let mut exposure_s = longest_s.min(rig.camera.exposure_s);
    // A step grows by no more than its exposure does.
    let slack_s = (time_s - pass_s(rig, exposures, exposure_s)?) / exposures as f64;
    exposure_s = longest_s.min(exposure_s + slack_s.max(0.0));
    // The hair is for a pass that takes the very time.
    let passes = time_s / pass_s(rig, exposures, exposure_s)? + 1e-9;
    Ok((exposure_s, (passes as usize).max(1)))
}

/// Median of √(variance/repeats)/signal, over all values and in each region, where it is a number; `variance(value, number
/// of the value)` is in e⁻².
fn medians(
    values: &[Value],
    exposure_s: f64,
    repeats: usize,
    variance: impl Fn(&Value, usize) -> f64,
) -> (Option<f64>, [Option<f64>; 4]) {
    let mut regions: [Vec<f64>; 4] = Default::default();
    for (turn, value) in values.iter().enumerate() {
        let relative = (variance(value, turn) / repeats as f64).sqrt() / (value.rate * exposure_s);
        let region = REGIONS
            .iter()
            .position(|(_, end_deg)| value.from_mirror_deg < *end_deg);
        // A block that saturated at this pixel says nothing but that.
        regions[region.unwrap_or(REGIONS.len() - 1)].push(if relative.is_nan() {
            f64::INFINITY
        } else {
            relative
        });
    }
    let number = |values: Vec<f64>| median(values).filter(|median| median.is_finite());
    let all = number(regions.iter().flatten().copied().collect());
    (all, regions.map(number))
}

fn verdict(alternatives: &[Alternative], pick: usize, photon_share: Option<f64>) -> String {
    let best = |multiplexed: bool| {
        alternatives
            .iter()
            .filter(|one| (one.method == Method::Multiplexed) == multiplexed)
            .filter_map(|one| Some((one, one.uncertainty?)))
            .min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let (Some((single, of_single)), Some(photon_share)) = (best(false), photon_share) else {
        return "no recommendation: the pilot captured no value that stands for an uncertainty".to_owned();
    };
    let Some((coded, of_coded)) = best(true) else {
        return "do not multiplex: no order can be used".to_owned();
    };
    let (photon, read) = (100.0 * photon_share, 100.0 * (1.0 - photon_share));
    if alternatives[pick].method == Method::Multiplexed {
        return format!(
            "multiplex with order {}: read noise makes {read:.0} % of the variance of a single exposure; the median \
             uncertainty falls by a factor of {:.2}",
            coded.order,
            of_single / of_coded
        );
    }
    let why = if photon_share > 0.5 {
        format!(
            "photon noise rules, with {photon:.0} % of the variance of a single exposure, and multiplexing adds that of \
             the other directions"
        )
    } else if coded.exposure_s < 0.8 * single.exposure_s {
        format!(
            "so many directions at once saturate the camera unless they are exposed {:.1} times shorter",
            single.exposure_s / coded.exposure_s
        )
    } else {
        "the photon noise of the other directions outweighs the read noise that is saved".to_owned()
    };
    format!(
        "do not multiplex: {why}; the best order, {}, would be {:.2} times as uncertain",
        coded.order,
        of_coded / of_single
    )
}

#[cfg(test)]
mod tests;
