//! What watches the lamp, with nothing held but darkness.

use super::capture::{PATTERNS, StrayViews, WATCHED};
use super::fit::Frames;
use crate::base::linear_fit::least_squares;
use crate::instrument::calibration::Monitor;
use crate::instrument::calibration::lamp::{WATCH_TERMS, watch_terms};
use crate::instrument::calibration::stray::{dark_of, steps_dn};
use crate::instrument::rig::Rig;

/// Every so manieth pixel takes part.
const EVERY: usize = 7;
/// Blocks along an axis by which it is told how well the light is known, and groups of dark pixels in this image.
const BLOCKS: usize = 4;
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
            let (found, left) = self.smooth(&dark, &shown)?;
            let watching_dn = views.watched_s * found[0];
            off = off.max(left.hypot(steps_dn(rig, watching_dn) / watching_dn));
            light.push(found);
        }
        Some(Monitor {
            side: views.watching_side,
            light,
            standard_uncertainty: off.hypot(BEST),
        })
    }

    /// A polynomial over the image that is as `shown`(pixel): its coefficients, and how far it is uncertain, relative. At other tilts other
    /// pixels are dark than these: known about as well as what blocks of the image, or groups of dark pixels, differ from it by.
    /// `None` if nothing shines.
    fn smooth(&self, dark: &[u32], shown: &dyn Fn(usize) -> f64) -> Option<(Vec<f64>, f64)> {
        let (width, height) = self.size_px;
        let some = || (0..width * height).step_by(EVERY);
        let rows: Vec<_> = some()
            .map(|pixel| (watch_terms(pixel, width, height).to_vec(), shown(pixel), 1.0))
            .collect();
        let (found, _) = least_squares(WATCH_TERMS, rows.iter().cloned())?;
        let left = |pixels: &mut dyn Iterator<Item = usize>| {
            let (mut off, mut sum) = (0.0, 0.0);
            for pixel in pixels {
                let terms = watch_terms(pixel, width, height);
                let fitted: f64 = terms.iter().zip(found.iter()).map(|(term, c)| term * c).sum();
                off += shown(pixel) - fitted;
                sum += fitted;
            }
            off / sum
        };
        let is_in = |pixel: usize, block: usize| {
            let (x, y) = (pixel % width * BLOCKS / width, pixel / width * BLOCKS / height);
            y * BLOCKS + x == block
        };
        let rms = |each: Vec<f64>| {
            let squares: f64 = each.iter().map(|left| left * left).sum();
            (squares / each.len() as f64).sqrt()
        };
        let blocks = (0..BLOCKS * BLOCKS).map(|block| left(&mut some().filter(|pixel| is_in(*pixel, block))));
        let groups = dark
            .chunks(dark.len().div_ceil(GROUPS))
            .map(|group| left(&mut group.iter().map(|pixel| *pixel as usize)));
        let off = rms(blocks.collect()).max(rms(groups.collect()));
        (found[0] > 0.0 && off.is_finite()).then(|| (found.iter().copied().collect(), off))
    }
}
