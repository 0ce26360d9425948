//! Capture: fires the controller, collects frames, pairs them with their triggers, and takes again what is
//! missing.
//!
//! # Design
//! One call of [`Instrument::take`] takes one segment. What the pairing did not settle is taken again in a
//! further run of just those patterns, until nothing is missing or [`ATTEMPTS`] are used up. While the trigger box fires, a thread of
//! its own takes the frames in (`intake`); the box waits between two segments until the writer has room for one more. In memory are the
//! frames that fit into the [`ring`] and those of three segments at most: one that is captured, one that waits and one that is written.
//!
//! Of several exposures of a pattern (brackets) the first step shows it and it stays for the others: a table of that many
//! steps, played once for each pattern. A repetition of some of them shows the pattern before the first that is missing,
//! each with its own exposure time, from a table that says so step by step. Where the projector cannot be triggered it leads
//! (`led`), and each exposure has its pattern shown anew. Where the projector makes the bands (`banded`), each pattern is shown in one
//! primary after the other, and an image is made of their frames.

mod banded;
pub mod camera;
pub mod camera_clock;
pub mod device;
pub mod directory;
pub mod dlpc900;
pub mod files;
pub mod flow;
pub mod follow;
mod further_wires;
#[cfg(feature = "genicam")]
pub mod genicam;
mod intake;
mod led;
pub mod link;
pub mod native;
pub mod pairing;
pub mod pilot;
pub mod projector;
pub mod real;
pub mod records;
pub mod replay;
pub mod ring;
pub mod selftest;
pub mod session;
pub mod steps;
pub mod update;
#[cfg(feature = "window")]
pub mod window;
pub mod wiring;

use std::time::Duration;

use rcg_protocol::{Event, State, Step, StepRecord, Ticks};

use crate::capture::banded::Order;
use crate::capture::camera::{Camera, CameraError, Fired, Frame};
use crate::capture::device::{Device, DeviceError};
use crate::capture::follow::Ending;
use crate::capture::intake::taking_in;
use crate::capture::link::Link;
use crate::capture::pairing::{Outcome, Pairing, pair};
use crate::capture::projector::{Projector, ProjectorError};
use crate::capture::wiring::{Wiring, WiringError};
use crate::plan::pattern::BitPattern;
use crate::plan::schedule::Timing;
use crate::store::OrphanFrame;

pub use crate::store::Tally;

/// How often an exposure is tried.
pub const ATTEMPTS: u8 = 8;
/// Frames may be this late after the last strobe.
const FRAMES_LATE: Duration = Duration::from_millis(500);

/// Trigger box, camera and projector of one rig.
pub struct Instrument {
    /// The trigger box.
    pub device: Device<Box<dyn Link>>,
    /// The camera.
    pub camera: Box<dyn Camera>,
    /// The projector.
    pub projector: Box<dyn Projector>,
    /// Row-major indices of projector pixels that are lit in every pattern, black ones too: those that watch the lamp, see
    /// [`crate::instrument::monitor`].
    pub watching: Vec<u32>,
    /// What lies between the trigger box and the parts.
    pub wiring: Wiring,
    /// How often each pattern is shown: in each of the projector's primaries, whose frames are the channels of one image, or once in white
    /// (1). See [`Rig::shown_bands`](crate::instrument::rig::Rig::shown_bands).
    pub bands: usize,
}

/// One exposure.
#[derive(Clone, Debug)]
pub struct Captured {
    /// Digital numbers, [row, column, channel].
    pub dn: Vec<u16>,
    /// Ticks from the start of its run to the trigger, the strobe's beginning and its end; of several bands those of the first, as number
    /// and time-stamp.
    pub ticks: [Ticks; 3],
    /// Number of the frame in its run.
    pub frame_id: u64,
    /// Start of its exposure on the camera's own clock, s.
    pub camera_timestamp_s: f64,
    /// How often it was tried, at least 1.
    pub attempts: u8,
    /// Flags of the controller's record.
    pub flags: u8,
}

/// Why a capture failed.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// The controller.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The projector.
    #[error(transparent)]
    Projector(#[from] ProjectorError),
    /// What lies between the trigger box and the parts.
    #[error(transparent)]
    Wiring(#[from] WiringError),
    /// The controller ended the run by itself.
    #[error(
        "controller: expected a run of {expected} steps, found that it ended as `{state}` after {done}{reason}"
    )]
    Ended {
        /// Steps of the run.
        expected: u64,
        /// How it ended.
        state: State,
        /// Steps done.
        done: u64,
        /// The fault, with a colon before it, or nothing.
        reason: String,
    },
    /// The photodiode does not see what the projector shows.
    #[error(
        "projector {projector}: expected an edge of SYNC as picture {picture} of a run appeared, found none: does the \
         photodiode see the patch of the image, and is it wired to SYNC?"
    )]
    Unseen {
        /// The projector.
        projector: String,
        /// Number of the picture, from 0 on.
        picture: u64,
    },
    /// An exposure failed again and again.
    #[error(
        "exposure {exposure} of this segment: expected a frame, found none in {ATTEMPTS} attempts ({outcome})"
    )]
    GaveUp {
        /// Which one, from the start of the segment.
        exposure: usize,
        /// What became of the last attempt.
        outcome: Outcome,
    },
}

/// What one run brought.
struct Received {
    records: Vec<StepRecord>,
    spurious_on: Vec<u64>,
    frames: Vec<Frame>,
    /// Steps that did not begin when their picture appeared, and by how many display frames they were late.
    unsteady: Vec<(usize, f64)>,
}

impl Received {
    /// Room for `steps` steps.
    fn of(steps: usize) -> Self {
        Self {
            records: Vec::with_capacity(steps),
            spurious_on: Vec::new(),
            frames: Vec::with_capacity(steps),
            unsteady: Vec::new(),
        }
    }
}

/// Keeps what an `event` of a run over `wiring` says of its steps and strobes, in the times of the parts.
fn hear(
    event: Option<&Event>,
    (wiring, clock_hz): (&Wiring, u32),
    records: &mut Vec<StepRecord>,
    spurious_on: &mut Vec<u64>,
) -> Result<(), WiringError> {
    match event {
        Some(Event::Records { records: new, .. }) => {
            for record in new {
                records.push(wiring.record(record, clock_hz)?);
            }
        }
        Some(Event::SpuriousStrobe { on, .. }) => spurious_on.push(wiring.strobe_on(*on, clock_hz).0),
        _ => {}
    }
    Ok(())
}

impl Instrument {
    /// Takes images of `timings` of each of `count` patterns, one pattern after the other; `timings` is a
    /// [series](Timing::series). `patterns(i, image)` draws pattern `i` into an image that is black but for what watches
    /// the lamp, once for each band; `taken(n)` is told after each event how many images have been recorded so far.
    ///
    /// # Errors
    /// [`CaptureError`].
    pub fn take(
        &mut self,
        count: usize,
        timings: &[Timing],
        mut patterns: impl FnMut(usize, &mut BitPattern),
        tally: &mut Tally,
        mut taken: impl FnMut(usize),
    ) -> Result<Vec<Captured>, CaptureError> {
        let order = Order {
            brackets: timings.len(),
            bands: self.bands,
        };
        let count = count * order.bands * order.brackets;
        let mut done: Vec<Option<Captured>> = vec![None; count];
        let mut open: Vec<usize> = (0..count).collect();
        let mut last = Outcome::NoRecord;
        for attempt in 1..=ATTEMPTS {
            let (steps, shown) = self.load(&open, timings, order, &mut patterns)?;
            let settled = count - open.len();
            let recorded = |recorded| taken((settled + recorded) / order.bands);
            let fired: Vec<(usize, usize)> = open.iter().map(|&one| order.image_and_band(one)).collect();
            let Received {
                records,
                spurious_on,
                mut frames,
                unsteady,
            } = if self.projector.leading().is_some() {
                self.run_led(&steps, &shown, &fired, recorded)?
            } else {
                self.run(&steps, order.brackets, &fired, recorded)?
            };
            let tick_s = 1.0 / f64::from(self.device.info().clock_hz);
            let mut pairing = pair(open.len(), &records, &spurious_on, &frames, tick_s);
            for (step, _) in unsteady {
                if let Some(outcome @ Outcome::Paired(_)) = pairing.outcomes.get_mut(step) {
                    *outcome = Outcome::Unsteady;
                }
            }
            let clock_hz = self.device.info().clock_hz;
            for record in records
                .iter()
                .filter(|record| is_cut_short(record, &steps, clock_hz))
            {
                if let Some(outcome @ Outcome::Paired(_)) = pairing.outcomes.get_mut(record.step.0 as usize) {
                    *outcome = Outcome::Disputed;
                }
            }
            tally.spurious_strobes += spurious_on.len() as u64;
            count_strays(tally, &pairing, &frames);

            let mut by_step = vec![None; open.len()];
            for record in &records {
                if let Some(place) = by_step.get_mut(record.step.0 as usize) {
                    *place = Some(record);
                }
            }
            for (step, outcome) in pairing.outcomes.iter().enumerate() {
                match *outcome {
                    Outcome::Paired(frame) => {
                        let record = by_step[step].expect("a paired step has a record");
                        done[open[step]] = Some(captured(record, &mut frames[frame], attempt));
                        tally.paired += 1;
                    }
                    Outcome::MissedTrigger => tally.missed_triggers += 1,
                    Outcome::DroppedFrame => tally.dropped_frames += 1,
                    Outcome::NoRecord => tally.lost_records += 1,
                    Outcome::Disputed | Outcome::Unsteady => tally.disputed += 1,
                }
                if !matches!(outcome, Outcome::Paired(_)) {
                    last = *outcome;
                }
            }
            open = order.open(&done);
            if open.is_empty() {
                break;
            }
            // Of an image that is taken again as a whole.
            let dropped = open.iter().filter_map(|&exposure| done[exposure].take());
            tally.paired -= dropped.count() as u64;
            tracing::info!(again = open.len(), attempt, outcome = ?last, "exposures are taken again");
            tally.repeated += open.len() as u64;
        }
        match open.first() {
            Some(&exposure) => Err(CaptureError::GaveUp {
                exposure: order.image_and_band(exposure).0,
                outcome: last,
            }),
            None => Ok(order.images(done)),
        }
    }

    /// Loads the patterns of the exposures in `open`. Returns the steps that take these, and which of the loaded patterns each shows.
    fn load(
        &mut self,
        open: &[usize],
        timings: &[Timing],
        order: Order,
        patterns: &mut impl FnMut(usize, &mut BitPattern),
    ) -> Result<(Vec<Timing>, Vec<usize>), CaptureError> {
        let (width_px, height_px) = self.projector.size_px();
        let mut image = BitPattern::black(width_px, height_px);
        let is_led = self.projector.leading().is_some();
        self.projector.clear()?;
        let mut steps = Vec::with_capacity(open.len());
        let mut shown = Vec::with_capacity(open.len());
        let (mut showing, mut loaded) = (None, 0);
        for &exposure in open {
            let (picture, timing) = (order.picture(exposure), &timings[exposure % order.brackets]);
            let is_new = showing != Some(picture);
            if is_new {
                showing = Some(picture);
                let (pattern, band) = order.pattern_and_band(picture);
                image.clear();
                image.light(&self.watching);
                patterns(pattern, &mut image);
                order.show(band, &mut image);
                self.projector.load(&image)?;
                loaded += 1;
            }
            shown.push(loaded - 1);
            steps.push(if is_new || is_led {
                timing.shown(&timings[0])
            } else {
                *timing
            });
        }
        self.projector.pace(&steps)?;
        self.projector.ready()?;
        Ok((steps, shown))
    }

    /// One run of the controller over `timings`, which take these `exposures` of the segment: (image, band) of each.
    /// If these are the first `cycle` again and again, the table is no longer.
    fn run(
        &mut self,
        timings: &[Timing],
        cycle: usize,
        exposures: &[(usize, usize)],
        mut recorded: impl FnMut(usize),
    ) -> Result<Received, CaptureError> {
        let steps = timings.len();
        let cycle = cycle.min(steps);
        let cyclic = timings.chunks(cycle).all(|chunk| *chunk == timings[..cycle]);
        let table = &timings[..if cyclic { cycle } else { steps }];
        let clock_hz = self.device.info().clock_hz;
        let Self {
            device,
            camera,
            wiring,
            ..
        } = self;
        let table = table
            .iter()
            .map(|timing| wiring.step(timing.step(clock_hz), clock_hz));
        let table: Vec<Step> = table.collect::<Result<_, _>>()?;
        let program = wiring.program(Timing::table(table.len() as u32, (steps / table.len()) as u32));
        wiring.check(&table, &program, &device.info())?;
        camera.arm()?;
        let mut haul = Received::of(steps);
        let (frames, records, spurious_on) = (&mut haul.frames, &mut haul.records, &mut haul.spurious_on);
        let ending = taking_in(camera.as_mut(), frames, |take_in| {
            device.play_with(
                &program,
                &table,
                |_| take_in(),
                |event| {
                    hear(event, (wiring, clock_hz), records, spurious_on)?;
                    recorded(records.len());
                    Ok(())
                },
            )
        })?;
        is_done(ending, steps)?;
        self.receive_late(timings, exposures, &mut haul)?;
        Ok(haul)
    }

    /// Tells the camera what was fired of these `exposures` of the segment, (image, band) of each, and takes in the frames that are still on their way when the
    /// run over `timings` has ended.
    fn receive_late(
        &mut self,
        timings: &[Timing],
        exposures: &[(usize, usize)],
        haul: &mut Received,
    ) -> Result<(), CaptureError> {
        let tick_s = 1.0 / f64::from(self.device.info().clock_hz);
        let fired = haul.records.iter().filter_map(|record| {
            let (exposure, band) = *exposures.get(record.step.0 as usize)?;
            Some(Fired {
                exposure,
                band,
                on_s: (record.trigger + record.strobe?.delay).0 as f64 * tick_s,
            })
        });
        self.camera.fired(&fired.collect::<Vec<_>>())?;
        while let Some(frame) = self.camera.next_frame(Duration::ZERO)? {
            haul.frames.push(frame);
        }
        let longest_s = timings.iter().map(|timing| timing.period_s).fold(0.0, f64::max);
        let patience = FRAMES_LATE.max(Duration::from_secs_f64(longest_s));
        let strobes = haul
            .records
            .iter()
            .filter(|record| record.strobe.is_some())
            .count();
        while haul.frames.len() < strobes {
            match self.camera.next_frame(patience)? {
                Some(frame) => haul.frames.push(frame),
                None => break,
            }
        }
        Ok(())
    }
}

/// Whether the strobe of a `record` is less than half as long as the exposure that its step asks for: then it is none of that trigger, which
/// the camera ignored, but of something else that made it expose behind it.
fn is_cut_short(record: &StepRecord, steps: &[Timing], clock_hz: u32) -> bool {
    let asked = steps
        .get(record.step.0 as usize)
        .map(|timing| timing.step(clock_hz).cam.width);
    asked
        .zip(record.strobe)
        .is_some_and(|(asked, strobe)| 2 * strobe.width.0 < asked.0)
}

/// Counts the `frames` of a run that came twice or that no strobe explains.
fn count_strays(tally: &mut Tally, pairing: &Pairing, frames: &[Frame]) {
    tally.duplicates += pairing.duplicates as u64;
    tally.orphans += pairing.orphans.len() as u64;
    tally.orphan_frames.extend(pairing.orphans.iter().map(|&frame| {
        let Frame { id, timestamp_s, .. } = frames[frame];
        OrphanFrame {
            frame_id: id,
            timestamp_s,
        }
    }));
}

/// Refuses a run that ended before its `steps` were over.
fn is_done(ending: Ending, steps: usize) -> Result<(), CaptureError> {
    if ending.state == State::Done {
        return Ok(());
    }
    Err(CaptureError::Ended {
        expected: steps as u64,
        state: ending.state,
        done: ending.steps_done,
        reason: ending.fault.map_or(String::new(), |fault| format!(": {fault}")),
    })
}

fn captured(record: &StepRecord, frame: &mut Frame, attempts: u8) -> Captured {
    let strobe = record.strobe.expect("invariant: a frame is paired by its strobe");
    let on = record.trigger + strobe.delay;
    Captured {
        dn: std::mem::take(&mut frame.dn),
        ticks: [record.trigger, on, on + strobe.width],
        frame_id: frame.id,
        camera_timestamp_s: frame.timestamp_s,
        attempts,
        flags: record.flags.0,
    }
}
