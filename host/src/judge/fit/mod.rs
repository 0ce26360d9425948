//! Models fitted to a BRDF: parameters with covariance.
//!
//! # Design
//! | file | holds |
//! |---|---|
//! | `observations` | the samples, their lights and pixels, and their variances |
//! | `model` | Ward and GGX as sums of a diffuse part and a lobe |
//! | `shape` | the lobe's roughness along its axes, and where those lie |
//! | `parameters` | the same in names and numbers, with covariance |
//! | `solve` | weighted least squares by Levenberg and Marquardt |
//! | `systematic` | errors that all samples have in common |
//! | `verdict` | residuals, and whether they support the model |
//!
//! The model is averaged over the spot of light and over the pixel before it is compared: what the instrument blurs does
//! not pass for roughness. The covariance follows from the residuals as they turned out, so that it holds too where the
//! model is wrong by more than the noise, and where samples of one incident direction or of one cell of the disk share an
//! error. To it come, fully correlated, a tenth of what the blur shifts each parameter by (how well the blur is known limits
//! the fit of a sharp lobe), and what the uncertainty of the standard and of the directions does to all samples alike. What was
//! not calibrated is not in it, and named.
//!
//! A fit is *acceptable* if it has converged to physical parameters and its residuals support the model: by χ², and by
//! the systematic part of the residuals relative to f, which no uncertainty swallows. One that is not says why, in words,
//! and has no uncertainties: those of a wrong model mean nothing. A parameter that noise alone puts beyond its bound, as
//! that of a metal without diffuse part, counts as at the bound.
//!
//! A sample may lie turned in its holder: the azimuth of the lobe's axes is found too. Where a lobe is as wide both ways within its
//! uncertainty there is none.
//!
//! # Tradeoffs
//! Some 200,000 samples take part, not all.

mod model;
mod observations;
mod parameters;
mod shape;
mod solve;
mod systematic;
#[cfg(test)]
mod tests;
mod verdict;

use std::path::Path;

use crate::base::blame::Blame;
use crate::brdf::sample::Sample;
use crate::brdf::{Azimuth, Brdf};
use crate::judge::chart::{Axis, Chart, ChartError, Curve, Scale};
use crate::store::StoreError;

pub use model::Model;
use observations::Observations;
use parameters::Numbers;
pub use parameters::{AZIMUTH, Parameter};
use shape::SHAPE;
pub(crate) use shape::Shape;
use solve::{Range, Solution};
pub use verdict::Residual;

/// Share of the blur's effect by which it may be wrong (k = 1): how the spot is filled, and where in their pixels the
/// cells of the disk lie.
const BLUR_UNCERTAINTY: f64 = 0.1;
/// Standard uncertainties by which a free parameter may be beyond its bound, and a lobe has to stand out.
const CLEAR: f64 = 3.0;

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
    /// All on one side.
    #[error(
        "fit: expected half vectors all around the normal, with at least {expected} samples towards each of +x, +y, −x and \
         −y, found {found} towards {side}"
    )]
    OneSided {
        /// How many it takes on each side.
        expected: usize,
        /// How many there are.
        found: usize,
        /// Where they are too few.
        side: &'static str,
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

impl Blame for FitError {
    fn is_input(&self) -> bool {
        match self {
            Self::Store(error) => error.is_input(),
            Self::TooFew { .. } | Self::OneSided { .. } | Self::NoLobe { .. } => true,
        }
    }
}

/// A fitted model.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Fit {
    /// Which.
    pub model: Model,
    /// αx, αy, the azimuth if the lobe has one, then ρd and the strength of the lobe of each channel.
    pub parameters: Vec<Parameter>,
    /// Covariance of the parameters, row by row in their order; `None` if the fit is not acceptable.
    pub covariance: Option<Vec<Vec<f64>>>,
    /// Where φ = 0 lies, from which azimuths count; `None` of a known sample, which has its own.
    pub azimuth_zero: Option<Azimuth>,
    /// Samples (pairs of directions) that took part.
    pub samples: usize,
    /// Sum of squared residuals over their variances, per degree of freedom: 1 if noise is all there is.
    pub chi_squared_per_degree: f64,
    /// Systematic part of the residuals relative to f, in percent: root mean square over ranges of the half vector and the
    /// incident angle. `None` if no range has enough samples.
    pub lack_of_fit_percent: Option<f64>,
    /// Whether the minimum was reached.
    pub converged: bool,
    /// Whether the parameters stand for the sample, see [`warnings`](Self::warnings) if not.
    pub acceptable: bool,
    /// Why the fit is not acceptable, and what else is to be known of it, in sentences.
    pub warnings: Vec<String>,
    /// The residuals by the polar angle of the half vector.
    pub residuals: Vec<Residual>,
    #[serde(skip)]
    shape: Shape,
}

impl Fit {
    /// Fits `model` to a measured BRDF.
    ///
    /// # Errors
    /// [`FitError`].
    pub fn of_brdf(model: Model, brdf: &Brdf) -> Result<Self, FitError> {
        let mut fit = Self::new(model, &Observations::of_brdf(brdf)?)?;
        fit.azimuth_zero = Some(brdf.azimuth().clone());
        let unknown = brdf.uncalibrated().unwrap_or_default();
        if fit.acceptable && !unknown.is_empty() {
            fit.warnings.push(format!(
                "the uncertainties do not hold errors of {}: not calibrated",
                unknown.join(", ")
            ));
        }
        Ok(fit)
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
        let free = solve::start(model, seen, Range::Free);
        let mut solution = solve::solve(model, seen, &points, &free, Range::Free)?;
        let mut range = Range::Free;
        match beyond(&solution) {
            Beyond::Nothing => {}
            Beyond::Noise => {
                for at in (SHAPE..solution.unknowns.len()).step_by(2) {
                    let [rho_d, strength] = solve::physical(solution.unknowns[at], solution.unknowns[at + 1]);
                    solution.unknowns[at] = rho_d;
                    solution.unknowns[at + 1] = strength;
                }
            }
            Beyond::More => {
                range = Range::Physical;
                let bounded = solve::start(model, seen, range);
                solution = solve::solve(model, seen, &points, &bounded, range)?;
            }
        }
        let unknowns = &solution.unknowns;
        let of_shape = [unknowns[0], unknowns[1], unknowns[2]];
        if !stands_out(&solution) {
            return Err(FitError::NoLobe {
                alpha: Shape::of_unknowns(of_shape).alpha,
            });
        }
        let (sharp, is_sharp_converged) = solve::unknowns(model, &points, &points, unknowns, range)?;
        let degrees = (seen.all.len() * seen.channels - unknowns.len()) as f64;
        let shift = (&sharp - unknowns) * BLUR_UNCERTAINTY;
        let covariance = &solution.covariance + &shift * shift.transpose();
        let Numbers {
            parameters,
            covariance,
            shape,
        } = Numbers::of(model, unknowns, &covariance, seen.channels);
        let mut fit = Self {
            model,
            parameters,
            covariance: Some(
                covariance
                    .row_iter()
                    .map(|row| row.iter().copied().collect())
                    .collect(),
            ),
            azimuth_zero: None,
            samples: seen.all.len(),
            chi_squared_per_degree: solution.chi_squared / degrees,
            lack_of_fit_percent: None,
            converged: solution.is_converged && is_sharp_converged,
            acceptable: true,
            warnings: Vec::new(),
            residuals: Vec::new(),
            shape,
        };
        fit.judge(seen, range == Range::Physical);
        Ok(fit)
    }

    /// The value of a parameter, 0 if there is none of this `name`.
    pub(crate) fn value(&self, name: &str) -> f64 {
        let found = self.parameters.iter().find(|parameter| parameter.name == name);
        found.map_or(0.0, |parameter| parameter.value)
    }

    /// The lobe's roughness along its axes, and where those lie.
    pub(crate) const fn shape(&self) -> Shape {
        self.shape
    }

    /// The residuals as a chart.
    fn chart(&self, name: &str) -> Chart {
        let curve = |label: &str, of: fn(&Residual) -> f64| Curve {
            band: Vec::new(),
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

/// How far free parameters are from what is physical.
enum Beyond {
    Nothing,
    /// No farther than noise puts them.
    Noise,
    More,
}

fn beyond(solution: &Solution) -> Beyond {
    let mut worst = Beyond::Nothing;
    for at in SHAPE..solution.unknowns.len() {
        let is_diffuse = (at - SHAPE).is_multiple_of(2);
        let pair = if is_diffuse { at } else { at - 1 };
        let [rho_d, strength] = solve::physical(solution.unknowns[pair], solution.unknowns[pair + 1]);
        let excess = (solution.unknowns[at] - if is_diffuse { rho_d } else { strength }).abs();
        if excess > CLEAR * solution.covariance[(at, at)].sqrt() {
            return Beyond::More;
        }
        if excess > 0.0 {
            worst = Beyond::Noise;
        }
    }
    worst
}

/// Whether there is a lobe: its strength in some channel is clear of 0.
fn stands_out(solution: &Solution) -> bool {
    (SHAPE + 1..solution.unknowns.len()).step_by(2).any(|at| {
        solution.unknowns[at] > CLEAR * solution.covariance[(at, at)].sqrt() && solution.unknowns[at] > 0.0
    })
}
