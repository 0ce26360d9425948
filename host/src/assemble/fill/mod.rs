//! Filling: directions that one capture does not reach, from others, from reciprocity, from neighbours, from a model.
//!
//! # Design
//! | step | file | provenance |
//! |---|---|---|
//! | merge of captures with the sample tilted otherwise | `merge` | merged |
//! | the exchanged pair of directions (Helmholtz reciprocity) | `gaps` | reciprocal |
//! | what the wire hides, from both sides of it | `gaps` | interpolated |
//! | a fitted GGX with a Lambert base (`model`), where something near was measured (`near`) | `gaps` | modelled |
//!
//! Each step takes what those before have left. Merging comes first, because what was measured is better than what follows
//! from a law. Where camera and projector share one hole, as in RCG-1, the exchange of directions cannot fill it: it brings
//! back what saturated, what one device sees and the other does not, and what only the grid leaves out.
//!
//! Assembled files are in the sample's frame whatever the tilt was, so a pair of directions is the same pair in each. What
//! the tilts were not quite, and how the light has changed in between, is found in the overlap (`merge`).
//!
//! Captures with other incident directions (adaptive ones, lists) become one list of all of them (`union`), in which each row
//! holds what was measured at just that direction.
//!
//! Everything streams chunk by chunk through files; memory does not grow with them. The result is a `brdf.zarr` like any
//! other, in which directions that were filled count as reached.

mod gaps;
mod mean;
mod merge;
mod model;
mod near;
mod union;

use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::Serialize;
use serde_json::{Map, Value, json};

pub use merge::Alignment;

use crate::assemble::like::{self, Own, finish, is_same_place};
use crate::assemble::list_attributes;
use crate::base::blame::Blame;
use crate::base::progress::Progress;
use crate::brdf::{Brdf, BrdfError, LINEAGE, evidence};
use crate::hemisphere::direction::{from_angles, is_above_horizon};
use crate::hemisphere::incident::IncidentSet;
use crate::instrument::optics::Unmeasurable;
use crate::judge::fit::{Fit, FitError};
use crate::store::provenance::Provenance;
use crate::store::{BrdfWriter, StoreError};

/// Coverage counts pairs of directions up to this polar angle, degrees.
pub const COVERED_THETA_DEG: f64 = 85.0;

/// Share of the pairs without a value that is worth a sentence.
const WORTH_SAYING: f64 = 1e-3;

/// Directions by which the solid angles of a list are found.
const SPIRAL: u32 = 20_000;
/// The golden angle, radians.
const GOLDEN_RAD: f64 = 2.399_963_229_728_653;

/// Why there is nothing filled.
#[derive(Debug, thiserror::Error)]
pub enum FillError {
    /// A file.
    #[error(transparent)]
    Brdf(#[from] BrdfError),
    /// A store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The model.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// Files that do not go together.
    #[error("{path}: {field}: expected {expected}, found {found}")]
    Differs {
        /// The file.
        path: String,
        /// What differs.
        field: &'static str,
        /// As in the first file.
        expected: String,
        /// As in this one.
        found: String,
    },
    /// A file without a measured sample.
    #[error("{path}: expected at least {expected} measured samples to fill from, found {found}")]
    Nothing {
        /// The file.
        path: String,
        /// How many it takes.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// Captures that are not equally bright.
    #[error(
        "{path}: expected f as {first} has it within {allowed_percent:.1} %, which is what both state as common uncertainty, found it \
         to need a scale of {scale:.4} ± {uncertainty:.4}; is it the same sample, and the same standard? --any-scale brings it to the \
         first one's"
    )]
    Scale {
        /// The file.
        path: String,
        /// The first file.
        first: String,
        /// What its f would have to be multiplied with.
        scale: f64,
        /// Its standard uncertainty (k = 1).
        uncertainty: f64,
        /// By how much it may differ from 1.
        allowed_percent: f64,
    },
    /// Captures without common directions.
    #[error(
        "{path}: expected at least {expected} samples that {first} has too, found {found}; capture the sample at tilts \
         between the two, or fill each by itself"
    )]
    NoOverlap {
        /// The file.
        path: String,
        /// The first file.
        first: String,
        /// How many it takes.
        expected: usize,
        /// How many there are.
        found: usize,
    },
}

impl Blame for FillError {
    fn is_input(&self) -> bool {
        match self {
            Self::Brdf(error) => error.is_input(),
            Self::Store(error) => error.is_input(),
            Self::Fit(error) => error.is_input(),
            Self::Differs { .. } | Self::Scale { .. } | Self::NoOverlap { .. } | Self::Nothing { .. } => true,
        }
    }
}

/// What of the ways to fill is left out, and what else is asked for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Ways that are not taken.
    pub without: Vec<Way>,
    /// Whether further captures may be brighter or darker than the first by more than what they state.
    pub is_any_scale: bool,
}

/// A way to fill what no capture has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// The exchanged pair of directions.
    Reciprocity,
    /// Across the wire, from both its sides.
    Wire,
    /// A fitted model.
    Model,
}

impl Options {
    fn takes(&self, way: Way) -> bool {
        !self.without.contains(&way)
    }
}

/// Share of direction pairs of one provenance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Share {
    /// The provenance.
    pub provenance: &'static str,
    /// Share of all pairs with θ ≤ 85° both ways, by solid angle.
    pub share: f64,
}

/// What was filled.
#[derive(Clone, Debug, Serialize)]
pub struct Filled {
    /// The result.
    pub out: PathBuf,
    /// Scale and turn of each further capture.
    pub alignments: Vec<Alignment>,
    /// The model, if one was needed and the samples have a lobe.
    pub model: Option<Fit>,
    /// Coverage, all kinds of provenance; empty if the file has no pair of directions with θ ≤ 85°.
    pub shares: Vec<Share>,
    /// What is to be known of it, in sentences.
    pub warnings: Vec<String>,
}

/// Fills the file at `first` with the help of `others` into `out`, which must not be one of them, as `options` say.
///
/// # Errors
/// [`FillError`]; the files that are read stay as they are.
pub fn fill(
    first: &Path,
    others: &[PathBuf],
    out: &Path,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Filled, FillError> {
    let base = Brdf::open(first)?;
    let further = others
        .iter()
        .map(|path| Brdf::open(path))
        .collect::<Result<Vec<_>, _>>()?;
    for one in &further {
        check_alike(&base, one)?;
    }
    for read in std::iter::once(first).chain(others.iter().map(PathBuf::as_path)) {
        if is_same_place(read, out) {
            return Err(FillError::Differs {
                path: out.display().to_string(),
                field: "output",
                expected: "another file than those that are read".to_owned(),
                found: "one of them".to_owned(),
            });
        }
    }
    // Hidden and of this process, so that it is nobody else's.
    let merged_path = out.with_file_name(format!(".merged-{}.zarr", std::process::id()));
    let origin = Origin {
        captures: evidence::captures_of(&std::iter::once(&base).chain(&further).collect::<Vec<_>>())?,
        lineage: like::lineage_of(
            "fill",
            &std::iter::once(&base).chain(&further).collect::<Vec<_>>(),
        )?,
    };
    let (merged, alignments) = if further.is_empty() {
        (base, Vec::new())
    } else {
        let alignments = merge::merge(&base, &further, &merged_path, options.is_any_scale, progress)?;
        (Brdf::open(&merged_path)?, alignments)
    };
    let filled = gaps::fill(&merged, &origin, out, options, progress);
    drop(merged);
    if !alignments.is_empty() {
        // A leftover costs space and harms nothing.
        std::fs::remove_dir_all(&merged_path).ok();
    }
    let model = filled?;
    let shares = shares(&Brdf::open(out)?)?;
    let mut warnings = model
        .as_ref()
        .map_or_else(Vec::new, |model| model.warnings.clone());
    let missing = shares
        .iter()
        .find(|share| share.provenance == Provenance::Missing.name());
    if let Some(missing) = missing.filter(|missing| missing.share > WORTH_SAYING && options.takes(Way::Model))
    {
        warnings.push(format!(
            "coverage: {:.1} % of the pairs of directions stay without a value, because nothing was measured with half vectors and \
             difference angles near theirs, where a lobe may be; measure at further --tilt",
            100.0 * missing.share
        ));
    }
    if shares.is_empty() {
        warnings.push(format!(
            "coverage: none, the file has no pair of directions with θ ≤ {COVERED_THETA_DEG}° both ways"
        ));
    }
    Ok(Filled {
        out: out.to_owned(),
        shares,
        alignments,
        model,
        warnings,
    })
}

/// What a filled file is made of.
struct Origin {
    /// The captures.
    captures: Vec<String>,
    /// Its lineage.
    lineage: Value,
}

/// Directions of the cells of `brdf`; `None` below the horizon.
fn directions(brdf: &Brdf) -> Vec<Option<DVec3>> {
    let of_cell = |cell| brdf.disk().direction(cell).filter(|w| is_above_horizon(*w));
    (0..brdf.disk().len()).map(of_cell).collect()
}

fn check_alike(base: &Brdf, other: &Brdf) -> Result<(), FillError> {
    let fields = [
        (
            "channels",
            base.channels().to_string(),
            other.channels().to_string(),
        ),
        (
            "outgoing grid",
            base.disk().size().to_string(),
            other.disk().size().to_string(),
        ),
        (
            "azimuth_deg",
            base.azimuth().deg.to_string(),
            other.azimuth().deg.to_string(),
        ),
    ];
    match fields.into_iter().find(|(_, expected, found)| expected != found) {
        None => Ok(base.check_same_bands(other)?),
        Some((field, expected, found)) => Err(FillError::Differs {
            path: other.path().display().to_string(),
            field,
            expected: format!("{expected} as in {}", base.path().display()),
            found,
        }),
    }
}

/// A writer of a file like `brdf`, of the incident directions `grid`, whose directions have these reasons.
fn writer_like(
    brdf: &Brdf,
    grid: &IncidentSet,
    path: &Path,
    incident: &[Option<Unmeasurable>],
    outgoing: &[Option<Unmeasurable>],
    facts: Map<String, Value>,
) -> Result<BrdfWriter, StoreError> {
    let disk = brdf.disk();
    // Filled cells resolve what the others do; where no cell resolves anything, neither do they.
    let seen: Vec<f64> = (0..disk.len())
        .map(|cell| brdf.pixel_sr(cell))
        .filter(|sr| !sr.is_nan())
        .collect();
    let usual = if seen.is_empty() {
        f64::NAN
    } else {
        seen.iter().sum::<f64>() / seen.len() as f64
    };
    let pixel_sr: Vec<f64> = (0..disk.len())
        .map(|cell| match (brdf.pixel_sr(cell), outgoing[cell]) {
            (sr, None) if sr.is_nan() => usual,
            (sr, _) => sr,
        })
        .collect();
    let mut all = Map::new();
    if matches!(grid, IncidentSet::List(_)) {
        all = list_attributes();
        all.insert("step_deg".to_owned(), Value::Null);
    }
    all.extend(facts);
    let own = Own {
        grid,
        incident,
        outgoing,
        pixel_sr: &pixel_sr,
        facts: all,
    };
    like::writer_like(brdf, own, path)
}

/// Share of the pairs of directions of each provenance, up to [`COVERED_THETA_DEG`]; nothing if there is no such pair.
///
/// # Errors
/// [`StoreError`].
pub fn shares(brdf: &Brdf) -> Result<Vec<Share>, StoreError> {
    let least = COVERED_THETA_DEG.to_radians().cos();
    let cells: Vec<usize> = (0..brdf.disk().len())
        .filter(|&cell| brdf.disk().direction(cell).is_some_and(|w| w.z >= least))
        .collect();
    let (weights, gaps) = solid_angles(brdf, least);
    let mut sums = [0.0; Provenance::ALL.len()];
    for chunk in 0..brdf.chunks() {
        let rows = brdf.chunk(chunk)?;
        for (place, index) in brdf.chunk_range(chunk).enumerate() {
            let wi = brdf.grid().direction(index);
            if wi.z < least {
                continue;
            }
            let weight = weights[index];
            for &cell in &cells {
                let code = rows
                    .as_ref()
                    .filter(|_| brdf.incident_reason(index).is_none())
                    .map_or(0, |rows| rows.provenance[place * brdf.disk().len() + cell]);
                sums[usize::from(code)] += weight;
            }
        }
    }
    sums[usize::from(Provenance::Missing.code())] += gaps * cells.len() as f64;
    let total: f64 = sums.iter().sum();
    if total <= 0.0 {
        return Ok(Vec::new());
    }
    Ok(Provenance::ALL
        .into_iter()
        .zip(sums)
        .map(|(provenance, sum)| Share {
            provenance: provenance.name(),
            share: sum / total,
        })
        .collect())
}

/// Relative solid angle that each incident direction of `brdf` stands for, and that of the gaps in which none does, down to
/// the cosine `least`.
fn solid_angles(brdf: &Brdf, least: f64) -> (Vec<f64>, f64) {
    let grid = brdf.grid();
    let is_ring_grid = brdf.attributes().get("incident_kind").and_then(Value::as_str) == Some("theta-phi");
    if matches!(grid, IncidentSet::Rings(_)) {
        // Rings of a θ × φ grid stand for solid angles that go with sin θ; the others are spread evenly.
        let sine = |index: usize| (1.0 - grid.direction(index).z.powi(2)).sqrt();
        let weight = |index: usize| if is_ring_grid { sine(index) } else { 1.0 };
        return ((0..grid.len()).map(weight).collect(), 0.0);
    }
    // Evenly spread directions on a spiral stand for the nearest of the list.
    let (mut weights, mut gaps) = (vec![0.0; grid.len()], 0.0);
    for at in 0..SPIRAL {
        let z = 1.0 - (f64::from(at) + 0.5) / f64::from(SPIRAL) * (1.0 - least);
        let w = from_angles(z.acos(), GOLDEN_RAD * f64::from(at));
        let nearest = grid.neighbours(w).into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        match nearest {
            Some((index, _)) if grid.is_spanned(w) => weights[index] += 1.0,
            _ => gaps += 1.0,
        }
    }
    (weights, gaps)
}

/// What the attributes of a file say of how it was filled, and from which captures.
fn facts(text: &str, others: &[String], origin: Option<&Origin>) -> Map<String, Value> {
    let mut facts = Map::new();
    facts.insert("filled".to_owned(), json!(text));
    if let Some(origin) = origin {
        if !origin.captures.is_empty() {
            facts.insert(evidence::CAPTURES.to_owned(), json!(origin.captures));
        }
        facts.insert(LINEAGE.to_owned(), origin.lineage.clone());
    }
    if !others.is_empty() {
        facts.insert("merged_with".to_owned(), json!(others));
    }
    facts
}
