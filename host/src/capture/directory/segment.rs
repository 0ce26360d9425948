//! One segment: a run of the controller, its frames and their records.

use super::MeasurementError;
use crate::capture::camera::Planned;
use crate::capture::{Instrument, Tally};
use crate::plan::Exposure;
use crate::plan::pattern::{BitPattern, LitSet};
use crate::plan::schedule::Timing;
use crate::store::{ExposureRecord, RawStore, StoreError};

/// A segment as it was taken: each frame where it came to lie.
pub(crate) struct Taken {
    /// Digital numbers of each exposure, [row, column, channel].
    frames: Vec<Vec<u16>>,
    records: Vec<ExposureRecord>,
    tally: Tally,
}

impl Taken {
    /// Writes it as segment `index` of `raw`.
    pub(crate) fn write(&self, raw: &RawStore, index: usize) -> Result<(), StoreError> {
        raw.write_frames(index, &self.frames, &self.records, &self.tally)
    }
}

/// What the exposures of `timings` with each pattern of `lit` are going to be, the first of them number `first` of the measurement.
pub(super) fn planned(
    first: usize,
    timings: &[Timing],
    patterns: &[Exposure],
    lit: &[Option<LitSet>],
) -> Vec<Planned> {
    let each = patterns
        .iter()
        .zip(lit)
        .flat_map(|pattern| timings.iter().map(move |timing| (pattern, timing)));
    each.enumerate()
        .map(|(at, ((exposure, lit), timing))| Planned {
            index: first + at,
            incident: exposure.code(),
            exposure_s: timing.cam_width_s,
            lit_solid_angle_sr: lit.as_ref().map_or(0.0, |lit| lit.solid_angle_sr),
        })
        .collect()
}

/// Takes one segment: the exposures of `timings` with each pattern of `lit`, with their records and their tally.
pub(crate) fn take_segment(
    instrument: &mut Instrument,
    timings: &[Timing],
    patterns: &[Exposure],
    lit: &[Option<LitSet>],
    progress: &mut dyn FnMut(usize),
) -> Result<Taken, MeasurementError> {
    let mut tally = Tally::default();
    let draw = |pattern: usize, image: &mut BitPattern| match (&lit[pattern], patterns[pattern]) {
        (Some(lit), _) => image.light(&lit.pixels),
        (None, Exposure::Unwatched) => image.clear(),
        (None, _) => {}
    };
    let captured = instrument.take(lit.len(), timings, draw, &mut tally, progress)?;
    let mut taken = Taken {
        frames: Vec::with_capacity(captured.len()),
        records: Vec::with_capacity(captured.len()),
        tally,
    };
    let lit = patterns.iter().zip(lit);
    let each = lit.flat_map(|pattern| timings.iter().map(move |timing| (pattern, timing)));
    for (((exposure, lit), timing), shot) in each.zip(captured) {
        taken.frames.push(shot.dn);
        taken.records.push(ExposureRecord {
            incident: exposure.code(),
            kind: u8::from(exposure.is_black()),
            exposure_s: timing.cam_width_s,
            trigger_tick: shot.ticks[0].0,
            strobe_on_tick: shot.ticks[1].0,
            strobe_off_tick: shot.ticks[2].0,
            frame_id: shot.frame_id,
            camera_timestamp_s: shot.camera_timestamp_s,
            attempts: shot.attempts,
            flags: u16::from(shot.flags),
            lit_solid_angle_sr: lit.as_ref().map_or(0.0, |lit| lit.solid_angle_sr),
            lit_irradiance: lit.as_ref().map_or(0.0, |lit| lit.irradiance),
        });
    }
    Ok(taken)
}
