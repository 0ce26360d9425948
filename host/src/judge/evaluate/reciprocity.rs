//! Reciprocity: how much f changes when the two directions are exchanged.
//!
//! # Design
//! Only what was measured both ways is evidence: a value that was filled in by reciprocity is its own counterpart and
//! would be reciprocal to the bit. Every pair of directions is drawn by chance and counts once, not once each way.

use glam::DVec3;
use rand::SeedableRng as _;
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::base::median::median;
use crate::brdf::Brdf;
use crate::brdf::sample::Sample;
use crate::hemisphere::direction::drawn;
use crate::hemisphere::judged::RECIPROCAL_THETA_DEG;
use crate::store::StoreError;

/// Pairs of directions that are tried.
const PAIRS: usize = 20_000;

/// The residual |f(a,b) − f(b,a)| / mean.
pub(super) struct Reciprocity {
    /// Median of the BRDF.
    pub(super) median: Option<f64>,
    /// Median of the reference over the same pairs.
    pub(super) of_reference: Option<f64>,
    /// Pairs that it was found from.
    pub(super) pairs: usize,
    /// Share of the pairs with θ ≤ 70° both ways that those are.
    pub(super) share: f64,
}

/// Of `brdf`, and of `reference`, over random pairs of directions with θ ≤ 70°.
///
/// # Errors
/// [`StoreError`].
pub(super) fn reciprocity(brdf: &Brdf, reference: Option<&dyn Sample>) -> Result<Reciprocity, StoreError> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(0);
    let mut draw = || drawn(&mut rng, RECIPROCAL_THETA_DEG);
    let pairs: Vec<(DVec3, DVec3)> = (0..PAIRS).map(|_| (draw(), draw())).collect();
    let both: Vec<(DVec3, DVec3)> = pairs.iter().flat_map(|&(a, b)| [(a, b), (b, a)]).collect();
    // As it was captured: other interpolations use what is judged here.
    let values = brdf.measured(&both)?;
    let (mut residuals, mut own) = (Vec::new(), Vec::new());
    for (&(a, b), values) in pairs.iter().zip(values.chunks_exact(2)) {
        let mean =
            |value: &Option<[f32; 3]>| Some(value.as_ref()?.iter().map(|&f| f64::from(f)).sum::<f64>() / 3.0);
        let (Some(forth), Some(back)) = (mean(&values[0]), mean(&values[1])) else {
            continue;
        };
        residuals.extend(residual(forth, back));
        if let Some(reference) = reference {
            let mean = |a, b| reference.f(a, b).iter().sum::<f64>() / 3.0;
            own.extend(residual(mean(a, b), mean(b, a)));
        }
    }
    let found = residuals.len();
    Ok(Reciprocity {
        median: middle(residuals),
        of_reference: middle(own),
        pairs: found,
        share: found as f64 / PAIRS as f64,
    })
}

/// Of f of a pair both ways, unless one of them is no positive number: noise about 0 has no relative difference.
fn residual(forth: f64, back: f64) -> Option<f64> {
    let defined = |f: f64| f.is_finite() && f > 0.0;
    (defined(forth) && defined(back)).then(|| (forth - back).abs() / f64::midpoint(forth, back))
}

/// The median of at least two numbers.
fn middle(all: Vec<f64>) -> Option<f64> {
    (all.len() > 1).then(|| median(all)).flatten()
}
