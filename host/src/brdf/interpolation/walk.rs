//! Values by the million, of images that are read once for all of them.
//!
//! # Design
//! Of a pair nothing is kept but what images said so far, less than the pair itself takes. What it asks is prepared anew for each group of images
//! that it needs, two or three in most cases: that takes less time than a file takes to be read again because memory was full.
//! Each pair adds up the same numbers in the same order as [`Lookup`](super::lookup::Lookup) does: values are the same to the bit.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DVec3, Vec4};
use rayon::prelude::*;

use super::Blend;
use super::answering::{Answering, Desk, Sums};
use super::captures::{Captures, Image};
use super::lookup::captured;
use super::packed::Strides;
use super::prepared::{Prepared, filled, of_lane};
use crate::base::eight::LANES;
use crate::brdf::reflectance::Missing;
use crate::store::StoreError;

/// Pairs among which those that need a group are looked for together.
const TOGETHER: usize = 1 << 12;

/// Consecutive images are parts, of which a byte counts all.
struct Parts {
    rows: usize,
}

impl Parts {
    const fn of(images: usize) -> Self {
        Self {
            rows: images.div_ceil(u8::MAX as usize),
        }
    }

    const fn part(&self, row: usize) -> u8 {
        (row / self.rows) as u8
    }

    /// The first and the last of the parts that `group` has a row of.
    const fn around(&self, group: &Range<usize>) -> [u8; 2] {
        [self.part(group.start), self.part(group.end - 1)]
    }
}

/// What images said of a pair so far, and which it needs.
#[derive(Clone, Copy)]
struct Kept {
    /// f in sr⁻¹ × weight and that weight, forth and back.
    sums: [[f32; 4]; 2],
    /// As [`Sums`] has them, forth.
    found: f32,
    saturated: f32,
    /// The first and the last of the parts with an image that is read forth, and back; the last before the first if there is none.
    parts: [[u8; 2]; 2],
}

impl Kept {
    const NOTHING: Self = Self {
        sums: [[0.0; 4]; 2],
        found: 0.0,
        saturated: 0.0,
        parts: [[u8::MAX, 0]; 2],
    };

    fn includes(&mut self, is_back: bool, part: u8) {
        let [first, last] = &mut self.parts[usize::from(is_back)];
        (*first, *last) = ((*first).min(part), (*last).max(part));
    }

    fn needs(&self, [first, last]: [u8; 2]) -> bool {
        self.parts.iter().any(|of| of[0] <= last && first <= of[1])
    }

    fn sums(&self) -> [Sums; 2] {
        let of = |[x, y, z, w]: [f32; 4], found, saturated| Sums {
            sum: Vec4::new(x, y, z, w),
            found,
            saturated,
            weakest: 0,
        };
        let [forth, back] = self.sums;
        [of(forth, self.found, self.saturated), of(back, 0.0, 0.0)]
    }

    fn keep(&mut self, [forth, back]: &[Sums; 2]) {
        self.sums = [forth.sum.to_array(), back.sum.to_array()];
        (self.found, self.saturated) = (forth.found, forth.saturated);
    }
}

/// Makes `value` of what is found of each pair of unit vectors (incident, outgoing): f in sr⁻¹, or the weight of what saturated where there is
/// none, as of pairs that are not above the horizon.
///
/// # Errors
/// [`StoreError`] if the captures cannot be read.
pub(crate) fn walk<T: Send>(
    captures: &impl Captures,
    blend: &Blend,
    pairs: &[(DVec3, DVec3)],
    value: impl Fn((DVec3, DVec3), Result<[f32; 3], f32>) -> T + Sync,
) -> Result<Vec<T>, StoreError> {
    let parts = Parts::of(captures.set().len());
    let (mut kept, wanted) = needed(captures, blend, pairs, &parts);
    let captured = captured(captures);
    captures.scan(&wanted, &mut |group, image| {
        let answering = Answering {
            set: captures.set(),
            blend,
            cells: captures.cells(),
            strides: Strides::rows(captures.cells().disk.size()),
            captured: &captured,
            image: |row| group.contains(&row).then(|| image(row)).flatten(),
        };
        let around = parts.around(&group);
        let all = kept.par_chunks_mut(TOGETHER).zip(pairs.par_chunks(TOGETHER));
        all.for_each_init(Desk::<Image<'_>>::default, |desk, (kept, pairs)| {
            let asking: Vec<usize> = (0..kept.len()).filter(|at| kept[*at].needs(around)).collect();
            for some in asking.chunks(LANES) {
                let mut eight = [pairs[some[0]]; LANES];
                for (pair, at) in eight.iter_mut().zip(some) {
                    *pair = pairs[*at];
                }
                answering.read(&eight, desk);
                for (lane, at) in some.iter().enumerate() {
                    let mut sums = kept[*at].sums();
                    desk.add(lane, &mut sums);
                    kept[*at].keep(&sums);
                }
            }
        });
    })?;
    let all = kept.par_iter().zip(pairs);
    let found = |(kept, pair): (&Kept, &(DVec3, DVec3))| {
        let [forth, back] = kept.sums();
        value(*pair, Sums::value(&forth, &back))
    };
    Ok(all.map(found).collect())
}

/// Which images each pair needs, and which are needed at all.
fn needed(
    captures: &impl Captures,
    blend: &Blend,
    pairs: &[(DVec3, DVec3)],
    parts: &Parts,
) -> (Vec<Kept>, Vec<bool>) {
    let set = captures.set();
    let wanted: Vec<AtomicBool> = (0..set.len()).map(|_| AtomicBool::new(false)).collect();
    let mut kept = vec![Kept::NOTHING; pairs.len()];
    let all = kept.par_chunks_mut(LANES).zip(pairs.par_chunks(LANES));
    all.for_each(|(kept, pairs)| {
        let mut eight = filled(pairs);
        let is_above = eight.map(|(wi, wo)| Missing::at_horizon(wi, wo).is_none());
        for (pair, is_above) in eight.iter_mut().zip(is_above) {
            if !is_above {
                *pair = (DVec3::Z, DVec3::Z);
            }
        }
        let prepared = Prepared::new(blend, &eight);
        for is_back in [false, true] {
            if is_back && !blend.reads_back() {
                break;
            }
            let neighbours = prepared.neighbours(set, is_back);
            for (lane, kept) in kept.iter_mut().enumerate() {
                let is_read = !is_back || prepared.side(lane, is_back).iter().any(|share| *share > 0.0);
                if !is_above[lane] || !is_read {
                    continue;
                }
                let (rows, weights) = of_lane(&neighbours, lane);
                for (row, _) in rows.into_iter().zip(weights).filter(|(_, weight)| *weight > 0.0) {
                    wanted[row as usize].store(true, Ordering::Relaxed);
                    kept.includes(is_back, parts.part(row as usize));
                }
            }
        }
    });
    (kept, wanted.into_iter().map(AtomicBool::into_inner).collect())
}
