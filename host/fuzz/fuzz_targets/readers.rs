//! Whatever a file holds, a reader of formats refuses it in one sentence or makes a sample of it that has numbers: no panic, no memory that
//! the file's own size does not explain.
//!
//! `host/fuzz/fuzz.sh readers`.

#![no_main]

use std::fs;

use libfuzzer_sys::fuzz_target;
use rcg::brdf::format::{Format, open};
use rcg::brdf::sample::Sample as _;
use rcg::hemisphere::direction::from_degrees;

fuzz_target!(|drawn: &[u8]| {
    // The first byte chooses the ending of the name, which decides where the content says nothing.
    let Some((first, content)) = drawn.split_first() else {
        return;
    };
    let endings: Vec<&str> = Format::ALL.iter().flat_map(|format| format.endings()).copied().collect();
    let folder = tempfile::tempdir().expect("a folder can be made");
    let path = folder.path().join(format!("a.{}", endings[usize::from(*first) % endings.len()]));
    fs::write(&path, content).expect("a file can be written");
    match open(&path) {
        Ok(sample) => {
            for (theta, phi) in [(0.0, 0.0), (30.0, 45.0), (75.0, 200.0), (89.0, 359.0)] {
                let f = sample.f(from_degrees(theta, phi), from_degrees(60.0, phi + 170.0));
                assert!(f.iter().all(|f| !f.is_infinite()), "{f:?}");
            }
        }
        Err(error) => {
            let sentence = error.to_string();
            assert!(sentence.contains("a.") && !sentence.contains('\n'), "{sentence}");
        }
    }
});
