//! Turning the frame of a sample after it was measured.
//!
//! # Design
//! The values stay where they are; what changes is where φ = 0 lies among them: the incident directions have other azimuths, and the
//! grid of outgoing directions lies turned ([`Disk::turned`](crate::hemisphere::disk::Disk::turned)). So nothing is interpolated, the
//! uncertainties stay those of the values, and turning back gives the file that was.

use std::path::Path;

use serde::Serialize;
use serde_json::Value;

use super::interpolation_errors;
use super::like::{Own, is_same_place, lineage_of, writer_like};
use crate::base::blame::Blame;
use crate::brdf::{Azimuth, Brdf, BrdfError, LINEAGE};
use crate::hemisphere::incident::IncidentSet;
use crate::judge::fit::{AZIMUTH, Fit, FitError, Model};
use crate::store::StoreError;

/// Attribute of `brdf.zarr` that describes the incident directions of rings as they were captured, and what it says behind that.
const RINGS: &str = "incident_grid";
const TURNED: &str = "; less azimuth_deg in phi";

/// An axis that is less certain than this is none, degrees (k = 1).
pub const LEAST_CERTAIN_DEG: f64 = 2.0;

/// Why nothing was turned.
#[derive(Debug, thiserror::Error)]
pub enum TurnError {
    /// The file that is read.
    #[error(transparent)]
    Brdf(#[from] BrdfError),
    /// A store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The model.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// No axis to lay φ = 0 on.
    #[error(
        "{path}: expected a lobe whose axis the {model} model finds to {LEAST_CERTAIN_DEG}° (k = 1), found {found}; give --azimuth in \
         degrees, or another --model"
    )]
    NoAxis {
        /// The file.
        path: String,
        /// The model.
        model: &'static str,
        /// What there is.
        found: String,
    },
    /// A file cannot be written while it is read.
    #[error("{path}: expected another file than the one that is read")]
    Itself {
        /// The file.
        path: String,
    },
}

impl Blame for TurnError {
    fn is_input(&self) -> bool {
        match self {
            Self::Brdf(error) => error.is_input(),
            Self::Store(error) => error.is_input(),
            Self::Fit(error) => error.is_input(),
            Self::NoAxis { .. } | Self::Itself { .. } => true,
        }
    }
}

/// Where φ = 0 is to lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum To {
    /// At this azimuth of the file as it is, degrees.
    Azimuth(f64),
    /// On the axis of `ax` of a fitted lobe.
    Lobe(Model),
}

/// What was turned.
#[derive(Clone, Debug, Serialize)]
pub struct Turned {
    /// By how much, degrees: what was at this azimuth is at 0 now.
    pub by_deg: f64,
    /// Where φ = 0 lies now.
    pub azimuth: Azimuth,
}

/// Writes the BRDF at `path` to `out` in a frame whose φ = 0 lies as `to` says.
///
/// # Errors
/// [`TurnError`]; the file that is read stays as it is.
pub fn turn(path: &Path, to: To, out: &Path) -> Result<Turned, TurnError> {
    let brdf = Brdf::open(path)?;
    if is_same_place(path, out) {
        return Err(TurnError::Itself {
            path: out.display().to_string(),
        });
    }
    let before = brdf.azimuth();
    let (by_deg, model, standard_uncertainty_deg) = match to {
        To::Azimuth(deg) => (deg, None, before.holder_uncertainty_deg),
        To::Lobe(model) => {
            let [deg, uncertainty_deg] = axis(&brdf, model)?;
            (deg, Some(model.name().to_owned()), Some(uncertainty_deg))
        }
    };
    let azimuth = Azimuth {
        deg: readable_deg(before.deg + by_deg),
        model,
        standard_uncertainty_deg,
        ..before.clone()
    };
    write(&brdf, by_deg, &azimuth, out)?;
    Ok(Turned { by_deg, azimuth })
}

/// The same azimuth within ± 180°, without what rounding leaves of one that was turned there and back.
fn readable_deg(deg: f64) -> f64 {
    let within = if deg.abs() <= 180.0 {
        deg
    } else {
        (deg + 180.0).rem_euclid(360.0) - 180.0
    };
    // Far below any uncertainty. Adding 0 leaves no −0.
    (within * 1e9).round() / 1e9 + 0.0
}

/// The azimuth in the file of the axis of `ax`, and its standard uncertainty, degrees.
fn axis(brdf: &Brdf, model: Model) -> Result<[f64; 2], TurnError> {
    let fit = Fit::of_brdf(model, brdf)?;
    let none = |found: String| TurnError::NoAxis {
        path: brdf.path().display().to_string(),
        model: model.name(),
        found,
    };
    if !fit.acceptable {
        let why = fit.warnings.first().cloned();
        return Err(none(format!(
            "a fit that is not acceptable{}",
            why.map_or_else(String::new, |why| format!(" ({why})"))
        )));
    }
    let axis = fit.parameters.iter().find(|parameter| parameter.name == AZIMUTH);
    let known = axis.and_then(|axis| Some([axis.value, axis.standard_uncertainty?]));
    match known {
        Some([deg, uncertainty_deg]) if uncertainty_deg <= LEAST_CERTAIN_DEG => Ok([deg, uncertainty_deg]),
        Some([deg, uncertainty_deg]) => Err(none(format!("{deg:.1} ± {uncertainty_deg:.1}°"))),
        None => Err(none("one that is as wide both ways, or none".to_owned())),
    }
}

/// Writes `brdf` with φ = 0 at `by_deg` of where it was, which is `azimuth` now.
fn write(brdf: &Brdf, by_deg: f64, azimuth: &Azimuth, out: &Path) -> Result<(), TurnError> {
    let set = brdf.grid().turned(by_deg).map_err(|error| brdf.content(&error))?;
    let cells = 0..brdf.disk().len();
    let incident: Vec<_> = (0..set.len()).map(|index| brdf.incident_reason(index)).collect();
    let outgoing: Vec<_> = cells.clone().map(|cell| brdf.outgoing_reason(cell)).collect();
    let pixel_sr: Vec<f64> = cells.map(|cell| brdf.pixel_sr(cell)).collect();
    let mut facts = azimuth.attributes();
    facts.insert(LINEAGE.to_owned(), lineage_of("turn", &[brdf])?);
    if let (IncidentSet::Rings(_), Some(Value::String(rings))) = (&set, brdf.attributes().get(RINGS)) {
        let as_captured = rings.trim_end_matches(TURNED);
        let turned = if azimuth.deg == 0.0 { "" } else { TURNED };
        facts.insert(RINGS.to_owned(), format!("{as_captured}{turned}").into());
    }
    let own = Own {
        grid: &set,
        incident: &incident,
        outgoing: &outgoing,
        pixel_sr: &pixel_sr,
        facts,
    };
    let writer = writer_like(brdf, own, out)?;
    writer.rewrite(&interpolation_errors(brdf.interpolation_errors()))?;
    for chunk in 0..brdf.chunks() {
        if let Some(rows) = brdf.chunk(chunk)? {
            writer.write_chunk(chunk, &rows)?;
        }
    }
    writer.finish()?;
    Ok(())
}
