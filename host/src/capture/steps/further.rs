//! What the further outputs do in every step, as people say it.

use std::fmt;
use std::str::FromStr;

use rcg_firmware::pulse::WordFormat;
use rcg_protocol::{Aux, AuxPulse, Program, Pulse, Step, Ticks};

use super::{Limits, Named, Span, StepsError, check_with};

/// A pulse of a further output in every step: `1ms+5us` begins 1 ms into the step and lasts 5 us; `cam` goes with CAM, `cam+1us` 1 us later
/// and as long as CAM, `cam+1us+5us` 5 us long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AuxSpan {
    /// From the start of the step.
    InStep {
        /// Leading edge.
        at: Span,
        /// Length.
        width: Span,
    },
    /// From the leading edge of CAM.
    WithCam {
        /// Leading edge.
        after: Span,
        /// Length; else that of CAM.
        width: Option<Span>,
    },
}

impl FromStr for AuxSpan {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        const EXPECTED: &str =
            "expected AT+WIDTH, such as 1ms+5us, or cam, cam+AFTER or cam+AFTER+WIDTH, such as cam+1us+5us";
        let span = |text: &str| text.parse::<Span>().map_err(|_| EXPECTED.to_owned());
        let width = |text: &str| {
            let width = span(text)?;
            if matches!(width, Span::Ticks(0)) || matches!(width, Span::Seconds(s) if s <= 0.0) {
                return Err("expected a width of more than 0".to_owned());
            }
            Ok(width)
        };
        let parts: Vec<&str> = text.split('+').collect();
        match *parts.as_slice() {
            ["cam"] => Ok(Self::WithCam {
                after: Span::Ticks(0),
                width: None,
            }),
            ["cam", after] => Ok(Self::WithCam {
                after: span(after)?,
                width: None,
            }),
            ["cam", after, length] => Ok(Self::WithCam {
                after: span(after)?,
                width: Some(width(length)?),
            }),
            [at, length] => Ok(Self::InStep {
                at: span(at)?,
                width: width(length)?,
            }),
            _ => Err(EXPECTED.to_owned()),
        }
    }
}

impl fmt::Display for AuxSpan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::InStep { at, width } => write!(f, "{at}+{width}"),
            Self::WithCam { after, width: None } => write!(f, "cam+{after}"),
            Self::WithCam {
                after,
                width: Some(width),
            } => write!(f, "cam+{after}+{width}"),
        }
    }
}

impl AuxSpan {
    /// As the trigger box with these `limits` is told of it, where `option` says it.
    ///
    /// # Errors
    /// [`StepsError::BelowTick`].
    pub fn pulse(self, option: &'static str, limits: Limits) -> Result<AuxPulse, StepsError> {
        let ticks = |span| limits.ticks(option, span);
        Ok(match self {
            Self::InStep { at, width } => AuxPulse::InStep(Pulse {
                at: ticks(at)?,
                width: ticks(width)?,
            }),
            Self::WithCam { after, width } => AuxPulse::WithCam {
                after: ticks(after)?,
                width: width.map_or(Ok(Ticks::ZERO), ticks)?,
            },
        })
    }
}

impl Limits {
    /// Those of steps in which further outputs do what `aux` says.
    #[must_use]
    pub fn with_aux(self, aux: &Aux, program: &Program) -> Self {
        let format = WordFormat::new(program.pace, program.polarity).with_aux(aux);
        Self {
            longest_period: self.longest_period.min(format.longest_period()),
            ..self
        }
    }
}

/// Whether the trigger box with these `limits` can make `steps` of `program` with what the further outputs do.
///
/// # Errors
/// [`StepsError`] names the step and what in it cannot be.
pub fn further(aux: &Aux, steps: &[Step], program: &Program, limits: Limits) -> Result<(), StepsError> {
    const A: [&str; 2] = ["the leading edge of AUX-A", "the trailing edge of AUX-A"];
    const B: [&str; 2] = ["the leading edge of AUX-B", "the trailing edge of AUX-B"];
    if !aux.has_pulses() {
        return Ok(());
    }
    let limits = limits.with_aux(aux, program);
    for (index, step) in steps.iter().enumerate() {
        let beyond = Pulse {
            at: Ticks(u64::MAX),
            width: Ticks(1),
        };
        let pulses: [Named; 2] = [("AUX-A", aux.a, A), ("AUX-B", aux.b, B)]
            .map(|(name, pulse, edges)| (name, pulse.of(step).unwrap_or(beyond), edges));
        check_with(index, step, &pulses, limits)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use rcg_firmware::pulse::StepWords;
    use rcg_protocol::{Extent, Info, Pace};

    use super::*;

    #[test]
    fn what_people_say_is_what_it_means_or_refused() {
        let limits = Limits {
            clock_hz: 125_000_000,
            shortest: Ticks(3),
            longest_period: Ticks(1 << 40),
        };
        let with_cam = |after, width| AuxPulse::WithCam {
            after: Ticks(after),
            width: Ticks(width),
        };
        for (text, pulse) in [
            ("1ms+5us", AuxPulse::InStep(Pulse::new(125_000, 625))),
            ("0ticks+3ticks", AuxPulse::InStep(Pulse::new(0, 3))),
            ("cam", with_cam(0, 0)),
            ("cam+8ns", with_cam(1, 0)),
            ("cam+0s+1us", with_cam(0, 125)),
        ] {
            let span: AuxSpan = text.parse().unwrap();
            assert_eq!(span.pulse("--aux-a", limits), Ok(pulse), "{text}");
            let again: AuxSpan = span.to_string().parse().unwrap();
            assert_eq!(again.pulse("--aux-a", limits), Ok(pulse), "{text} as {span}");
        }
        for text in [
            "",
            "5us",
            "cam+",
            "cam+1",
            "+5us",
            "5us+",
            "proj+5us",
            "1us+2us+3us",
            "cam+1us+2us+3us",
            "1us+-2us",
        ] {
            assert!(
                text.parse::<AuxSpan>().unwrap_err().contains("expected AT+WIDTH"),
                "{text}"
            );
        }
        for text in ["1us+0us", "cam+1us+0ticks"] {
            assert!(
                text.parse::<AuxSpan>().unwrap_err().contains("more than 0"),
                "{text}"
            );
        }
        let short: AuxSpan = "1us+1ns".parse().unwrap();
        let error = short.pulse("--aux-b", limits).unwrap_err().to_string();
        assert!(
            error.starts_with("--aux-b: expected 0 or at least 24 ns"),
            "{error}"
        );
    }

    /// Law: what passes here the box makes, and what does not it refuses.
    #[test]
    fn the_box_and_the_host_agree_on_what_can_be_made() {
        let info = Info {
            firmware: (0, 0, 0),
            clock_hz: 125_000_000,
            max_steps: 9,
            max_words: 9,
            shortest_free: 3,
            shortest_sync: 5,
            longest_period: rcg_firmware::pulse::LONGEST_PERIOD,
        };
        let mut made = 0;
        for pace in [Pace::FreeRunning, Pace::EachOnSync] {
            let limits = Limits::new(&info, pace);
            let program = Program {
                pace,
                ..Program::new(Extent::Stream)
            };
            for (at, width, after) in (0..14_u64).flat_map(|at| {
                (0..8_u64).flat_map(move |width| (0..8_u64).map(move |after| (at, width, after)))
            }) {
                for period in [40, 50, 34 << 26, 34 << 25, (34 << 26) + 200] {
                    let step = Step {
                        proj: Pulse::new(0, 10),
                        cam: Pulse::new(20, 12),
                        period: Ticks(period),
                    };
                    let aux = Aux {
                        a: AuxPulse::InStep(Pulse::new(3 * at, 2 * width)),
                        b: AuxPulse::WithCam {
                            after: Ticks(after),
                            width: Ticks(width),
                        },
                        ..Aux::default()
                    };
                    let format = WordFormat::new(pace, program.polarity).with_aux(&aux);
                    let theirs = format.encode_into(&step, &aux, 0, &mut StepWords::new());
                    let ours = further(&aux, &[step], &program, limits);
                    assert_eq!(
                        ours.is_ok(),
                        theirs.is_ok(),
                        "{aux:?}, period {period}: {ours:?}, {theirs:?}"
                    );
                    made += u32::from(ours.is_ok());
                }
            }
        }
        assert!(made > 100, "{made}");
        let aux = Aux {
            a: AuxPulse::InStep(Pulse::new(u64::MAX, 9)),
            ..Aux::default()
        };
        let step = Step {
            period: Ticks(100),
            ..Step::default()
        };
        let program = Program::new(Extent::Stream);
        let error = further(&aux, &[step], &program, Limits::new(&info, Pace::FreeRunning)).unwrap_err();
        assert!(error.to_string().contains("AUX-A"), "{error}");
    }
}
