//! Rigs whose parts stand on a table.

use std::path::Path;

use super::{CameraPart, ProjectorPart, Rig, RigError};
use crate::instrument::drivers::{CameraDriver, Genicam, ProjectorDriver, Trigger};
use crate::instrument::parts::Binned;
use crate::instrument::pixel_format::PixelFormat;

impl Rig {
    /// Whether camera and projector stand on a table; they are virtual else.
    #[must_use]
    pub fn is_real(&self) -> bool {
        self.camera.driver != CameraDriver::Virtual
    }

    /// The rig without what drives it: what is left decides what an image means.
    #[must_use]
    pub fn without_drivers(&self) -> Self {
        Self {
            camera: CameraPart {
                driver: CameraDriver::Virtual,
                genicam: None,
                ..self.camera.clone()
            },
            projector: ProjectorPart {
                driver: ProjectorDriver::Virtual,
                files: None,
                ..self.projector.clone()
            },
            trigger: None,
            ..self.clone()
        }
    }

    /// This rig, driven as `other` is: what calibration made of a rig is measured with by what stands on the table now.
    #[must_use]
    pub fn driven_as(&self, other: &Self) -> Self {
        Self {
            camera: CameraPart {
                driver: other.camera.driver,
                genicam: other.camera.genicam.clone(),
                ..self.camera.clone()
            },
            projector: ProjectorPart {
                driver: other.projector.driver,
                files: other.projector.files.clone(),
                ..self.projector.clone()
            },
            trigger: other.trigger.clone(),
            ..self.clone()
        }
    }

    /// This rig with its trigger box at `port`.
    #[must_use]
    pub fn at_port(&self, port: &str) -> Self {
        Self {
            trigger: Some(Trigger {
                port: port.to_owned(),
            }),
            ..self.clone()
        }
    }

    /// Checks that what drives the parts goes together.
    pub(super) fn check_drivers(&self, path: &Path) -> Result<(), RigError> {
        let error = |field: &str, expected: &str, found: &str| RigError::Field {
            path: path.to_path_buf(),
            field: field.to_owned(),
            expected: expected.to_owned(),
            found: found.to_owned(),
        };
        let (camera, projector) = (self.camera.driver, self.projector.driver);
        match (camera, projector) {
            (CameraDriver::Virtual, ProjectorDriver::Virtual) if self.trigger.is_some() => {
                return Err(error(
                    "trigger.port",
                    "nothing beside a virtual camera and projector (--port and --wires drive these by a box elsewhere)",
                    "a table [trigger]",
                ));
            }
            (CameraDriver::Virtual, ProjectorDriver::Virtual) => {}
            (CameraDriver::Virtual, _) => {
                return Err(error(
                    "camera.driver",
                    "a real one beside a real projector, whose light a virtual camera does not see",
                    "virtual",
                ));
            }
            (_, ProjectorDriver::Virtual) => {
                return Err(error(
                    "projector.driver",
                    "a real one beside a real camera, which does not see a virtual projector's light",
                    "virtual",
                ));
            }
            _ => {}
        }
        for (field, is_driver, is_given) in [
            (
                "camera.genicam",
                camera == CameraDriver::Genicam,
                self.camera.genicam.is_some(),
            ),
            (
                "projector.files",
                projector == ProjectorDriver::Files,
                self.projector.files.is_some(),
            ),
        ] {
            if is_given && !is_driver {
                return Err(error(field, "no settings of a driver that is not named", "some"));
            }
        }
        if projector == ProjectorDriver::Files && self.projector.files.is_none() {
            return Err(error("projector.files", "a table with a folder", "nothing"));
        }
        if let Some(files) = &self.projector.files
            && !(0.0..=86_400.0).contains(&files.patience_s)
        {
            let found = files.patience_s.to_string();
            return Err(error("projector.files.patience_s", "0 to 86400 seconds", &found));
        }
        match (camera, &self.camera.genicam) {
            (CameraDriver::Genicam, None) => Err(error("camera.genicam", "a table", "nothing")),
            (CameraDriver::Genicam, Some(genicam)) => self.check_genicam(genicam, error),
            _ => Ok(()),
        }
    }

    /// Checks that what is read of the sensor is what `camera` describes: no frame would tell.
    fn check_genicam(
        &self,
        genicam: &Genicam,
        error: impl Fn(&str, &str, &str) -> RigError,
    ) -> Result<(), RigError> {
        let (camera, lens) = (&self.camera, &self.camera.lens);
        let field = "camera.genicam.region_px";
        let Some([.., width, height]) = genicam.region_px else {
            return Err(error(field, "[x, y, width, height] in pixels", "nothing"));
        };
        // The rig of a capture has fewer pixels than its sensor.
        let is_sensor = camera.binned == Binned::default();
        if is_sensor && (width, height) != (lens.width_px, lens.height_px) {
            return Err(error(
                field,
                &format!("the {}×{} pixels of camera.lens", lens.width_px, lens.height_px),
                &format!("{width}×{height}"),
            ));
        }
        let field = "camera.genicam.pixel_format";
        let name = genicam.pixel_format.as_deref().unwrap_or("nothing");
        let Some(format) = PixelFormat::of(name) else {
            return Err(error(
                field,
                "Mono, Bayer or RGB of 8 to 16 bits, such as BayerRG12",
                name,
            ));
        };
        let (channels, bits) = (usize::from(camera.channels), camera.bits);
        if format.channels() != channels || is_sensor && format.bits() != bits {
            return Err(error(
                field,
                &format!("one of {channels} channels and {bits} bits, as camera has"),
                &format!("{name}, of {} and {}", format.channels(), format.bits()),
            ));
        }
        if genicam.buffers < 2 {
            return Err(error(
                "camera.genicam.buffers",
                "2 or more",
                &genicam.buffers.to_string(),
            ));
        }
        Ok(())
    }
}
