//! The residuals of a fit, and whether they support the model.
//!
//! # Design
//! χ² alone is a bad judge: where samples are precise every model of a real material is refuted by it, and where the blur of
//! light and pixels makes the uncertainty large it swallows whatever is wrong. So a fit is held to two scales: χ² per degree
//! of freedom of at most [`CHI_SQUARED`], and a *lack of fit* of at most [`LACK_PERCENT`]. That is the part of the residuals
//! that averaging does not remove: samples at similar half vectors and incident angles are averaged, over all there are, and
//! the mean residual is taken relative to the mean f. χ² is only held against a model whose lack of fit is more than
//! [`NEGLIGIBLE_PERCENT`]: less than that is calibration rather than shape.

use super::Fit;
use super::model::combine;
use super::observations::{Observation, Observations};

/// Degrees of the half vector's polar angle that one point of the residuals' chart stands for.
const BIN_DEG: f64 = 3.0;
/// χ² per degree of freedom up to which residuals pass for noise.
const CHI_SQUARED: f64 = 3.0;
/// Lack of fit in percent up to which a model describes the sample.
const LACK_PERCENT: f64 = 10.0;
/// Lack of fit in percent that nobody minds, however precise the samples are.
const NEGLIGIBLE_PERCENT: f64 = 2.0;
/// Ranges of the half vector's polar angle in degrees (their ends), of the incident one, and of the half vector's azimuth
/// (along x, diagonal, along y) within which residuals are averaged.
const HALF_DEG: [f64; 9] = [2.0, 4.0, 7.0, 11.0, 17.0, 25.0, 37.0, 55.0, 90.0];
const INCIDENT_DEG: [f64; 3] = [35.0, 60.0, 90.0];
const AZIMUTHS: usize = 6;
/// Fewest samples whose mean says something.
const FEWEST: f64 = 25.0;
/// Share of the mean f of all samples below which f counts as that: relative to nothing everything is large.
const FLOOR: f64 = 0.01;

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

/// One sample and what the fit leaves of it.
struct Seen {
    half_deg: f64,
    /// Of the averaging range.
    range: usize,
    f: [f64; 3],
    /// Fit − f.
    residual: [f64; 3],
    /// Variance of f by noise.
    variance: [f64; 3],
}

/// Number of averaging ranges.
const RANGES: usize = HALF_DEG.len() * INCIDENT_DEG.len() * AZIMUTHS;

fn range(half: glam::DVec3, half_deg: f64, incident_deg: f64) -> usize {
    let at = |ends: &[f64], value: f64| ends.iter().position(|end| value < *end).unwrap_or(ends.len() - 1);
    // A half vector and the one across the normal are the same to the models.
    let azimuth = half.y.atan2(half.x).rem_euclid(std::f64::consts::PI) / std::f64::consts::PI;
    let azimuth = ((azimuth * AZIMUTHS as f64) as usize).min(AZIMUTHS - 1);
    (at(&HALF_DEG, half_deg) * INCIDENT_DEG.len() + at(&INCIDENT_DEG, incident_deg)) * AZIMUTHS + azimuth
}

impl Fit {
    /// Fills in the residuals and what they say; `is_bounded` if the parameters had to be kept within bounds.
    pub(super) fn judge(&mut self, seen: &Observations, is_bounded: bool) {
        let each = self.seen(seen);
        self.residuals = residuals(&each, seen.channels);
        self.lack_of_fit_percent = lack_of_fit(&each, seen.channels).map(|share| 100.0 * share);
        let mut against = Vec::new();
        if !self.converged {
            against.push("the fit has not converged".to_owned());
        }
        if is_bounded {
            let names: Vec<&str> = self
                .parameters
                .iter()
                .filter(|parameter| parameter.at_bound)
                .map(|parameter| parameter.name.as_str())
                .collect();
            against.push(if names.is_empty() {
                "the samples ask for parameters that are not physical".to_owned()
            } else {
                format!("{} would leave what is physical", names.join(", "))
            });
        }
        let chi_squared = self.chi_squared_per_degree;
        match self.lack_of_fit_percent {
            None => against.push("the samples are too few and too scattered to judge the model by them".to_owned()),
            Some(lack) if lack > LACK_PERCENT => against.push(format!(
                "the model misses f by {lack:.0} % where averaging leaves no noise, more than {LACK_PERCENT} %"
            )),
            Some(lack) if chi_squared > CHI_SQUARED && lack > NEGLIGIBLE_PERCENT => against.push(format!(
                "χ² per degree of freedom is {chi_squared:.1}, more than {CHI_SQUARED}, and the model misses f by {lack:.1} % \
                 where averaging leaves no noise"
            )),
            // NaN too.
            Some(_) if !chi_squared.is_finite() => against.push("χ² is not a number".to_owned()),
            Some(_) => {}
        }
        for parameter in self.parameters.iter().filter(|parameter| parameter.at_bound) {
            self.warnings.push(format!(
                "{} sits at its bound of {}",
                parameter.name, parameter.value
            ));
        }
        self.acceptable = against.is_empty();
        if !self.acceptable {
            self.warnings.insert(
                0,
                format!(
                    "the fitted {} model does not describe the samples, its parameters are not to be relied on: {}",
                    self.model.name(),
                    against.join("; ")
                ),
            );
            self.covariance = None;
            for parameter in &mut self.parameters {
                parameter.standard_uncertainty = None;
            }
        }
    }

    fn seen(&self, seen: &Observations) -> Vec<Seen> {
        let first = self.parameters.len() - 2 * seen.channels;
        let linear = |channel: usize, part: usize| self.parameters[first + 2 * channel + part].value;
        let of = |sample: &Observation| {
            let (light, place) = (
                sample.light[0] + sample.light[3],
                sample.places[0] + sample.places[3],
            );
            let half = (light + place).normalize();
            let half_deg = half.z.clamp(0.0, 1.0).acos().to_degrees();
            let incident_deg = light.normalize().z.clamp(0.0, 1.0).acos().to_degrees();
            let parts = self.model.parts(self.shape, sample);
            let mut one = Seen {
                half_deg,
                range: range(half, half_deg, incident_deg),
                f: sample.f,
                residual: [0.0; 3],
                variance: [0.0; 3],
            };
            for channel in 0..seen.channels {
                let f = sample.f[channel];
                one.residual[channel] = combine(parts, linear(channel, 0), linear(channel, 1)) - f;
                one.variance[channel] = sample.variance_at(f);
            }
            one
        };
        seen.all.iter().map(of).collect()
    }
}

/// Root mean square, over the ranges with enough samples and the channels, of the mean residual relative to the mean f,
/// without what noise does to the mean.
fn lack_of_fit(each: &[Seen], channels: usize) -> Option<f64> {
    let (mut squares, mut count) = (0.0, 0.0);
    for channel in 0..channels {
        // Count, f, residual, its square.
        let mut sums = vec![[0.0_f64; 4]; RANGES];
        let mut total = 0.0;
        for one in each {
            let (f, residual) = (one.f[channel], one.residual[channel]);
            total += f;
            for (sum, add) in sums[one.range]
                .iter_mut()
                .zip([1.0, f, residual, residual * residual])
            {
                *sum += add;
            }
        }
        let floor = FLOOR * total / each.len() as f64;
        if floor.is_nan() || floor <= 0.0 {
            continue;
        }
        for [samples, f, residual, square] in sums.into_iter().filter(|sum| sum[0] >= FEWEST) {
            let mean = residual / samples;
            let scatter = (square / samples - mean * mean).max(0.0) / samples;
            squares += ((mean * mean - scatter).max(0.0)) / (f / samples).max(floor).powi(2);
            count += 1.0;
        }
    }
    (count > 0.0).then(|| (squares / count).sqrt())
}

/// The residuals of each range of the half vector's polar angle.
fn residuals(each: &[Seen], channels: usize) -> Vec<Residual> {
    let bins = (90.0 / BIN_DEG) as usize;
    // Count, f, (fit − f), its square, variance.
    let mut sums = vec![[0.0_f64; 5]; bins];
    for one in each {
        let bin = ((one.half_deg / BIN_DEG) as usize).min(bins - 1);
        for channel in 0..channels {
            let (f, residual) = (one.f[channel], one.residual[channel]);
            let add = [1.0, f, residual, residual * residual, one.variance[channel]];
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
