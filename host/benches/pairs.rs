//! f of single pairs of directions of a measured material, each pair with another incident direction, on one core;
//! baseline: the incident direction prepared for every pair.
//!
//! The file is not part of the project; without it the benchmark says so.

use std::path::Path;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use glam::DVec3;
use rcg::brdf::sample::{MeasuredRgl, Sample};
use rcg::hemisphere::direction::from_degrees;

fn main() {
    divan::main();
}

/// Pairs without any order, so that none profits from the one before it.
fn pairs(count: u32) -> Vec<(DVec3, DVec3)> {
    let direction = |i: u32, a: u32, b: u32| {
        from_degrees(f64::from(i * a % 8900) / 100.0, f64::from(i * b % 36_000) / 100.0)
    };
    (0..count)
        .map(|i| (direction(i, 7919, 104_729), direction(i, 6101, 35_317)))
        .collect()
}

fn run(bencher: Bencher, count: u32, f: impl Fn(&MeasuredRgl, DVec3, DVec3) -> [f64; 3] + Sync) {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data"));
    let path = folder.join("satin_rosaline_rgb.bsdf");
    if !path.is_file() {
        println!("skipped: no measured material at {}", path.display());
        return;
    }
    let sample = MeasuredRgl::open(&path).expect("an RGL file");
    let pairs = pairs(count);
    bencher.counter(ItemsCount::new(pairs.len())).bench_local(|| {
        for &(wi, wo) in &pairs {
            black_box(f(&sample, black_box(wi), black_box(wo)));
        }
    });
}

#[divan::bench]
fn pair_by_pair(bencher: Bencher) {
    run(bencher, 20_000, Sample::f);
}

#[divan::bench(sample_count = 10)]
fn baseline_prepared_for_each(bencher: Bencher) {
    run(bencher, 200, |sample, wi, wo| sample.incident(wi).f(wo));
}
