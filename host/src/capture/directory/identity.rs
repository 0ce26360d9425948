//! What decides what is captured, told by content: a name says little, and files change under theirs.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::{Measurement, MeasurementError};
use crate::instrument::calibration::AppliedCalibration;
use crate::instrument::rig::Rig;
use crate::plan::{Plan, Virtual};
use crate::store::checksum::{sum, sum_of};
use crate::store::whole_file::FileError;

/// SHA-256, in hexadecimal digits, by what it is of.
pub(crate) type Sums = BTreeMap<String, String>;

/// Files in the directory that say what the measurement is; the last is there only with a calibration.
const FILES: [&str; 3] = ["rig.toml", "plan.toml", AppliedCalibration::FILE];
/// Names of the files from elsewhere.
const SAMPLE: &str = "sample";
const TRUTH: &str = "truth";

/// The files that are named for the virtual rig, and what for.
fn files_of(virtual_rig: Option<&Virtual>) -> impl Iterator<Item = (&'static str, PathBuf)> {
    let sample = virtual_rig.and_then(|rig| crate::brdf::sample::file_of(&rig.sample));
    let truth = virtual_rig.and_then(|rig| rig.truth.as_deref().map(Path::new));
    [(SAMPLE, sample), (TRUTH, truth)]
        .into_iter()
        .filter_map(|(what, path)| Some((what, path?.to_owned())))
}

/// The files that are named for the virtual rig, with length and time of change: as long as these stay, so does what is in
/// them.
pub(crate) fn stamps_of(virtual_rig: &Virtual) -> Vec<(PathBuf, Option<(u64, SystemTime)>)> {
    let stamp = |path: &Path| {
        let about = path.metadata().ok()?;
        Some((about.len(), about.modified().ok()?))
    };
    let files = files_of(Some(virtual_rig)).map(|(_, path)| path);
    files.map(|path| (path.clone(), stamp(&path))).collect()
}

/// Sums of the files that are named for the virtual rig.
///
/// # Errors
/// [`FileError`] if one cannot be read.
pub(crate) fn sums_of(virtual_rig: Option<&Virtual>) -> Result<Sums, FileError> {
    files_of(virtual_rig)
        .map(|(what, path)| {
            let sum = sum_of(&path).map_err(|source| FileError::at(&path, source))?;
            Ok((what.to_owned(), sum))
        })
        .collect()
}

/// Sums of what decides what a measurement of `plan` on `rig` in `dir` captures; its calibration is there already.
///
/// # Errors
/// [`MeasurementError::File`] if a file cannot be read.
pub(crate) fn sums_at(dir: &Path, rig: &Rig, plan: &Plan) -> Result<Sums, MeasurementError> {
    let mut sums = sums_of(plan.virtual_rig.as_ref())?;
    sums.insert(FILES[0].to_owned(), sum(rig.to_toml().as_bytes()));
    sums.insert(FILES[1].to_owned(), sum(plan.to_toml().as_bytes()));
    let path = dir.join(AppliedCalibration::FILE);
    if path.is_file() {
        let sum = sum_of(&path).map_err(|source| FileError::at(&path, source))?;
        sums.insert(AppliedCalibration::FILE.to_owned(), sum);
    }
    Ok(sums)
}

impl Measurement {
    /// Refuses files in the directory that are not those with which the measurement was begun.
    pub(super) fn check_files(&self) -> Result<(), MeasurementError> {
        FILES
            .iter()
            .try_for_each(|name| self.check(name, &self.path(name)))
    }

    /// Refuses another file at `path` than the one of that `name`.
    fn check(&self, name: &str, path: &Path) -> Result<(), MeasurementError> {
        let found = match sum_of(path) {
            Ok(found) => Some(found),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            Err(source) => return Err(FileError::at(path, source).into()),
        };
        self.check_sum(name, path, found.as_ref())
    }

    /// Refuses a file at `path` whose sum was `found` if that is not the one of that `name`.
    fn check_sum(&self, name: &str, path: &Path, found: Option<&String>) -> Result<(), MeasurementError> {
        let held = self.sums.get(name);
        if held == found {
            return Ok(());
        }
        let told = |sum: Option<&String>, other: &str| {
            sum.map_or_else(|| "none".to_owned(), |sum| format!("{other} (SHA-256 {sum:.12})"))
        };
        Err(MeasurementError::Changed {
            path: path.display().to_string(),
            expected: told(held, "the file"),
            found: told(found, "another"),
        })
    }

    /// Refuses to go on with files from elsewhere, sample and truth, that are not those with which this measurement was
    /// begun.
    ///
    /// # Errors
    /// [`MeasurementError::Changed`]; [`MeasurementError::File`] if one cannot be read.
    pub(super) fn check_inputs(&self) -> Result<(), MeasurementError> {
        files_of(self.plan.virtual_rig.as_ref()).try_for_each(|(what, path)| self.check(what, &path))
    }

    /// As [`check_inputs`](Self::check_inputs), of files that were `read` when they had these sums.
    ///
    /// # Errors
    /// [`MeasurementError::Changed`].
    pub(crate) fn check_read(&self, read: &Sums) -> Result<(), MeasurementError> {
        files_of(self.plan.virtual_rig.as_ref())
            .try_for_each(|(what, path)| self.check_sum(what, &path, read.get(what)))
    }

    /// Whether a file that is named for the virtual rig is the one with which this measurement was begun, wherever it lies.
    pub(super) fn is_same_file(&self, virtual_rig: Option<&Virtual>, name: &str) -> bool {
        let held = self.sums.get(name);
        files_of(virtual_rig)
            .find(|(what, _)| *what == name)
            .is_some_and(|(_, path)| held.is_some() && held == sum_of(&path).ok().as_ref())
    }
}
