//! A measured BRDF as the sample that others are compared with.

use glam::{DVec3, Vec3};

use super::{Brdf, BrdfError, evidence};
use crate::brdf::interpolation::{Cells, Image};
use crate::brdf::sample::{Outgoing, Sample};
use crate::hemisphere::direction::is_above_horizon;
use crate::hemisphere::incident::{IncidentSet, Neighbours};

/// Memory that a file may take as a whole, in bytes.
const MOST_BYTES: usize = 8_000_000_000;

/// All values of a file in memory, interpolated in all four angles; NaN where the file has none.
#[derive(Debug)]
pub struct KnownBrdf {
    set: IncidentSet,
    cells: Cells,
    channels: usize,
    /// f in sr⁻¹, [incident, cell, channel].
    f: Vec<f32>,
    /// Codes of provenance, [incident, cell].
    provenance: Vec<u8>,
}

impl KnownBrdf {
    /// Reads `brdf` as what `judged` is compared with: another capture of the sample.
    ///
    /// # Errors
    /// [`BrdfError`] if both hold the same capture, or as [`read`](Self::read).
    pub fn beside(brdf: &Brdf, judged: &Brdf) -> Result<Self, BrdfError> {
        evidence::check_apart(judged, brdf)?;
        Self::read(brdf)
    }

    /// Reads `brdf`.
    ///
    /// # Errors
    /// [`BrdfError`] if it cannot be read or does not fit into memory.
    pub fn read(brdf: &Brdf) -> Result<Self, BrdfError> {
        let (cells, channels) = (brdf.disk.len(), brdf.channels());
        let samples = brdf.grid.len() * cells;
        let bytes = samples * (4 * channels + 1);
        if bytes > MOST_BYTES {
            return Err(BrdfError::Content {
                path: brdf.path.display().to_string(),
                field: "f",
                expected: format!("at most {:.0} GB for a reference", MOST_BYTES as f64 * 1e-9),
                found: format!("{:.0} GB", bytes as f64 * 1e-9),
            });
        }
        let mut f = vec![f32::NAN; samples * channels];
        let mut provenance = vec![0; samples];
        for chunk in 0..brdf.chunks() {
            if let Some(rows) = brdf.chunk(chunk)? {
                let first = brdf.chunk_range(chunk).start * cells;
                provenance[first..][..rows.provenance.len()].copy_from_slice(&rows.provenance);
                f[first * channels..][..rows.f.len()].copy_from_slice(&rows.f);
            }
        }
        Ok(Self {
            set: brdf.grid.clone(),
            cells: brdf.cells.clone(),
            channels,
            f,
            provenance,
        })
    }
}

impl Sample for KnownBrdf {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        Box::new(Lit {
            known: self,
            neighbours: is_above_horizon(wi).then(|| self.set.neighbours(wi)),
        })
    }

    fn is_isotropic(&self) -> bool {
        false
    }
}

/// The values around one incident direction.
struct Lit<'a> {
    known: &'a KnownBrdf,
    neighbours: Option<Neighbours>,
}

impl Outgoing for Lit<'_> {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        let Some(neighbours) = self.neighbours.as_ref().filter(|_| is_above_horizon(wo)) else {
            return [0.0; 3];
        };
        let cells = self.known.cells.disk.len();
        let (mut sum, mut found) = (Vec3::ZERO, 0.0);
        for &(row, weight) in neighbours {
            if weight <= 0.0 {
                continue;
            }
            let image = Image {
                f: &self.known.f[row * cells * self.known.channels..][..cells * self.known.channels],
                provenance: Some(&self.known.provenance[row * cells..][..cells]),
                channels: self.known.channels,
            };
            let read = self.known.cells.read(image, wo);
            sum += weight as f32 * read.value;
            found += weight as f32 * read.weight;
        }
        // As in any look-up: without half of the weight there is no value.
        if found >= 0.5 {
            (sum / found).to_array().map(f64::from)
        } else {
            [f64::NAN; 3]
        }
    }
}
