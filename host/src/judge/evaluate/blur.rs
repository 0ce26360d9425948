//! What finite light and finite pixels must do to a reference, and what they resolve.

use glam::DVec3;
use rayon::prelude::*;

use super::histogram::LogHistogram;
use super::scoring::{Floor, channel_values};
use super::{Quantiles, Resolution};
use crate::brdf::Brdf;
use crate::brdf::quadrature::{around, interpolated_pixel_rad, mean_f, spot_rad};
use crate::brdf::sample::Sample;
use crate::hemisphere::judged::is_judged;

/// Incident directions for which the blur is computed.
const DIRECTIONS: usize = 48;

/// Relative difference between the reference averaged over the lit cone and the pixels, and itself, where it is scored.
pub(super) fn blur(brdf: &Brdf, sample: &dyn Sample, floor: &Floor, cells: &[Option<DVec3>]) -> Quantiles {
    // A file that does not say how wide its spot is has none here.
    let light_rad = spot_rad(brdf.spot_deg());
    let channels = brdf.channels();
    let measured: Vec<usize> = (0..brdf.grid().len())
        .filter(|&index| brdf.incident_reason(index).is_none() && is_judged(brdf.grid().direction(index)))
        .collect();
    let every = measured.len().div_ceil(DIRECTIONS).max(1);
    let chosen: Vec<usize> = measured.into_iter().step_by(every).collect();
    chosen
        .into_par_iter()
        .map(|index| {
            let mut histogram = LogHistogram::new();
            let wi = brdf.grid().direction(index);
            let sharp = sample.incident(wi);
            let lobes = around(wi, light_rad).map(|wi| sample.incident(wi));
            for (cell, wo) in cells.iter().enumerate() {
                let Some(wo) = wo.filter(|wo| is_judged(*wo)) else {
                    continue;
                };
                let places = around(wo, interpolated_pixel_rad(brdf.pixel_sr(cell)));
                let mean = mean_f(&lobes, &places.map(Some));
                let truth = channel_values(sharp.f(wo), channels);
                for (channel, (blurred, truth)) in channel_values(mean, channels).zip(truth).enumerate() {
                    if let Some(error) = floor.error(blurred, truth, channel) {
                        histogram.add(error);
                    }
                }
            }
            histogram
        })
        .reduce(LogHistogram::new, |a, b| a.merge(&b))
        .quantiles()
}

/// Width of a camera pixel in degrees, root mean square over the cells that have one.
pub(super) fn pixel_deg(brdf: &Brdf, cells: &[Option<DVec3>]) -> Option<f64> {
    let seen: Vec<f64> = pixels_sr(brdf, cells).collect();
    (!seen.is_empty()).then(|| (seen.iter().sum::<f64>() / seen.len() as f64).sqrt().to_degrees())
}

pub(super) fn resolution(brdf: &Brdf, cells: &[Option<DVec3>]) -> Resolution {
    let mut widths_deg: Vec<f64> = pixels_sr(brdf, cells)
        .map(|pixel_sr| pixel_sr.sqrt().to_degrees())
        .collect();
    widths_deg.sort_by(f64::total_cmp);
    Resolution {
        light_deg: light_deg(brdf),
        pixel_median_deg: widths_deg.get(widths_deg.len() / 2).copied(),
        pixel_worst_deg: widths_deg.last().copied(),
    }
}

/// Opening of the lit cone in degrees, if the file says.
pub(super) fn light_deg(brdf: &Brdf) -> Option<f64> {
    Some(brdf.spot_deg()).filter(|deg| deg.is_finite() && *deg > 0.0)
}

fn pixels_sr<'a>(brdf: &'a Brdf, cells: &'a [Option<DVec3>]) -> impl Iterator<Item = f64> + 'a {
    (0..cells.len())
        .filter(|&cell| cells[cell].is_some())
        .map(|cell| brdf.pixel_sr(cell))
        .filter(|pixel_sr| pixel_sr.is_finite() && *pixel_sr > 0.0)
}
