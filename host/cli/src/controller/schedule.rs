//! The schedule that `rcg controller run` fires and `rcg controller store` lets the box keep.

use rcg::capture::steps::{Bracket, Limits, Span};
use rcg::instrument::rig::Rig;
use rcg_protocol::{Aux, AuxPolarity, Extent, Micros, Pace, Polarity, Program, Start, Step, Ticks};

use super::further;
use crate::failure::Failure;

/// Options of a schedule.
#[derive(Debug, clap::Args)]
#[group(skip)]
pub(super) struct Schedule {
    /// Steps to fire, a multiple of the number of exposure times [default: 100 or the next multiple]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    steps: Option<u32>,
    /// Exposure time (length of the CAM pulse, 0us for none), or several that take turns [default: the rig's]
    #[arg(
        long,
        value_name = "TIME[,TIME…]",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    exposure: Vec<Span>,
    /// Length of a step [default: as short as the rig and the other times allow]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    period: Option<Span>,
    /// Leading edge of CAM from the start of the step [default: the rig's settling time, or less if --period says so]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    cam_at: Option<Span>,
    /// Length of the PROJ pulse, which begins the step; 0us for none [default: 5us]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    proj_width: Option<Span>,
    /// Begin at an edge of SYNC
    #[arg(long)]
    start_on_sync: bool,
    /// Begin each step at an edge of SYNC of its own
    #[arg(long)]
    each_on_sync: bool,
    /// End with a fault if SYNC does not come for so long [default: wait for ever]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    sync_timeout: Option<Span>,
    /// Take what STROBE does for less than this, up to 1ms, for a glitch [default: nothing is one]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    strobe_filter: Option<Span>,
    /// Lines that rest high and pulse low
    #[arg(long, value_name = "LINE[,LINE…]", value_delimiter = ',')]
    active_low: Vec<Line>,
    #[command(flatten)]
    further: further::Args,
}

/// What is longer is an exposure, or a pause between two.
const LONGEST_GLITCH_S: f64 = 1e-3;

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Line {
    Proj,
    Cam,
    Sync,
    Strobe,
    AuxA,
    AuxB,
    Photo,
    Start,
}

/// That of lines of which these rest high and pulse low.
pub(super) fn polarity(active_low: &[Line]) -> Polarity {
    let low = |line| active_low.contains(&line);
    Polarity {
        proj_active_low: low(Line::Proj),
        cam_active_low: low(Line::Cam),
        sync_active_low: low(Line::Sync),
        strobe_active_low: low(Line::Strobe),
    }
}

/// That of the further lines, of which these rest high and pulse low.
pub(super) fn aux_polarity(active_low: &[Line]) -> AuxPolarity {
    let low = |line| active_low.contains(&line);
    AuxPolarity {
        a_active_low: low(Line::AuxA),
        b_active_low: low(Line::AuxB),
        photo_active_low: low(Line::Photo),
        start_active_low: low(Line::Start),
    }
}

impl Schedule {
    /// The steps that take turns, and how many are fired.
    pub(super) fn steps(&self, rig: &Rig, limits: Limits) -> Result<(Vec<Step>, u32), Failure> {
        let bracket = Bracket {
            exposures: self.exposure.clone(),
            cam_at: self.cam_at,
            proj_width: self.proj_width,
            period: self.period,
        };
        let steps = bracket.steps(rig, limits)?;
        let turn = steps.len() as u32;
        let count = self.steps.unwrap_or_else(|| 100_u32.next_multiple_of(turn));
        if count.is_multiple_of(turn) {
            Ok((steps, count))
        } else {
            Err(Failure::input(format!(
                "--steps: expected a multiple of {turn}, the number of exposure times, found {count}"
            )))
        }
    }

    /// What of STROBE is a glitch.
    pub(super) fn glitch(&self, clock_hz: u32) -> Result<Option<Ticks>, Failure> {
        let Some(span) = self.strobe_filter else {
            return Ok(None);
        };
        let (seconds, ticks) = (span.seconds(clock_hz), span.ticks(clock_hz));
        if seconds.abs() <= 0.0 || (seconds <= LONGEST_GLITCH_S && ticks > Ticks::ZERO) {
            Ok(Some(ticks))
        } else {
            Err(Failure::input(format!(
                "--strobe-filter: expected 0s for none or from 1 tick to {} ms, found {span}",
                LONGEST_GLITCH_S * 1e3
            )))
        }
    }

    pub(super) const fn pace(&self) -> Pace {
        if self.each_on_sync {
            Pace::EachOnSync
        } else {
            Pace::FreeRunning
        }
    }

    /// The program of a table of `steps` steps that is played `cycles` times, or of a stream; no host has to be heard in it.
    pub(super) fn program(&self, extent: Extent, clock_hz: u32) -> Result<Program, Failure> {
        Ok(Program {
            extent,
            start: match (self.start_on_sync, self.further.start_on_line) {
                (true, _) => Start::OnSync,
                (false, true) => Start::OnStartLine,
                (false, false) => Start::AtOnce,
            },
            pace: self.pace(),
            polarity: polarity(&self.active_low),
            sync_timeout: micros(
                ("--sync-timeout", self.sync_timeout),
                [Micros(1), Micros(0)],
                clock_hz,
            )?,
            dead_man: Micros(0),
        })
    }

    /// What the further lines do in it, PHOTO stamped if `photo` says so; `None` if nothing is said of them.
    pub(super) fn aux(
        &self,
        photo: bool,
        schedule: (&[Step], &Program),
        limits: Limits,
    ) -> Result<Option<Aux>, Failure> {
        self.further
            .aux(aux_polarity(&self.active_low), photo, schedule, limits)
    }
}

/// The time-out that `name` asks for: 0 for none or `least` and more; else the default.
pub(super) fn micros(
    (name, span): (&str, Option<Span>),
    [least, default]: [Micros; 2],
    clock_hz: u32,
) -> Result<Micros, Failure> {
    let Some(span) = span else { return Ok(default) };
    let none = span.seconds(clock_hz) <= 0.0;
    span.micros(clock_hz)
        .filter(|micros| none || *micros >= least)
        .ok_or_else(|| {
            let least_ms = f64::from(least.0) * 1e-3;
            Failure::input(format!(
                "{name}: expected 0s for none or from {least_ms} ms to 4294 s, found {span}"
            ))
        })
}
