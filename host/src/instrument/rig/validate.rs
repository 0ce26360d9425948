//! Checks that a rig can be built: ranges of its numbers, and that its devices see something.
//!
//! # Design
//! Ranges are wide: they refuse slips of unit (250 for 250 mm) and what the optics cannot compute, not
//! unusual instruments. The checks that need geometry come last, when all numbers are known to be sound.

use std::fmt::Display;
use std::path::Path;

use super::{Binned, Lens, Rig, RigError};
use crate::base::text::listed;
use crate::instrument::optics::{Ellipsoid, Outline, Unmeasurable, View, WIDEST_DEG};

/// Side of the grid of pixels that is probed for a measurable direction.
const PROBES: u32 = 48;

impl Rig {
    /// Checks every number and that camera and projector see part of the hemisphere.
    ///
    /// # Errors
    /// [`RigError::Field`] for the first field that is not as it must be.
    pub fn validate(&self) -> Result<(), RigError> {
        self.check(&Path::new("rig").join(&self.name))
    }

    /// As [`Rig::validate`], naming the file at `path` in errors.
    pub(super) fn check(&self, path: &Path) -> Result<(), RigError> {
        let check = Checker { path };
        self.check_drivers(path)?;
        self.check_mirror(&check)?;
        self.check_camera(&check)?;
        self.check_projector_and_light(&check)?;
        self.check_sight(&check)?;
        self.check_photodiode(path)
    }

    fn check_mirror(&self, check: &Checker) -> Result<(), RigError> {
        let (mirror, sample) = (&self.mirror, &self.sample);
        check.range("mirror.a_m", mirror.a_m, 0.001, 10.0, "metres")?;
        check.range("mirror.b_m", mirror.b_m, 0.001, 10.0, "metres")?;
        if mirror.b_m <= mirror.a_m {
            let expected = format!("more than mirror.a_m = {} metres", mirror.a_m);
            return Err(check.error("mirror.b_m", expected, mirror.b_m));
        }
        let rim_is_inside = mirror.rim_z_m.abs() < mirror.b_m;
        if !rim_is_inside {
            let expected = format!(
                "a number between {} and {} metres, exclusive",
                -mirror.b_m, mirror.b_m
            );
            return Err(check.error("mirror.rim_z_m", expected, mirror.rim_z_m));
        }
        check.range("mirror.hole_deg", mirror.hole_deg, 0.0, 90.0, "degrees")?;
        check.each(
            "mirror.edge_rotation_deg",
            &mirror.edge_rotation_deg,
            45.0,
            "degrees",
        )?;
        check.range("sample.tilt_deg", sample.tilt_deg, -90.0, 90.0, "degrees")?;
        check.range("sample.roll_deg", sample.roll_deg, -180.0, 180.0, "degrees")?;
        check.each("sample.offset_m", &sample.offset_m, 1.0, "metres")?;
        check.range("sample.azimuth_deg", sample.azimuth_deg, -360.0, 360.0, "degrees")?;
        check.range("sample.radius_m", sample.radius_m, 1e-6, 1.0, "metres")?;
        if let Some(wire) = &self.wire {
            check.range("wire.azimuth_deg", wire.azimuth_deg, -360.0, 360.0, "degrees")?;
            check.range("wire.half_width_deg", wire.half_width_deg, 0.0, 45.0, "degrees")?;
        }
        for (at, obstacle) in self.obstacles.iter().enumerate() {
            let field = format!("obstacle[{at}].outline_deg");
            let outline = &obstacle.outline_deg;
            if outline.len() < 3 {
                return Err(check.error(
                    &field,
                    "3 corners or more, each an angle from the mirror's axis and an azimuth",
                    outline.len(),
                ));
            }
            for corner in outline {
                check.range(&field, corner[0], 0.0, 180.0, "degrees from the mirror's axis")?;
                check.range(&field, corner[1], -360.0, 360.0, "degrees of azimuth")?;
            }
            let reach_deg = Outline::of(obstacle).reach_rad().to_degrees();
            if reach_deg > WIDEST_DEG {
                let expected =
                    format!("corners within {WIDEST_DEG} degrees of their middle; make several of it");
                return Err(check.error(&field, &expected, format!("{reach_deg:.1} degrees")));
            }
        }
        Ok(())
    }

    fn check_camera(&self, check: &Checker) -> Result<(), RigError> {
        let camera = &self.camera;
        if !matches!(camera.channels, 1 | 3) {
            return Err(check.error("camera.channels", "1 or 3", camera.channels));
        }
        if !matches!(camera.bits, 8 | 10 | 12 | 16) {
            return Err(check.error("camera.bits", "8, 10, 12 or 16", camera.bits));
        }
        let saturation_dn = f64::from((1_u32 << camera.bits) - 1);
        let Binned {
            pixels,
            step_e,
            read_noise_e,
        } = camera.binned;
        check.range("camera.binned.pixels", pixels, 1.0, 1e9, "pixels")?;
        check.range("camera.binned.step_e", step_e, 0.0, 1e9, "electrons")?;
        check.range("camera.binned.read_noise_e", read_noise_e, 0.0, 1e6, "electrons")?;
        check.range(
            "camera.full_well_e",
            camera.full_well_e,
            1.0,
            1e9 * pixels,
            "electrons",
        )?;
        check.range(
            "camera.read_noise_e",
            camera.read_noise_e,
            0.0,
            1e6 * pixels,
            "electrons",
        )?;
        check.range(
            "camera.dark_dn",
            camera.dark_dn,
            0.0,
            saturation_dn - 1.0,
            "digital numbers",
        )?;
        let dark_current = camera.dark_current_e_per_s;
        check.range(
            "camera.dark_current_e_per_s",
            dark_current,
            0.0,
            1e9 * pixels,
            "electrons per second",
        )?;
        self.check_bands(check)?;
        check.range("camera.exposure_s", camera.exposure_s, 1e-7, 3600.0, "seconds")?;
        check.range(
            "camera.exposure_delay_s",
            camera.exposure_delay_s,
            0.0,
            10.0,
            "seconds",
        )?;
        check.range("camera.readout_s", camera.readout_s, 0.0, 60.0, "seconds")?;
        self.check_lens(check, "camera.lens", &camera.lens)
    }

    fn check_bands(&self, check: &Checker) -> Result<(), RigError> {
        let Some(bands) = &self.bands else {
            return Ok(());
        };
        if self.shows_bands() && self.camera.channels != 1 {
            let expected = "\"camera\", whose channels the bands are where it has more than one";
            return Err(check.error("bands.made_by", expected, "\"projector\""));
        }
        match bands.flaw(self.channels()) {
            None => Ok(()),
            Some((key, expected, found)) => Err(check.error(&format!("bands.{key}"), expected, found)),
        }
    }

    fn check_projector_and_light(&self, check: &Checker) -> Result<(), RigError> {
        let projector = &self.projector;
        check.range("projector.settle_s", projector.settle_s, 0.0, 60.0, "seconds")?;
        check.range(
            "projector.min_period_s",
            projector.min_period_s,
            1e-7,
            60.0,
            "seconds",
        )?;
        check.range(
            "projector.irradiance",
            projector.irradiance,
            1e-9,
            1e9,
            "(relative intensity)",
        )?;
        if let Some(contrast) = projector.contrast {
            check.range(
                "projector.contrast",
                contrast,
                10.0,
                1e9,
                "(full on over full off)",
            )?;
        }
        self.check_lens(check, "projector.lens", &projector.lens)?;
        check.range(
            "light.full_scale_f_sr",
            self.light.full_scale_f_sr,
            1e-9,
            1e9,
            "per steradian",
        )?;
        check.range(
            "light.polarisation",
            self.light.polarisation,
            0.0,
            1.0,
            "(degree of polarisation)",
        )?;
        check.range("light.spot_deg", self.light.spot_deg, 1e-3, 90.0, "degrees")
    }

    fn check_lens(&self, check: &Checker, table: &str, lens: &Lens) -> Result<(), RigError> {
        let field = |key: &str| format!("{table}.{key}");
        for (key, size_px) in [("width_px", lens.width_px), ("height_px", lens.height_px)] {
            if !(1..=32_768).contains(&size_px) {
                return Err(check.error(&field(key), "1 to 32768 pixels", size_px));
            }
        }
        check.range(&field("focal_px"), lens.focal_px, 1e-3, 1e7, "pixels")?;
        check.each(&field("centre_px"), &lens.centre_px, 1e6, "pixels")?;
        check.each(&field("distortion"), &lens.distortion, 1e3, "(no unit)")?;
        check.each(&field("offset_m"), &lens.offset_m, 1.0, "metres")?;
        check.each(&field("rotation_deg"), &lens.rotation_deg, 360.0, "degrees")?;
        check.range(&field("pupil_m"), lens.pupil_m, 0.0, 0.2, "metres")?;
        let ellipsoid = Ellipsoid::of(self);
        if !ellipsoid.contains(ellipsoid.f2() + glam::DVec3::from_array(lens.offset_m)) {
            let expected = "an optical centre inside the mirror's ellipsoid";
            return Err(check.error(
                &field("offset_m"),
                expected,
                format!("{} metres", listed(&lens.offset_m)),
            ));
        }
        if !crate::instrument::optics::Pinhole::of(lens).covers_image() {
            let expected = "a distortion that can be undone everywhere in the image";
            return Err(check.error(&field("distortion"), expected, listed(&lens.distortion)));
        }
        Ok(())
    }

    fn check_sight(&self, check: &Checker) -> Result<(), RigError> {
        for (table, view) in [
            ("camera.lens", View::camera(self)),
            ("projector.lens", View::projector(self)),
        ] {
            if let Some(reason) = why_blind(&view) {
                let expected = "a pose, focal length and mirror with which some pixel sees the hemisphere";
                let found = format!("no measurable pixel, most of them for the reason \"{reason}\"");
                return Err(check.error(table, expected, found));
            }
        }
        Ok(())
    }
}

/// The commonest reason if no pixel of a coarse grid has a measurable direction, else nothing.
fn why_blind(view: &View) -> Option<Unmeasurable> {
    let mut counts = [0_u32; Unmeasurable::ALL.len()];
    let pinhole = view.pinhole();
    for row in 0..PROBES {
        for column in 0..PROBES {
            let u_px = (f64::from(column) + 0.5) / f64::from(PROBES) * f64::from(pinhole.width_px());
            let v_px = (f64::from(row) + 0.5) / f64::from(PROBES) * f64::from(pinhole.height_px());
            match view.direction(u_px, v_px) {
                Ok(_) => return None,
                Err(reason) => counts[usize::from(reason.code()) - 1] += 1,
            }
        }
    }
    Unmeasurable::ALL
        .into_iter()
        .max_by_key(|reason| counts[usize::from(reason.code()) - 1])
}

/// Makes errors that name one file.
struct Checker<'a> {
    path: &'a Path,
}

impl Checker<'_> {
    fn error(&self, field: &str, expected: impl Display, found: impl Display) -> RigError {
        RigError::Field {
            path: self.path.to_path_buf(),
            field: field.to_owned(),
            expected: expected.to_string(),
            found: found.to_string(),
        }
    }

    fn range(&self, field: &str, found: f64, low: f64, high: f64, unit: &str) -> Result<(), RigError> {
        if (low..=high).contains(&found) {
            return Ok(());
        }
        Err(self.error(field, format!("a number from {low} to {high} {unit}"), found))
    }

    fn each(&self, field: &str, found: &[f64], limit: f64, unit: &str) -> Result<(), RigError> {
        if found.iter().all(|number| (-limit..=limit).contains(number)) {
            return Ok(());
        }
        Err(self.error(
            field,
            format!("numbers from -{limit} to {limit} {unit}"),
            listed(found),
        ))
    }
}
