//! Images on the outgoing disk, and what their neighbours say of them.
//!
//! # Design
//! Two rules predict f at an incident direction from captured ones with barycentric weights: *direct*, at the same
//! outgoing direction, and *half vector*, where each neighbour is looked up at the outgoing direction that has the same
//! half vector, so that a highlight moves instead of cross-fading. An image is judged by the better of the two.

use glam::DVec3;
use rayon::prelude::*;

use crate::hemisphere::direction::angle_between;
use crate::hemisphere::disk::Disk;
use crate::hemisphere::incident::{DirectionList, IncidentSet, Neighbours};
use crate::hemisphere::judged::is_judged;

/// Luminance of one capture on the outgoing disk.
pub(super) struct Image {
    /// f in sr⁻¹ per cell; NaN where there is none.
    pub(super) f: Vec<f32>,
    /// Mean over the cells of the noise variance of f, in sr⁻².
    pub(super) noise: f64,
}

/// How well the neighbours of a captured direction predict its image.
#[derive(Clone, Copy, Debug)]
pub(super) struct LeftOut {
    /// Mean squared error of f·cosθi at exposure 1, clipped to 1, without the part of the noise.
    pub(super) mse: f64,
    /// Mean squared error of the image itself by noise, in the same unit.
    pub(super) noise_mse: f64,
    /// Mean squared distance to what it was predicted from, weighted, in rad².
    pub(super) spacing: f64,
}

/// Rule of prediction.
#[derive(Clone, Copy)]
enum Rule {
    Direct,
    HalfVector,
}

/// A captured image: its incident direction, itself, and its weight.
pub(super) type Part<'a> = (DVec3, &'a Image, f64);

/// Every second cell of every second row of the disk, as far as errors are judged: enough to go by.
pub(super) fn judged_cells(disk: Disk) -> Vec<(usize, DVec3)> {
    (0..disk.len())
        .filter(|cell| (cell % disk.size()).is_multiple_of(2) && (cell / disk.size()).is_multiple_of(2))
        .filter_map(|cell| Some((cell, disk.direction(cell).filter(|w| is_judged(*w))?)))
        .collect()
}

/// For each of the captured directions, how well the others predict it; `None` where they have no cell in common.
pub(super) fn leave_one_out(
    angles_deg: &[[f64; 2]],
    set: &IncidentSet,
    images: &[Image],
    disk: Disk,
    cells: &[(usize, DVec3)],
) -> Vec<Option<LeftOut>> {
    (0..images.len())
        .into_par_iter()
        .map(|index| {
            let w = set.direction(index);
            let parts: Vec<Part> = others(angles_deg, set, index)
                .into_iter()
                .filter(|(_, weight)| *weight > 0.0)
                .map(|(other, weight)| (set.direction(other), &images[other], weight))
                .collect();
            left_out(w, &images[index], &parts, disk, cells)
        })
        .collect()
}

/// Weights of the other directions at direction `index`.
fn others(angles_deg: &[[f64; 2]], set: &IncidentSet, index: usize) -> Neighbours {
    // What is around it triangulates the hole that it leaves.
    let adjacent = set.adjacent(index);
    let around: Vec<[f64; 2]> = adjacent.iter().map(|&other| angles_deg[other]).collect();
    match DirectionList::new(&around) {
        Ok(list) => list
            .neighbours(set.direction(index))
            .map(|(place, weight)| (adjacent[place], weight)),
        // Two at the edge.
        Err(_) => [
            (adjacent[0], 1.0),
            (adjacent[0], 0.0),
            (adjacent[0], 0.0),
            (adjacent[0], 0.0),
        ],
    }
}

fn left_out(
    w: DVec3,
    image: &Image,
    parts: &[Part],
    disk: Disk,
    cells: &[(usize, DVec3)],
) -> Option<LeftOut> {
    let noise_mse = image.noise * w.z * w.z;
    let of_parts: f64 = parts
        .iter()
        .map(|(_, image, weight)| image.noise * weight * weight)
        .sum();
    let mse = mse(w, image, parts, disk, cells)?;
    Some(LeftOut {
        mse: (mse - noise_mse - of_parts * w.z * w.z).max(0.0),
        noise_mse,
        spacing: parts
            .iter()
            .map(|(other, _, weight)| weight * angle_between(*other, w).powi(2))
            .sum(),
    })
}

/// Mean squared difference between `image` at incident direction `w` and what `parts` predict, by the better rule; `None` if
/// they have no cell in common (everything saturated, or nothing seen).
pub(super) fn mse(
    w: DVec3,
    image: &Image,
    parts: &[Part],
    disk: Disk,
    cells: &[(usize, DVec3)],
) -> Option<f64> {
    let shown = |f: f64| (f * w.z).clamp(0.0, 1.0);
    // Where only one of the rules has its cells it is the only one that can be used, which says nothing of the other.
    let (mut both, mut direct_alone) = ([0.0; 3], [0.0; 2]);
    for &(cell, wo) in cells {
        let truth = f64::from(image.f[cell]);
        if truth.is_nan() {
            continue;
        }
        let Some(a) = predicted(Rule::Direct, w, wo, parts, disk) else {
            continue;
        };
        let direct = (shown(a) - shown(truth)).powi(2);
        if let Some(b) = predicted(Rule::HalfVector, w, wo, parts, disk) {
            both[0] += direct;
            both[1] += (shown(b) - shown(truth)).powi(2);
            both[2] += 1.0;
        } else {
            direct_alone[0] += direct;
            direct_alone[1] += 1.0;
        }
    }
    let [direct, half, count] = both;
    if count > 0.0 {
        return Some(f64::min(direct, half) / count);
    }
    let [direct, count] = direct_alone;
    (count > 0.0).then(|| direct / count)
}

/// f for incident direction `w` and outgoing direction `wo`, in sr⁻¹.
fn predicted(rule: Rule, w: DVec3, wo: DVec3, parts: &[Part], disk: Disk) -> Option<f64> {
    let half = (w + wo).normalize();
    let (mut sum, mut total) = (0.0, 0.0);
    for &(wi, image, weight) in parts {
        let wo = match rule {
            Rule::Direct => wo,
            Rule::HalfVector => 2.0 * half.dot(wi) * half - wi,
        };
        if let Some(f) = look_up(image, wo, disk) {
            sum += weight * f;
            total += weight;
        }
    }
    (total > 0.5).then(|| sum / total)
}

/// The bilinear mean of the cells around `wo`; `None` where one of them has no value.
fn look_up(image: &Image, wo: DVec3, disk: Disk) -> Option<f64> {
    disk.neighbours(wo)?
        .into_iter()
        .filter(|(_, weight)| *weight > 0.0)
        .map(|(cell, weight)| {
            let f = f64::from(image.f[cell]);
            (!f.is_nan()).then_some(weight * f)
        })
        .sum()
}
