//! A measured BRDF against the sample that stood in the rig, known in closed form.
//!
//! # Design
//! Every sample that was measured itself, θ ≤ 80° both ways, has z = (f − truth)/σ at just the directions that the file
//! states. What is wrong:
//! - any sample beyond 10 σ; more than one pair of directions, whose channels share what shape and light do, and more than a share of
//!   10⁻⁵, beyond 6 σ;
//! - a common factor s of all values beyond what the file states for it. s is that of least squares in f = s·truth, weighed
//!   with what is left of σ² without the common part. |s − 1| may be 3.5 times as much as the stated uncertainty and that of
//!   s together.
//!
//! Light and pixels flatten a lobe, which each σ states and which all samples of the lobe share: no factor of all values, but one
//! that a fit would find. So only samples count for s around which the truth is flat.
//!
//! An offset by the lamp in the black frames, by stray light, or by light that returns onto the sample is shared by all samples too
//! and is no factor, but least squares in f = s·truth find one. So s may be off by what the budget of the file states of that.
//!
//! Samples of one incident direction share errors, and so do those of one cell of the disk. So the uncertainty of s is found from the sums of
//! what is left over of each row and of each cell (two-way clusters: Cameron, Gelbach, Miller 2011), and is no less than
//! that of independent samples.
//!
//! - less than 90 % of the samples within two standard uncertainties once the common factor is taken out, each as large as what
//!   is left of σ without the common part: what samples have for themselves has to be stated too. Taken out is that of s which the
//!   file states to be a factor, beside what else s may be off by.
//!
//! The share within 2 σ as it is is stated and no rule: it is that of one draw of the common factor. What was filled in is counted beside
//! it.
//! The file is read twice, chunk by chunk.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::brdf::sample::Sample;
use crate::brdf::{Brdf, own_variance};
use crate::hemisphere::direction::to_degrees;
use crate::hemisphere::judged::is_judged;
use crate::judge::evaluate::histogram::LogHistogram;
use crate::judge::evaluate::scoring::{Floor, channel_values};
use crate::store::StoreError;
use crate::store::provenance::Provenance;

/// Standard uncertainties beyond which no sample may lie.
const NEVER: f64 = 10.0;
/// Standard uncertainties beyond which hardly any may.
const RARE: f64 = 6.0;
/// Largest share of the samples beyond [`RARE`].
const RARE_SHARE: f64 = 1e-5;
/// Pairs of directions beyond [`RARE`], in all channels, that no file is blamed for.
const RARE_COUNT: u64 = 1;
/// Standard uncertainties by which the common factor may be off.
const OF_SCALE: f64 = 3.5;
/// Least share of the samples within 2 of what they have for themselves, and samples of which that is asked.
const LEAST_COVERAGE: f64 = 0.9;
const ENOUGH: u64 = 1000;
/// Largest relative difference of the truth from a cell to the next, and of that difference from one to the next, where it is flat.
const FLAT: [f64; 2] = [0.05, 0.01];
/// Samples that are named.
const WORST: usize = 6;

/// Samples and how many lie how far from the truth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Origins {
    /// Samples, each channel one.
    pub samples: u64,
    /// |z| ≤ 2.
    pub within_2: u64,
    /// |z| > 6.
    pub beyond_6: u64,
    /// |z| > 10.
    pub beyond_10: u64,
}

impl Origins {
    /// Share within 2 σ; `None` of no samples.
    #[must_use]
    pub fn coverage(&self) -> Option<f64> {
        (self.samples > 0).then(|| self.within_2 as f64 / self.samples as f64)
    }

    /// Both together.
    #[must_use]
    pub const fn and(self, other: &Self) -> Self {
        Self {
            samples: self.samples + other.samples,
            within_2: self.within_2 + other.within_2,
            beyond_6: self.beyond_6 + other.beyond_6,
            beyond_10: self.beyond_10 + other.beyond_10,
        }
    }

    fn add(&mut self, z: f64) {
        // What is not a number is as wrong as can be.
        let far = if z.is_nan() { f64::INFINITY } else { z.abs() };
        self.samples += 1;
        self.within_2 += u64::from(far <= 2.0);
        self.beyond_6 += u64::from(far > RARE);
        self.beyond_10 += u64::from(far > NEVER);
    }
}

/// The factor that all values have in common.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scale {
    /// f over truth.
    pub value: f64,
    /// Its standard uncertainty (k = 1) by what differs between samples, and by offsets that all share as the file states.
    pub standard_uncertainty: f64,
    /// The part of that by those offsets.
    #[serde(default)]
    pub offsets: f64,
    /// The relative standard uncertainty that the file states for it (k = 1), if it does; that of the offsets is in there, too.
    pub stated: Option<f64>,
}

impl Scale {
    /// How far it is off in standard uncertainties; `None` if the file states none.
    #[must_use]
    pub fn score(&self) -> Option<f64> {
        let both = self.factor(self.stated?).hypot(self.standard_uncertainty);
        Some((self.value - 1.0).abs() / both)
    }

    /// What of a relative standard uncertainty `stated` for all values is that of a factor.
    fn factor(&self, stated: f64) -> f64 {
        (stated * stated - self.offsets * self.offsets).max(0.0).sqrt()
    }

    /// The factor of all values that it is most likely to be, beside what else it may be off by.
    fn taken_out(&self) -> f64 {
        let Some(stated) = self.stated else {
            return self.value;
        };
        let (stated, other) = (stated * stated, self.standard_uncertainty.powi(2));
        1.0 + (self.value - 1.0) * stated / (stated + other).max(f64::MIN_POSITIVE)
    }
}

/// A sample and how far from the truth it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Worst {
    /// θi, φi, θo, φo in degrees.
    pub directions_deg: [f64; 4],
    /// Its channel.
    pub channel: usize,
    /// f as measured, sr⁻¹.
    pub f: f64,
    /// f of the sample in closed form, sr⁻¹.
    pub truth: f64,
    /// Standard uncertainty as stated, sr⁻¹.
    pub sigma: f64,
    /// (f − truth)/σ.
    pub z: f64,
}

/// How a file stands against the truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    /// What was measured itself.
    pub measured: Origins,
    /// What was filled in, by the names of the provenances; stated, and no reason for blame.
    pub filled_in: BTreeMap<String, Origins>,
    /// The common factor; `None` of no samples, or of black ones.
    pub scale: Option<Scale>,
    /// Share of what was measured that lies within 2 of the standard uncertainties that samples have for themselves, once the common
    /// factor is taken out; `None` without one.
    #[serde(default)]
    pub own_coverage: Option<f64>,
    /// Share of all pairs of directions with θ ≤ 80° both ways (and channels) that are scored: measured, and truth ≥ max(1 % of its median, 0.01·albedo/π).
    pub scored_share: Option<f64>,
    /// Median of |f − truth|/truth over those.
    pub median_error: Option<f64>,
    /// Median of σ/f over those.
    pub median_sigma: Option<f64>,
    /// The samples furthest from the truth, the worst first.
    pub worst: Vec<Worst>,
    /// What is wrong, in sentences; nothing if nothing is.
    pub wrong: Vec<String>,
}

/// One channel of a pair of directions.
struct Compared {
    row: usize,
    cell: usize,
    channel: usize,
    wo: DVec3,
    f: f64,
    truth: f64,
    sigma: f64,
    /// What of it all samples share beside a factor.
    shared: f64,
    origin: Provenance,
    /// Whether the truth is flat around it.
    is_flat: bool,
}

impl Compared {
    /// Whether it shows the common factor.
    const fn is_of_scale(&self) -> bool {
        self.origin.is_seen() && self.is_flat
    }

    fn z(&self) -> f64 {
        (self.f - self.truth) / self.sigma
    }

    /// Variance that is left of σ² without the part that is `common`, relative.
    fn own_variance(&self, common: f64) -> f64 {
        own_variance(self.truth, self.sigma, common)
    }

    /// Samples of one incident direction that are about as bright.
    fn octave(&self) -> i32 {
        self.truth.log2().floor() as i32
    }
}

/// Weights of the samples of one incident direction in the fit of the scale.
///
/// A sample that noise makes darker states a smaller σ too, and would weigh more than one that noise makes brighter: the scale
/// would come out too small by the square of the relative noise. So each has the mean variance of those that are truly about as
/// bright.
fn weights(row: &[Compared], common: f64) -> Vec<f64> {
    let mut sums: BTreeMap<i32, (f64, f64)> = BTreeMap::new();
    for one in row.iter().filter(|one| one.is_of_scale()) {
        let (sum, count) = sums.entry(one.octave()).or_default();
        *sum += one.own_variance(common);
        *count += 1.0;
    }
    let weight = |one: &Compared| match sums.get(&one.octave()) {
        Some((sum, count)) if one.is_of_scale() => count / sum,
        _ => 0.0,
    };
    row.iter().map(weight).collect()
}

/// Judges `brdf`, which was measured of `sample`.
///
/// # Errors
/// [`StoreError`] if the file cannot be read or contradicts itself.
pub fn judge(brdf: &Brdf, sample: &dyn Sample) -> Result<Judgement, StoreError> {
    let stated = brdf.common_uncertainty();
    let scale = scale(brdf, sample, stated)?;
    let factor = scale.map_or(1.0, |scale| scale.taken_out());
    // What standards do to such a sample is no factor of all values, and stays.
    let of_all = brdf.common_uncertainty().unwrap_or(0.0);
    let of_all = scale.map_or(of_all, |scale| scale.factor(of_all));

    let floor = Floor::of(sample, brdf.channels());
    let mut measured = Origins::default();
    let mut filled_in: BTreeMap<String, Origins> = BTreeMap::new();
    let (mut errors, mut sigmas) = (LogHistogram::new(), LogHistogram::new());
    let mut within_own = 0_u64;
    let mut worst: Vec<Worst> = Vec::new();
    each(brdf, sample, &mut |row| {
        for one in row {
            let z = one.z();
            if !one.origin.is_seen() {
                let of = filled_in.entry(one.origin.name().to_owned()).or_default();
                of.add(z);
                continue;
            }
            measured.add(z);
            let beside = one.f - factor * one.truth;
            within_own += u64::from(beside * beside <= 4.0 * one.own_variance(of_all));
            if let Some(error) = floor.error(one.f, one.truth, one.channel) {
                errors.add(error);
                let is_positive = one.f > 0.0;
                sigmas.add(if is_positive {
                    one.sigma / one.f
                } else {
                    f64::INFINITY
                });
            }
            keep(&mut worst, brdf, one);
        }
    })?;
    let lit = (0..brdf.grid().len()).filter(|&row| is_judged(brdf.grid().direction(row)));
    let all = lit.count() * judged_cells(brdf).len() * brdf.channels();
    let own_coverage = scale
        .filter(|_| measured.samples > 0)
        .map(|_| within_own as f64 / measured.samples as f64);
    Ok(Judgement {
        own_coverage,
        measured,
        filled_in,
        scale,
        scored_share: (all > 0).then(|| errors.count() as f64 / all as f64),
        median_error: errors.median().value(),
        median_sigma: sigmas.median().value(),
        worst,
        wrong: wrong(&measured, brdf.channels(), scale.as_ref(), own_coverage),
    })
}

/// The factor that all values of `brdf`, measured of `sample`, have in common, which is `stated` to be this uncertain; `None` of no
/// samples, or of black ones.
fn scale(brdf: &Brdf, sample: &dyn Sample, stated: Option<f64>) -> Result<Option<Scale>, StoreError> {
    let common = stated.unwrap_or(0.0);
    let (mut up, mut down, mut shared) = (0.0, 0.0, 0.0);
    let (mut rows, mut cells) = (
        vec![[0.0; 2]; brdf.grid().len()],
        vec![[0.0; 2]; brdf.disk().len()],
    );
    let mut own = [0.0; 3];
    each(brdf, sample, &mut |row| {
        for (one, weight) in row.iter().zip(weights(row, common)) {
            let (found, known) = (weight * one.f * one.truth, weight * one.truth * one.truth);
            up += found;
            down += known;
            shared += weight * one.truth * one.shared;
            for sums in [&mut rows[one.row], &mut cells[one.cell]] {
                sums[0] += found;
                sums[1] += known;
            }
            for (sum, square) in own.iter_mut().zip([found * found, found * known, known * known]) {
                *sum += square;
            }
        }
    })?;
    Ok((down > 0.0).then(|| {
        let value = up / down;
        let squares = |sums: &[[f64; 2]]| {
            sums.iter()
                .map(|[found, known]| (found - value * known).powi(2))
                .sum::<f64>()
        };
        let own = own[0] - 2.0 * value * own[1] + value * value * own[2];
        let variance = (squares(&rows) + squares(&cells) - own) / (down * down);
        Scale {
            value,
            standard_uncertainty: variance.max(down.recip()).sqrt().hypot(shared / down),
            offsets: shared / down,
            stated,
        }
    }))
}

/// What is wrong, in sentences.
fn wrong(
    measured: &Origins,
    channels: usize,
    scale: Option<&Scale>,
    own_coverage: Option<f64>,
) -> Vec<String> {
    let mut wrong = Vec::new();
    let Origins {
        samples,
        beyond_6,
        beyond_10,
        ..
    } = *measured;
    if beyond_10 > 0 {
        wrong.push(format!(
            "expected no sample beyond {NEVER} σ, found {beyond_10} of {samples}"
        ));
    }
    if beyond_6 > RARE_COUNT * channels as u64 && beyond_6 as f64 > RARE_SHARE * samples as f64 {
        wrong.push(format!(
            "expected a share of {RARE_SHARE} of the samples beyond {RARE} σ, found {beyond_6} of {samples}"
        ));
    }
    if let Some(share) = own_coverage.filter(|share| samples >= ENOUGH && *share < LEAST_COVERAGE) {
        wrong.push(format!(
            "expected {:.0} % of the samples within 2 σ of their own beside the common factor, found {:.1} %",
            100.0 * LEAST_COVERAGE,
            100.0 * share
        ));
    }
    if let Some(scale) = scale
        && let Some(score) = scale.score()
        && (score > OF_SCALE || score.is_nan())
    {
        wrong.push(format!(
            "expected a common factor within {OF_SCALE} of its standard uncertainty, found {:.4} ± {:.4} where ± {:.4} is stated",
            scale.value,
            scale.standard_uncertainty,
            scale.stated.unwrap_or_default()
        ));
    }
    wrong
}

/// The cells of the disk with θ ≤ 80° and their directions.
fn judged_cells(brdf: &Brdf) -> Vec<(usize, DVec3)> {
    let disk = brdf.disk();
    let judged = |cell| disk.direction(cell).filter(|wo| is_judged(*wo));
    (0..disk.len())
        .filter_map(|cell| Some((cell, judged(cell)?)))
        .collect()
}

/// Calls `visit` with what has a value under each judged incident direction: each channel of each judged outgoing one.
fn each(brdf: &Brdf, sample: &dyn Sample, visit: &mut dyn FnMut(&[Compared])) -> Result<(), StoreError> {
    let (disk, channels) = (brdf.disk(), brdf.channels());
    let cells = judged_cells(brdf);
    for chunk in 0..brdf.chunks() {
        let Some(values) = brdf.chunk(chunk)? else {
            continue;
        };
        for (place, row) in brdf.chunk_range(chunk).enumerate() {
            let wi = brdf.grid().direction(row);
            if !is_judged(wi) {
                continue;
            }
            let lobe = sample.incident(wi);
            let whole: Vec<f64> = (0..disk.len())
                .map(|cell| {
                    disk.direction(cell)
                        .map_or(f64::NAN, |wo| lobe.f(wo).iter().sum())
                })
                .collect();
            let (theta_deg, _) = to_degrees(wi);
            let mut found = Vec::new();
            for &(cell, wo) in &cells {
                let shared = brdf.shared_part(theta_deg, to_degrees(wo).0).sqrt();
                let at = place * disk.len() + cell;
                let origin = Provenance::from_code(values.provenance[at]);
                let Some(origin) = origin.filter(|origin| *origin != Provenance::Missing) else {
                    continue;
                };
                let is_flat = is_flat(&whole, cell, disk.size());
                for (channel, truth) in channel_values(lobe.f(wo), channels).enumerate() {
                    found.push(Compared {
                        row,
                        cell,
                        channel,
                        wo,
                        f: f64::from(values.f[at * channels + channel]),
                        truth,
                        sigma: values.sigma[at * channels + channel].to_f64(),
                        shared: shared * values.sigma[at * channels + channel].to_f64(),
                        origin,
                        is_flat,
                    });
                }
            }
            visit(&found);
        }
    }
    Ok(())
}

/// Whether `values` over a disk of `size` cells a side are flat around `cell`, along both its axes.
fn is_flat(values: &[f64], cell: usize, size: usize) -> bool {
    let [first, second] = FLAT.map(|share| share * values[cell]);
    [1, size].into_iter().all(|stride| {
        let beside = [cell.checked_sub(stride), cell.checked_add(stride)];
        let beside = beside.map(|at| at.and_then(|at| values.get(at)).copied().unwrap_or(f64::NAN));
        let [before, after] = beside.map(|value| value - values[cell]);
        before.abs() <= first && after.abs() <= first && (before + after).abs() <= second
    })
}

/// Keeps `one` among the `worst` if it is.
fn keep(worst: &mut Vec<Worst>, brdf: &Brdf, one: &Compared) {
    let z = one.z();
    if worst.len() == WORST && worst[WORST - 1].z.abs() >= z.abs() {
        return;
    }
    let (theta_i, phi_i) = brdf.grid().angles_deg(one.row);
    let (theta_o, phi_o) = to_degrees(one.wo);
    let place = worst.partition_point(|other| other.z.abs() >= z.abs());
    worst.insert(
        place,
        Worst {
            directions_deg: [theta_i, phi_i, theta_o, phi_o],
            channel: one.channel,
            f: one.f,
            truth: one.truth,
            sigma: one.sigma,
            z,
        },
    );
    worst.truncate(WORST);
}
