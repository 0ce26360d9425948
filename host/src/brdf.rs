//! A measured BRDF: look-up with interpolation, from files larger than memory.
//!
//! # Design
//! Incident directions are interpolated on their grid, outgoing ones on the disk, both linearly. Samples
//! without a value take no part; if they would carry half of the weight or more, the answer is the reason
//! why, never a guess. Queries come in batches and are answered chunk by chunk in the order of the file, so
//! memory holds one chunk however large the table is.

use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::disk::Disk;
use crate::incident::{Grid, IncidentError, IncidentSet};
use crate::optics::Unmeasurable;
use crate::provenance::Provenance;
use crate::store::{BrdfReader, BrdfRows, StoreError};

/// Why there is no value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Missing {
    /// The instrument does not reach the incident direction.
    Incident(Unmeasurable),
    /// The instrument does not reach the outgoing direction.
    Outgoing(Unmeasurable),
    /// The camera saturated there.
    Saturated,
}

impl std::fmt::Display for Missing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Incident(reason) | Self::Outgoing(reason) => reason.fmt(f),
            Self::Saturated => f.write_str("saturated"),
        }
    }
}

/// f in sr⁻¹ per channel (a single channel is repeated), or why not.
pub type Value = Result<[f32; 3], Missing>;

/// Why a BRDF cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum BrdfError {
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Its coordinates make no sense.
    #[error("{path}: {field}: expected {expected}, found {found}")]
    Content {
        /// The file.
        path: String,
        /// Array or attribute.
        field: &'static str,
        /// What was expected.
        expected: String,
        /// What is there.
        found: String,
    },
}

/// A `brdf.zarr`.
#[derive(Debug)]
pub struct Brdf {
    path: PathBuf,
    reader: BrdfReader,
    grid: IncidentSet,
    disk: Disk,
    incident: Vec<Option<Unmeasurable>>,
    outgoing: Vec<Option<Unmeasurable>>,
    pixel_sr: Vec<f64>,
}

/// A part of the answer to a query: one row of the table with its weight.
struct Term {
    row: usize,
    query: usize,
    weight: f64,
}

/// What has been gathered for a query.
#[derive(Clone, Copy, Default)]
struct Sum {
    value: [f64; 3],
    weight: f64,
    saturated: f64,
}

impl Brdf {
    /// Opens the BRDF at `path`.
    ///
    /// # Errors
    /// [`BrdfError`] with path, field, expected and found.
    pub fn open(path: &Path) -> Result<Self, BrdfError> {
        let reader = BrdfReader::open(path)?;
        let content = |field, expected: String, found: String| BrdfError::Content {
            path: path.display().to_string(),
            field,
            expected,
            found,
        };
        let grid = incident_set(&reader, &content)?;
        let layout = *reader.layout();
        if grid.len() != layout.incident {
            let expected = format!("{} directions from step_deg", grid.len());
            return Err(content("incident", expected, layout.incident.to_string()));
        }
        if !matches!(layout.channels, 1 | 3) {
            return Err(content(
                "channel",
                "1 or 3 channels".to_owned(),
                layout.channels.to_string(),
            ));
        }
        let disk = Disk::new(layout.grid);
        let reasons = |field, length: usize| -> Result<Vec<Option<Unmeasurable>>, BrdfError> {
            let data = reader.small(field)?;
            let codes = data.as_u8().unwrap_or_default();
            if codes.len() != length {
                return Err(content(
                    field,
                    format!("{length} codes of type uint8"),
                    format!("{}", codes.len()),
                ));
            }
            codes
                .iter()
                .map(|&code| match (code, Unmeasurable::from_code(code)) {
                    (0, _) => Ok(None),
                    (_, Some(reason)) => Ok(Some(reason)),
                    (code, None) => Err(content(field, "a known code".to_owned(), code.to_string())),
                })
                .collect()
        };
        let incident = reasons("incident_reason", grid.len())?;
        let outgoing = reasons("outgoing_reason", disk.len())?;
        let pixel_sr = match reader.small("outgoing_pixel")?.as_f64() {
            Some(pixels) if pixels.len() == disk.len() => pixels.to_vec(),
            _ => {
                let expected = format!("{} solid angles of type float64", disk.len());
                return Err(content("outgoing_pixel", expected, "something else".to_owned()));
            }
        };
        Ok(Self {
            path: path.to_owned(),
            reader,
            grid,
            disk,
            incident,
            outgoing,
            pixel_sr,
        })
    }

    /// Where it was opened.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The incident directions.
    #[must_use]
    pub const fn grid(&self) -> &IncidentSet {
        &self.grid
    }

    /// The outgoing directions.
    #[must_use]
    pub const fn disk(&self) -> Disk {
        self.disk
    }

    /// Colour channels, 1 or 3.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.reader.layout().channels
    }

    /// Attributes of the file.
    #[must_use]
    pub fn attributes(&self) -> &serde_json::Map<String, serde_json::Value> {
        self.reader.attributes()
    }

    /// Why incident direction `index` of the grid has no data; `None` if it has.
    #[must_use]
    pub fn incident_reason(&self, index: usize) -> Option<Unmeasurable> {
        self.incident[index]
    }

    /// Why cell `index` of the disk has no data; `None` if it has.
    #[must_use]
    pub fn outgoing_reason(&self, index: usize) -> Option<Unmeasurable> {
        self.outgoing[index]
    }

    /// Solid angle in sr of the camera pixel that sees cell `index`; 0 if none does.
    #[must_use]
    pub fn pixel_sr(&self, index: usize) -> f64 {
        self.pixel_sr[index]
    }

    /// Number of chunks of whole incident directions.
    #[must_use]
    pub fn chunks(&self) -> usize {
        self.reader.chunks()
    }

    /// The incident directions of a chunk.
    #[must_use]
    pub fn chunk_range(&self, chunk: usize) -> std::ops::Range<usize> {
        self.reader.chunk_range(chunk)
    }

    /// The rows of a chunk, or `None` if nothing of it was measured.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn chunk(&self, chunk: usize) -> Result<Option<BrdfRows>, StoreError> {
        if self.reader.chunk_is_present(chunk) {
            self.reader.read_chunk(chunk).map(Some)
        } else {
            Ok(None)
        }
    }

    /// f for pairs of unit vectors (incident, outgoing), both away from the surface, in the order asked.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
        let mut terms: Vec<Term> = Vec::with_capacity(4 * pairs.len());
        for (query, &(wi, wo)) in pairs.iter().enumerate() {
            if wi.z <= 0.0 || wo.z <= 0.0 {
                continue;
            }
            for (row, weight) in self.grid.neighbours(wi) {
                if weight > 0.0 && self.incident[row].is_none() {
                    terms.push(Term { row, query, weight });
                }
            }
        }
        terms.sort_unstable_by_key(|term| (term.row, term.query));

        let channels = self.channels();
        let row_length = self.disk.len() * channels;
        let mut sums = vec![Sum::default(); pairs.len()];
        let mut rest = terms.as_slice();
        while let Some(first) = rest.first() {
            let chunk = first.row / self.reader.layout().chunk;
            let range = self.chunk_range(chunk);
            let (mine, others) = rest.split_at(rest.partition_point(|term| term.row < range.end));
            rest = others;
            let Some(rows) = self.chunk(chunk)? else { continue };
            for term in mine {
                let row = term.row - range.start;
                let f = &rows.f[row * row_length..][..row_length];
                let provenance = &rows.provenance[row * self.disk.len()..][..self.disk.len()];
                let Some(cells) = self.disk.neighbours(pairs[term.query].1) else {
                    continue;
                };
                let sum = &mut sums[term.query];
                for (cell, weight) in cells {
                    let weight = weight * term.weight;
                    if self.outgoing[cell].is_some() {
                        continue;
                    }
                    if provenance[cell] == Provenance::Missing.code() {
                        sum.saturated += weight;
                        continue;
                    }
                    sum.weight += weight;
                    for (channel, value) in sum.value.iter_mut().enumerate() {
                        *value += weight * f64::from(f[cell * channels + channel % channels]);
                    }
                }
            }
        }
        Ok(pairs
            .iter()
            .zip(&sums)
            .map(|(&(wi, wo), sum)| self.conclude(wi, wo, sum))
            .collect())
    }

    fn conclude(&self, wi: DVec3, wo: DVec3, sum: &Sum) -> Value {
        if sum.weight >= 0.5 {
            return Ok(sum.value.map(|value| (value / sum.weight) as f32));
        }
        if wi.z <= 0.0 {
            return Err(Missing::Incident(Unmeasurable::BelowHorizon));
        }
        // The heaviest neighbour that has a reason.
        let incident = heaviest(&self.grid.neighbours(wi), &self.incident);
        let outgoing = match self.disk.neighbours(wo) {
            Some(cells) if wo.z > 0.0 => heaviest(&cells, &self.outgoing),
            _ => Some((1.0, Unmeasurable::BelowHorizon)),
        };
        Err(match (incident, outgoing) {
            (Some((a, reason)), Some((b, _))) if a >= b => Missing::Incident(reason),
            (_, Some((weight, reason))) if weight > sum.saturated => Missing::Outgoing(reason),
            (Some((weight, reason)), _) if weight > sum.saturated => Missing::Incident(reason),
            _ => Missing::Saturated,
        })
    }
}

/// The incident directions of a file; `content` makes the complaint from field, expected and found.
fn incident_set(
    reader: &BrdfReader,
    content: &dyn Fn(&'static str, String, String) -> BrdfError,
) -> Result<IncidentSet, BrdfError> {
    let attribute = |name| reader.attributes().get(name).cloned().unwrap_or_default();
    let kind = attribute("incident_kind");
    let grid = match kind.as_str() {
        Some("list") => {
            let angles = |field| {
                reader.small(field)?.as_f64().map(<[f64]>::to_vec).ok_or_else(|| {
                    let found = "another type".to_owned();
                    content(field, "degrees of type float64".to_owned(), found)
                })
            };
            let (theta, phi): (Vec<f64>, Vec<f64>) = (angles("incident_theta")?, angles("incident_phi")?);
            Grid::List {
                directions_deg: theta.into_iter().zip(phi).map(<[f64; 2]>::from).collect(),
            }
        }
        // Files of before there was another kind do not say.
        None | Some("theta-phi" | "equal-solid-angle") => {
            let step = attribute("step_deg");
            let expected = || "degrees that divide 90".to_owned();
            let step_deg = step
                .as_f64()
                .ok_or_else(|| content("step_deg", expected(), step.to_string()))?;
            if kind == "equal-solid-angle" {
                Grid::EqualSolidAngle { step_deg }
            } else {
                Grid::ThetaPhi { step_deg }
            }
        }
        Some(_) => {
            let expected = "theta-phi, equal-solid-angle or list".to_owned();
            return Err(content("incident_kind", expected, kind.to_string()));
        }
    };
    grid.build().map_err(|error| match error {
        IncidentError::Step { step_deg } => {
            let found = step_deg.to_string();
            content("step_deg", "degrees that divide 90".to_owned(), found)
        }
        IncidentError::List { expected, found } => {
            content("incident_theta, incident_phi", expected.to_owned(), found)
        }
        IncidentError::File { expected, found, .. } => content("incident", expected, found),
    })
}

fn heaviest(neighbours: &[(usize, f64)], reasons: &[Option<Unmeasurable>]) -> Option<(f64, Unmeasurable)> {
    neighbours
        .iter()
        .filter_map(|&(index, weight)| reasons[index].map(|reason| (weight, reason)))
        .max_by(|a, b| a.0.total_cmp(&b.0))
}
