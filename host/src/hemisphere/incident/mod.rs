//! Incident directions of a measurement.
//!
//! # Design
//! A [`Grid`] is how directions are written in a plan; an [`IncidentSet`] is the same, ready to interpolate.
//!
//! | kind | directions |
//! |---|---|
//! | `theta-phi` | rings at θ = (k + ½)·step of 360/step each: 32,400 at 1°, as in the paper |
//! | `equal-solid-angle` | the same rings, each with as many as keep the gap along it within the step: 20,672 at 1° |
//! | `list` | any, interpolated on their spherical Delaunay triangulation ([`DirectionList`]) |
//!
//! No ring has a pole that is counted many times or lies at the horizon, where nothing is lit.
//! Directions are numbered ring by ring, or in the order of the list.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};

mod list;
mod rings;

pub use list::DirectionList;
pub use rings::Rings;
use rings::turned_deg;

use crate::base::eight::{LANES, Vectors};

/// Indices of incident directions and their weights, which are at least 0 and sum to 1.
pub type Neighbours = [(usize, f64); 4];

/// As [`Neighbours`], of eight directions, in single precision, each in the order of the indices: [neighbour][direction].
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct NeighboursOfEight {
    pub(crate) rows: [[u32; LANES]; 4],
    pub(crate) weights: [[f32; LANES]; 4],
}

impl NeighboursOfEight {
    /// Those of direction `lane`.
    fn put(&mut self, lane: usize, mut neighbours: Neighbours) {
        neighbours.sort_by_key(|neighbour| neighbour.0);
        let places = self.rows.iter_mut().zip(&mut self.weights);
        for ((rows, weights), (row, weight)) in places.zip(neighbours) {
            (rows[lane], weights[lane]) = (row as u32, weight as f32);
        }
    }
}

/// Incident directions as a plan and the command name them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Grid {
    /// Rings of equally many directions.
    ThetaPhi {
        /// Degrees between rings and between the directions of a ring; divides 90.
        step_deg: f64,
    },
    /// Rings of directions that are at most a step apart.
    EqualSolidAngle {
        /// Degrees between rings, and the most between the directions of a ring; divides 90.
        step_deg: f64,
    },
    /// Any directions.
    List {
        /// Polar angle and azimuth of each in degrees.
        directions_deg: Vec<[f64; 2]>,
    },
}

/// Incident directions that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IncidentError {
    /// A step that makes no rings.
    #[error("step: expected a number of degrees from 0.25 to 45 that divides 90, found {step_deg}")]
    Step {
        /// What was asked for.
        step_deg: f64,
    },
    /// A list that makes no triangulation.
    #[error("list of incident directions: expected {expected}, found {found}")]
    List {
        /// What was expected.
        expected: &'static str,
        /// What is there.
        found: String,
    },
    /// A file that holds no list.
    #[error("{path}{line}: expected {expected}, found {found}", line = line.map_or_else(String::new, |line| format!(", line {line}")))]
    File {
        /// The file.
        path: String,
        /// Its line, from 1 on; `None` for the whole file.
        line: Option<usize>,
        /// What was expected.
        expected: String,
        /// What is there.
        found: String,
    },
}

impl Grid {
    /// Reads a list of directions: lines `θ φ` in degrees; blank lines and what follows a # are skipped.
    ///
    /// # Errors
    /// [`IncidentError::File`].
    pub fn read_list(path: &Path) -> Result<Self, IncidentError> {
        let fail = |line, expected: &str, found: String| IncidentError::File {
            path: path.display().to_string(),
            line,
            expected: expected.to_owned(),
            found,
        };
        let text = crate::base::text::read(path)
            .map_err(|error| fail(None, "a list of directions", format!("no readable text: {error}")))?;
        let mut directions_deg = Vec::new();
        for (index, line) in text.lines().enumerate() {
            let direction = crate::base::text::numbers(line)
                .map_err(|found| fail(Some(index + 1), "two numbers, θ and φ in degrees", found))?;
            directions_deg.extend(direction);
        }
        let grid = Self::List { directions_deg };
        // Complaints about the content name the file too.
        grid.build().map_err(|error| match error {
            IncidentError::List { expected, found } => fail(None, expected, found),
            other => other,
        })?;
        Ok(grid)
    }

    /// The directions, ready to interpolate.
    ///
    /// # Errors
    /// [`IncidentError::Step`] or [`IncidentError::List`].
    pub fn build(&self) -> Result<IncidentSet, IncidentError> {
        match self {
            Self::ThetaPhi { step_deg } => Rings::theta_phi(*step_deg).map(IncidentSet::Rings),
            Self::EqualSolidAngle { step_deg } => Rings::equal_solid_angle(*step_deg).map(IncidentSet::Rings),
            Self::List { directions_deg } => DirectionList::new(directions_deg)
                .map(Arc::new)
                .map(IncidentSet::List),
        }
    }

    /// The word for it in files and on the command line.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::ThetaPhi { .. } => "theta-phi",
            Self::EqualSolidAngle { .. } => "equal-solid-angle",
            Self::List { .. } => "list",
        }
    }

    /// Degrees between rings; `None` for a list.
    #[must_use]
    pub const fn step_deg(&self) -> Option<f64> {
        match self {
            Self::ThetaPhi { step_deg } | Self::EqualSolidAngle { step_deg } => Some(*step_deg),
            Self::List { .. } => None,
        }
    }
}

impl std::fmt::Display for Grid {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::ThetaPhi { step_deg } => write!(f, "θ × φ grid of {step_deg}°"),
            Self::EqualSolidAngle { step_deg } => write!(f, "equal-solid-angle grid of {step_deg}°"),
            Self::List { directions_deg } => write!(f, "list of {}", directions_deg.len()),
        }
    }
}

/// Incident directions with interpolation between them. Cheap to clone.
#[derive(Clone, Debug)]
pub enum IncidentSet {
    /// `theta-phi` or `equal-solid-angle`.
    Rings(Rings),
    /// `list`.
    List(Arc<DirectionList>),
}

impl IncidentSet {
    /// Number of directions.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Rings(rings) => rings.len(),
            Self::List(list) => list.len(),
        }
    }

    /// Never: every set has at least three directions.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        false
    }

    /// Angles (θ, φ) of direction `index` in degrees.
    #[must_use]
    pub fn angles_deg(&self, index: usize) -> (f64, f64) {
        match self {
            Self::Rings(rings) => rings.angles_deg(index),
            Self::List(list) => list.angles_deg(index),
        }
    }

    /// Unit vector of direction `index`, sample frame.
    #[must_use]
    pub fn direction(&self, index: usize) -> DVec3 {
        match self {
            Self::Rings(rings) => rings.direction(index),
            Self::List(list) => list.direction(index),
        }
    }

    /// The directions around the unit vector `w` with weights for linear interpolation; unused places have weight 0.
    #[must_use]
    pub fn neighbours(&self, w: DVec3) -> Neighbours {
        match self {
            Self::Rings(rings) => rings.neighbours(w),
            Self::List(list) => list.neighbours(w),
        }
    }

    /// The directions around eight unit vectors `w`, `lanes` in single precision: as [`neighbours`](Self::neighbours) finds them.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub(crate) fn neighbours_of_eight(&self, w: &[DVec3; LANES], lanes: &Vectors) -> NeighboursOfEight {
        match self {
            Self::Rings(rings) => rings.neighbours_of_eight(w, lanes),
            Self::List(list) => {
                let mut found = NeighboursOfEight::default();
                for (lane, w) in w.iter().enumerate() {
                    found.put(lane, list.neighbours(*w));
                }
                found
            }
        }
    }

    /// Whether `w` is where the directions say something: not in a gap of a list. Of rings all of them belong to the set,
    /// those too that were not captured.
    #[must_use]
    pub fn is_spanned(&self, w: DVec3) -> bool {
        match self {
            Self::Rings(_) => true,
            Self::List(list) => list.is_spanned(w),
        }
    }

    /// The directions around direction `index`, itself not among them: those beside it on its ring and next to it on
    /// the rings above and below, or its Delaunay neighbours.
    #[must_use]
    pub fn adjacent(&self, index: usize) -> Vec<usize> {
        match self {
            Self::Rings(rings) => rings.adjacent(index),
            Self::List(list) => list.adjacent(index),
        }
    }

    /// The same directions in a frame whose +x lies at `azimuth_deg` in this one: what was at that azimuth is at 0 there.
    ///
    /// # Errors
    /// [`IncidentError::List`] if a list that is turned makes no triangulation, which no list leads to that made one before.
    pub fn turned(&self, azimuth_deg: f64) -> Result<Self, IncidentError> {
        match self {
            Self::Rings(rings) => Ok(Self::Rings(rings.turned(azimuth_deg))),
            Self::List(list) => {
                let turned = (0..list.len()).map(|index| {
                    let (theta_deg, phi_deg) = list.angles_deg(index);
                    [theta_deg, turned_deg(phi_deg, azimuth_deg)]
                });
                let directions_deg = turned.collect();
                Grid::List { directions_deg }.build()
            }
        }
    }

    /// Degrees between rings; `None` for a list.
    #[must_use]
    pub fn step_deg(&self) -> Option<f64> {
        match self {
            Self::Rings(rings) => Some(rings.step_deg()),
            Self::List(_) => None,
        }
    }
}

#[cfg(test)]
mod tests;
