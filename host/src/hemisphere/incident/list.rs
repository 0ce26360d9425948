//! Any incident directions, interpolated on their spherical Delaunay triangulation.
//!
//! # Design
//! Stereographic projection from the south pole, p = (x, y)/(1 + z), maps circles to circles, so that the planar
//! Delaunay triangulation of the projected directions is the spherical one, and the hemisphere is the unit disc.
//! Weights are the barycentric coordinates in that plane, which reproduce linear functions of it. Beyond the hull,
//! towards the horizon, the value stays that of the nearest place on the hull.
//!
//! A coarse raster of the disc remembers a direction near each of its cells, where the search for a triangle begins:
//! its length does not grow with the list.
//!
//! # Tradeoffs
//! The triangulation and its exact predicates are those of the crate spade.

use glam::{DVec2, DVec3};
use spade::handles::{DirectedEdgeHandle, FaceHandle, FixedDirectedEdgeHandle, FixedVertexHandle, InnerTag};
use spade::{DelaunayTriangulation, Point2, PositionInTriangulation, Triangulation as _};

use super::{IncidentError, Neighbours};
use crate::hemisphere::direction::{from_degrees, is_above_horizon};

/// Directions closer than this, in the plane of projection, are the same one.
const DISTINCT: f64 = 1e-7;
/// Less than this area, in the plane of projection, is none.
const FLAT: f64 = 1e-9;
/// An empty circle so many times as wide as usual is a gap.
const GAP: f64 = 2.0;
/// Directions per cell of the raster, about.
const PER_CELL: f64 = 2.0;

type Delaunay = DelaunayTriangulation<Point2<f64>>;

/// A list of directions.
#[derive(Debug)]
pub struct DirectionList {
    angles_deg: Vec<[f64; 2]>,
    directions: Vec<DVec3>,
    delaunay: Delaunay,
    /// For each cell of the square around the unit disc, row by row, a direction to begin the search at.
    hints: Vec<u32>,
    /// Cells along a side.
    cells: usize,
    /// Radius in rad of empty circles, median over the hemisphere.
    usual_rad: f64,
}

fn project(w: DVec3) -> DVec2 {
    w.truncate() / (1.0 + w.z)
}

const fn point(p: DVec2) -> Point2<f64> {
    Point2::new(p.x, p.y)
}

const fn vector(p: Point2<f64>) -> DVec2 {
    DVec2::new(p.x, p.y)
}

impl DirectionList {
    /// The directions with these (θ, φ) in degrees, in this order.
    ///
    /// # Errors
    /// [`IncidentError::List`] for fewer than three, one that is not above the horizon (0 ≤ θ < 90°), two that are the
    /// same, or all on one line.
    pub fn new(angles_deg: &[[f64; 2]]) -> Result<Self, IncidentError> {
        let fail = |expected, found| IncidentError::List { expected, found };
        let shown = |index: usize| format!("({}, {})", angles_deg[index][0], angles_deg[index][1]);
        if angles_deg.len() < 3 {
            return Err(fail("at least 3 directions", angles_deg.len().to_string()));
        }
        let above = |&[theta, phi]: &[f64; 2]| {
            (0.0..90.0).contains(&theta) && phi.is_finite() && is_above_horizon(from_degrees(theta, phi))
        };
        if let Some(index) = angles_deg.iter().position(|angles| !above(angles)) {
            let expected = "polar angles θ from 0° to below 90° and finite azimuths φ";
            return Err(fail(expected, format!("{} at place {}", shown(index), index + 1)));
        }
        let directions: Vec<DVec3> = angles_deg.iter().map(|a| from_degrees(a[0], a[1])).collect();
        let mut seen = std::collections::HashMap::new();
        for (index, &w) in directions.iter().enumerate() {
            let cell = (project(w) / DISTINCT).round().as_i64vec2();
            if let Some(other) = seen.insert(cell, index) {
                let found = format!("{} at places {} and {}", shown(index), other + 1, index + 1);
                return Err(fail("different directions", found));
            }
        }
        let points = directions.iter().map(|&w| point(project(w))).collect();
        let delaunay = Delaunay::bulk_load_stable(points).expect("finite and in the unit disc");
        let area: f64 = delaunay.inner_faces().map(|face| face.area()).sum();
        // Rounding makes triangles of directions on a line.
        if area < FLAT {
            return Err(fail(
                "directions that span an area",
                "all on one great circle through the pole".to_owned(),
            ));
        }
        let cells = ((angles_deg.len() as f64 / PER_CELL).sqrt() as usize).max(1);
        let mut hints = Vec::with_capacity(cells * cells);
        let mut hint = FixedVertexHandle::from_index(0);
        for row in 0..cells {
            for column in 0..cells {
                let centre = DVec2::new(column as f64 + 0.5, row as f64 + 0.5) * (2.0 / cells as f64) - 1.0;
                hint = match delaunay.locate_with_hint(point(centre), hint) {
                    PositionInTriangulation::OnVertex(vertex) => vertex,
                    PositionInTriangulation::OnFace(face) => delaunay.face(face).vertices()[0].fix(),
                    PositionInTriangulation::OnEdge(edge)
                    | PositionInTriangulation::OutsideOfConvexHull(edge) => {
                        delaunay.directed_edge(edge).from().fix()
                    }
                    PositionInTriangulation::NoTriangulation => hint,
                };
                hints.push(hint.index() as u32);
            }
        }
        let mut list = Self {
            angles_deg: angles_deg.to_vec(),
            directions,
            delaunay,
            hints,
            cells,
            usual_rad: 0.0,
        };
        list.usual_rad = list.usual_rad();
        Ok(list)
    }

    /// Number of directions.
    #[must_use]
    pub fn len(&self) -> usize {
        self.directions.len()
    }

    /// Never: there are at least three.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        false
    }

    /// Angles (θ, φ) of direction `index` in degrees, as they were given.
    #[must_use]
    pub fn angles_deg(&self, index: usize) -> (f64, f64) {
        self.angles_deg[index].into()
    }

    /// Unit vector of direction `index`, sample frame.
    #[must_use]
    pub fn direction(&self, index: usize) -> DVec3 {
        self.directions[index]
    }

    /// The triangles, each by the indices of its corners, counter-clockwise seen from above.
    pub fn triangles(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        self.delaunay.inner_faces().map(corners)
    }

    /// The centre of the empty circle through the corners of `triangle` (counter-clockwise): of all directions in it
    /// the farthest from what is in the list. It can lie below the horizon.
    #[must_use]
    pub fn circumcentre(&self, triangle: [usize; 3]) -> DVec3 {
        let [a, b, c] = triangle.map(|index| self.directions[index]);
        (b - a).cross(c - a).normalize()
    }

    /// Whether interpolation at `w` is as near to directions of the list as it is elsewhere: the empty circle around it is no
    /// more than `GAP` times as wide as they usually are, and it is no farther beyond the hull. Else `w` is in a gap, such
    /// as the hole of a mirror, of which the list says nothing.
    #[must_use]
    pub fn is_spanned(&self, w: DVec3) -> bool {
        let within = |triangle: [usize; 3]| self.radius_rad(triangle) <= GAP * self.usual_rad;
        let at = point(project(w.with_z(w.z.max(0.0)).normalize_or(DVec3::Z)));
        match self.delaunay.locate(at) {
            PositionInTriangulation::OnVertex(_) => true,
            PositionInTriangulation::OnFace(face) => within(corners(self.delaunay.face(face))),
            PositionInTriangulation::OnEdge(edge) => {
                let edge = self.delaunay.directed_edge(edge);
                let sides = [edge.face().as_inner(), edge.rev().face().as_inner()];
                sides.into_iter().flatten().any(|face| within(corners(face)))
            }
            _ => {
                let nearest = self
                    .neighbours(w)
                    .into_iter()
                    .fold(DVec3::ZERO, |sum, (index, weight)| {
                        sum + weight * self.directions[index]
                    });
                nearest.angle_between(w) <= GAP * self.usual_rad
            }
        }
    }

    /// Radius in rad of the empty circle through the corners of `triangle`.
    fn radius_rad(&self, triangle: [usize; 3]) -> f64 {
        self.circumcentre(triangle)
            .angle_between(self.directions[triangle[0]])
    }

    /// Median over the hemisphere of the radius of the empty circle.
    fn usual_rad(&self) -> f64 {
        let mut radii: Vec<(f64, f64)> = self
            .triangles()
            .map(|triangle| {
                let [a, b, c] = triangle.map(|index| self.directions[index]);
                (self.radius_rad(triangle), (b - a).cross(c - a).length())
            })
            .collect();
        radii.sort_by(|a, b| a.0.total_cmp(&b.0));
        let half = radii.iter().map(|radius| radius.1).sum::<f64>() / 2.0;
        let mut sum = 0.0;
        let middle = radii.iter().find(|radius| {
            sum += radius.1;
            sum >= half
        });
        middle.map_or(0.0, |radius| radius.0)
    }

    /// See [`super::IncidentSet::neighbours`].
    #[must_use]
    pub fn neighbours(&self, w: DVec3) -> Neighbours {
        // Below the horizon there is nothing; what is asked there is asked at the horizon.
        let p = project(w.with_z(w.z.max(0.0)).normalize_or(DVec3::Z));
        let cell = |x: f64| (((x + 1.0) * 0.5 * self.cells as f64).max(0.0) as usize).min(self.cells - 1);
        let hint = self.hints[cell(p.y) * self.cells + cell(p.x)] as usize;
        let p = point(p);
        match self
            .delaunay
            .locate_with_hint(p, FixedVertexHandle::from_index(hint))
        {
            PositionInTriangulation::OnVertex(vertex) => [
                (vertex.index(), 1.0),
                (vertex.index(), 0.0),
                (vertex.index(), 0.0),
                (vertex.index(), 0.0),
            ],
            PositionInTriangulation::OnFace(face) => {
                let face = self.delaunay.face(face);
                let [a, b, c] = corners(face);
                // Rounding must not make a weight negative.
                let [u, v, w] = face.barycentric_interpolation(p).map(|weight| weight.max(0.0));
                let sum = u + v + w;
                [(a, u / sum), (b, v / sum), (c, w / sum), (a, 0.0)]
            }
            PositionInTriangulation::OnEdge(edge) => on_edge(self.delaunay.directed_edge(edge), vector(p)).1,
            PositionInTriangulation::OutsideOfConvexHull(edge) => self.on_hull(edge, vector(p)),
            PositionInTriangulation::NoTriangulation => unreachable!("there is a triangle"),
        }
    }

    /// Weights of the place on the hull that is nearest to `p`, which lies beyond the hull's edge `edge`.
    fn on_hull(&self, edge: FixedDirectedEdgeHandle, p: DVec2) -> Neighbours {
        let mut edge = self.delaunay.directed_edge(edge);
        let mut came = 0.0;
        // Along a convex hull the distance falls towards the nearest place and then rises.
        loop {
            let (t, weights) = on_edge(edge, p);
            let way = if t > 1.0 {
                1.0
            } else if t < 0.0 {
                -1.0
            } else {
                0.0
            };
            // A corner is nearest where both edges that meet there point at it.
            if way == 0.0 || way * came < 0.0 {
                return weights;
            }
            came = way;
            edge = if way > 0.0 { edge.next() } else { edge.prev() };
        }
    }

    /// See [`super::IncidentSet::adjacent`].
    #[must_use]
    pub fn adjacent(&self, index: usize) -> Vec<usize> {
        let vertex = self.delaunay.vertex(FixedVertexHandle::from_index(index));
        vertex.out_edges().map(|edge| edge.to().index()).collect()
    }
}

fn corners(face: FaceHandle<'_, InnerTag, Point2<f64>, (), (), ()>) -> [usize; 3] {
    face.vertices().map(|vertex| vertex.index())
}

/// Place of the point of `edge` that is nearest to `p`: its share of the way before it was limited to the edge, and the
/// weights of the ends.
fn on_edge(edge: DirectedEdgeHandle<'_, Point2<f64>, (), (), ()>, p: DVec2) -> (f64, Neighbours) {
    let [a, b] = edge.vertices();
    let (from, to) = (vector(a.position()), vector(b.position()));
    let t = (p - from).dot(to - from) / (to - from).length_squared();
    let (a, b, inside) = (a.index(), b.index(), t.clamp(0.0, 1.0));
    (t, [(a, 1.0 - inside), (b, inside), (a, 0.0), (b, 0.0)])
}
