//! Reflectances: what comes back into a hemisphere, or into a ring around the normal, by the light's polar angle.
//!
//! # Design
//! ρ(θi; h) = ∫ f·cosθo dωo, mean over the azimuths of the light, from the cells of the file's own disk; 8°/h is that of a sphere with its
//! light at 8° and everything included. R(0°/45°) and R(45°/0°) are π·f, mean over the azimuths (annular geometries of CIE 15).
//! Values are weighed by the uncertainty of all of them together, as if it were the same in all: what calibration leaves is. What has no
//! value is taken for the mean of what has, give or take the largest f that was seen: a highlight may hide there. Where more than a
//! hundredth of the hemisphere (a quarter of a ring) is missing there is no reflectance.

use std::f64::consts::PI;

use glam::DVec3;
use serde::Serialize;

use crate::brdf::Source;
use crate::hemisphere::direction::from_degrees;
use crate::hemisphere::disk::Disk;
use crate::store::StoreError;

/// Azimuths of the light for a hemisphere, and of a ring.
const AZIMUTHS: usize = 12;
const RING: usize = 72;
/// Cells along a side of the disk by which a model is integrated.
const CELLS: usize = 192;
/// Share that has to have values: of ∫ cosθo dωo, and of a ring.
const WHOLE: f64 = 0.99;
const WHOLE_RING: f64 = 0.75;

/// Where light comes from and where it is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Geometry {
    /// From this polar angle in degrees into the hemisphere, mean over the azimuths.
    Hemisphere(f64),
    /// From one polar angle to another, degrees, one of them 0; mean over the azimuths.
    Ring(f64, f64),
}

impl std::fmt::Display for Geometry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Hemisphere(deg) => write!(f, "{deg}°/h"),
            Self::Ring(from, to) => write!(f, "{from}°/{to}°"),
        }
    }
}

/// A reflectance.
#[derive(Clone, Debug, Serialize)]
pub struct Reflected {
    /// The geometry: light/view.
    pub geometry: String,
    /// Reflectance (of a hemisphere) or reflectance factor (of a ring) per channel; `None` where too little has values.
    pub value: Option<[f64; 3]>,
    /// Its standard uncertainty (k = 1); `None` for what states none.
    pub standard_uncertainty: Option<[f64; 3]>,
    /// Share of the hemisphere (weighed by the cosine), or of the ring, that has values.
    pub seen: f64,
}

/// f and σ in sr⁻¹ of one pair.
type One = ([f64; 3], [f64; 3]);

/// The reflectance of `source` in the `geometry`.
///
/// # Errors
/// [`StoreError`] if a file cannot be read.
pub fn reflected(source: &Source, geometry: Geometry) -> Result<Reflected, StoreError> {
    let (pairs, whole) = match geometry {
        Geometry::Hemisphere(theta_deg) => (hemisphere(source, theta_deg), WHOLE),
        Geometry::Ring(from_deg, to_deg) => (ring(from_deg, to_deg), WHOLE_RING),
    };
    let directions: Vec<(DVec3, DVec3)> = pairs.iter().map(|(pair, _)| *pair).collect();
    let found = found(source, &directions)?;
    let weights = || pairs.iter().map(|(_, weight)| *weight);
    let seen: f64 = weights()
        .zip(&found)
        .filter_map(|(w, one)| one.and(Some(w)))
        .sum();
    let share = seen / weights().sum::<f64>();
    let mut mean = [0.0; 3];
    let (mut sigma, mut most) = (mean, mean);
    for (weight, (f, own)) in weights()
        .zip(&found)
        .filter_map(|(w, one)| Some((w / seen, (*one)?)))
    {
        for channel in 0..3 {
            mean[channel] += weight * f[channel];
            sigma[channel] += weight * own[channel];
            most[channel] = f64::max(most[channel], f[channel]);
        }
    }
    let is_whole = share >= whole;
    let uncertain = matches!(source, Source::Measured(_)) || share < 1.0 - 1e-9;
    let all = [0, 1, 2].map(|channel| PI * sigma[channel].hypot((1.0 - share) * most[channel]));
    Ok(Reflected {
        geometry: geometry.to_string(),
        value: is_whole.then(|| mean.map(|f| PI * f)),
        standard_uncertainty: (is_whole && uncertain).then_some(all),
        seen: share,
    })
}

/// Pairs of directions with their weights: cosθo of all cells of the disk, for each azimuth of the light.
fn hemisphere(source: &Source, theta_deg: f64) -> Vec<((DVec3, DVec3), f64)> {
    let disk = match source {
        Source::Measured(brdf) => brdf.disk(),
        Source::Known(_) => Disk::new(CELLS),
    };
    let outgoing: Vec<DVec3> = (0..disk.len()).filter_map(|cell| disk.direction(cell)).collect();
    let azimuths = if theta_deg == 0.0 { 1 } else { AZIMUTHS };
    (0..azimuths)
        .flat_map(|k| {
            let wi = from_degrees(theta_deg, 360.0 * k as f64 / azimuths as f64);
            outgoing.iter().map(move |wo| ((wi, *wo), wo.z))
        })
        .collect()
}

/// Pairs of directions around a ring.
fn ring(from_deg: f64, to_deg: f64) -> Vec<((DVec3, DVec3), f64)> {
    (0..RING)
        .map(|k| {
            let phi = 360.0 * k as f64 / RING as f64;
            ((from_degrees(from_deg, phi), from_degrees(to_deg, phi)), 1.0)
        })
        .collect()
}

fn found(source: &Source, directions: &[(DVec3, DVec3)]) -> Result<Vec<Option<One>>, StoreError> {
    let wide = |f: [f32; 3]| f.map(f64::from);
    Ok(match source {
        Source::Measured(brdf) => {
            let stated = brdf.stated(directions)?.into_iter();
            stated
                .map(|stated| stated.ok().map(|stated| (wide(stated.f), wide(stated.sigma))))
                .collect()
        }
        Source::Known(_) => {
            let values = source.reflectance().values(directions)?.into_iter();
            let number = |f: &[f64; 3]| f.iter().all(|f| f.is_finite());
            values
                .map(|f| f.ok().map(wide).filter(number).map(|f| (f, [0.0; 3])))
                .collect()
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::sample::{albedo, parse};
    use crate::judge::evaluate::tests::file;
    use crate::store::provenance::Provenance;

    #[test]
    fn a_model_reflects_its_directional_albedo() {
        for spec in [
            "lambert:0.6,0.3,0.1",
            "ggx:satin",
            "ward:rd=0.2,rs=0.2,ax=0.2,ay=0.3",
        ] {
            let source = Source::Known(parse(spec).unwrap());
            let sample = parse(spec).unwrap();
            let found = reflected(&source, Geometry::Hemisphere(8.0)).unwrap();
            let expected: Vec<[f64; 3]> = (0..AZIMUTHS)
                .map(|k| albedo(sample.as_ref(), from_degrees(8.0, 30.0 * k as f64)))
                .collect();
            for (channel, value) in found.value.unwrap().into_iter().enumerate() {
                let mean = expected.iter().map(|one| one[channel]).sum::<f64>() / AZIMUTHS as f64;
                assert!((value / mean - 1.0).abs() < 5e-3, "{spec}: {value} {mean}");
            }
            assert!(found.standard_uncertainty.is_none());
        }
        let white = Source::Known(parse("lambert:0.6").unwrap());
        for geometry in [Geometry::Ring(0.0, 45.0), Geometry::Ring(45.0, 0.0)] {
            let [value, ..] = reflected(&white, geometry).unwrap().value.unwrap();
            assert!((value - 0.6).abs() < 1e-6, "{geometry}: {value}");
        }
    }

    #[test]
    fn what_is_missing_is_uncertain_by_the_brightest_that_was_seen_and_much_of_it_is_no_reflectance() {
        let scratch = tempfile::tempdir().unwrap();
        let at = |name: &str| scratch.path().join(name);
        // None, one or thirty of the cells are missing, from the horizon on; one is ten times as bright.
        let disk = Disk::new(12);
        let seen: Vec<usize> = (0..disk.len())
            .filter(|cell| disk.direction(*cell).is_some())
            .collect();
        for (number, missing) in [0, 1, 30].into_iter().enumerate() {
            let brdf = file(&at(&number.to_string()), 1, &mut |_, cell| {
                let f = if cell == 66 { 1.0 } else { 0.1 };
                (!seen[..missing].contains(&cell)).then(|| (vec![f], 0.001, Provenance::Measured))
            });
            let found = reflected(&Source::Measured(Box::new(brdf)), Geometry::Hemisphere(11.25)).unwrap();
            assert_eq!(found.value.is_some(), missing < 30, "{found:?}");
            if missing < 30 {
                let [u, ..] = found.standard_uncertainty.unwrap();
                let largest = PI * (1.0 - found.seen);
                assert!(u >= largest && u < largest + 0.02, "{found:?}");
            }
        }
    }
}
