//! Frames per second of assembly with what calibration found, 96×96×3, files in the page cache, all cores.
//!
//! `uncalibrated` is the baseline: the same frames as the rig file says. `without_stray_light` has all of a calibration but glare,
//! ghost, direct light and what watches the lamp by it.

use std::path::Path;
use std::sync::LazyLock;

use divan::{Bencher, counter::ItemsCount};
use rcg::assemble::share::Share;
use rcg::assemble::{Target, assemble};
use rcg::base::progress::Silent;
use rcg::calibrate::photometry;
use rcg::capture::directory::Measurement;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::calibration::{AppliedCalibration, Calibration};
use rcg::instrument::rig::Rig;
use rcg::measure::{capture, prepare};
use rcg::plan::{Request, Virtual};
use rcg::virtual_rig::setup::Setup;
use rcg::virtual_rig::{Tolerances, Truth};
use tempfile::TempDir;

fn main() {
    divan::main();
}

/// Frames of a rig with flaws, and its calibration.
static FRAMES: LazyLock<(TempDir, Measurement, AppliedCalibration)> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a place for files");
    let rig = Rig::load("rcg-3").expect("a preset");
    let truth = Truth::drawn(&rig, Tolerances::DRAWN, 1).expect("a rig");
    let path = folder.path().join("truth.toml");
    std::fs::write(&path, truth.to_toml()).expect("written");
    let virtual_rig = Virtual {
        truth: Some(path.display().to_string()),
        ..Virtual::default()
    };
    let calibration = calibrated(&rig, &virtual_rig, &folder.path().join("calibration"));
    let setup = Setup {
        calibration: Some(calibration.clone()),
        ..Setup::from(virtual_rig)
    };
    let request = Request {
        grid: Grid::ThetaPhi { step_deg: 5.0 },
        image_size: 96,
        exposure_s: Some(1e-3),
        ..Request::default()
    };
    let (job, measurement) = prepare(
        &folder.path().join("m"),
        &calibration.rig,
        request,
        &setup,
        &Silent,
    )
    .expect("a plan");
    capture(&measurement, &job, &Silent).expect("the virtual rig works");
    (folder, measurement, calibration.applied())
});

fn calibrated(rig: &Rig, virtual_rig: &Virtual, dir: &Path) -> Calibration {
    std::fs::create_dir(dir).expect("made");
    std::fs::write(dir.join("rig.toml"), rig.to_toml()).expect("written");
    let request = photometry::Request {
        standard: "lambert:0.98".to_owned(),
        second_standard: Some("lambert:0.2".to_owned()),
        tilts: Vec::new(),
        exposure_s: None,
        image_size: 48,
    };
    let world = Setup::from(virtual_rig.clone()).world().expect("a world");
    photometry::capture(&request, dir, &world, &Silent).expect("captured");
    photometry::calibrate(
        dir,
        &photometry::Said::default(),
        &photometry::Trust::assumed(0.0025),
    )
    .expect("calibrated");
    Calibration::open(dir, rig).expect("read")
}

fn assembled(bencher: Bencher, change: impl Fn(&mut AppliedCalibration)) {
    let (_, m, calibration) = &*FRAMES;
    let mut applied = calibration.clone();
    change(&mut applied);
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
            assemble(&m.rig, &m.plan, &m.directions, &applied, &raw, target, &|_| {}).expect("assembles")
        });
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn uncalibrated(bencher: Bencher) {
    assembled(bencher, |applied| *applied = AppliedCalibration::default());
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn without_stray_light(bencher: Bencher) {
    assembled(bencher, |applied| {
        if let Some(photometry) = &mut applied.photometry {
            photometry.stray = rcg::instrument::calibration::Stray::default();
            photometry.lamp.monitor = None;
        }
    });
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn without_seen_part(bencher: Bencher) {
    assembled(bencher, |applied| {
        if let Some(photometry) = &mut applied.photometry {
            photometry.seen_part = None;
        }
    });
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn calibrated_as_found(bencher: Bencher) {
    assembled(bencher, |_| {});
}
