//! What the errors of repeated measurements have to do with each other.
//!
//! # Design
//! | part of σ, by the budget | in the mean of repeats | in their differences |
//! |---|---|---|
//! | noise | each one's own | each one's own |
//! | standard | common, unless all their certificates differ | cancels where the standard is the same |
//! | light and throughput, crosstalk | common, unless their calibrations differ | cancels with the same calibration |
//! | lamp, stray light, seen part | the same | each one's own: calibrations foresee them, sessions differ |
//! | directions, and what no budget explains | common | each one's own: the sample is laid anew |
//! | blur, interreflection, polarisation | common: no calibration changes them | (no part) |
//!
//! So whatever may be common is common in the mean, and whatever may differ differs in a difference. Calibrations are known by the
//! SHA-256 in `lineage`; where a file does not say, its calibration may be that of any other.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::brdf::{BANDS_DEG, Brdf, CAUSES, LINEAGE, budget};

/// Parts of σ that behave alike.
pub(crate) const CLASSES: usize = 6;
pub(crate) const NOISE: usize = 0;
const STANDARD: usize = 1;
pub(crate) const CALIBRATION: usize = 2;
const SESSION: usize = 3;
/// Directions, and what no budget explains.
pub(crate) const PLACEMENT: usize = 4;
pub(crate) const COMMON: usize = 5;
/// The class of each of [`CAUSES`].
pub(crate) const CLASS_OF: [usize; CAUSES.len()] = [
    NOISE,
    SESSION,
    SESSION,
    STANDARD,
    CALIBRATION,
    SESSION,
    PLACEMENT,
    COMMON,
    COMMON,
    CALIBRATION,
    COMMON,
];

/// Bands of incident × outgoing angles, and a last one beyond them.
pub(crate) const PLACES: usize = BANDS_DEG.len() * BANDS_DEG.len() + 1;

/// The place of these polar angles of light and view in degrees.
pub(crate) fn place_of(incident_deg: f64, outgoing_deg: f64) -> usize {
    let both = budget::band(incident_deg).zip(budget::band(outgoing_deg));
    both.map_or(PLACES - 1, |(row, column)| row * BANDS_DEG.len() + column)
}

/// What the σ of one measurement is made of, by [`place_of`].
#[derive(Clone, Debug)]
pub(crate) struct Parts {
    /// Square root of the share of each class in the variance.
    pub(crate) roots: [[f64; CLASSES]; PLACES],
    /// Share of each cause in the variance; `None` where there is no budget.
    pub(crate) causes: [Option<[f64; CAUSES.len()]>; PLACES],
    /// Share of the variance that all values of the file have in common beside a factor.
    pub(crate) shared: [f64; PLACES],
}

impl Parts {
    /// Those of `brdf`.
    pub(crate) fn of(brdf: &Brdf) -> Self {
        let mut all = Self {
            roots: [[0.0; CLASSES]; PLACES],
            causes: [None; PLACES],
            shared: [0.0; PLACES],
        };
        for one in brdf.budget() {
            let place = place_of(one.incident_deg[1], one.outgoing_deg[1]);
            let shares: [f64; CAUSES.len()] = std::array::from_fn(|cause| one.shares[cause].clamp(0.0, 1.0));
            all.causes[place] = Some(shares);
            all.shared[place] = one.shared.clamp(0.0, 1.0);
        }
        for (roots, causes) in all.roots.iter_mut().zip(&all.causes) {
            let mut shares = [0.0; CLASSES];
            for (class, share) in CLASS_OF.iter().zip(causes.iter().flatten()) {
                shares[*class] += share;
            }
            let explained: f64 = shares.iter().sum();
            shares[PLACEMENT] += (1.0 - explained).max(0.0);
            *roots = shares.map(f64::sqrt);
        }
        all
    }
}

/// Which measurements have which part of their errors in common: groups by class and measurement.
#[derive(Clone, Debug)]
pub(crate) struct Origins {
    /// For means: who may be in one group is.
    pub(crate) mean: [Vec<usize>; CLASSES],
    /// For differences: who certainly is.
    pub(crate) difference: [Vec<usize>; CLASSES],
    /// Whether all have one calibration, and one standard, for sure.
    pub(crate) one_calibration: bool,
    /// See `one_calibration`.
    pub(crate) one_standard: bool,
}

impl Origins {
    /// Those of `all`.
    pub(crate) fn of(all: &[&Brdf]) -> Self {
        let keys = |of: fn(&Brdf) -> BTreeSet<String>| all.iter().map(|brdf| of(brdf)).collect::<Vec<_>>();
        let (calibrations, standards) = (keys(calibrations), keys(standards));
        let certified: Vec<bool> = all.iter().map(|brdf| is_certified(brdf)).collect();
        let may_share =
            |a: usize, b: usize| !(certified[a] && certified[b] && standards[a].is_disjoint(&standards[b]));
        let may_be_one = |a: usize, b: usize| {
            let (a, b) = (&calibrations[a], &calibrations[b]);
            a.is_empty() || b.is_empty() || !a.is_disjoint(b)
        };
        let is_one = |of: &[BTreeSet<String>], a: usize, b: usize| !of[a].is_empty() && of[a] == of[b];
        let count = all.len();
        let each = || (0..count).collect::<Vec<_>>();
        let calibrated = grouped(count, &may_be_one);
        let same_standard = grouped(count, &|a, b| is_one(&standards, a, b));
        let same_calibration = grouped(count, &|a, b| is_one(&calibrations, a, b));
        let is_all = |groups: &[usize]| groups.iter().all(|group| *group == 0);
        Self {
            one_calibration: is_all(&same_calibration),
            one_standard: is_all(&same_standard),
            mean: [
                each(),
                grouped(count, &may_share),
                calibrated.clone(),
                calibrated,
                vec![0; count],
                vec![0; count],
            ],
            difference: [each(), same_standard, same_calibration, each(), each(), each()],
        }
    }
}

/// Groups of those that are `together` with one another, directly or by others; each has the number of its first.
fn grouped(count: usize, together: &dyn Fn(usize, usize) -> bool) -> Vec<usize> {
    let mut groups: Vec<usize> = (0..count).collect();
    for a in 0..count {
        for b in a + 1..count {
            if together(a, b) && groups[a] != groups[b] {
                let (low, high) = (groups[a].min(groups[b]), groups[a].max(groups[b]));
                groups
                    .iter_mut()
                    .filter(|group| **group == high)
                    .for_each(|group| *group = low);
            }
        }
    }
    groups
}

/// The calibrations behind a file by their sums; nothing if it does not say.
fn calibrations(brdf: &Brdf) -> BTreeSet<String> {
    fn add(lineage: &Value, all: &mut BTreeSet<String>) {
        if let Some(sums) = lineage["sha256"].as_object() {
            let sum = sums.get("calibration.json").and_then(Value::as_str);
            all.insert(sum.unwrap_or("none").to_owned());
        }
        for input in lineage["inputs"].as_array().into_iter().flatten() {
            add(&input[LINEAGE], all);
        }
    }
    let mut all = BTreeSet::new();
    if let Some(lineage) = brdf.attributes().get(LINEAGE) {
        add(lineage, &mut all);
    }
    all
}

/// The standards behind a file, by their certificates where they have one; `none` where it was not calibrated.
fn standards(brdf: &Brdf) -> BTreeSet<String> {
    let standards = brdf.standards();
    if standards.is_empty() {
        return BTreeSet::from(["none".to_owned()]);
    }
    let name = |standard: crate::instrument::calibration::Standard| match standard.certificate {
        Some(certificate) => certificate.sha256,
        None => format!("{} ± {}", standard.named, standard.standard_uncertainty),
    };
    standards.into_iter().map(name).collect()
}

/// Whether a certificate stands behind each standard of a file.
fn is_certified(brdf: &Brdf) -> bool {
    let standards = brdf.standards();
    !standards.is_empty() && standards.iter().all(|standard| standard.certificate.is_some())
}

/// Variance of a sum of errors, of which `amounts` says each measurement's (with its sign) by its number: those of a group in `groups` are the
/// same, others are independent. `sums` is room for one number a measurement.
pub(crate) fn variance(
    groups: &[usize],
    amounts: impl Iterator<Item = (usize, f64)>,
    sums: &mut [f64],
) -> f64 {
    sums.fill(0.0);
    for (number, amount) in amounts {
        sums[groups[number]] += amount;
    }
    sums.iter().map(|sum| sum * sum).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_may_be_in_a_group_by_others_is() {
        let near = |a: usize, b: usize| a.abs_diff(b) == 2;
        assert_eq!(grouped(6, &near), [0, 1, 0, 1, 0, 1]);
        assert_eq!(grouped(3, &|_, _| false), [0, 1, 2]);
    }

    #[test]
    fn the_errors_of_a_group_add_up_and_others_by_their_squares() {
        let amounts = || [3.0, 4.0, -3.0].into_iter().enumerate();
        let mut sums = [0.0; 3];
        assert!((variance(&[0, 1, 2], amounts(), &mut sums) - 34.0).abs() < 1e-12);
        assert!((variance(&[0, 0, 0], amounts(), &mut sums) - 16.0).abs() < 1e-12);
        assert!((variance(&[0, 1, 0], amounts(), &mut sums) - 16.0).abs() < 1e-12);
    }

    #[test]
    fn every_cause_has_its_class() {
        let class = |name: &str| CLASS_OF[CAUSES.iter().position(|cause| *cause == name).unwrap()];
        for (class, names) in [
            (NOISE, &["noise"][..]),
            (STANDARD, &["standard"]),
            (CALIBRATION, &["light and throughput", "crosstalk"]),
            (SESSION, &["lamp", "stray light", "seen part"]),
            (PLACEMENT, &["directions"]),
            (COMMON, &["blur", "interreflection", "polarisation"]),
        ]
        .map(|(wanted, names)| (wanted, names.iter().map(|name| class(name)).collect::<Vec<_>>()))
        {
            assert!(names.iter().all(|found| *found == class));
        }
    }
}
