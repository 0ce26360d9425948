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
    let (sin_tilt, cos_tilt) = tilt_deg.to_radians().sin_cos();
    // From the camera's frame to that of the sheet as a whole.
    let to_sheet = |w: DVec3| {
        DVec3::new(
            w.x,
            w.y * cos_tilt - w.z * sin_tilt,
            w.y * sin_tilt + w.z * cos_tilt,
        )
    };
    let (light, view) = (
        to_sheet(from_degrees(light_deg.0, light_deg.1)),
        to_sheet(DVec3::Z),
    );
    let half = size as f64 / 2.0;
    let mut radiance = vec![None; size];
    let mut rows = vec![(0.0, 0.0); size];
    let (mut pairs, mut columns) = (Vec::new(), Vec::new());
    for column in 0..size {
        let x = (column as f64 + 0.5) / half - 1.0;
        if x.abs() > HALF_WIDTH {
            continue;
        }
        let middle = height(x) * sin_tilt;
        rows[column] = (
            half * (1.0 - middle - HALF_HEIGHT * cos_tilt),
            half * (1.0 - middle + HALF_HEIGHT * cos_tilt),
        );
        radiance[column] = Some(Ok([0.0; 3]));
        let slope = -SLOPE * (WAVE * x).sin();
        let tangent = DVec3::new(1.0, 0.0, slope).normalize();
        let normal = tangent.cross(DVec3::Y);
        let local = |w: DVec3| DVec3::new(w.dot(tangent), w.y, w.dot(normal));
        if light.dot(normal) > HORIZON_COS && !is_shaded(x, light) {
            columns.push(column);
            pairs.push((local(light), local(view)));
        }
    }
    for ((column, value), (wi, _)) in columns.into_iter().zip(material.values(&pairs)?).zip(&pairs) {
        radiance[column] = Some(value.map(|f| f.map(|f| f * wi.z as f32)));
    }
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
}
