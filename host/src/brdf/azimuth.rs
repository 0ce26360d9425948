//! Where φ = 0 of a BRDF lies on the sample.

use serde::Serialize;
use serde_json::{Map, Value, json};

/// Attribute of `brdf.zarr`: azimuth in the sample holder of φ = 0 of the file, degrees.
const AZIMUTH: &str = "azimuth_deg";
/// Attribute of `brdf.zarr`: standard uncertainty (k = 1) of where φ = 0 lies, degrees.
const UNCERTAINTY: &str = "azimuth_uncertainty_deg";
/// Attribute of `brdf.zarr`: standard uncertainty (k = 1) of where azimuth 0 of the holder lies, degrees.
const HOLDER: &str = "azimuth_holder_uncertainty_deg";
/// Attribute of `brdf.zarr`: the model by whose lobe the frame was turned.
const MODEL: &str = "azimuth_model";
/// Attribute of `brdf.zarr`: all of it in words.
const ZERO: &str = "azimuth_zero";
/// Attribute of `brdf.zarr`: where the cells of the outgoing grid lie.
const OUTGOING: &str = "outgoing_grid";

/// Where φ = 0 of a BRDF lies on the sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Azimuth {
    /// Its azimuth in the sample holder, as `sample.azimuth_deg` of the rig file has that, degrees.
    pub deg: f64,
    /// The model on whose lobe's axis it was laid, if it was.
    pub model: Option<String>,
    /// Standard uncertainty (k = 1) in degrees: against that axis, or else against the holder. `None` if nobody knows.
    pub standard_uncertainty_deg: Option<f64>,
    /// Standard uncertainty (k = 1) of where azimuth 0 of the holder lies, degrees. `None` if nobody knows.
    pub holder_uncertainty_deg: Option<f64>,
}

impl Azimuth {
    /// φ = 0 is +x of the holder, known to this standard uncertainty.
    pub(crate) fn of_holder(uncertainty_deg: Option<f64>) -> Self {
        Self {
            standard_uncertainty_deg: uncertainty_deg,
            holder_uncertainty_deg: uncertainty_deg,
            ..Self::default()
        }
    }

    /// What the `attributes` of a file say; nothing in files of before: then it is +x of the holder.
    ///
    /// # Errors
    /// The attribute, and what was found in place of degrees.
    pub(super) fn of(attributes: &Map<String, Value>) -> Result<Self, (&'static str, String)> {
        let degrees = |name, range: std::ops::RangeInclusive<f64>| match attributes.get(name) {
            None | Some(Value::Null) => Ok(None),
            Some(value) => value
                .as_f64()
                .filter(|deg| range.contains(deg))
                .map(Some)
                .ok_or_else(|| (name, value.to_string())),
        };
        Ok(Self {
            deg: degrees(AZIMUTH, -360.0..=360.0)?.unwrap_or(0.0),
            standard_uncertainty_deg: degrees(UNCERTAINTY, 0.0..=180.0)?,
            holder_uncertainty_deg: degrees(HOLDER, 0.0..=180.0)?,
            model: attributes.get(MODEL).and_then(Value::as_str).map(str::to_owned),
        })
    }

    /// What a file says of it, and how its grid of outgoing directions lies; null is what it does not say.
    pub(crate) fn attributes(&self) -> Map<String, Value> {
        let phi = match self.deg {
            0.0 => "phi".to_owned(),
            deg => format!("(phi {} {} deg)", if deg < 0.0 { '-' } else { '+' }, deg.abs()),
        };
        let all = json!({
            AZIMUTH: self.deg,
            UNCERTAINTY: self.standard_uncertainty_deg,
            HOLDER: self.holder_uncertainty_deg,
            MODEL: self.model,
            ZERO: self.to_string(),
            OUTGOING: format!("Lambert azimuthal equal-area disk: x + iy = sqrt(2) sin(theta/2) exp(i {phi}), -1..1"),
        });
        match all {
            Value::Object(all) => all,
            _ => Map::new(),
        }
    }
}

impl Azimuth {
    /// Where it lies, in words, for pictures.
    #[must_use]
    pub fn zero(&self) -> String {
        match (&self.model, self.deg) {
            (Some(model), _) => format!("φ = 0 is the axis of ax of a fitted {model} model"),
            (None, 0.0) => "φ = 0 is +x of the sample holder".to_owned(),
            (None, deg) => format!("φ = 0 lies at {deg:.3}° of the sample holder"),
        }
    }
}

impl std::fmt::Display for Azimuth {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.zero())?;
        match self.standard_uncertainty_deg {
            Some(uncertainty_deg) => write!(f, " ± {uncertainty_deg:.3}° (k = 1)")?,
            None => write!(f, ", nobody knows how exactly")?,
        }
        match self.model {
            Some(_) => write!(f, ", at {:.3}° of the sample holder", self.deg),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_file_says_is_read_again() {
        for (deg, model, standard_uncertainty_deg) in [
            (0.0, None, None),
            (0.0, None, Some(0.11)),
            (-30.5, None, Some(0.1)),
            (29.875, Some("ward".to_owned()), Some(0.056)),
        ] {
            let azimuth = Azimuth {
                deg,
                model,
                standard_uncertainty_deg,
                holder_uncertainty_deg: Some(0.2),
            };
            assert_eq!(
                Azimuth::of(&azimuth.attributes()).as_ref(),
                Ok(&azimuth),
                "{azimuth}"
            );
        }
        assert_eq!(Azimuth::of(&Map::new()), Ok(Azimuth::default()));
        for wrong in [json!("30"), json!(1e9), json!([1.0])] {
            let attributes = Map::from_iter([(AZIMUTH.to_owned(), wrong.clone())]);
            assert_eq!(Azimuth::of(&attributes), Err((AZIMUTH, wrong.to_string())));
        }
    }
}
