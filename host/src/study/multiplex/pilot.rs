//! The pilot capture that the choice rests on.
//!
//! # Design
//! Two things decide how uncertain a value is: its own signal x and, in multiplexed light, the sum of x over its block.
//!
//! - About 48 *single* exposures, spread over the hemisphere, give x. A pixel that stands out of its noise counts by
//!   itself. The others hold little but noise; they share the mean f of all that are as far from the mirror direction.
//! - A few *blocks* of each order give the sums S, with all their cells lit at once, and with some of their coded
//!   exposures y the longest exposure time. A single saturated exposure spoils a pixel in all cells of its block, so what
//!   counts is the brightest of all n. It is taken as S/2 + d, but no more than S, with d the root mean square of 2y − S:
//!   for equal cells d is x (the truth is S/2 + x/2), for one cell that outshines all others S/2 + d is S, as it is, and
//!   in between y scatters about S/2 with d/2, so that this is two standard deviations.
//!
//! All signals are rates in electrons per second.

use super::choose::MultiplexError;
use crate::capture::pilot::{PILOT_CLIPPED, PILOT_TARGET, TestExposures, spread};
use crate::capture::{Captured, Instrument};
use crate::hemisphere::direction::angle_between;
use crate::hemisphere::judged::is_judged;
use crate::instrument::optics::{DirectionMap, View};
use crate::instrument::rig::Rig;
use crate::plan::light::cells::{Blocks, union};
use crate::plan::pattern::{LitSet, PatternMaker};
use crate::plan::{Directions, Request};

/// Cells that are lit for each order to learn the sums: blocks are taken until there are about so many …
const CELLS: usize = 512;
/// … but no fewer and no more blocks than these.
const BLOCKS: (usize, usize) = (2, 16);
/// Coded exposures that are taken for each order, at least; each block has as many.
const CODED: usize = 8;
/// Coded exposures whose numbers are this far apart have little in common; it shares no factor with any order.
const SCATTER: usize = 97;
/// A pixel stands out when its signal is this many standard uncertainties.
const STANDS_OUT: f64 = 5.0;
/// Degrees of a bin of the angle from the mirror direction in which faint pixels share a mean.
const BIN_DEG: f64 = 5.0;

/// One value: a pixel (and channel) of one single exposure.
#[derive(Clone, Copy, Debug)]
pub(super) struct Value {
    /// Its signal in e⁻/s.
    pub(super) rate: f64,
    /// Index in a frame.
    pub(super) pixel: usize,
    /// Angle between outgoing and mirror direction in degrees.
    pub(super) from_mirror_deg: f64,
}

/// What the pilot captured of single exposures.
pub(super) struct Singles {
    /// Incident directions that can be lit.
    pub(super) cells: Vec<LitSet>,
    /// Indices in a frame of values with θ ≤ 80°.
    pub(super) pixels: Vec<usize>,
    /// Values with θ ≤ 80° both ways.
    pub(super) values: Vec<Value>,
    /// Longest exposure in s that does not saturate.
    pub(super) longest_s: f64,
}

/// What the pilot captured of blocks.
pub(super) struct Sums {
    pub(super) blocks: Blocks,
    /// For some blocks the sum of e⁻/s over their cells, [block][value of a frame], and the number of their cells.
    pub(super) rates: Vec<(Vec<f64>, usize)>,
    /// Longest exposure in s of coded exposures that does not saturate.
    pub(super) longest_s: f64,
}

/// Electrons of light per second; NaN where saturated.
fn rates(rig: &Rig, shot: &Captured, exposure_s: f64) -> Vec<f64> {
    let of = |dn: &u16| {
        if *dn < rig.saturation_dn() {
            rig.light_e_per_s(*dn, exposure_s)
        } else {
            f64::NAN
        }
    };
    shot.dn.iter().map(of).collect()
}

impl Singles {
    pub(super) fn take(
        rig: &Rig,
        request: &Request,
        instrument: &mut Instrument,
    ) -> Result<Self, MultiplexError> {
        let directions = Directions::new(rig, &request.grid)?;
        let maker = PatternMaker::new(
            View::projector(rig),
            request.spot_deg(rig),
            rig.projector.irradiance,
        );
        let (indices, cells): (Vec<usize>, Vec<LitSet>) = directions
            .measurable()
            .filter_map(|index| Some((index, maker.lit_set(directions.grid.direction(index)).ok()?)))
            .unzip();
        let chosen: Vec<&LitSet> = spread(&directions, &indices)
            .into_iter()
            .map(|at| &cells[at])
            .collect();
        let patterns: Vec<Vec<u32>> = chosen.iter().map(|lit| lit.pixels.clone()).collect();
        let tests = TestExposures::take(rig, &patterns, instrument)?;

        let channels = rig.channels();
        let camera = DirectionMap::of(&View::camera(rig));
        let judged: Vec<(usize, glam::DVec3)> = camera
            .measurable()
            .filter(|(_, wo, _)| is_judged(*wo))
            .map(|(pixel, wo, _)| (pixel, wo))
            .collect();
        let mut values = Vec::new();
        let mut means = vec![Mean::default(); (180.0 / BIN_DEG) as usize * channels];
        let mut faint = Vec::new();
        for (lit, shot) in chosen.iter().zip(&tests.shots) {
            let rates = rates(rig, shot, tests.exposure_s);
            let mirror = glam::DVec3::new(-lit.centroid.x, -lit.centroid.y, lit.centroid.z);
            for &(at, wo) in &judged {
                let from_mirror_deg = angle_between(wo, mirror).to_degrees();
                for channel in 0..channels {
                    let pixel = at * channels + channel;
                    let rate = rates[pixel];
                    if rate.is_nan() {
                        continue;
                    }
                    let signal_e = (rate * tests.exposure_s).max(0.0);
                    let variance =
                        (rig.dark_variance_e2(tests.exposure_s) + signal_e) / tests.exposure_s.powi(2);
                    if rate < STANDS_OUT * variance.sqrt() {
                        let bin = (from_mirror_deg / BIN_DEG) as usize * channels + channel;
                        means[bin].add(rate, variance, lit.irradiance);
                        faint.push((values.len(), bin, lit.irradiance));
                    }
                    values.push(Value {
                        rate,
                        pixel,
                        from_mirror_deg,
                    });
                }
            }
        }
        for (value, bin, irradiance) in faint {
            values[value].rate = means[bin].f() * irradiance;
        }
        Ok(Self {
            cells,
            pixels: judged
                .iter()
                .flat_map(|(at, _)| at * channels..(at + 1) * channels)
                .collect(),
            values,
            longest_s: tests.longest_s,
        })
    }
}

/// Mean of f, in e⁻/s per irradiance, of faint pixels.
#[derive(Clone, Copy, Default)]
struct Mean {
    rate: f64,
    variance: f64,
    irradiance: f64,
}

impl Mean {
    fn add(&mut self, rate: f64, variance: f64, irradiance: f64) {
        self.rate += rate;
        self.variance += variance;
        self.irradiance += irradiance;
    }

    /// Never below its own uncertainty: no signal is not a signal of 0.
    fn f(&self) -> f64 {
        self.rate.max(self.variance.sqrt()) / self.irradiance
    }
}

impl Sums {
    pub(super) fn take(
        rig: &Rig,
        singles: &Singles,
        blocks: Blocks,
        instrument: &mut Instrument,
    ) -> Result<Self, MultiplexError> {
        let largest = blocks.cells(0).count();
        let some = (CELLS / largest).clamp(BLOCKS.0, BLOCKS.1).min(blocks.count());
        let each = CODED.div_ceil(some);
        let (mut whole, mut coded, mut counts) = (Vec::new(), Vec::new(), Vec::new());
        for turn in 0..some {
            let block = turn * blocks.count() / some;
            let sets: Vec<&LitSet> = blocks.cells(block).map(|cell| &singles.cells[cell]).collect();
            let code = blocks.code(block);
            for draw in turn * each..(turn + 1) * each {
                coded.push(union(code, draw * SCATTER % code.order(), &sets));
            }
            whole.push(sets.iter().flat_map(|set| set.pixels.iter().copied()).collect());
            counts.push(sets.len());
        }
        let whole = taken(rig, &whole, instrument)?;
        let coded = taken(rig, &coded, instrument)?;
        let mut brightest: Vec<f64> = Vec::new();
        for (sums, coded) in whole.iter().zip(coded.chunks(each)) {
            brightest.extend(singles.pixels.iter().map(|&pixel| {
                let sum = sums[pixel];
                let squares: f64 = coded.iter().map(|y| (2.0 * y[pixel] - sum).powi(2)).sum();
                sum / 2.0 + (squares / each as f64).sqrt().min(sum / 2.0)
            }));
        }
        Ok(Self {
            blocks,
            rates: whole.into_iter().zip(counts).collect(),
            longest_s: longest_s(rig, brightest),
        })
    }
}

/// Exposures of `patterns` (lit pixels) in e⁻/s, [pattern][value of a frame].
fn taken(
    rig: &Rig,
    patterns: &[Vec<u32>],
    instrument: &mut Instrument,
) -> Result<Vec<Vec<f64>>, MultiplexError> {
    let tests = TestExposures::take(rig, patterns, instrument)?;
    let rates = tests.shots.iter().map(|shot| rates(rig, shot, tests.exposure_s));
    Ok(rates.collect())
}

/// Exposure time in s at which all but a few of the pixels with the `brightest` e⁻/s nearly fill the range.
fn longest_s(rig: &Rig, mut brightest: Vec<f64>) -> f64 {
    if brightest.is_empty() {
        return rig.camera.exposure_s; // nothing to go by
    }
    let rank = ((brightest.len() as f64 * (1.0 - PILOT_CLIPPED)) as usize).min(brightest.len() - 1);
    // NaN, a pixel that saturated already, sorts last.
    let (_, bright, _) = brightest.select_nth_unstable_by(rank, f64::total_cmp);
    PILOT_TARGET * rig.camera.full_well_e / (bright.max(1e-6) + rig.camera.dark_current_e_per_s)
}
