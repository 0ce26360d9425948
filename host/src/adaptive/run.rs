//! The closed loop.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Map, json};

use super::choose::outlook;
use super::journal::{AdaptiveError, Asked, Journal, differs};
use super::predict::{Image, judged_cells, leave_one_out};
use super::{BATCH, Goal, Stop};
use crate::assemble::FrameAssembler;
use crate::brackets::Brackets;
use crate::capture::{Instrument, Tally};
use crate::direction::{angle_between, to_degrees};
use crate::disk::Disk;
use crate::incident::{DirectionList, Grid, IncidentSet, Rings};
use crate::measurement::{Measurement, MeasurementError, State, take_segment};
use crate::optics::View;
use crate::pattern::{LitSet, PatternMaker};
use crate::pilot::pilot;
use crate::plan::{Exposure, Plan, PlanError, Request, spot_deg};
use crate::progress::Progress;
use crate::rig::Rig;
use crate::schedule::Timing;
use crate::setup::Setup;

/// Captures of the coarse beginning.
const FIRST: usize = 3 * BATCH;
/// The coarse beginning is chosen from rings with this step, in degrees.
const FIRST_STEP_DEG: f64 = 5.0;
/// Nothing is captured nearer to the horizon than this polar angle, in degrees.
const GRAZING_DEG: f64 = 85.0;
/// More captures do not help where interpolation makes less than this share of the error that noise makes.
const NOISE_RULES: f64 = 0.25;

/// How an adaptive measurement went.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Adapted {
    /// Captures with light.
    pub captures: usize,
    /// Predicted PSNR in dB of f·cosθi in luminance at exposure 1, clipped to 1.
    pub predicted_db: f64,
    /// The part of noise alone: no number of captures gets beyond.
    pub noise_limit_db: f64,
    /// The goal.
    pub goal: Goal,
    /// Why it ended.
    pub stop: Stop,
    /// (captures, predicted PSNR in dB) after each batch.
    pub history: Vec<(usize, f64)>,
}

/// The loop's fixed parts.
struct Loop<'a> {
    rig: &'a Rig,
    maker: PatternMaker,
    timing: Timing,
    disk: Disk,
}

/// Measures `request` on `rig` (as loaded) adaptively in `out`, which is new or empty, or with `resume` one in which this
/// was begun. Returns the measurement, all of its frames captured, and how it went. The grid of the request has no part,
/// nor have its brackets: one exposure of each pattern is taken.
///
/// # Errors
/// [`AdaptiveError`].
pub fn measure(
    out: &Path,
    rig: &Rig,
    request: &Request,
    goal: Goal,
    setup: &Setup,
    resume: bool,
    progress: &dyn Progress,
) -> Result<(Measurement, Adapted), AdaptiveError> {
    let pilot_grid = Grid::EqualSolidAngle {
        step_deg: FIRST_STEP_DEG,
    };
    let request = Request {
        grid: pilot_grid.clone(),
        brackets: Brackets::One,
        ..request.clone()
    };
    crate::sample::parse(
        request
            .sample
            .as_deref()
            .unwrap_or(crate::measure::DEFAULT_SAMPLE),
    )
    .map_err(crate::measure::MeasureError::from)?;
    let scaled = request.rig(rig).map_err(MeasurementError::from)?;
    Plan::new(
        request.clone(),
        &scaled,
        request.exposure_s.unwrap_or(rig.camera.exposure_s),
    )
    .map_err(MeasurementError::from)?;
    let resumed = resume && Journal::exists(out);
    if !resumed {
        Measurement::check_new(out)?;
    }
    let mut instrument = setup.open(&scaled, &request)?;
    let journal = if resumed {
        let journal = Journal::open(out, &scaled)?;
        if journal.asked.goal != goal {
            return Err(differs(out, "goal"));
        }
        if journal.asked.request != request {
            return Err(differs(out, "request"));
        }
        journal
    } else {
        let exposure_s = match request.exposure_s {
            Some(exposure_s) => exposure_s,
            None => pilot(&scaled, &pilot_grid, &mut instrument)?,
        };
        let asked = Asked {
            exposure_s,
            rig: scaled.to_toml(),
            goal,
            request: request.clone(),
        };
        Journal::create(out, asked, &scaled)?
    };
    let exposure_s = journal.asked.exposure_s;
    let fixed = Loop {
        rig: &scaled,
        maker: PatternMaker::new(
            View::projector(&scaled),
            scaled.light.spot_deg,
            scaled.projector.irradiance,
        ),
        timing: Timing::new(&scaled, exposure_s)
            .map_err(PlanError::from)
            .map_err(MeasurementError::from)?,
        disk: Disk::new(request.image_size as usize),
    };
    let mut tally = Tally::default();
    let (directions_deg, adapted) = fixed.run(&journal, goal, &mut instrument, &mut tally, progress)?;

    let grid = Grid::List { directions_deg };
    let plan = Plan {
        segment: BATCH,
        ..Plan::new(Request { grid, ..request }, &scaled, exposure_s).map_err(MeasurementError::from)?
    };
    journal.publish(&scaled, plan.directions)?;
    let measurement = Measurement::found(out, scaled.clone(), plan)?;
    let mut facts = Map::new();
    facts.insert("adaptive".to_owned(), json!(adapted));
    facts.insert("capture".to_owned(), json!(tally));
    measurement.note(State::Captured, facts)?;
    journal.close()?;
    Ok((measurement, adapted))
}

impl Loop<'_> {
    fn reachable(&self, w: glam::DVec3) -> bool {
        w.z > GRAZING_DEG.to_radians().cos() && self.maker.lit_set(w).is_ok()
    }

    /// The coarse beginning: of rings, those directions in reach that are farthest from each other.
    fn first(&self, count: usize) -> Result<Vec<[f64; 2]>, AdaptiveError> {
        let rings = Rings::equal_solid_angle(FIRST_STEP_DEG)?;
        let mut open: Vec<(usize, f64)> = (0..rings.len())
            .filter(|&index| self.reachable(rings.direction(index)))
            .map(|index| (index, f64::MAX))
            .collect();
        if open.len() < count {
            return Err(AdaptiveError::OutOfReach {
                rig: self.rig.name.clone(),
                found: open.len(),
            });
        }
        let mut chosen = Vec::new();
        while chosen.len() < count {
            let farthest = (0..open.len())
                .max_by(|&a, &b| open[a].1.total_cmp(&open[b].1))
                .expect("some are left");
            let (index, _) = open.swap_remove(farthest);
            for (other, distance) in &mut open {
                *distance = distance.min(angle_between(rings.direction(*other), rings.direction(index)));
            }
            chosen.push(rings.angles_deg(index).into());
        }
        Ok(chosen)
    }

    fn run(
        &self,
        journal: &Journal,
        goal: Goal,
        instrument: &mut Instrument,
        tally: &mut Tally,
        progress: &dyn Progress,
    ) -> Result<(Vec<[f64; 2]>, Adapted), AdaptiveError> {
        let mut stored = journal.frames.whole_segments()?;
        if stored == 0 {
            let black = [Exposure::Black; BATCH];
            self.capture(journal, 0, &black, &vec![None; BATCH], instrument, tally)?;
            stored = 1;
        }
        let assembler =
            FrameAssembler::new(self.rig, &journal.frames.read_segment(0)?, self.disk).map_err(|reason| {
                AdaptiveError::from(MeasurementError::Plan(PlanError::File {
                    path: "adaptive.zarr".to_owned(),
                    reason,
                }))
            })?;
        let cells = judged_cells(self.disk);
        let mut directions_deg = journal.directions_deg()?;
        if directions_deg.is_empty() {
            directions_deg = self.first(FIRST.min(goal.budget))?;
            journal.choose(&directions_deg)?;
        }
        let mut images: Vec<Image> = Vec::new();
        let mut history = Vec::new();
        loop {
            let list = DirectionList::new(&directions_deg)?;
            while images.len() < directions_deg.len() {
                let batch = images.len()..(images.len() + BATCH).min(directions_deg.len());
                let segment = 1 + batch.start / BATCH;
                if segment >= stored {
                    let exposures: Vec<Exposure> = batch.clone().map(Exposure::Incident).collect();
                    let lit: Vec<Option<LitSet>> = batch
                        .map(|index| self.maker.lit_set(list.direction(index)).ok())
                        .collect();
                    self.capture(journal, segment, &exposures, &lit, instrument, tally)?;
                    stored = segment + 1;
                }
                let stored = journal.frames.read_segment(segment)?;
                images.extend(
                    assembler
                        .luminance(&stored)
                        .into_iter()
                        .map(|(f, noise)| Image { f, noise }),
                );
            }
            let set = IncidentSet::List(list.into());
            let left_out = leave_one_out(&directions_deg, &set, &images, self.disk, &cells);
            let IncidentSet::List(list) = &set else {
                unreachable!("made so")
            };
            let wanted = BATCH.min(goal.budget - images.len());
            let spot_rad = spot_deg(
                self.rig,
                &Grid::List {
                    directions_deg: Vec::new(),
                },
            )
            .to_radians();
            let outlook = outlook(list, &left_out, &|w| self.reachable(w), spot_rad, wanted);
            let predicted_db = decibels(outlook.mse + outlook.noise_mse);
            history.push((images.len(), predicted_db));
            progress.remark(&format!(
                "adaptive: {} captures, {predicted_db:.1} dB predicted",
                images.len()
            ));
            let stop = if goal.target_db.is_some_and(|target_db| predicted_db >= target_db) {
                Some(Stop::Target)
            } else if wanted == 0 {
                Some(Stop::Budget)
            } else if goal.target_db.is_some() && outlook.mse < NOISE_RULES * outlook.noise_mse {
                Some(Stop::Noise)
            } else if outlook.next.len() < wanted {
                Some(Stop::Spot)
            } else {
                None
            };
            if let Some(stop) = stop {
                let noise_limit_db = decibels(outlook.noise_mse);
                let captures = images.len();
                return Ok((
                    directions_deg,
                    Adapted {
                        captures,
                        predicted_db,
                        noise_limit_db,
                        goal,
                        stop,
                        history,
                    },
                ));
            }
            directions_deg.extend(outlook.next.into_iter().map(|w| {
                let (theta_deg, phi_deg) = to_degrees(w);
                [theta_deg, phi_deg]
            }));
            journal.choose(&directions_deg)?;
        }
    }

    fn capture(
        &self,
        journal: &Journal,
        segment: usize,
        exposures: &[Exposure],
        lit: &[Option<LitSet>],
        instrument: &mut Instrument,
        tally: &mut Tally,
    ) -> Result<(), AdaptiveError> {
        let taken = take_segment(
            instrument,
            std::slice::from_ref(&self.timing),
            exposures,
            lit,
            tally,
            &mut |_| {},
        )?;
        Ok(journal.frames.write_segment(segment, &taken)?)
    }
}

fn decibels(mse: f64) -> f64 {
    -10.0 * mse.max(1e-20).log10()
}
