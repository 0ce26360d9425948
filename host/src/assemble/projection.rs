//! From the frames of patterns to rows of f on the disk.

use std::collections::BTreeMap;

use half::f16;

use super::Assembled;
use super::radiometry::{Bench, Out, Radiometry, Way, Work, project, project_merged};
use super::stray::StrayLight;
use crate::assemble::resample::Resampling;
use crate::hemisphere::disk::Disk;
use crate::store::Segment;
use crate::store::provenance::Provenance;

/// What turns the frames of patterns into rows of f.
pub(super) struct Projection {
    pub(super) channels: usize,
    pub(super) disk: Disk,
    /// Of each exposure time.
    pub(super) radiometry: Vec<Radiometry>,
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
        let Self {
            channels,
            disk,
            radiometry,
            resampling,
            stray,
        } = self;
        let channels = *channels;
        let row = disk.len() * channels;
        let samples = radiometry[0].dark.len();
        let Work {
            signal,
            merged,
            room,
            sigma,
            common,
            levels,
            rows,
        } = work;
        let bench = &mut Bench {
            signal,
            merged,
            room,
            levels,
        };
        // Cells without taps are never written, so what the last chunk left there is NaN.
        sigma.resize(row, f32::NAN);
        common.stray.resize(places.len() * row, 0.0);
        common.lamp.resize(places.len() * row, 0.0);
        rows.f.resize(places.len() * row, f32::NAN);
        rows.sigma.resize(places.len() * row, f16::NAN);
        rows.provenance
            .resize(places.len() * disk.len(), Provenance::Missing.code());
        let mut counts = Assembled::default();
        let outs = rows
            .f
            .chunks_exact_mut(row)
            .zip(rows.sigma.chunks_exact_mut(row))
            .zip(rows.provenance.chunks_exact_mut(disk.len()))
            .zip(common.stray.chunks_exact_mut(row))
            .zip(common.lamp.chunks_exact_mut(row));
        // A frame that nothing lit says nothing.
        let lit = |(segment, at): &(usize, usize)| window[segment].records[*at].lit_irradiance > 0.0;
        for (index, (place, ((((f, row_sigma), provenance), stray_sigma), lamp_sigma))) in
            (first..).zip(places.iter().zip(outs))
        {
            let Some((segment, at)) = place.filter(lit) else {
                f.fill(f32::NAN);
                row_sigma.fill(f16::NAN);
                provenance.fill(Provenance::Missing.code());
                continue;
            };
            let segment = &window[&segment];
            let record = &segment.records[at];
            let frames = &segment.frames[at * samples..][..radiometry.len() * samples];
            let way = &Way {
                irradiance: record.lit_irradiance,
                resampling,
                stray: stray.as_ref().map(|stray| stray.of(index)),
            };
            let out = &mut Out {
                f,
                sigma: row_sigma,
                provenance,
                wide_sigma: sigma.as_mut_slice(),
                stray_sigma,
                lamp_sigma,
            };
            let (measured, saturated) = match (channels, radiometry.as_slice()) {
                (1, [one]) => project::<1>(frames, way, one, bench, out),
                (_, [one]) => project::<3>(frames, way, one, bench, out),
                (1, several) => project_merged::<1>(frames, way, several, bench, out),
                (_, several) => project_merged::<3>(frames, way, several, bench, out),
            };
            counts.directions += 1;
            counts.frames += radiometry.len();
            counts.measured += measured;
            counts.saturated += saturated;
        }
        counts
    }
}
