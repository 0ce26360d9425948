//! Light from all around: an environment map.
//!
//! # Design
//! A map is latitude–longitude, twice as wide as high: its upper edge is +y, its middle is what lies behind the object as the camera sees it
//! (−z), and longitude runs to the right as seen by somebody who looks at its middle (+x at three quarters of its width), so that its left
//! and right edges meet behind the camera (+z). It is the convention of OpenEXR (latitude–longitude environment maps), turned so that the
//! camera looks at the middle. Values are radiances in any unit; the picture's are in the same.
//!
//! What is brighter than all around it (the sun, lamps) is taken out as distant lights, whose light is all there; what is left is averaged
//! over solid angles of all sizes (a pyramid), so that however few directions are looked at, none of its light is missed.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use glam::{DQuat, DVec3, Vec3};
use rayon::prelude::*;

use crate::base::blame::Blame;

/// Largest width of a map in pixels.
const LARGEST: usize = 8192;
/// Width at which lights are told from their surroundings: 0.7° a pixel.
const FINEST: usize = 512;
/// Width of the coarsest level.
const COARSEST: usize = 8;
/// Share of the light of the whole map above which a pixel is a light.
const LIGHT: f64 = 1e-3;

/// Why an environment map cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {field}: expected {expected}, found {found}")]
pub struct EnvironmentError {
    path: String,
    field: &'static str,
    expected: String,
    found: String,
}

impl Blame for EnvironmentError {
    fn is_input(&self) -> bool {
        true
    }
}

/// One level of the pyramid, [row, column].
#[derive(Clone, Debug)]
struct Level {
    width: usize,
    radiance: Vec<Vec3>,
}

/// A distant light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Light {
    /// Unit vector towards it, in the frame of the picture.
    pub(super) direction: DVec3,
    /// Its irradiance on a plane that faces it.
    pub(super) irradiance: Vec3,
}

/// Radiance from all directions.
#[derive(Clone, Debug)]
pub struct Environment {
    /// From fine to coarse, without the lights.
    levels: Vec<Level>,
    pub(super) lights: Vec<Light>,
    /// Part of a whole turn by which the map is turned to the right.
    turns: f64,
}

impl Level {
    fn height(&self) -> usize {
        self.width / 2
    }

    /// Solid angle in sr of a pixel of `row`.
    fn solid_angle(&self, row: usize) -> f64 {
        let cos = |row: usize| (PI * row as f64 / self.height() as f64).cos();
        TAU / self.width as f64 * (cos(row) - cos(row + 1))
    }

    /// Direction of the middle of a pixel.
    fn direction(&self, index: usize) -> DVec3 {
        let (row, column) = (index / self.width, index % self.width);
        let (sin, cos) = (PI * (row as f64 + 0.5) / self.height() as f64).sin_cos();
        let longitude = TAU * ((column as f64 + 0.5) / self.width as f64 - 0.5);
        DVec3::new(longitude.sin() * sin, cos, -longitude.cos() * sin)
    }

    /// As this one with half of the pixels along each side, each the mean over its solid angle.
    fn halved(&self) -> Self {
        let width = self.width / 2;
        let mean = |index: usize| {
            let (row, column) = (2 * (index / width), 2 * (index % width));
            let weights = [row, row + 1].map(|row| self.solid_angle(row) as f32);
            let of = |row: usize| {
                let pixels = &self.radiance[row * self.width + column..][..2];
                0.5 * (pixels[0] + pixels[1])
            };
            (weights[0] * of(row) + weights[1] * of(row + 1)) / (weights[0] + weights[1])
        };
        Self {
            width,
            radiance: (0..width * width / 2).map(mean).collect(),
        }
    }

    /// Linear between the middles of pixels; the edges meet, and so do opposite meridians at the poles.
    fn at(&self, [longitude, latitude]: [f64; 2]) -> Vec3 {
        let (x, y) = (
            longitude * self.width as f64 - 0.5,
            latitude * self.height() as f64 - 0.5,
        );
        let (low_x, low_y) = (x.floor(), y.floor());
        let (tx, ty) = ((x - low_x) as f32, (y - low_y) as f32);
        let pixel = |dx: i64, dy: i64| {
            let (mut column, mut row) = (low_x as i64 + dx, low_y as i64 + dy);
            let height = self.height() as i64;
            if row < 0 || row >= height {
                row = row.clamp(0, height - 1);
                column += height;
            }
            self.radiance[row as usize * self.width + column.rem_euclid(self.width as i64) as usize]
        };
        (1.0 - ty) * ((1.0 - tx) * pixel(0, 0) + tx * pixel(1, 0))
            + ty * ((1.0 - tx) * pixel(0, 1) + tx * pixel(1, 1))
    }
}

impl Environment {
    /// Reads the Radiance (`.hdr`) or OpenEXR (`.exr`) file at `path`.
    ///
    /// # Errors
    /// [`EnvironmentError`] with path, field, expected and found: of what is no such picture, not twice as wide as high, or holds numbers
    /// that are no radiances.
    pub fn read(path: &Path) -> Result<Self, EnvironmentError> {
        let fail = |field, expected: &str, found: String| EnvironmentError {
            path: path.display().to_string(),
            field,
            expected: expected.to_owned(),
            found,
        };
        let readable = "a Radiance (.hdr) or OpenEXR (.exr) picture of red, green and blue";
        let (width, pixels) = super::linear::read(path).map_err(|error| fail("file", readable, error))?;
        let height = pixels.len() / width.max(1);
        if width != 2 * height || !(COARSEST..=LARGEST).contains(&width) {
            let expected = format!("a map twice as wide as high, {COARSEST} to {LARGEST} pixels wide");
            return Err(fail("size", &expected, format!("{width} × {height}")));
        }
        if let Some(place) = pixels
            .iter()
            .position(|pixel| !pixel.is_finite() || pixel.min_element() < 0.0)
        {
            let (column, row) = (place % width, place / width);
            let found = format!("{} in column {column}, row {row}", pixels[place]);
            return Err(fail("radiance", "finite numbers from 0 on", found));
        }
        if pixels.iter().all(|pixel| pixel.max_element() <= 0.0) {
            return Err(fail("radiance", "some light", "none".to_owned()));
        }
        Ok(Self::new(width, &pixels))
    }

    /// Of `pixels`, [row, column], `width` and half as many rows.
    pub(super) fn new(width: usize, pixels: &[Vec3]) -> Self {
        let mut level = resampled(width, pixels);
        let lights = level.take_lights();
        let mut levels = Vec::new();
        while level.width > COARSEST {
            let next = level.halved();
            levels.push(std::mem::replace(&mut level, next));
        }
        levels.push(level);
        Self {
            levels,
            lights,
            turns: 0.0,
        }
    }

    /// The same map turned about the upright axis: what was at its middle is `degrees` to the right.
    #[must_use]
    pub fn turned(mut self, degrees: f64) -> Self {
        let turn = DQuat::from_rotation_y(-degrees.to_radians());
        for light in &mut self.lights {
            light.direction = turn * light.direction;
        }
        self.turns += degrees / 360.0;
        self
    }

    /// Mean radiance over about `solid_angle` around the unit vector `w`, without the lights.
    pub(super) fn mean(&self, w: DVec3, solid_angle: f64) -> Vec3 {
        let finest = 2.0 * PI * PI / (self.levels[0].width * self.levels[0].height()) as f64;
        let last = self.levels.len() - 1;
        let level = (0.5 * (solid_angle / finest).log2()).clamp(0.0, last as f64);
        let (low, t) = (level as usize, level.fract() as f32);
        let [longitude, latitude] = place(w);
        let at = [longitude - self.turns, latitude];
        let fine = self.levels[low].at(at);
        if t > 0.0 {
            fine.lerp(self.levels[low + 1].at(at), t)
        } else {
            fine
        }
    }
}

/// Place of a direction on a map, from 0 to 1 along its width and its height.
fn place(w: DVec3) -> [f64; 2] {
    let longitude = w.x.atan2(-w.z) / TAU + 0.5;
    [longitude, w.y.clamp(-1.0, 1.0).acos() / PI]
}

/// `pixels` at a width that is a power of 2, at most [`FINEST`]: means over solid angles, by which no light is lost.
fn resampled(width: usize, pixels: &[Vec3]) -> Level {
    let target = FINEST.min(width.next_power_of_two());
    let columns: Vec<_> = (0..target)
        .map(|column| overlaps(column, target, width, |at| at))
        .collect();
    let mean = |index: usize| {
        let polar = |at: f64| -(PI * at).cos();
        let (mut sum, mut all) = (DVec3::ZERO, 0.0);
        for (row, height) in overlaps(index / target, target / 2, width / 2, polar) {
            for (column, length) in &columns[index % target] {
                sum += height * length * pixels[row * width + column].as_dvec3();
                all += height * length;
            }
        }
        (sum / all).as_vec3()
    };
    Level {
        width: target,
        radiance: (0..target * target / 2).into_par_iter().map(mean).collect(),
    }
}

/// The pixels of a line of `from` that pixel `index` of a line of `to` covers, and how much of each: what `measure` grows by.
fn overlaps(index: usize, to: usize, from: usize, measure: impl Fn(f64) -> f64) -> Vec<(usize, f64)> {
    let edge = |at: usize, of: usize| at as f64 / of as f64;
    let (first, last) = (index * from / to, ((index + 1) * from).div_ceil(to));
    (first..last.min(from))
        .map(|pixel| {
            let begin = edge(pixel, from).max(edge(index, to));
            let end = edge(pixel + 1, from).min(edge(index + 1, to));
            (pixel, measure(end) - measure(begin))
        })
        .collect()
}

impl Level {
    /// Takes out the pixels that hold more than [`LIGHT`] of all light, down to what is around them.
    fn take_lights(&mut self) -> Vec<Light> {
        let of = |radiance: Vec3| f64::from(radiance.dot(Vec3::new(0.299, 0.587, 0.114)));
        let light =
            |level: &Self, index: usize| level.solid_angle(index / level.width) * of(level.radiance[index]);
        let all: f64 = (0..self.radiance.len()).map(|index| light(self, index)).sum();
        // What one pixel of a map of one radiance holds is no light of its own.
        let usual = 8.0 * all / self.radiance.len() as f64;
        let threshold = (LIGHT * all).max(usual);
        let bright: Vec<usize> = (0..self.radiance.len())
            .filter(|&index| light(self, index) > threshold)
            .collect();
        let rest: Vec3 = {
            let others = (0..self.radiance.len()).filter(|index| bright.binary_search(index).is_err());
            let (sum, weight) = others.fold((DVec3::ZERO, 0.0), |(sum, weight), index| {
                let own = self.solid_angle(index / self.width);
                (sum + own * self.radiance[index].as_dvec3(), weight + own)
            });
            (sum / f64::max(weight, 1e-12)).as_vec3()
        };
        let mut lights = Vec::with_capacity(bright.len());
        for index in bright {
            let stays = self.radiance[index].min(rest);
            lights.push(Light {
                direction: self.direction(index),
                irradiance: self.solid_angle(index / self.width) as f32 * (self.radiance[index] - stays),
            });
            self.radiance[index] = stays;
        }
        lights
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_light_is_lost_between_the_map_and_what_lights() {
        // A sun of one pixel, a gradient, and an odd size.
        let (width, height) = (300, 150);
        let source = Level {
            width,
            radiance: (0..width * height)
                .map(|index| {
                    let sun = if index == 40 * width + 217 { 5000.0 } else { 0.0 };
                    Vec3::splat(1.0 + (index / width) as f32 / 75.0 + sun)
                })
                .collect(),
        };
        let all = |level: &Level| -> f64 {
            (0..level.radiance.len())
                .map(|index| level.solid_angle(index / level.width) * f64::from(level.radiance[index].y))
                .sum()
        };
        let environment = Environment::new(width, &source.radiance);
        let lights: f64 = environment
            .lights
            .iter()
            .map(|light| f64::from(light.irradiance.y))
            .sum();
        for level in &environment.levels {
            let found = all(level) + lights;
            assert!(
                (found / all(&source) - 1.0).abs() < 2e-3,
                "{}: {found}",
                level.width
            );
        }
        let sun = environment
            .lights
            .iter()
            .max_by(|a, b| a.irradiance.y.total_cmp(&b.irradiance.y))
            .unwrap();
        let expected = source.direction(40 * width + 217);
        assert!(sun.direction.angle_between(expected) < 0.012 && !environment.lights.is_empty());
    }

    #[test]
    fn a_map_lies_as_the_camera_sees_it_and_turns_to_the_right() {
        // Red where the camera looks, green to its right, blue above.
        let (width, height) = (64, 32);
        let level = Level {
            width,
            radiance: vec![Vec3::ZERO; width * height],
        };
        let pixels: Vec<Vec3> = (0..width * height)
            .map(|index| {
                let w = level.direction(index);
                Vec3::new(-w.z as f32, w.x as f32, w.y as f32).max(Vec3::ZERO)
            })
            .collect();
        assert!(
            pixels[height / 2 * width + width / 2].x > 0.99
                && pixels[height / 2 * width + width * 3 / 4].y > 0.99
        );
        let environment = Environment::new(width, &pixels);
        let seen = |environment: &Environment, w: DVec3| environment.mean(w, 1e-3);
        for (w, expected) in [
            (DVec3::NEG_Z, Vec3::X),
            (DVec3::X, Vec3::Y),
            (DVec3::Y, Vec3::Z),
            (DVec3::Z, Vec3::ZERO),
        ] {
            assert!(
                seen(&environment, w).distance(expected) < 0.06,
                "{w}: {}",
                seen(&environment, w)
            );
        }
        let turned = environment.turned(90.0);
        assert!(
            seen(&turned, DVec3::X).distance(Vec3::X) < 0.06,
            "{}",
            seen(&turned, DVec3::X)
        );
    }
}
