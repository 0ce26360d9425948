//! The file of a certificate.

use std::fmt::Display;
use std::path::Path;

use serde::Deserialize;
use toml::Value;

use super::geometry::{Geometry, LARGEST_DEG, Quantity};
use crate::base::date::Date;
use crate::brdf::sample::SampleError;
use crate::instrument::rig::{RigError, explain};
use crate::store::checksum::sum_of;

/// Version of the format.
const VERSION: u32 = 1;
/// Characters of the longest name.
const LONGEST_NAME: usize = 120;

/// A certificate as its file has it; what the fields mean says the example in `docs/standard.toml`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CertificateFile {
    pub(super) version: u32,
    pub(super) name: String,
    pub(super) serial: Option<String>,
    pub(super) certificate: String,
    pub(super) laboratory: String,
    pub(super) calibrated: Day,
    pub(super) expires: Option<Day>,
    pub(super) quantity: String,
    geometry: String,
    pub(super) k: f64,
    pub(super) value: Option<Numbers>,
    pub(super) expanded_uncertainty: Option<Numbers>,
    pub(super) bands_nm: Option<Vec<[f64; 2]>>,
    #[serde(default)]
    pub(super) spectrum: Vec<Line>,
    pub(super) angular: Option<AngularFile>,
}

/// One wavelength.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Line {
    pub(super) wavelength_nm: f64,
    pub(super) value: f64,
    pub(super) expanded_uncertainty: f64,
}

/// What is known of how f goes with direction.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AngularFile {
    /// Relative, k = 1, of f in one direction.
    pub(super) standard_uncertainty: f64,
    /// Of that between directions.
    pub(super) correlation: Option<f64>,
    /// Polar angle up to which that holds, degrees.
    pub(super) to_deg: Option<f64>,
    #[serde(default)]
    pub(super) values: Vec<Direction>,
}

/// f at a pair of directions in the plane of light, over that at others.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Direction {
    pub(super) incident_deg: f64,
    /// Negative on the light's own side.
    pub(super) outgoing_deg: f64,
    pub(super) ratio: f64,
}

/// A day, as a date of TOML or as text.
#[derive(Debug, Deserialize)]
#[serde(try_from = "Value")]
pub(super) struct Day(pub(super) Date);

impl TryFrom<Value> for Day {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        let text = match &value {
            Value::Datetime(day) => day.to_string(),
            Value::String(text) => text.clone(),
            other => other.to_string(),
        };
        let none = || {
            format!(
                "{}, expected a day such as 2027-03-14",
                crate::base::text::shown(&text)
            )
        };
        text.parse().map(Self).map_err(|_| none())
    }
}

/// One number, or one for each channel.
#[derive(Debug, Deserialize)]
#[serde(try_from = "Value")]
pub(super) struct Numbers(pub(super) Vec<f64>);

impl TryFrom<Value> for Numbers {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        let number = |value: &Value| match value {
            Value::Float(number) => Some(*number),
            Value::Integer(number) => Some(*number as f64),
            _ => None,
        };
        let numbers: Option<Vec<f64>> = match &value {
            Value::Array(all) => all.iter().map(number).collect(),
            one => number(one).map(|one| vec![one]),
        };
        let right = numbers.filter(|all| [1, 3].contains(&all.len()));
        right.map(Self).ok_or_else(|| {
            let found = crate::base::text::shown(&value.to_string());
            format!("{found}, expected one number, or those of red, green and blue")
        })
    }
}

/// The complaint that in `field` of the file at `path` something else was `found` than was `expected`.
pub(super) fn content(path: &Path, field: &str, expected: &str, found: impl Display) -> SampleError {
    SampleError::File {
        path: path.to_owned(),
        field: field.to_owned(),
        expected: expected.to_owned(),
        found: found.to_string(),
    }
}

/// The certificate at `path`, and the SHA-256 of its file.
pub(super) fn open(path: &Path) -> Result<(CertificateFile, String), SampleError> {
    let unreadable = |cause: std::io::Error| SampleError::Unreadable {
        path: path.to_owned(),
        cause,
    };
    let text = crate::base::text::read(path).map_err(|error| unreadable(error.into()))?;
    let sha256 = sum_of(path).map_err(unreadable)?;
    Ok((parse(&text, path)?, sha256))
}

/// The file at `path`, which holds `text`.
fn parse(text: &str, path: &Path) -> Result<CertificateFile, SampleError> {
    let file: CertificateFile = toml::from_str(text).map_err(|error| match explain(text, path, &error) {
        RigError::Field {
            path,
            field,
            expected,
            found,
        } => content(&path, field.trim_start_matches('['), &expected, found),
        RigError::Syntax {
            path,
            line,
            column,
            expected,
            found,
        } => content(&path, &format!("line {line}, column {column}"), &expected, found),
        unreadable @ RigError::Unreadable { .. } => content(path, "file", "valid TOML", unreadable),
    })?;
    file.check(path)?;
    Ok(file)
}

impl CertificateFile {
    fn check(&self, path: &Path) -> Result<(), SampleError> {
        if self.version != VERSION {
            return Err(content(path, "version", &VERSION.to_string(), self.version));
        }
        for (field, name) in [
            ("name", Some(&self.name)),
            ("serial", self.serial.as_ref()),
            ("certificate", Some(&self.certificate)),
            ("laboratory", Some(&self.laboratory)),
        ] {
            let fits = |name: &String| {
                let count = name.chars().count();
                let is_plain = *crate::base::text::plain(name) == **name;
                !name.trim().is_empty() && count <= LONGEST_NAME && is_plain
            };
            if let Some(name) = name.filter(|name| !fits(name)) {
                let expected = format!("words, at most {LONGEST_NAME} characters");
                return Err(content(path, field, &expected, crate::base::text::shown(name)));
            }
        }
        if let Some(expires) = &self.expires
            && expires.0 <= self.calibrated.0
        {
            let expected = format!("a day after that of the calibration, {}", self.calibrated.0);
            return Err(content(path, "expires", &expected, expires.0));
        }
        self.angular
            .as_ref()
            .map_or(Ok(()), |angular| angular.check(path))
    }

    /// What was calibrated, and in which geometry.
    pub(super) fn geometry(&self, path: &Path) -> Result<Geometry, SampleError> {
        let quantity = Quantity::ALL.into_iter().find(|one| one.name() == self.quantity);
        let Some(quantity) = quantity else {
            let expected = "reflectance, reflectance factor or brdf";
            let found = crate::base::text::shown(&self.quantity);
            return Err(content(path, "quantity", expected, found));
        };
        Geometry::parse(quantity, &self.geometry).ok_or_else(|| {
            let expected = match quantity {
                Quantity::Reflectance => {
                    format!(
                        "degrees/hemisphere for a reflectance, such as 8/hemisphere, from 0 to {LARGEST_DEG}"
                    )
                }
                _ => format!(
                    "degrees of light/degrees of view for a {}, such as 0/45, up to {LARGEST_DEG}",
                    quantity.name()
                ),
            };
            content(
                path,
                "geometry",
                &expected,
                crate::base::text::shown(&self.geometry),
            )
        })
    }
}

impl AngularFile {
    fn check(&self, path: &Path) -> Result<(), SampleError> {
        if !(self.standard_uncertainty > 0.0 && self.standard_uncertainty <= 0.2) {
            let expected = "a number above 0 up to 0.2, relative, k = 1";
            return Err(content(
                path,
                "angular.standard_uncertainty",
                expected,
                self.standard_uncertainty,
            ));
        }
        if let Some(correlation) = self.correlation
            && !(0.0..=1.0).contains(&correlation)
        {
            let expected = "a number from 0 to 1";
            return Err(content(path, "angular.correlation", expected, correlation));
        }
        let field = "angular.to_deg";
        match self.to_deg {
            Some(to_deg) if !(0.0..=90.0).contains(&to_deg) => {
                Err(content(path, field, "degrees from 0 to 90", to_deg))
            }
            None if self.values.is_empty() => {
                let expected = "the polar angle in degrees up to which the uncertainty holds, as there are no values by angle";
                Err(content(path, field, expected, "nothing"))
            }
            _ => Ok(()),
        }
    }
}
