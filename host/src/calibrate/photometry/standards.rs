//! What is known of the standards before anything is fitted: by their certificates, or by assumption.

use super::CalibrateError;
use crate::base::date::Date;
use crate::brdf::sample::{SampleError, certificate_of, file_of};
use crate::instrument::calibration::Standard;
use crate::virtual_rig::setup::SetupError;

/// How far standards are trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trust {
    /// Relative standard uncertainty (k = 1) of the reflectance of standards without a certificate; `None` for the
    /// [usual](Self::USUAL) one.
    pub uncertainty: Option<f64>,
    /// When the standards were captured; `None` if nobody says, which no certificate allows.
    pub captured: Option<Date>,
    /// Whether a certificate is taken that does not hold any more.
    pub takes_expired: bool,
}

impl Trust {
    /// What the reflectance of a white plate is usually known to, relative, k = 1.
    pub const USUAL: f64 = 0.0025;

    /// Standards without certificates, known to this relative standard uncertainty.
    #[must_use]
    pub const fn assumed(uncertainty: f64) -> Self {
        Self {
            uncertainty: Some(uncertainty),
            captured: None,
            takes_expired: false,
        }
    }
}

/// What is known of the first standard and of the second, if there is one, in front of a camera of so many `channels`.
///
/// # Errors
/// [`CalibrateError::Setup`] for a certificate that cannot be read or does not hold; [`CalibrateError::Standards`].
pub fn standards(
    (first, second): (&str, Option<&str>),
    channels: usize,
    trust: &Trust,
) -> Result<Vec<Standard>, CalibrateError> {
    let all = std::iter::once(first).chain(second);
    let all = all
        .map(|spec| standard(spec, channels, trust))
        .collect::<Result<Vec<_>, _>>()?;
    let is_certified = all.iter().all(|one| one.certificate.is_some());
    match trust.uncertainty {
        Some(uncertainty) if is_certified => Err(CalibrateError::Standards {
            expected: "no --standard-uncertainty-percent, as every standard has a certificate that states it"
                .to_owned(),
            found: format!("{} %", 100.0 * uncertainty),
        }),
        _ => Ok(all),
    }
}

fn standard(spec: &str, channels: usize, trust: &Trust) -> Result<Standard, CalibrateError> {
    let Some(certified) = certificate_of(spec).map_err(SetupError::from)? else {
        let name = file_of(spec)
            .and_then(|path| path.file_name())
            .map(|name| name.to_string_lossy());
        let uncertainty = trust.uncertainty.unwrap_or(Trust::USUAL);
        return Ok(Standard::assumed(name.as_deref().unwrap_or(spec), uncertainty));
    };
    if channels == 1 && !certified.is_grey() {
        return Err(CalibrateError::Standards {
            expected: format!("one value in {spec} for a camera without colours"),
            found: "those of red, green and blue".to_owned(),
        });
    }
    let mut standard = certified.standard().clone();
    if let Some(certificate) = &mut standard.certificate {
        let refused = |field: &str, expected: String, found: String| {
            let path = spec.into();
            let error = SampleError::File {
                path,
                field: field.to_owned(),
                expected,
                found,
            };
            CalibrateError::from(SetupError::from(error))
        };
        let Some(captured) = trust.captured else {
            return Err(CalibrateError::Standards {
                expected: format!("the day on which {spec} was captured, as a certificate holds for a time"),
                found: "none".to_owned(),
            });
        };
        if certificate.calibrated > captured {
            let expected = format!("a day up to that of the capture, {captured}");
            return Err(refused(
                "calibrated",
                expected,
                certificate.calibrated.to_string(),
            ));
        }
        certificate.expired = certificate.expires.is_some_and(|last| last < captured);
        if let Some(last) = certificate
            .expires
            .filter(|_| certificate.expired && !trust.takes_expired)
        {
            let expected = format!(
                "a certificate that held on the day of the capture, {captured} (--date says when that was; --standard-expired takes it \
                 anyway, and all documents say so)"
            );
            return Err(refused("expires", expected, last.to_string()));
        }
    }
    Ok(standard)
}
