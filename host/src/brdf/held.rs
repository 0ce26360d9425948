//! A measured BRDF that is held in memory, for look-ups by the million.
//!
//! # Design
//! By the rules of [`crate::brdf::interpolation`] a look-up reads up to eight images at up to four places each. Pairs in no order would wait
//! for memory all the time: many of them are answered tile by tile ([`Tiles`]), in which all images are read at places near each other, so
//! that what was read is read again soon. Each pair adds up the same numbers in the same order however many are asked, and whichever number of
//! threads there is: values are those of the file to the bit.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DVec3, Vec2, Vec4};
use rayon::prelude::*;

use super::{Brdf, BrdfError};
use crate::brdf::interpolation::{
    BLOCK, Blend, Captured, Interpolation, Layout, Lookup, Packed, PackedCell, captured,
};
use crate::brdf::reflectance::{Missing, Reflectance, Value};
use crate::hemisphere::disk::Disk;
use crate::store::StoreError;

/// Memory that the cells of a file may take, in bytes.
const MOST_BYTES: usize = 12_000_000_000;
/// Pairs that are brought into order together: each takes some 300 bytes meanwhile.
const BATCH: usize = 1 << 20;
/// Bytes of the file that are in memory at a time beside what is held, about.
const GROUP_BYTES: usize = 1 << 28;
/// Fewer are answered as they come.
const FEW: usize = 1 << 12;
/// Pairs of a tile, about.
const TOGETHER: usize = 64;
/// Pairs are in order if one in so many lies elsewhere than the one before it.
const IN_ORDER: usize = 4;

/// A file that is asked for this many pairs is held, if that takes no more bytes than [`UNASKED_BYTES`].
const MANY: usize = 1 << 18;
/// Memory that is taken without having been asked for.
const UNASKED_BYTES: usize = 4_000_000_000;

/// The cells of all images, packed.
#[derive(Debug)]
enum Cells {
    Colour(Vec<Vec4>),
    Grey(Vec<Vec2>),
}

/// What is held of a file beside the file.
#[derive(Debug)]
pub(super) struct Held {
    cells: Cells,
    layout: Layout,
    /// Incident directions of the images.
    captured: Vec<Captured>,
    blend: Blend,
}

/// Of a file that is held once many pairs were asked of it: how many were, and what is held then.
#[derive(Debug, Default)]
pub(super) struct Busy {
    asked: AtomicUsize,
    held: OnceLock<Held>,
}

impl Busy {
    /// What is held of `brdf`, of which `pairs` more are asked; `None` if few are, or too much would have to be held.
    pub(super) fn held(&self, brdf: &Brdf, pairs: usize) -> Result<Option<&Held>, StoreError> {
        let asked = self.asked.fetch_add(pairs, Ordering::Relaxed) + pairs;
        if self.held.get().is_none() && asked >= MANY && Held::bytes(brdf) <= UNASKED_BYTES {
            match Held::read(brdf, Interpolation::Blended) {
                // If another thread was first, its values are the same.
                Ok(held) => drop(self.held.set(held)),
                Err(BrdfError::Store(error)) => return Err(error),
                Err(BrdfError::Content { .. }) => {}
            }
        }
        Ok(self.held.get())
    }
}

/// All values of a `brdf.zarr`. It answers as [`Brdf`] does; nothing is read any more.
#[derive(Debug)]
pub struct HeldBrdf {
    brdf: Brdf,
    held: Held,
}

impl HeldBrdf {
    /// Reads all of `brdf`, 16 bytes for each incident direction and cell, 8 of a grey one, to be looked up by `interpolation`.
    ///
    /// # Errors
    /// [`BrdfError`] if it cannot be read or would take more than 12 GB.
    pub fn read(brdf: Brdf, interpolation: Interpolation) -> Result<Self, BrdfError> {
        let held = Held::read(&brdf, interpolation)?;
        Ok(Self { brdf, held })
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
        match &self.held.cells {
            Cells::Colour(cells) => Reader::new(&self.brdf, &self.held, cells).value(wi, wo),
            Cells::Grey(cells) => Reader::new(&self.brdf, &self.held, cells).value(wi, wo),
        }
    }
}

impl Reflectance for HeldBrdf {
    fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
        Ok(self.held.values(&self.brdf, pairs))
    }
}

impl Held {
    /// Bytes that the cells of `brdf` take.
    pub(super) fn bytes(brdf: &Brdf) -> usize {
        let cell = if brdf.channels() == 3 {
            size_of::<Vec4>()
        } else {
            size_of::<Vec2>()
        };
        Layout::new(brdf.grid.len(), brdf.disk.size()).len() * cell
    }

    /// Reads all of `brdf`.
    pub(super) fn read(brdf: &Brdf, interpolation: Interpolation) -> Result<Self, BrdfError> {
        let bytes = Self::bytes(brdf);
        if bytes > MOST_BYTES {
            return Err(brdf.too_large(MOST_BYTES, bytes));
        }
        let layout = Layout::new(brdf.grid.len(), brdf.disk.size());
        let cells = if brdf.channels() == 3 {
            Cells::Colour(packed(brdf, &layout)?)
        } else {
            Cells::Grey(packed(brdf, &layout)?)
        };
        Ok(Self {
            cells,
            layout,
            captured: captured(brdf),
            blend: Blend::new(interpolation, brdf.errors.as_ref()),
        })
    }

    /// f for pairs of unit vectors (incident, outgoing) of the file `brdf` that this was read from.
    pub(super) fn values(&self, brdf: &Brdf, pairs: &[(DVec3, DVec3)]) -> Vec<Value> {
        match &self.cells {
            Cells::Colour(cells) => Reader::new(brdf, self, cells).values(pairs),
            Cells::Grey(cells) => Reader::new(brdf, self, cells).values(pairs),
        }
    }
}

/// The cells of all images of `brdf`, some chunks of which are in memory beside them at a time.
fn packed<C: PackedCell>(brdf: &Brdf, layout: &Layout) -> Result<Vec<C>, BrdfError> {
    let mut all = vec![C::pack(&[0.0; 3], 0.0); layout.len()];
    let image = brdf.disk.len() * brdf.channels();
    let chunks: Vec<usize> = (0..brdf.chunks()).collect();
    let chunk_bytes = brdf.chunk_range(0).len() * image * size_of::<f32>();
    for group in chunks.chunks((GROUP_BYTES / chunk_bytes).max(1)) {
        let rows: Vec<_> = group
            .par_iter()
            .map(|&chunk| Ok((brdf.chunk_range(chunk).start, brdf.chunk(chunk)?)))
            .collect::<Result<_, StoreError>>()?;
        all.par_chunks_mut(layout.slab())
            .enumerate()
            .for_each(|(block, slab)| {
                for (first, rows) in &rows {
                    let images = rows.iter().flat_map(|rows| rows.f.chunks_exact(image));
                    for (f, out) in images.zip(slab.chunks_exact_mut(BLOCK).skip(*first)) {
                        layout.pack(&brdf.cells, block, f, out);
                    }
                }
            });
    }
    Ok(all)
}

/// What answers: a file, what is held of it, and its cells.
struct Reader<'a, C> {
    brdf: &'a Brdf,
    held: &'a Held,
    cells: &'a [C],
}

impl<'a, C: PackedCell> Reader<'a, C> {
    fn new(brdf: &'a Brdf, held: &'a Held, cells: &'a [C]) -> Self {
        Self { brdf, held, cells }
    }

    fn value(&self, wi: DVec3, wo: DVec3) -> Value {
        if let Some(missing) = Missing::at_horizon(wi, wo) {
            return Err(missing);
        }
        let set = (&self.brdf.grid, &self.held.captured[..]);
        let image = |row| self.image(row);
        let found = Lookup::of(set, &self.brdf.cells, &self.held.blend, (wi, wo), image);
        found
            .value()
            .ok_or_else(|| self.brdf.missing(wi, wo, f64::from(found.saturated)))
    }

    /// The image of incident direction `row`; `None` if it was not captured.
    fn image(&self, row: usize) -> Option<Packed<'a, C>> {
        self.brdf.incident[row]
            .is_none()
            .then(|| Packed::new(&self.held.layout, self.cells, row))
    }

    fn values(&self, pairs: &[(DVec3, DVec3)]) -> Vec<Value> {
        let mut values = Vec::with_capacity(pairs.len());
        for batch in pairs.chunks(BATCH) {
            let tiles = Tiles::of(batch.len());
            let places: Vec<u32> = batch.par_iter().map(|pair| tiles.place(*pair)).collect();
            let leaps = places.windows(2).filter(|two| two[0] != two[1]).count();
            if batch.len() < FEW || leaps * IN_ORDER < batch.len() {
                values.par_extend(batch.par_iter().map(|&(wi, wo)| self.value(wi, wo)));
                continue;
            }
            let order = sorted(&places);
            // Brought together first: so small a step waits for many of them at once.
            let together: Vec<(DVec3, DVec3)> = order.par_iter().map(|&at| batch[at as usize]).collect();
            let found: Vec<Value> = together.par_iter().map(|&(wi, wo)| self.value(wi, wo)).collect();
            let first = values.len();
            values.resize(first + batch.len(), Err(Missing::Unknown));
            for (at, value) in order.into_iter().zip(found) {
                values[first + at as usize] = value;
            }
        }
        values
    }
}

/// Tiles of the pairs of directions: both directions lie in the same cells of a coarse disk.
struct Tiles(Disk);

impl Tiles {
    /// Tiles that have [`TOGETHER`] of so many pairs each.
    fn of(pairs: usize) -> Self {
        let tiles = (pairs / TOGETHER).max(1) as f64;
        Self(Disk::new((tiles.powf(0.25).ceil() as usize).clamp(1, 64)))
    }

    /// Number of the tile of a pair; any for what lies below the horizon.
    fn place(&self, (wi, wo): (DVec3, DVec3)) -> u32 {
        let size = self.0.size();
        let [wi, wo] = [wi, wo].map(|w| {
            let position = self.0.position(w).unwrap_or_default();
            let [x, y] = [position.x, position.y].map(|at| (at as usize).min(size - 1));
            y * size + x
        });
        (wi * size * size + wo) as u32
    }
}

/// The indices of `keys` in the order of these; of equal ones the first comes first.
fn sorted(keys: &[u32]) -> Vec<u32> {
    let most = keys.iter().copied().max().unwrap_or(0) as usize;
    let mut starts = vec![0_u32; most + 2];
    for &key in keys {
        starts[key as usize + 1] += 1;
    }
    for at in 0..=most {
        starts[at + 1] += starts[at];
    }
    let mut order = vec![0; keys.len()];
    for (at, &key) in (0..).zip(keys) {
        let start = &mut starts[key as usize];
        order[*start as usize] = at;
        *start += 1;
    }
    order
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;
    use crate::brdf::interpolation::{BRANCHES, BranchErrors, REGIONS};
    use crate::hemisphere::direction::from_degrees;
    use crate::judge::evaluate::tests::file;
    use crate::store::provenance::Provenance;

    /// Bits of a value, or why there is none.
    fn bits(value: Value) -> Result<[u32; 3], Missing> {
        value.map(|f| f.map(f32::to_bits))
    }

    #[test]
    fn what_is_held_answers_as_the_file_does_to_the_bit() {
        let folder = tempfile::tempdir().unwrap();
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
        let pairs: Vec<(DVec3, DVec3)> = (0..2 * FEW)
            .map(|_| {
                let mut drawn = || from_degrees(rng.random_range(0.0..93.0), rng.random_range(0.0..360.0));
                (drawn(), drawn())
            })
            .collect();
        for channels in [1, 3] {
            let path = folder.path().join(format!("{channels}.zarr"));
            let mut one = |_, _| {
                let is_there = rng.random_bool(0.8);
                let f = (0..channels).map(|_| rng.random_range(0.0..2.0)).collect();
                is_there.then_some((f, 0.1, Provenance::Measured))
            };
            file(&path, channels, &mut one);
            let errors: Vec<f64> = (0..REGIONS * BRANCHES)
                .map(|_| rng.random_range(0.1..0.2))
                .collect();
            let open = || Brdf {
                errors: BranchErrors::from_values(errors.clone()),
                ..Brdf::open(&path).unwrap()
            };
            for interpolation in Interpolation::ALL {
                let told = open().interpolated(&pairs, interpolation).unwrap();
                assert!(told.iter().filter(|value| value.is_ok()).count() > FEW);
                assert!(told.contains(&Err(Missing::Saturated)));
                let held = HeldBrdf::read(open(), interpolation).unwrap();
                for (at, (found, told)) in held.values(&pairs).unwrap().into_iter().zip(&told).enumerate() {
                    let (wi, wo) = pairs[at];
                    assert_eq!(bits(found), bits(*told), "{interpolation:?} {wi} {wo}");
                    assert_eq!(bits(held.value(wi, wo)), bits(*told));
                }
            }
            // A file that is asked for much is held meanwhile.
            let busy = open().held_when_busy();
            let before = busy.values(&pairs).unwrap();
            let state = busy.busy.as_ref().unwrap();
            assert!(state.held.get().is_none());
            state.asked.store(MANY, Ordering::Relaxed);
            let after = busy.values(&pairs).unwrap();
            assert!(state.held.get().is_some());
            assert!(before.into_iter().map(bits).eq(after.into_iter().map(bits)));
        }
    }

    #[test]
    fn an_order_has_everything_once_by_its_keys() {
        let keys = [3, 0, 3, 1, 0, 7];
        assert_eq!(sorted(&keys), [1, 4, 3, 0, 2, 5]);
        assert!(sorted(&[]).is_empty());
    }
}
