//! What the captures say of the rules: each image is predicted from those around it.
//!
//! # Design
//! An image that is left out is predicted from the adjacent ones with weights that reproduce linear functions of the
//! direction (weighted least squares). Read back, it is predicted from the images around the outgoing direction as any
//! look-up is: with the directions exchanged they are not the image itself. That error therefore holds what
//! interpolation, noise and a lack of reciprocity (of the material or of the measurement) do together.
//!
//! BranchErrors are those of luminance f·cosθi, compressed as by an eye, or a display, that adapts: dim parts count too.
//! Some 10⁵ samples, spread over images and cells, are enough; they are drawn by fixed strides.

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::BranchErrors;
use super::blend::{BACK, BRANCHES, Tally};
use super::captures::{Captures, Cells, ImageOf, Readable as _};
use super::lookup::captured;
use super::rule::{Captured, DIRECT, Query, RULES};
use crate::store::StoreError;

/// Images that are left out, at most.
const IMAGES: usize = 512;
/// Samples in all, about.
const SAMPLES: usize = 160_000;
/// f·cosθi that counts as middle grey.
const GREY: f64 = 0.3;

/// Luminance (BT.601).
const LUMINANCE: Vec3 = Vec3::new(0.299, 0.587, 0.114);

/// What an error of f counts, relative to white, for incident direction `wi` where f is `f`.
pub(super) fn shown(wi: DVec3, f: f64) -> f64 {
    wi.z / (GREY + wi.z * f.max(0.0))
}

/// One sample: a pair of directions that was captured, and what the branches say of it.
struct Probe {
    row: usize,
    cell: usize,
    wi: DVec3,
    wo: DVec3,
    truth: Option<f32>,
    /// Adjacent images and those around the outgoing direction, with weights.
    parts: Vec<(usize, f32, bool)>,
    /// Luminance × weight, and weight.
    sums: [(f32, f32); BRANCHES],
}

impl Probe {
    fn gather(
        &mut self,
        cells: &Cells,
        captured: &[Captured],
        group: &std::ops::Range<usize>,
        image: ImageOf,
    ) {
        if group.contains(&self.row) {
            self.truth = image(self.row).and_then(|image| {
                let has_value = image.provenance.is_none_or(|codes| codes[self.cell] != 0);
                has_value.then(|| image.at(self.cell).dot(LUMINANCE))
            });
        }
        for &(row, weight, back) in self.parts.iter().filter(|part| group.contains(&part.0)) {
            let Some(image) = image(row) else { continue };
            let (pair, first) = if back {
                ((self.wo, self.wi), BACK)
            } else {
                ((self.wi, self.wo), 0)
            };
            Query::new(pair, |_| true).readings(&captured[row], |reading| {
                let read = image.read(cells, reading.wo);
                let luminance = weight * read.value.dot(LUMINANCE);
                for rule in reading.rules.clone() {
                    let sum = &mut self.sums[first + rule];
                    sum.0 += luminance * reading.factor(rule) as f32;
                    sum.1 += weight * read.weight;
                }
            });
        }
    }

    /// What every branch is wrong by, relative to white; `None` where nothing can be compared.
    fn errors(&self) -> Option<[f64; BRANCHES]> {
        let truth = f64::from(self.truth?);
        if self.sums[DIRECT].1 < 0.5 {
            return None;
        }
        let shown = shown(self.wi, truth);
        Some(self.sums.map(|(sum, weight)| {
            // A branch that says nothing is wrong by all.
            let predicted = if weight > 0.5 {
                f64::from(sum / weight)
            } else {
                0.0
            };
            shown * (predicted - truth)
        }))
    }
}

/// Weights of `others` that reproduce functions linear in the direction at `w`; near ones count more.
fn linear_weights(w: DVec3, others: &[DVec3]) -> Vec<f64> {
    let (a, b) = w.any_orthonormal_pair();
    let rows: Vec<(DVec3, f64)> = others
        .iter()
        .map(|&other| {
            let near = 1.0 / (other - w).length_squared().max(1e-12);
            (DVec3::new(1.0, other.dot(a), other.dot(b)), near)
        })
        .collect();
    let mut normal = DMat3::ZERO;
    for &(row, near) in &rows {
        normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z) * near;
    }
    // All on one side or in one line: rather the mean than an extrapolation.
    let ridge =
        DMat3::from_diagonal(DVec3::new(0.0, 1.0, 1.0)) * (1e-3 * normal.x_axis.x * mean_square(&rows));
    let solved = (normal + ridge).inverse() * DVec3::X;
    rows.iter().map(|&(row, near)| near * row.dot(solved)).collect()
}

/// Mean squared distance of the others, weighted.
fn mean_square(rows: &[(DVec3, f64)]) -> f64 {
    let sum: f64 = rows
        .iter()
        .map(|(row, near)| near * (row.y * row.y + row.z * row.z))
        .sum();
    sum / rows.iter().map(|row| row.1).sum::<f64>()
}

fn probes(captures: &impl Captures) -> Vec<Probe> {
    let set = captures.set();
    let captured: Vec<usize> = (0..set.len()).filter(|&row| captures.is_captured(row)).collect();
    let disk = captures.cells().disk;
    let directions: Vec<(usize, DVec3)> = (0..disk.len())
        .filter_map(|cell| Some((cell, disk.direction(cell)?)))
        .collect();
    let every = captured.len().div_ceil(IMAGES).max(1);
    let images = captured.len().div_ceil(every).max(1);
    // A stride that is odd against the disk's rows spreads over it; each image begins elsewhere.
    let stride = (directions.len() * images / SAMPLES).max(1) | 1;
    captured
        .into_iter()
        .step_by(every)
        .enumerate()
        .flat_map(|(begin, row)| {
            let wi = set.direction(row);
            let mut adjacent = set.adjacent(row);
            adjacent.retain(|&other| captures.is_captured(other));
            let around: Vec<DVec3> = adjacent.iter().map(|&other| set.direction(other)).collect();
            let weights = linear_weights(wi, &around);
            let forth: Vec<(usize, f32, bool)> = adjacent
                .into_iter()
                .zip(weights)
                .map(|(other, weight)| (other, weight as f32, false))
                .collect();
            let enough = forth.len() >= 2;
            directions
                .iter()
                .skip(begin % stride)
                .step_by(stride)
                .filter(move |_| enough)
                .map(|&(cell, wo)| {
                    let back = set.neighbours(wo).into_iter().filter(|other| other.1 > 0.0);
                    let back = back.map(|(other, weight)| (other, weight as f32, true));
                    Probe {
                        row,
                        cell,
                        wi,
                        wo,
                        truth: None,
                        parts: forth.iter().copied().chain(back).collect(),
                        sums: [(0.0, 0.0); BRANCHES],
                    }
                })
                .collect::<Vec<_>>()
        })
        .collect()
}

/// The errors of all branches ([`RULES`] forth and back) by region; `None` if there are too few captures to tell.
///
/// # Errors
/// [`StoreError`] if the captures cannot be read.
pub(crate) fn learn(captures: &impl Captures) -> Result<Option<BranchErrors>, StoreError> {
    debug_assert_eq!(BRANCHES, 2 * RULES.len());
    let mut probes = probes(captures);
    let mut wanted = vec![false; captures.set().len()];
    for probe in &probes {
        wanted[probe.row] = true;
        for part in &probe.parts {
            wanted[part.0] = true;
        }
    }
    let captured = captured(captures);
    captures.scan(&wanted, &mut |group, image| {
        probes
            .par_iter_mut()
            .for_each(|probe| probe.gather(captures.cells(), &captured, &group, image));
    })?;
    // One after the other: sums of floating-point numbers must not depend on the number of threads.
    let mut tally = Tally::new();
    for probe in &probes {
        if let Some(errors) = probe.errors() {
            tally.add(probe.wi, probe.wo, &errors);
        }
    }
    Ok(tally.errors())
}
