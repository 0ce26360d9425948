//! What an image that is not even makes of the uncertainty of its values.
//!
//! # Design
//! Slopes and second differences come from the neighbours of each cell, as far as they are beyond what noise makes of
//! them. They count as follows.
//!
//! - **Directions**: the slope of f over the outgoing directions times the uncertainty of the directions. The slope over
//!   the incident ones is taken to be as steep, which holds where f depends on the half vector.
//! - **Interpolation and blur**: light and pixels average f over the spot and over what bilinear interpolation takes in.
//!   Of a lobe that has the variance v along an axis where it is seen, of which the blur is V, the peak is lower than it
//!   should be by the factor √((v − V)/v) (a Gaussian lobe; for one that is wide it is the well-known half of second
//!   derivative times variance). How wide it is seen the second difference over the value tells,
//!   f″/f = −2 (1 − exp(−d²/2v)) over a distance d; so lobes count that are hardly wider than a pixel, where the second derivative
//!   alone would state too little. Where a pixel is wider than a cell, d is as wide: between the same pixels the image is
//!   straight. Both axes of the disk are taken for themselves, and what couples them is added.
//!
//! Curvature goes through zero on the flanks of a lobe and may lie between two cells: each cell takes the most of those
//! a pixel around it, and one farther where a neighbour is missing. Beside what was not measured a lobe may have its peak out of sight: what f rises or falls by on the
//! side that is seen, it may fall or rise by on the other. Where f rises towards what was not measured, all of that rise may be light that was
//! blurred there out of a lobe which no image shows, as beside one that is saturated.

use glam::{DVec2, DVec3};

use crate::assemble::resample::Resampling;
use crate::hemisphere::disk::Disk;
use crate::instrument::optics::View;

/// Squares of slopes count by what they have beyond so many times their variance by noise: two standard deviations, so that
/// noise hardly ever passes for them.
const CLEAR: f32 = 4.0;
/// The same of second differences, of which the most of nine cells counts.
const BENT: f32 = 9.0;
/// A lobe is one above what it stands on if the square of that is so many times its variance by noise.
const LOBE: f32 = 50.0;
/// A lobe counts as at least so much wider than the blur, as a share of its variance: what is narrower has no true width.
const NARROWEST: f32 = 0.02;
/// The same of a lobe that stands on a foot, which is hardly known.
const NARROW: f32 = 0.25;
/// So many times as far as its neighbours a lobe has come down to what it stands on, about.
const FOOT: usize = 4;
/// The share of a lobe's height that is lost from which on all of it is stated.
const MUCH: f32 = 0.3;
/// A pixel may be wider than so many cells by this.
const WHOLE: f32 = 0.2;

/// Axis and side of the neighbours of a cell.
const SIDES: [(usize, usize); 4] = [(0, 0), (0, 1), (1, 0), (1, 1)];

/// Angles from a cell to its neighbours, radians: left, right, above, below; `None` where there is none.
type Steps = [Option<f32>; 4];

/// f of a cell and its noise, sr⁻¹; `None` where it was not measured.
type Seen = Option<(f32, f32)>;

/// What is the same for all images.
pub(super) struct Shape {
    size: usize,
    channels: usize,
    steps: Vec<Steps>,
    /// Variance of the directions along each axis, radians².
    direction_variance: f32,
    /// How many cells a pixel is wide there along columns and rows.
    apart: Vec<[usize; 2]>,
    /// Variances of the blur of each cell along columns and rows, and their covariance, in cells².
    blur: Vec<[f32; 3]>,
}

/// A cell by its number, its column and its row.
#[derive(Clone, Copy)]
struct Cell {
    at: usize,
    x: usize,
    y: usize,
}

/// Room for the numbers of one image.
#[derive(Default)]
pub(super) struct ByShape {
    seen: Vec<Seen>,
    slope2: Vec<f32>,
    /// The uncertainty by what blur took, in sr⁻¹.
    blurred: Vec<f32>,
    /// The part of the total that directions make.
    pub(super) directed: Vec<f32>,
    pub(super) total: Vec<f32>,
}

impl Shape {
    /// Of images of `camera` on `disk`, resampled by `resampling`; light has `light_variance` along each axis, and directions
    /// are known to `direction_variance`, both in radians².
    pub(super) fn new(
        camera: &View,
        disk: Disk,
        resampling: &Resampling,
        channels: usize,
        light_variance: f64,
        direction_variance: f64,
    ) -> Self {
        let mut blur = vec![[0.0; 3]; disk.len()];
        for taps in &resampling.taps {
            let cell = taps.cell as usize;
            if let Some(found) = disk
                .direction(cell)
                .and_then(|w| blur_of(camera, disk, w, light_variance))
            {
                blur[cell] = found;
            }
        }
        Self {
            size: disk.size(),
            channels,
            steps: steps(disk),
            direction_variance: direction_variance as f32,
            // Of the variance of blur a pixel's is a quarter of the square of its width.
            apart: blur
                .iter()
                .map(|[columns, rows, _]| {
                    [columns, rows].map(|variance| ((2.0 * variance.sqrt() - WHOLE).ceil() as usize).max(1))
                })
                .collect(),
            blur,
        }
    }

    /// The standard uncertainties by shape of one channel of the image `f` (sr⁻¹, [cell, channel]), which has `noise`
    /// (k = 1) and whose light comes from an angle beside the incident direction of which `beside2` is the square (radians²):
    /// sr⁻¹, [cell], in `by`.
    pub(super) fn uncertainties(
        &self,
        f: &[f32],
        noise: &[f32],
        measured: &dyn Fn(usize) -> bool,
        channel: usize,
        beside2: f32,
        by: &mut ByShape,
    ) {
        let cells = self.size * self.size;
        for room in [&mut by.slope2, &mut by.blurred, &mut by.directed, &mut by.total] {
            room.clear();
            room.resize(cells, 0.0);
        }
        by.seen.clear();
        by.seen.extend((0..cells).map(|cell| {
            let place = cell * self.channels + channel;
            measured(cell).then(|| (f[place], noise[place]))
        }));
        for cell in self.cells() {
            if let Some(value) = by.seen[cell.at] {
                by.slope2[cell.at] = self.slope2(cell, value, &by.seen);
                by.blurred[cell.at] = self.blurred(cell, value, &by.seen);
            }
        }
        for cell in self.cells() {
            let Cell { at, x, y } = cell;
            if by.seen[at].is_none() {
                continue;
            }
            let most = |of: &[f32], reach: usize| {
                let around = |at: usize| at.saturating_sub(reach)..(at + reach + 1).min(self.size);
                around(y)
                    .map(|y| {
                        let row = &of[y * self.size..][around(x)];
                        row.iter().copied().fold(0.0, f32::max)
                    })
                    .fold(0.0, f32::max)
            };
            let [columns, rows] = self.apart[at];
            let is_within = SIDES.into_iter().all(|(axis, side)| {
                let beside = self.neighbour(cell, axis, side, 1);
                beside.is_some_and(|beside| by.seen[beside].is_some())
            });
            let reach = columns.max(rows) + usize::from(!is_within);
            let by_direction2 = by.slope2[at] * (self.direction_variance + beside2);
            by.directed[at] = by_direction2.sqrt();
            let blurred = most(&by.blurred, reach).max(self.unseen(cell, &by.seen));
            by.total[at] = hypot(by.directed[at], blurred);
        }
    }

    /// All cells, row by row.
    fn cells(&self) -> impl Iterator<Item = Cell> {
        let size = self.size;
        (0..size).flat_map(move |y| {
            (0..size).map(move |x| Cell {
                at: y * size + x,
                x,
                y,
            })
        })
    }

    /// The cell so many cells `apart` on one side (0 or 1) of `cell` along an axis (0 columns, 1 rows).
    fn neighbour(&self, cell: Cell, axis: usize, side: usize, apart: usize) -> Option<usize> {
        let (place, step) = [(cell.x, 1), (cell.y, self.size)][axis];
        if side == 0 {
            (place >= apart).then(|| cell.at - apart * step)
        } else {
            (place + apart < self.size).then(|| cell.at + apart * step)
        }
    }

    /// Square of the slope at `cell`, sr⁻²/rad².
    fn slope2(&self, cell: Cell, (value, noise): (f32, f32), seen: &[Seen]) -> f32 {
        (0..2)
            .map(|axis| {
                let side = |side: usize| {
                    let step = self.steps[cell.at][2 * axis + side]?;
                    Some((seen[self.neighbour(cell, axis, side, 1)?]?, step))
                };
                let (difference, noise2, width) = match (side(0), side(1)) {
                    (Some((low, before)), Some((high, after))) => {
                        (high.0 - low.0, low.1 * low.1 + high.1 * high.1, before + after)
                    }
                    // At an edge one side stands for both.
                    (Some((one, step)), None) | (None, Some((one, step))) => {
                        (one.0 - value, one.1 * one.1 + noise * noise, step)
                    }
                    (None, None) => return 0.0,
                };
                (difference * difference - CLEAR * noise2).max(0.0) / (width * width)
            })
            .sum()
    }

    /// The standard uncertainty by blur of the value of `cell`, which has `noise`, about, sr⁻¹.
    fn blurred(&self, cell: Cell, (value, noise): (f32, f32), seen: &[Seen]) -> f32 {
        let [columns, rows, both] = self.blur[cell.at];
        let beyond = |difference: f32, noise2: f32| (difference * difference - BENT * noise2).max(0.0).sqrt();
        let (mut factor, mut highest) = (1.0_f32, 0.0_f32);
        for (axis, variance) in [columns, rows].into_iter().enumerate() {
            let side = |side: usize, apart: usize| seen[self.neighbour(cell, axis, side, apart)?];
            let both_sides = |apart: usize| Some((side(0, apart)?, side(1, apart)?, apart));
            // At an edge one side stands for both.
            let one_side = |apart: usize| {
                let one = side(0, apart).or_else(|| side(1, apart))?;
                Some((one, one, apart))
            };
            let apart = || (1..=self.apart[cell.at][axis]).rev();
            let widest = apart()
                .find_map(both_sides)
                .or_else(|| apart().find_map(one_side));
            let Some((low, high, apart)) = widest else {
                continue;
            };
            let noise2 = low.1 * low.1 + high.1 * high.1 + 4.0 * noise * noise;
            let upwards = low.0 + high.0 - 2.0 * value;
            let bend = beyond(upwards, noise2);
            if bend > 0.0 {
                let peak = value.abs().max(low.0.abs()).max(high.0.abs());
                // What lies between lobes stands on nothing, nor does what noise makes.
                let foot = (upwards < 0.0)
                    .then(|| self.foot(cell, seen))
                    .filter(|foot| (peak - foot.0).powi(2) > LOBE * (noise * noise + foot.1 * foot.1))
                    .map_or(0.0, |(foot, _)| foot);
                let height = (peak - foot)
                    .max(bend / bend_most(apart as f32, variance))
                    .min(peak);
                highest = highest.max(height);
                factor *= 1.0 + lost(bend / height, apart as f32, variance);
            }
        }
        let corner = |across: usize, along: usize| {
            let [columns, rows] = self.apart[cell.at];
            let at = self.neighbour(cell, 0, across, columns)?;
            let x = if across == 0 {
                cell.x - columns
            } else {
                cell.x + columns
            };
            seen[self.neighbour(Cell { at, x, ..cell }, 1, along, rows)?]
        };
        let mut coupled = 0.0;
        if let (Some(a), Some(b), Some(c), Some(d)) = (corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1))
        {
            let noise2 = a.1 * a.1 + b.1 * b.1 + c.1 * c.1 + d.1 * d.1;
            let area = self.apart[cell.at][0] * self.apart[cell.at][1];
            coupled = both.abs() * beyond(a.0 + d.0 - b.0 - c.0, noise2) / (4.0 * area as f32);
        }
        let even = 3.0_f32.sqrt().recip();
        let stated = even + (1.0 - even) * ((factor - 1.0) / MUCH).min(1.0);
        stated * (highest * (factor - 1.0) + coupled)
    }

    /// What a lobe that was not measured may have added to the value of `cell`, sr⁻¹: what it rises by towards a side where nothing was.
    fn unseen(&self, cell: Cell, seen: &[Seen]) -> f32 {
        let Some((value, noise)) = seen[cell.at] else {
            return 0.0;
        };
        let side = |axis: usize, side: usize| seen[self.neighbour(cell, axis, side, 1)?];
        let rise = |axis: usize| match (side(axis, 0), side(axis, 1)) {
            (Some(one), None) | (None, Some(one)) if value > one.0 => {
                let noise2 = noise * noise + one.1 * one.1;
                ((value - one.0).powi(2) - BENT * noise2).max(0.0)
            }
            _ => 0.0,
        };
        rise(0).max(rise(1)).sqrt()
    }

    /// What a lobe at `cell` stands on, and its noise: the least of what is seen far from it in four directions, sr⁻¹; 0 if it is not seen
    /// so far.
    fn foot(&self, cell: Cell, seen: &[Seen]) -> (f32, f32) {
        let far = SIDES.into_iter().filter_map(|(axis, side)| {
            let apart = FOOT * self.apart[cell.at][axis];
            seen[self.neighbour(cell, axis, side, apart)?]
        });
        let least = far.min_by(|a, b| a.0.total_cmp(&b.0));
        least.filter(|(f, _)| *f > 0.0).unwrap_or_default()
    }
}

/// √(a² + b²) of numbers that are finite, or NaN: as C has it, without its care for those that are infinite.
pub(super) fn hypot(a: f32, b: f32) -> f32 {
    let [a, b] = [a, b].map(f64::from);
    (a * a + b * b).sqrt() as f32
}

/// What blur of `variance` has taken of a lobe along one axis, as a share of what is left of it; `bend` is its second
/// difference over the distance `apart`, over its value; in cells.
fn lost(bend: f32, apart: f32, variance: f32) -> f32 {
    // The second difference of a Gaussian of variance v at its peak is −2 (1 − exp(−d²/2v)) of its height.
    let seen = -0.5 * apart * apart / (1.0 - (0.5 * bend).min(0.999)).ln();
    let own = (seen - variance).max(NARROWEST * seen);
    (seen / own).sqrt() - 1.0
}

/// The most that a lobe on a foot bends by over the distance `apart`, over its height: where it seems to bend by more the foot is a
/// slope.
fn bend_most(apart: f32, variance: f32) -> f32 {
    let narrowest = variance / (1.0 - NARROW);
    2.0 * (1.0 - (-0.5 * apart * apart / narrowest).exp())
}

/// Variances of the blur around `w` along columns and rows of `disk`, and their covariance, in cells²; `None` where the
/// image has no place for it.
fn blur_of(camera: &View, disk: Disk, w: DVec3, light_variance: f64) -> Option<[f32; 3]> {
    /// Radians over which the disk is straight.
    const SMALL: f64 = 1e-4;
    let half = disk.size() as f64 / 2.0;
    // As `Disk::position`, beyond the horizon too.
    let place = |w: DVec3| half * w.truncate() / (1.0 + w.z).sqrt();
    let at = camera.pixel(w).ok()?;
    let along = |step: DVec2| {
        let (after, before) = (at + 0.5 * step, at - 0.5 * step);
        Some(place(camera.sight(after.x, after.y)?) - place(camera.sight(before.x, before.y)?))
    };
    let (a, b) = w.any_orthonormal_pair();
    let light = |t: DVec3| (place((w + SMALL * t).normalize()) - place(w)) / SMALL;
    let parts = [
        // A square pixel has 1/12, and interpolation between two adds 1/6.
        (along(DVec2::X)?, 0.25),
        (along(DVec2::Y)?, 0.25),
        (light(a), light_variance),
        (light(b), light_variance),
    ];
    let sum =
        |of: &dyn Fn(DVec2) -> f64| parts.iter().map(|(d, variance)| variance * of(*d)).sum::<f64>() as f32;
    Some([sum(&|d| d.x * d.x), sum(&|d| d.y * d.y), sum(&|d| d.x * d.y)])
}

/// Angles from each cell of the disk to its neighbours.
fn steps(disk: Disk) -> Vec<Steps> {
    let size = disk.size();
    let between = |a: usize, b: usize| Some(disk.direction(a)?.angle_between(disk.direction(b)?) as f32);
    (0..disk.len())
        .map(|cell| {
            let (x, y) = (cell % size, cell / size);
            [
                (x > 0).then(|| between(cell, cell - 1)).flatten(),
                (x + 1 < size).then(|| between(cell, cell + 1)).flatten(),
                (y > 0).then(|| between(cell, cell - size)).flatten(),
                (y + 1 < size).then(|| between(cell, cell + size)).flatten(),
            ]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_out_of_a_lobe_that_was_not_measured_is_in_the_uncertainty_beside_it() {
        const SIZE: usize = 9;
        let cells = SIZE * SIZE;
        let shape = Shape {
            size: SIZE,
            channels: 1,
            steps: vec![[Some(0.05); 4]; cells],
            direction_variance: 0.0,
            apart: vec![[1, 1]; cells],
            blur: vec![[0.25, 0.25, 0.0]; cells],
        };
        // Flat, but for what the lobe in the columns from 5 on, which is saturated, spreads.
        let spread = [0.0, 0.0, 0.0, 0.002, 0.017];
        let f: Vec<f32> = (0..cells)
            .map(|cell| 0.03 + spread.get(cell % SIZE).unwrap_or(&f32::NAN))
            .collect();
        let mut by = ByShape::default();
        shape.uncertainties(&f, &vec![5e-4; cells], &|cell| cell % SIZE < 5, 0, 0.0, &mut by);
        for cell in (0..cells).filter(|cell| cell % SIZE < 5) {
            let off = f[cell] - 0.03;
            assert!(
                off <= 2.0 * hypot(by.total[cell], 5e-4),
                "{cell}: {off} {}",
                by.total[cell]
            );
        }
        // Where nothing is beside it, it says nothing.
        assert!(by.total[SIZE] < 1e-3, "{}", by.total[SIZE]);
    }

    #[test]
    fn what_a_gaussian_lobe_has_lost_is_found_however_narrow_it_is() {
        for (variance, apart) in [(0.1_f32, 1.0_f32), (0.25, 1.0), (0.6, 2.0), (2.0, 3.0)] {
            for own in [0.05_f32, 0.2, 1.0, 5.0, 50.0] {
                let seen = own + variance;
                let bend = 2.0 * (1.0 - (-0.5 * apart * apart / seen).exp());
                let truth = (seen / own).sqrt() - 1.0;
                let found = lost(bend, apart, variance);
                assert!(
                    (found / truth - 1.0).abs() < 0.02,
                    "{variance} {own}: {found} {truth}"
                );
            }
        }
        // A wide lobe: half of second derivative times variance.
        assert!((lost(1e-3, 1.0, 0.25) / (0.5 * 1e-3 * 0.25) - 1.0).abs() < 0.01);
        // What is narrower than light and pixel could be any height.
        assert!(lost(2.0, 1.0, 0.25) > 5.0);
    }
}
