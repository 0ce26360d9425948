//! What part of the sample is seen and lit, as calibration found it.
//!
//! # Design
//! Pixels and spots have patches on the sample ([`Patch`]); how much of the light of one is on the other, a share, depends on
//! where the sample stands along the rays, on the pupils, and on how evenly the projector's pupil shines. These six numbers a
//! standard tells, beside light and throughput (`calibrate photometry`): no product of both can do what they do. What of them
//! does not show stays as the rig file has it, within [`SeenPart::TOLERANCES`].
//!
//! Where an edge of a patch may lie is uncertain by their covariance and by the ellipses that patches are taken for. An edge
//! that is three standard uncertainties farther in must change little: what it changes by more than [`WORST`] of them, or of which
//! too little is lit, has no value. An edge is on one side, and far from linear: its variance is a sum over places near and far on both
//! sides ([`PLACES`]), as by a quadrature of Gauss and Hermite.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};
use nalgebra::{Matrix6, SymmetricEigen, Vector6};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::base::median::median;
use crate::instrument::frame_format::pixel_centre;
use crate::instrument::optics::{LitPatch, Patch, View};
use crate::instrument::rig::Rig;

/// How many numbers describe it.
pub(crate) const UNKNOWNS: usize = 6;
/// What the falloff is taken for before.
const FALLOFF: f64 = 0.05;
/// Relative standard uncertainty of the size of a patch of light as an ellipse.
pub(crate) const ELLIPSE: f64 = 0.04;
/// An edge is looked for so many standard uncertainties from where it is.
pub(crate) const FAR: f64 = 3.0;
/// The least share that gives a value, and the largest relative standard uncertainty of one.
const LEAST: f64 = 0.4;
const WORST: f64 = 0.1;

/// Places along each axis of the covariance, in standard uncertainties, and what the square of a change there counts in the variance:
/// exact where the change is linear, and to 3 % where it begins at up to one standard uncertainty and is linear from there on.
const PLACES: [(f64, f64); 4] = [
    (FAR, 1.0 / 54.0),
    (-FAR, 1.0 / 54.0),
    (1.0, 1.0 / 3.0),
    (-1.0, 1.0 / 3.0),
];
/// Doubts about a share: those places along each axis, and the last one.
const ALONG: usize = PLACES.len() * UNKNOWNS;
const DOUBTS: usize = ALONG + 1;

/// Numbers in units of [`SeenPart::TOLERANCES`].
pub(crate) type Unknowns = [f64; UNKNOWNS];

/// What calibration found of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeenPart {
    /// Where the sample is, less where the rig has it, mirror frame, metres.
    pub offset_m: [f64; 3],
    /// Diameters of the pupils of camera and projector, metres.
    pub pupils_m: [f64; 2],
    /// By which share the edge of what is lit is darker than its middle.
    pub falloff: f64,
    /// Covariance, [row, column], of offsets (metres), logarithms of the pupils, and falloff.
    pub covariance: [[f64; UNKNOWNS]; UNKNOWNS],
}

impl SeenPart {
    /// How well its numbers are known before (k = 1): the sample's place along the mirror's x, y and z, metres; logarithms of
    /// the diameters of both pupils, which f-numbers marked to a third of a stop tell; falloff.
    pub(crate) const TOLERANCES: [f64; UNKNOWNS] = [3e-3, 3e-3, 3e-3, 0.06, 0.06, 0.1];

    /// How well samples are put where they belong along their plane (k = 1), metres.
    pub(crate) const ALONG_M: f64 = 1e-3;

    /// What the shapes of pupils, the places of lenses and the seating of samples, each of which lies at a height of its own, leave of
    /// what is found, in the same order (k = 1).
    pub(crate) const LEFT: [f64; UNKNOWNS] = [1.4e-4, 1.4e-4, 1.4e-4, 0.03, 0.03, 0.02];

    /// As `rig` has it; `None` if it says nothing of the pupils.
    pub(crate) fn of(rig: &Rig) -> Option<Self> {
        let pupils_m = [rig.camera.lens.pupil_m, rig.projector.lens.pupil_m];
        pupils_m.iter().all(|pupil_m| *pupil_m > 0.0).then(|| Self {
            offset_m: [0.0; 3],
            pupils_m,
            falloff: FALLOFF,
            covariance: std::array::from_fn(|row| {
                std::array::from_fn(|column| {
                    if row == column {
                        Self::TOLERANCES[row].powi(2)
                    } else {
                        0.0
                    }
                })
            }),
        })
    }

    /// What is moved `by` so many tolerances.
    pub(crate) fn moved(&self, by: &Unknowns) -> Self {
        let step = |at: usize| by[at] * Self::TOLERANCES[at];
        Self {
            offset_m: std::array::from_fn(|axis| self.offset_m[axis] + step(axis)),
            pupils_m: std::array::from_fn(|device| self.pupils_m[device] * step(3 + device).exp()),
            falloff: (self.falloff + step(5)).clamp(0.0, 1.0),
            covariance: self.covariance,
        }
    }

    /// The same with the sample displaced `by_m` more, mirror frame, metres.
    pub(crate) fn displaced(&self, by_m: DVec3) -> Self {
        Self {
            offset_m: (DVec3::from_array(self.offset_m) + by_m).to_array(),
            ..self.clone()
        }
    }

    /// By how many tolerances it differs from what `rig` has.
    pub(crate) fn beside_nominal(&self, rig: &Rig) -> Unknowns {
        let nominal = [rig.camera.lens.pupil_m, rig.projector.lens.pupil_m];
        let by = |at: usize| match at {
            0..3 => self.offset_m[at],
            3 | 4 => (self.pupils_m[at - 3] / nominal[at - 3]).ln(),
            _ => self.falloff - FALLOFF,
        };
        std::array::from_fn(|at| by(at) / Self::TOLERANCES[at])
    }

    /// With the covariance that unknowns in units of tolerances have, and what a model leaves besides.
    pub(crate) fn with_covariance(mut self, of: impl Fn(usize, usize) -> f64) -> Self {
        self.covariance = std::array::from_fn(|row| {
            std::array::from_fn(|column| {
                let own = if row == column {
                    Self::LEFT[row].powi(2)
                } else {
                    0.0
                };
                own + of(row, column) * Self::TOLERANCES[row] * Self::TOLERANCES[column]
            })
        });
        self
    }

    /// What is wrong with it: the field, and what was expected.
    pub(crate) fn flaw(&self) -> Option<(&'static str, &'static str)> {
        let is_near = self.offset_m.iter().all(|m| m.abs() <= 0.1);
        let is_pupil = self.pupils_m.iter().all(|m| *m > 0.0 && *m <= 1.0);
        let is_known = self.covariance.iter().flatten().all(|c| c.is_finite());
        match (is_near, is_pupil, is_known) {
            (false, ..) => Some(("offset_m", "numbers from -0.1 to 0.1")),
            (_, false, _) => Some(("pupils_m", "numbers above 0 up to 1")),
            (.., false) => Some(("covariance", "finite numbers")),
            _ => (!(0.0..=1.0).contains(&self.falloff)).then_some(("falloff", "a number from 0 to 1")),
        }
    }

    /// `rig` with it.
    fn rig(&self, rig: &Rig) -> Rig {
        let mut rig = rig.clone();
        for (offset, by) in rig.sample.offset_m.iter_mut().zip(self.offset_m) {
            *offset += by;
        }
        rig
    }

    /// The patches of all pixels of the camera of `rig`, row by row, and of light from the positions `projector_px` of its
    /// projector; `None` for what there is none of.
    pub(crate) fn patches(&self, rig: &Rig, projector_px: &[Option<DVec2>]) -> Patches {
        let rig = self.rig(rig);
        let [camera, projector] = [View::camera(&rig), View::projector(&rig)];
        let patch = |view: &View, at: DVec2, device: usize| -> Option<Patch> {
            view.patch(at.x, at.y, self.pupils_m[device]).ok()
        };
        let (width_px, height_px) = camera.size_px();
        Patches {
            seen: (0..width_px * height_px)
                .into_par_iter()
                .map(|index| patch(&camera, pixel_centre(index, width_px), 0))
                .collect(),
            lit: projector_px
                .iter()
                .map(|at| LitPatch::new(&patch(&projector, (*at)?, 1)?, self.falloff))
                .collect(),
            radius_m: rig.sample.radius_m,
        }
    }

    /// Area of the sample that pixels of the camera of `rig` see, those at the positions `pixels_px`: median, smallest and largest, mm².
    /// What a value is a mean over is that, or less where less is lit. `None` if none sees anything.
    pub(crate) fn area(&self, rig: &Rig, pixels_px: impl Iterator<Item = DVec2>) -> Option<MeasuredArea> {
        let camera = View::camera(&self.rig(rig));
        let sample_mm2 = PI * (1e3 * rig.sample.radius_m).powi(2);
        let patches = pixels_px.filter_map(|at| camera.patch(at.x, at.y, self.pupils_m[0]).ok());
        let areas = patches.map(|patch| (1e6 * PI * patch.axes_m.determinant().abs()).min(sample_mm2));
        let mut areas: Vec<f64> = areas.collect();
        areas.sort_by(f64::total_cmp);
        Some(MeasuredArea {
            median_mm2: *areas.get(areas.len() / 2)?,
            smallest_mm2: *areas.first()?,
            largest_mm2: *areas.last()?,
            // The covariance has logarithms of diameters.
            relative_uncertainty: (2.0 * self.covariance[3][3].max(0.0).sqrt()).hypot(ELLIPSE),
        })
    }

    /// Changes that edges are looked for at: [`PLACES`] along the axes of the covariance, and what ellipses do.
    fn doubts(&self) -> [Unknowns; DOUBTS] {
        let scaled = Matrix6::from_fn(|row, column| {
            self.covariance[row][column] / (Self::TOLERANCES[row] * Self::TOLERANCES[column])
        });
        let axes = SymmetricEigen::new(scaled);
        let along = |axis: usize, at: f64| -> Vector6<f64> {
            axes.eigenvectors.column(axis) * (at * axes.eigenvalues[axis].max(0.0).sqrt())
        };
        let mut smaller = [0.0; UNKNOWNS];
        smaller[4] = -FAR * ELLIPSE / Self::TOLERANCES[4];
        std::array::from_fn(|doubt| match doubt {
            ALONG.. => smaller,
            _ => along(doubt / PLACES.len(), PLACES[doubt % PLACES.len()].0).into(),
        })
    }
}

/// Area of the sample that camera pixels see.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasuredArea {
    /// Median over the pixels, mm².
    pub median_mm2: f64,
    /// That of the pixel that sees least.
    pub smallest_mm2: f64,
    /// That of the pixel that sees most.
    pub largest_mm2: f64,
    /// Relative standard uncertainty (k = 1) of them.
    pub relative_uncertainty: f64,
}

impl MeasuredArea {
    /// Of measurements of one sample together: from the smallest to the largest, as uncertain as the most uncertain; `None` of none.
    pub(crate) fn of_all(areas: &[Self]) -> Option<Self> {
        let middle = median(areas.iter().map(|area| area.median_mm2).collect())?;
        areas.iter().copied().reduce(|one, other| Self {
            median_mm2: middle,
            smallest_mm2: one.smallest_mm2.min(other.smallest_mm2),
            largest_mm2: one.largest_mm2.max(other.largest_mm2),
            relative_uncertainty: one.relative_uncertainty.max(other.relative_uncertainty),
        })
    }
}

impl std::fmt::Display for MeasuredArea {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{:.3} mm² ± {:.0} % (k = 1), {:.3} to {:.3} mm² by the direction of view",
            self.median_mm2,
            100.0 * self.relative_uncertainty,
            self.smallest_mm2,
            self.largest_mm2
        )
    }
}

/// Patches of pixels and of spots.
#[derive(Clone)]
pub(crate) struct Patches {
    seen: Vec<Option<Patch>>,
    lit: Vec<Option<LitPatch>>,
    radius_m: f64,
}

impl Patches {
    /// The share that is lit of what the pixel `seen` sees, by the spot `lit`; 0 where there is none.
    pub(crate) fn share(&self, lit: usize, seen: usize) -> f64 {
        let patches = self.seen[seen].as_ref().zip(self.lit[lit].as_ref());
        patches.map_or(0.0, |(seen, lit)| seen.lit(lit, self.radius_m))
    }
}

/// Shares with their uncertainties.
pub(crate) struct Shares {
    patches: Patches,
    doubts: [Patches; DOUBTS],
}

/// A share, and what each doubt makes of it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Share {
    share: f64,
    doubts: [f64; DOUBTS],
}

impl Shares {
    /// Of the pixels of the camera of `rig`, row by row, and of light from the directions `lit` (sample frame); calibration found
    /// `part`.
    pub(crate) fn new(part: &SeenPart, rig: &Rig, lit: &[Option<DVec3>]) -> Self {
        let projector = View::projector(rig);
        let projector_px: Vec<_> = lit.iter().map(|w| projector.pixel((*w)?).ok()).collect();
        let of = |part: &SeenPart| part.patches(rig, &projector_px);
        Self {
            patches: of(part),
            doubts: part.doubts().map(|by| of(&part.moved(&by))),
        }
    }

    /// That of the pixel `seen` in the light `lit`.
    pub(crate) fn share(&self, lit: usize, seen: usize) -> Share {
        Share {
            share: self.patches.share(lit, seen),
            doubts: std::array::from_fn(|doubt| self.doubts[doubt].share(lit, seen)),
        }
    }
}

impl Share {
    /// Adds `weight` times the `other`.
    pub(crate) fn add(&mut self, other: &Self, weight: f32) {
        let weight = f64::from(weight);
        self.share += weight * other.share;
        for (sum, other) in self.doubts.iter_mut().zip(other.doubts) {
            *sum += weight * other;
        }
    }

    /// The share and its relative standard uncertainty (k = 1); `None` where it gives no value.
    pub(crate) fn known(&self) -> Option<(f32, f32)> {
        if self.share < LEAST {
            return None;
        }
        let off2 = self.doubts.map(|doubt| (doubt / self.share - 1.0).powi(2));
        let (axes, smaller) = off2.split_at(ALONG);
        let (mut variance, mut farthest2) = (smaller[0] / (FAR * FAR), smaller[0]);
        for places in axes.chunks(PLACES.len()) {
            variance += places
                .iter()
                .zip(PLACES)
                .map(|(off2, (_, counts))| off2 * counts)
                .sum::<f64>();
            farthest2 += places.iter().copied().fold(0.0, f64::max);
        }
        (farthest2.sqrt() <= FAR * WORST).then_some((self.share as f32, variance.sqrt() as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;

    #[test]
    fn what_is_lit_in_part_is_uncertain_and_where_an_edge_may_be_there_is_no_value() {
        let rig = Rig::load("rcg-1-16bit").unwrap().with_image_size(64).unwrap();
        let mut part = SeenPart::of(&rig).unwrap().with_covariance(|_, _| 0.0);
        let camera = View::camera(&rig);
        let seen = |theta_deg: f64, phi_deg: f64| {
            let at = camera.pixel(from_degrees(theta_deg, phi_deg)).unwrap();
            at.y as usize * 64 + at.x as usize
        };
        let lit = [30.0, 60.0].map(|theta_deg| Some(from_degrees(theta_deg, 0.0)));
        let aligned = Shares::new(&part, &rig, &lit);
        let (share, relative) = aligned.share(0, seen(35.0, 90.0)).known().unwrap();
        // All of it is lit; the middle of the light falls off a little.
        assert!(share > 0.99 && relative < 0.01, "{share} {relative}");
        // A sample that stands 2 mm too high: 2 mm · tan 75° is beyond what is lit from 30°.
        part.offset_m = [0.0, 0.0, 2e-3];
        let high = Shares::new(&part, &rig, &lit);
        assert!(high.share(0, seen(75.0, 180.0)).known().is_none());
        // Near the normal it is not, and how far it is known decides.
        assert!(high.share(0, seen(35.0, 0.0)).known().is_some());
        let unknown = part.with_covariance(|row, column| f64::from(u8::from(row == column)));
        let unknown = Shares::new(&unknown, &rig, &lit);
        assert!(unknown.share(1, seen(65.0, 180.0)).known().is_none());
    }

    #[test]
    fn an_edge_counts_on_whichever_side_of_an_axis_it_is() {
        // Light that ends from so many standard uncertainties on, on one side, by 6 % for each.
        let share = |begins: f64, side: f64| {
            let mut doubts = [1.0; DOUBTS];
            for (doubt, (at, _)) in doubts[8..].iter_mut().zip(PLACES) {
                *doubt -= 0.06 * (side * at - begins).max(0.0);
            }
            Share { share: 1.0, doubts }
        };
        // By integrating over a normal distribution.
        for (begins, expected) in [(0.0, 0.5_f64.sqrt()), (0.5, 0.458), (1.0, 0.274)] {
            for side in [1.0, -1.0] {
                let (_, relative) = share(begins, side).known().unwrap();
                let expected = 0.06 * expected;
                assert!(
                    (f64::from(relative) / expected - 1.0).abs() < 0.05,
                    "{begins} {side}: {relative}"
                );
            }
        }
        // What is never far from an edge has no value.
        assert!(share(-2.5, 1.0).known().is_none() && share(-2.5, -1.0).known().is_none());
        let mut even = share(10.0, 1.0);
        for (doubt, (at, _)) in even.doubts[8..].iter_mut().zip(PLACES) {
            *doubt = 1.0 + 0.06 * at;
        }
        let (_, relative) = even.known().unwrap();
        assert!((relative - 0.06).abs() < 1e-6, "{relative}");
        // Every doubt has its opposite, up to the ellipses.
        let rig = Rig::load("rcg-3").unwrap();
        let part = SeenPart::of(&rig)
            .unwrap()
            .with_covariance(|row, column| if row == column { 0.04 } else { 0.01 });
        for sides in part.doubts()[..ALONG].chunks(2) {
            let off = (0..UNKNOWNS)
                .map(|at| (sides[0][at] + sides[1][at]).abs())
                .fold(0.0, f64::max);
            assert!(
                off < 1e-12 && sides[0].iter().any(|by| by.abs() > 0.05),
                "{sides:?}"
            );
        }
    }

    #[test]
    fn the_area_that_pixels_see_is_that_of_the_pupils_image_on_the_sample() {
        let rig = Rig::load("rcg-3").unwrap();
        let mut part = SeenPart::of(&rig).unwrap();
        let camera = View::camera(&rig);
        let at = camera.pixel(from_degrees(30.0, 40.0)).unwrap();
        let found = part.area(&rig, [at].into_iter()).unwrap();
        assert!(
            found.median_mm2 > 0.01 && found.smallest_mm2.total_cmp(&found.largest_mm2).is_eq(),
            "{found}"
        );
        // Whatever its form, it goes with the square of the pupil's diameter, up to the sample.
        part.pupils_m[0] *= 0.5;
        let half = part.area(&rig, [at].into_iter()).unwrap();
        assert!(
            (4.0 * half.median_mm2 / found.median_mm2 - 1.0).abs() < 0.01,
            "{half}"
        );
        let mut small = rig.clone();
        small.sample.radius_m = 1e-6;
        let whole = part.area(&small, [at].into_iter()).unwrap().median_mm2;
        assert!((whole / (PI * 1e-6) - 1.0).abs() < 1e-9, "{whole}");
        assert_eq!(part.area(&rig, std::iter::empty()), None);
    }

    #[test]
    fn a_rig_that_says_nothing_of_its_pupils_has_no_part() {
        let mut rig = Rig::load("rcg-3").unwrap();
        let beside = SeenPart::of(&rig).unwrap().beside_nominal(&rig);
        assert!(beside.iter().all(|by| by.abs() < 1e-12), "{beside:?}");
        rig.projector.lens.pupil_m = 0.0;
        assert_eq!(SeenPart::of(&rig), None);
    }
}
