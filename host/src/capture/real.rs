//! The instrument that stands on a table, by the drivers that its rig file names.

use std::time::Duration;

use serde::Serialize;

use crate::base::blame::Blame;
use crate::capture::Instrument;
use crate::capture::camera::{Camera, CameraError};
use crate::capture::device::{Device, DeviceError};
use crate::capture::dlpc900::Dlpc900Projector;
use crate::capture::files::FilesProjector;
use crate::capture::link::Link;
use crate::capture::projector::{Projector, ProjectorError};
use crate::capture::replay::ReplayCamera;
use crate::capture::wiring::Wiring;
use crate::instrument::drivers::{CameraDriver, ProjectorDriver};
use crate::instrument::rig::Rig;

/// Why a real instrument cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum RealError {
    /// The trigger box.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The projector.
    #[error(transparent)]
    Projector(#[from] ProjectorError),
    /// The driver is not part of this program.
    #[error("{field}: expected a driver that this program was built with, found {driver}; {remedy}")]
    NotBuilt {
        /// Key of the rig file.
        field: &'static str,
        /// What it names.
        driver: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// The projector is another than the rig describes.
    #[error(
        "rig {rig}: expected projector.lens of the {}×{} mirrors of projector {projector}, found {}×{} pixels",
        native.0, native.1, lens.0, lens.1
    )]
    Mirrors {
        /// The rig's name.
        rig: String,
        /// The projector.
        projector: String,
        /// Its mirrors, (columns, rows).
        native: (usize, usize),
        /// What the rig has.
        lens: (usize, usize),
    },
    /// The rig has none.
    #[error("rig {rig}: expected drivers of a real camera and projector, found the virtual rig")]
    Virtual {
        /// The rig's name.
        rig: String,
    },
}

impl Blame for RealError {
    fn is_input(&self) -> bool {
        match self {
            Self::Device(error) => error.is_input(),
            Self::Camera(error) => error.is_input(),
            Self::Projector(error) => error.is_input(),
            Self::NotBuilt { .. } | Self::Mirrors { .. } | Self::Virtual { .. } => true,
        }
    }
}

/// The instrument that `rig` names the drivers of, its camera image of the size that is to be stored. A run that the trigger box may still be busy
/// with is aborted.
///
/// # Errors
/// [`RealError`].
pub fn open(rig: &Rig) -> Result<Instrument, RealError> {
    // What is cheap to ask comes first.
    let projector = projector(rig)?;
    let mut device = trigger_box(rig)?;
    device.abort()?;
    let wiring = Wiring::new(rig.trigger.as_ref());
    wiring.prepare(&mut device)?;
    Ok(Instrument {
        wiring,
        device,
        camera: camera(rig)?,
        projector,
        watching: Vec::new(),
        bands: rig.shown_bands(),
    })
}

/// What was found of one part of an instrument.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// The part.
    pub part: &'static str,
    /// What it is, where it is as it should be.
    pub found: Option<String>,
    /// What is missing, with the remedy, where it is not.
    pub missing: Option<String>,
}

impl Finding {
    fn of(part: &'static str, found: Result<String, RealError>) -> Self {
        let (found, missing) = match found {
            Ok(found) => (Some(found), None),
            Err(error) => (None, Some(error.to_string())),
        };
        Self { part, found, missing }
    }
}

/// What is found of each part that `rig` names a driver of; nothing is exposed or shown.
#[must_use]
pub fn check(rig: &Rig) -> Vec<Finding> {
    if !rig.is_real() {
        let part = |part| Finding::of(part, Ok("virtual".to_owned()));
        return ["trigger box", "camera", "projector"].map(part).to_vec();
    }
    let fires = || -> Result<String, RealError> {
        let device = trigger_box(rig)?;
        let info = device.info();
        let (major, minor, patch) = info.firmware;
        Ok(format!(
            "{}, firmware {major}.{minor}.{patch}, clock of {} MHz",
            device.link().peer(),
            f64::from(info.clock_hz) * 1e-6
        ))
    };
    let seen = || -> Result<String, RealError> {
        let camera = camera(rig)?;
        let format = camera.format();
        let image = format!(
            "{}, images of {}×{} pixels, {} channels",
            camera.name(),
            format.width_px,
            format.height_px,
            format.channels
        );
        let bands = rig
            .bands
            .as_ref()
            .map(|bands| format!("bands: {}", bands.words()));
        let bands: Vec<String> = bands.into_iter().collect();
        Ok([vec![image], camera.settings(), bands].concat().join("; "))
    };
    let shown = || -> Result<String, RealError> {
        #[cfg(feature = "window")]
        if rig.projector.driver == ProjectorDriver::Window {
            return Ok(crate::capture::window::look(rig)?);
        }
        let projector = projector(rig)?;
        let (width, height) = projector.size_px();
        Ok(format!(
            "{}, {width}×{height} pixels, {} patterns at a time",
            projector.description(),
            projector.capacity()
        ))
    };
    vec![
        Finding::of("trigger box", fires()),
        Finding::of("camera", seen()),
        Finding::of("projector", shown()),
    ]
}

/// The trigger box of `rig`.
fn trigger_box(rig: &Rig) -> Result<Device<Box<dyn Link>>, DeviceError> {
    Device::at(&rig.trigger.clone().unwrap_or_default().port)
}

/// The camera of `rig`.
///
/// # Errors
/// [`RealError`].
pub fn camera(rig: &Rig) -> Result<Box<dyn Camera>, RealError> {
    match rig.camera.driver {
        CameraDriver::Virtual => Err(RealError::Virtual {
            rig: rig.name.clone(),
        }),
        CameraDriver::Replay => {
            let replay = rig.camera.replay.clone().unwrap_or_default();
            Ok(Box::new(ReplayCamera::open(&replay.file, rig)?))
        }
        #[cfg(feature = "genicam")]
        CameraDriver::Genicam => Ok(Box::new(crate::capture::genicam::GenicamCamera::open(rig)?)),
        #[cfg(not(feature = "genicam"))]
        CameraDriver::Genicam => Err(RealError::NotBuilt {
            field: "camera.driver",
            driver: "genicam",
            remedy: "build with `--features genicam` (Debian: apt install libaravis-dev libusb-1.0-0-dev)",
        }),
    }
}

/// The projector of `rig`.
///
/// # Errors
/// [`RealError`].
pub fn projector(rig: &Rig) -> Result<Box<dyn Projector>, RealError> {
    let lens = &rig.projector.lens;
    let size_px = (lens.width_px as usize, lens.height_px as usize);
    match (rig.projector.driver, &rig.projector.files) {
        (ProjectorDriver::Files, Some(files)) => Ok(Box::new(FilesProjector::open(
            &files.folder,
            size_px,
            Duration::from_secs_f64(files.patience_s),
        )?)),
        #[cfg(feature = "window")]
        (ProjectorDriver::Window, _) => Ok(Box::new(crate::capture::window::WindowProjector::open(rig)?)),
        #[cfg(not(feature = "window"))]
        (ProjectorDriver::Window, _) => Err(RealError::NotBuilt {
            field: "projector.driver",
            driver: "window",
            remedy: "build with `--features window`, which needs nothing else",
        }),
        (ProjectorDriver::Dlpc900, _) => {
            let settings = rig.projector.dlpc900.clone().unwrap_or_default();
            let projector = Dlpc900Projector::open(&settings, rig.camera.exposure_delay_s)?;
            if projector.size_px() != size_px {
                return Err(RealError::Mirrors {
                    rig: rig.name.clone(),
                    projector: projector.name().to_owned(),
                    native: projector.size_px(),
                    lens: size_px,
                });
            }
            Ok(Box::new(projector))
        }
        _ => Err(RealError::Virtual {
            rig: rig.name.clone(),
        }),
    }
}
