//! Times of one step, in seconds for people and in ticks for the controller.

use std::borrow::Cow;

use rcg_protocol::{Extent, Micros, Program, Pulse, Step, Ticks};
use serde::{Deserialize, Serialize};

use crate::instrument::rig::{Panel, Rig};

/// Length of the PROJ pulse: inputs of projectors want a few microseconds.
const PROJ_PULSE_S: f64 = 5e-6;

/// The shortest exposure time in s that a schedule takes.
pub const SHORTEST_EXPOSURE_S: f64 = 1e-6;
/// The longest one.
pub const LONGEST_EXPOSURE_S: f64 = 60.0;
/// Exposure times in s.
pub const EXPOSURES_S: std::ops::RangeInclusive<f64> = SHORTEST_EXPOSURE_S..=LONGEST_EXPOSURE_S;

/// Times of one step in s from its start.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Timing {
    /// Length of the PROJ pulse, which begins the step.
    pub proj_width_s: f64,
    /// Leading edge of the CAM pulse.
    pub cam_at_s: f64,
    /// Length of the CAM pulse: the exposure time.
    pub cam_width_s: f64,
    /// Length of the step.
    pub period_s: f64,
}

/// From one trigger to the next in s, for exposures of `exposures_s` seconds of one pattern on `rig`. One exposure: as
/// short as the rig allows. Of several the first waits for the pattern, which then stays, and each waits until the one
/// before is read out, because a long exposure may still be read when a short one after it is over.
pub fn periods_s(rig: &Rig, exposures_s: &[f64]) -> Vec<f64> {
    let rig = &*unhurried(rig);
    if let [exposure_s] = exposures_s {
        return vec![rig.step_period_s(*exposure_s)];
    }
    let mut periods: Vec<f64> = exposures_s
        .iter()
        .map(|exposure_s| rig.camera.exposure_delay_s + exposure_s + rig.camera.readout_s)
        .collect();
    if let Some(first) = periods.first_mut() {
        *first = (*first + rig.projector.settle_s).max(rig.projector.min_period_s);
    }
    periods
}

/// What bounds the pace of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Bound {
    /// Settling, exposing and reading out take longest.
    Camera,
    /// The projector shows patterns no faster.
    Projector,
}

/// Times that do not fit together.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ScheduleError {
    /// The exposure time is out of range.
    #[error("exposure time in ms: expected a number from 0.001 to 60000, found {}", .exposure_s * 1e3)]
    Exposure {
        /// What was asked for.
        exposure_s: f64,
    },
    /// No trigger box makes steps that long.
    #[error(
        "rig {rig}: expected steps of at most {LONGEST_PERIOD_S} s, found that settling, exposure and read-out take \
         {period_s} s"
    )]
    Period {
        /// Name of the rig.
        rig: String,
        /// What it takes.
        period_s: f64,
    },
}

/// Longest step in seconds: that of a trigger box at 125 MHz, see [`rcg_firmware::pulse::LONGEST_PERIOD`].
pub const LONGEST_PERIOD_S: f64 = 120.0;

/// In so many settling times what is left of a pattern fades to 10⁻⁴ of it and less, even where it is 2 % after the first.
pub const PATIENCE: f64 = 4.0;

/// Edges that are not in the same tick are at least this far apart, in ticks: what the pulse engine wants when it waits
/// for SYNC, which is more than it wants when it runs free.
const APART: u64 = rcg_firmware::pulse::PACED_OVERHEAD as u64;

/// Whether pictures of `rig` need [`PATIENCE`]: those of bands follow on each other, and what liquid crystals leave of red in green
/// nothing would tell.
fn needs_patience(rig: &Rig) -> bool {
    rig.shows_bands() && rig.projector.panel == Panel::LiquidCrystal
}

/// `rig` with as long a time to settle as its pictures need.
fn unhurried(rig: &Rig) -> Cow<'_, Rig> {
    if needs_patience(rig) {
        Cow::Owned(waiting(rig))
    } else {
        Cow::Borrowed(rig)
    }
}

/// `rig` with [`PATIENCE`] times as long to settle.
fn waiting(rig: &Rig) -> Rig {
    let mut rig = rig.clone();
    rig.projector.settle_s *= PATIENCE;
    rig
}

fn within_longest(rig: &Rig, period_s: f64) -> Result<(), ScheduleError> {
    if period_s <= LONGEST_PERIOD_S {
        return Ok(());
    }
    Err(ScheduleError::Period {
        rig: rig.name.clone(),
        period_s,
    })
}

impl Timing {
    /// The fastest step of `rig` with exposures of `exposure_s` seconds: the pattern settles, then the camera
    /// is triggered; the next pattern comes when the exposure is over, or when the camera is ready if it
    /// cannot expose while it reads out.
    ///
    /// # Errors
    /// [`ScheduleError`] for an exposure time out of range.
    pub fn new(rig: &Rig, exposure_s: f64) -> Result<Self, ScheduleError> {
        if !EXPOSURES_S.contains(&exposure_s) {
            return Err(ScheduleError::Exposure { exposure_s });
        }
        Self::settled(&unhurried(rig), exposure_s)
    }

    /// As [`new`](Self::new), with the time to settle that `rig` has.
    fn settled(rig: &Rig, exposure_s: f64) -> Result<Self, ScheduleError> {
        let cam_at_s = rig.projector.settle_s;
        let period_s = rig.step_period_s(exposure_s);
        within_longest(rig, period_s)?;
        Ok(Self {
            proj_width_s: PROJ_PULSE_S.min(cam_at_s.max(1e-6)),
            cam_at_s,
            cam_width_s: exposure_s,
            period_s,
        })
    }

    /// As [`new`](Self::new), but each pattern has [`PATIENCE`] times as long to settle. So calibrations see one pattern at a time: beside
    /// black light a spot is dim, and what watches the lamp has to be as bright in the first frame of a run as in all others.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn patient(rig: &Rig, exposure_s: f64) -> Result<Self, ScheduleError> {
        if needs_patience(rig) {
            return Self::new(rig, exposure_s);
        }
        Self::new(&waiting(rig), exposure_s)
    }

    /// The steps of exposures of `exposures_s` seconds of one pattern: the first shows it, and it stays for the others.
    /// So the projector needs no more memory, and no more time to settle, than for one exposure.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn series(rig: &Rig, exposures_s: &[f64]) -> Result<Vec<Self>, ScheduleError> {
        let steps = exposures_s.iter().zip(periods_s(rig, exposures_s)).enumerate();
        steps
            .map(|(at, (&exposure_s, period_s))| {
                let shown = Self::new(rig, exposure_s)?;
                // A repetition may have to show the pattern before any of them.
                within_longest(rig, period_s + shown.cam_at_s)?;
                Ok(match at {
                    0 => Self { period_s, ..shown },
                    _ => Self {
                        proj_width_s: 0.0,
                        cam_at_s: 0.0,
                        cam_width_s: exposure_s,
                        period_s,
                    },
                })
            })
            .collect()
    }

    /// This step with the pattern shown anew, as in `first`, the step of a series that shows it: for a repetition that
    /// begins with this exposure.
    #[must_use]
    pub fn shown(&self, first: &Self) -> Self {
        let settling_s = first.cam_at_s - self.cam_at_s;
        Self {
            proj_width_s: first.proj_width_s,
            cam_at_s: first.cam_at_s,
            period_s: (self.period_s + settling_s).max(first.period_s),
            ..*self
        }
    }

    /// What bounds the pace on `rig`.
    #[must_use]
    pub fn bound(&self, rig: &Rig) -> Bound {
        if self.period_s > rig.projector.min_period_s * 1.000_001 {
            Bound::Camera
        } else {
            Bound::Projector
        }
    }

    /// The step in ticks of a clock of `clock_hz`; times are rounded to the nearest tick, the period up, and edges that
    /// would be too close for the pulse engine move to the same tick or a few ticks apart.
    #[must_use]
    pub fn step(&self, clock_hz: u32) -> Step {
        let ticks = |s: f64| (s * f64::from(clock_hz)).round() as u64;
        let period = (self.period_s * f64::from(clock_hz) - 1e-6).ceil() as u64;
        let cam_width = ticks(self.cam_width_s).max(APART);
        let cam_at = match ticks(self.cam_at_s) {
            0 => 0,
            at => at.max(APART),
        };
        let near = |edge: &u64| edge.abs_diff(ticks(self.proj_width_s)) < APART;
        let proj_width = match ticks(self.proj_width_s) {
            0 => 0,
            width => [cam_at, cam_at + cam_width]
                .into_iter()
                .find(near)
                .unwrap_or(width)
                .max(APART),
        };
        let end = proj_width.max(cam_at + cam_width);
        Step {
            proj: Pulse::new(0, proj_width),
            cam: Pulse::new(cam_at, cam_width),
            // The engine wants a few ticks between the last edge and the end.
            period: Ticks(period.max(end + 8)),
        }
    }

    /// A run of `exposures` such steps.
    #[must_use]
    pub fn program(exposures: u32) -> Program {
        Self::table(1, exposures)
    }

    /// A run of a table of `steps` steps, `cycles` times.
    #[must_use]
    pub fn table(steps: u32, cycles: u32) -> Program {
        Program {
            dead_man: Micros::DEFAULT_DEAD_MAN,
            ..Program::new(Extent::Table { steps, cycles })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_camera_sees_one_settled_pattern_and_is_ready_again() {
        for preset in crate::instrument::rig::PRESETS {
            let rig = Rig::load(preset).unwrap();
            for exposure_s in [1e-6, rig.camera.exposure_s, 0.1] {
                let timing = Timing::new(&rig, exposure_s).unwrap();
                let exposed = timing.cam_at_s + rig.camera.exposure_delay_s;
                assert!(
                    exposed >= rig.projector.settle_s,
                    "{preset}: exposes while the pattern settles"
                );
                let over = exposed + exposure_s;
                // The next pattern appears its settling time after the step's end.
                assert!(
                    timing.period_s + rig.projector.settle_s >= over,
                    "{preset}: sees the next pattern"
                );
                let busy = if rig.camera.overlap {
                    over
                } else {
                    over + rig.camera.readout_s
                };
                assert!(
                    timing.period_s + exposed >= busy,
                    "{preset}: triggers a busy camera"
                );
                assert!(timing.period_s >= rig.projector.min_period_s);
            }
        }
    }

    #[test]
    fn ticks_are_the_times_and_the_engine_accepts_them() {
        use rcg_firmware::pulse::WordFormat;
        for preset in crate::instrument::rig::PRESETS {
            let rig = Rig::load(preset).unwrap();
            for clock_hz in [125_000_000, 200_000_000] {
                for exposure_s in [1e-6, rig.camera.exposure_s, 60.0] {
                    let timing = Timing::new(&rig, exposure_s).unwrap();
                    let step = timing.step(clock_hz);
                    let s = |ticks: Ticks| ticks.0 as f64 / f64::from(clock_hz);
                    assert!((s(step.cam.at) - timing.cam_at_s).abs() < 1e-8);
                    assert!((s(step.cam.width) - exposure_s).abs() < 1e-8);
                    assert!(
                        s(step.period) >= timing.period_s - 1e-12 && s(step.period) < timing.period_s + 1e-7
                    );
                    let program = Timing::program(1);
                    WordFormat::new(program.pace, program.polarity)
                        .encode(&step, 0)
                        .expect("fits the engine");
                }
            }
        }
    }

    /// Whatever a rig file may say, each step of its schedules can be made, and lasts as it should to a few ticks.
    #[test]
    fn every_rig_has_steps_that_the_engine_makes() {
        use proptest::prelude::*;
        use rcg_firmware::pulse::WordFormat;
        use rcg_protocol::{Pace, Polarity};
        // From a few ticks to the longest, evenly in decades; nothing at all too.
        let span = |low: f64, high: f64| {
            prop_oneof![
                1 => Just(0.0),
                9 => (low.log10()..high.log10()).prop_map(|exponent| 10_f64.powf(exponent)),
            ]
        };
        let worlds = (
            (
                span(1e-9, 20.0),
                span(1e-7, 20.0),
                span(1e-9, 5.0),
                span(1e-9, 20.0),
            ),
            proptest::collection::vec(1e-6..20.0_f64, 1..6),
            any::<bool>(),
            prop_oneof![Just(125_000_000_u32), Just(200_000_000), Just(150_000_000)],
        );
        proptest!(|(((settle_s, min_period_s, delay_s, readout_s), mut exposures_s, overlap, clock_hz) in worlds)| {
            let mut rig = Rig::load("rcg-1-16bit").unwrap();
            rig.projector.settle_s = settle_s;
            rig.projector.min_period_s = min_period_s.max(1e-7);
            rig.camera.exposure_delay_s = delay_s;
            rig.camera.readout_s = readout_s;
            rig.camera.overlap = overlap;
            exposures_s.sort_by(f64::total_cmp);
            let series = Timing::series(&rig, &exposures_s).unwrap();
            let again = series.iter().map(|timing| timing.shown(&series[0]));
            for timing in series.iter().copied().chain(again) {
                let step = timing.step(clock_hz);
                for pace in [Pace::FreeRunning, Pace::EachOnSync] {
                    let words = WordFormat::new(pace, Polarity::default()).encode(&step, 0);
                    prop_assert!(words.is_ok(), "{timing:?} {step:?}: {words:?}");
                }
                let s = |ticks: Ticks| ticks.0 as f64 / f64::from(clock_hz);
                prop_assert!((s(step.cam.width) - timing.cam_width_s).abs() < 1e-8);
                prop_assert!((s(step.cam.at) - timing.cam_at_s).abs() < 5e-8);
                prop_assert!(s(step.period) > timing.period_s - 1e-12);
                prop_assert!(s(step.period) < timing.period_s + 6e-6, "{timing:?} {step:?}");
            }
        });
    }

    #[test]
    fn steps_that_no_trigger_box_makes_are_refused() {
        let mut rig = Rig::load("rcg-1-16bit").unwrap();
        rig.projector.settle_s = 59.0;
        rig.camera.readout_s = 30.0;
        for exposures_s in [&[60.0][..], &[1.0, 60.0]] {
            let refused = Timing::series(&rig, exposures_s).unwrap_err().to_string();
            assert!(
                refused.starts_with("rig rcg-1-16bit: expected steps of at most 120 s"),
                "{refused}"
            );
        }
    }

    #[test]
    fn bands_of_liquid_crystals_wait_until_the_one_before_is_gone() {
        let white = Rig::load("rcg-1-16bit").unwrap();
        let mut rig = white.clone();
        rig.camera.channels = 1;
        rig.bands = Some(crate::instrument::bands::tests::in_turn());
        for exposures_s in [&[0.01][..], &[0.01, 0.05]] {
            let [hasty, bands] = [&white, &rig].map(|rig| Timing::series(rig, exposures_s).unwrap());
            let patient = Timing::patient(&white, 0.01).unwrap();
            assert!((bands[0].cam_at_s - patient.cam_at_s).abs() < 1e-12);
            let later_s = bands[0].cam_at_s - hasty[0].cam_at_s;
            assert!((bands[0].period_s - hasty[0].period_s - later_s).abs() < 1e-12);
            assert_eq!(bands[1..], hasty[1..]);
            assert_eq!(Timing::patient(&rig, 0.01).unwrap(), patient);
        }
        rig.projector.panel = Panel::Mirrors;
        assert_eq!(Timing::new(&rig, 0.01), Timing::new(&white, 0.01));
    }

    #[test]
    fn the_prototypes_pace_and_the_dmds() {
        let rcg1 = Rig::load("rcg-1-16bit").unwrap();
        let timing = Timing::new(&rcg1, rcg1.camera.exposure_s).unwrap();
        assert!(
            (timing.period_s * 32_400.0 / 60.0 - 50.0).abs() < 0.1,
            "50 minutes in the paper"
        );
        assert_eq!(timing.bound(&rcg1), Bound::Camera);
        let dmd = Rig::load("dmd").unwrap();
        let timing = Timing::new(&dmd, dmd.camera.exposure_s).unwrap();
        assert!((1.0 / timing.period_s - 9523.8).abs() < 0.5);
        assert_eq!(timing.bound(&dmd), Bound::Projector);
    }

    #[test]
    fn exposure_times_out_of_range_are_refused() {
        let rig = Rig::load("rcg-1-16bit").unwrap();
        for exposure_s in [0.0, -1.0, 61.0, f64::NAN, f64::INFINITY] {
            assert!(Timing::new(&rig, exposure_s).is_err(), "{exposure_s}");
        }
    }
}
