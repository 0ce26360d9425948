//! A measured BRDF as the sample that others are compared with.

use glam::{DVec3, Vec3};

use super::images::Images;
use super::{Brdf, BrdfError, evidence};
use crate::brdf::interpolation::{Cells, ENOUGH, Readable as _};
use crate::brdf::sample::{Outgoing, Sample};
use crate::hemisphere::direction::is_above_horizon;
use crate::hemisphere::incident::{IncidentSet, Neighbours};

/// All values of a file in memory, interpolated in all four angles; NaN where the file has none.
#[derive(Debug)]
pub struct KnownBrdf {
    set: IncidentSet,
    cells: Cells,
    images: Images,
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
        Ok(Self {
            set: brdf.grid.clone(),
            cells: brdf.cells.clone(),
            images: Images::read(brdf)?,
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
        let (mut sum, mut found) = (Vec3::ZERO, 0.0);
        for &(row, weight) in neighbours {
            if weight <= 0.0 {
                continue;
            }
            let read = self.known.images.of(row).read(&self.known.cells, wo);
            sum += weight as f32 * read.value;
            found += weight as f32 * read.weight;
        }
        // As in any look-up: without half of the weight there is no value.
        if found >= ENOUGH {
            (sum / found).to_array().map(f64::from)
        } else {
            [f64::NAN; 3]
        }
    }
}
