//! Filling: directions that one capture does not reach, from others, from reciprocity, from neighbours, from a model.
//!
//! # Design
//! | step | file | provenance |
//! |---|---|---|
//! | merge of captures with the sample tilted otherwise | `merge` | merged |
//! | the exchanged pair of directions (Helmholtz reciprocity) | `gaps` | reciprocal |
//! | what the wire hides, from both sides of it | `gaps` | interpolated |
//! | a fitted GGX with a Lambert base | `gaps` | modelled |
//!
//! Each step takes what those before have left. Merging comes first, because what was measured is better than what follows
//! from a law. Where camera and projector share one hole, as in RCG-1, the exchange of directions cannot fill it: it brings
//! back what saturated, what one device sees and the other does not, and what only the grid leaves out.
//!
//! Assembled files are in the sample's frame whatever the tilt was, so a pair of directions is the same pair in each. What
//! the tilts were not quite, and how the light has changed in between, is found in the overlap (`merge`).
//!
//! Everything streams chunk by chunk through files; memory does not grow with them. The result is a `brdf.zarr` like any
//! other, in which directions that were filled count as reached.

mod gaps;
mod merge;

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Map, Value, json};

pub use merge::Alignment;

use crate::assemble::{coordinates, interpolation_errors};
use crate::brdf::{Brdf, BrdfError, evidence};
use crate::fit::{Fit, FitError};
use crate::optics::Unmeasurable;
use crate::progress::Progress;
use crate::provenance::Provenance;
use crate::store::{BrdfLayout, BrdfWriter, StoreError};

/// Coverage counts pairs of directions up to this polar angle, degrees.
pub const COVERED_THETA_DEG: f64 = 85.0;

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

/// Fills the file at `first` with the help of `others` into `out`, which must not be one of them.
///
/// # Errors
/// [`FillError`]; the files that are read stay as they are.
pub fn fill(
    first: &Path,
    others: &[PathBuf],
    out: &Path,
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
        let is_same = match (read.canonicalize(), out.canonicalize()) {
            (Ok(read), Ok(out)) => read == out,
            _ => read == out,
        };
        if is_same {
            return Err(FillError::Differs {
                path: out.display().to_string(),
                field: "output",
                expected: "another file than those that are read".to_owned(),
                found: "one of them".to_owned(),
            });
        }
    }
    let captures = captures(&base, &further)?;
    let merged_path = out.with_extension("merged.zarr");
    let (merged, alignments) = if further.is_empty() {
        (base, Vec::new())
    } else {
        let alignments = merge::merge(&base, &further, &merged_path, progress)?;
        (Brdf::open(&merged_path)?, alignments)
    };
    let filled = gaps::fill(&merged, &captures, out, progress);
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

/// The captures behind all files, each of which may be there once: a second time it is no evidence.
fn captures(base: &Brdf, others: &[Brdf]) -> Result<Vec<String>, FillError> {
    let mut all = evidence::captures(base)?;
    let mut before = vec![base];
    for other in others {
        for one in &before {
            evidence::check_apart(one, other)?;
        }
        before.push(other);
        all.extend(evidence::captures(other)?);
    }
    Ok(all)
}

fn check_alike(base: &Brdf, other: &Brdf) -> Result<(), FillError> {
    let grid = |brdf: &Brdf| {
        let angles = (0..brdf.grid().len()).map(|index| brdf.grid().angles_deg(index));
        angles.fold(0.0, |sum, (theta, phi)| sum * 1.000_1 + theta + 1e-3 * phi)
    };
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
            "incident directions",
            base.grid().len().to_string(),
            other.grid().len().to_string(),
        ),
        ("incident grid", grid(base).to_string(), grid(other).to_string()),
    ];
    match fields.into_iter().find(|(_, expected, found)| expected != found) {
        None => Ok(()),
        Some((field, expected, found)) => Err(FillError::Differs {
            path: other.path().display().to_string(),
            field,
            expected: format!("{expected} as in {}", base.path().display()),
            found,
        }),
    }
}

/// A writer of a file like `brdf`, whose directions have these reasons.
fn writer_like(
    brdf: &Brdf,
    path: &Path,
    incident: &[Option<Unmeasurable>],
    outgoing: &[Option<Unmeasurable>],
    facts: Map<String, Value>,
) -> Result<BrdfWriter, StoreError> {
    let disk = brdf.disk();
    let layout = BrdfLayout {
        incident: brdf.grid().len(),
        grid: disk.size(),
        channels: brdf.channels(),
        chunk: brdf.chunk_range(0).len(),
    };
    // Filled cells resolve what the others do; where no cell resolves anything, neither do they.
    let seen: Vec<f64> = (0..disk.len())
        .map(|cell| brdf.pixel_sr(cell))
        .filter(|sr| *sr > 0.0)
        .collect();
    let usual = if seen.is_empty() {
        0.0
    } else {
        seen.iter().sum::<f64>() / seen.len() as f64
    };
    let pixel_sr: Vec<f64> = (0..disk.len())
        .map(|cell| match (brdf.pixel_sr(cell), outgoing[cell]) {
            (0.0, None) => usual,
            (sr, _) => sr,
        })
        .collect();
    let mut attributes = brdf.attributes().clone();
    attributes.retain(|name, _| !name.starts_with("rcg_"));
    attributes.extend(facts);
    BrdfWriter::create(
        path,
        layout,
        &coordinates(brdf.grid(), incident, disk, outgoing, &pixel_sr),
        attributes,
        true,
    )
}

/// Gives the file of `writer` its name, with the errors of interpolation that it has.
fn finish(writer: BrdfWriter) -> Result<(), FillError> {
    let errors = Brdf::open(writer.partial_path())?.learn()?;
    writer.rewrite(&interpolation_errors(errors.as_ref()))?;
    writer.finish()?;
    Ok(())
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
    // Rings of a θ × φ grid stand for solid angles that go with sin θ; other grids are spread evenly.
    let is_ring_grid = brdf.attributes().get("incident_kind").and_then(Value::as_str) == Some("theta-phi");
    let mut sums = [0.0; Provenance::ALL.len()];
    for chunk in 0..brdf.chunks() {
        let rows = brdf.chunk(chunk)?;
        for (place, index) in brdf.chunk_range(chunk).enumerate() {
            let wi = brdf.grid().direction(index);
            if wi.z < least {
                continue;
            }
            let weight = if is_ring_grid {
                (1.0 - wi.z * wi.z).sqrt()
            } else {
                1.0
            };
            for &cell in &cells {
                let code = rows
                    .as_ref()
                    .filter(|_| brdf.incident_reason(index).is_none())
                    .map_or(0, |rows| rows.provenance[place * brdf.disk().len() + cell]);
                sums[usize::from(code)] += weight;
            }
        }
    }
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

/// What the attributes of a file say of how it was filled, and from which captures.
fn facts(text: &str, others: &[String], captures: &[String]) -> Map<String, Value> {
    let mut facts = Map::new();
    facts.insert("filled".to_owned(), json!(text));
    if !captures.is_empty() {
        facts.insert(evidence::CAPTURES.to_owned(), json!(captures));
    }
    if !others.is_empty() {
        facts.insert("merged_with".to_owned(), json!(others));
    }
    facts
}
