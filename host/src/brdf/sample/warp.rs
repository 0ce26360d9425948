//! Bilinear tables over the unit square, and the warp that a piecewise-bilinear density defines.
//!
//! Positions are (x, y) ∈ [0,1]²; x runs along the last axis of a table (its columns), y along the axis before it
//! (its rows). Values stand at the vertices: column i of n is at x = i/(n−1).
//!
//! The warp carries uniform points s to points u distributed like the density p: `s_y` is the marginal cumulative
//! distribution of the rows up to `u_y`, `s_x` the conditional one up to `u_x` within the row at `u_y`. Along a line of a
//! bilinear patch p is linear, so both are quadratic inside a cell and known exactly, and so are their inverses. Look-ups take u → s,
//! writers of tables s → u.
//!
//! Source: J. Dupuy and W. Jakob, "An adaptive parameterization for efficient material acquisition and
//! rendering", ACM TOG 37(6), 2018.

/// Cell index and position inside the cell, 0–1, of coordinate `t` on an axis of `vertices` ≥ 2 vertices.
///
/// Clamps `t` to [0,1].
fn cell(t: f64, vertices: usize) -> (usize, f64) {
    let at = t.clamp(0.0, 1.0) * (vertices - 1) as f64;
    let index = (at as usize).min(vertices - 2);
    (index, at - index as f64)
}

/// a at t = 0, b at t = 1.
fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + t * (b - a)
}

/// Where inside a cell, 0–1, the integral of a density that is linear from `low` to `high` reaches `area`.
fn reached(low: f64, high: f64, area: f64) -> f64 {
    let root = (low * low + 2.0 * (high - low) * area).max(0.0).sqrt();
    // Not divided by the slope, which may be 0.
    if low + root > 0.0 {
        (2.0 * area / (low + root)).clamp(0.0, 1.0)
    } else {
        0.0
    }
}

/// Bilinear interpolation of the four neighbours of a position among `rows` × `columns` vertices.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Patch {
    /// Index of the vertex at the lower corner, in row-major order.
    corner: usize,
    columns: usize,
    tx: f64,
    ty: f64,
}

impl Patch {
    /// The patch around (x, y), clamped to [0,1]².
    pub(crate) fn at(x: f64, y: f64, rows: usize, columns: usize) -> Self {
        let (column, tx) = cell(x, columns);
        let (row, ty) = cell(y, rows);
        Self {
            corner: row * columns + column,
            columns,
            tx,
            ty,
        }
    }

    /// The two rows of two vertices each that surround the position.
    fn corners<'a, T>(&self, vertices: &'a [T]) -> (&'a [T], &'a [T]) {
        let next = self.corner + self.columns;
        (&vertices[self.corner..self.corner + 2], &vertices[next..next + 2])
    }

    /// The interpolated value of a one-channel table.
    pub(crate) fn value(&self, vertices: &[f32]) -> f64 {
        let (low, high) = self.corners(vertices);
        lerp(
            lerp(f64::from(low[0]), f64::from(low[1]), self.tx),
            lerp(f64::from(high[0]), f64::from(high[1]), self.tx),
            self.ty,
        )
    }

    /// The interpolated values of a three-channel table.
    pub(crate) fn values(&self, vertices: &[[f32; 3]]) -> [f64; 3] {
        let (low, high) = self.corners(vertices);
        std::array::from_fn(|c| {
            lerp(
                lerp(f64::from(low[0][c]), f64::from(low[1][c]), self.tx),
                lerp(f64::from(high[0][c]), f64::from(high[1][c]), self.tx),
                self.ty,
            )
        })
    }
}

/// Density and, beside it because both are looked up together, its integral along the row from x = 0.
#[derive(Debug, Clone, Copy, Default)]
struct Vertex {
    density: f64,
    cumulative: f64,
}

/// A row of vertices as a whole.
#[derive(Debug, Clone, Copy, Default)]
struct Row {
    /// Integral over the row, x from 0 to 1.
    total: f64,
    /// Integral of `total` over y from 0 to this row.
    cumulative: f64,
}

/// A piecewise-bilinear density over the unit square with its cumulative distributions.
#[derive(Debug)]
pub(crate) struct Density {
    columns: usize,
    vertices: Vec<Vertex>,
    rows: Vec<Row>,
    /// 1/(columns − 1) and 1/(rows − 1).
    cell_width: f64,
    cell_height: f64,
    inv_total: f64,
}

impl Density {
    /// From non-negative `densities` at the vertices, row by row, at least 2×2 of them; `None` if all are zero.
    ///
    /// They need not be normalised.
    pub(crate) fn new(densities: &[f32], columns: usize) -> Option<Self> {
        let cell_width = 1.0 / (columns - 1) as f64;
        let cell_height = 1.0 / (densities.len() / columns - 1) as f64;
        let mut vertices = Vec::with_capacity(densities.len());
        let mut rows: Vec<Row> = Vec::with_capacity(densities.len() / columns);
        for densities in densities.chunks_exact(columns) {
            let mut total = 0.0;
            let mut before = None;
            for density in densities.iter().copied().map(f64::from) {
                total += before.map_or(0.0, |before| 0.5 * cell_width * (before + density));
                vertices.push(Vertex {
                    density,
                    cumulative: total,
                });
                before = Some(density);
            }
            let cumulative = rows.last().map_or(0.0, |below| {
                below.cumulative + 0.5 * cell_height * (below.total + total)
            });
            rows.push(Row { total, cumulative });
        }
        let total = rows.last().map_or(0.0, |row| row.cumulative);
        (total > 0.0).then(|| Self {
            columns,
            vertices,
            rows,
            cell_width,
            cell_height,
            inv_total: 1.0 / total,
        })
    }

    /// The mean of `densities` of one size, each normalised to an integral of 1, with weights that sum to 1.
    ///
    /// Nothing is integrated again: the integrals of a sum are the sums of the integrals.
    pub(crate) fn mean<'a>(densities: impl Iterator<Item = (&'a Self, f64)>) -> Option<Self> {
        let mut mean: Option<Self> = None;
        for (density, weight) in densities {
            let mean = mean.get_or_insert_with(|| Self {
                vertices: vec![Vertex::default(); density.vertices.len()],
                rows: vec![Row::default(); density.rows.len()],
                inv_total: 1.0,
                ..*density
            });
            let weight = weight * density.inv_total;
            for (sum, vertex) in mean.vertices.iter_mut().zip(&density.vertices) {
                sum.density += weight * vertex.density;
                sum.cumulative += weight * vertex.cumulative;
            }
            for (sum, row) in mean.rows.iter_mut().zip(&density.rows) {
                sum.total += weight * row.total;
                sum.cumulative += weight * row.cumulative;
            }
        }
        mean
    }

    /// The uniform point (`s_x`, `s_y`) ∈ [0,1]² that the warp carries to (`x`, `y`), clamped to [0,1]².
    pub(crate) fn invert(&self, x: f64, y: f64) -> (f64, f64) {
        self.integrals(x, y).shares(x)
    }

    /// The point (x, y) ∈ [0,1]² to which the warp carries the uniform (`s_x`, `s_y`), clamped to [0,1]²: what [`invert`](Self::invert) undoes.
    pub(crate) fn warp(&self, s_x: f64, s_y: f64) -> (f64, f64) {
        let share = s_y.clamp(0.0, 1.0) / self.inv_total;
        let row = self.rows.partition_point(|row| row.cumulative <= share);
        let row = row.saturating_sub(1).min(self.rows.len() - 2);
        let (below, above) = (self.rows[row], self.rows[row + 1]);
        let ty = reached(
            below.total,
            above.total,
            (share - below.cumulative) / self.cell_height,
        );
        let (low, high) = self.vertices[row * self.columns..].split_at(self.columns);
        let share = s_x.clamp(0.0, 1.0) * lerp(below.total, above.total, ty);
        let cumulative = |column: usize| lerp(low[column].cumulative, high[column].cumulative, ty);
        let density = |column: usize| lerp(low[column].density, high[column].density, ty);
        let (mut column, mut end) = (0, self.columns - 1);
        while end - column > 1 {
            let middle = usize::midpoint(column, end);
            *(if cumulative(middle) <= share {
                &mut column
            } else {
                &mut end
            }) = middle;
        }
        let area = (share - cumulative(column)) / self.cell_width;
        let tx = reached(density(column), density(column + 1), area);
        let y = (row as f64 + ty) * self.cell_height;
        ((column as f64 + tx) * self.cell_width, y)
    }

    /// The density at (`x`, `y`) with an integral of 1, clamped to [0,1]².
    pub(crate) fn at(&self, x: f64, y: f64) -> f64 {
        let (column, tx) = cell(x, self.columns);
        let (row, ty) = cell(y, self.rows.len());
        let of = |corner: usize| {
            let [left, right] = [corner, corner + 1].map(|at| self.vertices[at].density);
            lerp(left, right, tx)
        };
        let corner = row * self.columns + column;
        lerp(of(corner), of(corner + self.columns), ty) * self.inv_total
    }

    /// The densities at the vertices with an integral of 1, row by row.
    pub(crate) fn densities(&self) -> impl Iterator<Item = f32> + '_ {
        let densities = self.vertices.iter().map(|vertex| vertex.density);
        densities.map(|density| (density * self.inv_total) as f32)
    }

    /// Rows of vertices.
    pub(crate) fn rows(&self) -> usize {
        self.rows.len()
    }

    /// Vertices of a row.
    pub(crate) fn columns(&self) -> usize {
        self.columns
    }

    /// `mean(densities).invert(x, y)` for a single position, without the mean of all vertices.
    pub(crate) fn invert_mean<'a>(
        densities: impl Iterator<Item = (&'a Self, f64)>,
        x: f64,
        y: f64,
    ) -> (f64, f64) {
        let mut sum = Integrals::default();
        for (density, weight) in densities {
            let integrals = density.integrals(x, y);
            sum.up_to_x += weight * integrals.up_to_x;
            sum.line += weight * integrals.line;
            sum.up_to_y += weight * integrals.up_to_y;
        }
        sum.shares(x)
    }

    /// The integrals of the normalised density at (`x`, `y`), clamped to [0,1]².
    fn integrals(&self, x: f64, y: f64) -> Integrals {
        let (column, tx) = cell(x, self.columns);
        let (row, ty) = cell(y, self.rows.len());
        let patch = Patch {
            corner: row * self.columns + column,
            columns: self.columns,
            tx,
            ty,
        };
        let (low, high) = patch.corners(&self.vertices);
        let (below, above) = (self.rows[row], self.rows[row + 1]);

        let left = lerp(low[0].density, high[0].density, ty);
        let right = lerp(low[1].density, high[1].density, ty);
        let up_to_cell = lerp(low[0].cumulative, high[0].cumulative, ty);
        let up_to_x = up_to_cell + self.cell_width * tx * (left + 0.5 * tx * (right - left));
        let up_to_y =
            below.cumulative + self.cell_height * ty * (below.total + 0.5 * ty * (above.total - below.total));
        Integrals {
            up_to_x: up_to_x * self.inv_total,
            line: lerp(below.total, above.total, ty) * self.inv_total,
            up_to_y: up_to_y * self.inv_total,
        }
    }
}

/// Integrals of a density with an integral of 1, at a position (x, y); linear in the density.
#[derive(Debug, Clone, Copy, Default)]
struct Integrals {
    /// Along the line at y, from 0 to x.
    up_to_x: f64,
    /// Along that whole line.
    line: f64,
    /// Over all lines from 0 to y.
    up_to_y: f64,
}

impl Integrals {
    /// The conditional and the marginal cumulative distribution at a position with this `x`.
    fn shares(self, x: f64) -> (f64, f64) {
        // An empty line has no distribution; the uniform one is as good as any.
        let s_x = if self.line > 0.0 {
            self.up_to_x / self.line
        } else {
            x
        };
        (s_x, self.up_to_y)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    impl Density {
        /// The forward warp, by bisection on the definition of the cumulative distributions: independent of the
        /// closed form inside a cell.
        fn sample(&self, s_x: f64, s_y: f64) -> (f64, f64) {
            let y = bisect(|y| self.invert(0.5, y).1 - s_y);
            (bisect(|x| self.line(x, y) / self.line(1.0, y) - s_x), y)
        }

        /// Integral of the density at height y from 0 to x, cell by cell with Simpson's rule.
        fn line(&self, x: f64, y: f64) -> f64 {
            let table: Vec<f32> = self.vertices.iter().map(|v| v.density as f32).collect();
            let p = |x: f64| Patch::at(x, y, self.rows.len(), self.columns).value(&table);
            let mut sum = 0.0;
            for i in 0..self.columns - 1 {
                let (from, to) = (
                    i as f64 * self.cell_width,
                    ((i + 1) as f64 * self.cell_width).min(x),
                );
                if to > from {
                    sum += (to - from) / 6.0 * (p(from) + 4.0 * p(0.5 * (from + to)) + p(to));
                }
            }
            sum
        }
    }

    fn bisect(g: impl Fn(f64) -> f64) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            *(if g(middle) < 0.0 { &mut low } else { &mut high }) = middle;
        }
        0.5 * (low + high)
    }

    proptest! {
        #[test]
        fn invert_undoes_sample(
            // Multiples of 1/8, exact in f32.
            table in prop::collection::vec((1_u8..80).prop_map(|v| f32::from(v) / 8.0), 4 * 5),
            s_x in 0.0..1.0, s_y in 0.0..1.0,
        ) {
            let density = Density::new(&table, 5).unwrap();
            let (x, y) = density.sample(s_x, s_y);
            let (found_x, found_y) = density.invert(x, y);
            prop_assert!((found_x - s_x).abs() < 1e-9 && (found_y - s_y).abs() < 1e-9);
            // The closed form goes where bisection finds it.
            let (closed_x, closed_y) = density.warp(s_x, s_y);
            prop_assert!((closed_x - x).abs() < 1e-9 && (closed_y - y).abs() < 1e-9);
        }

        #[test]
        fn invert_is_the_share_of_the_density(x in 0.0..=1.0, y in 0.0..=1.0) {
            // p(x, y) = (1 + 2x)(2 + y), bilinear: s_x = (x + x²)/2, s_y = (2y + y²/2)/2.5.
            let table: Vec<f32> = (0_u8..3)
                .flat_map(|j| (0_u8..5).map(move |i| (1.0 + f32::from(i) / 2.0) * (2.0 + f32::from(j) / 2.0)))
                .collect();
            let (s_x, s_y) = Density::new(&table, 5).unwrap().invert(x, y);
            prop_assert!((s_x - 0.5 * x * (1.0 + x)).abs() < 1e-12);
            prop_assert!((s_y - (2.0 * y + y * y / 2.0) / 2.5).abs() < 1e-12);
        }

        #[test]
        fn a_mean_of_densities_has_the_mean_of_their_shares(x in 0.0..=1.0, y in 0.0..=1.0, t in 0.0..=1.0) {
            // 1 everywhere, and 6x: with integrals of 1 they are 1 and 2x.
            let (even, steep) = ([1.0; 4], [0.0, 6.0, 0.0, 6.0]);
            let [even, steep] = [even, steep].map(|table| Density::new(&table, 2).unwrap());
            let both = [(&even, 1.0 - t), (&steep, t)];
            let found = [
                Density::mean(both.into_iter()).unwrap().invert(x, y),
                Density::invert_mean(both.into_iter(), x, y),
            ];
            for (s_x, s_y) in found {
                prop_assert!((s_x - ((1.0 - t) * x + t * x * x)).abs() < 1e-12);
                prop_assert!((s_y - y).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn an_even_density_is_the_identity() {
        let density = Density::new(&[1.0; 4], 2).unwrap();
        for (x, y) in [(0.0, 0.0), (0.3, 0.8), (1.0, 1.0)] {
            let (s_x, s_y) = density.invert(x, y);
            assert!((s_x - x).abs() < 1e-15 && (s_y - y).abs() < 1e-15);
        }
    }

    #[test]
    fn empty_lines_and_positions_outside_stay_finite() {
        let density = Density::new(&[0.0, 0.0, 0.0, 0.0, 1.0, 1.0], 2).unwrap();
        assert_eq!(density.invert(0.25, 0.2), (0.25, 0.0));
        assert_eq!(density.invert(7.0, 7.0), (1.0, 1.0));
        // A position that is not a number must not panic, whatever comes out.
        let _ = density.invert(-1.0, f64::NAN);
    }

    #[test]
    fn zero_everywhere_is_no_density() {
        assert!(Density::new(&[0.0; 6], 3).is_none());
        assert!(Density::mean(std::iter::empty()).is_none());
    }

    #[test]
    fn patches_interpolate_and_meet_the_vertices() {
        let table = [
            [0.0, 1.0, 2.0],
            [1.0, 1.0, 2.0],
            [10.0, 1.0, 4.0],
            [11.0, 1.0, 4.0],
        ];
        for (x, y, expected) in [(0.25, 0.5, [5.25, 1.0, 3.0]), (1.0, 1.0, [11.0, 1.0, 4.0])] {
            let found = Patch::at(x, y, 2, 2).values(&table);
            assert!(
                found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12),
                "{found:?}"
            );
        }
        let single: Vec<f32> = table.iter().map(|v| v[0]).collect();
        assert!((Patch::at(0.25, 0.5, 2, 2).value(&single) - 5.25).abs() < 1e-12);
    }
}
