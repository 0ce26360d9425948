//! The fast map from image positions to directions.
//!
//! # Design
//! Directions are traced at the nodes of a square mesh, some pixels apart, and interpolated between them by bicubic
//! convolution (Keys, IEEE Trans. Acoust. Speech Signal Process. 29, 1981), which is exact for quadratic functions. The
//! mesh is halved until the interpolated directions, compared with traced ones at the places that are farthest from all
//! nodes, are within the wanted tolerance; the largest deviation found is the table's stated error.
//! What is measurable is not smooth. Squares of the mesh that an edge may cross (hole, rim, wire, horizon, border of the
//! sample) are traced as ever: the table never takes another side of an edge than [`View::direction`].
//!
//! # Tradeoffs
//! Nodes are f32, four lanes wide, which doubles the speed and leaves an error of some 1e-7 rad whatever the mesh.
//! A square counts as whole if a lattice of its points is measurable: an obstacle narrower than the lattice could slip
//! through. It is half a pixel, and no pixel resolves what is smaller.

use glam::{DVec3, Vec3A};
use rayon::prelude::*;

use super::{Unmeasurable, View};

/// Pixels between the nodes of the coarsest and of the finest mesh that is tried.
const SPACINGS_PX: [usize; 4] = [16, 8, 4, 2];
/// Places within a square where the error is measured, as shares of its side.
const PROBES: [f64; 3] = [0.25, 0.5, 0.75];

/// A table of directions of one view.
#[derive(Debug, Clone)]
pub struct DirectionTable {
    view: View,
    spacing_px: usize,
    per_px: f64,
    /// Nodes in a row and squares in a row; there is one node around all squares.
    columns: usize,
    squares: usize,
    /// Traced directions, [row, column], not to be used where a square is not whole.
    nodes: Vec<Vec3A>,
    /// Whether every position in a square is measurable, [row, column].
    whole: Vec<bool>,
    max_error_rad: f64,
}

impl DirectionTable {
    /// A table of `view` whose directions are within `tolerance_rad` radians of the traced ones, if a mesh of 2 pixels can
    /// do that; [`max_error_rad`](Self::max_error_rad) says what was reached.
    #[must_use]
    pub fn new(view: &View, tolerance_rad: f64) -> Self {
        let mut table = None;
        for spacing_px in SPACINGS_PX {
            let finer = Self::with_spacing(view, spacing_px);
            let is_good = finer.max_error_rad <= tolerance_rad;
            table = Some(finer);
            if is_good {
                break;
            }
        }
        table.expect("invariant: there are spacings")
    }

    fn with_spacing(view: &View, spacing_px: usize) -> Self {
        let size = |px: u32| (px as usize).div_ceil(spacing_px);
        let (squares, rows) = (size(view.pinhole().width_px()), size(view.pinhole().height_px()));
        let columns = squares + 3;
        let node = |row: usize, column: usize| {
            let at = |index: usize| (index as f64 - 1.0) * spacing_px as f64;
            view.reflect_pixel(glam::DVec2::new(at(column), at(row)))
                .map_or(Vec3A::NAN, |found| view.to_sample(found.direction).as_vec3a())
        };
        let nodes = (0..(rows + 3) * columns)
            .into_par_iter()
            .map(|index| node(index / columns, index % columns))
            .collect();
        let mut table = Self {
            view: view.clone(),
            spacing_px,
            per_px: (spacing_px as f64).recip(),
            columns,
            squares,
            nodes,
            whole: Vec::new(),
            max_error_rad: 0.0,
        };
        let found: Vec<(bool, f64)> = (0..rows * squares)
            .into_par_iter()
            .map(|index| table.probe(index / squares, index % squares))
            .collect();
        table.max_error_rad = found.iter().map(|found| found.1).fold(0.0, f64::max);
        table.whole = found.into_iter().map(|found| found.0).collect();
        table
    }

    /// Whether a square is whole, and the largest deviation found in it, radians.
    fn probe(&self, row: usize, column: usize) -> (bool, f64) {
        let (u_px, v_px) = ((column * self.spacing_px) as f64, (row * self.spacing_px) as f64);
        let lattice = 2 * self.spacing_px;
        // The far sides belong to the next squares, and that of the last ones to no pixel.
        let is_whole = (0..=lattice).all(|y| {
            (0..=lattice).all(|x| {
                let at =
                    |start: f64, step: usize| start + (step as f64 / 2.0).min(self.spacing_px as f64 - 1e-9);
                self.view.direction(at(u_px, x), at(v_px, y)).is_ok()
            })
        });
        if !is_whole {
            return (false, 0.0);
        }
        let mut error_rad = 0.0_f64;
        for y in PROBES {
            for x in PROBES {
                let traced = self.view.direction(
                    u_px + x * self.spacing_px as f64,
                    v_px + y * self.spacing_px as f64,
                );
                let missed = traced.map_or(f64::INFINITY, |w| {
                    (self.interpolated(row, column, x, y) - w).length()
                });
                error_rad = error_rad.max(missed);
            }
        }
        // An infinite error is a mesh that reaches where no ray goes: the square is traced.
        (
            error_rad.is_finite(),
            if error_rad.is_finite() { error_rad } else { 0.0 },
        )
    }

    /// Largest deviation from the traced directions that was found, radians.
    #[must_use]
    pub const fn max_error_rad(&self) -> f64 {
        self.max_error_rad
    }

    /// As [`View::direction`], within [`max_error_rad`](Self::max_error_rad).
    ///
    /// # Errors
    /// As there.
    #[inline]
    pub fn direction(&self, u_px: f64, v_px: f64) -> Result<DVec3, Unmeasurable> {
        let (x, y) = (u_px * self.per_px, v_px * self.per_px);
        // Positions off the image end beyond the table or, if negative or not numbers, in its first square.
        let (column, row) = (x as usize, y as usize);
        let is_whole = column < self.squares
            && x >= 0.0
            && y >= 0.0
            && row < self.whole.len()
            && self
                .whole
                .get(row * self.squares + column)
                .is_some_and(|whole| *whole);
        if is_whole {
            Ok(self.interpolated(row, column, x - column as f64, y - row as f64))
        } else {
            self.view.direction(u_px, v_px)
        }
    }

    /// The direction at the shares (`x`, `y`) of a square's sides.
    #[inline]
    fn interpolated(&self, row: usize, column: usize, x: f64, y: f64) -> DVec3 {
        let (across, down) = (weights(x as f32), weights(y as f32));
        let mut sum = Vec3A::ZERO;
        for (step, weight) in down.into_iter().enumerate() {
            let first = (row + step) * self.columns + column;
            let nodes = &self.nodes[first..first + 4];
            sum += weight
                * (across[0] * nodes[0] + across[1] * nodes[1] + across[2] * nodes[2] + across[3] * nodes[3]);
        }
        sum.as_dvec3().normalize()
    }
}

/// Weights of four nodes at −1, 0, 1, 2 for the place `t` between 0 and 1.
#[inline]
fn weights(t: f32) -> [f32; 4] {
    let (tt, ttt) = (t * t, t * t * t);
    [
        0.5 * (2.0 * tt - ttt - t),
        0.5 * (3.0 * ttt - 5.0 * tt + 2.0),
        0.5 * (4.0 * tt - 3.0 * ttt + t),
        0.5 * (ttt - tt),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::angle_between;
    use crate::instrument::rig::{PRESETS, Rig};

    #[test]
    fn the_table_is_as_good_as_it_says_and_knows_every_edge() {
        for name in PRESETS {
            let mut rig = Rig::load(name).unwrap().with_image_size(300).unwrap();
            rig.camera.lens.distortion = [-0.15, 0.08, 0.001, -0.0015, 0.02];
            rig.camera.lens.offset_m = [1e-4, -2e-4, 3e-4];
            rig.camera.lens.focal_px *= 0.9;
            let view = View::camera(&rig);
            let table = DirectionTable::new(&view, 1e-5);
            assert!(table.max_error_rad() <= 1e-5, "{name}: {}", table.max_error_rad());
            let whole = table.whole.iter().filter(|whole| **whole).count();
            assert!(
                whole > table.whole.len() / 3,
                "{name}: {whole} of {}",
                table.whole.len()
            );
            for step in 0..90_000 {
                // Irrational strides reach every place within the squares.
                let (u_px, v_px) = (
                    f64::from(step) * 0.618_034 % 1.0 * 300.0,
                    f64::from(step) * 0.003_33,
                );
                match (table.direction(u_px, v_px), view.direction(u_px, v_px)) {
                    (Ok(fast), Ok(traced)) => {
                        assert!(angle_between(fast, traced) <= 1.5 * table.max_error_rad() + 1e-12);
                    }
                    (fast, traced) => assert_eq!(fast, traced, "{name} {u_px} {v_px}"),
                }
            }
        }
    }

    #[test]
    fn a_finer_tolerance_is_kept_by_a_finer_mesh() {
        let view = View::camera(&Rig::load("rcg-1-16bit").unwrap().with_image_size(512).unwrap());
        let (coarse, fine) = (DirectionTable::new(&view, 1e-3), DirectionTable::new(&view, 1e-7));
        assert!(fine.spacing_px < coarse.spacing_px);
        assert!(fine.max_error_rad() < coarse.max_error_rad());
    }

    #[test]
    fn positions_off_the_image_have_no_direction() {
        let view = View::camera(&Rig::load("rcg-2").unwrap().with_image_size(64).unwrap());
        let table = DirectionTable::new(&view, 1e-5);
        for (u_px, v_px) in [
            (-0.5, 32.0),
            (32.0, -1e9),
            (64.0, 32.0),
            (32.0, 1e300),
            (f64::NAN, 32.0),
        ] {
            assert_eq!(table.direction(u_px, v_px), Err(Unmeasurable::OutsideImage));
        }
    }
}
