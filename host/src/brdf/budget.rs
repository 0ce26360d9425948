//! The budget of uncertainty: which cause makes how much of σ, by regions of directions.
//!
//! # Design
//! Each measured sample has a variance that is a sum over causes. Of each cause the share of that variance is averaged over
//! the samples of a region, so that the shares of a region sum to 1 and no bright sample drowns the others. How large σ is
//! there tells the geometric mean of σ over f. Regions are bands of the polar angles of light and view.

use serde::Serialize;

use super::cause::KINDS;
use crate::store::{BrdfReader, SmallArray, SmallData, StoreError};

/// What makes uncertain, in the order of the columns.
pub const CAUSES: [&str; 11] = {
    let mut names = [""; KINDS.len()];
    let mut at = 0;
    while at < names.len() {
        names[at] = KINDS[at].name;
        at += 1;
    }
    names
};
/// Upper ends of the bands of polar angles, degrees.
pub const BANDS_DEG: [f64; 3] = [30.0, 60.0, 80.0];
/// Bands of incident × outgoing angles.
pub(crate) const REGIONS: usize = BANDS_DEG.len() * BANDS_DEG.len();

/// Arrays of `brdf.zarr`: shares [theta region, cause], and geometric mean of σ/f [theta region].
pub(crate) const SHARES: &str = "uncertainty_share";
pub(crate) const RELATIVE: &str = "uncertainty_relative";
/// Array of `brdf.zarr`: share that all values have in common beside a factor, [theta region].
const SHARED: &str = "uncertainty_shared";

/// The band of a polar angle; `None` beyond the last.
#[must_use]
pub(crate) fn band(theta_deg: f64) -> Option<usize> {
    BANDS_DEG.iter().position(|end| theta_deg <= *end)
}

/// The polar angles of a band, from and to, degrees.
pub(crate) fn span(band: usize) -> [f64; 2] {
    let from = band.checked_sub(1).map_or(0.0, |below| BANDS_DEG[below]);
    [from, BANDS_DEG[band]]
}

/// Sums over samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct BudgetSums {
    shares: [[f64; CAUSES.len()]; REGIONS],
    samples: [u64; REGIONS],
    log_relative: [f64; REGIONS],
    /// Samples that have a σ/f.
    positive: [u64; REGIONS],
    /// Σ of the share of the variance that all samples share beside a factor.
    shared: [f64; REGIONS],
    /// Σ f·c/σ², c being the standard uncertainty that all samples share by the standards, and by the lamp in the black frames.
    by_cause: [f64; 2],
    /// Σ f²/σ².
    values: f64,
}

/// Standard uncertainties of a sample that all others share.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Shared {
    /// By the reflectance of the standards.
    pub(crate) standards: f32,
    /// By the lamp in the black frames.
    pub(crate) lamp: f32,
    /// By stray light.
    pub(crate) stray: f32,
    /// By light that returns onto the sample.
    pub(crate) returned: f32,
}

impl BudgetSums {
    /// Adds a sample f of these `variances` by cause in a region.
    pub(crate) fn add(&mut self, region: usize, f: f32, variances: [f32; CAUSES.len()]) {
        let all: f32 = variances.iter().sum();
        if !(all > 0.0 && all.is_finite()) {
            return;
        }
        for (sum, variance) in self.shares[region].iter_mut().zip(variances) {
            *sum += f64::from(variance / all);
        }
        self.samples[region] += 1;
        if f > 0.0 {
            self.log_relative[region] += f64::from(all.sqrt() / f).ln();
            self.positive[region] += 1;
        }
    }

    /// Adds a sample f of this `variance` in a region, and what of it is `shared`.
    pub(crate) fn add_shared(&mut self, region: usize, f: f32, variance: f32, shared: Shared) {
        let Shared {
            standards,
            lamp,
            stray,
            returned,
        } = shared;
        let offsets2 = [lamp, stray, returned]
            .map(|of| f64::from(of).powi(2))
            .iter()
            .sum::<f64>();
        let [f, variance, standards, lamp] = [f, variance, standards, lamp].map(f64::from);
        if variance > 0.0 && (f + variance + standards + offsets2).is_finite() {
            self.shared[region] += offsets2 / variance;
            for (sum, cause) in self.by_cause.iter_mut().zip([standards, lamp]) {
                *sum += f * cause / variance;
            }
            self.values += f * f / variance;
        }
    }

    /// Relative standard uncertainty (k = 1) of the factor that all values have in common, by what they share: by as much would least
    /// squares find it off.
    pub(crate) fn shared(&self) -> f64 {
        let [standards, lamp] = self.by_cause;
        if self.values > 0.0 {
            standards.hypot(lamp) / self.values
        } else {
            0.0
        }
    }

    /// Adds those of `other` samples.
    pub(crate) fn merge(&mut self, other: &Self) {
        for (sum, other) in self.by_cause.iter_mut().zip(other.by_cause) {
            *sum += other;
        }
        self.values += other.values;
        for region in 0..REGIONS {
            for (sum, other) in self.shares[region].iter_mut().zip(other.shares[region]) {
                *sum += other;
            }
            self.shared[region] += other.shared[region];
            self.samples[region] += other.samples[region];
            self.log_relative[region] += other.log_relative[region];
            self.positive[region] += other.positive[region];
        }
    }

    /// All numbers, real ones by their bits, in the order of the fields.
    pub(crate) fn to_bits(&self) -> Vec<u64> {
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        [
            bits(self.shares.as_flattened()),
            self.samples.to_vec(),
            bits(&self.log_relative),
            self.positive.to_vec(),
            bits(&self.shared),
            bits(&self.by_cause),
            bits(&[self.values]),
        ]
        .concat()
    }

    /// The sums of which [`to_bits`](Self::to_bits) made these; `None` if there are more or fewer.
    pub(crate) fn from_bits(bits: &[u64]) -> Option<Self> {
        let mut sums = Self::default();
        let mut bits = bits.iter().copied();
        let mut real = |places: &mut [f64]| {
            for place in places {
                *place = f64::from_bits(bits.next()?);
            }
            Some(())
        };
        real(sums.shares.as_flattened_mut())?;
        let mut counts = [[0.0; REGIONS]; 2];
        real(&mut counts[0])?;
        real(&mut sums.log_relative)?;
        real(&mut counts[1])?;
        real(&mut sums.shared)?;
        real(&mut sums.by_cause)?;
        real(std::slice::from_mut(&mut sums.values))?;
        sums.samples = counts[0].map(f64::to_bits);
        sums.positive = counts[1].map(f64::to_bits);
        bits.next().is_none().then_some(sums)
    }

    /// The arrays of `brdf.zarr`; NaN where there is no sample, or none at all.
    pub(crate) fn arrays(sums: Option<&Self>) -> [SmallArray<'static>; 3] {
        let mut shared = vec![f64::NAN; REGIONS];
        let mut shares = vec![f64::NAN; REGIONS * CAUSES.len()];
        let mut relative = vec![f64::NAN; REGIONS];
        for region in 0..REGIONS {
            let Some(sums) = sums.filter(|sums| sums.samples[region] > 0) else {
                continue;
            };
            for (share, sum) in shares[region * CAUSES.len()..]
                .iter_mut()
                .zip(sums.shares[region])
            {
                *share = sum / sums.samples[region] as f64;
            }
            shared[region] = sums.shared[region] / sums.samples[region] as f64;
            if sums.positive[region] > 0 {
                relative[region] = (sums.log_relative[region] / sums.positive[region] as f64).exp();
            }
        }
        [
            SmallArray {
                name: SHARES,
                dims: &["theta_region", "cause"],
                shape: vec![REGIONS, CAUSES.len()],
                data: SmallData::F64(shares),
                units: "1",
                long_name: "share of each cause in the variance of f: noise, stray light, lamp, standard, light and throughput, \
                            seen part, directions, blur, interreflection, crosstalk, polarisation; regions: incident theta up to 30, 60, 80 degrees, within each \
                            outgoing theta up to 30, 60, 80 degrees",
                codes: &[],
            },
            SmallArray {
                name: RELATIVE,
                dims: &["theta_region"],
                shape: vec![REGIONS],
                data: SmallData::F64(relative),
                units: "1",
                long_name: "geometric mean of the standard uncertainty of f over f",
                codes: &[],
            },
            SmallArray {
                name: SHARED,
                dims: &["theta_region"],
                shape: vec![REGIONS],
                data: SmallData::F64(shared),
                units: "1",
                long_name: "share of the variance of f that all values have in common beside a factor: by the lamp in the black \
                            frames, by stray light, and by light that returns onto the sample",
                codes: &[],
            },
        ]
    }
}

/// The budget of a region.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RegionBudget {
    /// Incident and outgoing polar angles, from and to, degrees.
    pub incident_deg: [f64; 2],
    /// See `incident_deg`.
    pub outgoing_deg: [f64; 2],
    /// Geometric mean of σ/f.
    pub relative: f64,
    /// Share of each of [`CAUSES`] in the variance.
    pub shares: Vec<f64>,
    /// Share of the variance that all values have in common beside a factor: an offset by the lamp in the black frames, and by stray
    /// light.
    pub shared: f64,
}

/// The budget that a file has; nothing if it is older, or has none.
///
/// # Errors
/// [`StoreError`].
pub(crate) fn read(reader: &BrdfReader) -> Result<Vec<RegionBudget>, StoreError> {
    let array = |name| match reader.small(name) {
        Ok(data) => Ok(data.as_f64().unwrap_or_default().to_vec()),
        Err(StoreError::ArrayMissing { .. }) => Ok(Vec::new()),
        Err(error) => Err(error),
    };
    let shares = array(SHARES)?;
    // Of other causes it says nothing.
    let is_ours = shares.len() == REGIONS * CAUSES.len();
    Ok(if is_ours {
        regions([&shares, &array(RELATIVE)?, &array(SHARED)?])
    } else {
        Vec::new()
    })
}

/// The arrays of a file that takes this `budget` over from another.
pub(crate) fn arrays_of(budget: &[RegionBudget]) -> [SmallArray<'static>; 3] {
    let [mut shares, mut relative, mut shared] = BudgetSums::arrays(None);
    let mut all = vec![f64::NAN; REGIONS * CAUSES.len()];
    let [mut sizes, mut parts] = [(); 2].map(|()| vec![f64::NAN; REGIONS]);
    for one in budget {
        let at = [one.incident_deg, one.outgoing_deg].map(|[_, end]| band(end));
        if let [Some(row), Some(column)] = at {
            let region = row * BANDS_DEG.len() + column;
            all[region * CAUSES.len()..][..CAUSES.len()].copy_from_slice(&one.shares);
            sizes[region] = one.relative;
            parts[region] = one.shared;
        }
    }
    shares.data = SmallData::F64(all);
    (relative.data, shared.data) = (SmallData::F64(sizes), SmallData::F64(parts));
    [shares, relative, shared]
}

/// The budgets of all regions that have samples, from what [`BudgetSums::arrays`] wrote.
pub(crate) fn regions([shares, relative, shared]: [&[f64]; 3]) -> Vec<RegionBudget> {
    shares
        .chunks_exact(CAUSES.len())
        .zip(relative)
        .take(REGIONS)
        .enumerate()
        .filter(|(_, (shares, _))| shares.iter().all(|share| share.is_finite()))
        .map(|(region, (shares, relative))| RegionBudget {
            incident_deg: span(region / BANDS_DEG.len()),
            outgoing_deg: span(region % BANDS_DEG.len()),
            relative: *relative,
            shares: shares.to_vec(),
            shared: shared.get(region).copied().unwrap_or(0.0),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_means_over_samples_and_sum_to_one() {
        let mut sums = BudgetSums::default();
        sums.add(4, 1.0, [1e-4, 0.0, 0.0, 3e-4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let mut more = BudgetSums::default();
        more.add(4, 100.0, [4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        // What nobody knows counts for nothing.
        more.add(4, 1.0, [f32::INFINITY; CAUSES.len()]);
        sums.merge(&more);
        let read = |arrays: [SmallArray<'_>; 3]| {
            let [shares, relative, shared] = arrays.each_ref().map(|array| array.data.as_f64().unwrap());
            regions([shares, relative, shared])
        };
        let found = read(BudgetSums::arrays(Some(&sums)));
        let [one] = found.as_slice() else {
            panic!("one region: {found:?}")
        };
        assert_eq!((one.incident_deg, one.outgoing_deg), ([30.0, 60.0], [30.0, 60.0]));
        assert!((one.shares[0] - 0.625).abs() < 1e-6 && (one.shares[3] - 0.375).abs() < 1e-6);
        assert!((one.shares.iter().sum::<f64>() - 1.0).abs() < 1e-6);
        assert!((one.relative - 0.02).abs() < 1e-6, "{}", one.relative);
        assert_eq!((band(30.0), band(30.1), band(80.1)), (Some(0), Some(1), None));
        assert_eq!(read(arrays_of(&found)), found);
    }

    #[test]
    fn what_all_values_share_is_off_as_least_squares_would_find_it() {
        let mut sums = BudgetSums::default();
        for (f, lamp) in [(0.1, 0.01), (1.0, 0.01)] {
            let shared = Shared {
                standards: 0.02 * f,
                lamp,
                stray: 0.0,
                // As large in σ as the lamp's offset of the dim one.
                returned: 0.1 * f,
            };
            sums.add_shared(4, f, 0.04 * f * f, shared);
            sums.add(
                4,
                f,
                [0.04 * f * f, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            );
        }
        // Relative to their σ both weigh alike; the lamp's offset is 10 % of one and 1 % of the other.
        assert!(
            (sums.shared() - 0.02_f64.hypot(0.055)).abs() < 1e-6,
            "{}",
            sums.shared()
        );
        let [_, _, shared] = BudgetSums::arrays(Some(&sums));
        let found = shared.data.as_f64().unwrap()[4];
        assert!(
            (found - f64::midpoint(0.25, 0.0025) - 0.25).abs() < 1e-6,
            "{found}"
        );
    }

    #[test]
    fn without_samples_there_is_no_budget() {
        let [shares, relative, _] = BudgetSums::arrays(None);
        let [shares, relative] = [&shares, &relative].map(|array| array.data.as_f64().unwrap());
        assert!(regions([shares, relative, &[]]).is_empty());
    }
}
