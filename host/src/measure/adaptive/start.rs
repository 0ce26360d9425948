//! The coarse beginning: what is captured before any error is known.
//!
//! # Design
//! Unless a grid is given it is [`FIRST`] directions of rings that are as far from each other as can be. Of a grid it is
//! what can be lit. Segments of frames have a fixed length, so that it is filled up to whole ones, where the gaps are widest.

use glam::DVec3;

use super::choose::outlook;
use super::{AdaptiveError, BATCH, Goal, GoalError};
use crate::capture::directory::MeasurementError;
use crate::hemisphere::direction::{angle_between, to_degrees};
use crate::hemisphere::incident::{DirectionList, Grid};
use crate::instrument::rig::Rig;
use crate::plan::{Directions, Plan, Request};

/// Captures of the usual beginning.
const FIRST: usize = 3 * BATCH;
/// The usual beginning is chosen from rings with this step, in degrees.
const FIRST_STEP_DEG: f64 = 5.0;

/// The grid that a beginning is chosen from: `start`, or that of the usual one.
pub(super) fn grid(start: Option<&Grid>) -> Grid {
    start.cloned().unwrap_or(Grid::EqualSolidAngle {
        step_deg: FIRST_STEP_DEG,
    })
}

/// The directions of `grid` as a list, in degrees: patterns of a list have the rig's own spot of light, as all that are
/// captured here.
pub(super) fn listed(grid: &Grid) -> Result<Grid, AdaptiveError> {
    let set = grid.build()?;
    let directions_deg = (0..set.len()).map(|index| set.angles_deg(index).into()).collect();
    Ok(Grid::List { directions_deg })
}

/// `request` with as many directions as `goal` allows, all in reach of `rig` (as loaded): what an adaptive measurement takes at most.
///
/// # Errors
/// [`AdaptiveError`] for what no adaptive measurement is made of.
pub fn at_most(rig: &Rig, request: &Request, goal: Goal) -> Result<Request, AdaptiveError> {
    if !request.light.is_single() {
        return Err(AdaptiveError::Light { found: request.light });
    }
    let scaled = request.rig(rig).map_err(MeasurementError::from)?;
    let mut directions_deg = Vec::new();
    for step_deg in [3.0, 1.0, 0.5] {
        let directions =
            Directions::new(&scaled, &Grid::EqualSolidAngle { step_deg }).map_err(MeasurementError::from)?;
        directions_deg = directions
            .measurable()
            .take(goal.budget)
            .map(|index| directions.grid.angles_deg(index).into())
            .collect();
        if directions_deg.len() == goal.budget {
            break;
        }
    }
    Ok(Request {
        grid: Grid::List { directions_deg },
        ..request.clone()
    })
}

/// Patterns of a segment of what `plan` says: what divides a batch, as far as memory allows.
pub(super) fn patterns(plan: &Plan) -> usize {
    let most = (plan.segment / plan.brackets()).clamp(1, BATCH);
    1 << most.ilog2()
}

/// `plan` as it is captured adaptively: black patterns first, and a segment for each batch or less.
#[must_use]
pub fn in_batches(plan: Plan) -> Plan {
    Plan {
        segment: patterns(&plan) * plan.brackets(),
        black_first: true,
        ..plan
    }
}

/// Angles (θ, φ) of `w` in degrees, as lists have them.
pub(super) fn in_degrees(w: DVec3) -> [f64; 2] {
    to_degrees(w).into()
}

/// The directions of the beginning in degrees, at most `budget`: those of `start` that are `lit`, filled up to whole batches
/// with `reachable` ones, which are no nearer than `spot_rad` to others; without one, the usual ones.
pub(super) fn beginning(
    rig: &Rig,
    start: Option<&Grid>,
    budget: usize,
    lit: &dyn Fn(DVec3) -> bool,
    reachable: &dyn Fn(DVec3) -> bool,
    spot_rad: f64,
) -> Result<Vec<[f64; 2]>, AdaptiveError> {
    let set = grid(start).build()?;
    if start.is_none() {
        let open: Vec<(DVec3, [f64; 2])> = (0..set.len())
            .map(|index| (set.direction(index), set.angles_deg(index).into()))
            .filter(|(w, _)| reachable(*w))
            .collect();
        return spread(rig, open, FIRST.min(budget));
    }
    let mut chosen: Vec<[f64; 2]> = (0..set.len())
        .filter(|&index| lit(set.direction(index)))
        .map(|index| set.angles_deg(index).into())
        .collect();
    if chosen.len() > budget {
        let start = chosen.len();
        return Err(GoalError::Start { start, budget }.into());
    }
    if chosen.len() < 3 {
        return Err(AdaptiveError::OutOfReach {
            rig: rig.name.clone(),
            found: chosen.len(),
        });
    }
    let whole = chosen.len().next_multiple_of(BATCH).min(budget);
    while chosen.len() < whole {
        let list = DirectionList::new(&chosen)?;
        let next = outlook(&list, &[], reachable, spot_rad, whole - chosen.len()).next;
        if next.is_empty() {
            break; // all spots of light overlap
        }
        chosen.extend(next.into_iter().map(in_degrees));
    }
    Ok(chosen)
}

/// `count` of the directions `open` (each with its angles in degrees) that are farthest from each other.
fn spread(rig: &Rig, mut open: Vec<(DVec3, [f64; 2])>, count: usize) -> Result<Vec<[f64; 2]>, AdaptiveError> {
    if open.len() < count {
        return Err(AdaptiveError::OutOfReach {
            rig: rig.name.clone(),
            found: open.len(),
        });
    }
    let mut distances = vec![f64::MAX; open.len()];
    let mut chosen = Vec::new();
    while chosen.len() < count {
        let farthest = (0..open.len())
            .max_by(|&a, &b| distances[a].total_cmp(&distances[b]))
            .expect("some are left");
        let (w, angles_deg) = open.swap_remove(farthest);
        distances.swap_remove(farthest);
        for ((other, _), distance) in open.iter().zip(&mut distances) {
            *distance = distance.min(angle_between(*other, w));
        }
        chosen.push(angles_deg);
    }
    Ok(chosen)
}
