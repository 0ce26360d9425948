//! A measured BRDF that is held in memory, for look-ups by the million.
//!
//! # Design
//! By the rules of [`crate::brdf::interpolation`] a look-up reads up to eight images at up to four places each. Pairs in no order would wait
//! for memory all the time: many of them are answered tile by tile ([`Tiles`]), in which all images are read at places near each other, so
//! that what was read is read again soon. Each pair adds up the same numbers in the same order however many are asked, and whichever number of
//! threads there is: values are those of the file to the bit.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DVec3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use super::{Brdf, BrdfError};
use crate::base::eight::LANES;
use crate::brdf::interpolation::{
    Answering, BLOCK, Blend, Captured, Desk, Interpolation, Layout, Packed, PackedCell, captured, filled,
};
use crate::brdf::reflectance::{Missing, Reflectance, Value};
use crate::store::StoreError;

/// Memory that the cells of a file may take, in bytes.
const MOST_BYTES: usize = 12_000_000_000;
/// Pairs that are brought into order together: each takes some 50 bytes meanwhile.
const BATCH: usize = 1 << 22;
/// Bytes of the file that are in memory at a time beside what is held, about.
const GROUP_BYTES: usize = 1 << 28;
/// Fewer are answered as they come.
const FEW: usize = 1 << 12;
/// Pairs of a tile, about.
const TOGETHER: usize = 64;
/// Pairs are in order if one in so many lies elsewhere than the one before it.
const IN_ORDER: usize = 4;
/// Pairs that a thread answers at a time.
const AT_A_TIME: usize = 128 * LANES;

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
    /// Whether `brdf` is held once many pairs were asked of it.
    pub(super) fn will_hold(brdf: &Brdf) -> bool {
        Held::bytes(brdf) <= UNASKED_BYTES
    }

    /// What is held of `brdf`, of which `pairs` more are asked; `None` if few are, or too much would have to be held.
    pub(super) fn held(&self, brdf: &Brdf, pairs: usize) -> Result<Option<&Held>, StoreError> {
        let asked = self.asked.fetch_add(pairs, Ordering::Relaxed) + pairs;
        if self.held.get().is_none() && asked >= MANY && Self::will_hold(brdf) {
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
    /// Reads all of `brdf`, 20 bytes for each incident direction and cell, 10 of a grey one, to be looked up by `interpolation`.
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
    let mut all = vec![C::MISSING; layout.len()];
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
        let mut value = [Err(Missing::Unknown)];
        self.answer(&mut value, &[(wi, wo)], &mut Desk::default());
        value[0]
    }

    /// Answers one to eight pairs.
    fn answer(&self, values: &mut [Value], pairs: &[(DVec3, DVec3)], desk: &mut Desk<Packed<'a, C>>) {
        let mut above = filled(pairs);
        for pair in &mut above {
            if Missing::at_horizon(pair.0, pair.1).is_some() {
                *pair = (DVec3::Z, DVec3::Z);
            }
        }
        let answering = Answering {
            set: &self.brdf.grid,
            blend: &self.held.blend,
            cells: &self.brdf.cells,
            strides: self.held.layout.strides(),
            captured: &self.held.captured,
            image: |row| self.image(row),
        };
        let found = answering.eight(&above, desk);
        for ((value, &(wi, wo)), found) in values.iter_mut().zip(pairs).zip(found) {
            *value = match (Missing::at_horizon(wi, wo), found) {
                (Some(missing), _) => Err(missing),
                (None, Ok(f)) => Ok(f),
                (None, Err(saturated)) => Err(self.brdf.missing(wi, wo, f64::from(saturated))),
            };
        }
    }

    /// The image of incident direction `row`; `None` if it was not captured.
    fn image(&self, row: usize) -> Option<Packed<'a, C>> {
        self.brdf.incident[row]
            .is_none()
            .then(|| Packed::new(&self.held.layout, self.cells, row))
    }

    fn values(&self, pairs: &[(DVec3, DVec3)]) -> Vec<Value> {
        let mut values = vec![Err(Missing::Unknown); pairs.len()];
        for (values, pairs) in values.chunks_mut(BATCH).zip(pairs.chunks(BATCH)) {
            let tiles = Tiles::of(pairs.len());
            let places: Vec<u32> = pairs.par_iter().map(|pair| tiles.place(*pair)).collect();
            let leaps = places.par_windows(2).filter(|two| two[0] != two[1]).count();
            if pairs.len() < FEW || leaps * IN_ORDER < pairs.len() {
                self.as_they_come(values, pairs);
            } else {
                self.in_order(values, pairs, &places);
            }
        }
        values
    }

    /// Answers pairs in their own order.
    fn as_they_come(&self, values: &mut [Value], pairs: &[(DVec3, DVec3)]) {
        let all = values.par_chunks_mut(AT_A_TIME).zip(pairs.par_chunks(AT_A_TIME));
        all.for_each_init(Desk::default, |desk, (values, pairs)| {
            for (values, pairs) in values.chunks_mut(LANES).zip(pairs.chunks(LANES)) {
                self.answer(values, pairs, desk);
            }
        });
    }

    /// Answers pairs in the order of the `places` that they lie in.
    fn in_order(&self, values: &mut [Value], pairs: &[(DVec3, DVec3)], places: &[u32]) {
        let order = Order::of(places);
        let mut found = vec![Err(Missing::Unknown); pairs.len()];
        let all = found
            .par_chunks_mut(AT_A_TIME)
            .zip(order.indices.par_chunks(AT_A_TIME));
        all.for_each_init(Desk::default, |desk, (values, indices)| {
            let mut eight = [(DVec3::Z, DVec3::Z); LANES];
            for (values, indices) in values.chunks_mut(LANES).zip(indices.chunks(LANES)) {
                for (pair, &index) in eight.iter_mut().zip(indices) {
                    *pair = pairs[index as usize];
                }
                self.answer(values, &eight[..indices.len()], desk);
            }
        });
        let places = values.par_iter_mut().zip(&order.places);
        places.for_each(|(value, &place)| *value = found[place as usize]);
    }
}

/// Tiles of the pairs of directions: both directions lie in the same cells of a coarse equal-area disk, `size` of them a side.
struct Tiles {
    size: u32,
}

impl Tiles {
    /// Tiles that have [`TOGETHER`] of so many pairs each.
    fn of(pairs: usize) -> Self {
        let tiles = (pairs / TOGETHER).max(1) as f64;
        Self {
            size: (tiles.powf(0.25).ceil() as u32).clamp(1, 64),
        }
    }

    /// Number of the tile of a pair; any for what lies below the horizon. Those near each other have numbers near each other: the bits of
    /// their columns and rows take turns (a Z-order curve).
    fn place(&self, (wi, wo): (DVec3, DVec3)) -> u32 {
        let half = 0.5 * self.size as f32;
        let cells = |w: Vec3| {
            let scale = half / (1.0 + w.z.max(0.0)).sqrt();
            [w.x, w.y].map(|x| ((x * scale + half).max(0.0) as u32).min(self.size - 1))
        };
        let ([a, b], [c, d]) = (cells(wi.as_vec3()), cells(wo.as_vec3()));
        apart(c) | apart(d) << 1 | apart(a) << 2 | apart(b) << 3
    }
}

/// The six lowest bits, each four places from the next.
const fn apart(x: u32) -> u32 {
    x & 1 | (x & 2) << 3 | (x & 4) << 6 | (x & 8) << 9 | (x & 16) << 12 | (x & 32) << 15
}

/// An order by keys: the index of what comes at each place, and the place of each. Of equal keys the first comes first.
struct Order {
    indices: Vec<u32>,
    places: Vec<u32>,
}

impl Order {
    fn of(keys: &[u32]) -> Self {
        let most = keys.iter().copied().max().unwrap_or(0) as usize;
        let mut starts = vec![0_u32; most + 2];
        for &key in keys {
            starts[key as usize + 1] += 1;
        }
        for at in 0..=most {
            starts[at + 1] += starts[at];
        }
        let (mut indices, mut places) = (vec![0; keys.len()], vec![0; keys.len()]);
        for (index, (&key, place)) in (0..).zip(keys.iter().zip(&mut places)) {
            let start = &mut starts[key as usize];
            indices[*start as usize] = index;
            *place = *start;
            *start += 1;
        }
        Self { indices, places }
    }
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
        let order = Order::of(&[3, 0, 3, 1, 0, 7]);
        assert_eq!(order.indices, [1, 4, 3, 0, 2, 5]);
        assert_eq!(order.places, [3, 0, 4, 2, 1, 5]);
        assert!(Order::of(&[]).indices.is_empty());
    }

    #[test]
    fn each_tile_has_its_own_number() {
        let numbers: std::collections::HashSet<u32> = (0..64).map(apart).collect();
        assert_eq!(numbers.len(), 64);
        assert!(numbers.iter().all(|number| number & !0x0011_1111 == 0));
        let tiles = Tiles { size: 64 };
        let far = tiles.place((from_degrees(89.9, 45.0), from_degrees(89.9, 225.0)));
        assert!(far < 1 << 24, "{far}");
    }
}
