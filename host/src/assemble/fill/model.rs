//! The model for what nobody saw: a GGX lobe with a Lambert base, or a mean where there is no lobe.

use glam::DVec3;

use super::FillError;
use crate::brdf::Brdf;
use crate::brdf::sample::Sample;
use crate::judge::fit::{Fit, FitError, Model};
use crate::store::provenance::Provenance;

/// Relative uncertainty of a model that does not describe what was seen, and of one that does, at least.
const MODEL: f32 = 0.3;
const LEAST_MODEL: f32 = 0.1;

/// The model for what nobody saw.
pub(super) struct Modelled {
    pub(super) fit: Option<Fit>,
    /// Of each channel; a single one stands for all.
    samples: Vec<Box<dyn Sample>>,
    /// f in sr⁻¹ of each channel where there is no lobe.
    lambert: [f32; 3],
}

impl Modelled {
    /// By the measured samples of `brdf`.
    pub(super) fn of(brdf: &Brdf) -> Result<Self, FillError> {
        match Fit::of_brdf(Model::Ggx, brdf) {
            Ok(fit) => {
                let endings: &[&str] = if brdf.channels() == 1 {
                    &[""]
                } else {
                    &["_r", "_g", "_b"]
                };
                let samples = endings
                    .iter()
                    .map(|end| {
                        let (diffuse, strength) =
                            (fit.value(&format!("rd{end}")), fit.value(&format!("f0{end}")));
                        Model::Ggx.sample(fit.shape(), diffuse.max(0.0), strength.clamp(0.0, 1.0))
                    })
                    .collect();
                Ok(Self {
                    fit: Some(fit),
                    samples,
                    lambert: [0.0; 3],
                })
            }
            // A diffuse material has no lobe, and samples on one side say no more than their mean.
            Err(FitError::NoLobe { .. } | FitError::OneSided { .. }) => Ok(Self {
                fit: None,
                samples: Vec::new(),
                lambert: mean(brdf)?.map(|f| f.max(0.0)),
            }),
            // A whole hemisphere from a handful of samples would be made up.
            Err(FitError::TooFew { expected, found }) => Err(FillError::Nothing {
                path: brdf.path().display().to_string(),
                expected,
                found,
            }),
            Err(error) => Err(error.into()),
        }
    }

    pub(super) fn f(&self, wi: DVec3, wo: DVec3) -> [f32; 3] {
        if self.samples.is_empty() {
            return self.lambert;
        }
        std::array::from_fn(|channel| {
            let sample = &self.samples[channel.min(self.samples.len() - 1)];
            sample.f(wi, wo)[channel] as f32
        })
    }

    /// By how much f at a pair of directions is more than what lies between two other pairs, of the second of which it has
    /// this `share`.
    pub(super) fn hump(&self, at: (DVec3, DVec3), sides: [(DVec3, DVec3); 2], share: f32) -> [f32; 3] {
        let [f, a, b] = [at, sides[0], sides[1]].map(|(wi, wo)| self.f(wi, wo));
        std::array::from_fn(|c| f[c] - (a[c] + share * (b[c] - a[c])))
    }

    /// Least relative standard uncertainty of it: a tenth, because nobody saw whether the model goes on, and more of a fit that does
    /// not describe what was seen.
    pub(super) fn least(&self) -> f32 {
        match &self.fit {
            Some(fit) if !fit.acceptable => MODEL,
            _ => LEAST_MODEL,
        }
    }
}

/// Mean f of each channel over all measured samples.
fn mean(brdf: &Brdf) -> Result<[f32; 3], FillError> {
    let channels = brdf.channels();
    let (mut sums, mut count) = ([0.0_f64; 3], 0_u64);
    for chunk in 0..brdf.chunks() {
        let Some(rows) = brdf.chunk(chunk)? else { continue };
        for (sample, code) in rows.provenance.iter().enumerate() {
            if Provenance::from_code(*code).is_some_and(Provenance::is_seen) {
                count += 1;
                for (channel, sum) in sums.iter_mut().enumerate() {
                    *sum += f64::from(rows.f[sample * channels + channel.min(channels - 1)]);
                }
            }
        }
    }
    if count == 0 {
        return Err(FillError::Nothing {
            path: brdf.path().display().to_string(),
            expected: 1,
            found: 0,
        });
    }
    Ok(sums.map(|sum| (sum / count as f64) as f32))
}

#[cfg(test)]
use crate::judge::fit::Shape;

#[cfg(test)]
impl Modelled {
    /// A lobe of this width α.
    pub(super) fn of_lobe(alpha: f64) -> Self {
        Self {
            fit: None,
            samples: vec![Model::Ggx.sample(
                Shape {
                    alpha: [alpha; 2],
                    azimuth_rad: 0.0,
                },
                0.1,
                0.5,
            )],
            lambert: [0.0; 3],
        }
    }
}
