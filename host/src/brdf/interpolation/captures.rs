//! Captured images, read between their cells.

use glam::{DVec2, DVec3, Vec3, Vec4};

use super::packed::Four;
use crate::hemisphere::disk::Disk;
use crate::hemisphere::incident::IncidentSet;
use crate::store::StoreError;
use crate::store::provenance::Provenance;

/// The cells of a disk as an image is read.
///
/// Cells count by their cosθo too, as if f·cosθo and cosθo were interpolated and divided: measured data and models with a
/// cosine in their denominator rise steeply towards the horizon, and the product does not; a constant f stays exact. The
/// cosine counts as at least 2/N, that of the outermost cells' centres.
#[derive(Clone, Debug)]
pub(crate) struct Cells {
    pub(crate) disk: Disk,
    kinds: Vec<Kind>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// Its centre lies below the horizon: there is nothing to miss.
    Beyond,
    /// It has no value in any image.
    Blind,
    /// It may have a value, and this is its cosθo.
    Seen(f32),
}

/// One image: f in sr⁻¹, [cell, channel], and where it has a value.
#[derive(Clone, Copy)]
pub(crate) struct Image<'a> {
    pub(crate) f: &'a [f32],
    /// Codes of [`Provenance`] per cell; `None` if what has no value is NaN.
    pub(crate) provenance: Option<&'a [u8]>,
    pub(crate) channels: usize,
}

/// Something of the outgoing directions of one incident one that can be read between its cells.
pub(crate) trait Readable: Copy {
    /// f in sr⁻¹ of a cell times the cosθo by which it counts, and that, with its code of [`Provenance`], 0 if nobody says; `None` if it is
    /// missing. The cell is one that has a value in some image.
    fn cell(&self, cells: &Cells, cell: usize) -> Option<(Vec4, u8)>;

    /// What is read at `wo`.
    fn read(&self, cells: &Cells, wo: DVec3) -> Read {
        cells
            .place(wo)
            .map_or_else(Read::default, |place| place.read(cells, *self))
    }

    /// Sum over `four` cells of what [`cell`](Self::cell) has of them by their weights; not a number if one is missing.
    fn corners(&self, cells: &Cells, four: &Four) -> Vec4;

    /// Whether cells have codes other than 0.
    const HAS_CODES: bool;
    /// Whether cells stand in blocks; else rows follow each other.
    const IS_BLOCKED: bool;

    /// The largest code of `four` cells.
    fn weakest(&self, _cells: &Cells, _four: &Four) -> u8 {
        0
    }
}

/// Where images are read: the cells around a direction, each with its weight, 0 of those that never have a value.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    cells: [(usize, f32); 4],
    /// One over the weight of what lies above the horizon.
    rest: f32,
}

/// What was read between cells.
#[derive(Clone, Copy, Default)]
pub(crate) struct Read {
    /// f in sr⁻¹ × weight.
    pub(crate) value: Vec3,
    /// Weight of the cells that have a value, 0 to 1.
    pub(crate) weight: f32,
    /// Weight of the cells that are missing from this image alone: they saturated.
    pub(crate) saturated: f32,
    /// Largest code of provenance of the cells that have a value; 0 where the image does not say.
    pub(crate) weakest: u8,
}

impl Cells {
    /// The cells of `disk`, of which those with `has_value` have values.
    pub(crate) fn new(disk: Disk, has_value: impl Fn(usize) -> bool) -> Self {
        let least = 2.0 / disk.size() as f32;
        let kind = |cell| match disk.direction(cell) {
            None => Kind::Beyond,
            Some(w) if has_value(cell) => Kind::Seen((w.z as f32).max(least)),
            Some(_) => Kind::Blind,
        };
        let kinds = (0..disk.len()).map(kind).collect();
        Self { disk, kinds }
    }

    /// cosθo by which a cell counts; `None` if it never has a value.
    pub(super) fn cosine(&self, cell: usize) -> Option<f32> {
        match self.kinds[cell] {
            Kind::Seen(cosine) => Some(cosine),
            Kind::Beyond | Kind::Blind => None,
        }
    }

    /// The cells around `wo`; at the horizon, where all four may lie beyond it, those one cell inwards.
    fn around(&self, wo: DVec3) -> Option<[(usize, f64); 4]> {
        let around = self.disk.neighbours(wo)?;
        if around
            .iter()
            .any(|&(cell, weight)| weight > 1e-6 && self.kinds[cell] != Kind::Beyond)
        {
            return Some(around);
        }
        let sin = 1.0 - (2.0 / self.disk.size() as f64).min(0.5);
        let inwards = wo.truncate().normalize_or_zero() * sin;
        self.disk.neighbours(inwards.extend((1.0 - sin * sin).sqrt()))
    }

    /// Where images are read for `wo`; nowhere below the horizon.
    pub(crate) fn place(&self, wo: DVec3) -> Option<Place> {
        let mut beyond = 0.0;
        let cells = self.around(wo)?.map(|(cell, weight)| {
            let weight = weight as f32;
            match self.kinds[cell] {
                Kind::Beyond => {
                    beyond += weight;
                    (cell, 0.0)
                }
                Kind::Seen(_) => (cell, weight),
                Kind::Blind => (cell, 0.0),
            }
        });
        let rest = 1.0 / (1.0 - beyond).max(1e-6);
        Some(Place { cells, rest })
    }

    /// What linear interpolation between the cells of `image` is off by at `wo`, in sr⁻¹: along each axis t·(1 − t)/2 of the second
    /// difference, t being the place between two cells.
    pub(crate) fn bend(&self, image: impl Readable, wo: DVec3) -> Vec3 {
        let here = image.read(self, wo);
        let Some(position) = self.disk.position(wo).filter(|_| here.weight > 0.0) else {
            return Vec3::ZERO;
        };
        let t = (position - 0.5).fract();
        let here = here.value / here.weight;
        let along = |axis: DVec2| {
            let sides = [axis, -axis].map(|step| {
                let read = image.read(self, self.disk.at(position + step)?);
                (read.weight > 0.5).then(|| read.value / read.weight)
            });
            // Without both the slope would count.
            match sides {
                [Some(one), Some(other)] => (0.5 * (one + other) - here).abs(),
                _ => Vec3::ZERO,
            }
        };
        let part = t * (1.0 - t);
        part.x as f32 * along(DVec2::X) + part.y as f32 * along(DVec2::Y)
    }
}

impl Place {
    /// Reads `image` there.
    pub(crate) fn read(&self, cells: &Cells, image: impl Readable) -> Read {
        let mut read = Read::default();
        let mut sum = Vec4::ZERO;
        for &(cell, weight) in &self.cells {
            if weight <= 0.0 {
                continue;
            }
            let Some((weighted, code)) = image.cell(cells, cell) else {
                read.saturated += weight;
                continue;
            };
            read.weakest = read.weakest.max(code);
            read.weight += weight;
            sum += weight * weighted;
        }
        if sum.w > 0.0 {
            read.value = sum.truncate() * (self.rest * read.weight / sum.w);
            read.weight *= self.rest;
            read.saturated *= self.rest;
        }
        read
    }
}

impl Readable for Image<'_> {
    #[inline]
    fn cell(&self, cells: &Cells, cell: usize) -> Option<(Vec4, u8)> {
        let cosine = cells.cosine(cell)?;
        let f = self.at(cell);
        let code = match self.provenance {
            Some(codes) if codes[cell] == Provenance::Missing.code() => return None,
            None if f.x.is_nan() => return None,
            Some(codes) => codes[cell],
            None => 0,
        };
        Some(((cosine * f).extend(cosine), code))
    }

    #[inline]
    fn corners(&self, cells: &Cells, four: &Four) -> Vec4 {
        let mut sum = Vec4::ZERO;
        let Some(around) = four.cells(cells) else {
            return Vec4::NAN;
        };
        for (cell, weight) in around.into_iter().zip(four.weights.to_array()) {
            let Some((weighted, _)) = self.cell(cells, cell) else {
                return Vec4::NAN;
            };
            sum += weight * weighted;
        }
        sum
    }

    const HAS_CODES: bool = true;
    const IS_BLOCKED: bool = false;

    fn weakest(&self, cells: &Cells, four: &Four) -> u8 {
        let (Some(codes), Some(cells)) = (self.provenance, four.cells(cells)) else {
            return 0;
        };
        cells.map(|cell| codes[cell]).into_iter().fold(0, u8::max)
    }
}

impl Image<'_> {
    /// f in sr⁻¹ of one cell; a single channel is repeated.
    pub(crate) fn at(&self, cell: usize) -> Vec3 {
        match *self.f {
            ref f if self.channels == 3 => Vec3::from_slice(&f[3 * cell..]),
            ref f => Vec3::splat(f[cell]),
        }
    }
}

/// Captured images, in memory or in a file.
pub(crate) trait Captures: Sync {
    /// Their incident directions.
    fn set(&self) -> &IncidentSet;
    /// Their cells.
    fn cells(&self) -> &Cells;
    /// Whether anything was captured for incident direction `row`.
    fn is_captured(&self, row: usize) -> bool;
    /// Hands out the images of the rows that are `wanted`, in groups of consecutive rows: `each` gets the rows of a
    /// group and the way to its images, which has `None` where nothing was captured.
    ///
    /// # Errors
    /// [`StoreError`].
    fn scan(
        &self,
        wanted: &[bool],
        each: &mut dyn FnMut(std::ops::Range<usize>, ImageOf<'_>),
    ) -> Result<(), StoreError>;
}

/// The way from a row to its image.
pub(crate) type ImageOf<'a> = &'a (dyn Fn(usize) -> Option<Image<'a>> + Sync);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;
    use proptest::prelude::*;

    const SIZE: usize = 8;

    proptest! {
        /// What stands in samples without a value must not matter: NaN times a weight of 0 is NaN.
        #[test]
        fn samples_without_a_value_take_no_part_whatever_stands_there(
            codes in prop::collection::vec(0_u8..3, SIZE * SIZE),
            blind in prop::collection::vec(prop::bool::weighted(0.2), SIZE * SIZE),
            (theta_deg, phi_deg) in (0.0..90.0_f64, 0.0..360.0_f64),
            channels in prop_oneof![Just(1_usize), Just(3)],
        ) {
            let cells = Cells::new(Disk::new(SIZE), |cell| !blind[cell]);
            let has_value = |cell: usize| codes[cell] != 0 && cells.disk.direction(cell).is_some() && !blind[cell];
            let filled = |nothing: f32| -> Vec<f32> {
                let f = |at: usize| if has_value(at / channels) { 1.0 + at as f32 * 0.01 } else { nothing };
                (0..SIZE * SIZE * channels).map(f).collect()
            };
            let read = |f: &[f32]| {
                let image = Image { f, provenance: Some(&codes), channels };
                let read = image.read(&cells, from_degrees(theta_deg, phi_deg));
                (read.value.to_array(), read.weight, read.saturated)
            };
            let (with_nan, with_number) = (read(&filled(f32::NAN)), read(&filled(1e30)));
            prop_assert_eq!(with_nan, with_number);
            prop_assert!(with_nan.0.iter().all(|value| value.is_finite()));
        }
    }
}
