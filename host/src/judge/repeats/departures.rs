//! How each repeat departs from the others, by regions and as a whole.
//!
//! # Design
//! Over the pairs of directions that all repeats have, some 10⁵ spread evenly, the relative departure of repeat i from the mean m of all is a
//! mean x_i = Σ w·(f_i − m)/m / Σ w with w = m⁴/σ⁴, as comparisons of two have it: σ is that of all together, so that no repeat
//! weighs itself. Noise averages out; each other part of σ counts as the same all over a region; what repeats have in common cancels.
//! How the sample lay is a part too, by the slope along the azimuth.
//!
//! A repeat is an outlier if somewhere it departs from the mean of the others by more than [`CLEAR`] standard uncertainties of that
//! departure, and by more than σ of a single value, which says how far it may be from the truth. The farthest is named first, and
//! the rest is judged without it, as long as there are three.

use serde::Serialize;

use super::origins::{CLASSES, COMMON, NOISE, Origins, PLACEMENT, Parts, variance};
use super::scan::{Sample, scan};
use super::scatter::Places;
use crate::brdf::{Brdf, BrdfError};
use crate::hemisphere::judged::is_judged;
use crate::judge::compare::slopes;
use crate::judge::region::{ENOUGH, NEIGHBOURS, REGIONS, Region};

/// Pairs of directions that count, about.
const ASKED: usize = 200_000;
/// Standard uncertainties beyond which a repeat departs from the others.
const CLEAR: f64 = 4.0;
/// Fewest repeats of which one can be told to be off.
const FEWEST: usize = 3;

/// A relative difference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Departure {
    /// By how much it is brighter.
    pub relative: f64,
    /// Standard uncertainty (k = 1) of that, without what cancels.
    pub standard_uncertainty: f64,
    /// What of it is noise.
    pub noise: f64,
    /// Relative standard uncertainty (k = 1) that single values state.
    pub stated: f64,
}

/// A repeat that is none.
#[derive(Clone, Debug, Serialize)]
pub struct Outlier {
    /// Its number, from 0.
    pub number: usize,
    /// Where it departs farthest; `None` as a whole.
    pub region: Option<Region>,
    /// Channel, from 0.
    pub channel: usize,
    /// From the mean of the others.
    pub departure: Departure,
}

/// Sums over the samples of one channel of a region.
#[derive(Clone, Debug, Default)]
struct Sums {
    samples: u64,
    weights: f64,
    total: f64,
    /// Of each repeat.
    levels: Vec<f64>,
    noise: Vec<f64>,
    rest: Vec<[f64; CLASSES]>,
}

impl Sums {
    fn new(count: usize) -> Self {
        Self {
            levels: vec![0.0; count],
            noise: vec![0.0; count],
            rest: vec![[0.0; CLASSES]; count],
            ..Self::default()
        }
    }

    /// Adds a sample, whose f changes by `turned` sr⁻¹ by how uncertainly each repeat lay.
    fn add(&mut self, sample: &Sample, (parts, place): (&[Parts], usize), turned: &[f64]) {
        let per_m = sample.mean.powi(3) / sample.variance.powi(2);
        self.samples += 1;
        self.weights += per_m * sample.mean;
        self.total += per_m.abs() * sample.variance.sqrt();
        for &(number, f, sigma) in &sample.values {
            self.levels[number] += per_m * (f - sample.mean);
            let roots = &parts[number].roots[place];
            self.noise[number] += (per_m * sigma * roots[NOISE]).powi(2);
            for (class, sum) in self.rest[number].iter_mut().enumerate() {
                let mut amount = sigma * roots[class];
                if class == PLACEMENT {
                    amount = amount.hypot(turned[number]);
                }
                *sum += per_m.abs() * amount;
            }
        }
    }

    fn merge(&mut self, other: &Self) {
        self.samples += other.samples;
        self.weights += other.weights;
        self.total += other.total;
        for (number, rest) in self.rest.iter_mut().enumerate() {
            self.levels[number] += other.levels[number];
            self.noise[number] += other.noise[number];
            rest.iter_mut()
                .zip(other.rest[number])
                .for_each(|(sum, one)| *sum += one);
        }
    }

    /// Repeat `of` over the mean of those of `reference`; `None` of too few samples.
    fn against(&self, of: usize, reference: &[usize], origins: &Origins) -> Option<Departure> {
        if self.samples < ENOUGH || self.weights <= 0.0 {
            return None;
        }
        let share = 1.0 / reference.len() as f64;
        let factors: Vec<(usize, f64)> = (0..self.levels.len())
            .map(|number| {
                let own = f64::from(u8::from(number == of));
                (
                    number,
                    own - if reference.contains(&number) { share } else { 0.0 },
                )
            })
            .collect();
        let level: f64 = reference.iter().map(|number| share * self.levels[*number]).sum();
        // Levels are differences from the mean of all.
        let weights = self.weights + level;
        let mut room = vec![0.0; self.levels.len()];
        let noise: f64 = factors
            .iter()
            .map(|(number, factor)| factor * factor * self.noise[*number])
            .sum();
        let noise = NEIGHBOURS * noise;
        let rest: f64 = (0..CLASSES)
            .filter(|class| ![NOISE, COMMON].contains(class))
            .map(|class| {
                let amounts = factors
                    .iter()
                    .map(|(number, factor)| (*number, factor * self.rest[*number][class]));
                variance(&origins.difference[class], amounts, &mut room)
            })
            .sum();
        let relative: f64 = factors
            .iter()
            .map(|(number, factor)| factor * self.levels[*number])
            .sum();
        Some(Departure {
            relative: relative / weights,
            standard_uncertainty: (noise + rest).sqrt() / weights,
            noise: noise.sqrt() / weights,
            stated: self.total / self.weights,
        })
    }
}

/// How repeats depart from one another.
#[derive(Clone, Debug)]
pub(crate) struct Departures {
    origins: Origins,
    channels: usize,
    /// [region, channel].
    regions: Vec<Sums>,
    /// [channel].
    whole: Vec<Sums>,
    /// Pairs of directions that all have.
    pub(crate) pairs: u64,
}

impl Departures {
    /// Of all repeats, whose errors have these `parts` and `origins`.
    pub(crate) fn of(all: &[&Brdf], parts: &[Parts], origins: &Origins) -> Result<Self, BrdfError> {
        let first = all[0];
        let (count, channels, cells) = (all.len(), first.channels(), first.disk().len());
        let places = Places::of(first);
        let pairs = pairs(first);
        let turn_deg: Vec<f64> = all
            .iter()
            .map(|brdf| brdf.azimuth().standard_uncertainty_deg.unwrap_or(0.0))
            .collect();
        let is_turned = turn_deg.iter().any(|deg| *deg > 0.0);
        let directions: Vec<_> = pairs
            .iter()
            .filter(|_| is_turned)
            .filter_map(|&(index, cell)| Some((first.grid().direction(index), first.disk().direction(cell)?)))
            .collect();
        let slopes = slopes(first, &directions)?;
        let mut total = Self {
            origins: origins.clone(),
            channels,
            regions: vec![Sums::new(count); REGIONS * channels],
            whole: vec![Sums::new(count); channels],
            pairs: 0,
        };
        scan(
            all,
            &|chunk, rows| {
                let mut regions = vec![Sums::new(count); REGIONS * channels];
                let (mut sample, mut turned) = (Sample::default(), vec![0.0; count]);
                let range = first.chunk_range(chunk);
                let from = pairs.partition_point(|pair| pair.0 < range.start);
                let to = pairs.partition_point(|pair| pair.0 < range.end);
                for (number, &(index, cell)) in pairs.iter().enumerate().take(to).skip(from) {
                    let region = Places::region(first, index, cell);
                    for channel in 0..channels {
                        sample.read(rows, (index - range.start) * cells + cell, channels, channel);
                        if region == REGIONS || sample.count() < count {
                            break;
                        }
                        if let Some(slope) = slopes.get(number) {
                            let each = turned.iter_mut().zip(&turn_deg);
                            each.for_each(|(turned, deg)| *turned = slope[channel] * deg);
                        }
                        regions[region * channels + channel].add(
                            &sample,
                            (parts, places.place(index, cell)),
                            &turned,
                        );
                    }
                }
                Ok(regions)
            },
            &mut |_, found| {
                for (place, sums) in found.iter().enumerate() {
                    total.regions[place].merge(sums);
                    total.whole[place % channels].merge(sums);
                }
                Ok(())
            },
        )?;
        total.pairs = total.whole[0].samples;
        Ok(total)
    }

    /// Repeat `of` as a whole against the one of the number `reference`, or against the mean of all, by channel; `None` of too few samples.
    pub(crate) fn against(&self, of: usize, reference: Option<usize>) -> Vec<Option<Departure>> {
        let reference = match reference {
            Some(reference) => vec![reference],
            None => (0..self.whole[0].levels.len()).collect(),
        };
        let whole = self.whole.iter();
        whole
            .map(|sums| sums.against(of, &reference, &self.origins))
            .collect()
    }

    /// By channel of each region, and of all beyond them as of the whole: the relative variance of one repeat by how they differ as a whole
    /// there; 0 of too few samples.
    pub(crate) fn level_variances(&self) -> Vec<Vec<f64>> {
        let of = |sums: &Sums| {
            if sums.samples < ENOUGH || sums.weights <= 0.0 {
                return 0.0;
            }
            let squares: f64 = sums
                .levels
                .iter()
                .map(|level| (level / sums.weights).powi(2))
                .sum();
            squares / (sums.levels.len() - 1).max(1) as f64
        };
        let rows = self.regions.chunks(self.channels);
        rows.chain([self.whole.as_slice()])
            .map(|sums| sums.iter().map(of).collect())
            .collect()
    }

    /// Repeats that are none among those of `among`, the farthest first.
    pub(crate) fn outliers(&self, among: &[usize]) -> Vec<Outlier> {
        let (mut left, mut found) = (among.to_vec(), Vec::new());
        while left.len() >= FEWEST {
            let Some(farthest) = self.farthest(&left) else {
                break;
            };
            left.retain(|number| *number != farthest.number);
            found.push(farthest);
        }
        found
    }

    /// The one of `left` that departs farthest from the others by its uncertainty, if that is an outlier.
    fn farthest(&self, left: &[usize]) -> Option<Outlier> {
        let mut farthest: Option<(f64, Outlier)> = None;
        let regions = self
            .regions
            .iter()
            .enumerate()
            .map(|(place, sums)| (Some(place / self.channels), place, sums));
        let whole = self
            .whole
            .iter()
            .enumerate()
            .map(|(channel, sums)| (None, channel, sums));
        for (region, place, sums) in whole.chain(regions) {
            for &number in left {
                let others: Vec<usize> = left.iter().copied().filter(|other| *other != number).collect();
                let Some(departure) = sums.against(number, &others, &self.origins) else {
                    continue;
                };
                let size = departure.relative.abs();
                let by = size / departure.standard_uncertainty;
                let is_clear = size > CLEAR * departure.standard_uncertainty && size > departure.stated;
                if is_clear && farthest.as_ref().is_none_or(|(most, _)| by > *most) {
                    let outlier = Outlier {
                        number,
                        region: region.map(Region::numbered),
                        channel: place % self.channels,
                        departure,
                    };
                    farthest = Some((by, outlier));
                }
            }
        }
        farthest.map(|(_, outlier)| outlier)
    }
}

/// Judged pairs of an incident direction and a cell, by a fixed stride.
fn pairs(brdf: &Brdf) -> Vec<(usize, usize)> {
    let cells: Vec<usize> = (0..brdf.disk().len())
        .filter(|cell| brdf.disk().direction(*cell).is_some_and(is_judged))
        .collect();
    let lit: Vec<usize> = (0..brdf.grid().len())
        .filter(|index| is_judged(brdf.grid().direction(*index)))
        .collect();
    // Odd, so that it does not stay in step with rows of an even number.
    let stride = (lit.len() * cells.len()).div_ceil(ASKED) | 1;
    let all = lit
        .iter()
        .flat_map(|index| cells.iter().map(|cell| (*index, *cell)));
    all.step_by(stride).collect()
}
