//! Frames per second of assembly from `raw.zarr`, 96×96×3, files in the page cache, all cores.
//!
//! `write_only` is the baseline: the same bytes of `brdf.zarr` written without computing anything.

use std::path::Path;

use divan::{Bencher, counter::ItemsCount};
use half::f16;
use rcg::assemble::share::Share;
use rcg::assemble::{CHUNK, Target, assemble};
use rcg::base::progress::Silent;
use rcg::capture::directory::Measurement;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::calibration::AppliedCalibration;
use rcg::instrument::rig::Rig;
use rcg::measure::{Job, capture};
use rcg::plan::{Plan, Request, Virtual};
use rcg::store::{BrdfLayout, BrdfRows, BrdfWriter};

fn main() {
    divan::main();
}

fn captured(dir: &Path) -> Measurement {
    let request = Request {
        grid: Grid::ThetaPhi { step_deg: 2.0 },
        image_size: 96,
        exposure_s: Some(0.004),
        ..Request::default()
    };
    let rig = Rig::load("rcg-2")
        .expect("a preset")
        .with_image_size(96)
        .expect("sees the sample");
    let plan = Plan::new(request, &rig, 0.004)
        .expect("fits")
        .on(Virtual::default());
    let measurement = Measurement::create(dir, rig, plan).expect("a new directory");
    capture(
        &measurement,
        &Job::of(&measurement, None).expect("known"),
        &Silent,
    )
    .expect("the virtual rig works");
    measurement
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn assemble_frames(bencher: Bencher) {
    let dir = tempfile::tempdir().expect("a place for files");
    let m = captured(&dir.path().join("m"));
    let (raw, brdf) = (m.path("raw.zarr"), m.path("brdf.zarr"));
    let target = Target {
        path: &brdf,
        lineage: None,
        probe: None,
        share: Share::Whole,
    };
    bencher
        .counter(ItemsCount::new(m.plan.direction_count))
        .bench_local(|| {
            assemble(
                &m.rig,
                &m.plan,
                &m.directions,
                &AppliedCalibration::default(),
                &raw,
                target,
                &|_| {},
            )
            .expect("assembles")
        });
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn write_only(bencher: Bencher) {
    let dir = tempfile::tempdir().expect("a place for files");
    let layout = BrdfLayout {
        incident: 8100,
        grid: 96,
        channels: 3,
        chunk: CHUNK,
    };
    let cells = CHUNK * 96 * 96;
    let rows = BrdfRows {
        f: vec![0.1; cells * 3],
        sigma: vec![f16::from_f32(0.01); cells * 3],
        provenance: vec![1; cells],
    };
    bencher.counter(ItemsCount::new(8064_u32)).bench_local(|| {
        let path = dir.path().join("brdf.zarr");
        let writer = BrdfWriter::create(&path, layout, &[], serde_json::Map::new(), true).expect("new");
        for chunk in 0..8064 / CHUNK {
            writer.write_chunk(chunk, &rows).expect("written");
        }
        writer.finish().expect("named");
    });
}
