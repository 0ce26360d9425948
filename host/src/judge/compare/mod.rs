//! Comparison of two results for one sample: bias, scatter, and whether their uncertainties explain how they differ.
//!
//! # Design
//! The pairs of directions are those of the second file, some 10⁵ of them spread evenly; the first is looked up there, with what
//! interpolation adds to its uncertainty. By region of the polar angles and of the azimuth between light and view, channel by
//! channel, the bias δ is a mean of relative differences,
//!
//! δ = Σ w·d/m / Σ w,  d = b − a,  m = (a + b)/2,  w = m⁴/u⁴,  u² = u_a² + u_b² − 2·cov(a, b),
//!
//! and its standard uncertainty counts noise as that of a value and its neighbours and everything else as the same in all values of the region, which it is
//! at most. That is why the best known values weigh more than by 1/u²: what is common to all no mean lessens.
//! The degree of equivalence is the number E_n = |δ| / (2·u(δ)) (ISO 13528, k = 2): 1 or less where the
//! uncertainties explain the difference. Where both were measured by the same standard, what is wrong with it cancels (`cov`).
//! How the sample lay is a part of u, by the slope along the azimuth.
//!
//! | file | holds |
//! |---|---|
//! | `pairs` | what both say of the same pairs of directions |
//! | `region` | the sums over a region |
//! | `picture` | the chart and the table |

mod pairs;
mod picture;
mod region;
#[cfg(test)]
mod tests;

use serde::Serialize;

use crate::brdf::{Brdf, BrdfError, Source, evidence};

pub use region::{Agreement, RegionAgreement};

pub(super) use pairs::slopes;
use region::Regions;

/// E_n up to which uncertainties explain a difference.
pub const AGREES: f64 = 1.0;
/// Share of regions that may lie beyond, at k = 2.
const BEYOND: f64 = 0.05;

/// How the second result differs from the first, for θ ≤ 80° both ways and values that were measured themselves.
#[derive(Clone, Debug, Serialize)]
pub struct Compared {
    /// Pairs of directions that were compared.
    pub pairs: u64,
    /// Share of the looked-up pairs of the second file that the first has a value for too; `None` if there are none.
    pub share: Option<f64>,
    /// Whether what is wrong with the standard was taken for the same in both.
    pub shares_standard: bool,
    /// What the channels of the second file are called, see [`Brdf::channel_labels`].
    pub channels: Vec<String>,
    /// By channel, over all regions.
    pub overall: Vec<Agreement>,
    /// The regions with enough samples.
    pub regions: Vec<RegionAgreement>,
    /// Of all regions and channels, how many have an E_n.
    pub judged: usize,
    /// Those of them with E_n ≤ 1.
    pub agreeing: usize,
    /// Root mean square of d/u over all samples, the bias of each region taken away: 1 if the stated uncertainty were all scatter.
    pub normalised_scatter: Option<f64>,
    /// What cannot be stated, and what differs, in sentences.
    pub warnings: Vec<String>,
}

/// Compares `b` with `a`, one of a measurement, a measured file and a model; with `same_standard` both were measured by the same
/// standard, which certificates of the same content say too.
///
/// # Errors
/// [`BrdfError`] if their azimuths do not count from the same direction, only the second has colours, their bands are of other light, both hold the same capture, or a file cannot be read.
pub fn compare(a: &Source, b: &Brdf, same_standard: bool) -> Result<Compared, BrdfError> {
    if let Source::Measured(a) = a {
        check_azimuth(a, b)?;
        check_colours(a, b)?;
        a.check_near_bands(b)?;
        evidence::check_apart(b, a)?;
    }
    let shares_standard = same_standard || has_same_certificate(a, b);
    let found = pairs::of(a, b)?;
    let mut regions = Regions::new(b.channels());
    for pair in &found.pairs {
        regions.add(pair, shares_standard);
    }
    let all = regions.all();
    let agreements = || all.iter().flat_map(|region| &region.channels);
    let judged: Vec<f64> = agreements().filter_map(|one| one.e_n).collect();
    let agreeing = judged.iter().filter(|e_n| **e_n <= AGREES).count();
    let mut compared = Compared {
        pairs: found.pairs.len() as u64,
        share: (found.asked > 0).then(|| found.pairs.len() as f64 / found.asked as f64),
        shares_standard,
        channels: b.channel_labels(),
        overall: regions.overall(),
        judged: judged.len(),
        agreeing,
        normalised_scatter: regions.normalised_scatter(),
        regions: all,
        warnings: Vec::new(),
    };
    compared.warnings = warnings(&compared);
    Ok(compared)
}

/// Whether the first standards of both have one certificate.
fn has_same_certificate(a: &Source, b: &Brdf) -> bool {
    let Source::Measured(a) = a else { return false };
    let certificate = |brdf: &Brdf| Some(brdf.standards().into_iter().next()?.certificate?.sha256);
    certificate(a).is_some_and(|sum| certificate(b) == Some(sum))
}

/// Refuses files of which one has its azimuths from a lobe's axis and the other from its holder.
pub(super) fn check_azimuth(a: &Brdf, b: &Brdf) -> Result<(), BrdfError> {
    if a.azimuth().model.is_some() == b.azimuth().model.is_some() {
        return Ok(());
    }
    Err(BrdfError::Content {
        path: b.path().display().to_string(),
        field: "azimuth_deg",
        expected: format!(
            "azimuths as in {}, {} (`rcg turn` lays φ = 0 elsewhere)",
            a.path().display(),
            a.azimuth()
        ),
        found: b.azimuth().to_string(),
    })
}

/// Refuses a first file without colours beside a second one with: nobody knows of which colour its light was.
fn check_colours(a: &Brdf, b: &Brdf) -> Result<(), BrdfError> {
    if a.channels() >= b.channels() {
        return Ok(());
    }
    Err(BrdfError::Content {
        path: a.path().display().to_string(),
        field: "channel",
        expected: format!(
            "{} channels as in {}, or the two exchanged",
            b.channels(),
            b.path().display()
        ),
        found: a.channels().to_string(),
    })
}

fn warnings(compared: &Compared) -> Vec<String> {
    let mut warnings = Vec::new();
    if compared.judged == 0 {
        warnings.push(format!(
            "comparison: none, {} pairs of directions with θ ≤ 80° both ways have measured values in both",
            compared.pairs
        ));
    }
    let beyond = compared.judged - compared.agreeing;
    if beyond as f64 > BEYOND * compared.judged as f64 {
        warnings.push(format!(
            "comparison: in {beyond} of {} regions and channels the difference is larger than both uncertainties explain (E_n > 1, k = 2)",
            compared.judged
        ));
    }
    warnings
}
