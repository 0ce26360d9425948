//! Micromirrors behind a Texas Instruments DLPC900: DLP6500, DLP9000, DLP670S, DLP500YX, DLP5500.
//!
//! # Design
//! Patterns are uploaded over USB HID (pattern-on-the-fly mode), 24 to an image, and advance by the trigger line. Source is the
//! programmer's guide, DLPU018 (revision J); where it is silent, what drivers of others found on their tables.
//!
//! | line of the unit | line of the trigger box |
//! |---|---|
//! | TRIG_IN_1 | PROJ: its edge shows the next pattern after `trigger_delay_us` |
//! | TRIG_IN_2 | none: tie it high, the sequence runs while it is; its level when the sequence starts counts as that |
//! | TRIG_OUT_1 | SYNC: it frames the exposure of each pattern |
//!
//! One bit a mirror: a pattern of the brightest level is one plane, and with `hold` it stays until the next trigger, however long and
//! often the camera looks; beside that it is exposed for as long as the camera looks, so that both say the same. Nothing is dithered. A sequence with other levels is shown with eight bits, by switching mirrors in time: each
//! pattern begins as the camera's exposure begins and lasts as long, 4,046 µs or more, and the camera looks once at each. Where steps
//! do not leave 105 µs before the next trigger, that is refused.
//!
//! What hangs or tells of an error is stopped, set to another mode and back, once; then it is given up by name.
//!
//! # Tradeoffs
//! Reports go once a millisecond: 64 kB a second, so that a segment of 400 spots takes some seconds to upload.
//!
//! A trigger that comes too early is lost, and all patterns behind it are late by one: rigs whose steps are shorter than delay and shortest
//! exposure together are refused, although a unit may take faster ones, and exposures end 105 µs before the next trigger.

mod choose;
#[cfg(feature = "dlpc900")]
mod hid;
pub mod image;
pub mod model;
pub mod packet;
pub mod reports;
pub mod sheet;
pub mod unit;
pub mod video;

use std::fmt::Display;

use crate::capture::projector::{Projector, ProjectorError, check_resolution, check_room};
use crate::instrument::drivers::{Dlpc900, Edge, LONGEST_US, SHORTEST_US};
use crate::plan::pattern::BitPattern;
use crate::plan::schedule::Timing;

use self::image::{PLANES, Planes};
use self::model::{FIRMWARE, IMAGES, Model, SHORTEST_GREY_US};
use self::packet::{CommandError, Commands};
use self::reports::Reports;
use self::unit::{Entry, Mode, Play, Status, Triggers, Unit};

pub use self::choose::{Found, Kind, Opened, list, open};

/// How long a pattern with levels has to be over before the next trigger, µs: the black one behind it.
const APART_US: u32 = 105;
/// A tick or two of rounding, µs.
const ROUNDING_US: f64 = 0.5;

/// A DLPC900 as a projector.
pub struct Dlpc900Projector {
    name: String,
    unit: Unit,
    status: Status,
    model: Model,
    settings: Dlpc900,
    /// From the CAM edge to the start of the exposure, µs.
    camera_late_us: f64,
    patterns: Vec<BitPattern>,
    shown: Shown,
}

/// How the patterns that are loaded are shown.
#[derive(Clone, Debug, PartialEq)]
struct Shown {
    delay_us: u16,
    /// Of each pattern; the last one of those behind it too.
    exposures_us: Vec<u32>,
}

impl Shown {
    /// Whatever the camera does.
    fn of(settings: &Dlpc900) -> Self {
        Self {
            delay_us: settings.trigger_delay_us,
            exposures_us: vec![settings.exposure_us.unwrap_or(SHORTEST_US)],
        }
    }

    fn exposure_us(&self, pattern: usize) -> u32 {
        let last = self.exposures_us.last().copied().unwrap_or(SHORTEST_US);
        self.exposures_us.get(pattern).copied().unwrap_or(last)
    }
}

impl Dlpc900Projector {
    /// The unit that `settings` name. The camera's exposure begins `camera_late_s` after the CAM edge.
    ///
    /// # Errors
    /// [`ProjectorError::Failed`] where there is none, several, or one that this driver does not know.
    pub fn open(settings: &Dlpc900, camera_late_s: f64) -> Result<Self, ProjectorError> {
        let opened = open(settings.device.as_deref(), &[Kind::Dlpc900])?;
        Self::over(&opened.name, opened.reports, settings, camera_late_s)
    }

    /// The unit behind `reports`, which people know by `name`.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn over(
        name: &str,
        reports: Box<dyn Reports>,
        settings: &Dlpc900,
        camera_late_s: f64,
    ) -> Result<Self, ProjectorError> {
        let mut unit = Unit::new(Commands::new(reports));
        let failed = |reason: String| ProjectorError::Failed {
            projector: name.to_owned(),
            reason,
        };
        let status = with_recovery(&mut unit, |unit| {
            let status = unit.status()?;
            unit.check()?;
            Ok(status)
        })
        .map_err(&failed)?;
        if !FIRMWARE.contains(&status.firmware.0) {
            let (major, minor, patch) = status.firmware;
            return Err(failed(format!(
                "expected firmware {} to {}, whose commands this driver knows, found {major}.{minor}.{patch}; update it with the \
                 maker's program",
                FIRMWARE.start(),
                FIRMWARE.end()
            )));
        }
        let model = status.model().ok_or_else(|| {
            failed(format!(
                "expected a DLP6500, DLP9000, DLP670S, DLP500YX or DLP5500, found mirrors of code {}; flash the firmware of the \
                 mirrors that are there",
                status.mirrors
            ))
        })?;
        if status.secondary != model.is_dual {
            return Err(failed(format!(
                "expected {} secondary controller beside a {}, found {}; flash the firmware of the mirrors that are there",
                if model.is_dual { "a" } else { "no" },
                model.name,
                if status.secondary { "one" } else { "none" }
            )));
        }
        Ok(Self {
            name: format!("{} at {name}", model.name),
            unit,
            status,
            model,
            settings: settings.clone(),
            camera_late_us: camera_late_s * 1e6,
            patterns: Vec::new(),
            shown: Shown::of(settings),
        })
    }

    /// What it said of itself when it was opened.
    #[must_use]
    pub const fn status(&self) -> &Status {
        &self.status
    }

    /// Its mirrors.
    #[must_use]
    pub const fn model(&self) -> &Model {
        &self.model
    }

    /// Shows what is loaded, one pattern after the other without any trigger, each for `exposure_us`.
    ///
    /// # Errors
    /// [`ProjectorError`].
    pub fn run_free(&mut self, exposure_us: u32, sent: &mut dyn FnMut(usize)) -> Result<(), ProjectorError> {
        self.shown.exposures_us = vec![exposure_us];
        self.program(false, sent)
    }

    /// As [`ready`](Projector::ready); `sent` is told of the bytes that are uploaded.
    ///
    /// # Errors
    /// [`ProjectorError`].
    pub fn ready_telling(&mut self, sent: &mut dyn FnMut(usize)) -> Result<(), ProjectorError> {
        self.program(true, sent)
    }

    /// Compares what the unit says with what it was told: mode, faults, and that its sequence runs.
    ///
    /// # Errors
    /// [`ProjectorError`].
    pub fn check_runs(&mut self) -> Result<Status, ProjectorError> {
        let status = self.unit.status().map_err(|error| self.failed(error))?;
        let found = if status.mode != Mode::OnTheFly {
            status.mode.name()
        } else if !status.running {
            "a stopped one"
        } else if status.parked {
            "parked mirrors"
        } else {
            return Ok(status);
        };
        Err(self.failed(format!(
            "expected a running sequence of patterns on the fly, found {found}"
        )))
    }

    fn failed(&self, reason: impl Display) -> ProjectorError {
        ProjectorError::Failed {
            projector: self.name.clone(),
            reason: reason.to_string(),
        }
    }

    /// Bits of the patterns that are loaded.
    fn depth(&self) -> usize {
        if self.patterns.iter().any(is_grey) { 8 } else { 1 }
    }

    /// The sequence of what is loaded.
    fn entries(&self, waits: bool) -> Vec<Entry> {
        let depth = self.depth();
        let each = PLANES / depth;
        let entry = |(number, pattern): (usize, &BitPattern)| Entry {
            exposure_us: self.shown.exposure_us(number),
            clears: !self.settings.hold,
            depth: depth as u8,
            light: pattern.primary().map_or(7, |primary| 1 << primary),
            waits,
            image: number / each,
            plane: number % each * depth,
        };
        self.patterns.iter().enumerate().map(entry).collect()
    }

    /// Tells the unit all of it, and starts the sequence.
    fn program(&mut self, waits: bool, sent: &mut dyn FnMut(usize)) -> Result<(), ProjectorError> {
        let depth = self.depth();
        if depth > 1 {
            for exposure_us in &mut self.shown.exposures_us {
                *exposure_us = (*exposure_us).max(SHORTEST_GREY_US);
            }
        }
        let entries = self.entries(waits);
        let images: Vec<Vec<Vec<u8>>> = self
            .patterns
            .chunks(PLANES / depth)
            .map(|patterns| {
                let planes = Planes::of(patterns, depth);
                let parts = self.model.halves().into_iter();
                parts.map(|columns| planes.upload(columns)).collect()
            })
            .collect();
        let triggers = Triggers {
            delay_us: self.shown.delay_us,
            falling: self.settings.trigger_edge == Edge::Falling,
            inverted: self.settings.sync_inverted,
            late_us: self.settings.sync_late_us,
        };
        with_recovery(&mut self.unit, |unit| {
            unit.set_mode(Mode::OnTheFly)?;
            unit.set_triggers(&triggers)?;
            unit.define(&entries)?;
            for (number, parts) in images.iter().enumerate().rev() {
                unit.upload(number, parts, sent)?;
            }
            // What is uploaded counts from here on.
            unit.configure(entries.len())?;
            unit.check()?;
            unit.play(Play::Start)?;
            unit.check()
        })
        .map_err(|reason| self.failed(reason))
    }

    /// The steps of each pattern, as times in µs from its trigger: (camera's window from, until, to the next trigger).
    fn windows(&self, steps: &[Timing]) -> Vec<Vec<[f64; 3]>> {
        let mut windows: Vec<Vec<[f64; 3]>> = Vec::new();
        let mut at_us = 0.0;
        for step in steps {
            if step.proj_width_s > 0.0 || windows.is_empty() {
                windows.push(Vec::new());
                at_us = 0.0;
            }
            let from_us = at_us + step.cam_at_s * 1e6 + self.camera_late_us;
            at_us += step.period_s * 1e6;
            let of_pattern = windows.last_mut().expect("invariant: one was pushed");
            of_pattern.push([from_us, from_us + step.cam_width_s * 1e6, at_us]);
        }
        windows
    }

    /// Begins patterns with levels as the camera's exposure begins, and lets them last as long.
    fn pace_grey(&mut self, windows: &[Vec<[f64; 3]>]) -> Result<(), ProjectorError> {
        let first = windows.first().and_then(|steps| steps.first()).copied();
        let Some([from_us, until_us, next_us]) = first else {
            return Ok(());
        };
        let alike = |steps: &Vec<[f64; 3]>| {
            let near = |[from, until, _]: &[f64; 3]| {
                (from - from_us).abs() < ROUNDING_US && (until - until_us).abs() < ROUNDING_US
            };
            steps.len() == 1 && steps.iter().all(near)
        };
        if !windows.iter().all(alike) {
            return Err(self.failed(
                "expected one exposure of one time for each pattern with levels of grey, found several: mirrors make grey by switching \
                 in the time of one exposure",
            ));
        }
        let (longest, exposure_us) = (f64::from(u16::MAX), until_us - from_us);
        if exposure_us + ROUNDING_US < f64::from(SHORTEST_GREY_US) {
            return Err(self.failed(format!(
                "expected exposures of {SHORTEST_GREY_US} µs or more for levels of grey, in which mirrors switch through eight bits, \
                 found {exposure_us:.0} µs; expose longer"
            )));
        }
        if from_us > longest {
            return Err(self.failed(format!(
                "expected levels of grey to begin within {longest} µs of their trigger, found that the camera's exposure does after \
                 {from_us:.0} µs; lower projector.settle_s"
            )));
        }
        let needed_us = until_us + f64::from(APART_US);
        if windows
            .iter()
            .flatten()
            .any(|step| step[2] + ROUNDING_US < needed_us)
        {
            return Err(self.failed(format!(
                "expected {needed_us:.0} µs from trigger to trigger for levels of grey, found {next_us:.0} µs; raise \
                 projector.min_period_s to that"
            )));
        }
        self.shown = Shown {
            delay_us: from_us.round() as u16,
            exposures_us: vec![exposure_us.round() as u32],
        };
        Ok(())
    }
}

/// Whether it has a level between black and the brightest.
fn is_grey(pattern: &BitPattern) -> bool {
    !matches!(pattern.level(), 0 | u8::MAX)
}

/// What `work` makes of the unit; where that fails, the unit is stopped, set to another mode and back, and it is tried once more. The
/// error is a sentence's end.
fn with_recovery<T>(
    unit: &mut Unit,
    mut work: impl FnMut(&mut Unit) -> Result<T, CommandError>,
) -> Result<T, String> {
    let first = match work(unit) {
        Ok(done) => return Ok(done),
        // Nobody is there who could be stopped.
        Err(error @ CommandError::Connection(_)) => return Err(error.to_string()),
        Err(error) => error,
    };
    tracing::warn!(error = %first, "the DLPC900 is stopped, set to another mode and back");
    unit.recover();
    work(unit).map_err(|error| {
        format!("{error}, after it was stopped, set to video mode and back; switch its power off and on")
    })
}

impl Projector for Dlpc900Projector {
    fn name(&self) -> &str {
        &self.name
    }

    fn description(&self) -> String {
        let (major, minor, patch) = self.status.firmware;
        format!(
            "{}, firmware {major}.{minor}.{patch} {}, mode {}",
            self.name,
            self.status.tag,
            self.status.mode.name()
        )
    }

    fn size_px(&self) -> (usize, usize) {
        self.model.size_px
    }

    fn capacity(&self) -> usize {
        self.model.entries
    }

    fn clear(&mut self) -> Result<(), ProjectorError> {
        self.patterns.clear();
        self.shown = Shown::of(&self.settings);
        with_recovery(&mut self.unit, |unit| unit.play(Play::Stop)).map_err(|reason| self.failed(reason))
    }

    fn load(&mut self, pattern: &BitPattern) -> Result<(), ProjectorError> {
        check_resolution(&self.name, self.model.size_px, pattern)?;
        if pattern.primary().is_some() && !self.settings.primaries {
            return Err(self.failed(
                "expected white patterns, found one in a primary; if the unit's outputs switch red, green and blue lights, say so by \
                 `primaries = true` in [projector.dlpc900]",
            ));
        }
        self.patterns.push(pattern.clone());
        let stored = IMAGES * (PLANES / self.depth());
        let limit = self.model.entries.min(stored);
        // With it there may be fewer: levels of grey take the planes of eight.
        let room = check_room(&self.name, self.patterns.len() - 1, limit);
        if room.is_err() {
            self.patterns.pop();
        }
        room
    }

    fn pace(&mut self, steps: &[Timing]) -> Result<(), ProjectorError> {
        let windows = self.windows(steps);
        if self.depth() > 1 {
            return self.pace_grey(&windows);
        }
        let delay_us = f64::from(self.shown.delay_us);
        let mut exposures_us = Vec::with_capacity(windows.len());
        for steps in &windows {
            let looks = || steps.iter().copied();
            let from_us = looks().map(|step| step[0]).fold(f64::INFINITY, f64::min);
            let until_us = looks().map(|step| step[1]).fold(0.0, f64::max);
            let next_us = looks().map(|step| step[2]).fold(0.0, f64::max);
            let room_us = until_us.min(next_us - f64::from(APART_US)) - delay_us;
            let room_us = room_us
                .clamp(f64::from(SHORTEST_US), f64::from(LONGEST_US))
                .round();
            let exposure_us = self.settings.exposure_us.unwrap_or(room_us as u32);
            let over_us = delay_us + f64::from(exposure_us);
            let found = if from_us + ROUNDING_US < delay_us {
                format!(
                    "that the camera looks {from_us:.0} µs after the trigger, before the pattern is there ({delay_us} µs)"
                )
            } else if !self.settings.hold && until_us > over_us + ROUNDING_US {
                format!(
                    "that the camera looks until {until_us:.0} µs, when the pattern has gone ({over_us} µs): hold it"
                )
            } else if next_us + ROUNDING_US < over_us {
                format!(
                    "that the next trigger comes after {next_us:.0} µs, before the exposure is over ({over_us} µs)"
                )
            } else {
                exposures_us.push(exposure_us);
                continue;
            };
            return Err(self.failed(format!(
                "expected exposures while a pattern of [projector.dlpc900] is there, found {found}"
            )));
        }
        if !exposures_us.is_empty() {
            self.shown.exposures_us = exposures_us;
        }
        Ok(())
    }

    fn ready(&mut self) -> Result<(), ProjectorError> {
        self.program(true, &mut |_| {})
    }
}
