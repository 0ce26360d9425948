//! What the views of stray light say.
//!
//! # Design
//! *Direct light* is what the camera shows of parts of the projector's image while nothing is held but darkness: the
//! coefficients of a polynomial over both images, which is a least-squares fit along each.
//!
//! Glare and ghost stand in `glare`.

use std::path::Path;

use glam::Vec4;
use nalgebra::DMatrix;
use rayon::prelude::*;

use super::super::Linear;
use super::super::capture::{VIEWS, layout};
use super::capture::{BLACK, DISCS, FIRST_PARTED, PATTERNS, RAW, SEGMENTS, StrayViews, WATCHED, lit};
use super::glare::{Mirrored, luminance, sources};
use crate::base::text::by;
use crate::calibrate::{CalibrateError, open_raw};
use crate::instrument::calibration::stray::{CAMERA_TERMS, PROJECTOR_TERMS, camera_terms, lanes, lit_terms};
use crate::instrument::calibration::{CalibrationError, Monitor, Stray};
use crate::instrument::rig::Rig;

/// A frame whose brightest pixel is dimmer than this share of that of all frames shows nothing.
const LEAST_BRIGHT: f32 = 0.2;
/// Side of the blocks by which it is told how well the halo is known, pixels.
pub(super) const BLOCK_PX: usize = 32;
/// No halo, ghost or direct light is known better than this, relative.
pub(super) const BEST: f64 = 0.02;
/// The stray light in the captures in `dir`, and what watches the lamp; `linear` is the camera as `views` show it.
///
/// # Errors
/// [`CalibrateError`].
pub(in super::super) fn stray(
    dir: &Path,
    full: &Rig,
    views: &StrayViews,
    linear: &Linear,
) -> Result<(Stray, Option<Monitor>), CalibrateError> {
    let frames = Frames::read(dir, full, views, linear)?;
    let (direct, direct_uncertainty) = frames.direct();
    let mirrored = frames.mirrored();
    if mirrored.shown.is_empty() {
        return Err(CalibrateError::Views {
            expected: "discs of light in the flat mirror".to_owned(),
            found: "none".to_owned(),
            advice: "is the mirror in place, flat, and lit?",
        });
    }
    let (halo, halo_uncertainty, ghost) = mirrored.fit();
    let found = Stray {
        halo,
        halo_uncertainty,
        ghost,
        direct,
        direct_uncertainty,
    };
    Ok((found, frames.monitor(views, &views.rig(full)?)))
}

/// The frames of the views.
pub(super) struct Frames {
    pub(super) size_px: (usize, usize),
    projector_px: (usize, usize),
    pub(super) channels: usize,
    /// Exposure time of parts, seconds.
    parts_s: f64,
    /// Of each segment, those with light, less the black ones, linear, channels in the lanes.
    pub(super) segments: Vec<Vec<Vec<Vec4>>>,
    /// Variance of a dark pixel of these by noise, DN².
    variance: f32,
}

impl Frames {
    fn read(dir: &Path, full: &Rig, views: &StrayViews, linear: &Linear) -> Result<Self, CalibrateError> {
        let rig = views.rig(full)?;
        let raw = open_raw(dir, RAW, VIEWS)?;
        let (expected, found) = (layout(SEGMENTS, rig.frame_format()), raw.layout());
        let of = |layout: &crate::store::RawLayout| {
            [
                layout.exposures,
                layout.segment,
                layout.height,
                layout.width,
                layout.channels,
            ]
        };
        if of(&expected) != of(found) {
            return Err(CalibrationError::Content {
                path: dir.join(RAW).display().to_string(),
                field: "exposures × segment × rows × columns × channels".to_owned(),
                expected: format!("{} as {VIEWS} says", by(&of(&expected))),
                found: by(&of(found)),
            }
            .into());
        }
        let (channels, length) = (found.channels, rig.frame_format().len());
        let of_pixel = |values: &[f64]| lanes(channels, |channel| values[channel]);
        let (mut segments, mut darkness) = (Vec::new(), 0.0_f64);
        for number in 0..raw.segments() {
            let segment = raw.read_segment(number)?;
            let all: Vec<&[u16]> = segment.frames.chunks_exact(length).collect();
            let black = linear.mean(&all[PATTERNS..]);
            let mean = black.iter().sum::<f64>() / black.len() as f64;
            if number < FIRST_PARTED {
                darkness = darkness.max(mean);
            }
            let shown = |frame: &&[u16]| {
                let lit: Vec<f64> = frame
                    .iter()
                    .zip(&black)
                    .map(|(dn, black)| linear.of(f64::from(*dn)) - black)
                    .collect();
                lit.chunks_exact(channels).map(of_pixel).collect::<Vec<_>>()
            };
            segments.push(all[..PATTERNS].par_iter().map(shown).collect());
        }
        let camera = linear.camera_of(&rig);
        let one = camera.read_variance_dn2() + darkness.max(0.0) / camera.gain_e_per_dn;
        Ok(Self {
            size_px: (found.width, found.height),
            projector_px: (
                rig.projector.lens.width_px as usize,
                rig.projector.lens.height_px as usize,
            ),
            channels,
            parts_s: views.parts_s,
            segments,
            variance: (one * (1.0 + 1.0 / BLACK as f64)) as f32,
        })
    }

    /// Coefficients of direct light, [channel][camera term × projector term], and its standard uncertainty, DN per second and
    /// projector pixel.
    fn direct(&self) -> (Vec<Vec<f64>>, f64) {
        let (width, height) = self.size_px;
        let camera = DMatrix::from_row_iterator(
            width * height,
            CAMERA_TERMS,
            (0..width * height).flat_map(|pixel| camera_terms(pixel, width, height)),
        );
        let shown: Vec<&Vec<Vec4>> = self.segments[FIRST_PARTED..WATCHED].iter().flatten().collect();
        let exposure_s = self.parts_s;
        let lit: Vec<[f64; PROJECTOR_TERMS]> = (0..shown.len())
            .map(|number| {
                let pixels = lit(
                    FIRST_PARTED + number / PATTERNS,
                    number % PATTERNS,
                    self.projector_px,
                );
                lit_terms(&pixels, self.projector_px.0, self.projector_px.1)
            })
            .collect();
        let projector = DMatrix::from_row_iterator(lit.len(), PROJECTOR_TERMS, lit.iter().flatten().copied());
        let inverse = |of: &DMatrix<f64>| {
            let square = of.transpose() * of;
            let scale = square.diagonal().max();
            (square / scale).pseudo_inverse(1e-12).map_or_else(
                |_| DMatrix::zeros(of.ncols(), of.ncols()),
                |inverse| inverse / scale,
            )
        };
        let to_camera = inverse(&camera) * camera.transpose();
        let to_projector = &projector * inverse(&projector);
        let (mut all, mut squares, mut signal) = (Vec::new(), 0.0_f64, 0.0_f64);
        for channel in 0..self.channels {
            let image = DMatrix::from_fn(width * height, shown.len(), |pixel, number| {
                f64::from(shown[number][pixel][channel]) / exposure_s
            });
            let found = &to_camera * &image * &to_projector;
            let left = image - &camera * &found * projector.transpose();
            for (number, column) in left.column_iter().enumerate() {
                let (blocks, of) = (self.blocks(column.as_slice()), lit[number][0]);
                squares += blocks.iter().map(|mean| (mean / of).powi(2)).sum::<f64>() / blocks.len() as f64;
            }
            signal += found[(0, 0)].abs();
            all.push(
                (0..CAMERA_TERMS)
                    .flat_map(|row| found.row(row).iter().copied().collect::<Vec<_>>())
                    .collect(),
            );
        }
        let left = (squares / (self.channels * shown.len()) as f64).sqrt();
        (all, left.hypot(BEST * signal / self.channels as f64))
    }

    /// Means of an image over blocks.
    fn blocks(&self, image: &[f64]) -> Vec<f64> {
        let (width, height) = self.size_px;
        let columns = width.div_ceil(BLOCK_PX);
        let mut sums = vec![(0.0, 0_u32); columns * height.div_ceil(BLOCK_PX)];
        for (pixel, value) in image.iter().enumerate() {
            let sum = &mut sums[pixel / width / BLOCK_PX * columns + pixel % width / BLOCK_PX];
            *sum = (sum.0 + value, sum.1 + 1);
        }
        sums.into_iter()
            .map(|(sum, count)| sum / f64::from(count.max(1)))
            .collect()
    }

    /// The frames with the mirror that show something, less what comes directly.
    fn mirrored(&self) -> Mirrored {
        let (mirror, trap) = self.segments[..FIRST_PARTED].split_at(DISCS);
        let less = |(mirror, trap): (&Vec<Vec4>, &Vec<Vec4>)| {
            let pixels = mirror.iter().zip(trap);
            pixels.map(|(mirror, trap)| *mirror - *trap).collect()
        };
        let both = mirror.iter().flatten().zip(trap.iter().flatten());
        let mut shown: Vec<Vec<Vec4>> = both.map(less).collect();
        let brightest = |frame: &Vec<Vec4>| frame.iter().map(|lanes| luminance(*lanes)).fold(0.0, f32::max);
        let most = shown.iter().map(brightest).fold(0.0, f32::max);
        shown.retain(|frame| most > 0.0 && brightest(frame) > LEAST_BRIGHT * most);
        Mirrored {
            size_px: self.size_px,
            channels: self.channels,
            variance: 2.0 * self.variance,
            sources: shown.iter().map(|frame| sources(frame)).collect(),
            shown,
        }
    }
}
