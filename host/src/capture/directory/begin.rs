//! What a directory may hold before it is a measurement.

use std::ffi::OsString;
use std::fs;
use std::path::Path;

use super::manifest::MANIFEST;
use super::{Measurement, MeasurementError};
use crate::capture::session::{ATTACHMENTS, Record};
use crate::instrument::calibration::AppliedCalibration;
use crate::store::Lock;
use crate::store::lock::{self, dangling};
use crate::store::whole_file::{self, FileError, is_partial};

/// Files that a directory can hold before it is a measurement.
const BEGINNINGS: [&str; 11] = [
    ATTACHMENTS,
    Record::FILE,
    "rig.tmp",
    "rig.toml",
    "plan.tmp",
    "adaptive.tmp",
    "calibration.tmp",
    AppliedCalibration::FILE,
    "manifest.tmp",
    MANIFEST,
    lock::NAME,
];

/// The frames of an adaptive measurement until it has a plan.
pub(crate) const FRAMES_BEFORE_PLAN: &str = "adaptive.zarr";

/// Where the pictures of a measurement stand, and their names: the sphere, and some frames.
pub(crate) const FIGURES: &str = "figures";
pub(crate) const PICTURES: [&str; 2] = ["sphere.png", "frames.png"];

/// Removes what killed writers left in `dir` of the files that only the one with the right to write there writes.
pub(crate) fn sweep_unfinished(dir: &Path) {
    whole_file::sweep(dir, &[Record::FILE, MANIFEST, "report.html"]);
    whole_file::sweep(&dir.join(FIGURES), &PICTURES);
}

/// Removes what a writer that was killed left in the measurement `dir` of frames that `raw.zarr` holds now.
pub(super) fn sweep_moved(dir: &Path) -> Result<(), FileError> {
    let path = dir.join(FRAMES_BEFORE_PLAN);
    if path.exists() && dir.join("raw.zarr").exists() {
        fs::remove_dir_all(&path).map_err(|source| FileError::at(&path, source))?;
    }
    Ok(())
}

impl Measurement {
    /// Whether `dir` could become a new measurement: absent or empty.
    ///
    /// # Errors
    /// [`MeasurementError::Exists`].
    pub fn check_new(dir: &Path) -> Result<(), MeasurementError> {
        let taken = |path: &Path, found| MeasurementError::Exists {
            path: path.display().to_string(),
            found,
        };
        if let Some(link) = dangling(dir) {
            return Err(taken(link, "a link that leads nowhere"));
        }
        let is_file = |entry: std::io::Result<fs::DirEntry>| {
            // The lock of a writer that was killed, or ours.
            entry.map_or(true, |entry| entry.file_name() != lock::NAME)
        };
        match fs::read_dir(dir).map(|mut entries| entries.any(is_file)) {
            Ok(false) => Ok(()),
            Ok(true) if Self::exists(dir) => Err(taken(dir, "a measurement; use --resume to go on with it")),
            Ok(true) => Err(taken(dir, "one with files in it")),
            Err(_) if !dir.exists() => Ok(()),
            Err(_) if !dir.is_dir() => Err(taken(dir, "a file")),
            Err(source) => Err(FileError::at(dir, source).into()),
        }
    }

    /// Removes what [`create`](Self::create) leaves in `dir` if it ends before there is a plan (killed, disk full);
    /// where there is a plan, or anything else, all stays as it is.
    ///
    /// # Errors
    /// [`MeasurementError::File`]; [`StoreError::Busy`](crate::store::StoreError::Busy) if another process is writing there.
    pub fn sweep(dir: &Path) -> Result<(), MeasurementError> {
        if !dir.is_dir() {
            return Ok(());
        }
        let _lock = Lock::folder(dir)?;
        let entries = fs::read_dir(dir).map_err(|source| FileError::at(dir, source))?;
        let names: Vec<_> = entries.flatten().map(|entry| entry.file_name()).collect();
        let all_of = |ours: &[&str]| {
            let is_ours = |name: &OsString| is_partial(name) || ours.iter().any(|one| name == one);
            names.iter().all(is_ours)
        };
        let has_plan = names.iter().any(|name| name == "plan.tmp");
        // The plan comes first, under its temporary name: without it these are somebody's files.
        if has_plan && all_of(&BEGINNINGS) || all_of(&[lock::NAME]) {
            for name in names.iter().filter(|name| *name != lock::NAME) {
                let path = dir.join(name);
                let removed = if name == ATTACHMENTS {
                    fs::remove_dir_all(&path)
                } else {
                    fs::remove_file(&path)
                };
                removed.map_err(|source| FileError::at(&path, source))?;
            }
        }
        Ok(())
    }
}
