//! What watches the lamp, with nothing held but darkness.

use super::capture::{PATTERNS, StrayViews, WATCHED};
use super::fit::Frames;
use crate::base::linear_fit::least_squares;
use crate::instrument::calibration::Monitor;
use crate::instrument::calibration::stray::{CAMERA_TERMS, camera_terms, dark_of, steps_dn};
use crate::instrument::rig::Rig;

/// How much more a pixel counts that is dark in measurements than one that is not, of which every so manieth takes part.
const DARK_WEIGHT: f64 = 100.0;
const EVERY: usize = 7;
/// Groups of dark pixels by which it is told how well the light in them is known.
const GROUPS: usize = 8;
/// It is known no better than this, relative.
const BEST: f64 = 3e-4;

impl Frames {
    /// Light of the watching pixels; `None` if there are none, or nothing to be seen of them.
    pub(super) fn monitor(&self, views: &StrayViews, rig: &Rig) -> Option<Monitor> {
        if views.watching_side == 0 {
            return None;
        }
        let frames = &self.segments[WATCHED];
        let scale = (PATTERNS as f64 * views.watched_s).recip();
        let dark = dark_of(rig);
        if dark.len() < GROUPS {
            return None;
        }
        let (mut light, mut off) = (Vec::new(), 0.0_f64);
        for channel in 0..self.channels {
            let shown = |pixel: usize| {
                let each = frames.iter().map(|frame| f64::from(frame[pixel][channel]));
                scale * each.sum::<f64>()
            };
            let (found, sum, left) = self.smooth(&dark, &shown)?;
            if sum <= 0.0 {
                return None;
            }
            let by_steps = steps_dn(rig) * dark.len() as f64 / views.watched_s;
            off = off.max(left.hypot(by_steps) / sum);
            light.push(found);
        }
        Some(Monitor {
            side: views.watching_side,
            light,
            standard_uncertainty: off.hypot(BEST),
        })
    }

    /// A polynomial over the image that is as `shown`(pixel), above all in the pixels that are `dark` otherwise: its coefficients,
    /// its sum over those, and how far that is uncertain: other tilts and image sizes have other dark pixels, about as well as
    /// groups of them agree.
    fn smooth(&self, dark: &[u32], shown: &dyn Fn(usize) -> f64) -> Option<(Vec<f64>, f64, f64)> {
        let (width, height) = self.size_px;
        let terms = |pixel: usize| camera_terms(pixel, width, height);
        let row = |pixel: usize, weight: f64| (terms(pixel).to_vec(), shown(pixel), weight);
        let all = (0..width * height).step_by(EVERY).map(|pixel| row(pixel, 1.0));
        let of_dark = dark.iter().map(|pixel| row(*pixel as usize, DARK_WEIGHT));
        let rows: Vec<_> = all.chain(of_dark).collect();
        let (found, _) = least_squares(CAMERA_TERMS, &rows.iter().cloned())?;
        let fitted = |pixel: u32| {
            let terms = terms(pixel as usize);
            terms
                .iter()
                .zip(found.iter())
                .map(|(term, c)| term * c)
                .sum::<f64>()
        };
        let left = |group: &[u32]| -> f64 {
            group
                .iter()
                .map(|pixel| shown(*pixel as usize) - fitted(*pixel))
                .sum()
        };
        let groups = dark.chunks(dark.len().div_ceil(GROUPS));
        let squares: f64 = groups.map(|group| left(group).powi(2)).sum();
        Some((
            found.iter().copied().collect(),
            dark.iter().map(|pixel| fitted(*pixel)).sum(),
            squares.sqrt(),
        ))
    }
}
