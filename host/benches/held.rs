//! Values a second of a measured BRDF that is held in memory, by blended interpolation: of pairs of directions in no order, and of those of
//! a sphere's picture. Baseline: direct interpolation of the same pairs, which reads an eighth of the images' cells.
//!
//! Of a loaded machine the ratio to the baseline counts.

use std::path::Path;

use divan::{Bencher, counter::ItemsCount};
use glam::DVec3;
use rcg::base::progress::Silent;
use rcg::brdf::interpolation::Interpolation;
use rcg::brdf::reflectance::Reflectance as _;
use rcg::brdf::{Brdf, HeldBrdf};
use rcg::hemisphere::direction::from_degrees;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::rig::Rig;
use rcg::judge::render::LitSphere;
use rcg::measure::{assemble_measurement, capture, prepare};
use rcg::plan::{Request, Virtual};
use rcg::virtual_rig::setup::Setup;

fn main() {
    divan::main();
}

/// Pairs in no order.
const PAIRS: u32 = 1 << 20;
/// Pixels a side of the sphere's picture.
const SIZE: usize = 1024;

fn measured(dir: &Path) -> Brdf {
    let request = Request {
        grid: Grid::ThetaPhi { step_deg: 3.0 },
        image_size: 96,
        exposure_s: Some(0.004),
        ..Request::default()
    };
    let rig = Rig::load("rcg-2").expect("a preset");
    let setup = Setup::from(Virtual {
        sample: "satin".to_owned(),
        ..Virtual::default()
    });
    let (job, measurement) = prepare(dir, &rig, request, &setup, &Silent).expect("plans");
    capture(&measurement, &job, &Silent).expect("the virtual rig works");
    assemble_measurement(&measurement, &Silent).expect("assembles");
    Brdf::open(&measurement.path("brdf.zarr")).expect("was assembled")
}

/// Pairs without any order, so that none profits from the one before it.
fn in_no_order() -> Vec<(DVec3, DVec3)> {
    let direction = |i: u32, a: u32, b: u32| {
        let share = |by: u32| f64::from(i.wrapping_mul(by)) / f64::from(u32::MAX);
        from_degrees(80.0 * share(a).sqrt(), 360.0 * share(b))
    };
    (0..PAIRS)
        .map(|i| {
            (
                direction(i, 2_654_435_761, 2_246_822_519),
                direction(i, 3_266_489_917, 668_265_263),
            )
        })
        .collect()
}

fn look_up(bencher: Bencher, interpolation: Interpolation, pairs: &[(DVec3, DVec3)]) {
    let dir = tempfile::tempdir().expect("a place for files");
    let held = HeldBrdf::read(measured(&dir.path().join("m")), interpolation).expect("fits into memory");
    bencher
        .counter(ItemsCount::new(pairs.len()))
        .bench_local(|| held.values(pairs).expect("nothing is read"));
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn blended_in_no_order(bencher: Bencher) {
    look_up(bencher, Interpolation::Blended, &in_no_order());
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn baseline_direct_in_no_order(bencher: Bencher) {
    look_up(bencher, Interpolation::Direct, &in_no_order());
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn blended_on_a_sphere(bencher: Bencher) {
    look_up(
        bencher,
        Interpolation::Blended,
        &LitSphere::new(SIZE, (45.0, 30.0)).pairs,
    );
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn baseline_direct_on_a_sphere(bencher: Bencher) {
    look_up(
        bencher,
        Interpolation::Direct,
        &LitSphere::new(SIZE, (45.0, 30.0)).pairs,
    );
}
