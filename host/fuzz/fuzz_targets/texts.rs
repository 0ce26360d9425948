//! Whatever stands in a rig file or a plan, it is read as one that can be used, or refused in one sentence with its path.
//!
//! `host/fuzz/fuzz.sh texts`; `rigs/lab.toml` and the presets make a corpus.

#![no_main]

use std::fs;

use libfuzzer_sys::fuzz_target;
use rcg::instrument::rig::Rig;
use rcg::plan::Plan;

fuzz_target!(|drawn: &[u8]| {
    let folder = tempfile::tempdir().expect("a folder can be made");
    let path = folder.path().join("a.toml");
    fs::write(&path, drawn).expect("a file can be written");
    let is_told = |sentence: String| assert!(sentence.contains("a.toml") && !sentence.contains('\n'), "{sentence}");
    if let Err(error) = Rig::load(&path.to_string_lossy()) {
        is_told(error.to_string());
    }
    match Plan::read(&path) {
        Ok(plan) => {
            if let Err(error) = plan.check(&path) {
                is_told(error.to_string());
            }
        }
        Err(error) => is_told(error.to_string()),
    }
});
