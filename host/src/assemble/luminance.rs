//! Single patterns, assembled in memory while a measurement goes on.
//!
//! # Design
//! Frames become f in the same steps as in [`assemble`](super::assemble()): exposures are merged, pixels that an edge may hide
//! left out, light and throughput taken as calibration found them. Cells whose pixels look beside them are left out too:
//! they would pass for poor interpolation. Only the uncertainty stays that of noise, which is what
//! more captures cannot help.

use std::collections::BTreeMap;

use glam::DVec3;
use rayon::prelude::*;

use super::correction::Correction;
use super::edges::Edges;
use super::off_sample::OffSample;
use super::projection::Projection;
use super::radiometry::{Black, Work};
use super::stray::StrayLight;
use super::{AssembleError, no_black_frames, seen, unlit};
use crate::hemisphere::disk::Disk;
use crate::instrument::calibration::AppliedCalibration;
use crate::instrument::optics::View;
use crate::instrument::rig::Rig;
use crate::plan::{Directions, Plan};
use crate::store::provenance::Provenance;
use crate::store::{BrdfRows, Segment};

/// Turns the frames of single patterns into luminance on the disk, as assembly would.
pub(crate) struct FrameAssembler<'a> {
    rig: &'a Rig,
    applied: &'a AppliedCalibration,
    projection: Projection,
    /// What calibration makes of the images of the directions that are expected.
    correction: Option<Correction>,
}

/// Whether light from a direction reaches the sample of `rig` for certain: the projector has it, and no edge, as well as they
/// are known, may hide it; a standard that stood as in `plan` was lit from there, if there was one.
///
/// # Errors
/// [`AssembleError::Mismatch`] if the standard was not captured at the tilt of the sample.
pub(crate) fn certainly_lit<'a>(
    rig: &Rig,
    applied: &'a AppliedCalibration,
    plan: &Plan,
) -> Result<impl Fn(DVec3) -> bool + use<'a>, AssembleError> {
    let (projector, edges) = (View::projector(rig), Edges::new(applied.edge_deg));
    let off_sample = OffSample::new(applied, plan)?;
    let spot_deg = plan.spot_deg;
    Ok(move |w| projector.pixel(w).is_ok() && unlit(&projector, spot_deg, &edges, &off_sample, w).is_none())
}

impl<'a> FrameAssembler<'a> {
    /// For frames of `rig` exposed as in `plan`, the black ones of which are in `black`; `applied` is what calibration found.
    ///
    /// # Errors
    /// A sentence if there are no black exposures, or the standard was not captured at the tilt of the sample.
    pub(crate) fn new(
        rig: &'a Rig,
        applied: &'a AppliedCalibration,
        black: &[Segment],
        plan: &Plan,
        disk: Disk,
    ) -> Result<Self, String> {
        let format = rig.frame_format();
        let off_sample = OffSample::new(applied, plan).map_err(|error| error.to_string())?;
        let mut frames = no_black_frames(rig, plan, applied);
        for (number, segment) in black.iter().enumerate() {
            frames.add(number * plan.segment, segment, format.len());
        }
        let Black {
            radiometry, drift, ..
        } = frames.finish(rig, plan)?;
        Ok(Self {
            projection: Projection {
                channels: format.channels,
                disk,
                radiometry,
                drift,
                segment: plan.segment,
                resampling: seen((rig, plan), &Edges::new(applied.edge_deg), &off_sample, disk),
                stray: None,
            },
            correction: None,
            rig,
            applied,
        })
    }

    /// Gets ready for images of those `directions` that can be lit, with spots as in `plan`.
    ///
    /// # Errors
    /// What is wrong if the calibration does not fit the camera.
    pub(crate) fn expect(&mut self, plan: &Plan, directions: &Directions) -> Result<(), String> {
        if self.applied.photometry.is_some() {
            let correction = Correction::new(
                self.rig,
                plan,
                directions,
                self.applied,
                self.projection.disk,
                &self.projection.resampling,
            )?;
            self.projection.stray = StrayLight::new(self.rig, plan, self.applied, &correction, None);
            self.correction = Some(correction);
        }
        Ok(())
    }

    /// For each pattern of `segment`, those of the incident directions from `first` on: the luminance of f in sr⁻¹ per cell
    /// (NaN where there is none), and the mean of the variance of f by noise.
    pub(crate) fn luminance(&self, segment: &Segment, first: usize) -> Vec<(Vec<f32>, f64)> {
        let brackets = self.projection.radiometry.len();
        let frames = segment
            .frames
            .par_chunks_exact(self.projection.radiometry[0].dark.len() * brackets);
        segment
            .records
            .par_chunks_exact(brackets)
            .zip(frames)
            .enumerate()
            .map(|(place, (records, frames))| {
                let alone = Segment {
                    frames: frames.to_vec(),
                    records: records.to_vec(),
                    ..Segment::default()
                };
                let window = BTreeMap::from([(0, alone)]);
                let mut work = Work::default();
                self.projection
                    .rows(first + place, &[Some((0, 0))], &window, &mut work);
                self.luminance_of(&mut work, first + place)
            })
            .collect()
    }

    fn luminance_of(&self, work: &mut Work, index: usize) -> (Vec<f32>, f64) {
        let rows = &mut work.rows;
        // ITU-R BT.601.
        let Projection { channels, disk, .. } = self.projection;
        let weights: &[f32] = if channels == 1 {
            &[1.0]
        } else {
            &[0.299, 0.587, 0.114]
        };
        let factor = |value: usize| {
            self.correction
                .as_ref()
                .map_or(1.0, |correction| correction.factor(index, value))
        };
        let is_missing = |rows: &BrdfRows, cell: usize| rows.provenance[cell] == Provenance::Missing.code();
        let (mut variance, mut count) = (0.0, 0_u32);
        for cell in (0..disk.len()).filter(|&cell| !is_missing(rows, cell)) {
            let at = cell * channels;
            let squares = weights.iter().enumerate().map(|(channel, weight)| {
                (weight * rows.sigma[at + channel].to_f32() * factor(at + channel)).powi(2)
            });
            variance += f64::from(squares.sum::<f32>());
            count += 1;
        }
        if let Some(correction) = &self.correction {
            correction.apply(index, rows, &work.common, None);
        }
        let f = (0..disk.len())
            .map(|cell| {
                if is_missing(rows, cell) {
                    return f32::NAN;
                }
                let f = &rows.f[cell * channels..][..channels];
                weights.iter().zip(f).map(|(weight, f)| weight * f).sum()
            })
            .collect();
        (f, variance / f64::from(count.max(1)))
    }
}
