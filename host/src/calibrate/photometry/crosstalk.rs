//! What the camera's colours show of each other, from a standard in the light of one primary after the other.
//!
//! # Design
//! The image is looked at in blocks, over whose pixels light is summed. In each the light of a primary over that of all is a number
//! with a variance by noise, and two terms over the image explain all blocks (see [`Crosstalk`]). By what they do not explain
//! beyond noise all are uncertain, and by what the lamp, and with it the light of black pixels, flickers from primary to primary, and
//! by the noise of rows, which all blocks beside each other have in common, and by the steps of a converter that noise does not dither.

use glam::DVec3;

use super::linear::Linear;
use crate::base::linear_fit::least_squares;
use crate::brdf::sample::{Outgoing, Sample, parse};
use crate::calibrate::CalibrateError;
use crate::hemisphere::direction::from_degrees;
use crate::instrument::calibration::{COLOURS, Crosstalk};
use crate::instrument::frame_format::place_of_pixel;
use crate::virtual_rig::setup::SetupError;

/// Blocks of the image along each axis.
const BLOCKS: usize = 6;
/// Light of a block that counts, over that of the brightest.
const LEAST: f64 = 0.05;
/// Fewest blocks that tell two terms, and how well.
const FEWEST: usize = 4;
/// What two terms do not have is more at the middle and the edges than in the mean, by this factor.
const EDGES: f64 = 1.5;

/// Frames of the `standard` in each primary and black ones, of an image `size_px` (width, height).
pub(super) struct Colours<'a> {
    pub(super) of_primary: [Vec<&'a [u16]>; COLOURS],
    pub(super) black: Vec<&'a [u16]>,
    pub(super) size_px: [usize; 2],
    pub(super) standard: &'a dyn Sample,
    /// Standard deviation of the lamp's light from frame to frame, relative.
    pub(super) flicker: f64,
}

/// One channel in one block.
#[derive(Clone, Copy, Default)]
struct Block {
    /// Light of each primary, and its variance.
    light: [f64; COLOURS],
    variance: [f64; COLOURS],
    pixels: usize,
    /// Light of black pixels.
    black: f64,
    /// Σ light·ρ².
    squares: f64,
}

impl Block {
    fn all(&self) -> f64 {
        self.light.iter().sum()
    }

    /// Share of a primary, and its variance by noise.
    fn share(&self, primary: usize) -> (f64, f64) {
        let all = self.all();
        let share = self.light[primary] / all;
        let others: f64 = (0..COLOURS)
            .filter(|other| *other != primary)
            .map(|other| self.variance[other])
            .sum();
        let variance = (1.0 - share).powi(2) * self.variance[primary] + share * share * others;
        (share, variance / (all * all))
    }
}

impl Colours<'_> {
    /// What the colours show of each other; `None` if there is too little light to tell.
    pub(super) fn crosstalk(&self, linear: &Linear) -> Option<Crosstalk> {
        let blocks = self.blocks(linear);
        let mut found = Crosstalk {
            shares: [[[0.0; 2]; COLOURS]; COLOURS],
            standard_uncertainty: [[0.0; COLOURS]; COLOURS],
        };
        for (channel, blocks) in blocks.iter().enumerate() {
            let brightest = blocks.iter().map(Block::all).fold(0.0, f64::max);
            let bright = |block: &&Block| block.all() > LEAST * brightest;
            let bright: Vec<&Block> = blocks.iter().filter(bright).collect();
            if bright.len() < FEWEST {
                return None;
            }
            let sum = |of: fn(&Block) -> f64| bright.iter().map(|block| of(block)).sum::<f64>();
            let all = sum(Block::all);
            let black = sum(|block| block.black.abs()) / all;
            let per_dn = sum(|block| block.pixels as f64) / all;
            let rows = (linear.camera.row_variance_dn2() / self.size_px[1] as f64).sqrt() * per_dn;
            let steps = Steps::of(linear, &bright, per_dn);
            for primary in 0..COLOURS {
                let (terms, uncertainty) = explain(&bright, primary)?;
                found.shares[channel][primary] = terms;
                let frames = self.of_primary[primary].len() as f64;
                // Of two means of so many frames.
                let by_lamp = (terms[0] * (1.0 - terms[0])).hypot(black) * self.flicker;
                let by_frame = by_lamp.hypot(rows) * (2.0 / frames).sqrt();
                let steps = steps.of_share(terms[0], primary);
                found.standard_uncertainty[channel][primary] = uncertainty.hypot(by_frame).hypot(steps);
            }
            // Each was fitted by itself; together they are all of the light.
            for term in 0..2 {
                let sum: f64 = found.shares[channel].iter().map(|terms| terms[term]).sum();
                found.shares[channel][channel][term] += if term == 0 { 1.0 - sum } else { -sum };
            }
        }
        Some(found)
    }

    /// [channel][block].
    fn blocks(&self, linear: &Linear) -> [Vec<Block>; COLOURS] {
        let [width_px, height_px] = self.size_px;
        // How bright the standard is in each, over the mean.
        let f = self.standard.f(from_degrees(45.0, 0.0), DVec3::Z);
        let f = f.map(|of_one| of_one * COLOURS as f64 / f.iter().sum::<f64>());
        let lit = self.of_primary.each_ref().map(|frames| linear.mean(frames));
        let black = linear.mean(&self.black);
        let read = linear.camera.read_variance_dn2();
        let noise =
            |light: f64, frames: usize| (read + light.max(0.0) / linear.camera.gain_e_per_dn) / frames as f64;
        let mut blocks = std::array::from_fn(|_| vec![Block::default(); BLOCKS * BLOCKS]);
        for pixel in 0..width_px * height_px {
            let [x, y] = place_of_pixel(pixel, width_px, height_px);
            let [column, row] = [x, y].map(|at| (f64::midpoint(at, 1.0) * BLOCKS as f64) as usize);
            for (channel, blocks) in blocks.iter_mut().enumerate() {
                let at = pixel * COLOURS + channel;
                let all = self.of_primary.iter().flatten().chain(&self.black);
                if !all.map(|frame| f64::from(frame[at])).all(|dn| linear.trusts(dn)) {
                    continue;
                }
                let block: &mut Block = &mut blocks[row * BLOCKS + column];
                for primary in 0..COLOURS {
                    // Had the standard been as bright in all.
                    let light = (lit[primary][at] - black[at]) / f[primary];
                    let variance = noise(lit[primary][at], self.of_primary[primary].len())
                        + noise(black[at], self.black.len());
                    block.light[primary] += light;
                    block.variance[primary] += variance / f[primary].powi(2);
                    block.squares += light * (x * x + y * y);
                }
                block.pixels += 1;
                block.black += black[at];
            }
        }
        blocks
    }
}

/// What steps of the converter leave in frames, relative to the light of all primaries together (k = 1).
struct Steps {
    of_black: f64,
    of_lit: [f64; COLOURS],
}

impl Steps {
    /// In these `blocks`, where a digital number of each pixel makes `per_dn` of that light.
    fn of(linear: &Linear, blocks: &[&Block], per_dn: f64) -> Self {
        let pixels: usize = blocks.iter().map(|block| block.pixels).sum();
        let mean_dn =
            |of: &dyn Fn(&Block) -> f64| blocks.iter().map(|block| of(block)).sum::<f64>() / pixels as f64;
        let black_dn = mean_dn(&|block| block.black);
        let left = |light_dn: f64| per_dn * linear.steps_in_dn(black_dn + light_dn);
        Self {
            of_black: left(0.0),
            of_lit: std::array::from_fn(|primary| left(mean_dn(&|block| block.light[primary]))),
        }
    }

    /// What they leave of this `share` of a `primary`: all are compared with the same black frames.
    fn of_share(&self, share: f64, primary: usize) -> f64 {
        let of_lit = self.of_lit.iter().enumerate();
        of_lit.fold(
            (1.0 - COLOURS as f64 * share) * self.of_black,
            |left, (other, of_lit)| {
                let part = if other == primary { 1.0 - share } else { share };
                left.hypot(part * of_lit)
            },
        )
    }
}

/// Both terms of the share of a `primary` in all `blocks`, and its standard uncertainty.
fn explain(blocks: &[&Block], primary: usize) -> Option<([f64; 2], f64)> {
    let of = |block: &&Block| (block.share(primary), block.squares / block.all());
    let rows = || blocks.iter().map(of);
    let normal = rows().map(|((share, variance), square)| (vec![1.0, square], share, variance.recip()));
    let (terms, covariance) = least_squares(2, normal)?;
    let (mut squares, mut weights) = (0.0, 0.0);
    for ((share, variance), square) in rows() {
        squares += (share - terms[0] - terms[1] * square).powi(2) / variance;
        weights += variance.recip();
    }
    let more = (squares - (blocks.len() as f64 - 2.0)).max(0.0) / weights;
    Some((
        [terms[0], terms[1]],
        (covariance[(0, 0)] + EDGES * EDGES * more).sqrt(),
    ))
}

/// A standard as a camera with `crosstalk` sees it.
#[derive(Debug)]
pub(super) struct AsSeen {
    standard: Box<dyn Sample>,
    pub(super) crosstalk: Option<Crosstalk>,
}

impl AsSeen {
    /// The standard that `spec` describes.
    ///
    /// # Errors
    /// That of [`crate::brdf::sample::parse`].
    pub(super) fn new(spec: &str, crosstalk: Option<Crosstalk>) -> Result<Self, CalibrateError> {
        let standard = parse(spec).map_err(SetupError::from)?;
        Ok(Self { standard, crosstalk })
    }
}

/// The same under one incident direction.
struct AsSeenOutgoing<'a>(Box<dyn Outgoing + 'a>, Crosstalk);

impl Sample for AsSeen {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        let of_standard = self.standard.incident(wi);
        match self.crosstalk {
            Some(crosstalk) => Box::new(AsSeenOutgoing(of_standard, crosstalk)),
            None => of_standard,
        }
    }

    fn is_isotropic(&self) -> bool {
        self.standard.is_isotropic()
    }
}

impl Outgoing for AsSeenOutgoing<'_> {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        (self.1.at(0.0, 0.0) * DVec3::from(self.0.f(wo))).to_array()
    }
}
