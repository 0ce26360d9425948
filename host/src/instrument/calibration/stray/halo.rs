//! A halo: sums of Gaussians of an image.
//!
//! # Design
//! Gaussians are products of one along x and one along y, and what they make is smooth: each is computed on a coarser grid on
//! which it is three pixels wide, and interpolated linearly. An axis of that is a band of weights (`Band`), which averages,
//! spreads and at last interpolates. Outside the image it is dark.

use glam::Vec4;

use super::WIDTHS;

/// Standard width of a Gaussian on its grid, pixels …
const GRID_PX: f64 = 3.0;
/// … and on how many at least.
const LEAST_PX: usize = 8;
/// A Gaussian ends here, standard widths.
const END: f64 = 4.0;

/// The halos of images of one size, one for each of [`WIDTHS`].
#[derive(Debug)]
pub(crate) struct Halo {
    width_px: usize,
    /// Along x and y.
    gaussians: Vec<[Axis; 2]>,
}

/// Images in between.
#[derive(Debug, Default)]
pub(crate) struct Room {
    rows: Vec<Vec4>,
    grid: Vec<Vec4>,
}

impl Halo {
    /// For images of this size.
    pub(crate) fn new(width_px: usize, height_px: usize) -> Self {
        // Widths are relative to half the image's width along both axes.
        let axis = |size_px: usize, width: f64| Axis::new(size_px, width * width_px as f64 / 2.0);
        Self {
            width_px,
            gaussians: WIDTHS
                .map(|width| [axis(width_px, width), axis(height_px, width)])
                .into(),
        }
    }

    /// The sum of all Gaussians of `image` with these `shares` into `out`.
    pub(crate) fn of(&self, image: &[Vec4], shares: &[Vec4], out: &mut Vec<Vec4>, room: &mut Room) {
        out.clear();
        out.resize(image.len(), Vec4::ZERO);
        for (place, share) in shares.iter().enumerate() {
            if *share != Vec4::ZERO {
                self.add(place, image, *share, out, room);
            }
        }
    }

    /// Adds the Gaussian of this `place` among [`WIDTHS`] of `image`, × `share`, to `out`.
    pub(crate) fn add(&self, place: usize, image: &[Vec4], share: Vec4, out: &mut [Vec4], room: &mut Room) {
        let [x, y] = &self.gaussians[place];
        let (columns, rows) = (x.spread.rows.len(), y.spread.rows.len());
        // [row of the image, column of the grid], then [row, column] of the grid.
        room.rows.clear();
        for row in image.chunks_exact(self.width_px) {
            room.rows
                .extend((0..columns).map(|column| x.spread.dot(column, row, 1)));
        }
        room.grid.clear();
        for row in 0..rows {
            room.grid
                .extend((0..columns).map(|column| y.spread.dot(row, &room.rows[column..], columns)));
        }
        let mut between = vec![Vec4::ZERO; columns];
        for (row, out) in out.chunks_exact_mut(self.width_px).enumerate() {
            for (column, between) in between.iter_mut().enumerate() {
                *between = y.interpolate.dot(row, &room.grid[column..], columns);
            }
            for (column, out) in out.iter_mut().enumerate() {
                *out += share * x.interpolate.dot(column, &between, 1);
            }
        }
    }
}

/// One axis of a Gaussian.
#[derive(Debug)]
struct Axis {
    /// From pixels to the grid.
    spread: Band,
    /// And back.
    interpolate: Band,
}

impl Axis {
    /// Of `width_px` pixels standard width, along `size_px` pixels.
    fn new(size_px: usize, width_px: f64) -> Self {
        let wanted = (size_px as f64 * GRID_PX / width_px).ceil() as usize;
        let grid = wanted.clamp(LEAST_PX.min(size_px), size_px);
        let pitch = size_px as f64 / grid as f64;
        let integral = |at: f64| 0.5 * erf(at / (std::f64::consts::SQRT_2 * width_px));
        let spread = (0..grid).map(|place| {
            let middle = (place as f64 + 0.5) * pitch;
            let reach = END * width_px + 1.0;
            let first = (middle - reach).floor().max(0.0) as usize;
            let last = ((middle + reach).ceil() as usize).min(size_px);
            let weight = |pixel: usize| {
                let from = pixel as f64 - middle;
                (integral(from + 1.0) - integral(from)) as f32
            };
            (first, (first..last).map(weight).collect())
        });
        let interpolate = (0..size_px).map(|pixel| {
            // Beyond the middles of the outermost pixels of the grid it goes on as straight.
            let at = (pixel as f64 + 0.5) / pitch - 0.5;
            let first = (at.max(0.0) as usize).min(grid.saturating_sub(2));
            let share = (at - first as f64) as f32;
            (
                first,
                if grid > 1 {
                    vec![1.0 - share, share]
                } else {
                    vec![1.0]
                },
            )
        });
        Self {
            spread: Band {
                rows: spread.collect(),
            },
            interpolate: Band {
                rows: interpolate.collect(),
            },
        }
    }
}

/// A matrix with weights about its diagonal: of each row the first column, and the weights from there on.
#[derive(Debug)]
struct Band {
    rows: Vec<(usize, Vec<f32>)>,
}

impl Band {
    /// A row times every `step`-th of `values`.
    fn dot(&self, row: usize, values: &[Vec4], step: usize) -> Vec4 {
        let (first, weights) = &self.rows[row];
        let mut sum = Vec4::ZERO;
        for (weight, value) in weights.iter().zip(values[first * step..].iter().step_by(step)) {
            sum += *value * *weight;
        }
        sum
    }
}

/// The error function to 1.5·10⁻⁷ (Abramowitz and Stegun, 7.1.26).
pub(super) fn erf(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x.abs());
    let poly = [
        1.061_405_429,
        -1.453_152_027,
        1.421_413_741,
        -0.284_496_736,
        0.254_829_592,
    ];
    let sum = poly.iter().fold(0.0, |sum, c| (sum + c) * t);
    (1.0 - sum * (-x * x).exp()).copysign(x)
}
