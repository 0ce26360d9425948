//! Assembling the frames of a measurement again: elsewhere, and with another calibration.
//!
//! # Design
//! A frame is what its pattern lit, and patterns were planned as directions by the geometry of then: with another geometry the same
//! projector pixels pointed elsewhere, and the values would stand at directions that were never lit. So only light, throughput and camera
//! may be others (`photometry.json`); a calibration whose rig is not that of the measurement to the bit is refused. Neither the measurement
//! nor its own result is touched.

use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::assemble::like::is_same_place;
use crate::assemble::share::Share;
use crate::assemble::{Assembled, Probe, Target, assemble};
use crate::base::progress::Progress;
use crate::brdf::Brdf;
use crate::capture::directory::{FIGURES, Measurement, MeasurementError};
use crate::capture::session::ATTACHMENTS;
use crate::instrument::calibration::{AppliedCalibration, Calibration, RIG, rig_hash};
use crate::judge::differences::{Differences, differences};
use crate::measure::MeasureError;

/// What was assembled again.
#[derive(Clone, Debug, Serialize)]
pub struct Again {
    /// What assembly found.
    #[serde(flatten)]
    pub assembled: Assembled,
    /// The result.
    pub out: PathBuf,
    /// SHA-256 of the calibration that was taken into account, as `calibration.json` would hold it; `None` for none.
    pub calibration_sha256: Option<String>,
    /// That of the measurement.
    pub own_calibration_sha256: Option<String>,
    /// By how much it differs from the measurement's own result; `None` if there is none.
    pub differences: Option<Differences>,
}

/// Assembles the frames of `measurement` into the `brdf.zarr` at `out`, with the calibration in the directory `calibration` in place of its
/// own if there is one; of a part nothing is compared.
///
/// # Errors
/// [`MeasureError`], [`MeasurementError::OtherGeometry`] for frames that were captured with another geometry; what is there stays as it is.
pub fn assemble_again(
    measurement: &Measurement,
    calibration: Option<&Path>,
    out: &Path,
    share: Share,
    progress: &dyn Progress,
) -> Result<Again, MeasureError> {
    check_apart(measurement, out)?;
    let other = calibration
        .map(|dir| of_same_geometry(measurement, dir))
        .transpose()?;
    let own = AppliedCalibration::FILE;
    let own = measurement
        .path(own)
        .is_file()
        .then(|| AppliedCalibration::read(measurement.dir()));
    let own = own.transpose().map_err(Box::new)?.map(|applied| applied.sum());
    // Before any work: a damaged one cannot be compared with.
    let path = measurement.path("brdf.zarr");
    let is_whole = !matches!(share, Share::Part(_));
    let older = (is_whole && path.exists())
        .then(|| Brdf::open(&path))
        .transpose()?;
    let to = To {
        out,
        probe: None,
        share,
    };
    let assembled = assembled(measurement, other.as_ref(), to, progress)?;
    let differences = match older {
        Some(older) => {
            progress.begin("compare", 1, "results");
            let differences = differences(&older, &Brdf::open(out)?)?;
            progress.end();
            differences
        }
        None => None,
    };
    Ok(Again {
        assembled,
        out: out.to_owned(),
        calibration_sha256: other.map(|applied| applied.sum()).or_else(|| own.clone()),
        own_calibration_sha256: own,
        differences,
    })
}

/// Where a result goes, and what of it is made.
#[derive(Clone, Copy)]
pub(super) struct To<'a> {
    /// The `brdf.zarr`.
    pub(super) out: &'a Path,
    /// What is wanted of some samples alone.
    pub(super) probe: Option<&'a Probe>,
    /// Which share of it.
    pub(super) share: Share,
}

/// Assembles the frames of `measurement` as `to` says, with the `other` calibration if there is one.
pub(super) fn assembled(
    measurement: &Measurement,
    other: Option<&AppliedCalibration>,
    to: To<'_>,
    progress: &dyn Progress,
) -> Result<Assembled, MeasureError> {
    let frames = measurement.plan.lit_patterns() * measurement.plan.brackets();
    progress.begin("assemble", frames, "frames");
    let Measurement {
        rig,
        plan,
        directions,
        ..
    } = measurement;
    // Frames of another measurement are not combined with this one's plan.
    let raw = measurement.raw()?;
    let own = AppliedCalibration::read(measurement.dir()).map_err(Box::new)?;
    let applied = other.unwrap_or(&own);
    let lineage = measurement.lineage(&raw, other)?;
    let target = Target {
        path: to.out,
        lineage: Some(&lineage),
        probe: to.probe,
        share: to.share,
    };
    let raw = measurement.path("raw.zarr");
    let assembled = assemble(rig, plan, directions, applied, &raw, target, &|done| {
        progress.reach(done);
    })?;
    progress.end();
    Ok(assembled)
}

/// What the calibration in `dir` found, if it is one of the geometry with which the frames of `measurement` were captured.
fn of_same_geometry(measurement: &Measurement, dir: &Path) -> Result<AppliedCalibration, MeasureError> {
    let calibration = Calibration::of_any_rig(dir).map_err(Box::new)?;
    let request = &measurement.plan.request;
    calibration.check_tilt(request.tilt).map_err(Box::new)?;
    let rig = request.rig(&calibration.rig).map_err(MeasurementError::from)?;
    let (expected, found) = (rig_hash(&measurement.rig), rig_hash(&rig));
    if expected != found {
        return Err(MeasurementError::OtherGeometry {
            path: dir.join(RIG).display().to_string(),
            measurement: measurement.dir().display().to_string(),
            expected,
            found,
        }
        .into());
    }
    Ok(calibration.applied())
}

/// Refuses an output that is a measurement's own result, or lies in a store of `measurement`.
fn check_apart(measurement: &Measurement, out: &Path) -> Result<(), MeasureError> {
    let refused = |found: &str| {
        MeasureError::from(MeasurementError::NotApart {
            path: out.display().to_string(),
            found: found.to_owned(),
        })
    };
    let folder = match out.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let is_own_name = out.file_name().is_some_and(|name| name == "brdf.zarr");
    if is_same_place(&measurement.path("brdf.zarr"), out) || is_own_name && Measurement::exists(folder) {
        return Err(refused("a measurement's own one"));
    }
    if is_same_place(measurement.dir(), out) {
        return Err(refused("the measurement itself"));
    }
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let within = |name: &&str| {
        let store = measurement.path(name);
        folder.starts_with(store.canonicalize().unwrap_or(store))
    };
    let stores = ["brdf.zarr", "raw.zarr", FIGURES, ATTACHMENTS];
    match stores.into_iter().find(within) {
        Some(name) => Err(refused(&format!("a place in the {name} of the measurement"))),
        None => Ok(()),
    }
}
