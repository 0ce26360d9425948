//! What the mean of repeats says of itself.

use std::collections::BTreeSet;

use serde_json::{Map, Value, json};

use crate::assemble::like::{lineage_of, measured_with};
use crate::brdf::{
    Azimuth, BANDS, Brdf, BrdfError, CAUSES, COMMON_UNCERTAINTY, DIRECTION_UNCERTAINTY, FIELD_UNCERTAINTY,
    LAMP_LIGHT, LINEAGE, evidence,
};
use crate::judge::repeats::Repeats;
use crate::judge::repeats::origins::{CALIBRATION, CLASS_OF, variance};

/// Attribute: how many were combined, and how many pairs of directions so many of them have.
const COMBINED: &str = "combined";
/// Attributes of single captures that a mean has only where all have the same.
const SINGLE: [&str; 6] = ["exposure_s", "light", "rig", LAMP_LIGHT, "incident_grid", BANDS];
/// Attributes of files that were filled or merged, whose names are not those of the mean.
const FILLED: [&str; 2] = ["filled", "merged_with"];

/// The attributes of the mean of `all`; null ones take away what the first has.
pub(super) fn of(all: &[&Brdf], found: &Repeats) -> Result<Map<String, Value>, BrdfError> {
    let mut facts = azimuth(all).attributes();
    facts.insert(LINEAGE.to_owned(), lineage_of("combine", all)?);
    let captures = evidence::captures_of(all)?;
    if !captures.is_empty() {
        facts.insert(evidence::CAPTURES.to_owned(), json!(captures));
    }
    facts.insert(
        COMBINED.to_owned(),
        json!({ "measurements": all.len(), "pairs_by_measurements": found.by_count }),
    );
    facts.extend(FILLED.map(|name| (name.to_owned(), Value::Null)));
    for name in SINGLE {
        let first = all[0].attributes().get(name);
        if all.iter().any(|brdf| brdf.attributes().get(name) != first) {
            facts.insert(name.to_owned(), Value::Null);
        }
    }
    facts.extend(measured_with(all));
    let stated =
        |of: &dyn Fn(&Brdf) -> Option<f64>| all.iter().map(|brdf| of(brdf)).collect::<Option<Vec<f64>>>();
    let mean = |amounts: &[f64], class: usize| mean_of(amounts, &found.origins.mean[class]);
    let fields = stated(&Brdf::field_uncertainty).map(|each| mean(&each, CALIBRATION));
    facts.insert(FIELD_UNCERTAINTY.to_owned(), json!(fields));
    // The geometry of different calibrations may be the same one.
    let directions = [0, 1].map(|end| stated(&|brdf| Some(brdf.direction_uncertainty_deg()?[end])));
    let directions = match directions {
        [Some(outgoing), Some(incident)] => {
            Some([outgoing, incident].map(|each| mean_of(&each, &vec![0; each.len()])))
        }
        _ => None,
    };
    facts.insert(DIRECTION_UNCERTAINTY.to_owned(), json!(directions));
    let common = stated(&Brdf::common_uncertainty).map(|each| {
        let standard = CAUSES
            .iter()
            .position(|cause| *cause == "standard")
            .unwrap_or_default();
        let by_standard: Vec<f64> = all
            .iter()
            .zip(&each)
            .map(|(brdf, all)| by(brdf, standard).min(*all))
            .collect();
        let others: Vec<f64> = each
            .iter()
            .zip(&by_standard)
            .map(|(all, by)| (all * all - by * by).max(0.0).sqrt())
            .collect();
        mean(&by_standard, CLASS_OF[standard]).hypot(mean(&others, CALIBRATION))
    });
    facts.insert(COMMON_UNCERTAINTY.to_owned(), json!(common));
    Ok(facts)
}

/// Standard uncertainty of the mean of errors of these `amounts`, of which those of a group are the same.
fn mean_of(amounts: &[f64], groups: &[usize]) -> f64 {
    let mut room = vec![0.0; amounts.len()];
    variance(groups, amounts.iter().copied().enumerate(), &mut room).sqrt() / amounts.len() as f64
}

/// Relative standard uncertainty of `brdf` by a cause: root mean square over the regions of its budget.
fn by(brdf: &Brdf, cause: usize) -> f64 {
    let squares: Vec<f64> = brdf
        .budget()
        .iter()
        .map(|one| one.relative * one.relative * one.shares[cause])
        .filter(|square| square.is_finite())
        .collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

/// Where φ = 0 of the mean lies: as in all, as uncertain as in the worst known.
fn azimuth(all: &[&Brdf]) -> Azimuth {
    let worst = |of: fn(&Azimuth) -> Option<f64>| {
        let each: Option<Vec<f64>> = all.iter().map(|brdf| of(brdf.azimuth())).collect();
        each.and_then(|each| each.into_iter().reduce(f64::max))
    };
    let models: BTreeSet<_> = all.iter().map(|brdf| brdf.azimuth().model.clone()).collect();
    Azimuth {
        deg: all[0].azimuth().deg,
        model: models.into_iter().flatten().next(),
        standard_uncertainty_deg: worst(|azimuth| azimuth.standard_uncertainty_deg),
        holder_uncertainty_deg: worst(|azimuth| azimuth.holder_uncertainty_deg),
    }
}
