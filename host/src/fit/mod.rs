//! Models fitted to a BRDF: parameters with covariance.
//!
//! # Design
//! | file | holds |
//! |---|---|
//! | `observations` | the samples, their lights and pixels, and their variances |
//! | `model` | Ward and GGX as sums of a diffuse part and a lobe |
//! | `solve` | weighted least squares by Levenberg and Marquardt |
//!
//! The model is averaged over the spot of light and over the pixel before it is compared: what the instrument blurs does
//! not pass for roughness. The covariance follows from the residuals as they turned out, so that it holds too where the
//! model is wrong by more than the noise. To it comes, fully correlated, a tenth of what the blur shifts each parameter by:
//! how well the blur is known limits the fit of a sharp lobe. What errors of light and throughput do to all samples alike is
//! not in it: nothing calibrates them yet.
//!
//! # Tradeoffs
//! Some 200,000 samples take part, not all; the axes of the lobe are the sample's x and y.

mod model;
mod observations;
mod solve;
#[cfg(test)]
mod tests;

use std::path::Path;

use nalgebra::DMatrix;

use crate::brdf::Brdf;
use crate::chart::{Axis, Chart, ChartError, Curve, Scale};
use crate::sample::Sample;
use crate::store::StoreError;

pub use model::Model;
use model::combine;
use observations::Observations;

/// Share of the blur's effect by which it may be wrong (k = 1): how the spot is filled, and where in their pixels the
/// cells of the disk lie.
const BLUR_UNCERTAINTY: f64 = 0.1;
/// Relative standard uncertainty of every parameter by what is left of blur and rounding: noise-free measurements of brass on
/// the virtual rigs come back within 0.14 %.
const LEFT: f64 = 1e-3;
/// Degrees of the half vector's polar angle that one point of the residuals' chart stands for.
const BIN_DEG: f64 = 3.0;

/// Why there is no fit.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// The file.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Nothing to fit to.
    #[error("fit: expected at least {expected} samples with θ of at most 80° both ways, found {found}")]
    TooFew {
        /// How many it takes.
        expected: usize,
        /// How many have a value.
        found: usize,
    },
    /// The samples do not determine the model.
    #[error(
        "fit: expected a lobe that the samples determine, found none (it ended at αx {:.4}, αy {:.4}); \
         a diffuse material has none, and one of a mirror is narrower than the pixels",
        alpha[0],
        alpha[1]
    )]
    NoLobe {
        /// Where the fit went.
        alpha: [f64; 2],
    },
}

/// One parameter of a fit.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Parameter {
    /// `ax`, `ay` (roughness along +x and +y), `rd` (diffuse reflectance), `rs` (Ward) or `f0` (GGX); those of colour
    /// channels end in `_r`, `_g`, `_b`.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Its standard uncertainty (k = 1).
    pub standard_uncertainty: f64,
}

/// A fitted model.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Fit {
    /// Which.
    pub model: Model,
    /// αx, αy, then ρd and the strength of the lobe of each channel.
    pub parameters: Vec<Parameter>,
    /// Covariance of the parameters, row by row in their order.
    pub covariance: Vec<Vec<f64>>,
    /// Samples (pairs of directions) that took part.
    pub samples: usize,
    /// Sum of squared residuals over their variances, per degree of freedom: 1 if noise is all there is.
    pub chi_squared_per_degree: f64,
    /// The residuals by the polar angle of the half vector.
    pub residuals: Vec<Residual>,
}

/// Residuals at similar half vectors.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct Residual {
    /// Middle of the bin: polar angle of the half vector, degrees.
    pub half_theta_deg: f64,
    /// Mean f in sr⁻¹.
    pub mean_f_sr: f64,
    /// Mean of (fit − f), in percent of the mean f.
    pub mean_percent: f64,
    /// Root mean square of (fit − f), in percent of the mean f.
    pub rms_percent: f64,
    /// Root mean square of the standard uncertainties of f, in percent of the mean f.
    pub noise_percent: f64,
}

impl Fit {
    /// Fits `model` to a measured BRDF.
    ///
    /// # Errors
    /// [`FitError`].
    pub fn of_brdf(model: Model, brdf: &Brdf) -> Result<Self, FitError> {
        Self::new(model, &Observations::of_brdf(brdf)?)
    }

    /// Fits `model` to a known sample.
    ///
    /// # Errors
    /// [`FitError`].
    pub fn of_sample(model: Model, sample: &dyn Sample) -> Result<Self, FitError> {
        Self::new(model, &Observations::of_sample(sample)?)
    }

    fn new(model: Model, seen: &Observations) -> Result<Self, FitError> {
        let points = seen.sharp();
        let solution = solve::solve(model, seen, &points, &solve::start(model, seen))?;
        let sharp = solve::solve(model, &points, &points, &solution.unknowns)?;
        let unknowns = &solution.unknowns;
        // From ln α to α.
        let scale = |at: usize| if at < 2 { unknowns[at].exp() } else { 1.0 };
        let value = |at: usize| if at < 2 { scale(at) } else { unknowns[at] };
        let degrees = (seen.all.len() * seen.channels - unknowns.len()) as f64;
        let chi_squared_per_degree = solution.chi_squared / degrees;
        let shift = (&sharp.unknowns - unknowns) * BLUR_UNCERTAINTY;
        let covariance = solution.covariance + &shift * shift.transpose();
        let covariance = DMatrix::from_fn(unknowns.len(), unknowns.len(), |i, j| {
            let left = if i == j { LEFT * value(i) } else { 0.0 };
            covariance[(i, j)] * scale(i) * scale(j) + left * left
        });
        let name = |at: usize| match at {
            0 => "ax".to_owned(),
            1 => "ay".to_owned(),
            _ => {
                let part = if at.is_multiple_of(2) {
                    "rd"
                } else {
                    model.strength()
                };
                match seen.channels {
                    1 => part.to_owned(),
                    _ => format!("{part}_{}", ["r", "g", "b"][at / 2 - 1]),
                }
            }
        };
        let parameters = (0..unknowns.len()).map(|at| Parameter {
            name: name(at),
            value: value(at),
            standard_uncertainty: covariance[(at, at)].sqrt(),
        });
        let parameters: Vec<Parameter> = parameters.collect();
        Ok(Self {
            model,
            residuals: residuals(model, seen, &parameters),
            parameters,
            covariance: covariance
                .row_iter()
                .map(|row| row.iter().copied().collect())
                .collect(),
            samples: seen.all.len(),
            chi_squared_per_degree,
        })
    }

    /// The residuals as a chart.
    fn chart(&self, name: &str) -> Chart {
        let curve = |label: &str, of: fn(&Residual) -> f64| Curve {
            label: label.to_owned(),
            points: self
                .residuals
                .iter()
                .map(|residual| (residual.half_theta_deg, Some(of(residual))))
                .collect(),
        };
        let curves = vec![
            curve("mean", |residual| residual.mean_percent),
            curve("RMS", |residual| residual.rms_percent),
            curve("noise (k = 1)", |residual| residual.noise_percent),
        ];
        let values = curves
            .iter()
            .flat_map(|curve| &curve.points)
            .filter_map(|point| point.1);
        Chart {
            title: format!("{name}: {} fitted", self.model.name()),
            y: Axis::covering("fit − f (% of the mean f there)", values),
            x: Axis {
                label: "polar angle of the half vector (°)".to_owned(),
                ticks: (0..=6).map(|tick| f64::from(tick) * 15.0).collect(),
                scale: Scale::Linear,
            },
            legend: "residual".to_owned(),
            marks: true,
            curves,
        }
    }

    /// Draws the residuals of the fit to the BRDF called `name` into `path` (`.svg`, `.png`).
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn save_residuals(&self, name: &str, path: &Path) -> Result<(), ChartError> {
        self.chart(name).save(path)
    }
}

fn residuals(model: Model, seen: &Observations, parameters: &[Parameter]) -> Vec<Residual> {
    let bins = (90.0 / BIN_DEG) as usize;
    // Count, f, (fit − f), its square, variance.
    let mut sums = vec![[0.0_f64; 5]; bins];
    let alpha = [parameters[0].value, parameters[1].value];
    for sample in &seen.all {
        let half = (sample.light[0] + sample.light[3] + sample.places[0] + sample.places[3]).normalize();
        let bin = ((half.z.clamp(0.0, 1.0).acos().to_degrees() / BIN_DEG) as usize).min(bins - 1);
        let parts = model.parts(alpha, sample);
        for (channel, &f) in sample.f[..seen.channels].iter().enumerate() {
            let [rho_d, strength] = [0, 1].map(|part| parameters[2 + 2 * channel + part].value);
            let residual = combine(parts, rho_d, strength) - f;
            let add = [1.0, f, residual, residual * residual, sample.variance_at(f)];
            for (sum, add) in sums[bin].iter_mut().zip(add) {
                *sum += add;
            }
        }
    }
    sums.iter()
        .enumerate()
        .filter(|(_, sum)| sum[0] > 0.0 && sum[1] > 0.0)
        .map(|(bin, &[count, f, residual, square, variance])| {
            let percent = 100.0 * count / f;
            Residual {
                half_theta_deg: (bin as f64 + 0.5) * BIN_DEG,
                mean_f_sr: f / count,
                mean_percent: percent * residual / count,
                rms_percent: percent * (square / count).sqrt(),
                noise_percent: percent * (variance / count).sqrt(),
            }
        })
        .collect()
}
