//! The samples that a model is fitted to.

use std::f64::consts::FRAC_1_SQRT_2;

use glam::DVec3;
use rayon::prelude::*;

use super::FitError;
use crate::brdf::Brdf;
use crate::brdf::quadrature::{around, interpolated_pixel_rad, spot_rad};
use crate::brdf::sample::Sample;
use crate::hemisphere::direction::from_degrees;
use crate::hemisphere::judged::is_judged;
use crate::store::provenance::Provenance;

/// Samples that take part, about: enough for every parameter of a lobe, and few enough for seconds.
const SAMPLES: usize = 200_000;
/// Fewer than this determine nothing.
const FEWEST: usize = 200;
/// Relative standard uncertainty that the values of a known sample are given.
const KNOWN: f64 = 0.01;

/// One sample: a pair of directions, f, and how its variance follows from f.
#[derive(Clone, Copy)]
pub(super) struct Observation {
    /// Four directions of light: ++, +−, −+, −−.
    pub(super) light: [DVec3; 4],
    /// Four places within the pixel, in the same order.
    pub(super) places: [DVec3; 4],
    /// f in sr⁻¹ per channel.
    pub(super) f: [f64; 3],
    /// Variance in sr⁻² at f = 0, and its rise with f in sr⁻¹.
    pub(super) variance: [f64; 2],
    /// The incident direction and the cell of the disk: samples that share one share its errors.
    pub(super) shared: [u32; 2],
}

impl Observation {
    /// Variance in sr⁻² of noise if the sample has the value `f`.
    pub(super) fn variance_at(&self, f: f64) -> f64 {
        self.variance[0] + self.variance[1] * f.max(0.0)
    }
}

/// What is fitted to.
pub(super) struct Observations {
    pub(super) all: Vec<Observation>,
    pub(super) channels: usize,
    /// Relative standard uncertainty that all f have in common.
    pub(super) common_uncertainty: f64,
    /// Standard uncertainty in radians, of one axis, that all outgoing and all incident directions have in common.
    pub(super) direction_rad: [f64; 2],
}

impl Observations {
    /// Samples of a measured BRDF with θ ≤ 80° both ways, spread evenly over all that have a value.
    ///
    /// Variances are those of the file, smoothed: that of a single sample follows from its own noisy value, and weights
    /// that know the noise would favour what came out too low. So they are a line over f in each image, times the mean ratio
    /// to it of the sample's cell of the disk: cells beside an edge are worse in all images.
    pub(super) fn of_brdf(brdf: &Brdf) -> Result<Self, FitError> {
        let cells: Vec<(usize, DVec3, f64)> = (0..brdf.disk().len())
            .filter_map(|cell| {
                let wo = brdf.disk().direction(cell).filter(|wo| is_judged(*wo))?;
                brdf.outgoing_reason(cell)
                    .is_none()
                    .then(|| (cell, wo, interpolated_pixel_rad(brdf.pixel_sr(cell))))
            })
            .collect();
        let captured =
            |index: usize| brdf.incident_reason(index).is_none() && is_judged(brdf.grid().direction(index));
        let images = (0..brdf.grid().len()).filter(|&index| captured(index)).count();
        // Odd, so that it does not stay in step with the disk's rows.
        let stride = (images * cells.len() / SAMPLES) | 1;
        let light = spot_rad(brdf.spot_deg());
        let channels = brdf.channels();
        let row = brdf.disk().len();
        // What was filled in was made from the same samples.
        let is_seen = |code: u8| Provenance::from_code(code).is_some_and(Provenance::is_seen);
        let mut all: Vec<Observation> = Vec::new();
        // Of each cell, the sums of its variances in the file and by the lines.
        let mut of_cells = vec![[0.0; 2]; row];
        for chunk in 0..brdf.chunks() {
            let Some(rows) = brdf.chunk(chunk)? else { continue };
            for (place, index) in brdf.chunk_range(chunk).enumerate() {
                if !captured(index) {
                    continue;
                }
                let lights = around(brdf.grid().direction(index), light);
                let mut image: Vec<(Observation, [f64; 3])> = cells
                    .iter()
                    .skip(index * 7 % stride)
                    .step_by(stride)
                    .filter(|(cell, ..)| is_seen(rows.provenance[place * row + cell]))
                    .map(|(cell, wo, pixel)| {
                        let at = (place * row + *cell) * channels;
                        let mut observation = Observation {
                            light: lights,
                            places: around(*wo, *pixel),
                            f: [0.0; 3],
                            variance: [0.0; 2],
                            shared: [index as u32, *cell as u32],
                        };
                        let mut squares = [0.0; 3];
                        for (out, &f) in observation.f.iter_mut().zip(&rows.f[at..at + channels]) {
                            *out = f64::from(f);
                        }
                        for (out, sigma) in squares.iter_mut().zip(&rows.sigma[at..at + channels]) {
                            *out = sigma.to_f64().powi(2);
                        }
                        (observation, squares)
                    })
                    .collect();
                let line = line(image.iter().flat_map(|(observation, squares)| {
                    observation.f.into_iter().zip(*squares).take(channels)
                }));
                for (observation, squares) in &mut image {
                    observation.variance = line;
                    let sums = &mut of_cells[observation.shared[1] as usize];
                    for (f, square) in observation.f.iter().zip(squares).take(channels) {
                        sums[0] += *square;
                        sums[1] += observation.variance_at(*f);
                    }
                }
                all.extend(image.into_iter().map(|(observation, _)| observation));
            }
        }
        for observation in &mut all {
            let [squares, lines] = of_cells[observation.shared[1] as usize];
            // A variance of 0 in the file would be no reason for any weight.
            let ratio = if squares > 0.0 { squares / lines } else { 1.0 };
            observation.variance = observation.variance.map(|part| part * ratio);
        }
        let [scale, fields] =
            [brdf.common_uncertainty(), brdf.field_uncertainty()].map(Option::unwrap_or_default);
        Self {
            all,
            channels,
            // A lobe and what lies around it may be off by as much as fields are.
            common_uncertainty: scale.hypot(fields),
            direction_rad: brdf
                .direction_uncertainty_deg()
                .unwrap_or_default()
                .map(|both_deg| both_deg.to_radians() * FRAC_1_SQRT_2),
        }
        .enough()
    }

    /// Values of a known sample, each with an uncertainty of 1 %, at 200 incident and 200 outgoing directions.
    pub(super) fn of_sample(sample: &dyn Sample) -> Result<Self, FitError> {
        let spread = |count: usize, turn: f64| -> Vec<DVec3> {
            (0..count)
                .map(|i| {
                    let share = (i as f64 + 0.5) / count as f64;
                    from_degrees(share.sqrt().asin().to_degrees() * 80.0 / 90.0, i as f64 * turn)
                })
                .collect()
        };
        // Half of the outgoing directions near the mirror direction, where a glossy sample has its lobe.
        let (incident, halves, outgoing) = (spread(200, 137.508), spread(100, 137.508), spread(100, 99.502));
        let all = incident
            .par_iter()
            .enumerate()
            .flat_map_iter(|(image, &wi)| {
                let lobe = sample.incident(wi);
                let mirrored = halves.iter().map(|&h| {
                    // Closer to the normal than the half vectors of the whole hemisphere.
                    let h = (h * DVec3::new(0.5, 0.5, 1.0)).normalize();
                    2.0 * wi.dot(h) * h - wi
                });
                mirrored
                    .chain(outgoing.iter().copied())
                    .filter(|wo| is_judged(*wo))
                    .enumerate()
                    .map(|(at, wo)| {
                        let f = lobe.f(wo);
                        let mean = (f[0] + f[1] + f[2]) / 3.0;
                        Observation {
                            light: [wi; 4],
                            places: [wo; 4],
                            f,
                            variance: [(KNOWN * mean).powi(2).max(1e-12), 0.0],
                            shared: [image as u32, at as u32],
                        }
                    })
                    .collect::<Vec<_>>()
            })
            .collect();
        Self {
            all,
            channels: 3,
            common_uncertainty: 0.0,
            direction_rad: [0.0; 2],
        }
        .enough()
    }

    fn enough(self) -> Result<Self, FitError> {
        let found = self.all.len();
        if found < FEWEST {
            return Err(FitError::TooFew {
                expected: FEWEST,
                found,
            });
        }
        let mut sides = [0; 4];
        for seen in &self.all {
            let half = seen.light.iter().chain(&seen.places).sum::<DVec3>();
            // Along the normal there is no side.
            if half.x.abs() > half.y.abs() {
                sides[if half.x > 0.0 { 0 } else { 2 }] += 1;
            } else if half.y.abs() > 0.0 {
                sides[if half.y > 0.0 { 1 } else { 3 }] += 1;
            }
        }
        match (0..4).find(|&side| sides[side] < FEWEST / 10) {
            Some(side) => Err(FitError::OneSided {
                expected: FEWEST / 10,
                found: sides[side],
                side: ["+x", "+y", "−x", "−y"][side],
            }),
            None => Ok(self),
        }
    }

    /// Every `stride`th of them.
    pub(super) fn every(&self, stride: usize) -> Self {
        Self {
            all: self.all.iter().step_by(stride.max(1)).copied().collect(),
            ..*self
        }
    }

    /// The same with point-like lights and pixels.
    pub(super) fn sharp(&self) -> Self {
        let centre = |four: &[DVec3; 4]| [four.iter().sum::<DVec3>().normalize(); 4];
        self.with_directions(centre, centre)
    }

    /// The same with other directions of light and places of the pixels.
    pub(super) fn with_directions(
        &self,
        light: impl Fn(&[DVec3; 4]) -> [DVec3; 4],
        places: impl Fn(&[DVec3; 4]) -> [DVec3; 4],
    ) -> Self {
        let all = self.all.iter().map(|seen| Observation {
            light: light(&seen.light),
            places: places(&seen.places),
            ..*seen
        });
        Self {
            all: all.collect(),
            ..*self
        }
    }
}

/// Least-squares line [at 0, slope] through points (f, variance), neither negative.
fn line(points: impl Iterator<Item = (f64, f64)>) -> [f64; 2] {
    let (mut n, mut x, mut y, mut xx, mut xy, mut least) = (0.0, 0.0, 0.0, 0.0, 0.0, f64::INFINITY);
    for (f, variance) in points {
        n += 1.0;
        x += f;
        y += variance;
        xx += f * f;
        xy += f * variance;
        least = least.min(variance);
    }
    let spread = n * xx - x * x;
    let slope = if spread > 0.0 {
        ((n * xy - x * y) / spread).max(0.0)
    } else {
        0.0
    };
    [((y - slope * x) / n).max(least).max(1e-14), slope]
}
