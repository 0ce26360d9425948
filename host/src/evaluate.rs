//! Evaluation: how good a measured BRDF is, by itself and against a known material.
//!
//! # Design
//! Everything streams over the file once. Quantiles come from a histogram of log error, 200 bins a decade,
//! so a median is right to 1.2 % of itself and memory does not grow with the measurement.
//!
//! The blur that finite light and finite pixels must cause is computed from the reference and reported beside
//! the error: on a sharp lobe it is most of it, and it is not a fault of the measurement.

use std::f64::consts::PI;

use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;
use serde::Serialize;

use crate::brdf::Brdf;
use crate::direction::from_degrees;
use crate::incident::IncidentSet;
use crate::interpolation::Interpolation;
use crate::provenance::Provenance;
use crate::quadrature::{around, interpolated_pixel_rad, mean_f, spot_rad};
use crate::sample::Sample;
use crate::store::StoreError;

mod histogram;
mod repeat;

use histogram::LogHistogram;
pub use histogram::Quantiles;
pub use repeat::{Repeatability, repeatability};

/// Errors are judged up to this polar angle of both directions, in degrees.
pub const JUDGED_THETA_DEG: f64 = 80.0;
/// The reciprocity residual is that of directions up to this polar angle in degrees, as others state it.
pub const RECIPROCAL_THETA_DEG: f64 = 70.0;
/// Pairs of directions for the reciprocity residual.
const RECIPROCITY_PAIRS: usize = 20_000;
/// Bins of the polar angle in degrees where the incident directions form no rings.
const LIST_BIN_DEG: f64 = 5.0;
/// Incident directions for which the blur is computed.
const BLUR_DIRECTIONS: usize = 48;

/// What was found.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// Samples with a value.
    pub measured_samples: u64,
    /// Share of direction pairs with θ ≤ 80° that have a value.
    pub coverage: f64,
    /// Median of sigma/f over the judged samples; the instrument's own opinion of its noise.
    pub median_relative_sigma: f64,
    /// |f(a,b) − f(b,a)| / mean over random pairs with θ ≤ 70°, median.
    pub reciprocity_residual_median: Option<f64>,
    /// Pairs that went into it.
    pub reciprocity_pairs: usize,
    /// Directional albedo by incident polar angle.
    pub albedo: Vec<Albedo>,
    /// What light and pixels resolve.
    pub resolution: Resolution,
    /// Judged pairs by where their values come from; those that are missing too.
    pub provenance: Vec<Origin>,
    /// Comparison with the reference, if there is one.
    pub against_reference: Option<Comparison>,
}

/// Directional albedo ∫ f·cosθo dωo at one incident angle, mean over azimuth; unmeasured directions add nothing.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Albedo {
    /// Incident polar angle in degrees.
    pub theta_deg: f64,
    /// Mean over the channels.
    pub albedo: f64,
    /// Its standard uncertainty (k = 1), the samples' as if all of them were correlated: what calibration leaves is.
    pub standard_uncertainty: f64,
    /// Share of ∫ cosθo dωo that was measured.
    pub seen: f64,
}

/// Full widths of what is averaged over.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Resolution {
    /// Opening of the lit cone, degrees.
    pub light_deg: f64,
    /// Width of a camera pixel, the median over the cells, degrees.
    pub pixel_median_deg: f64,
    /// The same of the coarsest.
    pub pixel_worst_deg: f64,
}

/// The judged pairs of one provenance.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Origin {
    /// Its name.
    pub provenance: &'static str,
    /// Share of the judged pairs.
    pub share: f64,
    /// |f − reference| / reference, if there is a reference and any such pair.
    pub relative_error: Option<Quantiles>,
}

/// Error against the reference for θ ≤ 80° both ways, samples of all channels.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The reference as it was named.
    pub reference: String,
    /// Samples compared.
    pub samples: u64,
    /// |f − reference| / reference.
    pub relative_error: Quantiles,
    /// Peak signal-to-noise ratio in dB of f·cosθi, clipped to 1.
    pub psnr_db: f64,
    /// Reciprocity residual of the reference itself, median over the pairs that the BRDF has: measured materials have one.
    pub reciprocity_residual_median: Option<f64>,
    /// Relative difference that finite light and pixels alone must make.
    pub blur: Quantiles,
    /// Opening of the lit cone in degrees.
    pub light_deg: f64,
    /// Width of a camera pixel in degrees, root mean square over the hemisphere.
    pub pixel_deg: f64,
}

/// Bins of the incident polar angle: the rings of the grid, or a list's share of them.
struct ThetaBins {
    width_deg: f64,
}

impl ThetaBins {
    fn new(incident: &IncidentSet) -> Self {
        Self {
            width_deg: incident.step_deg().unwrap_or(LIST_BIN_DEG),
        }
    }

    fn count(&self) -> usize {
        (90.0 / self.width_deg).round() as usize
    }

    fn of(&self, theta_deg: f64) -> usize {
        ((theta_deg / self.width_deg) as usize).min(self.count() - 1)
    }
}

/// What one chunk adds.
#[derive(Clone)]
struct Part {
    error: LogHistogram,
    sigma: LogHistogram,
    squares: f64,
    compared: u64,
    measured: u64,
    judged: u64,
    /// Per bin of the incident polar angle.
    rings: Vec<Ring>,
    /// By code of provenance: judged pairs, and their errors.
    origins: Vec<(u64, LogHistogram)>,
}

/// Sums over the incident directions of one bin of the polar angle.
#[derive(Clone, Copy, Default)]
struct Ring {
    albedo: f64,
    sigma: f64,
    seen: f64,
    directions: u32,
}

impl Part {
    fn new(rings: usize) -> Self {
        Self {
            error: LogHistogram::new(),
            sigma: LogHistogram::new(),
            squares: 0.0,
            compared: 0,
            measured: 0,
            judged: 0,
            rings: vec![Ring::default(); rings],
            origins: vec![(0, LogHistogram::new()); Provenance::ALL.len()],
        }
    }

    fn merge(mut self, other: &Self) -> Self {
        self.error = self.error.merge(&other.error);
        self.sigma = self.sigma.merge(&other.sigma);
        self.squares += other.squares;
        self.compared += other.compared;
        self.measured += other.measured;
        self.judged += other.judged;
        for (a, b) in self.rings.iter_mut().zip(&other.rings) {
            a.albedo += b.albedo;
            a.sigma += b.sigma;
            a.seen += b.seen;
            a.directions += b.directions;
        }
        for (a, b) in self.origins.iter_mut().zip(&other.origins) {
            *a = (a.0 + b.0, a.1.clone().merge(&b.1));
        }
        self
    }
}

/// Evaluates `brdf`, against `reference` (its name and itself) if there is one; `progress` is told how many
/// chunks of [`Brdf::chunks`] are done.
///
/// # Errors
/// [`StoreError`] if the file cannot be read.
pub fn evaluate(
    brdf: &Brdf,
    reference: Option<(&str, &dyn Sample)>,
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Evaluation, StoreError> {
    let grid = brdf.grid();
    let bins = ThetaBins::new(grid);
    let cells: Vec<Option<DVec3>> = (0..brdf.disk().len())
        .map(|cell| {
            brdf.disk()
                .direction(cell)
                .filter(|_| brdf.outgoing_reason(cell).is_none())
        })
        .collect();
    let done = std::sync::atomic::AtomicUsize::new(0);
    let sample = reference.map(|(_, sample)| sample);
    let total = (0..brdf.chunks())
        .into_par_iter()
        .map(|chunk| {
            let part = part(brdf, chunk, &cells, sample, &bins);
            progress(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1);
            part
        })
        .try_reduce(|| Part::new(bins.count()), |a, b| Ok(a.merge(&b)))?;

    let (residual, own_residual, pairs) = reciprocity(brdf, sample)?;
    // How many pairs of directions with θ ≤ 80° there are in all.
    let judged_cells = (0..brdf.disk().len())
        .filter(|&cell| brdf.disk().direction(cell).is_some_and(is_judged))
        .count();
    let judged_incident = (0..grid.len())
        .filter(|&index| is_judged(grid.direction(index)))
        .count();
    let pairs_judged = (judged_cells as f64 * judged_incident as f64).max(1.0);
    let origins = Provenance::ALL
        .into_iter()
        .zip(&total.origins)
        .map(|(provenance, (count, errors))| Origin {
            provenance: provenance.name(),
            share: match provenance {
                Provenance::Missing => 1.0 - total.judged as f64 / pairs_judged,
                _ => *count as f64 / pairs_judged,
            },
            relative_error: (errors.count() > 0).then(|| errors.quantiles()),
        })
        .collect();
    let against_reference = reference.map(|(name, sample)| Comparison {
        reference: name.to_owned(),
        samples: total.compared,
        relative_error: total.error.quantiles(),
        psnr_db: -10.0 * (total.squares / total.compared.max(1) as f64).max(1e-30).log10(),
        reciprocity_residual_median: own_residual,
        blur: blur(brdf, sample, &cells),
        light_deg: brdf.spot_deg(),
        pixel_deg: pixel_deg(brdf, &cells),
    });
    Ok(Evaluation {
        measured_samples: total.measured,
        coverage: total.judged as f64 / pairs_judged,
        median_relative_sigma: total.sigma.quantile(0.5),
        reciprocity_residual_median: residual,
        reciprocity_pairs: pairs,
        albedo: albedo(&total.rings, &bins),
        resolution: resolution(brdf, &cells),
        provenance: origins,
        against_reference,
    })
}

/// Whether a direction is among those that are judged.
pub(crate) fn is_judged(w: DVec3) -> bool {
    w.z >= JUDGED_THETA_DEG.to_radians().cos()
}

fn pixel_deg(brdf: &Brdf, cells: &[Option<DVec3>]) -> f64 {
    let seen = || (0..cells.len()).filter(|&cell| cells[cell].is_some());
    let total_sr: f64 = seen().map(|cell| brdf.pixel_sr(cell)).sum();
    (total_sr / seen().count().max(1) as f64).sqrt().to_degrees()
}

fn part(
    brdf: &Brdf,
    chunk: usize,
    cells: &[Option<DVec3>],
    sample: Option<&dyn Sample>,
    bins: &ThetaBins,
) -> Result<Part, StoreError> {
    let mut part = Part::new(bins.count());
    let Some(rows) = brdf.chunk(chunk)? else {
        return Ok(part);
    };
    let channels = brdf.channels();
    let count = brdf.disk().len();
    let cell_sr = brdf.disk().cell_sr();
    for (place, index) in brdf.chunk_range(chunk).enumerate() {
        if brdf.incident_reason(index).is_some() {
            continue;
        }
        let wi = brdf.grid().direction(index);
        let judged_in = is_judged(wi);
        let lobe = sample.filter(|_| judged_in).map(|sample| sample.incident(wi));
        let mut sums = Ring::default();
        for (cell, wo) in cells.iter().enumerate() {
            let Some(wo) = *wo else { continue };
            let code = usize::from(rows.provenance[place * count + cell]);
            if code == usize::from(Provenance::Missing.code()) {
                continue;
            }
            let at = (place * count + cell) * channels;
            let f = &rows.f[at..at + channels];
            let sigma = &rows.sigma[at..at + channels];
            part.measured += 1;
            let projected_sr = wo.z * cell_sr;
            let mean = |sum: f64| projected_sr * sum / channels as f64;
            sums.albedo += mean(f.iter().map(|&f| f64::from(f)).sum());
            sums.sigma += mean(sigma.iter().map(|sigma| sigma.to_f64()).sum());
            sums.seen += projected_sr / PI;
            if !(judged_in && is_judged(wo)) {
                continue;
            }
            part.judged += 1;
            // A code of a later version counts as the last that is known.
            let origin = &mut part.origins[code.min(Provenance::ALL.len() - 1)];
            origin.0 += 1;
            part.sigma
                .add(f64::from(sigma[0]) / f64::from(f[0]).abs().max(1e-12));
            if let Some(lobe) = &lobe {
                let truth = channel_values(lobe.f(wo), channels);
                for (&f, truth) in f.iter().zip(truth) {
                    let f = f64::from(f);
                    let error = (f - truth).abs() / truth.abs().max(1e-12);
                    part.error.add(error);
                    origin.1.add(error);
                    let clipped = |f: f64| (f * wi.z).clamp(0.0, 1.0);
                    part.squares += (clipped(f) - clipped(truth)).powi(2);
                    part.compared += 1;
                }
            }
        }
        let ring = &mut part.rings[bins.of(brdf.grid().angles_deg(index).0)];
        ring.albedo += sums.albedo;
        ring.sigma += sums.sigma;
        ring.seen += sums.seen;
        ring.directions += 1;
    }
    Ok(part)
}

/// What a camera of `channels` channels sees of the three of a sample: all, or their mean.
fn channel_values(f: [f64; 3], channels: usize) -> impl Iterator<Item = f64> {
    let f = if channels == 1 {
        [(f[0] + f[1] + f[2]) / 3.0; 3]
    } else {
        f
    };
    f.into_iter().take(channels)
}

fn albedo(rings: &[Ring], bins: &ThetaBins) -> Vec<Albedo> {
    let mean = |at: usize, ring: &Ring| {
        let per = f64::from(ring.directions).recip();
        Albedo {
            theta_deg: (at as f64 + 0.5) * bins.width_deg,
            albedo: ring.albedo * per,
            standard_uncertainty: ring.sigma * per,
            seen: ring.seen * per,
        }
    };
    let lit = rings.iter().enumerate().filter(|(_, ring)| ring.directions > 0);
    lit.map(|(at, ring)| mean(at, ring)).collect()
}

fn resolution(brdf: &Brdf, cells: &[Option<DVec3>]) -> Resolution {
    let mut widths_deg: Vec<f64> = (0..cells.len())
        .filter(|&cell| cells[cell].is_some())
        .map(|cell| brdf.pixel_sr(cell).sqrt().to_degrees())
        .collect();
    widths_deg.sort_by(f64::total_cmp);
    Resolution {
        light_deg: brdf.spot_deg(),
        pixel_median_deg: widths_deg.get(widths_deg.len() / 2).copied().unwrap_or(0.0),
        pixel_worst_deg: widths_deg.last().copied().unwrap_or(0.0),
    }
}

/// Medians of |f(a,b) − f(b,a)| / mean over random pairs of directions with θ ≤ 70°, of the BRDF and of `reference` over
/// the same pairs, and how many there were.
fn reciprocity(
    brdf: &Brdf,
    reference: Option<&dyn Sample>,
) -> Result<(Option<f64>, Option<f64>, usize), StoreError> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(0);
    let lowest = RECIPROCAL_THETA_DEG.to_radians().cos();
    let mut draw = || {
        let z: f64 = rng.random_range(lowest..1.0);
        from_degrees(z.acos().to_degrees(), rng.random_range(0.0..360.0))
    };
    let pairs: Vec<(DVec3, DVec3)> = (0..RECIPROCITY_PAIRS).map(|_| (draw(), draw())).collect();
    let both: Vec<(DVec3, DVec3)> = pairs.iter().flat_map(|&(a, b)| [(a, b), (b, a)]).collect();
    // As it was captured: other interpolations use what is measured here.
    let values = brdf.interpolated(&both, Interpolation::Direct)?;
    let residual = |forth: f64, back: f64| {
        let middle = f64::midpoint(forth, back);
        (middle > 0.0).then(|| (forth - back).abs() / middle)
    };
    let (mut residuals, mut own) = (Vec::new(), Vec::new());
    for (&(a, b), values) in pairs.iter().zip(values.chunks_exact(2)) {
        let mean =
            |value: &crate::brdf::Value| Some(value.ok()?.iter().map(|&f| f64::from(f)).sum::<f64>() / 3.0);
        let (Some(forth), Some(back)) = (mean(&values[0]), mean(&values[1])) else {
            continue;
        };
        residuals.extend(residual(forth, back));
        if let Some(reference) = reference {
            let mean = |a, b| reference.f(a, b).iter().sum::<f64>() / 3.0;
            own.extend(residual(mean(a, b), mean(b, a)));
        }
    }
    let count = residuals.len();
    let median = |mut all: Vec<f64>| {
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied()
    };
    Ok((median(residuals), median(own), count))
}

/// Relative difference between the reference averaged over the lit cone and the pixels, and itself.
fn blur(brdf: &Brdf, sample: &dyn Sample, cells: &[Option<DVec3>]) -> Quantiles {
    let light_rad = spot_rad(brdf.spot_deg());
    let channels = brdf.channels();
    let measured: Vec<usize> = (0..brdf.grid().len())
        .filter(|&index| brdf.incident_reason(index).is_none() && is_judged(brdf.grid().direction(index)))
        .collect();
    let every = measured.len().div_ceil(BLUR_DIRECTIONS).max(1);
    let chosen: Vec<usize> = measured.into_iter().step_by(every).collect();
    chosen
        .into_par_iter()
        .map(|index| {
            let mut histogram = LogHistogram::new();
            let wi = brdf.grid().direction(index);
            let sharp = sample.incident(wi);
            let lobes = around(wi, light_rad).map(|wi| sample.incident(wi));
            for (cell, wo) in cells.iter().enumerate() {
                let Some(wo) = wo.filter(|wo| is_judged(*wo)) else {
                    continue;
                };
                let places = around(wo, interpolated_pixel_rad(brdf.pixel_sr(cell)));
                let mean = mean_f(&lobes, &places);
                let truth = channel_values(sharp.f(wo), channels);
                for (blurred, truth) in channel_values(mean, channels).zip(truth) {
                    histogram.add((blurred - truth).abs() / truth.abs().max(1e-12));
                }
            }
            histogram
        })
        .reduce(LogHistogram::new, |a, b| a.merge(&b))
        .quantiles()
}
