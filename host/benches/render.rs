//! Pixels per second of pictures of a measured (tabulated) BRDF, radiance to PNG.
//!
//! `bytes_to_png` is the baseline: an image that is there already, coded as PNG by the same encoder.

use std::path::Path;

use divan::{Bencher, counter::ItemsCount};
use rcg::base::progress::Silent;
use rcg::brdf::Brdf;
use rcg::instrument::rig::Rig;
use rcg::judge::render::{Picture, corrugated, save, sheet, sphere};
use rcg::measure::{assemble_measurement, capture, prepare};
use rcg::plan::{Request, Virtual};
use rcg::virtual_rig::setup::Setup;

fn main() {
    divan::main();
}

/// Pixels a side.
const SIZE: usize = 4096;
const LIGHT_DEG: (f64, f64) = (45.0, 30.0);

fn measured(dir: &Path) -> Brdf {
    let request = Request {
        grid: rcg::hemisphere::incident::Grid::ThetaPhi { step_deg: 3.0 },
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

fn draw(bencher: Bencher, scene: impl Fn(&Brdf) -> Picture) {
    let dir = tempfile::tempdir().expect("a place for files");
    let brdf = measured(&dir.path().join("m"));
    let out = dir.path().join("picture.png");
    bencher.counter(ItemsCount::new(SIZE * SIZE)).bench_local(|| {
        save(&sheet(&[vec![scene(&brdf)]], 1.0), &out).expect("is written");
    });
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn corrugated_to_png(bencher: Bencher) {
    draw(bencher, |brdf| {
        corrugated(brdf, SIZE, 30.0, LIGHT_DEG).expect("reads")
    });
}

#[divan::bench(sample_count = 2, sample_size = 1)]
fn sphere_to_png(bencher: Bencher) {
    draw(bencher, |brdf| sphere(brdf, SIZE, LIGHT_DEG).expect("reads"));
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn bytes_to_png(bencher: Bencher) {
    let dir = tempfile::tempdir().expect("a place for files");
    let brdf = measured(&dir.path().join("m"));
    let out = dir.path().join("picture.png");
    let image = sheet(
        &[vec![corrugated(&brdf, SIZE, 30.0, LIGHT_DEG).expect("reads")]],
        1.0,
    );
    bencher
        .counter(ItemsCount::new(SIZE * SIZE))
        .bench_local(|| save(&image, &out).expect("is written"));
}
