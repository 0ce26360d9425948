//! What the fit leaves that is no chance.
//!
//! # Design
//! A mirror is not quite an ellipsoid and a lens not quite what Brown and Conrady say. What is left of that turns the directions
//! of neighbouring pixels alike, while matching has an error of its own at each of them: the residuals of a view are averaged over
//! squares of the camera's image, and the mean square of those averages, beyond what chance makes of it, is the left-over. It is
//! of no shape that is assumed.
//!
//! A match has the left-over of camera and projector, each at its own place of the mirror: half of the variance is either's.
//! And what neighbours share is not told apart by asking many of them: the covariance of the unknowns grows by the design effect
//! of a sample in clusters, 1 + (n − 1)·ρ, of n matches each that are correlated by ρ (Kish, Survey Sampling, 1965). The
//! camera's half is the same in all views, whose squares are then one cluster; the projector sees itself elsewhere in each. Of so
//! few clusters the unknowns take a part, so that less is left than there is: the variance is that over degrees of freedom.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec2;

use super::sightings::Sightings;
use super::solve::Residual;

/// Squares along each side of the camera's image. What a fit leaves of a mirror is longer than a few pixels: with so many what is
/// stated of mirrors off by 0 to 0.5 mrad came to what directions were off by.
const SQUARES: f64 = 6.0;
/// Fewest matches of a square.
const FEWEST: usize = 4;
/// At most so many times the variance counts for what the unknowns take of it.
const MOST_TAKEN: f64 = 3.0;
/// A match that is this many scales off takes no part.
const OUTLIER: f64 = 5.0;

/// What the fit leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Leftover {
    /// RMS of what is left of a match and no chance, radians.
    pub(super) rad: f64,
    /// Mean square of that before what the unknowns take of it is added, radians².
    pub(super) seen_rad2: f64,
    /// Factor of the covariance of the unknowns.
    pub(super) design_effect: f64,
}

impl Leftover {
    /// Of the matches `seen` in an image of `size_px`, whose `residuals` by so many `unknowns` have the scale `scale_rad`.
    pub(super) fn of(
        seen: &Sightings,
        residuals: &[Residual],
        scale_rad: f64,
        unknowns: usize,
        [width_px, height_px]: [u32; 2],
    ) -> Self {
        let mut squares: BTreeMap<(usize, [u32; 2]), Vec<DVec2>> = BTreeMap::new();
        for (found, residual) in seen.matches.iter().zip(residuals) {
            if let Some(residual) = residual.filter(|residual| residual.length() < OUTLIER * scale_rad) {
                let at = |px: f64, size_px: u32| (px / f64::from(size_px) * SQUARES) as u32;
                let square = [at(found.camera_px.x, width_px), at(found.camera_px.y, height_px)];
                squares.entry((found.view, square)).or_default().push(residual);
            }
        }
        squares.retain(|_, of| of.len() >= FEWEST);
        let (mut beyond, mut chance, mut matches) = (0.0, 0.0, 0.0);
        for of in squares.values() {
            let count = of.len() as f64;
            let mean = of.iter().sum::<DVec2>() / count;
            let squares = of.iter().map(|residual| (*residual - mean).length_squared());
            let variance = squares.sum::<f64>() / (count - 1.0);
            beyond += count * mean.length_squared() - variance;
            chance += count * variance;
            matches += count;
        }
        if matches <= 0.0 {
            return Self {
                rad: 0.0,
                seen_rad2: 0.0,
                design_effect: 1.0,
            };
        }
        let of_camera: BTreeSet<[u32; 2]> = squares.keys().map(|(_, square)| *square).collect();
        let [of_view, of_all] = [squares.len(), of_camera.len()].map(|clusters| matches / clusters as f64);
        let each = f64::midpoint(of_view, of_all);
        // Each has two components.
        let numbers = 2.0 * matches / each;
        let taken = (numbers / (numbers - unknowns as f64).max(1.0)).min(MOST_TAKEN);
        let seen_rad2 = (beyond / matches).max(0.0);
        let (beyond, chance) = (taken * seen_rad2, chance / matches);
        let correlation = beyond / (beyond + chance);
        Self {
            rad: beyond.sqrt(),
            seen_rad2,
            design_effect: 1.0 + (each - 1.0) * correlation,
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_distr::StandardNormal;
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::super::sightings::Match;
    use super::*;

    #[test]
    fn what_neighbours_share_is_told_from_chance() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
        for shared_rad in [0.0, 1e-4, 4e-4] {
            let (mut seen, mut residuals) = (Sightings::default(), Vec::new());
            for at in 0..6000 {
                let camera_px = DVec2::new(f64::from(at % 100) + 0.5, f64::from(at / 100 % 100) + 0.5);
                seen.matches.push(Match {
                    view: at as usize % 3,
                    camera_px,
                    projector_px: DVec2::ZERO,
                });
                // Of a wave as long as the image the mean square is a half.
                let wave = (camera_px.x / 100.0 * std::f64::consts::TAU).sin() * 2_f64.sqrt();
                let mut normal = || -> f64 { rng.sample(StandardNormal) };
                let chance = DVec2::new(normal(), normal()) * 2e-4;
                residuals.push(Some(chance + DVec2::X * (shared_rad * wave)));
            }
            let found = Leftover::of(&seen, &residuals, 5e-4, 0, [100, 100]);
            let missed = (found.rad.powi(2) - shared_rad.powi(2)).abs();
            assert!(
                missed < (0.1 * shared_rad).powi(2).max(4e-10) + 0.15 * shared_rad.powi(2),
                "{found:?}"
            );
            assert!(shared_rad <= 0.0 || found.design_effect > 1.5, "{found:?}");
        }
    }
}
