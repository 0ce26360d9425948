//! What is said of captures that are there already.
//!
//! # Design
//! Frames say nothing of how much a standard reflects: who learns that it is another than was thought says so, and the same frames are
//! fitted again. How they were captured cannot be changed any more, and is refused if it is asked for otherwise.

use super::capture::Views;
use super::in_holder::check_standard;
use super::interreflection::{check_apart, interreflected};
use crate::brdf::sample::parse;
use crate::calibrate::{CalibrateError, check_image_size};
use crate::instrument::rig::Tilt;
use crate::virtual_rig::setup::SetupError;

/// A second standard of this name is none.
pub const NONE: &str = "none";

/// What is said when captures are fitted; what is not is as when they were made.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Said {
    /// What the standard is, as [`parse`] takes it.
    pub standard: Option<String>,
    /// What the second one is; [`NONE`] to do without.
    pub second_standard: Option<String>,
    /// Tilts at which the standard was captured, if any.
    pub tilts: Vec<Tilt>,
    /// Longest exposure time, seconds.
    pub exposure_s: Option<f64>,
    /// Pixels a side of the image.
    pub image_size: Option<u32>,
}

impl Said {
    /// Puts the standards that are said in place of those of `views`. Returns the second one, if it is to serve.
    ///
    /// # Errors
    /// [`CalibrateError`] if something is said that the captures are not, or standards cannot serve.
    pub(super) fn apply(&self, views: &mut Views) -> Result<Option<String>, CalibrateError> {
        let tilts: Vec<Tilt> = views.stands.iter().filter_map(|stand| stand.tilt).collect();
        let are_same = tilts.len() == self.tilts.len()
            && tilts
                .iter()
                .zip(&self.tilts)
                .all(|(one, other)| Tilt::is_same(Some(*one), Some(*other)));
        if !self.tilts.is_empty() && !are_same {
            let list = |tilts: &[Tilt]| match tilts {
                [] => "none".to_owned(),
                _ => tilts.iter().map(Tilt::to_string).collect::<Vec<_>>().join(","),
            };
            return Err(CalibrateError::otherwise(
                "--tilts",
                list(&tilts),
                list(&self.tilts),
            ));
        }
        if let Some(exposure_s) = self.exposure_s
            && (exposure_s / views.exposure_s - 1.0).abs() > 1e-6
        {
            let ms = |s: f64| format!("{} ms", 1e3 * s);
            return Err(CalibrateError::otherwise(
                "--exposure-ms",
                ms(views.exposure_s),
                ms(exposure_s),
            ));
        }
        check_image_size(views.image_size, self.image_size)?;
        let second = self.second_standard.as_deref();
        if let (None, Some(second)) = (&views.second_standard, second.filter(|spec| *spec != NONE)) {
            return Err(CalibrateError::otherwise("--second-standard", NONE, second));
        }
        if let Some(standard) = &self.standard {
            views.standard.clone_from(standard);
        }
        let second = match second {
            Some(NONE) => None,
            Some(second) => Some(second.to_owned()),
            None => views.second_standard.clone(),
        };
        let first = parse(&views.standard).map_err(SetupError::from)?;
        check_standard(first.as_ref(), &views.standard)?;
        if let Some(spec) = &second {
            let second = parse(spec).map_err(SetupError::from)?;
            check_standard(second.as_ref(), spec)?;
            check_apart(interreflected(first.as_ref()), interreflected(second.as_ref()))?;
        }
        Ok(second)
    }
}
