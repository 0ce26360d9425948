//! What hides the diffuse standard: the wire of the rig file, wherever it is, and what no rig file has.
//!
//! # Design
//! Where the rig as fitted says that the camera sees the standard, well away from hole, rim and horizon, its brightness follows a
//! smooth field; what is darker than that is behind something, or beside the standard, which the fit cannot tell: a camera that is a
//! millimetre off sees places of the sample that are many off. The field is a polynomial of the logarithm, fitted to what is not dark,
//! again and again.
//!
//! A wire is a strip of known width from the axis outwards: all azimuths are asked how dark the strip is there compared with what is
//! beside it, and it must be so over most of its length that is lit. Its own fit ([`super::solve`]) begins there. What else is dark with
//! light all around it becomes obstacles of the calibrated rig: polygons around the dark pixels and those beside them. What is dark
//! towards the border is left to the photometric calibration, which measures nothing where it has not seen its standard.

use glam::DVec2;
use nalgebra::{DMatrix, DVector};

use super::outlines::{around, connected, outlines};
use super::sightings::Sightings;
use crate::base::median::median;
use crate::hemisphere::judged::is_judged;
use crate::instrument::frame_format::pixel_centre;
use crate::instrument::optics::View;
use crate::instrument::parts::Obstacle;
use crate::instrument::rig::Rig;

/// Degree of the polynomial, its terms, and rounds in which what is dark is left out of it.
const DEGREE: i32 = 4;
const TERMS: usize = 15;
const ROUNDS: usize = 8;
/// Nothing is asked of pixels closer to an edge of hole or rim than this, radians, nor of directions that lean more, degrees.
const CLEAR_RAD: f64 = 0.03;
const FARTHEST_DEG: f64 = 75.0;
/// A pixel with less than this share of the light is in a shadow; those beside it that have less than the second are at its border.
const DARK: f64 = 0.8;
const DIM: f64 = 0.93;
/// So many standard deviations of the shares are no shadow.
const NOISE: f64 = 5.0;
/// What scatters more about the field is not lit, or is so little seen that no field describes it.
const NOISIEST: f64 = 0.15;
/// Fewest pixels that say something of shadows.
const FEWEST: usize = 300;
/// What has less than this share of the light has none.
const UNLIT: f64 = 0.5;
/// Step of the search for a wire, degrees; parts of its length.
const STEP_DEG: f64 = 0.25;
const PARTS: usize = 8;
/// Darkness of a strip against what is beside it, relative to what the wire must hide, from which on it is the wire.
const WIRE: f64 = 0.35;

/// How much of the light of the diffuse standard each pixel has that should see it.
pub(super) struct Shadows<'a> {
    camera: &'a View,
    width: usize,
    /// Share of the light that is expected; `None` of what cannot be asked.
    shares: Vec<Option<f64>>,
    /// Standard deviation of the shares by noise.
    noise: f64,
}

/// Where a wire was looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Wire {
    /// At this azimuth, degrees.
    At(f64),
    /// Nowhere, and where the rig file has it nothing can be seen.
    OutOfSight,
    /// Nowhere, though it should be in sight.
    Missing,
}

impl<'a> Shadows<'a> {
    /// Of the image of the standard that was `seen`, as the `camera` took it, which knows of no wire and no obstacles. `None` if too few
    /// pixels do, or it is not lit: then it tells nothing of shadows.
    pub(super) fn of(seen: &Sightings, camera: &'a View) -> Option<Self> {
        let (light, width) = (&seen.standard, seen.width);
        let height = light.len() / width.max(1);
        let farthest = FARTHEST_DEG.to_radians().cos();
        let is_asked = |pixel: usize| {
            let (u, v) = centre(pixel, width);
            let clear = camera.edge_within(u, v, CLEAR_RAD).is_none();
            clear
                && camera
                    .trace(u, v)
                    .is_ok_and(|trace| is_judged(trace.direction) && trace.direction.z > farthest)
        };
        let asked: Vec<usize> = (0..light.len()).filter(|pixel| is_asked(*pixel)).collect();
        if asked.len() < FEWEST {
            return None;
        }
        let asked_light: Vec<(DVec2, f64)> = asked
            .iter()
            .map(|&pixel| {
                let (u, v) = centre(pixel, width);
                let place = 2.0 * DVec2::new(u / width as f64, v / height as f64) - DVec2::ONE;
                (place, f64::from(light[pixel]))
            })
            .collect();
        let expected = field(&asked_light)?;
        let mut shares = vec![None; light.len()];
        let mut off = Vec::with_capacity(asked.len());
        for (&pixel, expected) in asked.iter().zip(&expected) {
            let share = f64::from(light[pixel]) / expected;
            if share > UNLIT {
                off.push((share - 1.0).abs());
            }
            shares[pixel] = Some(share);
        }
        let noise = 1.4826 * median(off)?;
        (noise <= NOISIEST).then_some(Self {
            camera,
            width,
            shares,
            noise,
        })
    }

    /// Looks for a wire of this half width all around; the rig file has it at `stated_deg`.
    pub(super) fn wire(&self, half_width_deg: f64, stated_deg: f64) -> Wire {
        // From the axis: azimuth, and sine of the polar angle.
        let places: Vec<(f64, f64, f64)> = self
            .shares
            .iter()
            .enumerate()
            .filter_map(|(pixel, share)| {
                let (u, v) = centre(pixel, self.width);
                let w = self.camera.from_f1(u, v)?;
                Some((w.y.atan2(w.x), w.x.hypot(w.y), (*share)?))
            })
            .collect();
        let pixel_rad = self.pixel_rad();
        let half_rad = half_width_deg.to_radians().max(pixel_rad / 2.0);
        // What a pixel in the middle of the strip loses.
        let hidden = (2.0 * half_width_deg.to_radians() / pixel_rad).min(1.0);
        let (mut best, mut best_deg, mut is_in_sight) = (0.0, None, false);
        for step in 0..(360.0 / STEP_DEG) as usize {
            let azimuth_deg = step as f64 * STEP_DEG;
            // By parts of the length: darkness and pixels within the strip, and beside it.
            let mut parts = [[0.0_f64; 4]; PARTS];
            for (azimuth_rad, sine, share) in &places {
                let off = azimuth_rad - azimuth_deg.to_radians();
                let beside = sine * off.sin().abs();
                if off.cos() <= 0.0 || beside > 2.0 * half_rad + 2.0 * pixel_rad {
                    continue;
                }
                let part = &mut parts[((sine * PARTS as f64) as usize).min(PARTS - 1)];
                let is_within = beside <= half_rad;
                if is_within || beside > half_rad + pixel_rad {
                    let at = if is_within { 0 } else { 2 };
                    part[at] += 1.0 - share;
                    part[at + 1] += 1.0;
                }
            }
            let seen: Vec<f64> = parts
                .iter()
                .filter(|part| part[1] > 0.0 && part[2] < (1.0 - UNLIT) * part[3])
                .map(|part| part[0] / part[1] - part[2] / part[3])
                .collect();
            if seen.len() < 2 {
                continue;
            }
            let off_deg = (azimuth_deg - stated_deg + 180.0).rem_euclid(360.0) - 180.0;
            is_in_sight |= off_deg.abs() <= super::parameters::ANGLE_DEG;
            let mean = seen.iter().sum::<f64>() / seen.len() as f64;
            let dark = seen.iter().filter(|part| **part > 0.4 * mean).count();
            if dark * 4 >= seen.len() * 3 && mean > best {
                (best, best_deg) = (mean, Some(azimuth_deg));
            }
        }
        tracing::debug!(best, ?best_deg, hidden, self.noise, "wire");
        match best_deg {
            Some(found_deg) if best > WIRE * hidden => Wire::At(found_deg),
            _ if is_in_sight => Wire::Missing,
            _ => Wire::OutOfSight,
        }
    }

    /// Angle across a pixel, seen from F1, in the middle of what is asked, radians.
    fn pixel_rad(&self) -> f64 {
        let across = |pixel: usize| {
            let (u, v) = centre(pixel, self.width);
            Some(
                self.camera
                    .from_f1(u, v)?
                    .angle_between(self.camera.from_f1(u + 1.0, v)?),
            )
        };
        let asked = (0..self.shares.len()).filter(|pixel| self.shares[*pixel].is_some());
        median(asked.filter_map(across).collect()).expect("invariant: some are asked")
    }

    /// Outlines of what is in the dark in front of the camera of `rig`, beside what its wire and obstacles hide.
    pub(super) fn obstacles(&self, rig: &Rig) -> Vec<Obstacle> {
        let known = View::camera(rig);
        let clearance_rad = 1.5 * self.pixel_rad();
        let is_unknown = |pixel: usize| {
            let (u, v) = centre(pixel, self.width);
            known.edge_within(u, v, clearance_rad).is_none()
        };
        let below = |limit: f64, sigmas: f64| limit.min(1.0 - sigmas * self.noise);
        let (dark, dim) = (below(DARK, NOISE), below(DIM, NOISE / 2.0));
        let is_below = |pixel: usize, limit: f64| self.shares[pixel].is_some_and(|share| share < limit);
        let may_belong: Vec<bool> = (0..self.shares.len())
            .map(|pixel| is_below(pixel, dim) && is_unknown(pixel))
            .collect();
        let mut components = connected(&may_belong, self.width);
        components.retain(|component| component.iter().any(|pixel| is_below(*pixel, dark)));
        // Where it is dark towards the border, too, that may be beside the standard.
        let is_closed = |component: &Vec<usize>| {
            let around = component
                .iter()
                .flat_map(|pixel| around(*pixel, self.width, self.shares.len()));
            around.into_iter().all(|beside| self.shares[beside].is_some())
        };
        components.retain(is_closed);
        outlines("shadow", &components, self.width, self.camera)
    }
}

/// The smooth field that the brightness at these places (−1 to 1) follows where it is not dark; `None` if there is no light.
fn field(light: &[(DVec2, f64)]) -> Option<Vec<f64>> {
    let mut sorted: Vec<f64> = light.iter().map(|(_, light)| *light).collect();
    let upper = sorted.len() * 19 / 20;
    let usual = *sorted.select_nth_unstable_by(upper, f64::total_cmp).1;
    if usual <= 0.0 {
        return None;
    }
    let terms = |at: DVec2| {
        let powers = (0..=DEGREE).flat_map(|i| (0..=DEGREE - i).map(move |j| (i, j)));
        DVector::from_iterator(TERMS, powers.map(|(i, j)| at.x.powi(i) * at.y.powi(j)))
    };
    let rows: Vec<DVector<f64>> = light.iter().map(|(at, _)| terms(*at)).collect();
    // In the dark there is no logarithm.
    let logarithms: Vec<f64> = light
        .iter()
        .map(|(_, light)| (light / usual).max(1e-3).ln())
        .collect();
    let mut expected = vec![0.0; light.len()];
    for round in 0..ROUNDS {
        // At first what is far from the usual brightness is left out, later what is far from the field.
        let lowest = if round == 0 {
            0.4_f64.ln()
        } else {
            DIM.ln() - 0.1 / round as f64
        };
        let (mut normal, mut right) = (DMatrix::zeros(TERMS, TERMS), DVector::zeros(TERMS));
        for ((row, logarithm), expected) in rows.iter().zip(&logarithms).zip(&expected) {
            if logarithm - expected > lowest {
                normal.ger(1.0, row, row, 1.0);
                right.axpy(*logarithm, row, 1.0);
            }
        }
        let found = normal.cholesky()?.solve(&right);
        for (expected, row) in expected.iter_mut().zip(&rows) {
            *expected = row.dot(&found);
        }
    }
    Some(
        expected
            .into_iter()
            .map(|logarithm| usual * logarithm.exp())
            .collect(),
    )
}

fn centre(pixel: usize, width: usize) -> (f64, f64) {
    pixel_centre(pixel, width).into()
}

#[cfg(test)]
mod tests {
    use super::super::without_obstacles;
    use super::*;

    /// The image of a smooth field in which the camera of `rig` sees the standard, behind what the rig has; noise of 1 %.
    fn image(rig: &Rig, size: usize) -> Sightings {
        let camera = View::camera(rig);
        let light = (0..size * size)
            .map(|pixel| {
                // Nine places: an edge hides a part of a pixel.
                let (u, v) = centre(pixel, size);
                let places = (0..9).map(|at| {
                    (
                        u - 0.33 + 0.33 * f64::from(at % 3),
                        v - 0.33 + 0.33 * f64::from(at / 3),
                    )
                });
                let seen = places.filter(|(u, v)| camera.direction(*u, *v).is_ok()).count();
                let (x, y) = (u / size as f64 - 0.5, v / size as f64 - 0.5);
                let field = 1.0 + 0.3 * (3.0 * x).sin() * (2.0 * y).cos() - 0.2 * x * x;
                let noise = 0.01 * ((pixel * 7919 % 1000) as f64 / 1000.0 - 0.5) * 3.46;
                (1000.0 * field * (1.0 + noise) * seen as f64 / 9.0) as f32
            })
            .collect();
        Sightings {
            standard: light,
            width: size,
            ..Sightings::default()
        }
    }

    #[test]
    fn a_wire_is_found_at_any_azimuth_and_missed_where_there_is_none() {
        for (size, azimuth_deg) in [(96, 10.0), (128, 101.5), (160, 250.0), (128, 333.0)] {
            let nominal = Rig::load("rcg-1-16bit").unwrap().with_image_size(size).unwrap();
            let mut rig = nominal.clone();
            rig.wire.as_mut().unwrap().azimuth_deg = azimuth_deg;
            let bare = without_obstacles(&nominal);
            let camera = View::camera(&bare);
            let shadows = Shadows::of(&image(&rig, size as usize), &camera).unwrap();
            let Wire::At(found_deg) = shadows.wire(0.6, 270.0) else {
                panic!("{azimuth_deg}")
            };
            assert!(
                (found_deg - azimuth_deg).abs() < 1.0,
                "{azimuth_deg}: {found_deg}"
            );
            assert!(shadows.obstacles(&rig).is_empty());
            let shadows = Shadows::of(&image(&bare, size as usize), &camera).unwrap();
            assert_eq!(shadows.wire(0.6, 270.0), Wire::Missing);
            assert!(shadows.obstacles(&bare).is_empty());
        }
    }

    #[test]
    fn what_no_rig_file_has_is_covered_and_little_beside() {
        let nominal = without_obstacles(&Rig::load("rcg-3").unwrap())
            .with_image_size(128)
            .unwrap();
        let camera = View::camera(&nominal);
        let mut rig = nominal.clone();
        // A bent one and a speck.
        let outlines_deg: [&[[f64; 2]]; 2] = [
            &[
                [60.0, 5.0],
                [60.0, 50.0],
                [63.0, 50.0],
                [63.0, 9.0],
                [90.0, 9.0],
                [90.0, 5.0],
            ],
            &[[40.0, 300.0], [40.0, 302.0], [41.0, 301.0]],
        ];
        rig.obstacles = outlines_deg
            .iter()
            .map(|outline_deg| Obstacle {
                name: "true".to_owned(),
                outline_deg: outline_deg.to_vec(),
            })
            .collect();
        let shadows = Shadows::of(&image(&rig, 128), &camera).unwrap();
        let mut found = nominal.clone();
        found.obstacles = shadows.obstacles(&nominal);
        let cut = |rig: &Rig| View::camera(rig).cut_pixels(0.0);
        let (truly, found_cut, anyway) = (cut(&rig), cut(&found), cut(&nominal));
        let (mut hidden, mut too_many, mut missed) = (0, 0, 0);
        for pixel in 0..truly.len() {
            if anyway[pixel].is_none() && shadows.shares[pixel].is_some() {
                hidden += usize::from(truly[pixel].is_some());
                too_many += usize::from(truly[pixel].is_none() && found_cut[pixel].is_some());
                missed += usize::from(shadows.shares[pixel] < Some(0.9) && found_cut[pixel].is_none());
            }
        }
        println!("{hidden} {too_many} {missed}, {} outlines", found.obstacles.len());
        assert!(hidden > 50 && missed == 0, "{hidden} {missed}");
        assert!(too_many < 3 * hidden, "{too_many} of {hidden}");
    }
}
