//! The four images on one side of a query, read at once.
//!
//! # Design
//! Where each image is read is the same arithmetic with other numbers: the four are lanes of a vector. It is in single precision, by which
//! a place is off by a few 10⁻⁵ of a cell: of what neighbouring cells differ by, values change by as much. The sums of each image are its
//! own, so that it does not matter which images are in memory together.

use glam::{DVec3, Vec3, Vec4};

use super::blend::BACK;
use super::captures::{Cells, Readable};
use super::packed::Four;
use super::rule::{Captured, DIRECT, LEAST_COSINES, PLACES, Place, RULES, azimuth};

/// What the images of a side say of a query, one by one.
#[derive(Clone, Copy, Default)]
pub(super) struct Said {
    /// f in sr⁻¹ × weight over all rules, and weight.
    pub(super) sums: [Vec4; 4],
    /// Weight of what direct reading found, and found saturated.
    pub(super) found: [f32; 4],
    pub(super) saturated: [f32; 4],
    /// Largest code of provenance of the cells that took part.
    pub(super) weakest: u8,
}

/// One side of a query: all images are read forth, or all are read back with the directions exchanged.
pub(super) struct Side<'a> {
    /// The pair of directions as the images are asked.
    pub(super) pair: (DVec3, DVec3),
    /// Incident directions of the images, and how much each counts.
    pub(super) captured: [&'a Captured; 4],
    pub(super) weights: [f32; 4],
    /// How much each rule counts.
    pub(super) shares: &'a [f32; BACK],
    pub(super) is_back: bool,
}

/// Directions, one in each lane.
#[derive(Clone, Copy)]
struct Directions {
    x: Vec4,
    y: Vec4,
    z: Vec4,
}

impl Directions {
    #[inline]
    fn splat(w: Vec3) -> Self {
        Self {
            x: Vec4::splat(w.x),
            y: Vec4::splat(w.y),
            z: Vec4::splat(w.z),
        }
    }

    /// Turned about the normal.
    #[inline]
    fn turned(self, [cos, sin]: [Vec4; 2]) -> Self {
        Self {
            x: cos * self.x - sin * self.y,
            y: sin * self.x + cos * self.y,
            z: self.z,
        }
    }

    /// `w` mirrored at these.
    #[inline]
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

impl Side<'_> {
    /// Reads `images`, those of the captured directions, as far as they are there.
    #[inline]
    pub(super) fn read<R: Readable>(&self, cells: &Cells, images: &[Option<R>; 4]) -> Said {
        let (wi, wo) = self.pair;
        let [a, b, c, d] = self.captured;
        let w = Directions {
            x: Vec4::new(a.lane.x, b.lane.x, c.lane.x, d.lane.x),
            y: Vec4::new(a.lane.y, b.lane.y, c.lane.y, d.lane.y),
            z: Vec4::new(a.lane.z, b.lane.z, c.lane.z, d.lane.z),
        };
        let half = Directions::splat((wi + wo).normalize_or(DVec3::Z).as_vec3());
        let straight = Directions::splat(wo.as_vec3());
        let turn = self.turn();
        let asked = Vec4::splat(1.0 / (wi.z * wo.z).max(LEAST_COSINES) as f32);
        let mut said = Said::default();
        for rules in PLACES {
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
            let places = Places::new(cells, at);
            let factors = (Vec4::from_array(self.weights) * factor).to_array();
            for (lane, image) in images.iter().enumerate() {
                let Some(image) = image.as_ref().filter(|_| places.is_above[lane] > 0.0) else {
                    continue;
                };
                let short = places.four(lane).and_then(|four| image.read_four(cells, &four));
                let read = short.unwrap_or_else(|| image.read(cells, at.lane(lane).as_dvec3()));
                let weight = self.weights[lane];
                let part = weight * share * read.weight;
                said.sums[lane] += (factors[lane] * read.value).extend(part);
                if is_direct {
                    said.found[lane] = weight * read.weight;
                    said.saturated[lane] = weight * read.saturated;
                }
                if read.weakest > said.weakest && share > 0.0 {
                    said.weakest = read.weakest;
                }
            }
        }
        said
    }

    /// Cosine and sine of the turn from the azimuth of the incident direction to those of the images.
    #[inline]
    fn turn(&self) -> [Vec4; 2] {
        let from = azimuth(self.pair.0);
        let [a, b, c, d] = self.captured;
        let x = Vec4::new(a.azimuth.x, b.azimuth.x, c.azimuth.x, d.azimuth.x);
        let y = Vec4::new(a.azimuth.y, b.azimuth.y, c.azimuth.y, d.azimuth.y);
        let (cos, sin) = (from.x * x + from.y * y, from.x * y - from.y * x);
        // What has no azimuth is not turned.
        let is_none = (cos * cos + sin * sin).cmplt(Vec4::splat(0.5));
        [
            Vec4::select(is_none, Vec4::ONE, cos),
            Vec4::select(is_none, Vec4::ZERO, sin),
        ]
    }
}

/// Where four directions lie on the grid: the first of the four cells around each, and how much each counts.
struct Places {
    size: usize,
    /// The cosine, above 0 of what lies above the horizon.
    is_above: [f32; 4],
    /// Column and row of the first cell; the column is less than 0 where the grid ends.
    column: [f32; 4],
    row: [f32; 4],
    weights: [[f32; 4]; 4],
}

impl Places {
    #[inline]
    fn new(cells: &Cells, at: Directions) -> Self {
        let (size, x_axis) = (cells.disk.size(), cells.disk.x_axis().as_vec2());
        let half = Vec4::splat(size as f32 / 2.0);
        let scale = half / (Vec4::ONE + at.z.max(Vec4::ZERO)).sqrt();
        let x = (x_axis.x * at.x - x_axis.y * at.y) * scale + (half - 0.5);
        let y = (x_axis.y * at.x + x_axis.x * at.y) * scale + (half - 0.5);
        let (column, row) = (x.floor(), y.floor());
        let (tx, ty) = (x - column, y - row);
        let (sx, sy) = (Vec4::ONE - tx, Vec4::ONE - ty);
        let last = Vec4::splat((size - 1) as f32);
        let is_inside = column.min(row).cmpge(Vec4::ZERO) & column.max(row).cmplt(last);
        Self {
            size,
            is_above: at.z.to_array(),
            column: Vec4::select(is_inside, column, Vec4::NEG_ONE).to_array(),
            row: row.to_array(),
            weights: [
                (sx * sy).to_array(),
                (tx * sy).to_array(),
                (sx * ty).to_array(),
                (tx * ty).to_array(),
            ],
        }
    }

    /// The cells around one of them; `None` if the grid ends there.
    #[inline]
    fn four(&self, lane: usize) -> Option<Four> {
        let (column, row) = (self.column[lane], self.row[lane]);
        let [a, b, c, d] = &self.weights;
        (column >= 0.0).then(|| Four {
            column: column as u32 as usize,
            row: row as u32 as usize,
            size: self.size,
            weights: [a[lane], b[lane], c[lane], d[lane]],
        })
    }
}
