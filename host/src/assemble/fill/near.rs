//! How well a model holds where something was measured, by half vector and difference angle.
//!
//! # Design
//! A lobe is a function of the half vector h, Fresnel's factor one of the angle θ_d between light and h (Rusinkiewicz, *A New Change of
//! Variables for Efficient BRDF Representation*, 1998). What the measured samples are off from the model is gathered in bins of both.
//! A bin is as wide as a sharp lobe, so all of what was measured in it may be what is asked for, the peak where the model has none.
//! Where neither a bin nor any of its neighbours has samples, nobody knows whether there is a lobe, and no model tells.

use std::f64::consts::TAU;

use glam::DVec3;

use super::{FillError, directions};
use crate::brdf::Brdf;
use crate::store::provenance::Provenance;

/// Bins of the polar angle of h, of its azimuth, and of θ_d.
const THETAS: usize = 9;
const PHIS: usize = 12;
const DIFFERENCES: usize = 6;
/// Fewest samples of a bin that tell.
const FEWEST: u32 = 5;
/// Samples that are looked at, about.
const SAMPLES: usize = 4_000_000;
/// The farthest sample of a bin is off by so many standard uncertainties at most.
const FARTHEST: f32 = 3.0;
/// How much more a model may be off where only its neighbours were seen.
const BEYOND: f32 = 2.0;
/// Share of the way to the brightest and the darkest sample of a bin that is one standard uncertainty.
const SPREAD: f32 = 0.5;

/// What the samples of a bin are off by, relative.
#[derive(Clone, Copy, Debug)]
struct Bin {
    count: u32,
    squares: f32,
    most: f32,
    /// The least and the most f, sr⁻¹, of each channel.
    range: [[f32; 2]; 3],
}

impl Default for Bin {
    fn default() -> Self {
        Self {
            count: 0,
            squares: 0.0,
            most: 0.0,
            range: [[f32::INFINITY, f32::NEG_INFINITY]; 3],
        }
    }
}

impl Bin {
    /// Adds a sample f that is so much off.
    fn add(&mut self, off: f32, f: [f32; 3]) {
        self.count += 1;
        self.squares += off * off;
        self.most = self.most.max(off);
        for ([low, high], f) in self.range.iter_mut().zip(f) {
            (*low, *high) = (low.min(f), high.max(f));
        }
    }

    /// Relative standard uncertainty of the model by it; `None` if it has too few samples.
    fn relative(&self) -> Option<f32> {
        let rms = (self.squares / self.count.max(1) as f32).sqrt();
        (self.count >= FEWEST).then(|| rms.max(self.most / FARTHEST))
    }
}

/// All bins, [θ of h][its φ][θ_d].
pub(super) struct Near(Vec<Bin>);

/// Places of a pair of directions among the bins.
fn place(wi: DVec3, wo: DVec3) -> [usize; 3] {
    let h = (wi + wo).normalize();
    let right = std::f64::consts::FRAC_PI_2;
    let bin = |angle: f64, whole: f64, count: usize| ((angle / whole * count as f64) as usize).min(count - 1);
    let theta = bin(h.z.clamp(-1.0, 1.0).acos(), right, THETAS);
    // About the normal all azimuths are near each other.
    let phi = if theta == 0 {
        0
    } else {
        bin(h.y.atan2(h.x).rem_euclid(TAU), TAU, PHIS)
    };
    [
        theta,
        phi,
        bin(wi.dot(h).clamp(-1.0, 1.0).acos(), right, DIFFERENCES),
    ]
}

const fn index([theta, phi, difference]: [usize; 3]) -> usize {
    (theta * PHIS + phi) * DIFFERENCES + difference
}

/// The bins around one, and itself.
fn around([theta, phi, difference]: [usize; 3]) -> impl Iterator<Item = usize> {
    let near = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
    near(theta, THETAS).flat_map(move |to_theta| {
        let phis: Vec<usize> = match (theta, to_theta) {
            (_, 0) => vec![0],
            (0, _) => (0..PHIS).collect(),
            _ => [PHIS - 1, 0, 1].map(|step| (phi + step) % PHIS).to_vec(),
        };
        phis.into_iter().flat_map(move |phi| {
            near(difference, DIFFERENCES).map(move |difference| index([to_theta, phi, difference]))
        })
    })
}

impl Near {
    /// What the measured samples of `brdf` are off from the `model`.
    ///
    /// # Errors
    /// [`FillError::Store`].
    pub(super) fn of(brdf: &Brdf, model: &dyn Fn(DVec3, DVec3) -> [f32; 3]) -> Result<Self, FillError> {
        let mut bins = vec![Bin::default(); THETAS * PHIS * DIFFERENCES];
        let (cells, channels) = (brdf.disk().len(), brdf.channels());
        let every = (cells * brdf.grid().len()).div_ceil(SAMPLES).max(1);
        let directions = directions(brdf);
        for chunk in 0..brdf.chunks() {
            let Some(rows) = brdf.chunk(chunk)? else { continue };
            for (row, incident) in brdf.chunk_range(chunk).enumerate() {
                let wi = brdf.grid().direction(incident);
                for (cell, wo) in directions
                    .iter()
                    .enumerate()
                    .skip(incident % every)
                    .step_by(every)
                {
                    let sample = row * cells + cell;
                    let is_seen =
                        Provenance::from_code(rows.provenance[sample]).is_some_and(Provenance::is_seen);
                    let Some(wo) = wo.filter(|_| is_seen) else {
                        continue;
                    };
                    let expected = model(wi, wo);
                    let off = |channel: usize| {
                        let expected = expected[channel].abs().max(f32::MIN_POSITIVE);
                        ((rows.f[sample * channels + channel] - expected) / expected).abs()
                    };
                    let off = (0..channels).map(off).fold(0.0, f32::max);
                    let shown = |channel: usize| rows.f[sample * channels + channel.min(channels - 1)];
                    bins[index(place(wi, wo))].add(off, std::array::from_fn(shown));
                }
            }
        }
        Ok(Self(bins))
    }

    /// Standard uncertainty of the value `f` of the model at a pair of directions, `least` at least, relative; `None` if nothing was
    /// measured near it.
    pub(super) fn sigma(&self, (wi, wo): (DVec3, DVec3), f: [f32; 3], least: f32) -> Option<[f32; 3]> {
        let place = place(wi, wo);
        let own = &self.0[index(place)];
        let is_seen = own.count >= FEWEST;
        let around = || around(place).map(|bin| &self.0[bin]).filter(|bin| bin.count > 0);
        let most = around().filter_map(Bin::relative).reduce(f32::max)?;
        let relative = least.max(if is_seen { most } else { BEYOND * most });
        let farthest = |channel: usize| {
            let of = |bin: &Bin| {
                let [low, high] = bin.range[channel];
                (high - f[channel]).max(f[channel] - low).max(0.0)
            };
            if is_seen {
                of(own)
            } else {
                around().map(of).fold(0.0, f32::max)
            }
        };
        Some(std::array::from_fn(|channel| {
            (relative * f[channel]).hypot(SPREAD * farthest(channel))
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;

    #[test]
    fn a_model_is_known_where_something_near_was_measured_and_nowhere_else() {
        let mut near = Near(vec![Bin::default(); THETAS * PHIS * DIFFERENCES]);
        let of = |theta_h_deg: f64, phi_h_deg: f64, theta_d_deg: f64| {
            let h = from_degrees(theta_h_deg, phi_h_deg);
            let side = h.any_orthonormal_vector() * theta_d_deg.to_radians().sin();
            [1.0, -1.0].map(|sign| h * theta_d_deg.to_radians().cos() + sign * side)
        };
        let [wi, wo] = of(25.0, 40.0, 20.0);
        near.0[index(place(wi, wo))] = Bin {
            count: 100,
            squares: 1.0,
            most: 0.2,
            range: [[0.1, 2.0]; 3],
        };
        // A model of 2 sr⁻¹ everywhere.
        let at = |theta_h_deg, phi_h_deg, theta_d_deg| {
            let [wi, wo] = of(theta_h_deg, phi_h_deg, theta_d_deg);
            let sigma = near.sigma((wi, wo), [2.0; 3], 0.05);
            assert_eq!(sigma, near.sigma((wo, wi), [2.0; 3], 0.05));
            sigma.map(|sigma| sigma[1])
        };
        // A tenth of it, and half of what it is above the darkest sample.
        assert_eq!(at(25.0, 40.0, 20.0), Some(0.2_f32.hypot(0.5 * 1.9)));
        assert_eq!(at(33.0, 62.0, 33.0), Some(0.4_f32.hypot(0.5 * 1.9)));
        assert_eq!(at(25.0, 40.0, 60.0), None);
        assert_eq!(at(45.0, 40.0, 20.0), None);
        assert_eq!(at(25.0, 130.0, 20.0), None);
        // About the normal there is no azimuth.
        let [wi, wo] = of(3.0, 10.0, 20.0);
        near.0[index(place(wi, wo))].count = 100;
        let [wi, wo] = of(15.0, 250.0, 20.0);
        assert!(near.sigma((wi, wo), [2.0; 3], 0.1).is_some());
    }
}
