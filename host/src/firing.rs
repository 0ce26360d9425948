//! What the trigger box shall fire, as people say it: times with their units, and brackets of exposures.

use std::str::FromStr;

use rcg_protocol::{Micros, Pulse, Step, Ticks};

use crate::rig::Rig;
use crate::schedule::{ScheduleError, Timing};

/// A length of time with its unit: `5us`, `33.3 ms`, `3ticks`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Span {
    /// In seconds, not negative.
    Seconds(f64),
    /// In ticks of the controller's clock.
    Ticks(u64),
}

impl FromStr for Span {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        const EXPECTED: &str = "expected a time with its unit (s, ms, us, ns or ticks), such as 5us";
        let unit_at = text
            .find(|c: char| c.is_alphabetic() && !matches!(c, 'e' | 'E'))
            .ok_or(EXPECTED)?;
        let (number, unit) = (text[..unit_at].trim(), &text[unit_at..]);
        let scale = match unit {
            "s" => 1.0,
            "ms" => 1e-3,
            "us" | "\u{b5}s" | "\u{3bc}s" => 1e-6,
            "ns" => 1e-9,
            "tick" | "ticks" => return number.parse().map(Self::Ticks).map_err(|_| EXPECTED),
            _ => return Err(EXPECTED),
        };
        let number: f64 = number.parse().map_err(|_| EXPECTED)?;
        let fits = number.is_finite() && number >= 0.0;
        fits.then_some(Self::Seconds(number * scale)).ok_or(EXPECTED)
    }
}

impl Span {
    /// In ticks of a clock of `clock_hz`, the nearest.
    #[must_use]
    pub fn ticks(self, clock_hz: u32) -> Ticks {
        match self {
            Self::Seconds(s) => Ticks((s * f64::from(clock_hz)).round() as u64),
            Self::Ticks(ticks) => Ticks(ticks),
        }
    }

    /// In seconds.
    #[must_use]
    pub fn seconds(self, clock_hz: u32) -> f64 {
        match self {
            Self::Seconds(s) => s,
            Self::Ticks(ticks) => ticks as f64 / f64::from(clock_hz),
        }
    }

    /// In microseconds, the nearest, for time-outs; `None` above 71 minutes.
    #[must_use]
    pub fn micros(self, clock_hz: u32) -> Option<Micros> {
        let micros = (self.seconds(clock_hz) * 1e6).round();
        (micros <= f64::from(u32::MAX)).then_some(Micros(micros as u32))
    }
}

/// Steps that differ in their exposure time only. What is not given comes from the rig.
#[derive(Clone, Debug, Default)]
pub struct Bracket {
    /// Exposure times, one step each; 0 for a step without CAM.
    pub exposures: Vec<Span>,
    /// Leading edge of CAM from the start of the step.
    pub cam_at: Option<Span>,
    /// Length of the PROJ pulse, which begins the step; 0 for none.
    pub proj_width: Option<Span>,
    /// Length of every step; else each is as short as the rig allows.
    pub period: Option<Span>,
}

impl Bracket {
    /// The steps, in the order of the exposure times.
    ///
    /// # Errors
    /// [`ScheduleError`] for an exposure time out of range.
    pub fn steps(&self, rig: &Rig, clock_hz: u32) -> Result<Vec<Step>, ScheduleError> {
        let default = [Span::Seconds(rig.camera.exposure_s)];
        let exposures = if self.exposures.is_empty() {
            &default[..]
        } else {
            &self.exposures
        };
        let ticks =
            |span: Option<Span>, otherwise: Ticks| span.map_or(otherwise, |span| span.ticks(clock_hz));
        exposures
            .iter()
            .map(|exposure| {
                // The rig bounds the pace from a microsecond on; a pulse may well be shorter.
                let step = Timing::new(rig, exposure.seconds(clock_hz).max(1e-6))?.step(clock_hz);
                Ok(Step {
                    proj: Pulse {
                        at: Ticks::ZERO,
                        width: ticks(self.proj_width, step.proj.width),
                    },
                    cam: Pulse {
                        at: ticks(self.cam_at, step.cam.at),
                        width: exposure.ticks(clock_hz),
                    },
                    period: ticks(self.period, step.period),
                })
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLOCK_HZ: u32 = 125_000_000;

    #[test]
    fn times_have_units() {
        for (text, ticks) in [
            ("5us", 625),
            ("5 \u{b5}s", 625),
            ("33.3ms", 4_162_500),
            ("1s", 125_000_000),
            ("24 ns", 3),
            ("3ticks", 3),
            ("0us", 0),
            ("2e-3s", 250_000),
        ] {
            assert_eq!(
                text.parse::<Span>().unwrap().ticks(CLOCK_HZ),
                Ticks(ticks),
                "{text}"
            );
        }
        for text in [
            "5",
            "",
            "us",
            "-1us",
            "1.5ticks",
            "5 minutes",
            "nan s",
            "infs",
            "5us6",
            "1e999s",
        ] {
            let error = text.parse::<Span>().unwrap_err();
            assert!(error.starts_with("expected a time with its unit"), "{text}");
        }
        assert_eq!(
            "2s".parse::<Span>().unwrap().micros(CLOCK_HZ),
            Some(Micros(2_000_000))
        );
        assert_eq!("5000s".parse::<Span>().unwrap().micros(CLOCK_HZ), None);
    }

    #[test]
    fn a_bracket_is_one_step_for_each_exposure_and_the_rigs_own_unless_told() {
        let rig = Rig::load("rcg-1").unwrap();
        let own = Timing::new(&rig, rig.camera.exposure_s).unwrap().step(CLOCK_HZ);
        assert_eq!(Bracket::default().steps(&rig, CLOCK_HZ).unwrap(), [own]);
        let exposures = vec![Span::Seconds(0.002), Span::Ticks(7), Span::Ticks(0)];
        let bracket = Bracket {
            exposures: exposures.clone(),
            ..Bracket::default()
        };
        let steps = bracket.steps(&rig, CLOCK_HZ).unwrap();
        let widths: Vec<u64> = steps.iter().map(|step| step.cam.width.0).collect();
        assert_eq!(widths, [250_000, 7, 0]);
        assert!(
            steps[0].period > steps[1].period,
            "each as short as the rig allows"
        );
        let told = Bracket {
            exposures,
            cam_at: Some(Span::Ticks(100)),
            proj_width: Some(Span::Ticks(0)),
            period: Some(Span::Seconds(0.0021)),
        };
        for step in told.steps(&rig, CLOCK_HZ).unwrap() {
            assert_eq!((step.cam.at, step.period), (Ticks(100), Ticks(262_500)));
            assert!(step.proj.is_none());
        }
        let long = Bracket {
            exposures: vec![Span::Seconds(61.0)],
            ..Bracket::default()
        };
        assert!(long.steps(&rig, CLOCK_HZ).is_err());
    }
}
