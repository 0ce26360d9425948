//! Whatever stands in the metadata of a `brdf.zarr`, it is read as a result or refused in one sentence.
//!
//! `host/fuzz/fuzz.sh metadata`; the first byte chooses the file, the rest is what stands there.

#![no_main]

use std::fs;
use std::path::PathBuf;
use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use rcg::base::progress::Silent;
use rcg::brdf::Brdf;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::rig::Rig;
use rcg::measure::{assemble_measurement, capture, prepare};
use rcg::plan::{Request, Virtual};
use rcg::virtual_rig::setup::Setup;

/// A result, made once, and the metadata in it.
fn made() -> &'static (tempfile::TempDir, Vec<PathBuf>) {
    static MADE: OnceLock<(tempfile::TempDir, Vec<PathBuf>)> = OnceLock::new();
    MADE.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder can be made");
        let rig = Rig::load("rcg-1-16bit").expect("a preset");
        let request = Request {
            grid: Grid::ThetaPhi { step_deg: 30.0 },
            image_size: 12,
            exposure_s: Some(0.02),
            ..Request::default()
        };
        let setup = Setup::from(Virtual::default());
        let (job, measurement) =
            prepare(&folder.path().join("m"), &rig, request, &setup, &Silent).expect("it is planned");
        capture(&measurement, &job, &Silent).expect("it is captured");
        assemble_measurement(&measurement, &Silent).expect("it is assembled");
        let out = measurement.path("brdf.zarr");
        let arrays = ["", "f", "sigma", "provenance", "incident_reason", "outgoing_reason", "outgoing_pixel"];
        let names = arrays.map(|array| out.join(array).join("zarr.json"));
        (folder, names.to_vec())
    })
}

fuzz_target!(|drawn: &[u8]| {
    let Some((first, content)) = drawn.split_first() else {
        return;
    };
    let (folder, names) = made();
    let name = &names[usize::from(*first) % names.len()];
    let before = fs::read(name).expect("it was made");
    fs::write(name, content).expect("a file can be written");
    match Brdf::open(&folder.path().join("m/brdf.zarr")) {
        Ok(brdf) => {
            for chunk in 0..brdf.chunks().min(4) {
                let _ = brdf.chunk(chunk);
            }
        }
        Err(error) => {
            let sentence = error.to_string();
            assert!(sentence.contains("brdf.zarr") && !sentence.contains('\n'), "{sentence}");
        }
    }
    fs::write(name, before).expect("a file can be written");
});
