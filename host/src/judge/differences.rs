//! By how much a result that is made again differs from the one before.
//!
//! # Design
//! Both are of the same frames and have the same incident directions and cells: noise they have in common, and what differs is what the
//! calibrations say. So differences are compared with the uncertainty that the older one states, not with both.

use serde::Serialize;

use crate::brdf::Brdf;
use crate::hemisphere::direction::to_degrees;
use crate::judge::evaluate::Quantile;
use crate::judge::evaluate::histogram::LogHistogram;
use crate::store::StoreError;

/// Differences of a newer result to an older one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Differences {
    /// Values (pairs of directions × channels) that both have.
    pub values: u64,
    /// Σ f of the newer one over Σ f of the older one, of those; `None` if there are none, or the older ones have no sum.
    pub scale: Option<f64>,
    /// Median of |newer − older|/|older|.
    pub median_relative: Quantile,
    /// Share of the values that differ by more than the older one's expanded uncertainty (k = 2); `None` if there are none.
    pub beyond_k2_share: Option<f64>,
    /// The largest difference over the standard uncertainty of the older one.
    pub largest: Option<Largest>,
    /// Pairs of directions that either has.
    pub pairs: u64,
    /// Share of these that only the newer one has; `None` if there are none.
    pub came_share: Option<f64>,
    /// Share of these that only the older one has; `None` if there are none.
    pub went_share: Option<f64>,
}

/// One difference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Largest {
    /// |newer − older|/σ of the older one (k = 1).
    pub sigmas: f64,
    /// (newer − older)/|older|; `None` if the older one is 0.
    pub relative: Option<f64>,
    /// Polar angle and azimuth of the incident direction, degrees.
    pub incident_deg: [f64; 2],
    /// Of the outgoing one; `None` if the cell's centre is below the horizon.
    pub outgoing_deg: Option<[f64; 2]>,
    /// Number of the channel.
    pub channel: usize,
}

/// What is counted on the way.
struct Count {
    histogram: LogHistogram,
    sums: [f64; 2],
    beyond: u64,
    came: u64,
    went: u64,
    both: u64,
    /// Sigmas, relative difference, incident direction, cell and channel.
    largest: Option<(f64, Option<f64>, usize, usize, usize)>,
}

/// By how much `newer` differs from `older`, which has the same directions, cells and channels; `None` if it has not.
///
/// # Errors
/// [`StoreError`].
pub fn differences(older: &Brdf, newer: &Brdf) -> Result<Option<Differences>, StoreError> {
    let size = |brdf: &Brdf| {
        (
            brdf.grid().len(),
            brdf.disk().size(),
            brdf.channels(),
            brdf.chunk_range(0),
        )
    };
    let angles = |brdf: &Brdf| -> Vec<_> {
        (0..brdf.grid().len())
            .map(|i| brdf.grid().angles_deg(i))
            .collect()
    };
    if size(older) != size(newer) || angles(older) != angles(newer) {
        return Ok(None);
    }
    let mut count = Count {
        histogram: LogHistogram::new(),
        sums: [0.0; 2],
        beyond: 0,
        came: 0,
        went: 0,
        both: 0,
        largest: None,
    };
    for chunk in 0..older.chunks() {
        count.add(older, newer, chunk)?;
    }
    Ok(Some(count.finish(older)))
}

impl Count {
    fn add(&mut self, older: &Brdf, newer: &Brdf, chunk: usize) -> Result<(), StoreError> {
        let (channels, cells) = (older.channels(), older.disk().len());
        let (rows, others) = (older.chunk(chunk)?, newer.chunk(chunk)?);
        let first = older.chunk_range(chunk).start;
        for sample in 0..older.chunk_range(chunk).len() * cells {
            let values = sample * channels..(sample + 1) * channels;
            let has = |rows: &Option<crate::store::BrdfRows>| {
                rows.as_ref().is_some_and(|rows| !rows.f[values.start].is_nan())
            };
            match (has(&rows), has(&others)) {
                (false, false) => {}
                (true, false) => self.went += 1,
                (false, true) => self.came += 1,
                (true, true) => self.both += 1,
            }
            let (Some(rows), Some(others)) = (&rows, &others) else {
                continue;
            };
            for value in values {
                let [was, is] = [&rows.f, &others.f].map(|f| f64::from(f[value]));
                if !(was - is).is_nan() {
                    let sigma = f64::from(rows.sigma[value].to_f32());
                    let place = (first + sample / cells, sample % cells, value % channels);
                    self.compare(was, is, sigma, place);
                }
            }
        }
        Ok(())
    }

    fn compare(&mut self, was: f64, is: f64, sigma: f64, (incident, cell, channel): (usize, usize, usize)) {
        let relative = (was != 0.0).then(|| (is - was) / was.abs());
        // Of nothing, anything is infinitely much; nothing is no difference.
        let of_nothing = if is.abs() > 0.0 { f64::INFINITY } else { 0.0 };
        let size = relative.map_or(of_nothing, f64::abs);
        self.histogram.add(size);
        self.sums[0] += was;
        self.sums[1] += is;
        let sigmas = (is - was).abs() / sigma;
        self.beyond += u64::from(sigmas > 2.0);
        if self.largest.is_none_or(|largest| sigmas > largest.0) {
            self.largest = Some((sigmas, relative, incident, cell, channel));
        }
    }

    fn finish(self, brdf: &Brdf) -> Differences {
        let [was, is] = self.sums;
        let (values, pairs) = (self.histogram.count(), self.came + self.went + self.both);
        let share = |part: u64, of: u64| (of > 0).then(|| part as f64 / of as f64);
        Differences {
            values,
            scale: Some(is / was).filter(|scale| scale.is_finite()),
            median_relative: self.histogram.median(),
            beyond_k2_share: share(self.beyond, values),
            largest: self
                .largest
                .map(|(sigmas, relative, incident, cell, channel)| Largest {
                    sigmas,
                    relative,
                    incident_deg: brdf.grid().angles_deg(incident).into(),
                    outgoing_deg: brdf.disk().direction(cell).map(|w| to_degrees(w).into()),
                    channel,
                }),
            pairs,
            came_share: share(self.came, pairs),
            went_share: share(self.went, pairs),
        }
    }
}
