//! What lies between the trigger box and the parts: polarity, pace, delays of optocouplers, glitches.
//!
//! # Design
//! Schedules and records are in the times of the parts: when an edge arrives at the projector or the camera, and when the camera
//! began and ceased to expose. What lies between delays each edge by its own time, so edges leave the box as much earlier; a step begins
//! so much earlier that none would have to leave before it. Of what comes back the delays are taken off.

use rcg_protocol::{Aux, Micros, Pace, Polarity, Program, Pulse, Start, Step, StepRecord, Strobe, Ticks};

use crate::base::blame::Blame;
use crate::capture::device::{Device, DeviceError};
use crate::capture::link::Link;
use crate::capture::steps::StepsError;
use crate::instrument::drivers::{Delay, Trigger, TriggerLine, TriggerPace};

/// The engine wants a few ticks between the last edge and the end of a step.
const AFTER_LAST_EDGE: Ticks = Ticks(8);

/// Delays that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WiringError {
    /// A pulse is shorter than what its edges are delayed differently by.
    #[error(
        "{field}: expected edges whose delays differ by less than the pulse of {pulse_s} s, found delays of {} s and {} s",
        delay.0[0], delay.0[1]
    )]
    PulseLost {
        /// The key of the rig file.
        field: &'static str,
        /// Length of the pulse, s.
        pulse_s: f64,
        /// The delays.
        delay: Delay,
    },
    /// STROBE came sooner than what lies between allows.
    #[error(
        "trigger.strobe_delay_s and trigger.cam_delay_s: expected delays that fit into what passed from the edge of CAM to \
         that of STROBE, {found_s} s, found {delays_s} s together"
    )]
    TooSoon {
        /// What passed, s.
        found_s: f64,
        /// Both delays, s.
        delays_s: f64,
    },
    /// What a further output does is not possible in a step.
    #[error("trigger.aux_a and trigger.aux_b: {0}")]
    Further(Box<StepsError>),
}

impl Blame for WiringError {
    fn is_input(&self) -> bool {
        true
    }
}

/// The wires of one rig. Without a table `[trigger]` in its file they change nothing.
#[derive(Clone, Debug, Default)]
pub struct Wiring {
    pub(super) trigger: Trigger,
}

impl Wiring {
    /// Those of `trigger`.
    #[must_use]
    pub fn new(trigger: Option<&Trigger>) -> Self {
        Self {
            trigger: trigger.cloned().unwrap_or_default(),
        }
    }

    /// Which lines rest high.
    #[must_use]
    pub fn polarity(&self) -> Polarity {
        let low = |line| self.trigger.active_low.contains(&line);
        Polarity {
            proj_active_low: low(TriggerLine::Proj),
            cam_active_low: low(TriggerLine::Cam),
            sync_active_low: low(TriggerLine::Sync),
            strobe_active_low: low(TriggerLine::Strobe),
        }
    }

    /// Tells `device` what it has to know before anything is fired: what of STROBE is a glitch, what its further lines do, and how its lines
    /// rest from its boot on.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] where a filter or a further line is wanted of a box that has none. One that keeps no
    /// polarity takes it from each schedule.
    pub fn prepare<L: Link>(&self, device: &mut Device<L>) -> Result<(), DeviceError> {
        if self.trigger.strobe_filter_s > 0.0 {
            let clock_hz = device.info().clock_hz;
            device.filter_strobe(Ticks(ticks(self.trigger.strobe_filter_s, clock_hz)).max(Ticks(1)))?;
        }
        let aux = self.aux(device.info().clock_hz);
        let begins_on_start = self.trigger.pace == TriggerPace::StartLine;
        match device.kept_aux() {
            Ok(kept) => {
                if kept != aux.polarity {
                    device.keep_aux(aux.polarity)?;
                }
                device.aux(&aux)?;
            }
            Err(DeviceError::Older { .. }) if aux == Aux::default() && !begins_on_start => {}
            Err(error) => return Err(error),
        }
        match device.kept() {
            Ok(kept) if kept != self.polarity() => device.keep(self.polarity()),
            Err(error) if !matches!(error, DeviceError::Older { .. }) => Err(error),
            _ => Ok(()),
        }
    }

    /// `program` over these wires, at the rig's pace.
    #[must_use]
    pub fn program(&self, program: Program) -> Program {
        let (start, pace) = match self.trigger.pace {
            TriggerPace::Free => (Start::AtOnce, Pace::FreeRunning),
            TriggerPace::SyncStart => (Start::OnSync, Pace::FreeRunning),
            TriggerPace::SyncEach => (Start::OnSync, Pace::EachOnSync),
            TriggerPace::StartLine => (Start::OnStartLine, Pace::FreeRunning),
        };
        Program {
            start,
            pace,
            polarity: self.polarity(),
            sync_timeout: Micros((self.trigger.sync_timeout_s * 1e6).round() as u32),
            ..program
        }
    }

    /// `program` over these wires, at its own pace.
    #[must_use]
    pub fn program_at_its_pace(&self, program: Program) -> Program {
        Program {
            polarity: self.polarity(),
            ..program
        }
    }

    /// `step` as it has to leave a box with a clock of `clock_hz`, to arrive as it is.
    ///
    /// # Errors
    /// [`WiringError::PulseLost`].
    pub fn step(&self, step: Step, clock_hz: u32) -> Result<Step, WiringError> {
        let lines = [
            ("trigger.proj_delay_s", step.proj, self.trigger.proj_delay_s),
            ("trigger.cam_delay_s", step.cam, self.trigger.cam_delay_s),
        ];
        // By so much the step begins earlier.
        let ahead = lines.iter().filter(|(_, pulse, _)| pulse.width > Ticks::ZERO);
        let ahead = ahead
            .map(|(_, pulse, delay)| in_ticks(*delay, clock_hz)[0].saturating_sub(pulse.at.0))
            .max()
            .unwrap_or(0);
        let [proj, cam] = lines.map(|(field, pulse, delay)| {
            if pulse.width == Ticks::ZERO {
                return Ok(pulse);
            }
            let [leading, trailing] = in_ticks(delay, clock_hz);
            let width = (pulse.width.0 + leading)
                .checked_sub(trailing)
                .filter(|width| *width > 0);
            let pulse_s = pulse.width.0 as f64 / f64::from(clock_hz);
            let width = width.ok_or(WiringError::PulseLost {
                field,
                pulse_s,
                delay,
            })?;
            Ok(Pulse {
                at: Ticks(pulse.at.0 + ahead - leading),
                width: Ticks(width),
            })
        });
        let (proj, cam) = (proj?, cam?);
        let end = (proj.at + proj.width).max(cam.at + cam.width);
        let changed = proj != step.proj || cam != step.cam;
        let period = if changed {
            step.period.max(end + AFTER_LAST_EDGE)
        } else {
            step.period
        };
        Ok(Step { proj, cam, period })
    }

    /// `record` in the times of the camera.
    ///
    /// # Errors
    /// [`WiringError::TooSoon`].
    pub fn record(&self, record: &StepRecord, clock_hz: u32) -> Result<StepRecord, WiringError> {
        let [cam, _] = in_ticks(self.trigger.cam_delay_s, clock_hz);
        let [on, off] = in_ticks(self.trigger.strobe_delay_s, clock_hz);
        let seconds = |ticks: u64| ticks as f64 / f64::from(clock_hz);
        let strobe = record.strobe.map(|strobe| {
            let too_soon = WiringError::TooSoon {
                found_s: seconds(strobe.delay.0),
                delays_s: seconds(cam + on),
            };
            // Stamps are up to a tick late, in steps of two: a delay that was found by them may be as much too long.
            let delay = (strobe.delay.0 + 2).checked_sub(cam + on).ok_or(too_soon)?;
            Ok(Strobe {
                delay: Ticks(delay.saturating_sub(2)),
                width: Ticks((strobe.width.0 + on).saturating_sub(off)),
            })
        });
        Ok(StepRecord {
            trigger: record.trigger + Ticks(cam),
            strobe: strobe.transpose()?,
            ..*record
        })
    }

    /// The time `on` at which STROBE became active, in the time of the camera.
    #[must_use]
    pub fn strobe_on(&self, on: Ticks, clock_hz: u32) -> Ticks {
        on.saturating_sub(Ticks(in_ticks(self.trigger.strobe_delay_s, clock_hz)[0]))
    }
}

pub(super) fn ticks(seconds: f64, clock_hz: u32) -> u64 {
    (seconds * f64::from(clock_hz)).round() as u64
}

fn in_ticks(delay: Delay, clock_hz: u32) -> [u64; 2] {
    delay.0.map(|seconds| ticks(seconds, clock_hz))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rcg_protocol::{Extent, StepFlags, StepId};

    use super::*;

    const CLOCK_HZ: u32 = 125_000_000;

    /// What each edge of a pulse that leaves as `pulse` becomes on the far side.
    fn arrives(pulse: Pulse, delay: Delay) -> [u64; 2] {
        let [leading, trailing] = in_ticks(delay, CLOCK_HZ);
        [pulse.at.0 + leading, pulse.at.0 + pulse.width.0 + trailing]
    }

    proptest! {
        /// Law: over wires with any delays the parts see the schedule, and what comes back is what the camera did.
        #[test]
        fn what_arrives_is_the_schedule_and_records_are_the_cameras(
            delays in prop::array::uniform6(0_u32..2_000),
            (cam_at, cam_width) in (0_u64..9_000, 2_000_u64..90_000),
            proj_width in prop_oneof![Just(0), 2_000_u64..9_000],
            exposes_after in 0_u64..900,
        ) {
            let delay = |k: usize| Delay([delays[k], delays[k + 1]].map(|ticks| f64::from(ticks) / f64::from(CLOCK_HZ)));
            let trigger = Trigger {
                proj_delay_s: delay(0),
                cam_delay_s: delay(2),
                strobe_delay_s: delay(4),
                ..Trigger::default()
            };
            let wiring = Wiring::new(Some(&trigger));
            let step = Step {
                proj: Pulse::new(0, proj_width),
                cam: Pulse::new(cam_at, cam_width),
                period: Ticks(100_000),
            };
            let leaves = wiring.step(step, CLOCK_HZ).unwrap();
            let cam = arrives(leaves.cam, trigger.cam_delay_s);
            prop_assert_eq!(cam[1] - cam[0], cam_width, "the exposure is as long as it should be");
            if proj_width > 0 {
                let proj = arrives(leaves.proj, trigger.proj_delay_s);
                prop_assert_eq!((proj[1] - proj[0], cam[0] - proj[0]), (proj_width, cam_at));
            } else {
                prop_assert_eq!(leaves.proj, step.proj);
            }
            prop_assert!(leaves.period >= step.period && leaves.period > leaves.cam.at + leaves.cam.width);

            // The camera exposes some time after its trigger; the box sees that later still.
            let [on, off] = in_ticks(trigger.strobe_delay_s, CLOCK_HZ);
            let exposes = cam[0] + exposes_after;
            let seen = StepRecord {
                step: StepId(3),
                trigger: leaves.cam.at,
                strobe: Some(Strobe {
                    delay: Ticks(exposes + on - leaves.cam.at.0),
                    width: Ticks(cam_width + off - on.min(cam_width + off)),
                }),
                flags: StepFlags::default(),
            };
            let record = wiring.record(&seen, CLOCK_HZ).unwrap();
            prop_assert_eq!(record.trigger.0, cam[0]);
            let strobe = record.strobe.unwrap();
            prop_assert_eq!((strobe.delay.0, strobe.width.0), (exposes_after, cam_width));
            prop_assert_eq!(wiring.strobe_on(Ticks(exposes + on), CLOCK_HZ), Ticks(exposes));
        }
    }

    #[test]
    fn wires_without_a_word_change_nothing_and_others_say_what_they_are() {
        let plain = Wiring::new(None);
        let program = Program::new(Extent::Table { steps: 1, cycles: 7 });
        let step = Step {
            proj: Pulse::new(0, 5),
            cam: Pulse::new(3, 9),
            period: Ticks(12),
        };
        assert_eq!(plain.program(program), program);
        assert_eq!(plain.step(step, CLOCK_HZ), Ok(step));
        let trigger = Trigger {
            active_low: vec![TriggerLine::Cam, TriggerLine::Strobe],
            pace: TriggerPace::SyncEach,
            sync_timeout_s: 1.5,
            cam_delay_s: Delay([1e-6, 5e-6]),
            strobe_delay_s: Delay([2e-6, 2e-6]),
            ..Trigger::default()
        };
        let wiring = Wiring::new(Some(&trigger));
        let over = wiring.program(program);
        assert_eq!((over.start, over.pace), (Start::OnSync, Pace::EachOnSync));
        assert_eq!(over.sync_timeout, Micros(1_500_000));
        assert!(over.polarity.cam_active_low && over.polarity.strobe_active_low);
        assert!(!over.polarity.proj_active_low && !over.polarity.sync_active_low);
        let paced = wiring.program_at_its_pace(program);
        assert_eq!((paced.polarity, paced.pace), (over.polarity, program.pace));
        // A pulse of 9 ticks does not survive a trailing edge that is 500 ticks earlier than it can be.
        let lost = wiring.step(step, CLOCK_HZ).unwrap_err();
        assert!(lost.to_string().contains("trigger.cam_delay_s"), "{lost}");
        let record = StepRecord {
            step: StepId(0),
            trigger: Ticks(100),
            strobe: Some(Strobe {
                delay: Ticks(372),
                width: Ticks(9),
            }),
            flags: StepFlags::default(),
        };
        let soon = wiring.record(&record, CLOCK_HZ).unwrap_err();
        assert!(soon.to_string().contains("trigger.strobe_delay_s"), "{soon}");
    }

    /// The camera of the virtual rig is at the box's own pins: what is taken off is off.
    #[test]
    fn a_segment_is_taken_over_such_wires_at_each_pace() {
        use std::sync::Arc;

        use crate::brdf::sample;
        use crate::capture::Instrument;
        use crate::instrument::rig::Rig;
        use crate::plan::Faults;
        use crate::plan::schedule::Timing;
        use crate::store::Tally;
        use crate::virtual_rig::{Behaviour, Held, Noise, Truth};
        use TriggerLine::{Cam, Proj, Strobe, Sync};
        const US: u64 = 125;
        let rig = Rig::load("rcg-2").unwrap().with_image_size(16).unwrap();
        let timing = Timing::new(&rig, 4e-3).unwrap();
        let mut spacing = Vec::new();
        for pace in [TriggerPace::Free, TriggerPace::SyncStart, TriggerPace::SyncEach] {
            let behaviour = Behaviour {
                noise: Noise::Off,
                seed: 1,
                faults: Faults::default(),
                lamp_h: 0.0,
            };
            let held = Held::Sample(Arc::from(sample::parse("lambert:0.1").unwrap()));
            let mut instrument = Instrument::simulated(&Truth::of(&rig), held, behaviour).unwrap();
            instrument.wiring = Wiring::new(Some(&Trigger {
                active_low: vec![Proj, Cam, Sync, Strobe],
                pace,
                sync_timeout_s: 0.5,
                strobe_filter_s: 1e-7,
                cam_delay_s: Delay([1e-6, 3e-6]),
                strobe_delay_s: Delay([2e-6, 1e-6]),
                ..Trigger::default()
            }));
            let Instrument { device, wiring, .. } = &mut instrument;
            wiring.prepare(device).unwrap();
            assert_eq!(device.kept().unwrap(), wiring.polarity());
            let mut tally = Tally::default();
            let taken = instrument
                .take(3, &[timing], |_, _| (), &mut tally, |_| ())
                .unwrap();
            for captured in &taken {
                let [trigger, on, off] = captured.ticks.map(|ticks| ticks.0);
                let delay = (rig.camera.exposure_delay_s * 1e6).round() as u64 * US;
                assert_eq!((captured.attempts, on - trigger), (1, delay - 3 * US), "{pace:?}");
                assert_eq!(off - on, 4000 * US - US, "2 us shorter, and 1 us longer");
            }
            spacing.push(taken[1].ticks[0].0 - taken[0].ticks[0].0);
        }
        assert_eq!(spacing[0], spacing[1], "within a run the box alone paces");
        assert!(
            spacing[2] > spacing[1],
            "each step waits for its edge: {spacing:?}"
        );
    }
}
