//! Which target stands in the holder, told by a few test exposures.
//!
//! # Design
//! Spots of light from some directions are shown one after the other. What is diffuse lights up as a whole, by as much as it reflects
//! and as the cosine of each direction against its normal: so brightness tells both (R. J. Woodham 1980, photometric stereo), where
//! it is lit at all: of a standard that stands beside the focus, light and view meet in a part only. It is the same part for most
//! spots, where a flat mirror shows a small image of each at another place, halfway between which and the spot is its normal. Brightness
//! is compared with the nominal rig, which is right to a factor rather than to percents: enough for which of two standards it is, and
//! whether anything is there. How well the standard is what it is said to be, nobody but the calibration can tell.

use std::f64::consts::PI;

use glam::{DMat3, DVec2, DVec3};

use super::capture::{Holder, maker};
use crate::base::median::median;
use crate::brdf::sample::Sample;
use crate::calibrate::CalibrateError;
use crate::capture::Instrument;
use crate::capture::pilot::TestExposures;
use crate::hemisphere::direction::{from_degrees, to_degrees};
use crate::instrument::calibration::lights;
use crate::instrument::frame_format::pixel_centre;
use crate::instrument::optics::{DirectionMap, View};
use crate::instrument::rig::Rig;

/// Opening of the cone of each spot, degrees.
const SPOT_DEG: f64 = 8.0;
/// Spots, about.
const SPOTS: usize = 12;
/// A pixel is lit that is brighter than this share of the brightest ones.
const LIT: f64 = 0.15;
/// By so much images of a diffuse target in the light of two spots are alike at least, on average: 1 where they are the same, 0 where
/// no pixel is lit in both.
const ALIKE: f64 = 0.4;
/// Below this reflectance, and below so many standard deviations of its noise, there is nothing.
const EMPTY: f64 = 0.01;
const CLEAR: f64 = 5.0;
/// Factor by which a standard may seem brighter or darker than it is said to be, at most.
const FACTOR: f64 = 2.5;
/// Angle in degrees up to which a diffuse target, and a mirror, stands as it should.
const LEANS_DEG: f64 = 20.0;
const MIRROR_DEG: f64 = 6.0;

/// What seems to stand in the holder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Looks {
    Nothing,
    /// A mirror of this normal.
    Mirror(DVec3),
    /// Something diffuse of this reflectance, about, and with this normal.
    Diffuse(f64, DVec3),
}

/// What should.
#[derive(Clone, Copy)]
pub(super) enum Wanted<'a> {
    Nothing,
    Mirror,
    /// A diffuse standard, beside which another one of this reflectance may be put in by mistake.
    Diffuse(&'a dyn Sample, Option<f64>),
}

/// Means of the channels of one test exposure, and where the camera's pixels see.
struct Seen {
    light: Vec<f64>,
    towards: DVec3,
    /// Light of a white diffuse target.
    white: f64,
}

impl Looks {
    /// What the `instrument` shows of it in the `holder`.
    pub(super) fn of(holder: &Holder, instrument: &mut Instrument) -> Result<Self, CalibrateError> {
        let rig = &holder.rig;
        let maker = maker(rig, SPOT_DEG);
        let every = (holder.directions.len() / SPOTS).max(1) | 1;
        let near = |at: &&usize| lights::angles_deg(**at).0 < 70.0;
        let spots: Vec<_> = holder
            .directions
            .iter()
            .filter(near)
            .step_by(every)
            .filter_map(|at| {
                Some((
                    lights::direction(*at),
                    maker.lit_set(lights::direction(*at)).ok()?,
                ))
            })
            .collect();
        let mut patterns = vec![Vec::new()];
        patterns.extend(spots.iter().map(|(_, lit)| lit.pixels.clone()));
        let tests = TestExposures::take(rig, &patterns, instrument)?;
        let channels = rig.channels();
        let mean = |dn: &[u16]| -> Vec<f64> {
            let pixels = dn.chunks_exact(channels);
            pixels
                .map(|dn| dn.iter().map(|dn| f64::from(*dn)).sum::<f64>() / channels as f64)
                .collect()
        };
        let black = mean(&tests.shots[0].dn);
        let per_irradiance =
            rig.projector.irradiance * rig.sensitivity_e() * tests.exposure_s / rig.gain_e_per_dn();
        let seen: Vec<Seen> = spots
            .iter()
            .zip(&tests.shots[1..])
            .map(|((towards, lit), shot)| Seen {
                light: mean(&shot.dn)
                    .iter()
                    .zip(&black)
                    .map(|(lit, black)| lit - black)
                    .collect(),
                towards: *towards,
                white: per_irradiance * lit.irradiance / PI,
            })
            .collect();
        Ok(told(rig, &seen))
    }

    /// What is wrong with it, if it is not what is `wanted`.
    pub(super) fn doubt(self, wanted: Wanted, name: &str) -> Option<String> {
        let is_right = match (wanted, self) {
            (Wanted::Nothing, Self::Nothing) => true,
            (Wanted::Mirror, Self::Mirror(normal)) => leans_deg(normal) <= MIRROR_DEG,
            (Wanted::Diffuse(standard, other), Self::Diffuse(reflectance, normal)) => {
                let stated = reflectance_of(standard);
                let apart = other.map_or(FACTOR, |other| {
                    (stated / other).max(other / stated).sqrt().min(FACTOR)
                });
                let off = (reflectance / stated).max(stated / reflectance);
                leans_deg(normal) <= LEANS_DEG && off <= apart
            }
            _ => false,
        };
        (!is_right).then(|| format!("expected the {name}, found {}", self.words()))
    }

    fn words(self) -> String {
        match self {
            Self::Nothing => "next to nothing: an empty holder or a trap, or no light".to_owned(),
            Self::Mirror(normal) => {
                let (tilt_deg, azimuth_deg) = to_degrees(normal);
                format!(
                    "a mirror at about {tilt_deg:.0}° / {:.0}°",
                    azimuth_deg.rem_euclid(360.0)
                )
            }
            Self::Diffuse(reflectance, normal) => format!(
                "something diffuse that reflects about {reflectance:.2} and leans by about {:.0}° from where it should stand",
                leans_deg(normal)
            ),
        }
    }
}

fn leans_deg(normal: DVec3) -> f64 {
    to_degrees(normal).0
}

/// Of a white diffuse sample, what a diffuse `standard` reflects of light from 45° to 0°.
pub(super) fn reflectance_of(standard: &dyn Sample) -> f64 {
    let f = standard.f(from_degrees(45.0, 0.0), from_degrees(10.0, 180.0));
    PI * f.iter().sum::<f64>() / 3.0
}

/// What stands in the holder of `rig` by what was `seen`.
fn told(rig: &Rig, seen: &[Seen]) -> Looks {
    let camera = View::camera(rig);
    let map = DirectionMap::of(&camera);
    let sees: Vec<bool> = map.directions.iter().map(Result::is_ok).collect();
    let of_sample = |light: &[f64]| -> Vec<f64> {
        let seen = light.iter().zip(&sees);
        seen.filter_map(|(light, sees)| sees.then_some(*light)).collect()
    };
    let lights: Vec<Vec<f64>> = seen.iter().map(|one| of_sample(&one.light)).collect();
    // All spots together: of a mirror each is a small image somewhere.
    let mut sum = vec![0.0; lights.first().map_or(0, Vec::len)];
    for light in &lights {
        sum.iter_mut().zip(light).for_each(|(sum, light)| *sum += light);
    }
    if sum.is_empty() {
        return Looks::Nothing;
    }
    let steps = sum.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let noise = (1.05 * median(steps.collect()).unwrap_or(0.0)).max(0.5);
    let bright = brightest(&sum);
    let mean = |light: &[f64]| light.iter().sum::<f64>() / light.len() as f64;
    let levels = |of: &dyn Fn(&[f64]) -> f64| -> Vec<(DVec3, f64)> {
        let each = seen.iter().zip(&lights);
        each.map(|(one, light)| (one.towards, of(light) / one.white * one.towards.z))
            .collect()
    };
    let (of_all, _) = stereo(&levels(&mean));
    let (reflectance, normal) = stereo(&levels(&|light| {
        let bright = brightest(light);
        let lit: Vec<f64> = light
            .iter()
            .copied()
            .filter(|light| *light > LIT * bright)
            .collect();
        if lit.is_empty() { 0.0 } else { mean(&lit) }
    }));
    let alike = alike(&lights);
    tracing::debug!(
        alike,
        bright,
        noise,
        reflectance,
        lean = leans_deg(normal),
        "looks"
    );
    if bright < CLEAR * noise {
        return Looks::Nothing;
    }
    if alike >= ALIKE {
        return if of_all < EMPTY {
            Looks::Nothing
        } else {
            Looks::Diffuse(reflectance, normal)
        };
    }
    let peak = lights.iter().flatten().copied().fold(0.0, f64::max);
    let width = rig.frame_format().width_px;
    let normals = seen
        .iter()
        .filter_map(|one| halfway(&camera, one, width, 0.3 * peak));
    let normals: Vec<DVec3> = normals.collect();
    let axis = |at: usize| median(normals.iter().map(|normal| normal[at]).collect());
    match (axis(0), axis(1), axis(2)) {
        (Some(x), Some(y), Some(z)) => Looks::Mirror(DVec3::new(x, y, z).normalize_or_zero()),
        _ => Looks::Nothing,
    }
}

/// What one pixel of 100 is brighter than.
fn brightest(light: &[f64]) -> f64 {
    let mut sorted = light.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted[sorted.len() * 99 / 100]
}

/// By how much images are alike, on average over all pairs: the cosine between them as vectors, of what is lit in them.
fn alike(lights: &[Vec<f64>]) -> f64 {
    let lit: Vec<Vec<f64>> = lights
        .iter()
        .map(|light| {
            let limit = LIT * brightest(light);
            light.iter().map(|light| (light - limit).max(0.0)).collect()
        })
        .collect();
    let dot = |one: &[f64], other: &[f64]| one.iter().zip(other).map(|(a, b)| a * b).sum::<f64>();
    let (mut sum, mut pairs) = (0.0, 0_u32);
    for (at, one) in lit.iter().enumerate() {
        for other in &lit[at + 1..] {
            sum += dot(one, other) / (dot(one, one) * dot(other, other)).sqrt().max(f64::MIN_POSITIVE);
            pairs += 1;
        }
    }
    sum / f64::from(pairs.max(1))
}

/// The direction halfway between a spot and the middle of what the `camera` sees of it brighter than `limit`.
fn halfway(camera: &View, seen: &Seen, width: usize, limit: f64) -> Option<DVec3> {
    let bright = seen.light.iter().enumerate().filter(|(_, light)| **light > limit);
    let (mut sum, mut weight) = (DVec2::ZERO, 0.0);
    for (pixel, light) in bright {
        sum += *light * pixel_centre(pixel, width);
        weight += light;
    }
    let at = (weight > 0.0).then(|| sum / weight)?;
    let out = camera.direction(at.x, at.y).ok()?;
    Some((out + seen.towards).normalize_or_zero())
}

/// Reflectance and normal that explain `levels`: light over that of a white target in full light, by the direction that it comes from.
fn stereo(levels: &[(DVec3, f64)]) -> (f64, DVec3) {
    let (mut matrix, mut vector) = (DMat3::ZERO, DVec3::ZERO);
    for (towards, level) in levels {
        matrix += DMat3::from_cols(*towards * towards.x, *towards * towards.y, *towards * towards.z);
        vector += *towards * *level;
    }
    if matrix.determinant().abs() < 1e-9 {
        return (0.0, DVec3::Z);
    }
    let found = matrix.inverse() * vector;
    (found.length(), found.normalize_or(DVec3::Z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::sample::parse;

    #[test]
    fn brightness_tells_reflectance_and_normal() {
        let normal = from_degrees(30.0, 70.0);
        let level = |turn: i32| {
            let towards = from_degrees(20.0 + f64::from(turn), 37.0 * f64::from(turn));
            (towards, 0.4 * towards.dot(normal))
        };
        let (reflectance, found) = stereo(&(0..9).map(level).collect::<Vec<_>>());
        assert!((reflectance - 0.4).abs() < 1e-9 && found.distance(normal) < 1e-9);
        assert_eq!(stereo(&[]), (0.0, DVec3::Z));
    }

    #[test]
    fn a_part_that_is_lit_by_all_spots_is_alike_and_small_images_of_each_are_not() {
        // 400 pixels, of which spot after spot lights some, above a veil of 2 %.
        let image =
            |lit: &dyn Fn(usize) -> f64| -> Vec<f64> { (0..400).map(|pixel| 0.02 + lit(pixel)).collect() };
        let part = |spot: usize| {
            image(&|pixel| {
                if pixel < 60 + 5 * spot {
                    0.5 + 0.05 * spot as f64
                } else {
                    0.0
                }
            })
        };
        let small = |spot: usize| image(&|pixel| if pixel / 20 == spot { 1.0 } else { 0.0 });
        let of = |image: &dyn Fn(usize) -> Vec<f64>| alike(&(0..9).map(image).collect::<Vec<_>>());
        assert!(of(&part) > 0.8, "{}", of(&part));
        assert!(of(&small) < 0.05, "{}", of(&small));
    }

    #[test]
    fn what_is_not_wanted_is_said() {
        let white = parse("lambert:0.98").unwrap();
        let standard = Wanted::Diffuse(white.as_ref(), Some(0.2));
        assert_eq!(Looks::Diffuse(0.8, DVec3::Z).doubt(standard, "standard"), None);
        for (found, said) in [
            (Looks::Diffuse(0.2, DVec3::Z), "reflects about 0.20"),
            (Looks::Diffuse(0.9, from_degrees(40.0, 0.0)), "leans by about 40°"),
            (
                Looks::Mirror(from_degrees(15.0, 240.0)),
                "a mirror at about 15° / 240°",
            ),
            (Looks::Nothing, "next to nothing"),
        ] {
            let sentence = found.doubt(standard, "standard").unwrap();
            assert!(
                sentence.contains("expected the standard") && sentence.contains(said),
                "{sentence}"
            );
        }
        assert_eq!(Looks::Nothing.doubt(Wanted::Nothing, "light trap"), None);
        assert!(
            Looks::Mirror(from_degrees(15.0, 0.0))
                .doubt(Wanted::Mirror, "flat mirror")
                .is_some()
        );
    }
}
