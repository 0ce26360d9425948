//! Whether the numbers of a plan file are those of a plan.

use super::{Plan, PlanError, SEGMENT_MAX};
use crate::instrument::bands::PRIMARIES;
use crate::instrument::monitor::BLOCK_PX;
use crate::plan::brackets::MOST_EXPOSURES;
use crate::plan::schedule::LONGEST_PERIOD_S;

impl Plan {
    /// Refuses numbers that no plan of this program has; `path` is where it was read.
    ///
    /// # Errors
    /// [`PlanError::File`] with the first field that is wrong.
    pub fn check(&self, path: &std::path::Path) -> Result<(), PlanError> {
        let fail = |field: &str, expected: &str, found: &dyn std::fmt::Display| PlanError::File {
            path: path.display().to_string(),
            reason: format!("{field}: expected {expected}, found {found}"),
        };
        let timing = &self.timing;
        let ranges = [
            ("exposure_s", self.exposure_s, 1e-6, 60.0, "1e-6 to 60 seconds"),
            ("spot_deg", self.spot_deg, 1e-3, 90.0, "0.001 to 90 degrees"),
            (
                "timing.proj_width_s",
                timing.proj_width_s,
                1e-7,
                60.0,
                "1e-7 to 60 seconds",
            ),
            ("timing.cam_at_s", timing.cam_at_s, 0.0, 60.0, "0 to 60 seconds"),
            (
                "timing.cam_width_s",
                timing.cam_width_s,
                1e-6,
                60.0,
                "1e-6 to 60 seconds",
            ),
            (
                "timing.period_s",
                timing.period_s,
                1e-6,
                LONGEST_PERIOD_S,
                "1e-6 to 120 seconds",
            ),
        ];
        for (field, found, low, high, expected) in ranges {
            if !(low..=high).contains(&found) {
                return Err(fail(field, expected, &found));
            }
        }
        if let Some(virtual_rig) = &self.virtual_rig {
            let faults = &virtual_rig.faults;
            let rates = [
                faults.missed_triggers,
                faults.dropped_frames,
                faults.doubled_frames,
            ];
            if let Some(rate) = rates.iter().find(|rate| !(0.0..=1.0).contains(*rate)) {
                return Err(fail("virtual.faults", "rates from 0 to 1", rate));
            }
        }
        if self.watching_side > BLOCK_PX {
            let expected = format!("at most {BLOCK_PX} pixels");
            return Err(fail("watching_side", &expected, &self.watching_side));
        }
        if !matches!(self.bands, 1 | PRIMARIES) {
            return Err(fail("bands", &format!("1 or {PRIMARIES}"), &self.bands));
        }
        let longest = SEGMENT_MAX / self.bands;
        if !(1..=longest).contains(&self.segment) {
            return Err(fail(
                "segment",
                &format!("1 to {longest} exposures"),
                &self.segment,
            ));
        }
        // The one stands in the records, the other in the schedule.
        if timing.cam_width_s.total_cmp(&self.exposure_s).is_ne() {
            let expected = format!("exposure_s = {}", self.exposure_s);
            return Err(fail("timing.cam_width_s", &expected, &timing.cam_width_s));
        }
        if timing.cam_at_s + timing.cam_width_s > timing.period_s {
            let expected = "at least timing.cam_at_s + timing.cam_width_s";
            return Err(fail("timing.period_s", expected, &timing.period_s));
        }
        if self.longer.len() >= MOST_EXPOSURES {
            let expected = format!("at most {} exposures", MOST_EXPOSURES - 1);
            return Err(fail("longer", &expected, &self.longer.len()));
        }
        if !self.segment.is_multiple_of(self.brackets()) {
            let expected = format!("a multiple of the {} exposures of a pattern", self.brackets());
            return Err(fail("segment", &expected, &self.segment));
        }
        self.check_longer(&fail)?;
        self.check_code(path)
    }

    /// Refuses a code that is none for so many directions.
    fn check_code(&self, path: &std::path::Path) -> Result<(), PlanError> {
        let Some(code) = self.code else {
            return Ok(());
        };
        let patterns = code.patterns(self.direction_count);
        patterns.map(|_| ()).map_err(|error| PlanError::File {
            path: path.display().to_string(),
            reason: format!("code.{error}"),
        })
    }

    /// Refuses longer exposures of a pattern that do not follow on each other; `fail` makes the error of field, expected and
    /// found.
    fn check_longer(
        &self,
        fail: &dyn Fn(&str, &str, &dyn std::fmt::Display) -> PlanError,
    ) -> Result<(), PlanError> {
        let mut shorter_s = self.exposure_s;
        for timing in &self.longer {
            let from_s = timing.cam_at_s + timing.cam_width_s;
            let wrong = [
                (
                    timing.proj_width_s.total_cmp(&0.0).is_ne(),
                    "proj_width_s",
                    "0: the pattern stays",
                    timing.proj_width_s,
                ),
                (
                    !(0.0..=60.0).contains(&timing.cam_at_s),
                    "cam_at_s",
                    "0 to 60 seconds",
                    timing.cam_at_s,
                ),
                (
                    !(shorter_s < timing.cam_width_s && timing.cam_width_s <= 60.0),
                    "cam_width_s",
                    "more than the exposure before, at most 60 seconds",
                    timing.cam_width_s,
                ),
                (
                    !(from_s..=LONGEST_PERIOD_S).contains(&timing.period_s),
                    "period_s",
                    "cam_at_s + cam_width_s to 120 seconds",
                    timing.period_s,
                ),
            ];
            if let Some((_, field, expected, found)) = wrong.iter().find(|wrong| wrong.0) {
                return Err(fail(&format!("longer.{field}"), expected, found));
            }
            shorter_s = timing.cam_width_s;
        }
        Ok(())
    }
}
