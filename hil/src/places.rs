//! Where the parts of the bench lie in the workspace.

use std::path::{Path, PathBuf};

/// This crate's directory.
const CRATE: &str = env!("CARGO_MANIFEST_DIR");

/// The emulator's program.
#[must_use]
pub fn emulator() -> PathBuf {
    Path::new(CRATE).join("emulator/main.mjs")
}

/// What the emulator is made of; `npm ci` puts it there.
#[must_use]
pub fn emulator_modules() -> PathBuf {
    Path::new(CRATE).join("emulator/node_modules")
}

/// The descriptions of devices under test.
#[must_use]
pub fn duts() -> PathBuf {
    Path::new(CRATE).join("duts")
}

/// The workspace.
#[must_use]
pub fn workspace() -> PathBuf {
    Path::new(CRATE)
        .parent()
        .expect("the crate lies in the workspace")
        .to_owned()
}

/// Cargo's output directory.
#[must_use]
pub fn target() -> PathBuf {
    workspace().join("target")
}

/// The host's command, where `cargo build` or `cargo test` of the workspace puts it.
#[must_use]
pub fn command() -> PathBuf {
    target().join("debug/rcg")
}
