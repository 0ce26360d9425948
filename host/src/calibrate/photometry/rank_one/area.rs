//! What part of the standard pixels see and spots light, in the fit.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::{Fields, Seen};
use crate::instrument::calibration::{ELLIPSE, FAR, Patches, SeenPart, UNKNOWNS, Unknowns, lights};
use crate::instrument::optics::View;

/// Step in tolerances by which shares are differenced, the least share that says something, and what part of what is missing
/// of one the pupils' own shapes may make (k = 1).
const STEP: f64 = 0.02;
const LEAST_SHARE: f64 = 0.3;
const UNLIKE: f64 = 0.1;
/// Pairs of which so much is lit, to this relative standard uncertainty, tell what the fields leave.
const SURE_SHARE: f64 = 0.5;
const SURE: f64 = 0.01;

/// The share that is lit of what a pixel sees: its logarithm, how that changes with the unknowns of [`SeenPart`], and its
/// variance by what is left of where edges are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Area {
    pub(super) log: f64,
    pub(super) slopes: Unknowns,
    pub(super) variance: f64,
    /// Whether so much is lit that it says something, and whether a sample would have a value there.
    pub(super) is_lit: bool,
    pub(super) is_sure: bool,
}

impl Area {
    /// All of it.
    pub(super) const ALL: Self = Self {
        log: 0.0,
        slopes: [0.0; UNKNOWNS],
        variance: 0.0,
        is_lit: true,
        is_sure: true,
    };
}

impl Seen<'_> {
    /// The patches of all pixels and places by `part`.
    pub(super) fn patches_of(&self, part: &SeenPart) -> Patches {
        let (width, height) = View::projector(&self.rig).size_px();
        let pixels = |half: f64, size: usize| 0.5 * (half + 1.0) * size as f64;
        let projector_px: Vec<_> = self
            .all_lit
            .iter()
            .map(|lit| lit.map(|([x, y], _)| DVec2::new(pixels(x, width), pixels(y, height))))
            .collect();
        part.patches(&self.rig, &projector_px)
    }

    /// Takes what is seen and lit of the standard for as in `part`; where it is along the axes `aside` nothing tells.
    pub(in super::super) fn set_part(&mut self, part: &SeenPart, aside: &[DVec3]) {
        let patches = self.patches_of(part);
        let moved: Vec<Patches> = (0..UNKNOWNS)
            .map(|at| {
                let by = std::array::from_fn(|other| if other == at { STEP } else { 0.0 });
                self.patches_of(&part.moved(&by))
            })
            .collect();
        // What is left of where edges are, in tolerances.
        let mut left = SeenPart::LEFT;
        left[4] = left[4].hypot(ELLIPSE);
        for (left, tolerance) in left.iter_mut().zip(SeenPart::TOLERANCES) {
            *left /= tolerance;
        }
        // As far as edges are looked for both ways.
        let both = [FAR, -FAR];
        let moved_far = (0..UNKNOWNS).flat_map(|at| {
            both.map(|far| {
                let mut by = [0.0; UNKNOWNS];
                by[at] = far * left[at];
                part.moved(&by)
            })
        });
        let aside = aside
            .iter()
            .flat_map(|axis| both.map(|far| part.displaced(*axis * far * SeenPart::ALONG_M)));
        let apart: Vec<Patches> = moved_far
            .chain(aside)
            .map(|part| self.patches_of(&part))
            .collect();
        self.pairs.par_iter_mut().for_each(|pair| {
            let (lit, seen) = (pair.place as usize, pair.pixel as usize);
            let share = patches.share(lit, seen);
            let log = |share: f64| share.max(LEAST_SHARE / 10.0).ln();
            let slopes: Unknowns =
                std::array::from_fn(|at| (log(moved[at].share(lit, seen)) - log(share)) / STEP);
            // An edge that is sharp is far from linear.
            let off = |side: &Patches| (log(side.share(lit, seen)) - log(share)).abs() / FAR;
            let edges = apart
                .chunks_exact(2)
                .map(|sides| off(&sides[0]).max(off(&sides[1])).powi(2));
            let variance = edges.sum::<f64>() + (UNLIKE * (1.0 - share)).powi(2);
            pair.area = Area {
                log: log(share),
                slopes,
                variance,
                is_lit: share > LEAST_SHARE,
                is_sure: share > SURE_SHARE && variance < SURE * SURE,
            };
        });
        self.patches = Some(patches);
    }

    /// The share that light from everywhere, all of it, lights of what the pixel `index` sees.
    pub(in super::super) fn mean_share(&self, index: usize) -> f64 {
        let (mut sum, mut weights) = (0.0, 0.0);
        for (place, light) in self.stand.directions.iter().enumerate() {
            if self.all_lit[place].is_some() {
                let w = lights::direction(*light);
                // Rings of as many directions each: the solid angle of one goes by the sine.
                let weight = w.z * w.truncate().length();
                sum += weight * self.share(place, index);
                weights += weight;
            }
        }
        if weights > 0.0 { sum / weights } else { 1.0 }
    }

    /// Trusts pairs as the `fields` say that were fitted to this stand among others.
    pub(in super::super) fn set_trust(&mut self, fields: &Fields, stand: usize) {
        if let Some(trust) = fields.trust.get(stand) {
            for (pair, trust) in self.pairs.iter_mut().zip(trust) {
                pair.trust = *trust;
            }
        }
    }

    /// The share that is lit of what the pixel `index` sees, with the spot of `place`.
    pub(in super::super) fn share(&self, place: usize, index: usize) -> f64 {
        self.patches
            .as_ref()
            .map_or(1.0, |patches| patches.share(place, index))
    }
}
