//! Where images are read for queries, and what they say there.
//!
//! # Design
//! First it is noted where each image is read ([`Side::note`]), then all of it is read ([`Notes::read`]): so short a loop waits for many cells at
//! once.
//!
//! Where the four images on a side of a query are read is the same arithmetic with other numbers: the four are lanes of a vector. It is in
//! single precision, by which a place is off by a few 10⁻⁵ of a cell: of what neighbouring cells differ by, values change by as much. The
//! sums of each image are its own, so that it does not matter which images are in memory together.

use glam::{Mat4, Vec2, Vec3, Vec4};

use super::blend::BACK;
use super::captures::{Cells, Readable};
use super::packed::{Four, Strides};
use super::rule::{Captured, DIRECT, LEAST_COSINES, PLACES, Place, RULES};
use crate::base::eight::floor;

/// Images of a side.
pub(super) const FOUR: usize = 4;
/// Readings of a side, at most.
const MOST: usize = FOUR * PLACES.len();

/// What the images of a side say of a query, one by one.
#[derive(Clone, Copy, Default)]
pub(super) struct Said {
    /// f in sr⁻¹ × weight over all rules; what stands beside the three is of no meaning.
    pub(super) sums: [Vec4; FOUR],
    /// That weight.
    pub(super) weights: [f32; FOUR],
    /// Weight of what direct reading forth found, and found saturated.
    pub(super) found: [f32; FOUR],
    pub(super) saturated: [f32; FOUR],
    /// Largest code of provenance of the cells that took part.
    pub(super) weakest: u8,
}

/// One side of a query: all images are read forth, or all are read back with the directions exchanged.
pub(super) struct Side<'a> {
    /// The pair of directions as the images are asked.
    pub(super) wi: Vec3,
    pub(super) wo: Vec3,
    /// Incident directions of the images, and how much each counts: nothing if it is not there.
    pub(super) captured: [&'a Captured; FOUR],
    pub(super) weights: Vec4,
    /// How much each rule counts.
    pub(super) shares: &'a [f32; BACK],
    pub(super) is_back: bool,
}

/// An image that is read between four cells.
#[derive(Clone, Copy, Default)]
struct Reading {
    four: Four,
    /// The side, the place and the lane.
    side: u32,
    place: u32,
    lane: u32,
    /// What its value and its weight count.
    factor: f32,
    weight: f32,
}

/// What is read of some sides.
#[derive(Default)]
pub(super) struct Notes {
    readings: Vec<Reading>,
    count: usize,
    /// Where each side reads at each place, in all lanes.
    at: Vec<[Directions; PLACES.len()]>,
    /// How much each image of a side counts.
    weights: Vec<Vec4>,
    said: Vec<Said>,
}

impl Notes {
    /// Of so many sides.
    pub(super) fn of(sides: usize) -> Self {
        Self {
            readings: vec![Reading::default(); sides * MOST],
            at: vec![[Directions::default(); PLACES.len()]; sides],
            weights: vec![Vec4::ZERO; sides],
            said: vec![Said::default(); sides],
            count: 0,
        }
    }

    /// Nothing is noted any more.
    pub(super) fn clear(&mut self) {
        self.count = 0;
        self.said.fill(Said::default());
    }

    /// What side `side` says.
    pub(super) fn said(&self, side: usize) -> &Said {
        &self.said[side]
    }

    /// Reads `images`, [side, lane].
    #[inline]
    pub(super) fn read<R: Readable>(&mut self, cells: &Cells, images: &[[Option<R>; FOUR]]) {
        for reading in &self.readings[..self.count] {
            let (side, lane) = (reading.side as usize, reading.lane as usize % FOUR);
            let said = &mut self.said[side];
            let Some(image) = &images[side][lane] else {
                continue;
            };
            let sum = image.corners(cells, &reading.four);
            // Not a number where one of them is missing.
            if sum.w > 0.0 {
                said.sums[lane] += sum * (reading.factor / sum.w);
                if R::HAS_CODES && reading.weight > 0.0 {
                    said.weakest = said.weakest.max(image.weakest(cells, &reading.four));
                }
                continue;
            }
            let at = self.at[side][reading.place as usize].lane(lane);
            seldom(cells, image, at, reading, self.weights[side][lane], said);
        }
    }
}

/// Reads beside what has no value, and at the horizon; it was noted as if all had one.
#[cold]
#[inline(never)]
fn seldom(cells: &Cells, image: &impl Readable, wo: Vec3, reading: &Reading, weight: f32, said: &mut Said) {
    let (read, lane) = (image.read(cells, wo.as_dvec3()), reading.lane as usize);
    said.sums[lane] += (reading.factor * read.value).extend(0.0);
    said.weights[lane] += reading.weight * (read.weight - 1.0);
    if reading.place as usize == DIRECT && said.found[lane] > 0.0 {
        said.found[lane] = weight * read.weight;
        said.saturated[lane] = weight * read.saturated;
    }
    if reading.weight > 0.0 {
        said.weakest = said.weakest.max(read.weakest);
    }
}

/// Directions, one in each lane.
#[derive(Clone, Copy, Default)]
struct Directions {
    x: Vec4,
    y: Vec4,
    z: Vec4,
}

// Inlined whatever the compiler thinks of it: millions of times a second.
#[allow(clippy::inline_always)]
impl Directions {
    #[inline(always)]
    fn splat(w: Vec3) -> Self {
        Self {
            x: Vec4::splat(w.x),
            y: Vec4::splat(w.y),
            z: Vec4::splat(w.z),
        }
    }

    /// Turned about the normal.
    #[inline(always)]
    fn turned(self, [cos, sin]: [Vec4; 2]) -> Self {
        Self {
            x: cos * self.x - sin * self.y,
            y: sin * self.x + cos * self.y,
            z: self.z,
        }
    }

    /// `w` mirrored at these.
    #[inline(always)]
    fn mirrored(self, w: Self) -> Self {
        let twice = 2.0 * (self.x * w.x + self.y * w.y + self.z * w.z);
        Self {
            x: twice * self.x - w.x,
            y: twice * self.y - w.y,
            z: twice * self.z - w.z,
        }
    }

    fn lane(self, lane: usize) -> Vec3 {
        Vec3::new(self.x[lane], self.y[lane], self.z[lane])
    }
}

#[allow(clippy::inline_always)]
impl Side<'_> {
    /// Notes as number `number` where its images are read, whose cells lie by `strides`.
    #[inline(always)]
    pub(super) fn note<R: Readable>(
        &self,
        number: usize,
        cells: &Cells,
        strides: Strides,
        notes: &mut Notes,
    ) {
        let along = |of: fn(&Captured) -> f32| {
            let [a, b, c, d] = self.captured;
            Vec4::new(of(a), of(b), of(c), of(d))
        };
        let w = Directions {
            x: along(|of| of.lane.x),
            y: along(|of| of.lane.y),
            z: along(|of| of.lane.z),
        };
        let half = Directions::splat((self.wi + self.wo).normalize_or(Vec3::Z));
        let straight = Directions::splat(self.wo);
        let turn = self.turn([along(|of| of.azimuth.x), along(|of| of.azimuth.y)]);
        let asked = Vec4::splat(1.0 / (self.wi.z * self.wo.z).max(LEAST_COSINES as f32));
        let mut all = Vec4::ZERO;
        for (place, rules) in PLACES.into_iter().enumerate() {
            let shares = &self.shares[rules.clone()];
            let share: f32 = shares.iter().sum();
            // Direct reading forth says whether anything was measured here, even if its share is nothing.
            let is_direct = rules.start == DIRECT && !self.is_back;
            if share <= 0.0 && !is_direct {
                continue;
            }
            let Place { half_vector, turned } = RULES[rules.start].place;
            let (at, factor) = if half_vector {
                let half = if turned { half.turned(turn) } else { half };
                let at = half.mirrored(w);
                // The rules there multiply with √ of the cosines to the powers 0, 1 and 2.
                let square = (w.z * at.z).max(Vec4::splat(LEAST_COSINES as f32)) * asked;
                let factor = Vec4::splat(shares[0]) + shares[1] * square.sqrt() + shares[2] * square;
                (at, factor)
            } else {
                let at = if turned { straight.turned(turn) } else { straight };
                (at, Vec4::splat(share))
            };
            let is_read = at.z.min(self.weights).cmpgt(Vec4::ZERO);
            let weights = Vec4::select(is_read, self.weights, Vec4::ZERO);
            all += share * weights;
            if is_direct {
                notes.said[number].found = weights.to_array();
            }
            notes.at[number][place] = at;
            let (factor, weight) = ((weights * factor).to_array(), (weights * share).to_array());
            let fours = fours::<R>(cells, strides, at);
            for lane in 0..FOUR {
                notes.readings[notes.count] = Reading {
                    four: fours[lane],
                    side: number as u32,
                    place: place as u32,
                    lane: lane as u32,
                    factor: factor[lane],
                    weight: weight[lane],
                };
                notes.count += (is_read.bitmask() >> lane & 1) as usize;
            }
        }
        notes.weights[number] = self.weights;
        notes.said[number].weights = all.to_array();
    }

    /// Cosine and sine of the turn from the azimuth of the incident direction to those of the images, of which these are cosine and sine.
    #[inline(always)]
    fn turn(&self, [x, y]: [Vec4; 2]) -> [Vec4; 2] {
        let across = Vec2::new(self.wi.x, self.wi.y);
        let squared = across.length_squared();
        let from = if squared > 1e-18 {
            across / squared.sqrt()
        } else {
            Vec2::ZERO
        };
        let (cos, sin) = (from.x * x + from.y * y, from.x * y - from.y * x);
        // What has no azimuth is not turned.
        let is_none = (cos * cos + sin * sin).cmplt(Vec4::splat(0.5));
        [
            Vec4::select(is_none, Vec4::ONE, cos),
            Vec4::select(is_none, Vec4::ZERO, sin),
        ]
    }
}

/// The four cells around directions on the grid: the first of them, and how much each counts.
#[allow(clippy::inline_always)]
#[inline(always)]
fn fours<R: Readable>(cells: &Cells, strides: Strides, at: Directions) -> [Four; FOUR] {
    let (size, x_axis) = (cells.disk.size(), cells.disk.x_axis().as_vec2());
    let half = Vec4::splat(size as f32 / 2.0);
    let scale = half / (Vec4::ONE + at.z.max(Vec4::ZERO)).sqrt();
    let x = (x_axis.x * at.x - x_axis.y * at.y) * scale + (half - 0.5);
    let y = (x_axis.y * at.x + x_axis.x * at.y) * scale + (half - 0.5);
    let (column, row) = (floor(x), floor(y));
    let (tx, ty) = (x - column, y - row);
    let (sx, sy) = (Vec4::ONE - tx, Vec4::ONE - ty);
    let last = Vec4::splat((size - 1) as f32);
    let is_inside = column.min(row).cmpge(Vec4::ZERO) & column.max(row).cmplt(last);
    let is_inside = is_inside.bitmask();
    let first = strides.first::<R>(column, row);
    let weights = Mat4::from_cols(sx * sy, tx * sy, sx * ty, tx * ty).transpose();
    let of = |lane: usize, weights: Vec4| Four {
        // Where the grid ends there are no four, nor such a place in memory.
        first: if is_inside >> lane & 1 == 1 {
            first[lane]
        } else {
            u32::MAX
        },
        weights,
    };
    [
        of(0, weights.x_axis),
        of(1, weights.y_axis),
        of(2, weights.z_axis),
        of(3, weights.w_axis),
    ]
}
