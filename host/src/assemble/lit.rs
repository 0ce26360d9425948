//! What lights each incident direction: the projector's pixels that were lit, not those that should have been.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::instrument::calibration::stray::{PROJECTOR_TERMS, lit_terms};
use crate::instrument::calibration::{Photometry, SEATED_DEG};
use crate::instrument::optics::View;
use crate::instrument::rig::Rig;
use crate::plan::pattern::PatternMaker;
use crate::plan::{Directions, Plan};

/// What the lit pixels of one incident direction are to its images.
pub(super) struct Lit {
    pub(super) direction: DVec3,
    /// Factor of f for their intensity, and its relative variance.
    pub(super) factor: f32,
    pub(super) relative2: f32,
    /// Relative standard uncertainty (k = 1) of f by how sample and standard lean.
    pub(super) leant: f32,
    /// Mean solid angle of a pixel; 0 where none is lit.
    pixel_sr: f64,
    /// Square of the angle from the direction to their middle, radians².
    pub(super) beside2: f32,
    /// Their terms for direct light, see [`lit_terms`].
    pub(super) terms: [f64; PROJECTOR_TERMS],
}

/// The lit pixels of each incident direction; nothing of those that are not lit.
pub(super) fn lit(
    rig: &Rig,
    plan: &Plan,
    directions: &Directions,
    photometry: Option<&Photometry>,
) -> Vec<Lit> {
    let projector = View::projector(rig);
    let maker = PatternMaker::new(projector.clone(), plan.spot_deg, rig.projector.irradiance);
    let (width_px, height_px) = maker.size_px();
    let field = photometry.map(|found| found.intensity.over(width_px, height_px));
    (0..directions.grid.len())
        .into_par_iter()
        .map(|index| {
            let mut of = Lit {
                direction: directions.grid.direction(index),
                factor: 1.0,
                relative2: 0.0,
                leant: 0.0,
                pixel_sr: 0.0,
                beside2: 0.0,
                terms: [0.0; PROJECTOR_TERMS],
            };
            let w: DVec3 = directions.grid.direction(index);
            let lit = directions.reasons[index].is_none().then(|| maker.lit_set(w).ok());
            let Some((lit, at)) = lit.flatten().zip(projector.pixel(w).ok()) else {
                return of;
            };
            of.pixel_sr = lit.solid_angle_sr / lit.pixels.len() as f64;
            of.beside2 = lit.centroid.angle_between(w).powi(2) as f32;
            let Some((found, field)) = photometry.zip(field.as_ref()) else {
                return of;
            };
            let [x, y] = place(&projector, at);
            let of_standard2 = found.standards[0].angular.variance(0, polar_deg(w));
            of.relative2 = (found.intensity.relative_uncertainty_at(x, y).powi(2) + of_standard2) as f32;
            of.leant = (2_f64.sqrt() * SEATED_DEG.to_radians() * w.z.acos().tan()) as f32;
            of.factor = (lit.irradiance / maker.irradiance_of(&lit, field)) as f32;
            of.terms = lit_terms(&lit.pixels, width_px, height_px);
            of
        })
        .collect()
}

pub(super) fn polar_deg(w: DVec3) -> f64 {
    w.z.clamp(-1.0, 1.0).acos().to_degrees()
}

/// Mean solid angle of the projector's pixels that are lit.
pub(super) fn pixel_sr(rows: &[Lit]) -> f64 {
    let lit = rows.iter().map(|lit| lit.pixel_sr).filter(|sr| *sr > 0.0);
    lit.clone().sum::<f64>() / lit.count().max(1) as f64
}

/// The image position `at` (pixels) as fields take it, −1 to 1 over the image.
pub(super) fn place(view: &View, at: DVec2) -> [f64; 2] {
    let half = |at: f64, size_px: u32| 2.0 * at / f64::from(size_px) - 1.0;
    [
        half(at.x, view.pinhole().width_px()),
        half(at.y, view.pinhole().height_px()),
    ]
}
