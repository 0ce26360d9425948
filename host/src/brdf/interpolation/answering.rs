//! Queries by the million, of images that are all in memory.

use glam::{Vec3, Vec4};

use super::captures::{Cells, Readable};
use super::lanes::{FOUR, Notes, Said};
use super::packed::Strides;
use super::prepared::{Pairs, Prepared, of_lane, side};
use super::rule::Captured;
use super::{Blend, ENOUGH};
use crate::base::eight::LANES;
use crate::hemisphere::incident::IncidentSet;

/// What the images on one side of a query say together.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sums {
    /// f in sr⁻¹ × weight, and that weight.
    pub(super) sum: Vec4,
    /// Weight of what direct reading found: without it nothing was measured there.
    pub(super) found: f32,
    /// Weight of what direct reading found saturated.
    pub(super) saturated: f32,
    /// Largest code of provenance of the cells that took part.
    pub(super) weakest: u8,
}

// Inlined whatever the compiler thinks of it: millions of times a second.
#[allow(clippy::inline_always)]
impl Sums {
    /// Adds what some images said.
    #[inline(always)]
    pub(super) fn add(&mut self, said: &Said) {
        for (sum, weight) in said.sums.iter().zip(said.weights) {
            self.sum += sum.truncate().extend(weight);
        }
        self.found += said.found.iter().sum::<f32>();
        self.saturated += said.saturated.iter().sum::<f32>();
        self.weakest = self.weakest.max(said.weakest);
    }

    /// Value × weight, and weight of all that was read on both sides.
    #[inline(always)]
    fn of_both(forth: &Self, back: &Self) -> (Vec3, f32) {
        let sum = forth.sum + back.sum;
        (sum.truncate(), sum.w)
    }

    /// f in sr⁻¹ if at least half of what direct interpolation needs was measured; else the weight of what saturated.
    #[inline(always)]
    pub(super) fn value(forth: &Self, back: &Self) -> Result<[f32; 3], f32> {
        let (value, weight) = Self::of_both(forth, back);
        if forth.found >= ENOUGH && weight > 1e-6 {
            Ok((value / weight).to_array())
        } else {
            Err(forth.saturated)
        }
    }
}

/// What queries are answered from: images that are all in memory.
pub(crate) struct Answering<'a, I> {
    pub(crate) set: &'a IncidentSet,
    pub(crate) blend: &'a Blend,
    pub(crate) cells: &'a Cells,
    pub(crate) strides: Strides,
    /// Incident directions of the images.
    pub(crate) captured: &'a [Captured],
    /// From its number to an image; `None` if it was not captured.
    pub(crate) image: I,
}

/// What [`Answering::eight`] writes on.
pub(crate) struct Desk<R> {
    notes: Notes,
    /// Images of each side, [pair × side, lane].
    images: [[Option<R>; FOUR]; 2 * LANES],
}

impl<R: Readable> Default for Desk<R> {
    fn default() -> Self {
        Self {
            notes: Notes::of(2 * LANES),
            images: [[None; FOUR]; 2 * LANES],
        }
    }
}

impl<R: Readable> Desk<R> {
    /// Adds what was read of the pair in `lane` to its sums, forth and back.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub(super) fn add(&self, lane: usize, sums: &mut [Sums; 2]) {
        for (side, sums) in sums.iter_mut().enumerate() {
            sums.add(self.notes.said(2 * lane + side));
        }
    }
}

// Inlined whatever the compiler thinks of it: millions of times a second.
#[allow(clippy::inline_always)]
impl<R: Readable, I: Fn(usize) -> Option<R>> Answering<'_, I> {
    /// f in sr⁻¹ of each pair, or the weight of what saturated where there is none.
    pub(crate) fn eight(&self, pairs: &Pairs, desk: &mut Desk<R>) -> [Result<[f32; 3], f32>; LANES] {
        self.read(pairs, desk);
        std::array::from_fn(|lane| {
            let mut sums = [Sums::default(); 2];
            desk.add(lane, &mut sums);
            Sums::value(&sums[0], &sums[1])
        })
    }

    /// Reads what the images that are there say of each pair: it is on the `desk` then.
    #[inline(always)]
    pub(super) fn read(&self, pairs: &Pairs, desk: &mut Desk<R>) {
        let prepared = Prepared::new(self.blend, pairs);
        desk.notes.clear();
        for is_back in [false, true] {
            if is_back && !self.blend.reads_back() {
                break;
            }
            let neighbours = prepared.neighbours(self.set, is_back);
            for lane in 0..LANES {
                let shares = prepared.side(lane, is_back);
                if is_back && !shares.iter().any(|share| *share > 0.0) {
                    continue;
                }
                let number = 2 * lane + usize::from(is_back);
                let (rows, mut weights) = of_lane(&neighbours, lane);
                let images = &mut desk.images[number];
                for at in 0..FOUR {
                    images[at] = (self.image)(rows[at] as usize);
                    weights[at] = if images[at].is_some() { weights[at] } else { 0.0 };
                }
                // Nothing would be noted.
                if weights.iter().all(|weight| *weight <= 0.0) {
                    continue;
                }
                let side = side(
                    prepared.pair(lane, is_back),
                    self.captured,
                    (rows, weights),
                    shares,
                    is_back,
                );
                side.note::<R>(number, self.cells, self.strides, &mut desk.notes);
            }
        }
        desk.notes.read(self.cells, &desk.images);
    }
}
