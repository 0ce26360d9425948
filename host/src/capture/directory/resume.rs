//! Going on with a measurement only as what it is.

use super::{Measurement, MeasurementError};
use crate::instrument::calibration::{AppliedCalibration, Calibration, rig_hash};
use crate::instrument::rig::Rig;
use crate::plan::light::{Coding, Light};
use crate::plan::{Request, Virtual};

impl Measurement {
    /// Refuses to go on with a `rig` (as loaded, or that of `calibration`) or a `calibration` that is not the one with which
    /// this measurement was begun; no calibration leaves the one of then.
    ///
    /// # Errors
    /// [`MeasurementError::Differs`]; [`MeasurementError::Calibration`].
    pub fn check_rig(&self, rig: &Rig, calibration: Option<&Calibration>) -> Result<(), MeasurementError> {
        if rig.name != self.rig.name {
            let (expected, found) = (self.rig.name.clone(), rig.name.clone());
            return Err(self.differs("rig", expected, found));
        }
        let applied = AppliedCalibration::read(self.dir())?;
        if let Some(calibration) = calibration
            && applied != calibration.applied()
        {
            let (expected, found) = ("the one".to_owned(), "another".to_owned());
            return Err(self.differs("calibration", expected, found));
        }
        let (expected, found) = match &applied.nominal_sha256 {
            Some(nominal) if calibration.is_none() => (nominal.clone(), rig_hash(rig)),
            _ => (rig_hash(&self.rig), rig_hash(&self.plan.request.rig(rig)?)),
        };
        if expected == found {
            return Ok(());
        }
        let (expected, found) = (
            format!("{} (SHA-256 {expected:.12})", rig.name),
            format!("another one of that name ({found:.12})"),
        );
        Err(self.differs("rig", expected, found))
    }

    /// Refuses to go on if something else is asked for than what this measurement holds. Sample and truth may lie elsewhere
    /// now if their content is the same; they are taken from there then. What it is compared with, and what goes wrong on
    /// purpose, may be another.
    ///
    /// # Errors
    /// [`MeasurementError::Differs`] with the first field that differs.
    pub fn check_same(&mut self, request: &Request, virtual_rig: &Virtual) -> Result<(), MeasurementError> {
        let held = &self.plan.request;
        let Some(held_rig) = &self.plan.virtual_rig else {
            let (expected, found) = ("a real one", "the virtual one");
            return Err(self.differs("instrument", expected.to_owned(), found.to_owned()));
        };
        let (sample, truth) = (
            self.is_same_file(Some(virtual_rig), "sample"),
            self.is_same_file(Some(virtual_rig), "truth"),
        );
        let or_none = |value: Option<String>| value.unwrap_or_else(|| "none".to_owned());
        let on_or_off = |noise: bool| if noise { "on" } else { "off" }.to_owned();
        let milliseconds = |request: &Request| {
            request.exposure_s.map_or_else(
                || "that of a pilot capture".to_owned(),
                |s| format!("{} ms", s * 1e3),
            )
        };
        let spot = |request: &Request| {
            if request.spot_auto {
                return "that of a pilot capture".to_owned();
            }
            let given = request.spot_deg.map(|deg| format!("{deg}°"));
            given.unwrap_or_else(|| "that of the rig".to_owned())
        };
        let grid = |request: &Request| request.grid.to_string();
        let other_grid = if held.grid != request.grid && grid(held) == grid(request) {
            format!("another {}", request.grid)
        } else {
            grid(request)
        };
        let named = |spec: &Virtual| [Some(spec.sample.clone()), spec.truth.clone()].map(or_none);
        let [held_sample, held_truth] = named(held_rig);
        let [asked_sample, asked_truth] = named(virtual_rig);
        let sample = if sample { held_sample.clone() } else { asked_sample };
        let truth = if truth { held_truth.clone() } else { asked_truth };
        // A replayed plan asks for what a pilot capture chose.
        let chosen = self.plan.code.map_or(Light::Single, Coding::light);
        let light = if request.light == chosen {
            held.light
        } else {
            request.light
        }
        .to_string();
        let tilt = |request: &Request| or_none(request.tilt.map(|tilt| tilt.to_string()));
        let fields: [(&'static str, String, String); 13] = [
            ("grid", grid(held), other_grid),
            (
                "image-size",
                held.image_size.to_string(),
                request.image_size.to_string(),
            ),
            ("exposure-ms", milliseconds(held), milliseconds(request)),
            ("spot", spot(held), spot(request)),
            (
                "brackets",
                held.brackets.to_string(),
                request.brackets.to_string(),
            ),
            ("light", held.light.to_string(), light),
            ("sample", held_sample, sample),
            ("truth", held_truth, truth),
            ("tilt", tilt(held), tilt(request)),
            ("noise", on_or_off(held_rig.noise), on_or_off(virtual_rig.noise)),
            ("seed", held_rig.seed.to_string(), virtual_rig.seed.to_string()),
            (
                "sample-name",
                or_none(held.sample_name.clone()),
                or_none(request.sample_name.clone()),
            ),
            (
                "sample-description",
                or_none(held.sample_description.clone()),
                or_none(request.sample_description.clone()),
            ),
        ];
        if let Some((field, expected, found)) = fields.into_iter().find(|(_, held, asked)| held != asked) {
            return Err(self.differs(field, expected, found));
        }
        self.plan.request.reference.clone_from(&request.reference);
        self.plan.virtual_rig = Some(virtual_rig.clone());
        self.check_inputs()
    }

    /// The error that `field` of what is asked for is not what this measurement holds.
    pub(crate) fn differs(&self, field: &'static str, expected: String, found: String) -> MeasurementError {
        MeasurementError::Differs {
            path: self.dir.display().to_string(),
            field,
            expected,
            found,
        }
    }
}
