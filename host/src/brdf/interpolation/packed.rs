//! Images that are read by the million.
//!
//! # Design
//! A cell has f times its cosθo beside that cosine, so that reading between four cells touches nothing else and is one sum of products; the cosine is
//! not a number where there is no value. Almost all readings lie between four cells that have one: they take a short way, by which values are
//! those of [`Place::read`](super::captures::Place) but for rounding.

use glam::{Vec2, Vec3, Vec4};

use super::captures::{Cells, Readable};
use crate::base::eight::{floor, whole};

/// A cell of a packed image.
pub(crate) trait PackedCell: Copy + Send + Sync {
    /// One without a value.
    const MISSING: Self;
    /// f of the `channels` in sr⁻¹ with the cosine by which the cell counts.
    fn pack(channels: &[f32], cosine: f32) -> Self;
    /// f in sr⁻¹ times the cosine, and the cosine; a single channel is repeated.
    fn weighted(self) -> Vec4;
}

impl PackedCell for Vec4 {
    const MISSING: Self = Self::NAN;

    #[inline]
    fn pack(channels: &[f32], cosine: f32) -> Self {
        (cosine * Vec3::from_slice(channels)).extend(cosine)
    }

    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn weighted(self) -> Vec4 {
        self
    }
}

impl PackedCell for Vec2 {
    const MISSING: Self = Self::NAN;

    #[inline]
    fn pack(channels: &[f32], cosine: f32) -> Self {
        Self::new(cosine * channels[0], cosine)
    }

    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn weighted(self) -> Vec4 {
        Vec4::new(self.x, self.x, self.x, self.y)
    }
}

/// Cells along a side of a block that begin in it. It holds those after them too, so that four cells around a place are in one block.
const SIDE: usize = 8;
/// Cells along a side of a block.
const LINE: usize = SIDE + 1;
/// Cells of a block of one image.
pub(crate) const BLOCK: usize = LINE * LINE;
/// Cells from the first of the four around a place to the last.
const SPAN: usize = LINE + 2;

/// Where cells stand in memory: that in a column and a row is number `inside` of block `block`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Strides {
    /// Cells from one block to the next.
    block: u32,
    /// Blocks from one row of them to the next.
    band: f32,
}

// Inlined whatever the compiler thinks of it: a function of its own would not be compiled for the processor that is there.
#[allow(clippy::inline_always)]
impl Strides {
    /// Those of images of `size` cells a side whose rows follow each other: each is a block.
    pub(crate) const fn rows(size: usize) -> Self {
        Self {
            block: size as u32,
            band: 1.0,
        }
    }

    /// Where the cells in these columns and rows stand, of images such as `R`.
    #[inline(always)]
    pub(super) fn first<R: Readable>(self, column: Vec4, row: Vec4) -> [u32; 4] {
        let (block, inside) = if R::IS_BLOCKED {
            let part = 1.0 / SIDE as f32;
            let (across, down) = (floor(column * part), floor(row * part));
            let (x, y) = (column - SIDE as f32 * across, row - SIDE as f32 * down);
            (across + self.band * down, x + LINE as f32 * y)
        } else {
            (row, column)
        };
        let ([a, b, c, d], [e, f, g, h]) = (whole(block), whole(inside));
        let at = |block: u32, inside: u32| block.wrapping_mul(self.block).wrapping_add(inside);
        [at(a, e), at(b, f), at(c, g), at(d, h)]
    }
}

/// Where cells stand: blocks of the disk one after the other, each with its cells of all images, [block, image, cell]. What is read for directions near each other stands together then, in few pages of
/// memory.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    images: usize,
    size: usize,
}

impl Layout {
    /// That of so many `images` of `size` cells a side.
    pub(crate) const fn new(images: usize, size: usize) -> Self {
        Self { images, size }
    }

    /// Blocks along a side of the disk.
    const fn across(&self) -> usize {
        self.size.div_ceil(SIDE)
    }

    /// Cells of a block of all images.
    pub(crate) const fn slab(&self) -> usize {
        self.images * BLOCK
    }

    /// Cells in all, those beside the disk included.
    pub(crate) const fn len(&self) -> usize {
        self.across() * self.across() * self.slab()
    }

    pub(crate) const fn strides(&self) -> Strides {
        Strides {
            block: self.slab() as u32,
            band: self.across() as f32,
        }
    }

    /// Packs one `block` of the image `f`, [cell, channel] in sr⁻¹, NaN where there is no value.
    pub(crate) fn pack<C: PackedCell>(&self, cells: &Cells, block: usize, f: &[f32], out: &mut [C]) {
        let channels = f.len() / (self.size * self.size);
        let (first_row, first_column) = (block / self.across() * SIDE, block % self.across() * SIDE);
        for row in first_row..(first_row + LINE).min(self.size) {
            for column in first_column..(first_column + LINE).min(self.size) {
                let cell = row * self.size + column;
                let f = &f[channels * cell..][..channels];
                if let Some(cosine) = cells.cosine(cell).filter(|_| !f[0].is_nan()) {
                    out[(row - first_row) * LINE + column - first_column] = C::pack(f, cosine);
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

/// The four cells around a direction: where the first one stands by the [`Strides`] of the image, of none at a place beyond all, and
/// bilinear weights.
#[derive(Clone, Copy, Default)]
pub(crate) struct Four {
    pub(super) weights: Vec4,
    pub(super) first: u32,
}

impl Four {
    /// The cells of images whose rows follow each other ([`Strides::rows`]); `None` where the grid ends.
    pub(super) fn cells(&self, cells: &Cells) -> Option<[usize; 4]> {
        let first = self.first as usize;
        let next = first + cells.disk.size();
        (next + 1 < cells.disk.len()).then_some([first, first + 1, next, next + 1])
    }
}

impl<C: PackedCell> Readable for Packed<'_, C> {
    const HAS_CODES: bool = false;
    const IS_BLOCKED: bool = true;

    #[inline]
    fn cell(&self, _cells: &Cells, cell: usize) -> Option<(Vec4, u8)> {
        let (row, column) = (cell / self.layout.size, cell % self.layout.size);
        let block = row / SIDE * self.layout.across() + column / SIDE;
        let at = row % SIDE * LINE + column % SIDE;
        let cell = self.cells[block * self.layout.slab() + self.first + at].weighted();
        (cell.w > 0.0).then_some((cell, 0))
    }

    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn corners(&self, _cells: &Cells, four: &Four) -> Vec4 {
        let first = self.first + four.first as usize;
        let span: Option<&[C; SPAN]> = self.cells.get(first..first + SPAN).and_then(<[C]>::as_array);
        let Some(span) = span else {
            return Vec4::NAN;
        };
        let [a, b, c, d] = four.weights.to_array();
        let near = a * span[0].weighted() + b * span[1].weighted();
        near + c * span[LINE].weighted() + d * span[LINE + 1].weighted()
    }
}
