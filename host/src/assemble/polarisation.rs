//! What polarised light leaves uncertain.
//!
//! # Design
//! A first surface reflects more of the light that is polarised across the plane of light and view, a matte sample does not care. How far light
//! is polarised, and how far the camera prefers it, the rig says (`light.polarisation`); along which axis nobody does, so as often as not a value
//! is too high or too low by the degree times what a dielectric makes of it, n = 1.5, at the angle to the half vector. Metals make
//! less. What of a value is a first surface's is taken to be all that is beyond the dimmest of its image.

use glam::DVec3;

use crate::brdf::sample::across;
use crate::hemisphere::disk::Disk;

/// Reflectance of a dielectric at normal incidence, n = 1.5.
const F0: f64 = 0.04;
/// So many of the values of an image are dimmer than its dimmest.
const DIMMEST: f64 = 0.05;

/// What a stated degree of polarisation makes of images.
pub(super) struct Polarisation {
    /// Degree of polarisation (k = 1).
    degree: f32,
    /// Of each cell.
    directions: Vec<Option<DVec3>>,
}

impl Polarisation {
    /// Of images on `disk`, in light polarised by as much as `degree`.
    pub(super) fn new(degree: f64, disk: Disk) -> Self {
        Self {
            degree: degree as f32,
            directions: (0..disk.len()).map(|cell| disk.direction(cell)).collect(),
        }
    }

    /// For each cell, by how much a first surface may look brighter or darker in light from `wi`, relative (k = 1).
    pub(super) fn of_surface(&self, wi: DVec3) -> Vec<f32> {
        let of = |wo: &Option<DVec3>| {
            wo.map_or(0.0, |wo| {
                // The angle to the half vector h: ωi·h/|h| = |h|/2.
                self.degree * across(F0, 0.5 * (wi + wo).length()) as f32
            })
        };
        self.directions.iter().map(of).collect()
    }

    /// Variance of each cell of one channel of the image `f` (sr⁻¹, [cell, channel]) by that of a `surface`, into `variances`; 0 where nothing
    /// was measured.
    pub(super) fn variances(
        surface: &[f32],
        f: &[f32],
        measured: &dyn Fn(usize) -> bool,
        channel: usize,
        variances: &mut Vec<f32>,
    ) {
        let channels = f.len() / surface.len();
        let values = || (0..surface.len()).filter(|cell| measured(*cell));
        variances.clear();
        variances.extend(values().map(|cell| f[cell * channels + channel]));
        let dim = dimmest(variances);
        variances.clear();
        variances.resize(surface.len(), 0.0);
        for cell in values() {
            let gloss = (f[cell * channels + channel] - dim).max(0.0);
            variances[cell] = (surface[cell] * gloss).powi(2);
        }
    }
}

/// As dim as hardly any of `values`, which noise may make less than nothing.
fn dimmest(values: &mut [f32]) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let place = (DIMMEST * values.len() as f64) as usize;
    let (_, dimmest, _) = values.select_nth_unstable_by(place, f32::total_cmp);
    dimmest.max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;

    #[test]
    fn uncertain_is_gloss_where_it_polarises() {
        let disk = Disk::new(32);
        let surface = Polarisation::new(0.01, disk).of_surface(from_degrees(55.0, 0.0));
        let near = |w: DVec3| {
            let of = |cell: &usize| disk.direction(*cell).map_or(-1.0, |other| other.dot(w));
            let cell = (0..disk.len()).max_by(|a, b| of(a).total_cmp(&of(b))).unwrap();
            surface[cell]
        };
        assert!(near(from_degrees(57.0, 180.0)) > 9.5e-3);
        assert!(near(from_degrees(55.0, 0.0)) < 2e-4);
        let mut values: Vec<f32> = (0..100).map(|at| at as f32).collect();
        assert!((dimmest(&mut values) - 5.0).abs() < 1e-6);
        assert!(dimmest(&mut [-1.0; 40]).abs() < 1e-9 && dimmest(&mut []).abs() < 1e-9);
        // Of two channels the second: matte but for one cell, and one was not measured.
        let mut image = vec![0.1; 2 * disk.len()];
        let (glossy, dark) = (disk.len() / 2, disk.len() / 3);
        (image[2 * glossy + 1], image[2 * dark + 1]) = (0.5, f32::NAN);
        let mut variances = Vec::new();
        Polarisation::variances(&surface, &image, &|cell| cell != dark, 1, &mut variances);
        let expected = (surface[glossy] * 0.4).powi(2);
        let others: f32 = variances.iter().sum::<f32>() - variances[glossy];
        assert!((variances[glossy] / expected - 1.0).abs() < 1e-5 && others.abs() < 1e-12);
    }
}
