//! Single frames, assembled in memory while a measurement goes on.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::chunk_rows;
use super::radiometry::{Radiometry, Work};
use crate::disk::Disk;
use crate::optics::View;
use crate::provenance::Provenance;
use crate::resample::Resampling;
use crate::rig::Rig;
use crate::store::{BrdfRows, Segment};

/// Turns single frames into luminance on the disk, as assembly would.
pub(crate) struct FrameAssembler {
    radiometry: [Radiometry; 1],
    resampling: Resampling,
    channels: usize,
    disk: Disk,
}

impl FrameAssembler {
    /// For frames of `rig` with the black exposures of `black`.
    ///
    /// # Errors
    /// A sentence if there are no black exposures.
    pub(crate) fn new(rig: &Rig, black: &Segment, disk: Disk) -> Result<Self, String> {
        Ok(Self {
            radiometry: [Radiometry::new(
                rig,
                None,
                std::slice::from_ref(black),
                black.records.first().map_or(0.0, |record| record.exposure_s),
                rig.frame_format().len(),
            )?],
            resampling: Resampling::new(&View::camera(rig), disk),
            channels: rig.frame_format().channels,
            disk,
        })
    }

    /// For each frame of `segment`: the luminance of f in sr⁻¹ per cell (NaN where there is none), and the mean of the
    /// variance of f by noise.
    pub(crate) fn luminance(&self, segment: &Segment) -> Vec<(Vec<f32>, f64)> {
        let frames = segment.frames.par_chunks_exact(self.radiometry[0].dark.len());
        segment
            .records
            .par_iter()
            .zip(frames)
            .map(|(record, frame)| {
                let place = Segment {
                    frames: frame.to_vec(),
                    records: vec![*record],
                    ..Segment::default()
                };
                let window = BTreeMap::from([(0, place)]);
                let mut work = Work::default();
                let places = [Some((0, 0))];
                chunk_rows(
                    &places,
                    &window,
                    self.channels,
                    self.disk,
                    &self.radiometry,
                    &self.resampling,
                    &mut work,
                );
                self.luminance_of(&work.rows)
            })
            .collect()
    }

    fn luminance_of(&self, rows: &BrdfRows) -> (Vec<f32>, f64) {
        // ITU-R BT.601.
        let weights: &[f32] = if self.channels == 1 {
            &[1.0]
        } else {
            &[0.299, 0.587, 0.114]
        };
        let (mut variance, mut count) = (0.0, 0_u32);
        let cells = rows
            .f
            .chunks_exact(self.channels)
            .zip(rows.sigma.chunks_exact(self.channels));
        let f = cells
            .zip(&rows.provenance)
            .map(|((f, sigma), &provenance)| {
                if provenance == Provenance::Missing.code() {
                    return f32::NAN;
                }
                let squares = weights
                    .iter()
                    .zip(sigma)
                    .map(|(weight, sigma)| (weight * sigma.to_f32()).powi(2));
                variance += f64::from(squares.sum::<f32>());
                count += 1;
                weights.iter().zip(f).map(|(weight, f)| weight * f).sum()
            })
            .collect();
        (f, variance / f64::from(count.max(1)))
    }
}
