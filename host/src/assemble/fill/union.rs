//! The incident directions of several captures together.
//!
//! # Design
//! Captures with the same directions are merged as they are. Others (adaptive ones, lists, other grids) become one list, that
//! of the first capture and behind it what each further one adds, so that every row holds what was measured at just that
//! direction and nothing is interpolated.

use std::collections::HashMap;

use glam::{DVec3, I64Vec2};

use crate::brdf::Brdf;
use crate::hemisphere::incident::{Grid, IncidentError, IncidentSet};

/// Directions closer than this, in radians, are the same one.
const SAME_RAD: f64 = 1e-6;

/// Directions of several captures, and where each has them.
pub(super) struct Union {
    /// All of them.
    pub(super) set: IncidentSet,
    /// For each capture and each direction of `set` its index there, if the capture has it.
    pub(super) rows: Vec<Vec<Option<usize>>>,
}

impl Union {
    /// The directions of `captures`, of which there is at least one.
    ///
    /// # Errors
    /// [`IncidentError`], which no captures lead to.
    pub(super) fn of(captures: &[&Brdf]) -> Result<Self, IncidentError> {
        let first = captures[0].grid();
        let same = |other: &IncidentSet| {
            other.len() == first.len()
                && (0..first.len()).all(|at| is_same(first.direction(at), other.direction(at)))
        };
        if captures.iter().all(|capture| same(capture.grid())) {
            let all: Vec<Option<usize>> = (0..first.len()).map(Some).collect();
            return Ok(Self {
                set: first.clone(),
                rows: vec![all; captures.len()],
            });
        }
        let mut seen = Seen::default();
        let mut directions_deg: Vec<[f64; 2]> = Vec::new();
        let places: Vec<Vec<usize>> = captures
            .iter()
            .map(|capture| {
                let set = capture.grid();
                (0..set.len())
                    .map(|index| {
                        let w = set.direction(index);
                        seen.find(w).unwrap_or_else(|| {
                            directions_deg.push(set.angles_deg(index).into());
                            seen.add(w)
                        })
                    })
                    .collect()
            })
            .collect();
        let rows = places
            .into_iter()
            .map(|places| {
                let mut rows = vec![None; directions_deg.len()];
                for (index, place) in places.into_iter().enumerate() {
                    rows[place] = Some(index);
                }
                rows
            })
            .collect();
        Ok(Self {
            set: Grid::List { directions_deg }.build()?,
            rows,
        })
    }
}

fn is_same(a: DVec3, b: DVec3) -> bool {
    (a - b).length() <= SAME_RAD
}

/// Directions that were met, in order.
#[derive(Default)]
struct Seen {
    directions: Vec<DVec3>,
    /// By cell of the plane below them: two that are the same are in the same one or in neighbours.
    cells: HashMap<I64Vec2, Vec<usize>>,
}

impl Seen {
    fn cell(w: DVec3) -> I64Vec2 {
        (w.truncate() / (2.0 * SAME_RAD)).floor().as_i64vec2()
    }

    fn find(&self, w: DVec3) -> Option<usize> {
        let cell = Self::cell(w);
        let around = (-1..=1).flat_map(|x| (-1..=1).map(move |y| cell + I64Vec2::new(x, y)));
        around
            .filter_map(|cell| self.cells.get(&cell))
            .flatten()
            .copied()
            .find(|&index| is_same(self.directions[index], w))
    }

    fn add(&mut self, w: DVec3) -> usize {
        let index = self.directions.len();
        self.directions.push(w);
        self.cells.entry(Self::cell(w)).or_default().push(index);
        index
    }
}
