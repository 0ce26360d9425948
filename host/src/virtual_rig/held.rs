//! What stands in the holder of the virtual rig.
//!
//! # Design
//! A flat first-surface mirror cannot be a [`Sample`]: its BRDF is no function. Each camera pixel sees in it the piece of
//! the projector's image that lies along the mirrored direction, with the reflectance of the surface (black glass: 4 %, so
//! that ordinary exposure times do). As everywhere in the signal model the light of a direction is taken to fill the sample.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::brdf::sample::{Outgoing, Sample};
use crate::instrument::optics::{View, reflect};
use crate::instrument::rig::Rig;

/// What the holder holds.
#[derive(Clone)]
pub enum Held {
    /// A flat sample.
    Sample(Arc<dyn Sample>),
    /// A flat mirror.
    Mirror(FlatMirror),
    /// A light trap, or nothing: no light comes back.
    Trap,
}

impl Held {
    /// Whether it is the very sample that the `other` is.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Sample(one), Self::Sample(other)) => Arc::ptr_eq(one, other),
            (Self::Trap, Self::Trap) => true,
            _ => false,
        }
    }
}

/// A flat first-surface mirror in the holder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlatMirror {
    /// Unit normal of its surface, sample frame.
    pub normal: DVec3,
    /// Share of the light that it reflects.
    pub reflectance: f64,
}

impl FlatMirror {
    /// The direction towards which light from `w` is reflected; both away from the surface, sample frame.
    #[must_use]
    pub fn mirrored(&self, w: DVec3) -> DVec3 {
        -reflect(w, self.normal)
    }
}

/// A standard that reflects another share than is stated.
#[derive(Debug)]
pub(super) struct Off {
    pub(super) stated: Arc<dyn Sample>,
    pub(super) factor: f64,
}

/// The same under one incident direction.
struct OffOutgoing<'a>(Box<dyn Outgoing + 'a>, f64);

impl Sample for Off {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        Box::new(OffOutgoing(self.stated.incident(wi), self.factor))
    }

    fn is_isotropic(&self) -> bool {
        self.stated.is_isotropic()
    }
}

impl Outgoing for OffOutgoing<'_> {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        self.0.f(wo).map(|f| f * self.1)
    }

    fn across(&self, wo: DVec3) -> [f64; 3] {
        self.0.across(wo).map(|f| f * self.1)
    }
}

/// Parts per side of a camera pixel that each see one projector pixel.
const PARTS: usize = 4;

/// Which projector pixels each camera pixel sees in a flat mirror.
pub(super) struct Reflections {
    /// Row-major indices of projector pixels, [camera pixel, part]; `u32::MAX` where a part sees none.
    projector_px: Vec<[u32; PARTS * PARTS]>,
    reflectance: f64,
}

impl Reflections {
    /// Of `rig`, whose views these are of camera and projector.
    pub(super) fn of(rig: &Rig, [camera, projector]: &[View; 2], mirror: FlatMirror) -> Self {
        let format = rig.camera_format();
        let (width_px, height_px) = (format.width_px, format.height_px);
        let seen = |u_px: usize, v_px: usize| -> Option<DVec2> {
            let w = camera.direction(u_px as f64, v_px as f64).ok()?;
            projector.pixel(mirror.mirrored(w)).ok()
        };
        // The corners of the pixels; within one the way is straight enough.
        let columns = width_px + 1;
        let corners: Vec<Option<DVec2>> = (0..columns * (height_px + 1))
            .into_par_iter()
            .map(|index| seen(index % columns, index / columns))
            .collect();
        let projector_width_px = projector.pinhole().width_px();
        let part = |index: usize, part: usize| -> Option<u32> {
            let first = index / width_px * columns + index % width_px;
            let share = |step: usize| (step as f64 + 0.5) / PARTS as f64;
            let (x, y) = (share(part % PARTS), share(part / PARTS));
            let upper = corners[first]?.lerp(corners[first + 1]?, x);
            let lower = corners[first + columns]?.lerp(corners[first + columns + 1]?, x);
            let at = upper.lerp(lower, y);
            Some(at.y as u32 * projector_width_px + at.x as u32)
        };
        Self {
            projector_px: (0..width_px * height_px)
                .into_par_iter()
                .map(|index| std::array::from_fn(|at| part(index, at).unwrap_or(u32::MAX)))
                .collect(),
            reflectance: mirror.reflectance,
        }
    }

    /// Radiance of every camera pixel, relative, if the projector pixels have these intensities.
    pub(super) fn image(&self, intensity: &[f32]) -> Vec<f32> {
        let scale = self.reflectance as f32 / (PARTS * PARTS) as f32;
        let of = |px: &u32| intensity.get(*px as usize).copied().unwrap_or(0.0);
        self.projector_px
            .iter()
            .map(|parts| scale * parts.iter().map(of).sum::<f32>())
            .collect()
    }
}
