//! Going on with a measurement only as what it is.

use super::{Measurement, MeasurementError};
use crate::instrument::bands::Bands;
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
        let words = |rig: &Rig| rig.bands.as_ref().map_or_else(|| "none".to_owned(), Bands::words);
        if rig.bands != self.rig.bands {
            return Err(self.differs("bands of the rig", words(&self.rig), words(rig)));
        }
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
    pub fn check_same(
        &mut self,
        request: &Request,
        virtual_rig: Option<&Virtual>,
    ) -> Result<(), MeasurementError> {
        let held = &self.plan.request;
        let or_none = |value: Option<String>| value.unwrap_or_else(|| "none".to_owned());
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
        // A replayed plan asks for what a pilot capture chose.
        let chosen = self.plan.code.map_or(Light::Single, Coding::light);
        let light = if request.light == chosen {
            held.light
        } else {
            request.light
        }
        .to_string();
        let tilt = |request: &Request| or_none(request.tilt.map(|tilt| tilt.to_string()));
        let mut fields = vec![
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
            ("estimate", on_or_off(held.estimate), on_or_off(request.estimate)),
            ("tilt", tilt(held), tilt(request)),
            (
                "lossless",
                held.lossless.to_string(),
                request.lossless.to_string(),
            ),
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
        match (&self.plan.virtual_rig, virtual_rig) {
            (Some(held), Some(asked)) => fields.extend(self.virtual_fields(held, asked)),
            (None, None) => {}
            (held, _) => {
                let words = |is_real: bool| if is_real { "a real one" } else { "the virtual one" }.to_owned();
                return Err(self.differs("instrument", words(held.is_none()), words(held.is_some())));
            }
        }
        if let Some((field, expected, found)) = fields.into_iter().find(|(_, held, asked)| held != asked) {
            return Err(self.differs(field, expected, found));
        }
        self.plan.request.reference.clone_from(&request.reference);
        self.plan.virtual_rig = virtual_rig.cloned();
        self.check_inputs()
    }

    /// What there is of the virtual rig that may differ: field, what it is here, and as it is asked for. Of files that lie elsewhere now
    /// the content counts.
    fn virtual_fields(&self, held: &Virtual, asked: &Virtual) -> [(&'static str, String, String); 4] {
        let truth = |spec: &Virtual| spec.truth.clone().unwrap_or_else(|| "none".to_owned());
        let named = |what: &str, held: String, other: String| {
            let is_same = self.is_same_file(Some(asked), what);
            let found = if is_same { held.clone() } else { other };
            (held, found)
        };
        let sample = named("sample", held.sample.clone(), asked.sample.clone());
        let truth = named("truth", truth(held), truth(asked));
        [
            ("sample", sample.0, sample.1),
            ("truth", truth.0, truth.1),
            ("noise", on_or_off(held.noise), on_or_off(asked.noise)),
            ("seed", held.seed.to_string(), asked.seed.to_string()),
        ]
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

/// An option as it is asked for.
fn on_or_off(is_on: bool) -> String {
    if is_on { "on" } else { "off" }.to_owned()
}
