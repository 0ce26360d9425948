//! A run that the projector leads: it cannot be triggered, and an edge of SYNC tells when it shows a picture.
//!
//! # Design
//! Each step waits for an edge of SYNC of its own. The projector shows a picture, its edge begins the step, and only when the
//! trigger box has said that the step is over the next picture is shown: so no step can begin with the picture of another one
//! unless an edge comes that is none of a picture's. Whether one did is seen afterwards: by the display's clock and the box's,
//! each step must have begun as long after its picture appeared as the first one did, to [`TOLERANCE`] of a display frame and what
//! clocks differ by. Where frames were shown again or left out on the way, the picture came later or earlier than the display says,
//! and the same difference tells. Those exposures are taken again. What comes later from then on is believed the second time, as a
//! step that begins late begins with its own picture; what comes earlier is not: an edge of the picture before would look
//! like that, again and again. It costs what is left of the run.
//!
//! The first picture of a run is shown twice, first for a step without an exposure: so each exposure has a picture before it.
//! All steps are as the first of a series: their edges come when the patch is lit, which is when the picture may change.

use std::time::Duration;

use rcg_protocol::{Fault, Micros, Pace, Program, Pulse, Start, State, Step, StepId, StepRecord};

use super::intake::taking_in;
use super::{CaptureError, Instrument, Received, hear, is_done};
use crate::capture::device::Device;
use crate::capture::link::Link;
use crate::capture::projector::{Leading, ProjectorError};
use crate::plan::schedule::Timing;

/// An edge of SYNC counts as a picture's when it is off by less than this, display frames.
pub(crate) const TOLERANCE: f64 = 0.25;
/// The display's clock and the box's count the same to such a share of the time.
const DRIFT: f64 = 1e-4;
/// A picture whose edge does not come for so long was not seen.
const SYNC_PATIENCE_S: u32 = 2;
/// How often the trigger box is asked whether a step is over.
const LOOK: Duration = Duration::from_millis(1);
/// Nothing is to be done any more.
const NEVER: Duration = Duration::MAX;

/// Shows the pictures of a run one after the other.
struct Show<'a> {
    projector: &'a mut dyn Leading,
    /// Which loaded pattern each step shows.
    patterns: Vec<usize>,
    steps: &'a [Step],
    tick_s: f64,
    /// When each appeared, s on the display's clock, of those that were shown so far; `None` for one whose step had begun before.
    appeared_s: Vec<Option<f64>>,
    /// Before that no step is over, on the link's clock.
    due: Duration,
}

impl Show<'_> {
    /// Shows the next picture if the step of the one before is over. Returns how long nothing is to be done.
    fn advance<L: Link>(&mut self, device: &mut Device<L>) -> Result<Duration, CaptureError> {
        let shown = self.appeared_s.len();
        if shown == self.patterns.len() {
            return Ok(NEVER);
        }
        let now = device.link().now();
        if now < self.due {
            return Ok(self.due.saturating_sub(now));
        }
        if shown > 0 {
            let status = device.status()?;
            if !matches!(status.state, State::Armed | State::Running) {
                return Ok(NEVER);
            }
            let done = (status.steps_done as usize).min(self.patterns.len());
            if done < shown {
                return Ok(LOOK);
            }
            // Edges that were none of a picture's have begun steps.
            self.appeared_s.resize(done, None);
        }
        let Some(&pattern) = self.patterns.get(self.appeared_s.len()) else {
            return Ok(NEVER);
        };
        let period_s = self.steps[self.appeared_s.len()].period.0 as f64 * self.tick_s;
        self.appeared_s.push(Some(self.projector.show(pattern)?));
        self.due = device.link().now() + Duration::from_secs_f64(0.9 * period_s);
        Ok(LOOK)
    }
}

impl Instrument {
    /// One run over `timings`, which take these `exposures` of the segment, (image, band) of each, led by the projector, which shows the
    /// loaded pattern of the number in `patterns` with each.
    pub(super) fn run_led(
        &mut self,
        timings: &[Timing],
        patterns: &[usize],
        exposures: &[(usize, usize)],
        mut recorded: impl FnMut(usize),
    ) -> Result<Received, CaptureError> {
        let clock_hz = self.device.info().clock_hz;
        let tick_s = 1.0 / f64::from(clock_hz);
        let taking = timings.iter().map(|timing| step_of(timing, clock_hz));
        let lead_in = timings.first().map(|timing| Step {
            cam: Pulse::NONE,
            ..step_of(timing, clock_hz)
        });
        let Self {
            device,
            camera,
            projector,
            wiring,
            ..
        } = self;
        let steps = lead_in.into_iter().chain(taking);
        let steps = steps.map(|step| wiring.step(step, clock_hz));
        let steps: Vec<Step> = steps.collect::<Result<_, _>>()?;
        let name = projector.name().to_owned();
        let projector = projector.leading().ok_or_else(|| ProjectorError::Failed {
            projector: name.clone(),
            reason: "expected one that leads, found one that is triggered".to_owned(),
        })?;
        let frame_s = projector.frame_s();
        let mut show = Show {
            projector,
            patterns: patterns.first().into_iter().chain(patterns).copied().collect(),
            steps: &steps,
            tick_s,
            appeared_s: Vec::with_capacity(steps.len()),
            due: Duration::ZERO,
        };
        let program = wiring.program_at_its_pace(program(steps.len()));
        wiring.check(&steps, &program, &device.info())?;
        camera.arm()?;
        let mut haul = Received::of(timings.len());
        let (frames, records, spurious_on) = (&mut haul.frames, &mut haul.records, &mut haul.spurious_on);
        let ending = taking_in(camera.as_mut(), frames, |take_in| {
            device.play_led(
                &program,
                &steps,
                |device| {
                    take_in()?;
                    show.advance(device)
                },
                |event| {
                    hear(event, (wiring, clock_hz), records, spurious_on)?;
                    recorded(records.len().saturating_sub(1));
                    Ok::<_, CaptureError>(())
                },
            )
        })?;
        if let Some(Fault::SyncTimeout { step }) = ending.fault {
            return Err(CaptureError::Unseen {
                projector: name,
                picture: step.0,
            });
        }
        is_done(ending, steps.len())?;
        show.projector.finish()?;
        let began_s = began_s(&steps, &haul.records, tick_s);
        haul.unsteady = unsteady(&began_s, &show.appeared_s, frame_s);
        if let Some(&(step, off)) = haul.unsteady.first() {
            tracing::info!(
                step,
                off,
                steps = haul.unsteady.len(),
                "display frames are not as the display says"
            );
        }
        without_lead_in(&mut haul);
        self.receive_late(timings, exposures, &mut haul)?;
        Ok(haul)
    }
}

/// The step of `timing` without a pulse for the projector.
fn step_of(timing: &Timing, clock_hz: u32) -> Step {
    Step {
        proj: Pulse::NONE,
        ..timing.step(clock_hz)
    }
}

/// A run of so many steps, each on an edge of its own.
fn program(steps: usize) -> Program {
    Program {
        start: Start::OnSync,
        pace: Pace::EachOnSync,
        sync_timeout: Micros(SYNC_PATIENCE_S * 1_000_000),
        ..Timing::table(steps as u32, 1)
    }
}

/// When each step began, s from the start of the run; `None` where its record was lost.
fn began_s(steps: &[Step], records: &[StepRecord], tick_s: f64) -> Vec<Option<f64>> {
    let mut began_s = vec![None; steps.len()];
    for record in records {
        let place = record.step.0 as usize;
        if let (Some(began_s), Some(step)) = (began_s.get_mut(place), steps.get(place)) {
            *began_s = Some(record.trigger.saturating_sub(step.cam.at).0 as f64 * tick_s);
        }
    }
    began_s
}

/// The steps that did not begin as long after their picture appeared as others did, and by how many display frames of `frame_s` they
/// were late: whole ones for frames that were shown again (positive) or left out. Not a number where that cannot be said.
fn unsteady(began_s: &[Option<f64>], appeared_s: &[Option<f64>], frame_s: f64) -> Vec<(usize, f64)> {
    let mut found = Vec::new();
    // When the last picture appeared, and how long after its picture a step begins: the two clocks' difference is part of it.
    let mut reference: Option<(f64, f64)> = None;
    let mut late_s: Option<f64> = None;
    for (step, (began_s, appeared_s)) in began_s.iter().zip(appeared_s).enumerate() {
        let Some(began_s) = *began_s else { continue };
        let Some(appeared_s) = *appeared_s else {
            found.push((step, f64::NAN));
            continue;
        };
        let after_s = began_s - appeared_s;
        let Some((last_s, expected_s)) = reference else {
            reference = Some((appeared_s, after_s));
            if step > 0 {
                found.push((step, f64::NAN));
            }
            continue;
        };
        let drift_s = DRIFT * (appeared_s - last_s);
        let slack_s = TOLERANCE * frame_s + drift_s;
        let off_s = after_s - expected_s;
        let is_late_again =
            off_s > slack_s && late_s.is_some_and(|late_s| (after_s - late_s).abs() <= slack_s);
        let expected_s = if is_late_again {
            after_s
        } else if off_s.abs() <= slack_s {
            // It follows the clocks, but no row of early edges.
            after_s.max(expected_s - drift_s)
        } else {
            found.push((step, off_s / frame_s));
            expected_s - drift_s
        };
        late_s = (off_s > slack_s && !is_late_again).then_some(after_s);
        reference = Some((appeared_s, expected_s));
    }
    found
}

/// Takes the step before the exposures away.
fn without_lead_in(haul: &mut Received) {
    haul.records.retain(|record| record.step.0 > 0);
    for record in &mut haul.records {
        record.step = StepId(record.step.0 - 1);
    }
    haul.unsteady.retain(|(step, _)| *step > 0);
    for (step, _) in &mut haul.unsteady {
        *step -= 1;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const FRAME_S: f64 = 1.0 / 60.0;

    /// Pictures that appear every so many frames, and steps that begin as they do.
    fn steady(frames: &[u32]) -> Vec<Option<f64>> {
        let mut at = 0;
        frames
            .iter()
            .map(|frames| {
                at += frames;
                Some(f64::from(at) * FRAME_S)
            })
            .collect()
    }

    proptest! {
        /// Whatever pictures take, latency, jitter and a drift of the clocks are nothing; frames too many or too few are told, with
        /// their number: too many once, too few until the end. So is an edge that is none of the picture's.
        #[test]
        fn frames_that_are_shown_again_or_left_out_are_told_apart(
            frames in proptest::collection::vec(2_u32..60, 3..40),
            latency_s in 0.0..0.3,
            jitter in proptest::collection::vec(-0.05..0.05, 40),
            drift in -50e-6..50e-6,
            at in any::<proptest::sample::Index>(),
            off in prop_oneof![-3..0, 1..4],
            stray in prop_oneof![-1.9..-0.4_f64, 0.4..1.9],
        ) {
            let appeared_s = steady(&frames);
            let began_s: Vec<Option<f64>> = appeared_s.iter().zip(&jitter).map(|(at_s, jitter)| {
                at_s.map(|at_s| (latency_s + at_s + jitter * FRAME_S) * (1.0 + drift))
            }).collect();
            prop_assert_eq!(unsteady(&began_s, &appeared_s, FRAME_S), []);

            // From one picture on everything comes later, or earlier.
            let at = 1 + at.index(frames.len() - 1);
            let moved = |from: usize, to: usize, frames: f64| -> Vec<Option<f64>> {
                let moved = |(step, began_s): (usize, &Option<f64>)| {
                    let is_moved = (from..to).contains(&step);
                    began_s.map(|began_s| if is_moved { began_s + frames * FRAME_S } else { began_s })
                };
                began_s.iter().enumerate().map(moved).collect()
            };
            let found = unsteady(&moved(at, frames.len(), f64::from(off)), &appeared_s, FRAME_S);
            let steps: Vec<usize> = found.iter().map(|(step, _)| *step).collect();
            let until = if off > 0 { at + 1 } else { frames.len() };
            prop_assert_eq!(steps, (at..until).collect::<Vec<_>>());
            prop_assert_eq!(found[0].1.round() as i32, off);

            // One step alone.
            let found = unsteady(&moved(at, at + 1, stray), &appeared_s, FRAME_S);
            prop_assert_eq!((found.len(), found[0].0), (1, at));
        }
    }

    #[test]
    fn what_cannot_be_compared_is_not_steady_and_a_lost_record_hides_nothing_behind_it() {
        let mut appeared_s = steady(&[3, 3, 4, 3, 5]);
        let mut began_s = appeared_s.clone();
        // A step that began without a picture.
        appeared_s[2] = None;
        let found = unsteady(&began_s, &appeared_s, FRAME_S);
        assert_eq!((found.len(), found[0].0, found[0].1.is_nan()), (1, 2, true));
        // A record is lost, and a frame shown again meanwhile: the next step is compared with the last that is known.
        appeared_s = began_s.clone();
        began_s[2] = None;
        assert_eq!(unsteady(&began_s, &appeared_s, FRAME_S), []);
        for began_s in began_s[3..].iter_mut().flatten() {
            *began_s += FRAME_S;
        }
        assert_eq!(unsteady(&began_s, &appeared_s, FRAME_S)[0].0, 3);
        // Not even the first is known.
        began_s[..3].fill(None);
        assert_eq!(unsteady(&began_s, &appeared_s, FRAME_S)[0].0, 3);
    }
}
