//! A corrugated sheet of the sample: a cloth in folds.
//!
//! # Design
//! The sheet's height is that of a cosine along x, its folds run upright, and its upper edge leans away from the
//! camera. The cloth follows it: +x of the sample is the tangent along the sheet across the folds, +y runs along
//! them. Camera and light are distant, so the radiance depends on the place along x only: every column of the
//! picture is one frame, evaluated once and exactly, however high the picture is.
//!
//! A fold shades its neighbour where the ray to the light meets the next crest. The ray rises, so that the first
//! crest on its way is the one that counts, and the point of it that reaches highest above the ray is where the sheet
//! is parallel to the ray: the shadow is exact too.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::DVec3;

use super::around::Place;
use super::{Content, Picture};
use crate::brdf::reflectance::Reflectance;
use crate::hemisphere::direction::{HORIZON_COS, from_degrees};
use crate::store::StoreError;

/// Half of the width of the sheet, in half widths of the picture.
const HALF_WIDTH: f64 = 0.96;
/// Half of its height along the folds.
const HALF_HEIGHT: f64 = 0.85;
/// Folds across the width.
const FOLDS: f64 = 4.0;
/// Steepest slope of the sheet.
const SLOPE: f64 = 0.7;
/// Radians of the fold per unit of x, and the height of a crest above the middle.
const WAVE: f64 = TAU * FOLDS / (2.0 * HALF_WIDTH);
const CREST: f64 = SLOPE / WAVE;

/// A sheet in a picture.
pub(super) struct Sheet {
    /// Half of the picture's pixels a side.
    half: f64,
    sin_tilt: f64,
    cos_tilt: f64,
}

impl Sheet {
    /// In a picture of `size` pixels a side, its upper edge leaning `tilt_deg` away from the camera.
    pub(super) fn new(size: usize, tilt_deg: f64) -> Self {
        let (sin_tilt, cos_tilt) = tilt_deg.to_radians().sin_cos();
        Self {
            half: size as f64 / 2.0,
            sin_tilt,
            cos_tilt,
        }
    }

    /// From the camera's frame to that of the sheet as a whole.
    fn to_sheet(&self, w: DVec3) -> DVec3 {
        let (sin, cos) = (self.sin_tilt, self.cos_tilt);
        DVec3::new(w.x, w.y * cos - w.z * sin, w.y * sin + w.z * cos)
    }

    /// And back.
    fn to_picture(&self, w: DVec3) -> DVec3 {
        let (sin, cos) = (self.sin_tilt, self.cos_tilt);
        DVec3::new(w.x, w.y * cos + w.z * sin, w.z * cos - w.y * sin)
    }

    fn x(&self, column: usize) -> f64 {
        (column as f64 + 0.5) / self.half - 1.0
    }

    /// The rows, in pixels, from and to which it covers a column.
    pub(super) fn rows(&self, column: usize) -> (f64, f64) {
        let x = self.x(column);
        if x.abs() > HALF_WIDTH {
            return (0.0, 0.0);
        }
        let middle = height(x) * self.sin_tilt;
        let edge = |side: f64| self.half * (1.0 - middle + side * HALF_HEIGHT * self.cos_tilt);
        (edge(-1.0), edge(1.0))
    }

    /// What stands in a column; `None` beside the sheet.
    pub(super) fn place(&self, column: usize) -> Option<Place> {
        let x = self.x(column);
        let slope = -SLOPE * (WAVE * x).sin();
        let tangent = DVec3::new(1.0, 0.0, slope).normalize();
        (x.abs() <= HALF_WIDTH).then(|| Place {
            at: DVec3::new(x, 0.0, 0.0),
            normal: self.to_picture(tangent.cross(DVec3::Y)),
            x: self.to_picture(tangent),
        })
    }

    /// Whether a fold stands between a place and what is in direction `w` of it.
    pub(super) fn is_shaded(&self, place: &Place, w: DVec3) -> bool {
        is_shaded(place.at.x, self.to_sheet(w))
    }
}

/// Renders a corrugated sheet of `size` pixels a side whose upper edge leans `tilt_deg` away from the camera, under a
/// light of unit irradiance from polar angle and azimuth `light_deg` (0, 0 is behind the camera; 90 is above).
///
/// # Errors
/// [`StoreError`] if the BRDF cannot be read.
pub fn corrugated(
    material: &dyn Reflectance,
    size: usize,
    tilt_deg: f64,
    light_deg: (f64, f64),
) -> Result<Picture, StoreError> {
    let sheet = Sheet::new(size, tilt_deg);
    let light = from_degrees(light_deg.0, light_deg.1);
    let mut radiance = vec![None; size];
    let (mut pairs, mut columns) = (Vec::new(), Vec::new());
    for (column, radiance) in radiance.iter_mut().enumerate() {
        let Some(place) = sheet.place(column) else {
            continue;
        };
        *radiance = Some(Ok([0.0; 3]));
        if light.dot(place.normal) > HORIZON_COS && !sheet.is_shaded(&place, light) {
            columns.push(column);
            pairs.push((place.local(light), place.local(DVec3::Z)));
        }
    }
    for ((column, value), (wi, _)) in columns.into_iter().zip(material.values(&pairs)?).zip(&pairs) {
        radiance[column] = Some(value.map(|f| f.map(|f| f * wi.z as f32)));
    }
    let rows = (0..size).map(|column| sheet.rows(column)).collect();
    Ok(Picture {
        size,
        content: Content::Columns { radiance, rows },
    })
}

/// Height of the sheet above its middle.
fn height(x: f64) -> f64 {
    CREST * (WAVE * x).cos()
}

/// Whether a fold stands between the sheet at `x` and the `light` (frame of the sheet).
fn is_shaded(x: f64, light: DVec3) -> bool {
    if light.z <= 0.0 {
        return true;
    }
    // The sheet is the same seen from either side.
    let x = if light.x < 0.0 { -x } else { x };
    let rise = light.z / light.x.abs();
    if rise >= SLOPE {
        return false;
    }
    // Where the sheet is parallel to the ray, ahead of a crest: −SLOPE·sin(kx) = rise.
    let ahead = -(rise / SLOPE).asin();
    debug_assert!((-FRAC_PI_2..=0.0).contains(&ahead));
    let turns = ((WAVE * x - ahead) / TAU).floor() + 1.0;
    let touch = (ahead + turns * TAU) / WAVE;
    height(touch) - height(x) > rise * (touch - x)
}

#[cfg(test)]
mod tests {
    use super::super::{Environment, corrugated_in};
    use super::*;
    use crate::brdf::reflectance::Value;
    use crate::brdf::sample::parse;

    /// Radiance per column of a Lambert sheet of albedo 1, times π.
    fn columns(tilt_deg: f64, light_deg: (f64, f64)) -> Vec<Option<f64>> {
        let picture = corrugated(&parse("lambert:1").unwrap(), 400, tilt_deg, light_deg).unwrap();
        let Content::Columns { radiance, .. } = picture.content else {
            panic!("columns")
        };
        let level = |value: Value| f64::from(value.unwrap()[0]) * std::f64::consts::PI;
        radiance.into_iter().map(|value| value.map(level)).collect()
    }

    #[test]
    fn a_sheet_receives_what_falls_on_the_plane() {
        // Without loss to the sides: the mean of cosθi over the surface, per area of the plane, is that of the plane,
        // shadows included.
        for (tilt_deg, light_deg) in [
            (0.0, (0.0, 0.0)),
            (0.0, (60.0, 0.0)),
            (0.0, (75.0, 180.0)),
            (30.0, (70.0, 20.0)),
        ] {
            let (sin_tilt, cos_tilt) = f64::to_radians(tilt_deg).sin_cos();
            let light = from_degrees(light_deg.0, light_deg.1);
            let expected = light.y * sin_tilt + light.z * cos_tilt;
            let lit = columns(tilt_deg, light_deg);
            let mut sum = 0.0;
            let mut count = 0.0;
            for (column, level) in lit.iter().enumerate() {
                let x = (column as f64 + 0.5) / 200.0 - 1.0;
                if let Some(level) = level {
                    sum += level * (SLOPE * (WAVE * x).sin()).hypot(1.0);
                    count += 1.0;
                }
            }
            let found = sum / count;
            assert!(
                (found / expected - 1.0).abs() < 0.02,
                "{tilt_deg} {light_deg:?}: {found} {expected}"
            );
        }
    }

    #[test]
    fn shadows_are_those_that_a_march_along_the_ray_finds() {
        for (theta_deg, phi_deg) in [(50.0, 0.0), (70.0, 180.0), (85.0, 30.0), (80.0, 250.0)] {
            let light = from_degrees(theta_deg, phi_deg);
            for k in 0..500 {
                let x = f64::from(k) / 250.0 - 1.0;
                let clearance = (1..4000)
                    .map(|step| {
                        let along = f64::from(step) * 5e-4;
                        height(x) + along * light.z / light.x.abs() - height(x + along * light.x.signum())
                    })
                    .fold(f64::INFINITY, f64::min);
                if clearance.abs() > 1e-4 {
                    assert_eq!(
                        is_shaded(x, light),
                        clearance < 0.0,
                        "{theta_deg} {phi_deg} {x} {clearance}"
                    );
                }
            }
        }
    }

    #[test]
    fn cloth_follows_the_sheet() {
        // Brass has its sharp axis across the folds: at a crest of an untilted sheet that is lit and seen straight on
        // the frame is that of the plane, and the other way round elsewhere it is turned with the slope.
        let brass = parse("ward:brass").unwrap();
        let picture = corrugated(&brass, 400, 0.0, (20.0, 0.0)).unwrap();
        let Content::Columns { radiance, .. } = picture.content else {
            panic!("columns")
        };
        let light = from_degrees(20.0, 0.0);
        for column in [30_usize, 111, 199, 250, 333] {
            let x = (column as f64 + 0.5) / 200.0 - 1.0;
            let turned = glam::DQuat::from_rotation_y((-SLOPE * (WAVE * x).sin()).atan());
            let (wi, wo) = (turned * light, turned * DVec3::Z);
            let expected = brass.f(wi, wo)[0] * wi.z;
            let found = f64::from(radiance[column].unwrap().unwrap()[0]);
            assert!(
                (found / expected - 1.0).abs() < 1e-5,
                "{column}: {found} {expected}"
            );
        }
    }

    #[test]
    fn a_white_sheet_in_light_from_everywhere_sees_what_its_folds_leave() {
        let everywhere = Environment::new(64, &vec![glam::Vec3::ONE; 64 * 32]);
        let white = parse("lambert:1").unwrap();
        let picture = corrugated_in(&white, 96, 0.0, &everywhere).unwrap().picture;
        let Content::Columns { radiance, .. } = picture.content else {
            panic!("columns")
        };
        let mut signed = Vec::new();
        for (column, found) in radiance.into_iter().enumerate() {
            let Some(found) = found else { continue };
            let x = (column as f64 + 0.5) / 48.0 - 1.0;
            // Between edges at polar angles a and b from the normal, of a place that is the same along the folds: (sin a + sin b)/2.
            let lean = (SLOPE * (WAVE * x).sin()).atan();
            let edge = |side: f64| {
                let rises = (1..3000).map(|step| {
                    let away = f64::from(step) * 5e-4;
                    (height(x + side * away) - height(x)) / away
                });
                FRAC_PI_2 - rises.fold(0.0, f64::max).atan() - side * lean
            };
            let expected = f64::midpoint(edge(1.0).min(FRAC_PI_2).sin(), edge(-1.0).min(FRAC_PI_2).sin());
            let found = f64::from(found.unwrap()[1]);
            assert!((found - expected).abs() < 0.015, "{column}: {found} {expected}");
            signed.push(found - expected);
        }
        let mean = signed.iter().sum::<f64>() / signed.len() as f64;
        assert!(signed.len() > 80 && mean.abs() < 0.002, "{mean}");
    }
}
