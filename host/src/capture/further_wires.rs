//! What the further lines of the trigger box do on one rig.

use rcg_protocol::{Aux, AuxPolarity, AuxPulse, Info, Program, Pulse, Step, Ticks};

use crate::capture::steps::{Limits, further};
use crate::capture::wiring::{Wiring, WiringError, ticks};
use crate::instrument::drivers::{AuxFrom, AuxOutput, TriggerLine};

impl Wiring {
    /// What the further lines of a box with a clock of `clock_hz` do.
    #[must_use]
    pub fn aux(&self, clock_hz: u32) -> Aux {
        let low = |line| self.trigger.active_low.contains(&line);
        let pulse = |output: Option<AuxOutput>| {
            let Some(output) = output else {
                return AuxPulse::Off;
            };
            let after = Ticks(ticks(output.delay_s, clock_hz));
            // What is more than nothing may not become nothing, which has a meaning of its own.
            let width = output
                .width_s
                .map(|width_s| Ticks(ticks(width_s, clock_hz).max(1)));
            match output.from {
                AuxFrom::Step => AuxPulse::InStep(Pulse {
                    at: after,
                    width: width.unwrap_or(Ticks::ZERO),
                }),
                AuxFrom::Cam => AuxPulse::WithCam {
                    after,
                    width: width.unwrap_or(Ticks::ZERO),
                },
            }
        };
        Aux {
            polarity: AuxPolarity {
                a_active_low: low(TriggerLine::AuxA),
                b_active_low: low(TriggerLine::AuxB),
                photo_active_low: low(TriggerLine::Photo),
                start_active_low: low(TriggerLine::Start),
            },
            a: pulse(self.trigger.aux_a),
            b: pulse(self.trigger.aux_b),
            photo: false,
        }
    }

    /// Whether the box that says `info` of itself can make `steps` of `program`, as they leave it, with what its further outputs do.
    ///
    /// # Errors
    /// [`WiringError::Further`].
    pub fn check(&self, steps: &[Step], program: &Program, info: &Info) -> Result<(), WiringError> {
        let limits = Limits::new(info, program.pace);
        further(&self.aux(info.clock_hz), steps, program, limits)
            .map_err(|error| WiringError::Further(Box::new(error)))
    }
}

#[cfg(test)]
mod tests {
    use rcg_protocol::{Extent, Pace, Start};

    use super::*;
    use crate::instrument::drivers::{Trigger, TriggerPace};

    const CLOCK_HZ: u32 = 125_000_000;

    #[test]
    fn further_lines_do_what_the_rig_says() {
        let step = Step {
            proj: Pulse::new(0, 5),
            cam: Pulse::new(3, 9),
            period: Ticks(12),
        };
        let program = Program::new(Extent::Table { steps: 1, cycles: 7 });
        let low = [TriggerLine::AuxB, TriggerLine::Start].map(|line| Trigger {
            active_low: vec![line],
            ..Trigger::default()
        });
        assert!(Wiring::new(Some(&low[0])).aux(CLOCK_HZ).polarity.b_active_low);
        let further = Trigger {
            aux_a: Some(AuxOutput {
                from: AuxFrom::Cam,
                delay_s: 2e-6,
                width_s: None,
            }),
            aux_b: Some(AuxOutput {
                from: AuxFrom::Step,
                delay_s: 8e-9,
                width_s: Some(1e-6),
            }),
            pace: TriggerPace::StartLine,
            ..low[1].clone()
        };
        let over = Wiring::new(Some(&further));
        let expected = Aux {
            polarity: AuxPolarity {
                start_active_low: true,
                ..AuxPolarity::default()
            },
            a: AuxPulse::WithCam {
                after: Ticks(250),
                width: Ticks(0),
            },
            b: AuxPulse::InStep(Pulse::new(1, 125)),
            photo: false,
        };
        assert_eq!(over.aux(CLOCK_HZ), expected);
        let program = over.program(program);
        assert_eq!(
            (program.start, program.pace),
            (Start::OnStartLine, Pace::FreeRunning)
        );
        let info = Info {
            firmware: (0, 0, 0),
            clock_hz: CLOCK_HZ,
            max_steps: 1,
            max_words: 1,
            shortest_free: 3,
            shortest_sync: 5,
            longest_period: Ticks(1 << 33),
        };
        // AUX-B ends 126 ticks into a step of 12.
        let outside = over.check(&[step], &program, &info).unwrap_err().to_string();
        assert!(
            outside.contains("trigger.aux_b: step 0: expected the AUX-A pulse"),
            "{outside}"
        );
    }
}
