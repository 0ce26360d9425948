//! Evaluation: how good a measured BRDF is, by itself and against a known material.
//!
//! # Design
//! | file | holds |
//! |---|---|
//! | `scoring` | which samples are scored against a reference |
//! | `tally` | what each chunk adds |
//! | `histogram` | quantiles |
//! | `reciprocity`, `blur`, `repeat` | the figure of that name |
//! | `warnings` | what could not be stated, in sentences |
//!
//! Everything streams over the file once. Quantiles come from a histogram of log error, 200 bins a decade,
//! so a median is right to 0.6 % of itself and memory does not grow with the measurement.
//!
//! What is absent, empty or undefined is never scored: a figure over nothing is none (null in JSON), each states the share
//! of pairs of directions that it was found from, and those of the measurement are found from what was measured itself.
//! Values that were filled in are judged each kind by itself.
//!
//! The blur that finite light and finite pixels must cause is computed from the reference and reported beside
//! the error: on a sharp lobe it is most of it, and it is not a fault of the measurement.

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use crate::brdf::sample::Sample;
use crate::brdf::{Azimuth, Brdf, RegionBudget};
use crate::hemisphere::judged::is_judged;
use crate::instrument::calibration::{MeasuredArea, Standard};
use crate::store::StoreError;
use crate::store::provenance::Provenance;

mod blur;
pub(super) mod histogram;
mod reciprocity;
pub(super) mod repeat;
pub(super) mod scoring;
mod tally;
#[cfg(test)]
pub(crate) mod tests;
mod warnings;

pub use histogram::{Quantile, Quantiles};
pub use repeat::{Repeatability, repeatability};
use scoring::Floor;
use tally::{Judge, Part, ThetaBins};

/// What was found. What could not be found is `None`, and [`warnings`](Self::warnings) say why.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// Where φ = 0 lies on the sample.
    pub azimuth: Azimuth,
    /// Samples with a value.
    pub measured_samples: u64,
    /// Share of direction pairs with θ ≤ 80° that have a value; `None` if the file has no such pair.
    pub coverage: Option<f64>,
    /// Median of sigma/f over what was measured of those, all channels; the instrument's own opinion of its noise. Where f
    /// is 0 or less it counts as above all others.
    pub median_relative_sigma: Quantile,
    /// Which cause makes how much of σ, by regions of directions; empty if the file does not say.
    pub budget: Vec<RegionBudget>,
    /// What has no part in that uncertainty, for want of a calibration: directions, light and throughput. `None` if the file
    /// does not say.
    pub uncalibrated: Option<Vec<String>>,
    /// The reflectance standards behind the values; empty if the file names none.
    pub standards: Vec<Standard>,
    /// Area of the sample that the camera's pixels see; `None` if the file does not say.
    pub measured_area: Option<MeasuredArea>,
    /// |f(a,b) − f(b,a)| / mean over random pairs with θ ≤ 70° that were measured both ways, median.
    pub reciprocity_residual_median: Option<f64>,
    /// Pairs that went into it.
    pub reciprocity_pairs: usize,
    /// Share of the pairs with θ ≤ 70° that those are.
    pub reciprocity_share: f64,
    /// Directional albedo by incident polar angle.
    pub albedo: Vec<Albedo>,
    /// What light and pixels resolve.
    pub resolution: Resolution,
    /// Judged pairs by where their values come from; those that are missing too. Empty if there are none.
    pub provenance: Vec<Origin>,
    /// Comparison with the reference, if there is one.
    pub against_reference: Option<Comparison>,
    /// What cannot be stated, or only of a part, in sentences.
    pub warnings: Vec<String>,
}

/// Directional albedo ∫ f·cosθo dωo at one incident angle, mean over the azimuths in reach.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Albedo {
    /// Incident polar angle in degrees.
    pub theta_deg: f64,
    /// Mean over the channels; `None` where less than 99 % of the hemisphere has values.
    pub albedo: Option<f64>,
    /// Its standard uncertainty (k = 1), the samples' as if all of them were correlated: what calibration leaves is.
    pub standard_uncertainty: Option<f64>,
    /// ∫ f·cosθo dωo over what has values, however little that is; `None` if nothing has.
    pub measured_part: Option<f64>,
    /// Its standard uncertainty, as that of the albedo.
    pub part_uncertainty: Option<f64>,
    /// Share of ∫ cosθo dωo that has values.
    pub seen: f64,
    /// Share of it whose values were not measured but filled in.
    pub filled: f64,
}

/// Full widths of what is averaged over.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Resolution {
    /// Opening of the lit cone, degrees; `None` if the file does not say.
    pub light_deg: Option<f64>,
    /// Width of a camera pixel, the median over the cells, degrees; `None` if no cell has one.
    pub pixel_median_deg: Option<f64>,
    /// The same of the coarsest.
    pub pixel_worst_deg: Option<f64>,
}

/// The judged pairs of one provenance.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Origin {
    /// Its name.
    pub provenance: &'static str,
    /// Share of the judged pairs.
    pub share: f64,
    /// |f − reference| / reference where the reference is scored, if there is a reference and any such pair.
    pub relative_error: Option<Quantiles>,
}

/// Error against the reference for θ ≤ 80° both ways, samples of all channels that were measured themselves.
///
/// Relative errors are scored where the reference f ≥ max(1 % of its median, 0.01·albedo/π), channel by channel.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The reference as it was named.
    pub reference: String,
    /// Samples compared: measured, and the reference has a value.
    pub samples: u64,
    /// Those of them that are scored.
    pub scored_samples: u64,
    /// Share of all pairs of directions with θ ≤ 80° both ways (and channels) that are scored; `None` if there are none.
    pub scored_share: Option<f64>,
    /// |f − reference| / reference over the scored samples.
    pub relative_error: Quantiles,
    /// Share of the scored samples whose interval of k = 2 holds the reference; `None` if there are none.
    pub within_k2: Option<f64>,
    /// Peak signal-to-noise ratio in dB of f·cosθi at exposure 1, clipped to 1, over all compared samples; `None` if none of
    /// them is scored, or if there is no difference.
    pub psnr_db: Option<f64>,
    /// Whether there is no difference at all.
    pub is_exact: bool,
    /// Reciprocity residual of the reference itself, median over the pairs that the BRDF has: measured materials have one.
    pub reciprocity_residual_median: Option<f64>,
    /// Relative difference that finite light and pixels alone must make, where the reference is scored.
    pub blur: Quantiles,
    /// Opening of the lit cone in degrees.
    pub light_deg: Option<f64>,
    /// Width of a camera pixel in degrees, root mean square over the hemisphere.
    pub pixel_deg: Option<f64>,
}

/// Evaluates `brdf`, against `reference` (its name and itself) if there is one; `progress` is told how many
/// chunks of [`Brdf::chunks`] are done.
///
/// # Errors
/// [`StoreError`] if the file cannot be read or contradicts itself.
pub fn evaluate(
    brdf: &Brdf,
    reference: Option<(&str, &dyn Sample)>,
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Evaluation, StoreError> {
    let (grid, disk) = (brdf.grid(), brdf.disk());
    let bins = ThetaBins::new(grid);
    let cells: Vec<Option<DVec3>> = (0..disk.len())
        .map(|cell| {
            disk.direction(cell)
                .filter(|_| brdf.outgoing_reason(cell).is_none())
        })
        .collect();
    let floor = reference.map(|(_, sample)| Floor::of(sample, brdf.channels()));
    let judge = Judge {
        brdf,
        cells: &cells,
        reference: reference.map(|(_, sample)| sample).zip(floor),
        bins: &bins,
    };
    let done = std::sync::atomic::AtomicUsize::new(0);
    let total = (0..brdf.chunks())
        .into_par_iter()
        .map(|chunk| {
            let part = judge.part(chunk);
            progress(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1);
            part
        })
        .try_reduce(|| Part::new(bins.count()), |a, b| Ok(a.merge(b)))?;

    // How many pairs of directions with θ ≤ 80° there are in all.
    let directions = || (0..disk.len()).filter_map(|cell| disk.direction(cell));
    let judged_cells = directions().filter(|wo| is_judged(*wo)).count();
    let judged_incident = (0..grid.len())
        .filter(|&index| is_judged(grid.direction(index)))
        .count();
    let pairs = judged_cells * judged_incident;
    let share = |count: u64, of: usize| (of > 0).then(|| count as f64 / of as f64);

    let reciprocity = reciprocity::reciprocity(brdf, judge.reference.map(|(sample, _)| sample))?;
    let seen = total.seen();
    let against_reference = reference.zip(floor).map(|((name, sample), floor)| {
        let scored = seen.errors.count();
        let mse = (scored > 0).then(|| seen.squares / seen.compared as f64);
        Comparison {
            reference: name.to_owned(),
            samples: seen.compared,
            scored_samples: scored,
            scored_share: share(scored, pairs * brdf.channels()),
            relative_error: seen.errors.quantiles(),
            within_k2: (scored > 0).then(|| seen.within as f64 / scored as f64),
            psnr_db: mse.filter(|mse| *mse > 0.0).map(|mse| -10.0 * mse.log10()),
            is_exact: mse == Some(0.0) && seen.errors.is_all_zeros(),
            reciprocity_residual_median: reciprocity.of_reference,
            blur: blur::blur(brdf, sample, &floor, &cells),
            light_deg: blur::light_deg(brdf),
            pixel_deg: blur::pixel_deg(brdf, &cells),
        }
    });
    let whole = directions().map(|wo| wo.z).sum::<f64>() * disk.cell_sr() / std::f64::consts::PI;
    let mut evaluation = Evaluation {
        azimuth: brdf.azimuth().clone(),
        measured_samples: total.measured,
        coverage: share(total.pairs(), pairs),
        median_relative_sigma: seen.sigma.median(),
        budget: brdf.budget().to_vec(),
        uncalibrated: brdf.uncalibrated(),
        standards: brdf.standards(),
        measured_area: brdf.measured_area(),
        reciprocity_residual_median: reciprocity.median,
        reciprocity_pairs: reciprocity.pairs,
        reciprocity_share: reciprocity.share,
        albedo: total.albedo(&bins, whole),
        resolution: blur::resolution(brdf, &cells),
        provenance: origins(&total, pairs),
        against_reference,
        warnings: Vec::new(),
    };
    evaluation.warnings = warnings::warnings(&evaluation);
    Ok(evaluation)
}

/// The judged pairs by origin, of `pairs` in all.
fn origins(total: &Part, pairs: usize) -> Vec<Origin> {
    if pairs == 0 {
        return Vec::new();
    }
    let share = |count: u64| count as f64 / pairs as f64;
    let origin = |provenance: Provenance| Origin {
        provenance: provenance.name(),
        share: match provenance {
            Provenance::Missing => 1.0 - share(total.pairs()),
            _ => total.of(provenance).map_or(0.0, |of| share(of.pairs)),
        },
        relative_error: total
            .of(provenance)
            .filter(|of| of.errors.count() > 0)
            .map(|of| of.errors.quantiles()),
    };
    Provenance::ALL.map(origin).to_vec()
}
