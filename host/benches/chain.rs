//! The whole chain, `measure --step 1 --image-size 96` with `ward:brass`: 32,400 lit exposures on `rcg-2`,
//! which has no hole. Takes minutes and 7 GB of disk.

use std::time::Duration;

use divan::{Bencher, counter::ItemsCount};
use rcg::base::progress::Silent;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::rig::Rig;
use rcg::measure::{complete, prepare};
use rcg::plan::Request;
use rcg::virtual_rig::setup::Setup;

fn main() {
    divan::main();
}

#[divan::bench(sample_count = 1, sample_size = 1, args = [3.0, 1.0])]
fn measure(bencher: Bencher, step_deg: f64) {
    let rig = Rig::load("rcg-2").expect("a preset");
    let request = Request {
        grid: Grid::ThetaPhi { step_deg },
        image_size: 96,
        ..Request::default()
    };
    let directions = (90.0 / step_deg * 360.0 / step_deg) as u32;
    bencher.counter(ItemsCount::new(directions)).bench_local(|| {
        let dir = tempfile::tempdir().expect("a place for files");
        let out = dir.path().join("m");
        let setup = Setup::default();
        let (job, m) = prepare(&out, &rig, request.clone(), &setup, &Silent).expect("plans");
        complete(&m, &job, &|| Duration::ZERO, &Silent).expect("measures")
    });
}
