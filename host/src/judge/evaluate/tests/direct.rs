//! What a direct computation of the figures says.

use std::path::Path;

use glam::DVec3;
use half::f16;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::file;
use crate::brdf::Brdf;
use crate::brdf::sample::{Outgoing, Sample};
use crate::hemisphere::disk::Disk;
use crate::hemisphere::judged::is_judged;
use crate::judge::evaluate::{Quantile, evaluate};
use crate::store::provenance::Provenance;

/// A reference that is 0 on one side, negative at the edge of it, and not known at the other.
#[derive(Debug)]
struct Ramp;

impl Sample for Ramp {
    fn incident(&self, _wi: DVec3) -> Box<dyn Outgoing + '_> {
        Box::new(Self)
    }

    fn is_isotropic(&self) -> bool {
        false
    }
}

impl Outgoing for Ramp {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        let f = match wo.x {
            x if x > 0.7 => f64::NAN,
            x if x > 0.0 => 0.2 * x,
            x if x > -0.5 => 0.0,
            x => x,
        };
        [f, 2.0 * f, f]
    }
}

/// A sample that was drawn, at its incident direction and cell.
struct Drawn {
    index: usize,
    cell: usize,
    /// Of each channel.
    f: Vec<f32>,
    sigma: f32,
    origin: Provenance,
}

/// A file with about this `share` of its samples, of whatever provenance, and what it holds.
fn drawn(path: &Path, channels: usize, share: f64, rng: &mut Xoshiro256PlusPlus) -> (Brdf, Vec<Drawn>) {
    let mut samples = Vec::new();
    let brdf = file(path, channels, &mut |index, cell| {
        if rng.random_range(0.0..1.0) > share {
            return None;
        }
        let f: Vec<f32> = (0..channels).map(|_| rng.random_range(-0.02..0.4)).collect();
        let sigma = f16::from_f32(rng.random_range(1e-4..1e-2)).to_f32();
        let origin = Provenance::ALL[rng.random_range(1..Provenance::ALL.len())];
        samples.push(Drawn {
            index,
            cell,
            f: f.clone(),
            sigma,
            origin,
        });
        Some((f, sigma, origin))
    });
    (brdf, samples)
}

/// The floor of a channel of [`Ramp`], by the definition, over other directions than those of the program.
fn floor(channels: usize, channel: usize) -> f64 {
    let all: Vec<DVec3> = (0..200 * 200)
        .filter_map(|cell| Disk::new(200).direction(cell))
        .filter(|wo| is_judged(*wo))
        .collect();
    let mut values: Vec<(f64, f64)> = all
        .iter()
        .map(|wo| (Outgoing::f(&Ramp, *wo), wo.z))
        .map(|(f, z)| {
            (
                if channels == 1 {
                    f.iter().sum::<f64>() / 3.0
                } else {
                    f[channel]
                },
                z,
            )
        })
        .filter(|(f, _)| f.is_finite())
        .collect();
    let albedo: f64 = values.iter().map(|(f, z)| f * z).sum::<f64>() * Disk::new(200).cell_sr();
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    f64::max(
        0.01 * values[values.len() / 2].0,
        0.01 * albedo / std::f64::consts::PI,
    )
}

/// Figures of samples against [`Ramp`], as their definitions read.
#[derive(Default)]
struct Direct {
    /// Relative, of what is scored.
    errors: Vec<f64>,
    /// Sum over all that is compared.
    squares: f64,
    compared: u64,
    /// Relative.
    sigmas: Vec<f64>,
}

impl Direct {
    /// Of `samples` of `brdf`, scored above the floor of each channel.
    fn of(brdf: &Brdf, samples: &[Drawn], floors: [f64; 3]) -> Self {
        let mut all = Self::default();
        for Drawn {
            index,
            cell,
            f,
            sigma,
            ..
        } in samples
        {
            let (wi, wo) = (
                brdf.grid().direction(*index),
                brdf.disk().direction(*cell).unwrap(),
            );
            let truth = Outgoing::f(&Ramp, wo);
            let truth = if brdf.channels() == 1 {
                [truth.iter().sum::<f64>() / 3.0; 3]
            } else {
                truth
            };
            for (channel, f) in f.iter().enumerate() {
                let f = f64::from(*f);
                all.sigmas.push(if f > 0.0 {
                    f64::from(*sigma) / f
                } else {
                    f64::INFINITY
                });
                let truth = truth[channel];
                if truth.is_finite() {
                    all.compared += 1;
                    all.squares += ((f * wi.z).clamp(0.0, 1.0) - (truth * wi.z).clamp(0.0, 1.0)).powi(2);
                    if truth > 0.0 && truth >= floors[channel] {
                        all.errors.push((f - truth).abs() / truth);
                    }
                }
            }
        }
        all
    }
}

#[test]
fn figures_are_those_of_a_direct_computation() {
    let scratch = tempfile::tempdir().unwrap();
    for seed in 0..6 {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let channels = if seed % 2 == 0 { 1 } else { 3 };
        let share = rng.random_range(0.3..1.0);
        let (brdf, mut samples) = drawn(&scratch.path().join("m"), channels, share, &mut rng);
        let found = evaluate(&brdf, Some(("ramp", &Ramp)), &|_| {}).unwrap();
        let (grid, disk) = (brdf.grid(), brdf.disk());
        let judged = |index: usize, cell: usize| {
            is_judged(grid.direction(index)) && disk.direction(cell).is_some_and(is_judged)
        };
        let pairs = (0..grid.len() * disk.len())
            .filter(|at| judged(at / disk.len(), at % disk.len()))
            .count() as f64;
        assert_eq!(found.measured_samples, samples.len() as u64);
        samples.retain(|sample| judged(sample.index, sample.cell));
        assert!((found.coverage.unwrap() - samples.len() as f64 / pairs).abs() < 1e-12);
        for origin in &found.provenance[1..] {
            let count = samples
                .iter()
                .filter(|sample| sample.origin.name() == origin.provenance)
                .count();
            assert!((origin.share - count as f64 / pairs).abs() < 1e-12, "{origin:?}");
        }
        samples.retain(|sample| sample.origin.is_seen());
        let floors = [0, 1, 2].map(|channel| floor(channels, channel));
        let Direct {
            mut errors,
            squares,
            compared,
            mut sigmas,
        } = Direct::of(&brdf, &samples, floors);
        let against = found.against_reference.unwrap();
        assert_eq!(
            (against.samples, against.scored_samples),
            (compared, errors.len() as u64)
        );
        assert!(
            (against.scored_share.unwrap() - errors.len() as f64 / (pairs * channels as f64)).abs() < 1e-12
        );
        let psnr_db = -10.0 * (squares / compared as f64).log10();
        assert!((against.psnr_db.unwrap() - psnr_db).abs() < 1e-9);
        let median = |values: &mut Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let close = |found: Quantile, expected: f64| {
            assert!(
                (found.value().unwrap() / expected - 1.0).abs() < 0.013,
                "{found:?} {expected}"
            );
        };
        close(found.median_relative_sigma, median(&mut sigmas));
        close(against.relative_error.median, median(&mut errors));
        close(
            against.relative_error.p90,
            errors[(0.9 * errors.len() as f64) as usize],
        );
    }
}
