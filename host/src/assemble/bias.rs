//! What the frames of a measurement are off by alike: some of them are looked at before all.

use rayon::prelude::*;

use super::AssembleError;
use super::projection::Projection;
use super::radiometry::{Bench, Way, Work, before};
use super::window::Agree;
use crate::instrument::calibration::lamp::SLOW;
use crate::instrument::calibration::stray::{ByBand, Told};
use crate::plan::{Directions, Exposure, Plan};
use crate::store::RawStore;

/// Segments and patterns that are looked at, about.
const SEGMENTS: usize = 16;
const PATTERNS: usize = 128;

/// Lets the stray light of `projection` learn from frames of `raw`, which show the `patterns` of `plan`.
///
/// # Errors
/// [`AssembleError`].
pub(super) fn learn(
    projection: &mut Projection,
    (plan, directions): (&Plan, &Directions),
    raw: &RawStore,
    patterns: &[Exposure],
    agree: &Agree<'_>,
) -> Result<(), AssembleError> {
    let Some(stray) = &projection.stray else {
        return Ok(());
    };
    let codes = plan.code_patterns();
    let cells: Vec<usize> = directions.measurable().collect();
    let terms = |exposure: Exposure| match exposure {
        Exposure::Incident(index) => Some(stray.of_all([index]).1),
        Exposure::Coded(number) => codes
            .as_ref()
            .map(|codes| stray.of_all(codes.lit(number).map(|cell| cells[cell])).1),
        Exposure::Black | Exposure::Unwatched => None,
    };
    let brackets = plan.brackets();
    let values = projection.radiometry[0].dark.len();
    let every = raw.segments().div_ceil(SEGMENTS).max(1);
    let each = PATTERNS.div_ceil(raw.segments().div_ceil(every).max(1));
    let mut told: Vec<Vec<ByBand<Option<Told>>>> = Vec::new();
    for number in (0..raw.segments()).step_by(every) {
        let segment = raw.read_segment(number)?;
        agree(number, &segment)?;
        let first = raw.segment_range(number).start;
        let lit: Vec<_> = patterns[first / brackets..]
            .iter()
            .zip(segment.frames.chunks_exact(values * brackets))
            .enumerate()
            .filter_map(|(place, (exposure, frames))| Some((place * brackets, terms(*exposure)?, frames)))
            .collect();
        let some: Vec<_> = lit.iter().step_by(lit.len().div_ceil(each).max(1)).collect();
        told.par_extend(
            some.par_iter()
                .map_init(Work::default, |work, (place, lit, frames)| {
                    let way = &Way {
                        irradiance: 1.0,
                        resampling: &projection.resampling,
                        stray: Some((stray.removal(), lit)),
                        bias: &[],
                        offset: projection.drift.of(first + place),
                        before: before(&segment, *place, (brackets, values)),
                    };
                    let mut bench = Bench::of(work).0;
                    projection.image(frames, way, &mut bench);
                    bench.told.clone()
                }),
        );
    }
    // Where black patterns stand among the others, slow changes are alike in the means of both.
    let slowly = if plan.black_first { SLOW } else { 0.0 };
    let radiometry = &projection.radiometry;
    if let Some(stray) = &mut projection.stray {
        stray.learn(&told, radiometry, slowly);
    }
    Ok(())
}
