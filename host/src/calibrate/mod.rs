//! Calibration: how the instrument really is, found with targets in place of the sample.
//!
//! # Design
//! | module | finds | with |
//! |---|---|---|
//! | [`geometry`] | poses, lenses, mirror, sample frame | a flat mirror at known tilts, a diffuse standard |
//! | [`photometry`] | camera, projector's response, light and throughput, interreflection | reflectance standards |
//!
//! A calibration is a directory. `rig.toml` in it is the calibrated rig, which measurements take in place of the nominal
//! one; the JSON files beside it say what was found, how certain it is, and for which rig.

mod file;
pub mod geometry;
pub mod photometry;

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use geometry::{GEOMETRY, Geometry};
use photometry::{PHOTOMETRY, Photometry};

use crate::brackets::Brackets;
use crate::capture::{CaptureError, Captured, Instrument, Tally};
use crate::incident::Grid;
use crate::measure::MeasureError;
use crate::measurement::{Measurement, MeasurementError, hex};
use crate::plan::{self, PlanError};
use crate::rig::{Rig, RigError, Tilt};
use crate::store::raw::SUBJECT;
use crate::store::{ExposureRecord, RawLayout, RawStore, Segment, StoreError};

/// Kind of exposures that show a view of a calibration.
const VIEW: u8 = crate::store::exposure_record::KINDS[2].0;
/// Name of the calibrated rig's file.
pub const RIG: &str = "rig.toml";

/// How the views of a calibration are captured.
#[derive(Clone, Debug, PartialEq)]
pub struct Conditions {
    /// Pixels a side of the camera's image.
    pub image_size: u32,
    /// How the virtual rig really is; see [`plan::Request::truth`].
    pub truth: Option<String>,
    /// Whether the virtual rig is noisy.
    pub noise: bool,
    /// Source of all chance of the virtual rig.
    pub seed: u64,
}

impl Conditions {
    /// What an instrument is opened for, with what it holds tilted by `tilt`.
    fn request(&self, grid: Grid, tilt: Option<Tilt>) -> plan::Request {
        plan::Request {
            grid,
            image_size: self.image_size,
            exposure_s: None,
            brackets: Brackets::default(),
            sample: None,
            truth: self.truth.clone(),
            tilt,
            noise: self.noise,
            seed: self.seed,
        }
    }
}

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
    /// Opens the calibration in `dir`, which must be one of `rig`: of the nominal rig or of what calibration made of it.
    ///
    /// # Errors
    /// [`CalibrateError::OtherRig`]; [`CalibrateError::Content`], also for a directory in which no calibration succeeded.
    pub fn open(dir: &Path, rig: &Rig) -> Result<Self, CalibrateError> {
        if ![GEOMETRY, PHOTOMETRY].iter().any(|file| dir.join(file).is_file()) {
            let found = match std::fs::read_dir(dir) {
                Err(error) => error.to_string(),
                Ok(_)
                    if [RIG, geometry::VIEWS, photometry::VIEWS]
                        .iter()
                        .any(|file| dir.join(file).exists()) =>
                {
                    "a calibration that has not succeeded".to_owned()
                }
                Ok(_) => "neither".to_owned(),
            };
            return Err(CalibrateError::Content {
                path: dir.display().to_string(),
                field: "calibration".to_owned(),
                expected: format!(
                    "{GEOMETRY} or {PHOTOMETRY} as `rcg calibrate geometry --out DIR` and `rcg calibrate photometry \
                     --out DIR` write them"
                ),
                found,
            });
        }
        let calibrated = Rig::load(&dir.join(RIG).display().to_string())?;
        let (given, own) = (rig_hash(rig), rig_hash(&calibrated));
        let path = dir.join(GEOMETRY);
        let geometry = path.is_file().then(|| Geometry::read(dir)).transpose()?;
        let recorded = geometry
            .as_ref()
            .map_or(&own, |geometry| &geometry.nominal_sha256);
        if given != own && given != *recorded {
            return Err(CalibrateError::OtherRig {
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

fn check_rig(path: &Path, rig: &Rig, found: &str) -> Result<(), CalibrateError> {
    let expected = rig_hash(rig);
    if expected == found {
        return Ok(());
    }
    Err(CalibrateError::OtherRig {
        path: path.display().to_string(),
        rig: rig.name.clone(),
        expected,
        found: found.to_owned(),
    })
}

/// What assembly takes into account, as `calibration.json` of a measurement has it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Applied {
    /// Standard uncertainty (k = 1, RMS) of the directions of camera and projector, degrees; zero if nobody knows.
    pub direction_deg: [f64; 2],
    /// Standard uncertainty (k = 1) of where the edges of hole, rim and wire are, degrees; zero if nobody knows.
    pub edge_deg: f64,
    /// Light, throughput and camera.
    pub photometry: Option<Photometry>,
    /// SHA-256 of the rig that was calibrated, as it was before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nominal_sha256: Option<String>,
}

impl Applied {
    /// Name of its file in a measurement.
    pub const FILE: &str = "calibration.json";

    /// What the measurement in `dir` takes into account: nothing if there is no such file.
    ///
    /// # Errors
    /// [`CalibrateError::Content`].
    pub fn read(dir: &Path) -> Result<Self, CalibrateError> {
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

    /// Writes it into the measurement in `dir`.
    ///
    /// # Errors
    /// [`MeasurementError::Io`].
    pub fn write(&self, dir: &Path) -> Result<(), MeasurementError> {
        file::write(&dir.join(Self::FILE), self)
    }
}

impl Measurement {
    /// Refuses to go on with a `rig` (as loaded, or that of `calibration`) or a `calibration` that is not the one with which
    /// this measurement was begun; no calibration leaves the one of then.
    ///
    /// # Errors
    /// [`MeasurementError::Differs`]; [`CalibrateError::Content`].
    pub fn check_rig(&self, rig: &Rig, calibration: Option<&Calibration>) -> Result<(), CalibrateError> {
        if rig.name != self.rig.name {
            let (expected, found) = (self.rig.name.clone(), rig.name.clone());
            return Err(self.differs("rig", expected, found).into());
        }
        let applied = Applied::read(self.dir())?;
        if let Some(calibration) = calibration
            && applied != calibration.applied()
        {
            let (expected, found) = ("the one".to_owned(), "another".to_owned());
            return Err(self.differs("calibration", expected, found).into());
        }
        let (expected, found) = match &applied.nominal_sha256 {
            Some(nominal) if calibration.is_none() => (nominal.clone(), rig_hash(rig)),
            _ => (
                rig_hash(&self.rig),
                rig_hash(&self.plan.request.rig(rig).map_err(MeasurementError::from)?),
            ),
        };
        if expected == found {
            return Ok(());
        }
        let (expected, found) = (
            format!("{} (SHA-256 {expected:.12})", rig.name),
            format!("another one of that name ({found:.12})"),
        );
        Err(self.differs("rig", expected, found).into())
    }
}

impl Calibration {
    /// `rig` with the dark level, dark current, gain and read noise that were found of its camera.
    #[must_use]
    pub fn with_camera(&self, rig: &Rig) -> Rig {
        let mut rig = rig.clone();
        if let Some(photometry) = &self.photometry {
            let found = &photometry.camera;
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
    /// [`CalibrateError::Views`].
    pub fn check_tilt(&self, tilt: Option<Tilt>) -> Result<(), CalibrateError> {
        let photometry = self.photometry.as_ref();
        photometry.map_or(Ok(()), |found| found.sight(tilt).map(|_| ()))
    }

    /// What measurements with it take into account.
    #[must_use]
    pub fn applied(&self) -> Applied {
        Applied {
            direction_deg: self
                .geometry
                .as_ref()
                .map_or([0.0; 2], |geometry| [geometry.camera_deg, geometry.projector_deg]),
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

/// Why there is no calibration.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// The instrument.
    #[error(transparent)]
    Measure(#[from] MeasureError),
    /// Its captures.
    #[error(transparent)]
    Measurement(#[from] MeasurementError),
    /// A store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The rig.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The picture of the residuals.
    #[error(transparent)]
    Picture(#[from] crate::render::PictureError),
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
    /// The views do not determine the geometry.
    #[error("calibration views: expected {expected}, found {found}; {advice}")]
    Views {
        /// What was expected.
        expected: String,
        /// What there is.
        found: String,
        /// What to do.
        advice: &'static str,
    },
}

impl From<CaptureError> for CalibrateError {
    fn from(error: CaptureError) -> Self {
        Self::Measurement(error.into())
    }
}

impl From<PlanError> for CalibrateError {
    fn from(error: PlanError) -> Self {
        Self::Measurement(error.into())
    }
}

/// What tells a rig from every other: the SHA-256 of its file as this program writes it.
#[must_use]
pub fn rig_hash(rig: &Rig) -> String {
    hex(&Sha256::digest(rig.to_toml().as_bytes()))
}

/// Makes the file of the frames that `instrument` will take of the views in the file `views`, which will hold `text`.
fn create_raw(
    path: &Path,
    layout: RawLayout,
    instrument: &Instrument,
    views: &str,
    text: &str,
) -> Result<RawStore, CalibrateError> {
    let layout = RawLayout {
        clock_hz: instrument.device.info().clock_hz,
        ..layout
    };
    let mut attributes = serde_json::Map::new();
    let sums = BTreeMap::from([(views, hex(&Sha256::digest(text.as_bytes())))]);
    attributes.insert(SUBJECT.to_owned(), serde_json::json!(sums));
    Ok(RawStore::create(path, layout, attributes)?)
}

/// Opens the frames `raw` in `dir`, which must have been taken of the views in the file `views` as it is.
fn open_raw(dir: &Path, raw: &str, views: &str) -> Result<RawStore, CalibrateError> {
    let path = dir.join(views);
    let content = |expected: String, found: String| CalibrateError::Content {
        path: path.display().to_string(),
        field: "file".to_owned(),
        expected,
        found,
    };
    let bytes =
        std::fs::read(&path).map_err(|error| content("a readable file".to_owned(), error.to_string()))?;
    let found = hex(&Sha256::digest(&bytes));
    let raw = RawStore::open(&dir.join(raw))?;
    let expected = raw
        .attributes()
        .get(SUBJECT)
        .and_then(|sums| sums[views].as_str());
    if expected == Some(&found) {
        return Ok(raw);
    }
    Err(content(
        format!(
            "the one of which the frames beside it were taken (SHA-256 {:.12})",
            expected.unwrap_or("unknown")
        ),
        format!("another ({found:.12}); put it back, or calibrate into a new directory"),
    ))
}

/// Frames and records of exposures that show no incident direction of a plan.
fn segment_of(shots: Vec<Captured>, tally: Tally, exposure_s: f64) -> Segment {
    let mut segment = Segment {
        tally,
        ..Segment::default()
    };
    for shot in shots {
        let [trigger, on, off] = shot.ticks;
        segment.records.push(ExposureRecord {
            incident: -1,
            kind: VIEW,
            exposure_s,
            trigger_tick: trigger.0,
            strobe_on_tick: on.0,
            strobe_off_tick: off.0,
            frame_id: shot.frame_id,
            camera_timestamp_s: shot.camera_timestamp_s,
            attempts: shot.attempts,
            flags: u16::from(shot.flags),
            lit_solid_angle_sr: f64::NAN,
            lit_irradiance: f64::NAN,
        });
        segment.frames.extend(shot.dn);
    }
    segment
}
