//! The mean of repeated measurements of one sample.
//!
//! # Design
//! Each pair of directions gets the plain mean of what those repeats say that measured it. Weights by σ would be less noisy where repeats
//! are unequally so; but σ goes with the measured value, so that values that are low by chance would weigh more, in lobes most, and a σ
//! that is wrong would draw the mean to itself. What was filled in has no part: `fill` fills the mean again. Where two or more have a
//! value, its origin is *merged*, where one has, that of the one; how many they are is not stored, only counted
//! (attribute `combined`).
//!
//! The variance of the mean is the sum over parts of σ of what each part has in common (`judge/repeats/origins`). The budget that says
//! which part is how large is a mean over regions, though, and a sample in a lobe has less noise among its causes than its
//! neighbours. So how repeats really scatter there bounds what averaging takes away: with the share q of σ² that is seen to
//! scatter, no less than 1 − q·(1 − 1/n) of it is left of n repeats. Where they scatter by more than they state, the excess over n is
//! added; it counts as one by directions, because it may be the same all over a region (`judge/repeats/scatter`). The part of it by which
//! whole regions differ from repeat to repeat grows by Student's factor for so few values (ISO/IEC Guide 98-3:2008, G.3).
//!
//! Time and names of files have no part in what is written.

mod attributes;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use half::f16;
use serde::Serialize;

use super::like::{Own, finish, is_same_place, writer_like};
use crate::base::blame::Blame;
use crate::base::progress::Progress;
use crate::base::student::quantile_95;
use crate::brdf::budget::{BudgetSums, Shared};
use crate::brdf::{BANDS_DEG, Brdf, BrdfError, CAUSES};
use crate::instrument::optics::Unmeasurable;
use crate::judge::repeats::origins::{CALIBRATION, CLASS_OF, CLASSES, PLACEMENT, PLACES, variance};
use crate::judge::repeats::scan::{Sample, scan};
use crate::judge::repeats::scatter::Places;
use crate::judge::repeats::{Repeat, Repeats, check_alike};
use crate::store::provenance::Provenance;
use crate::store::{BrdfRows, LEAST_SIGMA, StoreError, USELESS_SIGMA};

/// The cause that an excess of scatter counts as.
const EXCESS: usize = 6;
const _: () = assert!(CLASS_OF[EXCESS] == PLACEMENT, "directions");
/// The cause of what no budget explains.
const UNEXPLAINED: usize = 4;

/// Why there is no mean.
#[derive(Debug, thiserror::Error)]
pub enum CombineError {
    /// A file, or two that do not go together.
    #[error(transparent)]
    Brdf(#[from] BrdfError),
    /// A store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The result cannot be one of the files that are read.
    #[error("{path}: expected another file than those that are read, found one of them")]
    Itself {
        /// The result.
        path: String,
    },
    /// One is not as the others.
    #[error(
        "{name}: expected f as in the other {others} within what all state, found it {found}; --without {name} leaves it out, \
         --keep-outliers takes it and makes σ as much larger"
    )]
    Outlier {
        /// As it was named.
        name: String,
        /// How many others there are.
        others: usize,
        /// How far it is off, and where.
        found: String,
    },
}

impl Blame for CombineError {
    fn is_input(&self) -> bool {
        match self {
            Self::Brdf(error) => error.is_input(),
            Self::Store(error) => error.is_input(),
            Self::Itself { .. } | Self::Outlier { .. } => true,
        }
    }
}

/// What was combined.
#[derive(Clone, Debug, Serialize)]
pub struct Combined {
    /// The result.
    pub out: PathBuf,
    /// How the repeats agree.
    pub repeats: Repeats,
}

/// Writes the mean of at least two `repeats` to `out`. An outlier among three and more is refused, unless it is to be kept.
///
/// # Errors
/// [`CombineError`]; the files that are read stay as they are.
///
/// # Panics
/// Without a repeat.
pub fn combine(
    repeats: &[Repeat],
    out: &Path,
    keeps_outliers: bool,
    progress: &dyn Progress,
) -> Result<Combined, CombineError> {
    if repeats
        .iter()
        .any(|repeat| is_same_place(repeat.brdf.path(), out))
    {
        return Err(CombineError::Itself {
            path: out.display().to_string(),
        });
    }
    check_alike(repeats)?;
    let mut found = Repeats::of(repeats)?;
    if let Some(outlier) = found.outliers.first() {
        let named: Vec<String> = found
            .outliers
            .iter()
            .map(|outlier| format!("{} is {}", repeats[outlier.number].name, found.told(outlier)))
            .collect();
        if !keeps_outliers {
            return Err(CombineError::Outlier {
                name: repeats[outlier.number].name.clone(),
                others: repeats.len() - 1,
                found: found.told(outlier),
            });
        }
        found
            .warnings
            .push(format!("outliers: kept, {}", named.join("; ")));
    }
    let all: Vec<&Brdf> = repeats.iter().map(|repeat| &repeat.brdf).collect();
    write(&all, &found, out, progress)?;
    Ok(Combined {
        out: out.to_owned(),
        repeats: found,
    })
}

/// Writes the mean of `all` to `out`.
fn write(all: &[&Brdf], found: &Repeats, out: &Path, progress: &dyn Progress) -> Result<(), CombineError> {
    let first = all[0];
    let open = |reasons: &dyn Fn(&Brdf) -> Option<Unmeasurable>| {
        // Where one reaches, all do.
        all.iter()
            .map(|brdf| reasons(brdf))
            .min_by_key(Option::is_some)
            .flatten()
    };
    let incident: Vec<_> = (0..first.grid().len())
        .map(|index| open(&|brdf| brdf.incident_reason(index)))
        .collect();
    let outgoing: Vec<_> = (0..first.disk().len())
        .map(|cell| open(&|brdf| brdf.outgoing_reason(cell)))
        .collect();
    let pixel_sr: Vec<f64> = (0..first.disk().len())
        .map(|cell| {
            let known = all.iter().map(|brdf| brdf.pixel_sr(cell));
            known.into_iter().find(|sr| !sr.is_nan()).unwrap_or(f64::NAN)
        })
        .collect();
    let own = Own {
        grid: first.grid(),
        incident: &incident,
        outgoing: &outgoing,
        pixel_sr: &pixel_sr,
        facts: attributes::of(all, found)?,
    };
    let writer = writer_like(first, own, out)?;
    let mean = Mean {
        first,
        found,
        places: Places::of(first),
        causes: causes(found),
    };
    let mut budget = BudgetSums::default();
    progress.begin("combine", first.chunks(), "chunks");
    scan(all, &|chunk, rows| Ok(mean.chunk(chunk, rows)), &mut |chunk,
                                                                (
        rows,
        sums,
    ): (
        Option<BrdfRows>,
        BudgetSums,
    )| {
        if let Some(rows) = rows {
            writer.write_chunk(chunk, &rows)?;
        }
        budget.merge(&sums);
        progress.reach(chunk + 1);
        Ok(())
    })?;
    progress.end();
    let is_known = all.iter().any(|brdf| !brdf.budget().is_empty());
    for array in BudgetSums::arrays(is_known.then_some(&budget)) {
        writer.rewrite(&array)?;
    }
    finish(writer)?;
    Ok(())
}

/// Of each place, the share of each cause in its class.
fn causes(found: &Repeats) -> [[f64; CAUSES.len()]; PLACES] {
    std::array::from_fn(|place| {
        let mut shares = [0.0; CAUSES.len()];
        for parts in &found.parts {
            for (sum, share) in shares.iter_mut().zip(parts.causes[place].iter().flatten()) {
                *sum += share;
            }
        }
        let mut classes = [0.0; CLASSES];
        for (class, share) in CLASS_OF.iter().zip(shares) {
            classes[*class] += share;
        }
        for (class, share) in CLASS_OF.iter().zip(&mut shares) {
            *share = if classes[*class] > 0.0 {
                *share / classes[*class]
            } else {
                0.0
            };
        }
        shares
    })
}

/// How means are made.
struct Mean<'a> {
    first: &'a Brdf,
    found: &'a Repeats,
    places: Places,
    causes: [[f64; CAUSES.len()]; PLACES],
}

impl Mean<'_> {
    /// The means of a chunk, nothing if nobody measured any of it, and what their σ are made of.
    fn chunk(&self, chunk: usize, rows: &[Option<BrdfRows>]) -> (Option<BrdfRows>, BudgetSums) {
        let (cells, channels) = (self.first.disk().len(), self.first.channels());
        let range = self.first.chunk_range(chunk);
        let mut means = BrdfRows::missing(range.len() * cells, channels);
        let (mut budget, mut any) = (BudgetSums::default(), false);
        let (mut sample, mut sums) = (Sample::default(), vec![0.0; self.found.parts.len()]);
        for (row, index) in range.enumerate() {
            for &cell in &self.places.cells {
                let pair = row * cells + cell;
                for channel in 0..channels {
                    if !sample.read(rows, pair, channels, channel) {
                        break;
                    }
                    any = true;
                    let place = self.places.place(index, cell);
                    let region = Places::region(self.first, index, cell);
                    let by_class = self.by_class(&sample, (region, place, channel), &mut sums);
                    let sigma = by_class.iter().sum::<f64>().sqrt();
                    let sigma = sigma.min(USELESS_SIGMA.into()).max(LEAST_SIGMA.into());
                    means.f[pair * channels + channel] = sample.mean as f32;
                    means.sigma[pair * channels + channel] = f16::from_f64(sigma);
                    if place < BANDS_DEG.len() * BANDS_DEG.len() {
                        self.account(&mut budget, (place, &sample), by_class, &mut sums);
                    }
                }
                if let [(number, ..), others @ ..] = sample.values.as_slice() {
                    let own = rows[*number].as_ref().map(|rows| rows.provenance[pair]);
                    let own = own.filter(|_| others.is_empty());
                    means.provenance[pair] = own.unwrap_or(Provenance::Merged.code());
                }
            }
        }
        means.seal();
        (any.then_some(means), budget)
    }

    /// Variance of the mean of a sample by classes, and by the excess of scatter at the end.
    fn by_class(
        &self,
        sample: &Sample,
        (region, place, channel): (usize, usize, usize),
        sums: &mut [f64],
    ) -> [f64; CLASSES + 1] {
        let count = sample.count() as f64;
        let mut found = [0.0; CLASSES + 1];
        for (class, groups) in self.found.origins.mean.iter().enumerate() {
            let amounts = sample.amounts(&self.found.parts, place, class);
            found[class] = variance(groups, amounts, sums) / (count * count);
        }
        let (observed, excess) = self.found.tallies.at(region, channel, sample);
        // As if all errors were the same.
        let most = (sample.values.iter().map(|value| value.2).sum::<f64>() / count).powi(2);
        let least = most * (1.0 - observed.min(1.0) * (1.0 - count.recip()));
        let stated: f64 = found.iter().sum();
        if stated < least && stated > 0.0 {
            found = found.map(|one| one * least / stated);
        }
        // What is the same all over a region the repeats alone tell, and they are few: k = 2 shall hold 95 % of those too.
        let level = self.found.level_variances[region][channel] * sample.mean * sample.mean;
        let same = excess.min(level / sample.variance);
        let few = (quantile_95(self.found.parts.len() - 1) / 2.0).powi(2);
        found[CLASSES] = (excess + (few - 1.0) * same) * sample.variance / count;
        found
    }

    /// Adds what σ of a mean is made of to the `budget`.
    fn account(
        &self,
        budget: &mut BudgetSums,
        (place, sample): (usize, &Sample),
        by_class: [f64; CLASSES + 1],
        sums: &mut [f64],
    ) {
        let shares = &self.causes[place];
        let mut causes: [f64; CAUSES.len()] =
            std::array::from_fn(|cause| by_class[CLASS_OF[cause]] * shares[cause]);
        causes[EXCESS] += by_class[CLASSES];
        let all: f64 = by_class.iter().sum();
        causes[UNEXPLAINED] += (all - causes.iter().sum::<f64>()).max(0.0);
        budget.add(place, sample.mean as f32, causes.map(|cause| cause as f32));
        let offsets = sample.values.iter().map(|&(number, _, sigma)| {
            let shared = self.found.parts[number].shared[place];
            (number, sigma * shared.sqrt())
        });
        let shared =
            variance(&self.found.origins.mean[CALIBRATION], offsets, sums).sqrt() / sample.count() as f64;
        budget.add_shared(
            place,
            sample.mean as f32,
            all as f32,
            Shared {
                stray: shared as f32,
                ..Shared::default()
            },
        );
    }
}
