//! Which samples are scored against a reference, in one place.
//!
//! # Design
//! A relative error means something only where the reference is something: against 0 it is infinite, and a small number
//! against a smaller one fills the statistics with what no picture shows. So, channel by channel, a sample is *scored*
//! where the reference f ≥ max(1 % of its median, 0.01·albedo/π) and above 0, for θ ≤ 80° both ways. Median and albedo
//! are the reference's own, over a fixed set of directions, so that the floor does not depend on what was measured. The
//! rest is counted, and every figure states the share that it was scored over.

use std::f64::consts::PI;

use crate::base::median::median;
use crate::brdf::sample::Sample;
use crate::hemisphere::direction::from_degrees;
use crate::hemisphere::disk::Disk;

use crate::hemisphere::judged::{JUDGED_THETA_DEG, is_judged};

/// Share of the median of the reference below which nothing is scored.
const OF_MEDIAN: f64 = 0.01;
/// Share of f of a white surface with the albedo of the reference below which nothing is scored.
const OF_ALBEDO: f64 = 0.01;
/// Incident directions by which a reference is known, spread evenly over the projected solid angle.
const INCIDENT: usize = 16;
/// Cells a side of the disk of outgoing directions by which it is known.
const OUTGOING: usize = 48;
/// Azimuth from one incident direction to the next: the golden angle.
const TURN_DEG: f64 = 137.508;

/// The least f of a reference that is scored.
#[derive(Clone, Copy, Debug)]
pub(in crate::judge) struct Floor {
    /// In sr⁻¹, of each channel.
    least: [f64; 3],
}

impl Floor {
    /// Of `reference`, seen by a camera of `channels` channels.
    pub(in crate::judge) fn of(reference: &dyn Sample, channels: usize) -> Self {
        let disk = Disk::new(OUTGOING);
        let highest = JUDGED_THETA_DEG.to_radians().sin();
        let mut values: [Vec<f64>; 3] = Default::default();
        let mut albedo = [0.0; 3];
        for at in 0..INCIDENT {
            let sin = ((at as f64 + 0.5) / INCIDENT as f64).sqrt() * highest;
            let lobe = reference.incident(from_degrees(sin.asin().to_degrees(), at as f64 * TURN_DEG));
            let seen = (0..disk.len()).filter_map(|cell| disk.direction(cell));
            for wo in seen.filter(|wo| is_judged(*wo)) {
                for (channel, f) in channel_values(lobe.f(wo), channels).enumerate() {
                    if f.is_finite() {
                        values[channel].push(f);
                        albedo[channel] += f * wo.z * disk.cell_sr() / INCIDENT as f64;
                    }
                }
            }
        }
        let mut least = [f64::INFINITY; 3];
        for ((least, values), albedo) in least.iter_mut().zip(values).zip(albedo) {
            // A reference without any value scores nothing.
            if let Some(median) = median(values) {
                *least = f64::max(OF_MEDIAN * median, OF_ALBEDO * albedo / PI);
            }
        }
        Self { least }
    }

    /// |f − truth| / truth if it is scored in this channel; `None` if not.
    pub(in crate::judge) fn error(&self, f: f64, truth: f64, channel: usize) -> Option<f64> {
        let is_scored = truth.is_finite() && truth > 0.0 && truth >= self.least[channel];
        (is_scored && f.is_finite()).then(|| (f - truth).abs() / truth)
    }
}

/// What a camera of `channels` channels sees of the three of a sample: all, or their mean.
pub(in crate::judge) fn channel_values(f: [f64; 3], channels: usize) -> impl Iterator<Item = f64> {
    seen_by(f, channels).into_iter().take(channels)
}

/// As [`channel_values`], a single channel repeated.
pub(in crate::judge) fn seen_by(f: [f64; 3], channels: usize) -> [f64; 3] {
    if channels == 1 {
        [(f[0] + f[1] + f[2]) / 3.0; 3]
    } else {
        f
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::sample::parse;

    #[test]
    fn the_floor_is_a_hundredth_of_the_median_or_of_white_with_the_same_albedo() {
        // A diffuse material is its own median, and its albedo over θ ≤ 80° a little less than over all.
        for albedo in [0.9, 0.05] {
            let white = parse(&format!("lambert:{albedo}")).unwrap();
            let floor = Floor::of(white.as_ref(), 3);
            assert!(
                (floor.least[1] / (0.01 * albedo / PI) - 1.0).abs() < 1e-9,
                "{floor:?}"
            );
            assert_eq!(floor.error(0.5, 0.4, 1), Some((0.5 - 0.4) / 0.4));
        }
        // A lobe without a base has its albedo and hardly a median.
        let lobe = parse("ggx:f0=0.9,ax=0.1,ay=0.1,rd=0").unwrap();
        let floor = Floor::of(lobe.as_ref(), 1);
        assert!((0.3..1.0).contains(&(floor.least[0] * PI / 0.01)), "{floor:?}");
        assert_eq!(floor.error(1.0, 0.9 * floor.least[0], 0), None);
    }

    #[test]
    fn black_undefined_and_negative_references_score_nothing() {
        let black = parse("lambert:0").unwrap();
        let floor = Floor::of(black.as_ref(), 3);
        for truth in [0.0, -1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(floor.error(0.1, truth, 0), None, "{truth}");
        }
        assert_eq!(floor.error(f64::NAN, 1.0, 0), None);
    }
}
