//! Room for what workers make of frames.

use glam::Vec4;
use half::f16;

use super::shown::Shown;
use crate::assemble::merge::Merged;
use crate::instrument::calibration::stray::{ByBand, Levels, Room, Told};
use crate::store::BrdfRows;

/// What one worker keeps from chunk to chunk.
#[derive(Default)]
pub(in super::super) struct Work {
    /// What the exposures of a pattern show of it alone.
    pub(in super::super) shown: Shown,
    /// Dark-corrected signal of each pixel in DN, its channels in the lanes; NaN where it saturated.
    pub(in super::super) signal: Vec<Vec4>,
    /// The same from several exposures.
    pub(in super::super) merged: Merged,
    /// What of it came other ways.
    pub(in super::super) room: Room,
    /// Standard uncertainties of a row, before they are halved in width.
    pub(in super::super) sigma: Vec<f32>,
    /// What of them neighbours have in common, of all rows.
    pub(in super::super) common: Common,
    /// The lamp in each exposure of a pattern, and what told it.
    pub(in super::super) levels: Vec<Levels>,
    pub(in super::super) told: Vec<ByBand<Option<Told>>>,
    pub(in super::super) rows: BrdfRows,
}

/// Standard uncertainties that neighbours have in common, of all values of some rows, and the part of that by the lamp which all of the
/// measurement share, of each row.
#[derive(Default)]
pub(in super::super) struct Common {
    pub(in super::super) stray: Vec<f32>,
    pub(in super::super) lamp: Vec<f32>,
    pub(in super::super) lamp_share: Vec<f32>,
}

/// Where f, sigma and provenance of one incident direction go.
pub(in super::super) struct Out<'a> {
    pub(in super::super) f: &'a mut [f32],
    pub(in super::super) sigma: &'a mut [f16],
    pub(in super::super) provenance: &'a mut [u8],
    /// Standard uncertainties before they are halved in width.
    pub(in super::super) wide_sigma: &'a mut [f32],
    /// What of them stray light makes, and the lamp, and which part of that all of the measurement share.
    pub(in super::super) stray_sigma: &'a mut [f32],
    pub(in super::super) lamp_sigma: &'a mut [f32],
    pub(in super::super) lamp_share: &'a mut f32,
}

/// What a worker makes of the frames of one pattern on their way to the disk.
pub(in super::super) struct Bench<'a> {
    pub(in super::super) shown: &'a mut Shown,
    pub(in super::super) signal: &'a mut Vec<Vec4>,
    pub(in super::super) merged: &'a mut Merged,
    pub(in super::super) room: &'a mut Room,
    pub(in super::super) levels: &'a mut Vec<Levels>,
    pub(in super::super) told: &'a mut Vec<ByBand<Option<Told>>>,
}

impl<'a> Bench<'a> {
    /// Of what a worker keeps, and what else there is of that.
    pub(in super::super) fn of(
        work: &'a mut Work,
    ) -> (Self, &'a mut Vec<f32>, &'a mut Common, &'a mut BrdfRows) {
        let Work {
            shown,
            signal,
            merged,
            room,
            sigma,
            common,
            levels,
            told,
            rows,
        } = work;
        let bench = Self {
            shown,
            signal,
            merged,
            room,
            levels,
            told,
        };
        (bench, sigma, common, rows)
    }

    /// Part of the lamp's uncertainty that all of the measurement share, as far as the exposures of a pattern do.
    pub(super) fn lamp_share(&self) -> f32 {
        self.levels
            .iter()
            .map(|levels| levels.share())
            .fold(0.0, f32::max)
    }
}
