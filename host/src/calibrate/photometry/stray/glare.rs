//! Glare and ghost from discs of light in a flat mirror.
//!
//! # Design
//! In a flat mirror a pattern is seen sharp, and where it is not it should be as dark as with a black pattern. What shines there
//! is the halo of what is bright: a sum of Gaussians, whose shares are fitted (none below 0) with weights by noise and by a share
//! of the halo itself, so that far tails count as much as near ones. The ghost is looked for in what that leaves, displaced by
//! whole pixels first, and is fitted with the halo then.
//!
//! How well the halo is known is what the fit leaves of means over blocks of pixels, relative.

use glam::Vec4;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::fit::{BEST, BLOCK_PX};
use crate::instrument::calibration::GhostFound;
use crate::instrument::calibration::stray::{Halo, HaloRoom, Shifted, WIDTHS};

/// Share of the brightest from which on a pixel shows the pattern itself; more than any ghost.
const BRIGHT: f32 = 0.1;
/// Every so many pixels along each axis takes part.
const EVERY: usize = 2;
/// Share of the halo that counts as its noise.
const RELATIVE: f32 = 0.05;
/// Displacements of the ghost that are looked at, half widths of the image, and from how many pixels on.
const FARTHEST: f64 = 0.08;
const NEAREST_PX: f64 = 2.0;
/// A ghost is one if it stands out by so many standard uncertainties.
const CLEAR: f64 = 6.0;

/// No glass reflects less; what is fainter is the halo's shape.
const LEAST_GHOST: f64 = 1e-3;

/// Columns of the fit: the Gaussians, and the ghost.
const COLUMNS: usize = WIDTHS.len() + 1;

/// Sum of the channels.
pub(super) fn luminance(lanes: Vec4) -> f32 {
    lanes.x + lanes.y + lanes.z
}

/// The pixels that show the pattern itself; zero elsewhere.
pub(super) fn sources(frame: &[Vec4]) -> Vec<Vec4> {
    let brightest = frame.iter().map(|lanes| luminance(*lanes)).fold(0.0, f32::max);
    let is_bright = |lanes: &Vec4| luminance(*lanes) > BRIGHT * brightest;
    frame
        .iter()
        .map(|lanes| if is_bright(lanes) { *lanes } else { Vec4::ZERO })
        .collect()
}

/// Frames with the mirror.
pub(super) struct Mirrored {
    pub(super) size_px: (usize, usize),
    pub(super) channels: usize,
    /// Variance of a dark pixel by noise, DN².
    pub(super) variance: f32,
    /// What the frames show, less what is not of the pattern, DN.
    pub(super) shown: Vec<Vec<Vec4>>,
    /// Those of its pixels that show the pattern itself.
    pub(super) sources: Vec<Vec<Vec4>>,
}

/// A pixel that should be dark.
struct Dark {
    frame: u32,
    pixel: u32,
    /// What it shows.
    shown: Vec4,
    /// What each Gaussian of share 1 would add.
    gaussians: [Vec4; WIDTHS.len()],
    weight: Vec4,
}

impl Dark {
    /// What the columns of the Gaussians have of it in one channel; nothing in that of the ghost.
    fn row(&self, channel: usize) -> [f64; COLUMNS] {
        let mut row = [0.0; COLUMNS];
        for (value, gaussian) in row.iter_mut().zip(&self.gaussians) {
            *value = f64::from(gaussian[channel]);
        }
        row
    }
}

/// Shares of each channel, their covariance, and the weighted sum of squares that is left.
struct Shares {
    /// [channel][column].
    all: Vec<[f64; COLUMNS]>,
    /// Of the ghost, mean over the channels: share and standard uncertainty.
    ghost: (f64, f64),
    left: f64,
}

/// What the equations of one channel say.
struct Solved {
    shares: [f64; COLUMNS],
    /// Of the last share, k = 1.
    uncertainty: f64,
    /// Weighted sum of squares.
    left: f64,
}

/// Normal equations of one channel.
#[derive(Clone)]
struct Normal {
    matrix: [[f64; COLUMNS]; COLUMNS],
    right: [f64; COLUMNS],
    square: f64,
    count: f64,
}

impl Mirrored {
    /// Shares of the halo, [channel][width], their relative uncertainty, and the ghost.
    pub(super) fn fit(&self) -> (Vec<Vec<f64>>, f64, Option<GhostFound>) {
        let mut dark = self.dark();
        let mut shares = self.shares(&dark, &self.halo(&dark), None);
        self.weigh(&mut dark, &shares, None);
        shares = self.shares(&dark, &self.halo(&dark), None);
        let shift = self.look_for_ghost(&dark, &shares);
        let mut ghost = None;
        if let Some(shift) = shift {
            let (refined, with) = self.refine(&dark, shift);
            let (share, uncertainty) = with.ghost;
            if share > (CLEAR * uncertainty).max(LEAST_GHOST) {
                self.weigh(&mut dark, &with, Some(refined));
                shares = self.shares(&dark, &self.halo(&dark), Some(refined));
                let half = self.size_px.0 as f64 / 2.0;
                ghost = Some((
                    refined,
                    GhostFound {
                        share: shares.all.iter().map(|columns| columns[WIDTHS.len()]).collect(),
                        standard_uncertainty: shares.ghost.1.max(BEST * shares.ghost.0),
                        shift: refined.map(|px| px / half),
                    },
                ));
            }
        }
        let uncertainty = self.relative_uncertainty(&dark, &shares, ghost.as_ref().map(|(shift, _)| *shift));
        let halo = shares
            .all
            .iter()
            .map(|columns| columns[..WIDTHS.len()].to_vec())
            .collect();
        (halo, uncertainty, ghost.map(|(_, ghost)| ghost))
    }

    /// Pixels that should be dark.
    fn dark(&self) -> Vec<Dark> {
        let (width, height) = self.size_px;
        let halo = Halo::new(width, height);
        let of = |(frame, source): (usize, &Vec<Vec4>)| {
            let mut room = HaloRoom::default();
            let mut gaussians = vec![[Vec4::ZERO; WIDTHS.len()]; source.len()];
            let mut image = Vec::new();
            for place in 0..WIDTHS.len() {
                image.clear();
                image.resize(source.len(), Vec4::ZERO);
                halo.add(place, source, Vec4::ONE, &mut image, &mut room);
                for (gaussians, value) in gaussians.iter_mut().zip(&image) {
                    gaussians[place] = *value;
                }
            }
            let is_near = |x: usize, y: usize| {
                (y.saturating_sub(1)..(y + 2).min(height)).any(|y| {
                    (x.saturating_sub(1)..(x + 2).min(width)).any(|x| source[y * width + x] != Vec4::ZERO)
                })
            };
            let places = (0..height)
                .step_by(EVERY)
                .flat_map(|y| (0..width).step_by(EVERY).map(move |x| (x, y)));
            places
                .filter(|(x, y)| !is_near(*x, *y))
                .map(|(x, y)| Dark {
                    frame: frame as u32,
                    pixel: (y * width + x) as u32,
                    shown: self.shown[frame][y * width + x],
                    gaussians: gaussians[y * width + x],
                    weight: Vec4::splat(self.variance.recip()),
                })
                .collect::<Vec<_>>()
        };
        let all: Vec<Vec<Dark>> = self.sources.par_iter().enumerate().map(of).collect();
        all.into_iter().flatten().collect()
    }

    /// The ghost of share 1, displaced by `shift` pixels, if there is one.
    fn ghost(&self, shift: Option<[f64; 2]>) -> Option<Shifted> {
        let (width, height) = self.size_px;
        let shift = shift?.map(|px| 2.0 * px / width as f64);
        Some(Shifted::new(shift, width, height))
    }

    /// What the `ghost` of share 1 adds to a pixel.
    fn added(&self, ghost: Option<&Shifted>, dark: &Dark) -> Vec4 {
        ghost.map_or(Vec4::ZERO, |ghost| {
            ghost.at(&self.sources[dark.frame as usize], dark.pixel as usize)
        })
    }

    /// What the Gaussians make of the equations of each channel.
    fn halo(&self, dark: &[Dark]) -> Vec<Normal> {
        let mut normals = vec![Normal::default(); self.channels];
        for dark in dark {
            for (channel, normal) in normals.iter_mut().enumerate() {
                normal.add(
                    &dark.row(channel),
                    f64::from(dark.shown[channel]),
                    f64::from(dark.weight[channel]),
                );
            }
        }
        normals
    }

    /// Shares by least squares, with a ghost displaced by `shift` pixels if there is one; none is below 0. The `halo` is that of `dark`.
    fn shares(&self, dark: &[Dark], halo: &[Normal], shift: Option<[f64; 2]>) -> Shares {
        let ghost = self.ghost(shift);
        let mut normals = halo.to_vec();
        for dark in dark {
            let added = self.added(ghost.as_ref(), dark);
            // Discs have ghosts as large as they are: most pixels show none.
            if added == Vec4::ZERO {
                continue;
            }
            for (channel, normal) in normals.iter_mut().enumerate() {
                normal.add_ghost(
                    &dark.row(channel),
                    f64::from(added[channel]),
                    f64::from(dark.shown[channel]),
                    f64::from(dark.weight[channel]),
                );
            }
        }
        let found: Vec<Solved> = normals.iter().map(Normal::solve).collect();
        let channels = self.channels as f64;
        let mean = |of: fn(&Solved) -> f64| found.iter().map(of).sum::<f64>() / channels;
        Shares {
            ghost: (mean(|one| one.shares[WIDTHS.len()]), mean(|one| one.uncertainty)),
            left: found.iter().map(|one| one.left).sum(),
            all: found.into_iter().map(|one| one.shares).collect(),
        }
    }

    /// Weights of what should be dark by noise and by a share of what `shares` say that it is.
    fn weigh(&self, dark: &mut [Dark], shares: &Shares, shift: Option<[f64; 2]>) {
        let ghost = self.ghost(shift);
        for dark in dark {
            let model = Self::model(dark, shares, self.added(ghost.as_ref(), dark));
            let own = model * RELATIVE;
            dark.weight = (own * own + Vec4::splat(self.variance)).recip();
        }
    }

    /// What a pixel should show to which the ghost of share 1 has `added` so much.
    fn model(dark: &Dark, shares: &Shares, added: Vec4) -> Vec4 {
        let mut lanes = [0.0_f32; 4];
        for (channel, columns) in shares.all.iter().enumerate() {
            let halo: f64 = dark
                .gaussians
                .iter()
                .zip(columns)
                .map(|(gaussian, share)| f64::from(gaussian[channel]) * share)
                .sum();
            lanes[channel] = (halo + f64::from(added[channel]) * columns[WIDTHS.len()]) as f32;
        }
        Vec4::from_array(lanes)
    }

    /// The displacement in whole pixels at which a copy explains most of what `shares` leave.
    fn look_for_ghost(&self, dark: &[Dark], shares: &Shares) -> Option<[f64; 2]> {
        let (width, height) = self.size_px;
        let left: Vec<(usize, usize, f32, f32)> = dark
            .iter()
            .map(|dark| {
                let left = luminance(dark.shown - Self::model(dark, shares, Vec4::ZERO));
                (
                    dark.frame as usize,
                    dark.pixel as usize,
                    left,
                    luminance(dark.weight),
                )
            })
            .collect();
        let sources: Vec<Vec<f32>> = self
            .sources
            .iter()
            .map(|source| source.iter().map(|lanes| luminance(*lanes)).collect())
            .collect();
        let most = (FARTHEST * width as f64 / 2.0) as isize;
        let shifts: Vec<(isize, isize)> = (-most..=most)
            .flat_map(|y| (-most..=most).map(move |x| (x, y)))
            .filter(|(x, y)| (NEAREST_PX..=most as f64).contains(&(*x as f64).hypot(*y as f64)))
            .collect();
        let explained = |&(dx, dy): &(isize, isize)| {
            let (mut rc, mut cc) = (0.0_f64, 0.0_f64);
            for &(frame, pixel, left, weight) in &left {
                let (x, y) = (
                    (pixel % width).cast_signed() - dx,
                    (pixel / width).cast_signed() - dy,
                );
                if (0..width.cast_signed()).contains(&x) && (0..height.cast_signed()).contains(&y) {
                    let copy = sources[frame][y.cast_unsigned() * width + x.cast_unsigned()];
                    rc += f64::from(weight * left * copy);
                    cc += f64::from(weight * copy * copy);
                }
            }
            if rc > 0.0 && cc > 0.0 { rc * rc / cc } else { 0.0 }
        };
        let all: Vec<f64> = shifts.par_iter().map(explained).collect();
        let best = all.iter().zip(&shifts).max_by(|a, b| a.0.total_cmp(b.0))?;
        (*best.0 > 0.0).then_some([best.1.0 as f64, best.1.1 as f64])
    }

    /// The displacement near `shift` that leaves least, and the shares with it.
    fn refine(&self, dark: &[Dark], shift: [f64; 2]) -> ([f64; 2], Shares) {
        let halo = self.halo(dark);
        let mut best = (shift, self.shares(dark, &halo, Some(shift)));
        let mut step = 0.5;
        while step > 0.05 {
            let [x, y] = best.0;
            let around = [[x - step, y], [x + step, y], [x, y - step], [x, y + step]];
            let found = around.map(|shift| (shift, self.shares(dark, &halo, Some(shift))));
            let least = found.into_iter().min_by(|a, b| a.1.left.total_cmp(&b.1.left));
            match least {
                Some(least) if least.1.left < best.1.left => best = least,
                _ => step /= 2.0,
            }
        }
        best
    }

    /// What is left of means over blocks, relative to what the halo says.
    fn relative_uncertainty(&self, dark: &[Dark], shares: &Shares, shift: Option<[f64; 2]>) -> f64 {
        let ghost = self.ghost(shift);
        let (width, height) = self.size_px;
        let columns = width.div_ceil(BLOCK_PX);
        let blocks = columns * height.div_ceil(BLOCK_PX);
        let mut sums = vec![(0.0_f64, 0.0_f64, 0_u32); blocks * self.shown.len()];
        for dark in dark {
            let model = luminance(Self::model(dark, shares, self.added(ghost.as_ref(), dark)));
            let pixel = dark.pixel as usize;
            let block = pixel / width / BLOCK_PX * columns + pixel % width / BLOCK_PX;
            let sum = &mut sums[dark.frame as usize * blocks + block];
            sum.0 += f64::from(luminance(dark.shown) - model);
            sum.1 += f64::from(model);
            sum.2 += 1;
        }
        let noise = self.channels as f64 * f64::from(self.variance);
        let (mut left, mut all) = (0.0, 0.0);
        for (residual, model, count) in sums {
            let (residual, model, noise) = (residual.powi(2), model.powi(2), noise * f64::from(count));
            // Blocks that noise rules say nothing.
            if model > 100.0 * noise {
                left += (residual - noise) / model;
                all += 1.0;
            }
        }
        if all < 1.0 {
            return 1.0;
        }
        (left / all).max(0.0).sqrt().max(BEST)
    }
}

impl Default for Normal {
    fn default() -> Self {
        Self {
            matrix: [[0.0; COLUMNS]; COLUMNS],
            right: [0.0; COLUMNS],
            square: 0.0,
            count: 0.0,
        }
    }
}

impl Normal {
    /// Adds to a row that is in it what the column of the ghost has of that.
    fn add_ghost(&mut self, row: &[f64; COLUMNS], ghost: f64, target: f64, weight: f64) {
        const GHOST: usize = WIDTHS.len();
        for (sum, value) in self.matrix[GHOST].iter_mut().zip(row).take(GHOST) {
            *sum += weight * ghost * value;
        }
        self.matrix[GHOST][GHOST] += weight * ghost * ghost;
        self.right[GHOST] += weight * ghost * target;
    }

    fn add(&mut self, row: &[f64; COLUMNS], target: f64, weight: f64) {
        for (i, a) in row.iter().enumerate() {
            for (j, b) in row.iter().enumerate().take(i + 1) {
                self.matrix[i][j] += weight * a * b;
            }
            self.right[i] += weight * a * target;
        }
        self.square += weight * target * target;
        self.count += 1.0;
    }

    /// The shares, none below 0: those that would be are left out, the worst first.
    fn solve(&self) -> Solved {
        let mut used: Vec<usize> = (0..COLUMNS).filter(|&i| self.matrix[i][i] > 0.0).collect();
        loop {
            let at = |i: usize, j: usize| self.matrix[i.max(j)][i.min(j)];
            let matrix = DMatrix::from_fn(used.len(), used.len(), |i, j| at(used[i], used[j]));
            let right = DVector::from_fn(used.len(), |i, _| self.right[used[i]]);
            let Some(inverse) = matrix.cholesky().map(|factor| factor.inverse()) else {
                used.pop();
                continue;
            };
            let found = &inverse * &right;
            let worst = (0..used.len())
                .filter(|&i| found[i] < 0.0)
                .min_by(|a, b| found[*a].total_cmp(&found[*b]));
            if let Some(worst) = worst {
                used.remove(worst);
                continue;
            }
            let mut shares = [0.0; COLUMNS];
            for (&column, share) in used.iter().zip(&found) {
                shares[column] = *share;
            }
            let left = (self.square - found.dot(&right)).max(0.0);
            let scale = (left / self.count.max(1.0)).max(1.0);
            let last = used.iter().position(|column| *column == COLUMNS - 1);
            let uncertainty = last.map_or(0.0, |last| (inverse[(last, last)] * scale).sqrt());
            return Solved {
                shares,
                uncertainty,
                left,
            };
        }
    }
}
