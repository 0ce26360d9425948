//! Directions and solid angles of all pixels of a view.
//!
//! # Design
//! Built once and then looked up, for who needs every pixel; the projector's, of which few are lit, are traced in
//! [`super::DirectionTiles`]. Corners are shared by neighbouring pixels, so the whole map costs two traces
//! per pixel. Rows are traced in parallel; the result does not depend on the number of threads.
//!
//! # Tradeoffs
//! `f64` throughout, 40 bytes per pixel (168 MB for 2048 × 2048), for a round trip to 10⁻⁹ rad.

use std::ops::Range;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::solid_angle::quadrilateral_sr;
use super::{Unmeasurable, View};

/// All pixel centres of a view, row by row from the top, u fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct DirectionMap {
    /// Width of the image, pixels.
    pub width_px: usize,
    /// Height of the image, pixels.
    pub height_px: usize,
    /// Direction of each pixel's centre (sample frame, unit, away from the surface), or why there is none;
    /// [height × width], index `row * width_px + column`.
    pub directions: Vec<Result<DVec3, Unmeasurable>>,
    /// Solid angle of each pixel at the sample in steradians, 0 where there is no direction; indexed like
    /// `directions`.
    pub solid_angles_sr: Vec<f64>,
}

impl DirectionMap {
    /// Traces every pixel of `view`.
    pub fn of(view: &View) -> DirectionMap {
        let (width_px, height_px) = view.size_px();
        let bands = rayon::current_num_threads().saturating_mul(8).max(1);
        let band_rows = height_px.div_ceil(bands).max(1);
        let (directions, solid_angles_sr) = (0..height_px.div_ceil(band_rows))
            .into_par_iter()
            .flat_map_iter(|band| {
                let rows = band * band_rows..((band + 1) * band_rows).min(height_px);
                trace_rows(view, 0..width_px, rows)
            })
            .unzip();
        DirectionMap {
            width_px,
            height_px,
            directions,
            solid_angles_sr,
        }
    }

    /// Direction of the pixel in column `column` and row `row`; pixels outside have the reason for it.
    ///
    /// # Errors
    /// The reason why the pixel's centre sees no direction.
    pub fn direction(&self, column: usize, row: usize) -> Result<DVec3, Unmeasurable> {
        if column >= self.width_px {
            return Err(Unmeasurable::OutsideImage);
        }
        self.directions
            .get(row * self.width_px + column)
            .copied()
            .unwrap_or(Err(Unmeasurable::OutsideImage))
    }

    /// Index, direction and solid angle (steradians) of every measurable pixel, in order.
    pub fn measurable(&self) -> impl Iterator<Item = (usize, DVec3, f64)> + '_ {
        let pixels = self.directions.iter().zip(&self.solid_angles_sr).enumerate();
        pixels.filter_map(|(index, (direction, &sr))| direction.ok().map(|direction| (index, direction, sr)))
    }

    /// Code of each pixel's reason as files have it, 0 = measurable; indexed like `directions`.
    pub fn reason_codes(&self) -> Vec<u8> {
        self.directions
            .iter()
            .map(|direction| direction.err().map_or(0, Unmeasurable::code))
            .collect()
    }

    /// Solid angle of all measurable pixels together, steradians.
    pub fn total_sr(&self) -> f64 {
        self.solid_angles_sr.iter().sum()
    }
}

/// Direction and solid angle of the pixels of a rectangle, row by row. A row hands its lower corners on to the next.
pub(super) fn trace_rows(
    view: &View,
    columns: Range<usize>,
    rows: Range<usize>,
) -> impl Iterator<Item = (Result<DVec3, Unmeasurable>, f64)> {
    let Range { start, end } = columns;
    let corners = move |row: usize| -> Vec<Option<DVec3>> {
        (start..=end).map(|column| corner(view, column, row)).collect()
    };
    let mut upper = corners(rows.start);
    rows.flat_map(move |row| {
        let lower = corners(row + 1);
        let traced = trace_row(view, start, row, &upper, &lower);
        upper = lower;
        traced
    })
}

/// Direction of the upper left corner of a pixel, on the whole ellipsoid.
fn corner(view: &View, column: usize, row: usize) -> Option<DVec3> {
    view.reflect_pixel(DVec2::new(column as f64, row as f64))
        .map(|found| found.direction)
}

fn trace_row(
    view: &View,
    first_column: usize,
    row: usize,
    upper: &[Option<DVec3>],
    lower: &[Option<DVec3>],
) -> Vec<(Result<DVec3, Unmeasurable>, f64)> {
    let columns = upper.windows(2).zip(lower.windows(2)).enumerate();
    columns
        .map(|(column, (above, below))| {
            let centre = DVec2::new((first_column + column) as f64 + 0.5, row as f64 + 0.5);
            let direction = view.direction(centre.x, centre.y);
            let sr = match (direction, above[0], above[1], below[1], below[0]) {
                (Err(_), ..) => 0.0,
                (Ok(_), Some(a), Some(b), Some(c), Some(d)) => quadrilateral_sr([a, b, c, d]),
                (Ok(_), ..) => view.small_square_sr(centre),
            };
            (direction, sr)
        })
        .collect()
}
