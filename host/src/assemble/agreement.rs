//! Whether the records of `raw.zarr` are those that the plan says.

use crate::plan::Exposure;
use crate::store::ExposureRecord;

/// Checks the `records` of the exposures from number `first` on: `patterns` of the plan, each with all of `exposures_s`.
///
/// # Errors
/// A sentence with the exposure, the field, what was expected and what was found.
pub(super) fn check(
    first: usize,
    records: &[ExposureRecord],
    patterns: &[Exposure],
    exposures_s: &[f64],
) -> Result<(), String> {
    for (exposure, record) in (first..).zip(records) {
        let complain = |field: &str, expected: String, found: String| {
            Err(format!(
                "exposure {exposure}, {field}: expected {expected}, found {found}"
            ))
        };
        let incident = patterns[exposure / exposures_s.len()].code();
        if record.incident != incident {
            let expected = format!("{incident} from the plan");
            return complain("incident", expected, record.incident.to_string());
        }
        let exposure_s = exposures_s[exposure % exposures_s.len()];
        if record.exposure_s.total_cmp(&exposure_s).is_ne() {
            let expected = format!("{exposure_s} s from the plan");
            return complain("exposure_s", expected, format!("{} s", record.exposure_s));
        }
        for (field, found) in [
            ("lit_irradiance", record.lit_irradiance),
            ("lit_solid_angle_sr", record.lit_solid_angle_sr),
        ] {
            if !(found.is_finite() && found >= 0.0) {
                return complain(
                    field,
                    "a finite number of 0 or more".to_owned(),
                    found.to_string(),
                );
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_that_contradict_the_plan_are_named() {
        type Edit = fn(&mut ExposureRecord);
        let patterns = [Exposure::Black, Exposure::Incident(7)];
        let times_s = [0.01, 0.1];
        let record = |exposure: usize| ExposureRecord {
            incident: patterns[exposure / 2].code(),
            exposure_s: times_s[exposure % 2],
            ..ExposureRecord::default()
        };
        let sound: Vec<ExposureRecord> = (0..4).map(record).collect();
        assert_eq!(check(0, &sound, &patterns, &times_s), Ok(()));
        assert_eq!(check(2, &sound[2..], &patterns, &times_s), Ok(()));
        let edits: [(&str, Edit); 6] = [
            ("incident", |record| record.incident = 6),
            ("exposure_s", |record| record.exposure_s *= 2.0),
            ("exposure_s", |record| record.exposure_s = f64::NAN),
            ("lit_irradiance", |record| record.lit_irradiance = f64::NAN),
            ("lit_irradiance", |record| record.lit_irradiance = -1.0),
            ("lit_solid_angle_sr", |record| {
                record.lit_solid_angle_sr = f64::INFINITY;
            }),
        ];
        for (field, edit) in edits {
            let mut wrong = sound.clone();
            edit(&mut wrong[3]);
            let found = check(0, &wrong, &patterns, &times_s).unwrap_err();
            assert!(
                found.starts_with(&format!("exposure 3, {field}: expected ")) && found.contains(", found "),
                "{found}"
            );
        }
    }
}
