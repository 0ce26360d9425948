//! Laws of means: noise averages out, what is common does not, and what scatters beyond what is stated is in σ.

use std::path::Path;

use rand::SeedableRng as _;
use rand_distr::{Distribution as _, Normal};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::json;

use super::*;
use crate::base::progress::Silent;
use crate::brdf::budget::arrays_of;
use crate::brdf::{LINEAGE, RegionBudget};
use crate::hemisphere::incident::{Grid, IncidentSet};
use crate::store::{BrdfLayout, BrdfWriter};

const STEP_DEG: f64 = 22.5;
const SIZE: usize = 12;
const F: f64 = 0.2;

/// How a repeat is made: relative noise and offset, what it states of σ, share of noise in its variance, its calibration, and
/// the cells that it has.
#[derive(Clone, Copy)]
struct Made {
    noise: f64,
    offset: f64,
    stated: f64,
    share: f64,
    calibration: &'static str,
    has: fn(usize) -> bool,
}

const USUAL: Made = Made {
    noise: 0.02,
    offset: 0.0,
    stated: 0.0223,
    share: 0.8,
    calibration: "one",
    has: |_| true,
};

fn repeat(path: &Path, made: Made, seed: u64) -> Repeat {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let noise = Normal::new(0.0, made.noise).unwrap();
    let grid: IncidentSet = Grid::ThetaPhi { step_deg: STEP_DEG }.build().unwrap();
    let disk = crate::hemisphere::disk::Disk::new(SIZE);
    let layout = BrdfLayout {
        incident: grid.len(),
        grid: SIZE,
        channels: 1,
        chunk: 16,
    };
    let outgoing: Vec<_> = (0..disk.len())
        .map(|cell| {
            disk.direction(cell)
                .is_none()
                .then_some(Unmeasurable::BelowHorizon)
        })
        .collect();
    let small = crate::assemble::coordinates(
        &grid,
        &vec![None; grid.len()],
        disk,
        &outgoing,
        &vec![1e-3; disk.len()],
    );
    let attributes = json!({
        "step_deg": STEP_DEG, "incident_kind": "theta-phi", "spot_deg": 1.0, "common_uncertainty": 0.005,
        LINEAGE: { "sha256": { "calibration.json": made.calibration, "raw.zarr": seed.to_string() } },
    });
    let writer = BrdfWriter::create(
        path,
        layout,
        &small,
        attributes.as_object().unwrap().clone(),
        true,
    )
    .unwrap();
    let mut shares = vec![0.0; CAUSES.len()];
    (shares[0], shares[4]) = (made.share, 1.0 - made.share);
    let bands = [[0.0, 30.0], [30.0, 60.0], [60.0, 80.0]];
    let budget: Vec<RegionBudget> = (0..9)
        .map(|region| RegionBudget {
            incident_deg: bands[region / 3],
            outgoing_deg: bands[region % 3],
            relative: made.stated,
            shares: shares.clone(),
            shared: 0.0,
        })
        .collect();
    for array in arrays_of(&budget) {
        writer.rewrite(&array).unwrap();
    }
    for (chunk, first) in (0..grid.len()).step_by(16).enumerate() {
        let mut rows = BrdfRows::default();
        for _ in first..(first + 16).min(grid.len()) {
            for (cell, reason) in outgoing.iter().enumerate() {
                let is_there = reason.is_none() && (made.has)(cell);
                let f = F * (1.0 + made.offset + noise.sample(&mut random));
                rows.f.push(if is_there { f as f32 } else { f32::NAN });
                let sigma = if is_there { F * made.stated } else { f64::NAN };
                rows.sigma.push(f16::from_f64(sigma));
                let origin = if is_there {
                    Provenance::Measured
                } else {
                    Provenance::Missing
                };
                rows.provenance.push(origin.code());
            }
        }
        writer.write_chunk(chunk, &rows).unwrap();
    }
    writer.finish().unwrap();
    Repeat::open(&path.display().to_string(), path).unwrap()
}

fn repeats(folder: &Path, made: &[Made]) -> Vec<Repeat> {
    (0..)
        .zip(made)
        .map(|(seed, made)| repeat(&folder.join(format!("r{seed}")), *made, seed))
        .collect()
}

/// Relative σ and error (both root mean square) of the values for θ ≤ 80°.
fn judged(path: &Path) -> [f64; 2] {
    let brdf = Brdf::open(path).unwrap();
    let (mut sums, mut count) = ([0.0; 2], 0.0);
    for chunk in 0..brdf.chunks() {
        let rows = brdf.chunk(chunk).unwrap().unwrap();
        for (row, index) in brdf.chunk_range(chunk).enumerate() {
            for cell in 0..brdf.disk().len() {
                let at = row * brdf.disk().len() + cell;
                let is_judged = brdf.disk().direction(cell).is_some()
                    && Places::region(&brdf, index, cell) < crate::judge::region::REGIONS;
                if is_judged && rows.f[at].is_finite() {
                    count += 1.0;
                    sums[0] += (rows.sigma[at].to_f64() / F).powi(2);
                    sums[1] += (f64::from(rows.f[at]) / F - 1.0).powi(2);
                }
            }
        }
    }
    sums.map(|sum: f64| (sum / count).sqrt())
}

#[test]
fn noise_averages_out_and_a_common_calibration_does_not() {
    let folder = tempfile::tempdir().unwrap();
    // Calibrations that are off by what they state.
    let other = |(calibration, offset)| Made {
        offset,
        calibration,
        ..USUAL
    };
    let rest = 0.2_f64;
    for (count, made, left) in [
        (2, vec![USUAL; 2], 0.8 / 2.0 + rest),
        (5, vec![USUAL; 5], 0.8 / 5.0 + rest),
        (
            3,
            [("a", -0.01), ("b", 0.0), ("c", 0.01)].map(other).to_vec(),
            1.0 / 3.0,
        ),
    ] {
        let all = repeats(folder.path(), &made);
        let out = folder.path().join("mean.zarr");
        combine(&all, &out, false, &Silent).unwrap();
        let [sigma, error] = judged(&out);
        let expected = USUAL.stated * left.sqrt();
        // Where chance lets them scatter less, less averages out.
        assert!(
            (0.99..1.12).contains(&(sigma / expected)),
            "{count}: {sigma} {expected}"
        );
        assert!(
            (error / (USUAL.noise / f64::from(count).sqrt()) - 1.0).abs() < 0.05,
            "{error}"
        );
        let mean = Brdf::open(&out).unwrap();
        let noise = mean.budget()[4].shares[0];
        assert!((noise - 0.8 / f64::from(count) / left).abs() < 0.02, "{noise}");
        assert_eq!(mean.attributes()["combined"]["measurements"], json!(count));
    }
}

#[test]
fn what_is_stated_as_noise_and_does_not_scatter_is_not_averaged_out() {
    let folder = tempfile::tempdir().unwrap();
    // Nearly all of σ is said to be noise, of which there is none.
    let quiet = Made {
        noise: 1e-5,
        share: 1.0,
        ..USUAL
    };
    let all = repeats(folder.path(), &[quiet; 4]);
    let out = folder.path().join("mean.zarr");
    combine(&all, &out, false, &Silent).unwrap();
    assert!((judged(&out)[0] / quiet.stated - 1.0).abs() < 0.01);
}

#[test]
fn scatter_beyond_what_is_stated_is_in_sigma_and_an_outlier_is_refused_unless_it_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("mean.zarr");
    let loud = Made { noise: 0.1, ..USUAL };
    let found = combine(&repeats(folder.path(), &[loud; 3]), &out, true, &Silent).unwrap();
    let [sigma, error] = judged(&out);
    assert!((0.9..1.3).contains(&(sigma / error)), "{sigma} {error}");
    assert!(
        found
            .repeats
            .scatter
            .iter()
            .all(|one| one.is_larger && one.ratio > Some(4.0))
    );

    let off = Made { offset: 0.3, ..USUAL };
    let all = repeats(folder.path(), &[USUAL, off, USUAL]);
    let error = combine(&all, &out, false, &Silent).unwrap_err();
    assert!(
        error.is_input() && error.to_string().contains("r1: expected f as in the other 2"),
        "{error}"
    );
    let kept = combine(&all, &out, true, &Silent).unwrap();
    let [sigma, error] = judged(&out);
    assert!(sigma > 0.99 * error, "{sigma} {error}");
    assert!(
        kept.repeats
            .warnings
            .iter()
            .any(|warning| warning.contains("outliers: kept"))
    );
}

#[test]
fn pairs_that_only_some_have_are_the_mean_of_those() {
    let folder = tempfile::tempdir().unwrap();
    let half = Made {
        has: |cell| cell % 2 == 0,
        ..USUAL
    };
    let all = repeats(folder.path(), &[USUAL, half]);
    let out = folder.path().join("mean.zarr");
    let found = combine(&all, &out, false, &Silent).unwrap();
    assert!(
        found.repeats.by_count.iter().all(|count| *count > 0),
        "{:?}",
        found.repeats.by_count
    );
    let [first, mean] = [all[0].brdf.path(), &out].map(|path| Brdf::open(path).unwrap());
    let [first, mean] = [&first, &mean].map(|brdf| brdf.chunk(0).unwrap().unwrap());
    let mut less = 0;
    for cell in 0..SIZE * SIZE {
        if first.provenance[cell] == 0 {
            continue;
        }
        let origin = if cell % 2 == 0 {
            Provenance::Merged
        } else {
            Provenance::Measured
        };
        assert_eq!(mean.provenance[cell], origin.code());
        if cell % 2 == 1 {
            assert_eq!(
                (mean.f[cell], mean.sigma[cell]),
                (first.f[cell], first.sigma[cell])
            );
        } else {
            assert!(mean.sigma[cell] <= first.sigma[cell]);
            less += usize::from(mean.sigma[cell] < first.sigma[cell]);
        }
    }
    // Beyond 80° no budget says what noise is.
    assert!(less > 30, "{less}");
    let error = combine(&all, all[1].brdf.path(), false, &Silent).unwrap_err();
    assert!(matches!(error, CombineError::Itself { .. }), "{error}");
}

#[test]
fn means_of_few_that_differ_as_a_whole_are_as_uncertain_as_few_are() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(7);
    let offset = Normal::new(0.0, 0.1).unwrap();
    for count in [2, 3] {
        const DRAWS: usize = 20;
        let held = (0..DRAWS)
            .filter(|draw| {
                let place = folder.path().join(format!("{count}-{draw}"));
                std::fs::create_dir(&place).unwrap();
                let made: Vec<Made> = (0..count)
                    .map(|_| Made {
                        offset: offset.sample(&mut random),
                        ..USUAL
                    })
                    .collect();
                let out = place.join("mean.zarr");
                combine(&repeats(&place, &made), &out, true, &Silent).unwrap();
                // The mean of all errors: that of the offsets.
                let off = made.iter().map(|made| made.offset).sum::<f64>() / f64::from(count);
                off.abs() < 2.0 * judged(&out)[0]
            })
            .count();
        println!("{count}: {held} of {DRAWS}");
        assert!(held >= 17, "{count}: {held} of {DRAWS}");
    }
}
