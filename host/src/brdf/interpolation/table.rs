//! Captures in memory.

use glam::DVec3;
use rayon::prelude::*;

use super::captures::{Captures, Cells, Image, ImageOf};
use super::lookup::look_up;
use super::{Blend, BranchErrors, Interpolation, learn};
use crate::brdf::reflectance::Reflectance;
use crate::brdf::reflectance::{Missing, Value};
use crate::brdf::sample::Sample;
use crate::hemisphere::disk::Disk;
use crate::hemisphere::incident::IncidentSet;
use crate::instrument::optics::Unmeasurable;
use crate::store::StoreError;

/// What an ideal instrument captures of a known sample: f at the centre of every cell, for every incident direction.
#[derive(Debug)]
pub struct Table {
    set: IncidentSet,
    pub(super) cells: Cells,
    /// f in sr⁻¹, [incident, cell, channel]; NaN beyond the horizon.
    pub(super) f: Vec<f32>,
    pub(super) blend: Blend,
}

const CHANNELS: usize = 3;

impl Table {
    /// Captures `sample` from the directions of `set`, each image resolved as `disk`, to be looked up by direct
    /// interpolation. Takes 12 bytes per incident direction and cell.
    #[must_use]
    pub fn of(sample: &dyn Sample, set: IncidentSet, disk: Disk) -> Self {
        let cells: Vec<Option<DVec3>> = (0..disk.len()).map(|cell| disk.direction(cell)).collect();
        let mut f = vec![f32::NAN; set.len() * disk.len() * CHANNELS];
        f.par_chunks_exact_mut(disk.len() * CHANNELS)
            .enumerate()
            .for_each(|(row, image)| {
                let lit = sample.incident(set.direction(row));
                for (out, wo) in image.chunks_exact_mut(CHANNELS).zip(&cells) {
                    if let Some(wo) = wo {
                        out.copy_from_slice(&lit.f(*wo).map(|f| f as f32));
                    }
                }
            });
        Self {
            set,
            cells: Cells::new(disk, |_| true),
            f,
            blend: Blend::new(Interpolation::Direct, None),
        }
    }

    /// What leaving images out says of the rules; `None` if there are too few.
    #[must_use]
    pub fn learn(&self) -> Option<BranchErrors> {
        learn(self).expect("invariant: memory can be read")
    }

    /// Looks up by `interpolation` from now on.
    #[must_use]
    pub fn with(mut self, interpolation: Interpolation) -> Self {
        let errors = (interpolation == Interpolation::Blended).then(|| self.learn());
        self.blend = Blend::new(interpolation, errors.flatten().as_ref());
        self
    }
}

impl Captures for Table {
    fn set(&self) -> &IncidentSet {
        &self.set
    }

    fn cells(&self) -> &Cells {
        &self.cells
    }

    fn is_captured(&self, _row: usize) -> bool {
        true
    }

    fn scan(
        &self,
        _wanted: &[bool],
        each: &mut dyn FnMut(std::ops::Range<usize>, ImageOf<'_>),
    ) -> Result<(), StoreError> {
        let length = self.cells.disk.len() * CHANNELS;
        let image = |row: usize| {
            Some(Image {
                f: &self.f[row * length..][..length],
                provenance: None,
                channels: CHANNELS,
            })
        };
        each(0..self.set.len(), &image);
        Ok(())
    }
}

impl Reflectance for Table {
    fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
        let above = |&&(wi, wo): &&(DVec3, DVec3)| Missing::at_horizon(wi, wo).is_none();
        let asked: Vec<_> = pairs.iter().filter(above).copied().collect();
        let mut found = look_up(self, &self.blend, &asked)?.into_iter();
        Ok(pairs
            .iter()
            .map(|(wi, wo)| {
                if let Some(missing) = Missing::at_horizon(*wi, *wo) {
                    return Err(missing);
                }
                let found = found.next().expect("invariant: one per pair above the horizon");
                found.value().ok_or(Missing::Outgoing(Unmeasurable::OutsideImage))
            })
            .collect())
    }
}
