//! How repeats scatter, against what they state.
//!
//! # Design
//! Of each pair of directions and channel the variance s² by which repeats scatter is taken over the mean of their stated σ²: so no bright
//! sample drowns the others. These quotients are averaged, weighted by their degrees of freedom, over samples whose σ has much the
//! same causes: those of a region and channel with f within a factor of two and σ/f within one of √2. What noise, and whatever else
//! repeats may differ by, have stated of σ² is averaged likewise. The square root of observed over stated is the Birge ratio
//! (Birge, Phys. Rev. 40, 207, 1932).
//!
//! An excess is clear beyond [`CLEAR`] standard deviations of what chance makes: noise has as many degrees of freedom as there are
//! samples, over [`NEIGHBOURS`], everything else those of the repeats alone.

use std::collections::BTreeMap;

use serde::Serialize;

use super::origins::{CLASSES, COMMON, NOISE, Origins, Parts, place_of};
use super::scan::{Sample, angles_deg, scan};
use crate::brdf::Brdf;
use crate::hemisphere::judged::is_judged;
use crate::judge::region::{ENOUGH, NEIGHBOURS, REGIONS, Region};
use crate::store::StoreError;

/// Standard deviations beyond which scatter is more than stated.
const CLEAR: f64 = 3.0;
/// Of a sample whose f is not above 0.
const DARK: i16 = i16::MIN;

/// Sums over samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Tally {
    samples: u64,
    freedom: f64,
    /// Σ of variances over σ², times degrees of freedom: observed, by noise, and by what else repeats may differ by.
    observed: f64,
    noise: f64,
    others: f64,
    /// Σ ln σ/f, of so many.
    log_relative: f64,
    positive: u64,
    /// Σ f.
    values: f64,
}

impl Tally {
    fn merge(&mut self, other: &Self) {
        self.samples += other.samples;
        self.freedom += other.freedom;
        self.observed += other.observed;
        self.noise += other.noise;
        self.others += other.others;
        self.log_relative += other.log_relative;
        self.positive += other.positive;
        self.values += other.values;
    }

    /// Observed variance over σ²; `None` of too few samples.
    pub(crate) fn observed(&self) -> Option<f64> {
        (self.samples >= ENOUGH).then(|| self.observed / self.freedom)
    }

    /// By how much of σ² repeats scatter beyond all that they state, if that is clear; else 0.
    pub(crate) fn excess(&self) -> f64 {
        let Some(observed) = self.observed() else {
            return 0.0;
        };
        let (noise, others) = (self.noise / self.freedom, self.others / self.freedom);
        let repeats = self.freedom / self.samples as f64;
        let chance = 2.0 * noise * noise * NEIGHBOURS / self.freedom + 2.0 * others * others / repeats;
        let excess = observed - noise - others;
        if excess > CLEAR * chance.sqrt() {
            excess
        } else {
            0.0
        }
    }
}

/// How repeats scatter in one channel of a region. Uncertainties are relative, geometric means over the samples.
#[derive(Clone, Debug, Serialize)]
pub struct Scatter {
    /// Which.
    #[serde(flatten)]
    pub region: Region,
    /// Which, from 0.
    pub channel: usize,
    /// Samples that at least two repeats have.
    pub samples: u64,
    /// Mean of f, sr⁻¹.
    pub mean: f64,
    /// Stated standard uncertainty (k = 1) of one value over f; `None` if no f is above 0.
    pub standard_uncertainty: Option<f64>,
    /// What of it is noise.
    pub noise: Option<f64>,
    /// Standard deviation of one value by how repeats scatter.
    pub scatter: Option<f64>,
    /// That over noise; `None` where nothing is stated as noise.
    pub ratio: Option<f64>,
    /// Whether they scatter by more than all that they state as their own, beyond chance.
    pub is_larger: bool,
}

/// Where a sample counts: region (REGIONS beyond all), channel, powers of two of f and of √2 of σ/f.
type Key = (usize, usize, i16, i16);

/// The sums of all samples by what their σ is made of.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tallies {
    bins: BTreeMap<Key, Tally>,
    regions: BTreeMap<(usize, usize), Tally>,
    /// Samples by how many repeats have them, from one on.
    pub(crate) by_count: Vec<u64>,
}

fn key(region: usize, channel: usize, sample: &Sample) -> Key {
    let sigma = sample.variance.sqrt();
    if sample.mean > 0.0 {
        let level = sample.mean.log2().floor();
        (
            region,
            channel,
            level as i16,
            (2.0 * (sigma / sample.mean).log2()).floor() as i16,
        )
    } else {
        (region, channel, DARK, sigma.log2().floor() as i16)
    }
}

impl Tallies {
    /// Of all repeats, whose errors have these `parts` and `origins`.
    pub(crate) fn of(all: &[&Brdf], parts: &[Parts], origins: &Origins) -> Result<Self, StoreError> {
        let places = Places::of(all[0]);
        let channels = all[0].channels();
        let mut total = Self {
            by_count: vec![0; all.len()],
            ..Self::default()
        };
        scan(
            all,
            &|chunk, rows| {
                let mut found = Self {
                    by_count: vec![0; all.len()],
                    ..Self::default()
                };
                let (mut sample, mut sums) = (Sample::default(), vec![0.0; all.len()]);
                for (row, index) in all[0].chunk_range(chunk).enumerate() {
                    for &cell in &places.cells {
                        let pair = row * all[0].disk().len() + cell;
                        for channel in 0..channels {
                            if !sample.read(rows, pair, channels, channel) {
                                break;
                            }
                            found.by_count[sample.count() - 1] += u64::from(channel == 0);
                            if sample.count() > 1 && sample.variance > 0.0 {
                                let (place, region) =
                                    (places.place(index, cell), Places::region(all[0], index, cell));
                                found.add(
                                    key(region, channel, &sample),
                                    &sample,
                                    (parts, place, origins),
                                    &mut sums,
                                );
                            }
                        }
                    }
                }
                Ok(found)
            },
            &mut |_, found| {
                total.merge(&found);
                Ok(())
            },
        )?;
        for ((region, channel, ..), tally) in &total.bins {
            total.regions.entry((*region, *channel)).or_default().merge(tally);
        }
        Ok(total)
    }

    fn add(
        &mut self,
        key: Key,
        sample: &Sample,
        (parts, place, origins): (&[Parts], usize, &Origins),
        sums: &mut [f64],
    ) {
        let freedom = (sample.count() - 1) as f64;
        let mut expected = |class| {
            sample.expected((parts, place, class), &origins.difference[class], sums) / sample.variance
        };
        let noise = expected(NOISE);
        let others: f64 = (0..CLASSES)
            .filter(|class| ![NOISE, COMMON].contains(class))
            .map(&mut expected)
            .sum();
        let positive = sample.mean > 0.0;
        self.bins.entry(key).or_default().merge(&Tally {
            samples: 1,
            freedom,
            observed: freedom * sample.scatter() / sample.variance,
            noise: freedom * noise,
            others: freedom * others,
            log_relative: if positive {
                0.5 * sample.variance.ln() - sample.mean.ln()
            } else {
                0.0
            },
            positive: u64::from(positive),
            values: sample.mean,
        });
    }

    fn merge(&mut self, other: &Self) {
        for (sum, one) in self.by_count.iter_mut().zip(&other.by_count) {
            *sum += one;
        }
        for (key, tally) in &other.bins {
            self.bins.entry(*key).or_default().merge(tally);
        }
    }

    /// What of σ² is seen to scatter at a sample like this one, and how much more than is stated: parts of σ².
    pub(crate) fn at(&self, region: usize, channel: usize, sample: &Sample) -> (f64, f64) {
        let none = Tally::default();
        let bin = self.bins.get(&key(region, channel, sample)).unwrap_or(&none);
        match bin.observed() {
            Some(observed) => (observed, bin.excess()),
            // Few samples show nothing: no scatter that a mean could lessen, and as much excess as the region has.
            None => (
                0.0,
                self.regions.get(&(region, channel)).unwrap_or(&none).excess(),
            ),
        }
    }

    /// All regions that have enough samples.
    pub(crate) fn table(&self) -> Vec<Scatter> {
        let judged = self.regions.iter().filter(|((region, _), _)| *region < REGIONS);
        judged
            .filter_map(|(&(region, channel), tally)| {
                let observed = tally.observed()?;
                let noise = tally.noise / tally.freedom;
                let relative =
                    (tally.positive > 0).then(|| (tally.log_relative / tally.positive as f64).exp());
                Some(Scatter {
                    region: Region::numbered(region),
                    channel,
                    samples: tally.samples,
                    mean: tally.values / tally.samples as f64,
                    standard_uncertainty: relative,
                    noise: relative.map(|relative| relative * noise.sqrt()),
                    scatter: relative.map(|relative| relative * observed.sqrt()),
                    ratio: (noise > 0.0).then(|| (observed / noise).sqrt()),
                    is_larger: tally.excess() > 0.0,
                })
            })
            .collect()
    }
}

/// Where the pairs of directions of a file belong.
pub(crate) struct Places {
    incident_deg: Vec<f64>,
    cells_deg: Vec<Option<f64>>,
    /// Cells above the horizon.
    pub(crate) cells: Vec<usize>,
}

impl Places {
    /// Those of `brdf`.
    pub(crate) fn of(brdf: &Brdf) -> Self {
        let (incident_deg, cells_deg) = angles_deg(brdf);
        let cells = (0..cells_deg.len())
            .filter(|cell| cells_deg[*cell].is_some())
            .collect();
        Self {
            incident_deg,
            cells_deg,
            cells,
        }
    }

    /// The place in [`Parts`] of an incident direction and a cell.
    pub(crate) fn place(&self, index: usize, cell: usize) -> usize {
        place_of(
            self.incident_deg[index],
            self.cells_deg[cell].unwrap_or(f64::INFINITY),
        )
    }

    /// The number of the region of an incident direction and a cell; [`REGIONS`] beyond all.
    pub(crate) fn region(brdf: &Brdf, index: usize, cell: usize) -> usize {
        let wi = brdf.grid().direction(index);
        match brdf.disk().direction(cell) {
            Some(wo) if is_judged(wi) && is_judged(wo) => Region::number_of(wi, wo),
            _ => REGIONS,
        }
    }
}
