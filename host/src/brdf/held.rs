//! A measured BRDF that is held in memory, for look-ups by the million.
//!
//! # Design
//! Pairs of directions are answered one by one, by the rules of [`crate::brdf::interpolation`]. Reading up to eight images at up to four
//! places each takes a microsecond or more, most of it waiting for memory; direct interpolation reads four images at one place, and is
//! for those who need millions of values a second from a fine grid.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::images::Images;
use super::{Brdf, BrdfError};
use crate::brdf::interpolation::{Blend, Interpolation, Lookup};
use crate::brdf::reflectance::{Missing, Reflectance, Value};
use crate::store::StoreError;

/// All values of a `brdf.zarr`. It answers as [`Brdf`] does; nothing is read any more.
#[derive(Debug)]
pub struct HeldBrdf {
    brdf: Brdf,
    images: Images,
    /// Incident directions of the images.
    directions: Vec<DVec3>,
    interpolation: Interpolation,
    blend: Blend,
}

/// What was found: f × weight, weight, and the weight of what saturated.
type Found = (Vec3, f32, f32);

impl HeldBrdf {
    /// Reads all of `brdf`, 4 bytes for each value, to be looked up by `interpolation`.
    ///
    /// # Errors
    /// [`BrdfError`] if it cannot be read or does not fit into memory.
    pub fn read(brdf: Brdf, interpolation: Interpolation) -> Result<Self, BrdfError> {
        Ok(Self {
            images: Images::read(&brdf)?,
            directions: (0..brdf.grid.len()).map(|row| brdf.grid.direction(row)).collect(),
            blend: Blend::new(interpolation, brdf.errors.as_ref()),
            interpolation,
            brdf,
        })
    }

    /// The file.
    #[must_use]
    pub const fn brdf(&self) -> &Brdf {
        &self.brdf
    }

    /// f in sr⁻¹ for the pair of unit vectors (`wi`, `wo`), both away from the surface, or why there is none.
    ///
    /// # Errors
    /// [`Missing`].
    pub fn value(&self, wi: DVec3, wo: DVec3) -> Value {
        if let Some(missing) = Missing::at_horizon(wi, wo) {
            return Err(missing);
        }
        let (value, saturated) = if self.interpolation == Interpolation::Direct {
            let (sum, weight, saturated) = self.direct(wi, wo);
            ((weight >= 0.5).then(|| (sum / weight).to_array()), saturated)
        } else {
            let image = |row: usize| self.is_captured(row).then(|| self.images.of(row));
            let set = (&self.brdf.grid, &self.directions[..]);
            let found = Lookup::of(set, &self.brdf.cells, &self.blend, (wi, wo), &image);
            (found.value(), found.saturated)
        };
        value.ok_or_else(|| self.brdf.missing(wi, wo, f64::from(saturated)))
    }

    /// Direct interpolation: all four images are read at one place.
    fn direct(&self, wi: DVec3, wo: DVec3) -> Found {
        let mut found = (Vec3::ZERO, 0.0, 0.0);
        let Some(place) = self.brdf.cells.place(wo) else {
            return found;
        };
        for (row, weight) in self.brdf.grid.neighbours(wi) {
            if weight > 0.0 && self.is_captured(row) {
                let (read, weight) = (place.read(self.images.of(row)), weight as f32);
                found.0 += weight * read.value;
                found.1 += weight * read.weight;
                found.2 += weight * read.saturated;
            }
        }
        found
    }

    fn is_captured(&self, row: usize) -> bool {
        self.brdf.incident[row].is_none()
    }
}

impl Reflectance for HeldBrdf {
    fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
        Ok(pairs.par_iter().map(|&(wi, wo)| self.value(wi, wo)).collect())
    }
}
