//! What returns onto the sample, from two standards.
//!
//! # Design
//! Of the light that leaves the sample, mirror and optics throw a share back onto it. A second standard of another
//! reflectance shows how large it is: of the two, the brighter one gains more. Less than nothing does not return, however far off the
//! standards are said to be what they are not: what is found is the mean of what is left of it by that.

use super::rank_one::Seen;
use crate::brdf::sample::{Sample, albedo};
use crate::calibrate::CalibrateError;
use crate::hemisphere::direction::from_degrees;
use crate::instrument::calibration::Interreflection;

/// The reflectances of two standards differ at least by this.
const APART: f64 = 0.3;
/// No optics throw back more than this share: lenses and splitters reflect some percent of what reaches them, and little of that comes
/// back through the mirror. More by so many standard uncertainties is another standard.
const LARGEST: f64 = 0.02;
const CLEAR: f64 = 2.0;
/// What returns onto the standard is not less than nothing by so many standard uncertainties.
const CERTAIN: f64 = 4.0;

/// What the interreflection of the whole light adds to the signal of a standard, relative: of f the standard shows
/// f + share·ρ(ω_i)·ρ(ω_o)/π, with its directional albedo ρ. Standards are diffuse: one pair stands for all.
pub(super) fn interreflected(standard: &dyn Sample) -> f64 {
    let mean = |values: [f64; 3]| values.iter().sum::<f64>() / 3.0;
    let (wi, wo) = (from_degrees(45.0, 0.0), from_degrees(30.0, 180.0));
    mean(albedo(standard, wi)) * mean(albedo(standard, wo))
        / (std::f64::consts::PI * mean(standard.f(wi, wo)))
}

/// The share that returns, from what the standards show of their own reflectance: `first` adds share·`a`, `second`
/// share·`b`; their reflectances are known to these standard `uncertainties`, relative.
pub(super) fn interreflection(
    first: &Seen,
    second: &Seen,
    (a, b): (f64, f64),
    uncertainties: [f64; 2],
) -> Result<Interreflection, CalibrateError> {
    check_apart(a, b)?;
    let (ratio, uncertainty) = first.ratio_to(second).ok_or_else(|| CalibrateError::Views {
        expected: "frames of the second standard that are as bright as their noise is small".to_owned(),
        found: "none".to_owned(),
        advice: "give a brighter --second-standard, or none",
    })?;
    // (1 + share·a)/(1 + share·b) = ratio.
    let found = Interreflection {
        share: (ratio - 1.0) / (a - ratio * b),
        standard_uncertainty: uncertainty / (a - b).abs(),
        by_standards: uncertainties[0].hypot(uncertainties[1]) / (a - b).abs(),
        own: a,
        apart: a - b,
        narrowed: 1.0,
    };
    let doubt = found.standard_uncertainty.hypot(found.by_standards);
    if found.share > LARGEST + CLEAR * doubt {
        return Err(CalibrateError::Views {
            expected: format!(
                "standards of which no more than {:.0} % of their light would have to return for what they show",
                100.0 * LARGEST
            ),
            found: format!("{:.1} %", 100.0 * found.share),
            advice: "are both standards what they are said to be, and do they lie alike? Or --second-standard none",
        });
    }
    if found.share >= -CERTAIN * doubt {
        let (share, narrowed) = at_least_nothing(found.share, doubt);
        return Ok(Interreflection {
            share,
            standard_uncertainty: narrowed * found.standard_uncertainty,
            by_standards: narrowed * found.by_standards,
            narrowed,
            ..found
        });
    }
    Err(CalibrateError::Views {
        expected: "a second standard that is as bright beside the first as both are said to be".to_owned(),
        found: format!(
            "{:.1} % less light of the first, which is no interreflection",
            -100.0 * found.share * (a - b)
        ),
        advice: "are both standards what they are said to be, and do they lie alike?",
    })
}

/// Places at which a density is summed, and standard deviations beyond which there is nothing of it.
const STEPS: usize = 4_000;
const FAR: f64 = 12.0;

/// Mean of a quantity that was `found` with a standard uncertainty `sigma` and is not below 0, and its standard deviation over `sigma`: of a
/// normal distribution no more than the part from 0 on is left.
fn at_least_nothing(found: f64, sigma: f64) -> (f64, f64) {
    if sigma <= 0.0 {
        return (found.max(0.0), 1.0);
    }
    let from = -found / sigma;
    let width = FAR / STEPS as f64;
    let (mut weight, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for step in 0..STEPS {
        let z = from.max(-FAR / 2.0) + (step as f64 + 0.5) * width;
        // As a factor of the density where it is largest.
        let density = (-0.5 * (z * z - from.max(0.0).powi(2))).exp();
        weight += density;
        sum += density * z;
        squares += density * z * z;
    }
    let mean = sum / weight;
    (
        mean * sigma + found,
        (squares / weight - mean * mean).max(0.0).sqrt().min(1.0),
    )
}

/// Refuses standards so alike that their own uncertainty would pass for interreflection.
pub(super) fn check_apart(a: f64, b: f64) -> Result<(), CalibrateError> {
    let is_apart = (a - b).abs() >= APART;
    if is_apart {
        return Ok(());
    }
    Err(CalibrateError::Views {
        expected: format!("two standards whose reflectances differ by {APART} or more"),
        found: format!("{a:.3} and {b:.3}"),
        advice: "give a darker --second-standard, or none to do without interreflection",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_the_least_that_returns() {
        // Far above 0 it stays; tables of the truncated normal distribution have the others.
        for (found, sigma, expected, spread) in [
            (0.03, 0.005, 0.03, 1.0),
            (0.0, 1.0, 0.797_88, 0.602_81),
            (1.0, 1.0, 1.287_60, 0.793_53),
            (-1.0, 1.0, 0.525_14, 0.446_21),
            (-3.0, 1.0, 0.283_10, 0.265_41),
            (0.01, 0.0, 0.01, 1.0),
            (-0.01, 0.0, 0.0, 1.0),
        ] {
            let (mean, narrowed) = at_least_nothing(found, sigma);
            assert!((mean - expected).abs() < 1e-4, "{found} {sigma}: {mean}");
            assert!((narrowed - spread).abs() < 1e-3, "{found} {sigma}: {narrowed}");
        }
    }
}
