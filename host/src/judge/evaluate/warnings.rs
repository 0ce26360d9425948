//! What an evaluation cannot state, in sentences.

use super::{Evaluation, Quantile};
use crate::hemisphere::judged::{JUDGED_THETA_DEG, RECIPROCAL_THETA_DEG};
use crate::instrument::calibration::Standard;

/// One sentence for each figure that is none, or found from a part where only the whole has a meaning.
pub(super) fn warnings(found: &Evaluation) -> Vec<String> {
    let mut all: Vec<String> = found.standards.iter().filter_map(Standard::warning).collect();
    let judged = format!("with θ ≤ {JUDGED_THETA_DEG}° both ways");
    if found.measured_samples == 0 {
        all.push(
            "nothing was measured: no sample has a value, and every figure but the coverage is none"
                .to_owned(),
        );
        return all;
    }
    if found.coverage.is_none() {
        all.push(format!(
            "coverage: none, the file has no pair of directions {judged}"
        ));
    }
    match found.median_relative_sigma {
        Quantile::None => all.push(format!(
            "noise: none, fewer than two samples {judged} were measured themselves"
        )),
        Quantile::Above(_) => all.push(format!(
            "noise: no number, in half of the samples {judged} or more f does not stand out of its uncertainty"
        )),
        Quantile::At(_) => {}
    }
    if found.reciprocity_residual_median.is_none() {
        all.push(format!(
            "reciprocity: none, of the random pairs of directions with θ ≤ {RECIPROCAL_THETA_DEG}° {} were measured both \
             ways with f above 0",
            found.reciprocity_pairs
        ));
    }
    let parts = found
        .albedo
        .iter()
        .filter(|albedo| albedo.albedo.is_none())
        .count();
    if parts > 0 {
        all.push(format!(
            "albedo: none at {parts} of {} polar angles, where less than 99 % of the hemisphere has values; `fill` closes \
             the gaps",
            found.albedo.len()
        ));
    } else if found.albedo.is_empty() {
        all.push("albedo: none, there is no incident direction in reach".to_owned());
    }
    let brightest = found.albedo.iter().filter_map(|albedo| {
        let (part, uncertainty) = (albedo.measured_part?, albedo.part_uncertainty?);
        (part > 1.0 + 3.0 * uncertainty).then_some((part, albedo.theta_deg))
    });
    if let Some((part, theta_deg)) = brightest.max_by(|a, b| a.0.total_cmp(&b.0)) {
        all.push(format!(
            "energy: {part:.3} of the light at θi = {theta_deg}° comes back, which is more than there is"
        ));
    }
    if let Some(against) = &found.against_reference {
        if against.scored_samples == 0 {
            let why = if against.samples == 0 {
                format!("no sample {judged} was measured where the reference has a value")
            } else {
                format!(
                    "the reference is dark wherever the {} samples were measured (below 1 % of its median, 0.01·albedo/π, \
                     or 0)",
                    against.samples
                )
            };
            all.push(format!("error and PSNR: none, {why}"));
        } else if against.relative_error.p99.value().is_none() {
            all.push(format!(
                "error: {} scored samples are too few for all quantiles",
                against.scored_samples
            ));
        }
    }
    all
}
