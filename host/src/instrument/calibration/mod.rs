//! How the instrument really is, as calibration found it.
//!
//! # Design
//! A calibration is a directory. `rig.toml` in it is the calibrated rig, which measurements take in place of the nominal
//! one; the JSON files beside it say what was found, how certain it is, and for which rig. How all that is found is the
//! business of [`crate::calibrate`].
//!
//! | file | holds |
//! |---|---|
//! | `geometry` | directions and edges |
//! | `photometry` | light, throughput and camera |
//! | `field` | smooth fields over an image |
//! | `crosstalk` | what the camera's colours show of each other |
//! | `sight` | where the standard was seen and lit |
//! | `stray` | glare, ghost and direct light, and how images lose them |
//! | `lamp` | how steady the light is |
//! | `standard` | the reflectance standards, and whose word they are |
//! | `lights` | the incident directions with which it is lit |
//! | `file` | JSON of finite numbers |

mod crosstalk;
mod field;
pub(crate) mod file;
pub(crate) mod geometry;
pub(crate) mod lamp;
pub(crate) mod lights;
pub(crate) mod photometry;
mod seen_part;
mod sight;
mod standard;
pub(crate) mod stray;

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::base::blame::Blame;
use crate::instrument::bands::MadeBy;
use crate::instrument::rig::{Rig, RigError, Tilt};
use crate::store::checksum::sum;
use crate::store::whole_file::FileError;

pub(crate) use crosstalk::COLOURS;
pub use crosstalk::Crosstalk;
pub use field::SmoothField;
pub(crate) use field::{HIGHEST, TERMS, degree, terms};
pub use geometry::{AS_STATED, Found, GEOMETRY, Geometry, TiltFound, WORST_DEG};
pub use lamp::{LampFound, Monitor};
pub use photometry::{CameraFound, Interreflection, PHOTOMETRY, Photometry};
pub(crate) use photometry::{PHOTOMETRY_VERSION, TwoStandards};
pub(crate) use seen_part::{ELLIPSE, FAR, Patches, Share, Shares, UNKNOWNS, Unknowns};
pub use seen_part::{MeasuredArea, SeenPart};
pub use sight::Sight;
pub(crate) use sight::{BLIND, EDGE, SEEN, UNSEEN};
pub use standard::{Angular, Certificate, Standard};
pub use stray::{GhostFound, Stray};

/// Name of the calibrated rig's file.
pub const RIG: &str = "rig.toml";
/// Names of the files that say which views the two calibrations were made of.
pub(crate) const VIEWS: [&str; 2] = ["geometry-views.json", "photometry-views.json"];
/// By how much whatever is put into the holder leans each way, degrees (k = 1): the tenth of a millimetre by which one end of a plate lies
/// higher, over its length.
pub(crate) const SEATED_DEG: f64 = 0.05;

/// A calibration that measurements take into account.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The calibrated rig, its camera at full size.
    pub rig: Rig,
    /// How certain its geometry is; `None` if only the photometry was calibrated.
    pub geometry: Option<Geometry>,
    /// Light, throughput and camera; `None` if only the geometry was calibrated.
    pub photometry: Option<Photometry>,
}

impl Calibration {
    /// Refuses a directory in which no calibration succeeded.
    fn check_succeeded(dir: &Path) -> Result<(), CalibrationError> {
        if ![GEOMETRY, PHOTOMETRY].iter().any(|file| dir.join(file).is_file()) {
            let found = match std::fs::read_dir(dir) {
                Err(error) => error.to_string(),
                Ok(_)
                    if [RIG, VIEWS[0], VIEWS[1]]
                        .iter()
                        .any(|file| dir.join(file).exists()) =>
                {
                    "a calibration that has not succeeded".to_owned()
                }
                Ok(_) => "neither".to_owned(),
            };
            return Err(CalibrationError::Content {
                path: dir.display().to_string(),
                field: "calibration".to_owned(),
                expected: format!(
                    "{GEOMETRY} or {PHOTOMETRY} as `rcg calibrate geometry --out DIR` and `rcg calibrate photometry \
                     --out DIR` write them"
                ),
                found,
            });
        }
        Ok(())
    }

    /// Opens the calibration in `dir`, of whatever rig it is.
    ///
    /// # Errors
    /// As for [`open`](Self::open).
    pub fn of_any_rig(dir: &Path) -> Result<Self, CalibrationError> {
        Self::check_succeeded(dir)?;
        Self::open(dir, &Rig::load(&dir.join(RIG).display().to_string())?)
    }

    /// Opens the calibration in `dir`, which must be one of `rig`: of the nominal rig or of what calibration made of it.
    ///
    /// # Errors
    /// [`CalibrationError::OtherRig`]; [`CalibrationError::Content`], also for a directory in which no calibration succeeded.
    pub fn open(dir: &Path, rig: &Rig) -> Result<Self, CalibrationError> {
        Self::check_succeeded(dir)?;
        let calibrated = Rig::load(&dir.join(RIG).display().to_string())?;
        let (given, own) = (rig_hash(rig), rig_hash(&calibrated));
        let path = dir.join(GEOMETRY);
        let geometry = path.is_file().then(|| Geometry::read(dir)).transpose()?;
        let recorded = geometry
            .as_ref()
            .map_or(&own, |geometry| &geometry.nominal_sha256);
        if given != own && given != *recorded {
            return Err(CalibrationError::OtherRig {
                path: path.display().to_string(),
                rig: rig.name.clone(),
                expected: given,
                found: recorded.clone(),
            });
        }
        if let Some(geometry) = &geometry {
            check_rig(&path, &calibrated, &geometry.rig_sha256)?;
        }
        let path = dir.join(PHOTOMETRY);
        let photometry = path
            .is_file()
            .then(|| Photometry::read(&path, &calibrated))
            .transpose()?;
        Ok(Self {
            rig: calibrated,
            geometry,
            photometry,
        })
    }
}

/// Refuses a `rig` whose hash is not the `found` one of the file at `path`.
///
/// # Errors
/// [`CalibrationError::OtherRig`].
pub(crate) fn check_rig(path: &Path, rig: &Rig, found: &str) -> Result<(), CalibrationError> {
    let expected = rig_hash(rig);
    if expected == found {
        return Ok(());
    }
    Err(CalibrationError::OtherRig {
        path: path.display().to_string(),
        rig: rig.name.clone(),
        expected,
        found: found.to_owned(),
    })
}

/// What assembly takes into account, as `calibration.json` of a measurement has it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AppliedCalibration {
    /// Standard uncertainty (k = 1, RMS) of the directions of camera and projector, degrees; zero if nobody knows.
    pub direction_deg: [f64; 2],
    /// Standard uncertainty (k = 1) of where azimuth 0 of the holder lies, degrees; `None` if nobody knows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub azimuth_deg: Option<f64>,
    /// Standard uncertainty (k = 1) of where the edges of hole, rim and wire are, degrees; zero if nobody knows.
    pub edge_deg: f64,
    /// Light, throughput and camera.
    pub photometry: Option<Photometry>,
    /// SHA-256 of the rig that was calibrated, as it was before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nominal_sha256: Option<String>,
}

impl AppliedCalibration {
    /// Name of its file in a measurement.
    pub const FILE: &str = "calibration.json";

    /// Share of the camera's range above the dark level up to which it is linear.
    pub(crate) fn linear_to(&self) -> f64 {
        self.photometry
            .as_ref()
            .map_or(1.0, |found| found.camera.linear_to)
    }

    /// Camera and lamp as calibration found them.
    pub(crate) fn camera_and_lamp(&self) -> (Option<&CameraFound>, Option<&LampFound>) {
        let found = self.photometry.as_ref();
        (found.map(|found| &found.camera), found.map(|found| &found.lamp))
    }

    /// What the measurement in `dir` takes into account: nothing if there is no such file.
    ///
    /// # Errors
    /// [`CalibrationError::Content`].
    pub fn read(dir: &Path) -> Result<Self, CalibrationError> {
        let path = dir.join(Self::FILE);
        if path.is_file() {
            let applied: Self = file::read(&path, "rcg measure --calibration DIR")?;
            if let Some(photometry) = &applied.photometry {
                photometry.check(&path, "photometry.")?;
            }
            Ok(applied)
        } else {
            Ok(Self::default())
        }
    }

    /// SHA-256 of its file.
    #[must_use]
    pub fn sum(&self) -> String {
        sum(file::text(self).as_bytes())
    }

    /// Writes it into the measurement in `dir`.
    ///
    /// # Errors
    /// [`FileError`].
    pub fn write(&self, dir: &Path) -> Result<(), FileError> {
        file::write(&dir.join(Self::FILE), self)
    }
}

impl Calibration {
    /// `rig` with the dark level, dark current, gain and read noise that were found of its camera.
    #[must_use]
    pub fn with_camera(&self, rig: &Rig) -> Rig {
        let mut rig = rig.clone();
        if let Some(photometry) = &self.photometry {
            let found = photometry.camera.of_image(&rig.camera.binned);
            let range_dn = f64::from(rig.saturation_dn()) - found.dark_dn;
            rig.camera.dark_dn = found.dark_dn;
            rig.camera.read_noise_e = found.read_noise_e;
            rig.camera.dark_current_e_per_s = (found.dark_dn_per_s * found.gain_e_per_dn).max(0.0);
            rig.camera.full_well_e = found.gain_e_per_dn * range_dn;
        }
        rig
    }

    /// Refuses samples that `tilt` tilts, if the standard was not captured so: there is no throughput where it was not seen.
    ///
    /// # Errors
    /// [`CalibrationError::NoStandard`].
    pub fn check_tilt(&self, tilt: Option<Tilt>) -> Result<(), CalibrationError> {
        let photometry = self.photometry.as_ref();
        photometry.map_or(Ok(()), |found| found.sight(tilt).map(|_| ()))
    }

    /// What measurements with it take into account.
    #[must_use]
    pub fn applied(&self) -> AppliedCalibration {
        AppliedCalibration {
            direction_deg: self.geometry.as_ref().map_or([0.0; 2], |geometry| {
                // Samples lean besides, both ways.
                [geometry.camera_deg, geometry.projector_deg].map(|deg| deg.hypot(2_f64.sqrt() * SEATED_DEG))
            }),
            azimuth_deg: self.geometry.as_ref().map(|geometry| geometry.azimuth_deg),
            edge_deg: self.geometry.as_ref().map_or(0.0, Geometry::edge_deg),
            photometry: self.photometry.clone(),
            nominal_sha256: Some(
                self.geometry
                    .as_ref()
                    .map_or_else(|| rig_hash(&self.rig), |geometry| geometry.nominal_sha256.clone()),
            ),
        }
    }
}

/// What tells a rig from every other: the SHA-256 of its file as this program writes it, without what drives it and without the names of
/// bands that the camera makes.
#[must_use]
pub fn rig_hash(rig: &Rig) -> String {
    let mut rig = rig.without_drivers();
    rig.bands = rig
        .bands
        .take()
        .filter(|bands| bands.made_by == MadeBy::Projector);
    sum(rig.to_toml().as_bytes())
}

/// Why a calibration cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// The rig.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// A file of the calibration.
    #[error("{path}: {field}: expected {expected}, found {found}")]
    Content {
        /// The file.
        path: String,
        /// What in it.
        field: String,
        /// What was expected.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The calibration belongs to another rig.
    #[error(
        "{path}: expected a calibration of rig {rig}, found one of another rig (SHA-256 {found:.12} instead of \
         {expected:.12}); calibrate this rig, or give --rig the one that was calibrated"
    )]
    OtherRig {
        /// The file.
        path: String,
        /// Name of the rig that there is.
        rig: String,
        /// Its hash.
        expected: String,
        /// The recorded hash.
        found: String,
    },
    /// The standard was not captured where the sample is.
    #[error(
        "calibration views: expected a standard that was captured at the tilt of the sample, {tilt}, found it at {tilts}; give \
         `rcg calibrate photometry` all --tilts at which samples are measured"
    )]
    NoStandard {
        /// The tilt of the sample.
        tilt: String,
        /// Those of the standard.
        tilts: String,
    },
}

impl Blame for CalibrationError {
    fn is_input(&self) -> bool {
        true
    }
}
