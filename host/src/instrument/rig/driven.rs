//! Rigs whose parts stand on a table.

use std::path::Path;

use super::wired::check_wiring;
use super::{CameraPart, ProjectorPart, Rig, RigError};
use crate::instrument::drivers::{CameraDriver, Genicam, ProjectorDriver, Trigger};
use crate::instrument::drivers::{LONGEST_US, SHORTEST_DELAY_US, SHORTEST_US, SYNC_LATE_US};
use crate::instrument::parts::Binned;
use crate::instrument::pixel_format::PixelFormat;

/// What monitors are set to that nobody says it of.
const USUAL_REFRESH_HZ: f64 = 60.0;

impl Rig {
    /// Whether camera and projector stand on a table; they are virtual else.
    #[must_use]
    pub fn is_real(&self) -> bool {
        self.camera.driver != CameraDriver::Virtual
    }

    /// Display frames a second of the monitor that shows the pictures, 60 where the file does not say; `None` where the
    /// projector is triggered.
    #[must_use]
    pub fn refresh_hz(&self) -> Option<f64> {
        let projector = &self.projector;
        let window = projector.window.as_ref();
        let hz = || {
            window
                .and_then(|window| window.refresh_hz)
                .unwrap_or(USUAL_REFRESH_HZ)
        };
        (projector.driver == ProjectorDriver::Window).then(hz)
    }

    /// The rig without what drives it: what is left decides what an image means.
    #[must_use]
    pub fn without_drivers(&self) -> Self {
        Self {
            camera: CameraPart {
                driver: CameraDriver::Virtual,
                genicam: None,
                replay: None,
                ..self.camera.clone()
            },
            projector: ProjectorPart {
                driver: ProjectorDriver::Virtual,
                files: None,
                window: None,
                dlpc900: None,
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
                replay: other.camera.replay.clone(),
                ..self.camera.clone()
            },
            projector: ProjectorPart {
                driver: other.projector.driver,
                files: other.projector.files.clone(),
                window: other.projector.window.clone(),
                dlpc900: other.projector.dlpc900.clone(),
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
                ..self.trigger.clone().unwrap_or_default()
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
        self.check_settings(error)?;
        if let Some(trigger) = &self.trigger {
            check_wiring(trigger, projector, error)?;
        }
        if let Some(files) = &self.projector.files
            && !(0.0..=86_400.0).contains(&files.patience_s)
        {
            let found = files.patience_s.to_string();
            return Err(error("projector.files.patience_s", "0 to 86400 seconds", &found));
        }
        if projector == ProjectorDriver::Dlpc900 {
            self.check_dlpc900(error)?;
        }
        match &self.camera.genicam {
            Some(genicam) => self.check_genicam(genicam, error),
            None => Ok(()),
        }
    }

    /// Checks that the drivers that are named have their settings, as far as they need some, and no other ones have.
    fn check_settings(&self, error: impl Fn(&str, &str, &str) -> RigError) -> Result<(), RigError> {
        let (camera, projector) = (&self.camera, &self.projector);
        let is_camera = |driver| camera.driver == driver;
        let is_projector = |driver| projector.driver == driver;
        // The table, whether its driver is named, whether it is there, and what it has to be where it is needed.
        let tables = [
            (
                "camera.genicam",
                is_camera(CameraDriver::Genicam),
                camera.genicam.is_some(),
                Some("a table"),
            ),
            (
                "camera.replay",
                is_camera(CameraDriver::Replay),
                camera.replay.is_some(),
                Some("a table with a file"),
            ),
            (
                "projector.files",
                is_projector(ProjectorDriver::Files),
                projector.files.is_some(),
                Some("a table with a folder"),
            ),
            (
                "projector.window",
                is_projector(ProjectorDriver::Window),
                projector.window.is_some(),
                Some("a table with patch_px"),
            ),
            (
                "projector.dlpc900",
                is_projector(ProjectorDriver::Dlpc900),
                projector.dlpc900.is_some(),
                None,
            ),
        ];
        for (field, is_named, is_given, needed) in tables {
            match needed {
                _ if is_given && !is_named => {
                    return Err(error(field, "no settings of a driver that is not named", "some"));
                }
                Some(needed) if is_named && !is_given => return Err(error(field, needed, "nothing")),
                _ => {}
            }
        }
        Ok(())
    }

    /// Checks what a DLPC900 is set to, and that each pattern is there before the camera looks and over before the next trigger, which would
    /// be lost else: all further images would show another pattern than they should.
    fn check_dlpc900(&self, error: impl Fn(&str, &str, &str) -> RigError) -> Result<(), RigError> {
        let projector = &self.projector;
        let settings = projector.dlpc900.clone().unwrap_or_default();
        let delay_us = settings.trigger_delay_us;
        let exposure_us = settings.exposure_us.unwrap_or(SHORTEST_US);
        if self.shows_bands() && !settings.primaries {
            return Err(error(
                "projector.dlpc900.primaries",
                "true, as the projector makes the bands: the unit's outputs switch red, green and blue lights",
                "false",
            ));
        }
        if delay_us < SHORTEST_DELAY_US {
            let expected = format!("{SHORTEST_DELAY_US} µs or more");
            return Err(error(
                "projector.dlpc900.trigger_delay_us",
                &expected,
                &delay_us.to_string(),
            ));
        }
        if !(SHORTEST_US..=LONGEST_US).contains(&exposure_us) {
            let expected = format!("{SHORTEST_US} to {LONGEST_US} µs");
            return Err(error(
                "projector.dlpc900.exposure_us",
                &expected,
                &exposure_us.to_string(),
            ));
        }
        if let Some(late_us) = settings.sync_late_us.iter().find(|us| !SYNC_LATE_US.contains(us)) {
            let expected = format!("{} to {} µs", SYNC_LATE_US.start(), SYNC_LATE_US.end());
            return Err(error(
                "projector.dlpc900.sync_late_us",
                &expected,
                &late_us.to_string(),
            ));
        }
        // A nanosecond may be lost in rounding.
        let delay_s = f64::from(delay_us) * 1e-6 - 1e-9;
        let shown_s = delay_s + f64::from(exposure_us) * 1e-6;
        if projector.settle_s < delay_s {
            let expected = format!("trigger_delay_us of projector.dlpc900, {delay_us} µs, or more");
            return Err(error(
                "projector.settle_s",
                &expected,
                &projector.settle_s.to_string(),
            ));
        }
        if projector.min_period_s < shown_s {
            let expected = format!(
                "delay and exposure of projector.dlpc900, {} µs together, or more",
                u32::from(delay_us) + exposure_us
            );
            return Err(error(
                "projector.min_period_s",
                &expected,
                &projector.min_period_s.to_string(),
            ));
        }
        Ok(())
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

#[cfg(test)]
mod tests {
    use super::super::tests::sentence;
    use super::*;

    #[test]
    fn the_example_of_a_real_rig_names_every_driver_and_what_drives_it_is_no_part_of_its_hash() {
        let lab =
            Rig::from_toml(include_str!("../../../rigs/lab.toml"), Path::new("lab.toml")).expect("usable");
        assert!(lab.is_real());
        assert_eq!(
            Rig::from_toml(&lab.to_toml(), Path::new("x")).expect("usable"),
            lab
        );
        let bare = lab.without_drivers();
        assert!(!bare.is_real());
        assert!(!bare.to_toml().contains("driver") && !bare.to_toml().contains("port"));
        assert_eq!(bare.driven_as(&lab), lab);
        let hash = crate::instrument::calibration::rig_hash;
        assert_eq!(hash(&lab.at_port("/dev/ttyACM7")), hash(&bare));
        // With the numbers of the preset that it is like, and its name, it is that preset.
        let preset = Rig::load("rcg-3").expect("usable");
        assert_eq!(
            hash(&Rig {
                name: preset.name.clone(),
                ..bare
            }),
            hash(&preset)
        );
    }

    #[test]
    fn what_drives_the_parts_of_a_rig_goes_together_or_is_refused() {
        let genicam = |settings: &str| format!("[camera]\ndriver = \"genicam\"\ngenicam = {{ {settings} }}");
        let [good, small, coarse, grey, unknown, bare] = [
            "region_px = [0, 0, 2048, 2048], pixel_format = \"RGB16\"",
            "region_px = [0, 0, 1024, 2048], pixel_format = \"RGB16\"",
            "region_px = [0, 0, 2048, 2048], pixel_format = \"BayerRG12\"",
            "region_px = [0, 0, 2048, 2048], pixel_format = \"Mono16\"",
            "region_px = [0, 0, 2048, 2048], pixel_format = \"YUV422\"",
            "trigger = \"Line1\"",
        ]
        .map(genicam);
        let camera = ("[camera]", good.as_str());
        let projector = (
            "[projector]\n",
            "[projector]\ndriver = \"files\"\nfiles = { folder = \"p\" }\n",
        );
        for (changes, field, found) in [
            (&[camera][..], "projector.driver", "found virtual"),
            (&[projector], "camera.driver", "found virtual"),
            (
                &[camera, ("[projector]\n", "[projector]\ndriver = \"files\"\n")],
                "projector.files",
                "found nothing",
            ),
            (
                &[projector, ("[camera]", "[camera]\ndriver = \"replay\"")],
                "camera.replay",
                "found nothing",
            ),
            (
                &[("[camera]", "[camera]\nreplay = { file = \"m\" }")],
                "camera.replay",
                "no settings of a driver that is not named",
            ),
            (
                &[("[camera]", "[camera]\ngenicam = {}")],
                "camera.genicam",
                "no settings of a driver that is not named",
            ),
            (&[("[mirror]", "[trigger]\n[mirror]")], "trigger.port", "--wires"),
            (
                &[("[camera]", "[camera]\ndriver = \"usb\"")],
                "camera.driver",
                "virtual",
            ),
            (&[projector, ("[camera]", &bare)], "camera", "trigger_line"),
            (
                &[projector, ("[camera]", &small)],
                "camera.genicam.region_px",
                "found 1024×2048",
            ),
            (
                &[projector, ("[camera]", &coarse)],
                "camera.genicam.pixel_format",
                "3 channels and 16 bits",
            ),
            (
                &[projector, ("[camera]", &grey)],
                "camera.genicam.pixel_format",
                "found Mono16, of 1 and 16",
            ),
            (
                &[projector, ("[camera]", &unknown)],
                "camera.genicam.pixel_format",
                "found YUV422",
            ),
        ] {
            let sentence = sentence(changes);
            assert!(
                sentence.starts_with(&format!("lab/my.toml: {field}")) && sentence.contains(found),
                "{sentence}"
            );
        }
    }

    #[test]
    fn what_a_dlpc900_is_set_to_fits_the_rig_or_is_refused() {
        let camera = (
            "[camera]",
            "[camera]\ndriver = \"genicam\"\ngenicam = { region_px = [0, 0, 2048, 2048], pixel_format = \"RGB16\" }",
        );
        for (settings, field, found) in [
            ("exposure_us = 104", "projector.dlpc900.exposure_us", "found 104"),
            (
                "trigger_delay_us = 103",
                "projector.dlpc900.trigger_delay_us",
                "found 103",
            ),
            (
                "sync_late_us = [0, -21]",
                "projector.dlpc900.sync_late_us",
                "found -21",
            ),
            ("trigger_delay_us = 33301", "projector.settle_s", "found 0.0333"),
            (
                "exposure_us = 16600",
                "projector.min_period_s",
                "16705 µs together",
            ),
            ("trigger_edge = \"both\"", "projector", "rising"),
        ] {
            let mirrors = format!("[projector]\ndriver = \"dlpc900\"\ndlpc900 = {{ {settings} }}\n");
            let sentence = sentence(&[camera, ("[projector]\n", &mirrors)]);
            assert!(sentence.contains(field) && sentence.contains(found), "{sentence}");
        }
        let unnamed = "[projector]\ndriver = \"files\"\nfiles = { folder = \"p\" }\ndlpc900 = {}\n";
        let sentence = sentence(&[camera, ("[projector]\n", unnamed)]);
        assert!(
            sentence.contains("projector.dlpc900: expected no settings"),
            "{sentence}"
        );
    }
}
