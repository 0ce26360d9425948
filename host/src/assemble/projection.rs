//! From the frames of patterns to rows of f on the disk.

use std::collections::BTreeMap;

use half::f16;

use super::Assembled;
use super::radiometry::{
    Bench, Drift, Out, Radiometry, Way, Work, before, image, image_merged, project, project_merged,
};
use super::stray::StrayLight;
use crate::assemble::resample::Resampling;
use crate::hemisphere::disk::Disk;
use crate::instrument::calibration::stray::{Bias, ByBand};
use crate::store::Segment;
use crate::store::provenance::Provenance;

/// What turns the frames of patterns into rows of f.
pub(super) struct Projection {
    pub(super) channels: usize,
    pub(super) disk: Disk,
    /// Of each exposure time.
    pub(super) radiometry: Vec<Radiometry>,
    /// Of the camera's offset, and exposures of a segment.
    pub(super) drift: Drift,
    pub(super) segment: usize,
    pub(super) resampling: Resampling,
    /// `None` if nobody knows of any.
    pub(super) stray: Option<StrayLight>,
}

impl Projection {
    /// Fills the rows of the incident directions from `first` on: `places` says in which segment and where each was captured.
    pub(super) fn rows(
        &self,
        first: usize,
        places: &[Option<(usize, usize)>],
        window: &BTreeMap<usize, Segment>,
        work: &mut Work,
    ) -> Assembled {
        let radiometry = self.radiometry.as_slice();
        let samples = radiometry[0].dark.len();
        // A frame that nothing lit says nothing.
        let lit = |(segment, at): &(usize, usize)| window[segment].records[*at].lit_irradiance > 0.0;
        self.fill(first, places.len(), work, |index, bench, out| {
            let (number, at) = places[index - first].filter(lit)?;
            let segment = &window[&number];
            let record = &segment.records[at];
            let frames = &segment.frames[at * samples..][..radiometry.len() * samples];
            let way = &Way {
                irradiance: record.lit_irradiance,
                resampling: &self.resampling,
                stray: self.stray.as_ref().map(|stray| stray.of(index)),
                bias: self.bias(),
                offset: self.drift.of(number * self.segment + at),
                before: before(segment, at, (radiometry.len(), samples)),
            };
            Some(match (self.channels, radiometry) {
                (1, [one]) => project::<1>(frames, way, one, bench, out),
                (_, [one]) => project::<3>(frames, way, one, bench, out),
                (1, several) => project_merged::<1>(frames, way, several, bench, out),
                (_, several) => project_merged::<3>(frames, way, several, bench, out),
            })
        })
    }

    /// The `frames` of one pattern as an image in the `bench`, as by [`image`] or [`image_merged`].
    pub(super) fn image(&self, frames: &[u16], way: &Way<'_>, bench: &mut Bench<'_>) {
        match (self.channels, self.radiometry.as_slice()) {
            (1, [one]) => image::<1>(frames, way, one, bench),
            (_, [one]) => image::<3>(frames, way, one, bench),
            (1, several) => image_merged::<1>(frames, way, several, bench),
            (_, several) => image_merged::<3>(frames, way, several, bench),
        }
    }

    /// What frames of each exposure time are off by alike.
    pub(super) fn bias(&self) -> &[ByBand<Bias>] {
        self.stray.as_ref().map_or(&[], StrayLight::bias)
    }

    /// Fills the rows of `count` incident directions from `first` on with what `project` makes of each, which returns how many
    /// cells were measured and how many saturated, or nothing where there is no value.
    pub(super) fn fill(
        &self,
        first: usize,
        count: usize,
        work: &mut Work,
        mut project: impl FnMut(usize, &mut Bench<'_>, &mut Out<'_>) -> Option<(u64, u64)>,
    ) -> Assembled {
        let Self { channels, disk, .. } = self;
        let row = disk.len() * channels;
        let (mut bench, sigma, common, rows) = Bench::of(work);
        // Cells without taps are never written, so what the last chunk left there is NaN.
        sigma.resize(row, f32::NAN);
        common.stray.resize(count * row, 0.0);
        common.lamp.resize(count * row, 0.0);
        common.lamp_share.resize(count, 0.0);
        rows.f.resize(count * row, f32::NAN);
        rows.sigma.resize(count * row, f16::NAN);
        rows.provenance
            .resize(count * disk.len(), Provenance::Missing.code());
        let mut counts = Assembled::default();
        let outs = rows
            .f
            .chunks_exact_mut(row)
            .zip(rows.sigma.chunks_exact_mut(row))
            .zip(rows.provenance.chunks_exact_mut(disk.len()))
            .zip(common.stray.chunks_exact_mut(row))
            .zip(common.lamp.chunks_exact_mut(row).zip(&mut common.lamp_share));
        for (index, ((((f, row_sigma), provenance), stray_sigma), (lamp_sigma, lamp_share))) in
            (first..).zip(outs)
        {
            let out = &mut Out {
                f,
                sigma: row_sigma,
                provenance,
                wide_sigma: sigma.as_mut_slice(),
                stray_sigma,
                lamp_sigma,
                lamp_share,
            };
            let Some((measured, saturated)) = project(index, &mut bench, out) else {
                out.f.fill(f32::NAN);
                out.sigma.fill(f16::NAN);
                out.provenance.fill(Provenance::Missing.code());
                continue;
            };
            counts.directions += 1;
            counts.frames += self.radiometry.len();
            counts.measured += measured;
            counts.saturated += saturated;
        }
        counts
    }
}
