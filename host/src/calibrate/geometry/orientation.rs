//! Which way round the images of camera and projector are.
//!
//! # Design
//! A beam splitter mirrors one of the two paths, cameras hang on their sides, projectors stand on their heads, and each can turn
//! its image by itself: eight ways for each device. What a fit can find is near where it begins, so all 64 pairs are asked first
//! how well the matches agree with them, with the rig and the tilts as stated: the right one misses by the tolerances of a
//! workshop, a few degrees, any other by tens. Only if the stated way is clearly not the right one another is taken.
//!
//! Whether a device is turned, or its image by software, differs in where the principal point lies afterwards. Lenses that are
//! shifted have both asked.

use std::f64::consts::FRAC_PI_2;
use std::fmt;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::parameters::parameters;
use super::sightings::Match;
use super::solve::{Sketch, Task, sketch};
use crate::base::median::median;
use crate::instrument::calibration::AS_STATED;
use crate::instrument::optics::{View, reflect};
use crate::instrument::rig::{Lens, Rig};

/// Matches of each view that are asked, at most.
const ASKED: usize = 100;
/// Median angle up to which matches agree with a rig within its tolerances, radians.
const AGREES_RAD: f64 = 0.5;
/// What misses by more than so many times the least is none of those that are fitted, nor more than so many.
const WORSE: f64 = 4.0;
const FITTED: usize = 8;
/// A fit that misses by no more than so many times the least explains the matches.
const CLEARLY: f64 = 2.0;
/// A principal point farther from the middle than this share of the image is shifted on purpose.
const SHIFTED: f64 = 0.01;

/// How an image is turned and mirrored against what the rig file says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Orientation {
    /// Quarters of a turn of the device about its axis, from its x towards its y.
    quarters: u8,
    /// Whether the image is then mirrored left to right.
    mirrored: bool,
    /// Whether software does it, to the whole image, with the principal point.
    whole: bool,
}

impl Orientation {
    /// All that a `lens` may have.
    fn all(lens: &Lens) -> Vec<Self> {
        let [off_x, off_y] = from_middle(lens).to_array();
        let is_shifted = off_x.abs() > SHIFTED * f64::from(lens.width_px)
            || off_y.abs() > SHIFTED * f64::from(lens.height_px);
        let ways = [false, true]
            .into_iter()
            .flat_map(|mirrored| (0..4).map(move |quarters| (mirrored, quarters)));
        ways.flat_map(|(mirrored, quarters)| {
            [false, true].into_iter().filter_map(move |whole| {
                let way = Self {
                    quarters,
                    mirrored,
                    whole,
                };
                // Software turns an image by a quarter only if it is square.
                let is_possible = quarters % 2 == 0 || lens.width_px == lens.height_px;
                let is_another = is_shifted && way.is_any() && is_possible;
                (!whole || is_another).then_some(way)
            })
        })
        .collect()
    }

    /// Whether anything differs.
    pub(super) fn is_any(self) -> bool {
        self.mirrored || self.quarters > 0
    }

    /// Turns `lens`.
    fn apply(self, lens: &mut Lens) {
        let turn = f64::from(self.quarters) * 90.0;
        let off = from_middle(lens) * handedness(lens);
        // From -180 to 180.
        lens.rotation_deg[2] = (lens.rotation_deg[2] + turn + 180.0).rem_euclid(360.0) - 180.0;
        lens.mirrored ^= self.mirrored;
        if self.whole {
            let off = DVec2::from_angle(-f64::from(self.quarters) * FRAC_PI_2).rotate(off);
            lens.centre_px = (middle(lens) + off * handedness(lens)).to_array();
        }
    }
}

impl fmt::Display for Orientation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let turned = format!("turned by {}°", 90 * u32::from(self.quarters));
        f.write_str(match (self.quarters, self.mirrored) {
            (0, false) => AS_STATED,
            (0, true) => "mirrored left to right",
            (2, true) => "mirrored upside down",
            (_, false) => &turned,
            (_, true) => return write!(f, "{turned} and mirrored left to right"),
        })
    }
}

fn handedness(lens: &Lens) -> DVec2 {
    DVec2::new(if lens.mirrored { -1.0 } else { 1.0 }, 1.0)
}

fn middle(lens: &Lens) -> DVec2 {
    DVec2::new(f64::from(lens.width_px), f64::from(lens.height_px)) / 2.0
}

fn from_middle(lens: &Lens) -> DVec2 {
    DVec2::from_array(lens.centre_px) - middle(lens)
}

/// The ways in which the images of camera and projector are turned against the nominal rig of `task`, as far as the matches tell.
pub(super) fn orientations(task: Task) -> [Orientation; 2] {
    let seen = task.seen.thinned(ASKED);
    let task = Task { seen: &seen, ..task };
    let mut pairs = agreements(task);
    let stated = [Orientation::default(); 2];
    let limit_rad = pairs
        .first()
        .map_or(0.0, |(least, _)| (WORSE * least).min(AGREES_RAD));
    pairs.retain(|(missed_rad, pair)| *missed_rad <= limit_rad || *pair == stated);
    let mut ways: Vec<[Orientation; 2]> = pairs.into_iter().map(|(_, pair)| pair).take(FITTED).collect();
    if !ways.contains(&stated) {
        ways.push(stated);
    }
    let fitted = ways.par_iter().filter_map(|pair| {
        let nominal = &turned(task.nominal, *pair);
        let parameters = &parameters(nominal);
        let sketch = sketch(Task {
            nominal,
            parameters,
            ..task
        })?;
        tracing::debug!(?pair, sketch.missed_rad, sketch.changes, "orientation");
        Some((*pair, sketch))
    });
    let fitted: Vec<([Orientation; 2], Sketch)> = fitted.collect();
    let least_rad = fitted
        .iter()
        .map(|(_, sketch)| sketch.missed_rad)
        .fold(f64::INFINITY, f64::min);
    fitted
        .into_iter()
        .filter(|(_, sketch)| sketch.missed_rad <= CLEARLY * least_rad)
        .min_by(|(_, a), (_, b)| a.changes.total_cmp(&b.changes))
        .map_or(stated, |(pair, _)| pair)
}

/// Where each of some matches is seen, unit, sample frame; `None` for what misses the mirror.
pub(super) type Sights = Vec<Option<DVec3>>;

/// The directions in which camera and projector of `nominal` see `matches`, for each way in which their images may be turned.
pub(super) fn sights(nominal: &Rig, matches: &[Match]) -> [Vec<(Orientation, Sights)>; 2] {
    let sights = |lens: fn(&mut Rig) -> &mut Lens, view: fn(&Rig) -> View, at: fn(&Match) -> DVec2| {
        let mut rig = nominal.clone();
        let ways = Orientation::all(lens(&mut rig));
        ways.into_par_iter()
            .map(|way| {
                let mut rig = nominal.clone();
                way.apply(lens(&mut rig));
                let view = view(&rig);
                let sight = |found: &Match| {
                    let at = at(found);
                    view.sight(at.x, at.y)
                };
                (way, matches.iter().map(sight).collect())
            })
            .collect()
    };
    [
        sights(|rig| &mut rig.camera.lens, View::camera, |found| found.camera_px),
        sights(
            |rig| &mut rig.projector.lens,
            View::projector,
            |found| found.projector_px,
        ),
    ]
}

/// The median angle in radians by which the matches miss, with the rig as stated, for each pair of ways; the least first.
fn agreements(task: Task) -> Vec<(f64, [Orientation; 2])> {
    let Task { nominal, seen, .. } = task;
    let [of_camera, of_projector] = sights(nominal, &seen.matches);
    let mut agreed = Vec::new();
    for (camera, outs) in &of_camera {
        for (projector, lits) in &of_projector {
            let missed = seen.matches.iter().zip(outs.iter().zip(lits));
            let missed = missed.filter_map(|(found, (out, lit))| {
                let mirrored = -reflect((*out)?, task.mounts[found.view].leaning([0.0; 2]));
                Some(mirrored.distance((*lit)?))
            });
            let missed: Vec<f64> = missed.collect();
            let is_most = missed.len() * 2 > seen.matches.len();
            if let Some(median_rad) = median(missed).filter(|_| is_most) {
                agreed.push((median_rad, [*camera, *projector]));
            }
        }
    }
    agreed.sort_by(|a, b| a.0.total_cmp(&b.0));
    agreed
}

/// `nominal` with its images turned.
pub(super) fn turned(nominal: &Rig, [camera, projector]: [Orientation; 2]) -> Rig {
    let mut rig = nominal.clone();
    camera.apply(&mut rig.camera.lens);
    projector.apply(&mut rig.projector.lens);
    rig
}
