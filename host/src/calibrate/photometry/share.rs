//! How much of a pixel or of a spot of light the standard filled.
//!
//! # Design
//! A frame of the standard over what light and throughput say it should be is the share s of pixel and spot that the
//! standard filled: s = Σ g·p/var / Σ p²/var with the signal g and its prediction p, over the lit directions for a pixel, over
//! the pixels for a direction. What is not as predicted, beyond what noise and field leave uncertain, is off the sample: what is less
//! is cut, and what is more is cut less than it should be, so that nobody knows what is seen there. So is what lies beyond that, seen
//! from the normal: where its own edge should have ended it, a wrong edge may well seem right.
//!
//! The fields do not know that and would bend into the darkness. So they are fitted to what is whole, and what is whole is
//! judged by them, in turns (`turns`).

use glam::{DVec3, Vec4};
use rayon::prelude::*;

use super::rank_one::{Fields, Seen};
use super::{Black, Linear};
use crate::brdf::sample::Sample;
use crate::calibrate::CalibrateError;
use crate::instrument::calibration::lamp::SLOW;
use crate::instrument::calibration::lights;
use crate::instrument::calibration::stray::{Level, Removal, Room, Told, lanes};
use crate::instrument::calibration::{BLIND, EDGE, SEEN, Sight, UNSEEN};

/// A share is whole within so many of its standard uncertainties …
const CLEAR: f64 = 3.0;
/// … but at least within this, and at most within that.
const LEAST: f64 = 0.02;
const MOST: f64 = 0.5;
/// Within this θ every sample is seen, degrees.
pub(super) const NEAR_DEG: f64 = 52.0;
/// Before there are fields, what shines less than this share of the usual does not take part.
const DIM: f64 = 0.4;
/// Directions that judge a pixel, and pixels that judge a direction, about.
const LIGHTS: usize = 48;
const PIXELS: usize = 400;

/// What is wholly on the standard.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Judged {
    /// Of each pixel of the camera's image.
    pub(super) pixels: Vec<bool>,
    /// Of each place of the stand's directions.
    pub(super) places: Vec<bool>,
}

impl Judged {
    /// Everything, until more is known.
    pub(super) fn all(pixels: usize, places: usize) -> Self {
        Self {
            pixels: vec![true; pixels],
            places: vec![true; places],
        }
    }
}

/// A frame of the standard.
pub(super) struct Lit<'a> {
    pub(super) dn: &'a [u16],
    /// What came other ways, linear digital numbers.
    pub(super) stray: Vec<f32>,
    /// What it tells of the lamp, if it does, and the lamp over that of the black frames.
    pub(super) told: Option<Told>,
    pub(super) lamp: Level,
}

impl Lit<'_> {
    /// What the spot shows, had the lamp been as in the black frames, where the frame shows `all` and a black one `black`, linear
    /// numbers above the dark level at the place `at`.
    pub(super) fn spot(&self, all: f64, black: f64, at: usize) -> f64 {
        (all - f64::from(self.stray[at])) / f64::from(self.lamp.light) - black
    }
}

/// The frames of the standard at one stand.
pub(super) struct Frames<'a> {
    pub(super) linear: &'a Linear,
    /// Linear.
    pub(super) black: &'a [f64],
    /// One of each place.
    pub(super) lit: Vec<Lit<'a>>,
    pub(super) standard: &'a dyn Sample,
}

/// Share and its relative variance.
#[derive(Clone, Copy, Default)]
struct Share {
    signal: f64,
    weight: f64,
}

impl Share {
    fn add(&mut self, signal: f64, predicted: f64, variance: f64) {
        self.signal += signal * predicted / variance;
        self.weight += predicted * predicted / variance;
    }

    /// Whether it is 1 within noise and the relative uncertainty of the prediction; not if nothing was predicted.
    fn is_whole(&self, relative: f64) -> bool {
        let margin = (CLEAR * (self.weight.recip() + relative * relative).sqrt()).clamp(LEAST, MOST);
        self.weight > 0.0 && (self.signal / self.weight - 1.0).abs() < margin
    }

    /// Whether it is more than `least`; not if nothing was predicted.
    fn is_above(&self, least: f64) -> bool {
        self.weight > 0.0 && self.signal / self.weight > least
    }
}

impl Seen<'_> {
    /// The `frames` of the directions from the place `first` on, with the stray light that `removal` finds in them and what they tell of
    /// the lamp; `black` is the black frame, linear.
    pub(super) fn lit<'b>(
        &self,
        first: usize,
        frames: &[&'b [u16]],
        linear: &Linear,
        black: &[f64],
        removal: &Removal,
    ) -> Vec<Lit<'b>> {
        let channels = self.channels;
        let saturation = linear.of(self.saturation_dn) as f32;
        let one = |room: &mut Room, (place, dn): (usize, &&'b [u16])| {
            let more = |at: usize| {
                let dn = f64::from(dn[at]);
                if linear.trusts(dn) {
                    linear.of(dn) - black[at]
                } else {
                    f64::NAN
                }
            };
            let shown: Vec<Vec4> = (0..dn.len() / channels)
                .map(|pixel| lanes(channels, |channel| more(pixel * channels + channel)))
                .collect();
            removal.find(
                &shown,
                &self.lit_terms[first + place],
                self.exposure_s,
                saturation,
                room,
            );
            let told = removal.told(
                |pixel| shown[pixel] - room.stray[pixel],
                |pixel| lanes(channels, |channel| black[pixel * channels + channel]),
                |pixel| room.doubt[pixel],
            );
            let stray = room.stray.iter().map(Vec4::to_array);
            Lit {
                dn,
                stray: stray.flat_map(|lanes| lanes.into_iter().take(channels)).collect(),
                told,
                lamp: Level::SAME,
            }
        };
        frames
            .par_iter()
            .enumerate()
            .map_init(Room::default, one)
            .collect()
    }

    /// Sets the lamp of all the `frames` of the stand by what they told of it together, as `removal` has it, beside so many black
    /// ones.
    pub(super) fn set_lamp(frames: &mut [Lit], removal: &Removal, black: usize) {
        let told: Vec<Told> = frames.iter().filter_map(|frame| frame.told).collect();
        let bias = removal.bias(&told, black, SLOW);
        for frame in frames {
            frame.lamp = removal.level(frame.told, bias);
        }
    }

    /// Compares the lamp in the `black` frames of the stand with what watches it in the calibration.
    ///
    /// # Errors
    /// [`CalibrateError::Views`] if another lamp must have been in it.
    pub(super) fn compare_lamp(&mut self, removal: &Removal, black: &Black) -> Result<(), CalibrateError> {
        let image = |of: &dyn Fn(usize) -> f64| -> Vec<Vec4> {
            (0..black.light.len() / self.channels)
                .map(|pixel| lanes(self.channels, |channel| of(pixel * self.channels + channel)))
                .collect()
        };
        let watching = image(&|at| black.light[at] - black.unwatched[at]);
        let others = image(&|at| black.unwatched[at]);
        let told = removal.level_of_watching(&watching, &others, black.counts, self.exposure_s);
        let Some(level) = told else {
            self.lamp = [1.0, SLOW];
            return Ok(());
        };
        self.lamp = [level.light, level.uncertainty].map(f64::from);
        if level.is_same_lamp() {
            return Ok(());
        }
        Err(CalibrateError::Views {
            expected: format!(
                "a lamp within {} % of itself in all views",
                100.0 * Level::LARGEST_CHANGE
            ),
            found: format!("{:.1} ± {:.1} %", 100.0 * level.light, 100.0 * level.uncertainty),
            advice: "let the lamp warm up, and take all views anew",
        })
    }

    /// Whether each pixel of the image takes part and sees nothing but the standard.
    pub(super) fn whole_pixels(&self) -> Vec<bool> {
        let mut whole = vec![false; self.judged.pixels.len()];
        for (index, ..) in &self.pixels {
            whole[*index] = self.judged.pixels[*index];
        }
        whole
    }

    /// Signal and its variance by noise, in linear digital numbers, of one number of a frame; `None` if it saturated.
    fn signal(frames: &Frames, place: usize, at: usize) -> Option<(f64, f64)> {
        let lit = &frames.lit[place];
        let dn = f64::from(lit.dn[at]);
        if !frames.linear.trusts(dn) {
            return None;
        }
        let camera = &frames.linear.camera;
        let all = frames.linear.of(dn);
        let noise = camera.read_variance_dn2();
        Some((
            lit.spot(all, frames.black[at], at),
            noise + all.max(0.0) / camera.gain_e_per_dn,
        ))
    }

    /// f in sr⁻¹ of `channel`.
    pub(super) fn f_of(&self, f: [f64; 3], channel: usize) -> f64 {
        if self.channels == 1 {
            f.iter().sum::<f64>() / 3.0
        } else {
            f[channel]
        }
    }

    /// Places that judge pixels: whole ones that take part in the fit, spread over all.
    fn judges(&self) -> Vec<usize> {
        let whole: Vec<usize> = (0..self.all_lit.len())
            .filter(|place| self.judged.places[*place] && self.takes_part_of(*place))
            .collect();
        let every = (whole.len() / LIGHTS).max(1);
        whole.into_iter().step_by(every).collect()
    }

    /// Drops at once what is far dimmer than the usual.
    pub(super) fn drop_the_dim(&mut self, frames: &Frames) {
        let places = self.judges();
        let rate = |place: usize, index: usize, wo: DVec3| {
            let (_, irradiance) = self.all_lit[place]?;
            let f = frames
                .standard
                .f(lights::direction(self.stand.directions[place]), wo);
            let (signal, _) = Self::signal(frames, place, index * self.channels)?;
            Some(signal / (self.f_of(f, 0) * irradiance))
        };
        let pixels: Vec<(usize, Option<f64>)> = self
            .pixels
            .iter()
            .map(|&(index, _, wo)| {
                (
                    index,
                    mean(places.iter().filter_map(|place| rate(*place, index, wo))),
                )
            })
            .collect();
        let every = (self.pixels.len() / PIXELS).max(1);
        let lights: Vec<(usize, Option<f64>)> = (0..self.all_lit.len())
            .map(|place| {
                let some = self.pixels.iter().step_by(every);
                (
                    place,
                    mean(some.filter_map(|&(index, _, wo)| rate(place, index, wo))),
                )
            })
            .collect();
        for (of, rates) in [
            (&mut self.judged.pixels, pixels),
            (&mut self.judged.places, lights),
        ] {
            let mut known: Vec<f64> = rates.iter().filter_map(|(_, rate)| *rate).collect();
            known.sort_by(f64::total_cmp);
            let usual = known.get(known.len() / 2).copied().unwrap_or(0.0);
            for (at, rate) in rates {
                of[at] = rate.is_none_or(|rate| rate > DIM * usual);
            }
        }
    }

    /// Of what is on the standard, keeps what is within `theta_deg` of the normal.
    pub(super) fn keep_within(&mut self, theta_deg: f64) {
        let least = theta_deg.to_radians().cos();
        for &(index, _, wo, _) in &self.all_pixels {
            self.judged.pixels[index] &= wo.z >= least;
        }
        for (is_whole, index) in self.judged.places.iter_mut().zip(&self.stand.directions) {
            *is_whole &= lights::direction(*index).z >= least;
        }
    }

    /// Judges by `fields` what is wholly on the standard: more than the share `least` of the prediction, or 1 within noise and
    /// fields if there is none.
    pub(super) fn judge(&mut self, frames: &Frames, fields: &Fields, least: Option<f64>) {
        let intensity: Vec<f64> = self
            .all_lit
            .iter()
            .map(|lit| lit.map_or(0.0, |([x, y], _)| fields.intensity.at(x, y)))
            .collect();
        let add = |share: &mut Share, place: usize, (index, throughput, wo): (usize, f64, DVec3)| {
            let Some((_, irradiance)) = self.all_lit[place] else {
                return;
            };
            let f = frames
                .standard
                .f(lights::direction(self.stand.directions[place]), wo);
            let scale = self.exposure_s * self.lamp[0] * irradiance * throughput * intensity[place];
            let lit = self.share(place, index);
            for channel in 0..self.channels {
                if let Some((signal, variance)) = Self::signal(frames, place, index * self.channels + channel)
                {
                    let predicted = scale * fields.sensitivity[channel] * self.f_of(f, channel) * lit;
                    share.add(signal, predicted, variance);
                }
            }
        };
        let is_whole = |share: Share, relative: f64| match least {
            Some(least) => share.is_above(least),
            None => share.is_whole(relative),
        };
        let places = self.judges();
        let mut pixels = vec![true; self.judged.pixels.len()];
        for &(index, o, wo, _) in &self.all_pixels {
            let mut share = Share::default();
            let throughput = fields.throughput.at(o[0], o[1]);
            for &place in &places {
                add(&mut share, place, (index, throughput, wo));
            }
            let relative = fields
                .throughput
                .relative_uncertainty_at(o[0], o[1])
                .hypot(fields.residual);
            pixels[index] = is_whole(share, relative);
        }
        let whole: Vec<(usize, f64, DVec3)> = self
            .pixels
            .iter()
            .filter(|(index, ..)| pixels[*index])
            .map(|&(index, o, wo)| (index, fields.throughput.at(o[0], o[1]), wo))
            .collect();
        let every = (whole.len() / PIXELS).max(1);
        let lights: Vec<bool> = (0..self.all_lit.len())
            .map(|place| {
                let Some((p, _)) = self.all_lit[place] else {
                    return true;
                };
                let mut share = Share::default();
                for at in whole.iter().skip(place % every).step_by(every) {
                    add(&mut share, place, *at);
                }
                let relative = fields.intensity.relative_uncertainty_at(p[0], p[1]);
                is_whole(share, relative.hypot(fields.residual))
            })
            .collect();
        if least.is_none() {
            self.keep_joined(&mut pixels);
        }
        self.judged.pixels = pixels;
        self.judged.places = lights;
    }

    /// Of the `pixels` that are whole, keeps those that whole ones join to where every sample is seen.
    fn keep_joined(&self, pixels: &mut [bool]) {
        let near = NEAR_DEG.to_radians().cos();
        let mut whole = vec![false; pixels.len()];
        for &(index, ..) in &self.all_pixels {
            whole[index] = pixels[index];
        }
        let from = self.all_pixels.iter().filter(|(.., wo, _)| wo.z >= near);
        let reached = reached(&whole, self.size_px.0, from.map(|(index, ..)| *index));
        for &(index, ..) in &self.all_pixels {
            pixels[index] = reached[index];
        }
    }

    /// What was seen, as files have it.
    pub(super) fn sight(&self) -> Sight {
        let (width, height) = self.size_px;
        let mut camera = vec![BLIND; width * height];
        for (index, _, _, at_edge) in &self.all_pixels {
            camera[*index] = match (self.judged.pixels[*index], at_edge) {
                (true, _) => SEEN,
                (false, true) => EDGE,
                (false, false) => UNSEEN,
            };
        }
        let mut incident = vec![BLIND; lights::LIGHTS];
        for ((index, lit), whole) in self
            .stand
            .directions
            .iter()
            .zip(&self.all_lit)
            .zip(&self.judged.places)
        {
            let of = &mut incident[*index];
            *of = match (*of, lit, whole) {
                (BLIND, None, _) => EDGE,
                (BLIND, Some(_), true) => SEEN,
                (BLIND, Some(_), false) => UNSEEN,
                // Lit again to fill the last segment.
                (before, ..) => before,
            };
        }
        Sight::new(self.stand.tilt, &camera, width, &incident)
    }
}

/// Which pixels of an image of this width, row by row, are reached `from` some over side by side `open` ones.
fn reached(open: &[bool], width: usize, from: impl Iterator<Item = usize>) -> Vec<bool> {
    let mut reached = vec![false; open.len()];
    let mut reach = |index: usize, to_go: &mut Vec<usize>| {
        if open[index] && !std::mem::replace(&mut reached[index], true) {
            to_go.push(index);
        }
    };
    let mut to_go = Vec::new();
    for index in from {
        reach(index, &mut to_go);
    }
    while let Some(index) = to_go.pop() {
        let x = index % width;
        let beside = [
            (x > 0).then(|| index - 1),
            (x + 1 < width).then_some(index + 1),
            index.checked_sub(width),
            Some(index + width).filter(|below| *below < open.len()),
        ];
        for next in beside.into_iter().flatten() {
            reach(next, &mut to_go);
        }
    }
    reached
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_is_what_is_as_predicted_and_no_more() {
        let share = |signal: f64, variance: f64| {
            let mut share = Share::default();
            share.add(signal, 100.0, variance);
            share
        };
        for (signal, variance, relative, whole) in [
            (100.0, 1.0, 0.0, true),
            (98.5, 1e-3, 0.0, true),
            (97.0, 1e-3, 0.0, false),
            (103.0, 1e-3, 0.0, false),
            (103.0, 1e-3, 0.02, true),
            (80.0, 100.0, 0.0, true),
            // What may be half or double tells nothing.
            (120.0, 100.0, 0.0, true),
            // What may be anything is not less than half.
            (60.0, 1e6, 0.0, true),
            (40.0, 1e6, 0.0, false),
        ] {
            assert_eq!(
                share(signal, variance).is_whole(relative),
                whole,
                "{signal} {variance} {relative}"
            );
        }
        assert!(!Share::default().is_whole(0.01));
    }

    #[test]
    fn beyond_darkness_nothing_is_reached() {
        let picture = ["###.#", "###.#", "##.##", "#..##"];
        let open: Vec<bool> = picture.concat().bytes().map(|pixel| pixel == b'#').collect();
        let found = reached(&open, 5, [0, 7].into_iter());
        let expected = ["###..", "###..", "##...", "#...."].concat();
        let expected: Vec<bool> = expected.bytes().map(|pixel| pixel == b'#').collect();
        assert_eq!(found, expected);
        // Nor over the end of a row into the next.
        assert_eq!(
            reached(&[false, true, true, false], 2, [1].into_iter()),
            [false, true, false, false]
        );
    }
}
