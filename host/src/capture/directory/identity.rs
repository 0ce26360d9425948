//! What decides what is captured, told by content: a name says little, and files change under theirs.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::{Measurement, MeasurementError};
use crate::instrument::calibration::AppliedCalibration;
use crate::instrument::rig::Rig;
use crate::plan::{Plan, Request};
use crate::store::checksum::{sum, sum_of};
use crate::store::whole_file::FileError;

/// SHA-256, in hexadecimal digits, by what it is of.
pub(crate) type Sums = BTreeMap<String, String>;

/// Files in the directory that say what the measurement is; the last is there only with a calibration.
const FILES: [&str; 3] = ["rig.toml", "plan.toml", AppliedCalibration::FILE];
/// Names of the files from elsewhere.
const SAMPLE: &str = "sample";
const TRUTH: &str = "truth";

/// The files that `request` names, and what for.
fn files_of(request: &Request) -> impl Iterator<Item = (&'static str, PathBuf)> {
    let sample = request.sample.as_deref().and_then(crate::brdf::sample::file_of);
    let truth = request.truth.as_deref().map(Path::new);
    [(SAMPLE, sample), (TRUTH, truth)]
        .into_iter()
        .filter_map(|(what, path)| Some((what, path?.to_owned())))
}

/// Sums of the files that `request` names.
///
/// # Errors
/// [`MeasurementError::File`] if one cannot be read.
pub(crate) fn sums_of(request: &Request) -> Result<Sums, MeasurementError> {
    files_of(request)
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
    let mut sums = sums_of(&plan.request)?;
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
        let held = self.sums.get(name);
        let found = match sum_of(path) {
            Ok(found) => Some(found),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            Err(source) => return Err(FileError::at(path, source).into()),
        };
        if held == found.as_ref() {
            return Ok(());
        }
        let told = |sum: Option<&String>, other: &str| {
            sum.map_or_else(|| "none".to_owned(), |sum| format!("{other} (SHA-256 {sum:.12})"))
        };
        Err(MeasurementError::Changed {
            path: path.display().to_string(),
            expected: told(held, "the file"),
            found: told(found.as_ref(), "another"),
        })
    }

    /// Refuses to go on with files from elsewhere, sample and truth, that are not those with which this measurement was
    /// begun. To be asked after they were read: what changes before that is found out.
    ///
    /// # Errors
    /// [`MeasurementError::Changed`]; [`MeasurementError::File`] if one cannot be read.
    pub fn check_inputs(&self) -> Result<(), MeasurementError> {
        files_of(&self.plan.request).try_for_each(|(what, path)| self.check(what, &path))
    }

    /// Whether a file that `request` names is the one with which this measurement was begun, wherever it lies.
    pub(super) fn is_same_file(&self, request: &Request, name: &str) -> bool {
        let held = self.sums.get(name);
        files_of(request)
            .find(|(what, _)| *what == name)
            .is_some_and(|(_, path)| held.is_some() && held == sum_of(&path).ok().as_ref())
    }
}
