//! Images that are read by the million.
//!
//! # Design
//! A cell has its cosθo beside its f, so that reading between four cells touches nothing else; 0 stands where there is no value. Almost
//! all readings lie between four cells that have one: they take a short way, whose sums are those of [`Place::read`](super::captures::Place)
//! in the same order, to the bit.

use glam::{Vec2, Vec3, Vec4};

use super::captures::{Cells, Read, Readable};

/// A cell of a packed image.
pub(crate) trait PackedCell: Copy + Send + Sync {
    /// f of the `channels` in sr⁻¹ with the cosine by which the cell counts.
    fn pack(channels: &[f32], cosine: f32) -> Self;
    /// f in sr⁻¹; a single channel is repeated. What stands beside the three is of no meaning.
    fn f(self) -> Vec4;
    /// The cosine, 0 where there is no value.
    fn cosine(self) -> f32;
}

impl PackedCell for Vec4 {
    #[inline]
    fn pack(channels: &[f32], cosine: f32) -> Self {
        Vec3::from_slice(channels).extend(cosine)
    }

    #[inline]
    fn f(self) -> Vec4 {
        self
    }

    #[inline]
    fn cosine(self) -> f32 {
        self.w
    }
}

impl PackedCell for Vec2 {
    #[inline]
    fn pack(channels: &[f32], cosine: f32) -> Self {
        Self::new(channels[0], cosine)
    }

    #[inline]
    fn f(self) -> Vec4 {
        Vec4::splat(self.x)
    }

    #[inline]
    fn cosine(self) -> f32 {
        self.y
    }
}

/// Cells along a side of a block.
const SIDE: usize = 8;
/// Cells of a block of one image.
pub(crate) const BLOCK: usize = SIDE * SIDE;

/// Where cells stand: blocks of the disk one after the other, each with its cells of all images, [block, image, cell]. What is read for
/// directions near each other stands together then, in few pages of memory.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    images: usize,
    size: usize,
    /// Offset of each column, and of each row.
    columns: Vec<usize>,
    rows: Vec<usize>,
}

impl Layout {
    /// That of so many `images` of `size` cells a side.
    pub(crate) fn new(images: usize, size: usize) -> Self {
        let across = size.div_ceil(SIDE);
        let slab = images * BLOCK;
        Self {
            images,
            size,
            columns: (0..size).map(|at| at / SIDE * slab + at % SIDE).collect(),
            rows: (0..size)
                .map(|at| at / SIDE * across * slab + at % SIDE * SIDE)
                .collect(),
        }
    }

    /// Cells of a block of all images.
    pub(crate) const fn slab(&self) -> usize {
        self.images * BLOCK
    }

    /// Cells in all, those beside the disk included.
    pub(crate) fn len(&self) -> usize {
        self.size.div_ceil(SIDE).pow(2) * self.slab()
    }

    /// Packs one `block` of the image `f`, [cell, channel] in sr⁻¹, NaN where there is no value.
    pub(crate) fn pack<C: PackedCell>(&self, cells: &Cells, block: usize, f: &[f32], out: &mut [C]) {
        let (across, channels) = (self.size.div_ceil(SIDE), f.len() / (self.size * self.size));
        let (first_row, first_column) = (block / across * SIDE, block % across * SIDE);
        for row in first_row..(first_row + SIDE).min(self.size) {
            for column in first_column..(first_column + SIDE).min(self.size) {
                let cell = row * self.size + column;
                let f = &f[channels * cell..][..channels];
                if let Some(cosine) = cells.cosine(cell).filter(|_| !f[0].is_nan()) {
                    out[(row - first_row) * SIDE + column - first_column] = C::pack(f, cosine);
                }
            }
        }
    }
}

/// One image.
#[derive(Clone, Copy)]
pub(crate) struct Packed<'a, C> {
    layout: &'a Layout,
    cells: &'a [C],
    first: usize,
}

impl<'a, C: PackedCell> Packed<'a, C> {
    /// Image `row` of those whose `cells` lie by `layout`.
    #[inline]
    pub(crate) fn new(layout: &'a Layout, cells: &'a [C], row: usize) -> Self {
        Self {
            layout,
            cells,
            first: row * BLOCK,
        }
    }
}

/// The four cells around a direction, all of them on the grid: the first one, and bilinear weights.
#[derive(Clone, Copy)]
pub(crate) struct Four {
    pub(super) column: usize,
    pub(super) row: usize,
    /// Cells of a row.
    pub(super) size: usize,
    pub(super) weights: [f32; 4],
}

impl Four {
    /// The cells, each with its weight.
    pub(super) fn cells(&self) -> [(usize, f32); 4] {
        let [a, b, c, d] = self.weights;
        let first = self.row * self.size + self.column;
        let next = first + self.size;
        [(first, a), (first + 1, b), (next, c), (next + 1, d)]
    }
}

impl<C: PackedCell> Readable for Packed<'_, C> {
    #[inline]
    fn cell(&self, cell: usize) -> Option<(Vec3, u8)> {
        let (row, column) = (cell / self.layout.size, cell % self.layout.size);
        let cell = self.cells[self.first + self.layout.rows[row] + self.layout.columns[column]];
        (cell.cosine() > 0.0).then(|| (cell.f().truncate(), 0))
    }

    #[inline]
    fn read_four(&self, _cells: &Cells, four: &Four) -> Option<Read> {
        let (columns, rows) = (&self.layout.columns, &self.layout.rows);
        let (left, right) = (*columns.get(four.column)?, *columns.get(four.column + 1)?);
        let (near, far) = (*rows.get(four.row)?, *rows.get(four.row + 1)?);
        let (near, far) = (self.first + near, self.first + far);
        let a = *self.cells.get(near + left)?;
        let b = *self.cells.get(near + right)?;
        let c = *self.cells.get(far + left)?;
        let d = *self.cells.get(far + right)?;
        let (mut value, mut sum, mut cosines) = (Vec4::ZERO, 0.0, 0.0);
        for (cell, weight) in [
            (a, four.weights[0]),
            (b, four.weights[1]),
            (c, four.weights[2]),
            (d, four.weights[3]),
        ] {
            let cosine = cell.cosine();
            if cosine <= 0.0 {
                return None;
            }
            sum += weight;
            cosines += weight * cosine;
            value += weight * cosine * cell.f();
        }
        Some(Read {
            value: (value * (sum / cosines)).truncate(),
            weight: sum,
            ..Read::default()
        })
    }
}
