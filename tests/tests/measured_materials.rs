//! The whole chain on real measured reflectance, noise off: what the virtual rig was given comes out again.
//!
//! The files are not part of the project; without them the tests say so and pass.

use std::path::Path;
use std::time::Duration;

use rcg::base::progress::Silent;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::rig::Rig;
use rcg::measure::{complete, prepare};
use rcg::plan::Request;
use rcg::virtual_rig::setup::Setup;

/// Median relative error of `file` in the folder of measured materials, outside the hole, θ ≤ 80°.
fn median_error(file: &str) -> Option<f64> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/data")
        .join(file);
    if !path.is_file() {
        println!("skipped: no measured material at {}", path.display());
        return None;
    }
    let request = Request {
        grid: Grid::ThetaPhi { step_deg: 6.0 },
        image_size: 96,
        exposure_s: None,
        brackets: rcg::plan::brackets::Brackets::One,
        sample: Some(path.display().to_string()),
        truth: None,
        tilt: None,
        noise: false,
        seed: 1,
    };
    let dir = tempfile::tempdir().unwrap();
    let rig = Rig::load("rcg-1").unwrap();
    let measurement = prepare(&dir.path().join("m"), &rig, request, &Setup::default(), &Silent).unwrap();
    let summary = complete(&measurement, &Setup::default(), &|| Duration::ZERO, &Silent).unwrap();
    let against = summary.evaluation.against_reference.unwrap();
    println!("{file}: {:?}, blur {:?}", against.relative_error, against.blur);
    against.relative_error.median.value()
}

#[test]
fn white_paper() {
    if let Some(error) = median_error("paper_white_rgb.bsdf") {
        assert!(error <= 0.005, "{error}");
    }
}

#[test]
fn satin_film() {
    if let Some(error) = median_error("satin_rosaline_rgb.bsdf") {
        assert!(error <= 0.015, "{error}");
    }
}
