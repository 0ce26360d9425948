//! Incident directions of a measurement: the grid θ × φ at a step in degrees.
//!
//! # Design
//! Ring k lies at θ = (k + ½)·step, so that `90/step` rings of `360/step` directions cover the hemisphere
//! without a pole that is counted many times and without a ring at the horizon, where nothing is lit.
//! At 1° these are the 90 × 360 = 32,400 directions of the paper. Directions are numbered ring by ring:
//! index = `ring · phi_count + sector`.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use crate::direction::{from_angles, to_angles};

/// Rings of equally spaced incident directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IncidentGrid {
    theta_count: usize,
    phi_count: usize,
}

/// A step that makes no grid.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("step: expected a number of degrees from 0.25 to 45 that divides 90, found {step_deg}")]
pub struct StepError {
    /// What was asked for.
    pub step_deg: f64,
}

/// Indices of incident directions and their weights, which sum to 1.
pub type Neighbours = [(usize, f64); 4];

impl IncidentGrid {
    /// The grid with `step_deg` degrees between rings and between the directions of a ring.
    ///
    /// # Errors
    /// [`StepError`] if 90° is no whole number of steps.
    pub fn new(step_deg: f64) -> Result<Self, StepError> {
        let rings = 90.0 / step_deg;
        let whole = (rings - rings.round()).abs() < 1e-9 * rings;
        if !(0.25..=45.0).contains(&step_deg) || !whole {
            return Err(StepError { step_deg });
        }
        let theta_count = rings.round() as usize;
        Ok(Self {
            theta_count,
            phi_count: 4 * theta_count,
        })
    }

    /// Number of directions.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.theta_count * self.phi_count
    }

    /// Never: a grid has at least two rings.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        false
    }

    /// Number of directions of a ring.
    #[must_use]
    pub const fn phi_count(&self) -> usize {
        self.phi_count
    }

    /// Degrees between rings.
    #[must_use]
    pub fn step_deg(&self) -> f64 {
        90.0 / self.theta_count as f64
    }

    /// Angles (θ, φ) of direction `index` in degrees.
    #[must_use]
    pub fn angles_deg(&self, index: usize) -> (f64, f64) {
        let (ring, sector) = (index / self.phi_count, index % self.phi_count);
        (
            (ring as f64 + 0.5) * self.step_deg(),
            sector as f64 * self.step_deg(),
        )
    }

    /// Unit vector of direction `index`, sample frame.
    #[must_use]
    pub fn direction(&self, index: usize) -> DVec3 {
        let (theta_deg, phi_deg) = self.angles_deg(index);
        from_angles(theta_deg.to_radians(), phi_deg.to_radians())
    }

    /// The four directions around `w` for bilinear interpolation in θ and φ.
    ///
    /// Inside the first ring the other side of the pole takes part; beyond the last ring the value stays.
    #[must_use]
    pub fn neighbours(&self, w: DVec3) -> Neighbours {
        let (theta_rad, phi_rad) = to_angles(w);
        let step_rad = PI / 2.0 / self.theta_count as f64;
        let ring = theta_rad / step_rad - 0.5;
        let last = (self.theta_count - 1) as f64;
        let (inner, outer, t) = if ring < 0.0 {
            // Across the pole ring 0 stands where a ring −1 would be.
            ((0, phi_rad + PI), (0, phi_rad), ring + 1.0)
        } else {
            let inner = ring.min(last).floor();
            let outer = (inner + 1.0).min(last);
            (
                (inner as usize, phi_rad),
                (outer as usize, phi_rad),
                ring.min(last) - inner,
            )
        };
        let [a, b] = self.around(inner.0, inner.1);
        let [c, d] = self.around(outer.0, outer.1);
        [
            (a.0, a.1 * (1.0 - t)),
            (b.0, b.1 * (1.0 - t)),
            (c.0, c.1 * t),
            (d.0, d.1 * t),
        ]
    }

    /// The two directions of `ring` beside azimuth `phi_rad`.
    fn around(&self, ring: usize, phi_rad: f64) -> [(usize, f64); 2] {
        let sector = phi_rad.rem_euclid(TAU) / TAU * self.phi_count as f64;
        let low = sector.floor();
        let t = sector - low;
        let index = |sector: usize| ring * self.phi_count + sector % self.phi_count;
        [(index(low as usize), 1.0 - t), (index(low as usize + 1), t)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direction::{angle_between, from_degrees};

    #[test]
    fn counts_are_the_papers() {
        assert_eq!(IncidentGrid::new(1.0).unwrap().len(), 32_400);
        assert_eq!(IncidentGrid::new(15.0).unwrap().len(), 144);
    }

    #[test]
    fn a_step_that_does_not_divide_is_refused() {
        for step in [7.0, 0.0, -1.0, 60.0, f64::NAN, f64::INFINITY, 0.1] {
            assert!(IncidentGrid::new(step).is_err(), "{step}");
        }
        assert!(IncidentGrid::new(7.5).is_ok());
    }

    #[test]
    fn a_grid_direction_is_its_own_neighbour() {
        let grid = IncidentGrid::new(5.0).unwrap();
        for index in 0..grid.len() {
            let weight: f64 = grid
                .neighbours(grid.direction(index))
                .iter()
                .filter(|(neighbour, _)| *neighbour == index)
                .map(|(_, weight)| weight)
                .sum();
            assert!(
                (weight - 1.0).abs() < 1e-9,
                "direction {index} has weight {weight}"
            );
        }
    }

    #[test]
    fn weights_sum_to_one_and_neighbours_are_near() {
        let grid = IncidentGrid::new(5.0).unwrap();
        for theta in 0..90 {
            for phi in 0..72 {
                let w = from_degrees(f64::from(theta) + 0.3, f64::from(phi) * 5.0 + 1.0);
                let neighbours = grid.neighbours(w);
                let sum: f64 = neighbours.iter().map(|n| n.1).sum();
                assert!((sum - 1.0).abs() < 1e-12);
                for (index, weight) in neighbours {
                    assert!((-1e-12..=1.0 + 1e-12).contains(&weight));
                    assert!(angle_between(grid.direction(index), w).to_degrees() < 8.0 || weight < 1e-12);
                }
            }
        }
    }

    #[test]
    fn interpolation_is_continuous_across_the_pole_and_reproduces_cos_theta() {
        let grid = IncidentGrid::new(5.0).unwrap();
        let value = |w: DVec3| -> f64 {
            grid.neighbours(w)
                .iter()
                .map(|&(index, weight)| weight * grid.direction(index).x)
                .sum()
        };
        for theta in [0.0, 0.5, 1.0, 2.0, 2.4, 2.6, 30.0, 60.0] {
            for phi in [0.0, 91.0, 200.0] {
                let w = from_degrees(theta, phi);
                assert!(
                    (value(w) - w.x).abs() < 2e-3,
                    "θ {theta} φ {phi}: {} {}",
                    value(w),
                    w.x
                );
            }
        }
    }
}
